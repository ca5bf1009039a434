// SPDX-License-Identifier: Apache-2.0
// The tiles of a texture in a packed file: its pages in levels of half the size, cut into small
// images (store/FORMAT.md, "Tiles"). The engine's worker loads this with the first texture.

export const kSquare = 504, // pixels of a level that a tile shows, at most
  kMargin = 4; // more of them, on each side

const kMagic = 0x4c54544d,
  kVersion = 1,
  kStart = 16, // bytes that tell how long the head is
  kPageBytes = 12,
  kLevelBytes = 16,
  kEntryBytes = 8, // of a tile, in the index of its level
  kChecksum = 8,
  kCoarsestSide = 120,
  kMostLevels = 32,
  kMostSide = 2 ** 20,
  kMostPages = 65536,
  kMostTiles = 2 ** 24;
const kFirstRead = 16384,
  kWholeLevel = 2 ** 18; // bytes of a level that is read in one piece

// Level l has the page scaled by 2^-l.
export interface TiledPage {
  width: number;
  height: number; // pixels
  levels: number; // 0: the page has no tiles
}

// Page, level, column, row.
export type TileName = readonly [number, number, number, number];

export interface TilesHead {
  pages: TiledPage[];
  kinds: string[]; // of the pages: media types of their tiles
  levels: {offset: number; bytes: number}[]; // by number, with their indexes
  bytes: number; // of the head itself
  checksum: bigint;
}

export type Checksum = (bytes: Uint8Array, seed: bigint) => bigint;

const across = (side: number) => Math.ceil(side / kSquare);
export function sizeOf(page: TiledPage, level: number) {
  const width = Math.ceil(page.width / 2 ** level),
    height = Math.ceil(page.height / 2 ** level);
  return {width, height, columns: across(width), rows: across(height)};
}

// With its margins.
export function tileSize(page: TiledPage, [, level, column, row]: TileName) {
  const {width, height} = sizeOf(page, level);
  return {
    width: Math.min(kSquare, width - kSquare * column) + 2 * kMargin,
    height: Math.min(kSquare, height - kSquare * row) + 2 * kMargin,
  };
}

export const levelsOf = (width: number, height: number) => {
  let levels = 1;
  while (Math.max(width, height) > kCoarsestSide * 2 ** (levels - 1)) ++levels;
  return levels;
};

const tilesIn = (page: TiledPage, level: number) => {
  if (level >= page.levels) return 0;
  const {columns, rows} = sizeOf(page, level);
  return columns * rows;
};
export const tilesOf = (head: TilesHead, level: number) =>
  head.pages.reduce((sum, page) => sum + tilesIn(page, level), 0);

// Of a tile among those of its level.
export function numberOf(head: TilesHead, [page, level, column, row]: TileName) {
  let number = 0;
  for (const before of head.pages.slice(0, page)) number += tilesIn(before, level);
  return number + row * sizeOf(head.pages[page]!, level).columns + column;
}

const viewOf = (bytes: Uint8Array) => new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
const damaged = (what: string) => new Error(`the tiles of the texture are damaged: ${what}`);

// The bytes of the head, from the first kStart bytes of `fileBytes`.
export function headBytes(start: Uint8Array, fileBytes: number): number {
  if (start.length < kStart || fileBytes < kStart) throw damaged('the head is cut off');
  const view = viewOf(start);
  if (view.getUint32(0, true) !== kMagic) throw damaged('these are none');
  const version = view.getUint16(4, true);
  if (version !== kVersion)
    throw new Error(
      `the tiles of the texture have version ${version}, this page reads ${kVersion}`,
    );
  const levels = view.getUint16(10, true),
    pages = view.getUint32(12, true);
  const bytes = kStart + kPageBytes * pages + kLevelBytes * levels + kChecksum;
  if (
    view.getUint16(6, true) !== kSquare ||
    view.getUint16(8, true) !== kMargin ||
    levels > kMostLevels ||
    pages > kMostPages ||
    bytes > fileBytes
  )
    throw damaged('impossible numbers in the head');
  return bytes;
}

// `bytes`: as many as headBytes says.
export function readHead(bytes: Uint8Array, fileBytes: number, checksum: Checksum): TilesHead {
  const view = viewOf(bytes),
    end = bytes.length - kChecksum;
  const found = view.getBigUint64(end, true);
  if (checksum(bytes.subarray(0, end), BigInt('L'.charCodeAt(0))) !== found)
    throw damaged('the checksum of the head is wrong');
  const levels = view.getUint16(10, true);
  const head: TilesHead = {pages: [], kinds: [], levels: [], bytes: bytes.length, checksum: found};
  let at = kStart;
  for (; at < end - kLevelBytes * levels; at += kPageBytes) {
    const width = view.getUint32(at, true),
      height = view.getUint32(at + 4, true),
      count = view.getUint8(at + 8),
      kind = view.getUint8(at + 9);
    const right =
      count === 0
        ? width === 0 && height === 0
        : Math.min(width, height) > 0 &&
          Math.max(width, height) <= kMostSide &&
          count === levelsOf(width, height);
    if (!right || kind > 1) throw damaged(`impossible numbers of page ${head.pages.length}`);
    head.pages.push({width, height, levels: count});
    head.kinds.push(kind === 1 ? 'image/png' : 'image/jpeg');
  }
  let from = head.bytes;
  for (; at < end; at += kLevelBytes) {
    const offset = Number(view.getBigUint64(at, true)),
      size = Number(view.getBigUint64(at + 8, true));
    if (offset !== from || size > fileBytes - from)
      throw damaged('its levels do not follow each other');
    head.levels.unshift({offset, bytes: size});
    from += size;
  }
  let tiles = 0;
  head.levels.forEach((level, i) => {
    const count = tilesOf(head, i);
    tiles += count;
    if (level.bytes < kEntryBytes * count + kChecksum) throw damaged('impossible levels');
  });
  const most = head.pages.reduce((n, page) => Math.max(n, page.levels), 0);
  if (from !== fileBytes || tiles > kMostTiles || most !== levels)
    throw damaged('impossible levels');
  return head;
}

const kMask = 2n ** 64n - 1n;
function mix64(x: bigint) {
  x = (x + 0x9e3779b97f4a7c15n) & kMask;
  x = ((x ^ (x >> 30n)) * 0xbf58476d1ce4e5b9n) & kMask;
  x = ((x ^ (x >> 27n)) * 0x94d049bb133111ebn) & kMask;
  return x ^ (x >> 31n);
}
// Mix('L', level).
export const indexSeed = (level: number) => mix64(mix64(BigInt('L'.charCodeAt(0))) ^ BigInt(level));

// Where the tiles of a level lie in the file, and their checksums.
export interface LevelIndex {
  ends: Float64Array; // in the file; tile i begins where the one before ends
  first: number; // where tile 0 begins
  checksums: Uint32Array;
}

export function readIndex(bytes: Uint8Array, head: TilesHead, level: number, checksum: Checksum) {
  const view = viewOf(bytes),
    count = tilesOf(head, level),
    end = kEntryBytes * count,
    {offset, bytes: levelBytes} = head.levels[level]!;
  const index: LevelIndex = {
    ends: new Float64Array(count),
    first: offset + end + kChecksum,
    checksums: new Uint32Array(count),
  };
  let at = index.first;
  for (let i = 0; i < count; ++i) {
    at += view.getUint32(kEntryBytes * i, true);
    index.ends[i] = at;
    index.checksums[i] = view.getUint32(kEntryBytes * i + 4, true);
  }
  if (
    checksum(bytes.subarray(0, end), indexSeed(level)) !== view.getBigUint64(end, true) ||
    at !== offset + levelBytes
  )
    throw damaged(`the index of level ${level} is wrong`);
  return index;
}

// Reads tiles. What is small comes in one piece: the head with what lies behind it, and coarse
// levels.
export class TileFile {
  private readonly kept: {offset: number; bytes: Uint8Array}[] = [];
  private readonly indexes = new Map<number, Promise<LevelIndex>>();

  private constructor(
    private readonly readPart: (
      offset: number,
      bytes: number,
      signal?: AbortSignal,
    ) => Promise<Uint8Array>,
    private readonly checksum: Checksum,
  ) {}
  head!: TilesHead;

  // `read`: bytes of the file of the tiles, which has so many.
  static async open(
    bytes: number,
    read: (offset: number, bytes: number, signal?: AbortSignal) => Promise<Uint8Array>,
    checksum: Checksum,
  ): Promise<TileFile> {
    const file = new TileFile(read, checksum);
    const start = await file.keep(0, Math.min(kFirstRead, bytes));
    const head = await file.read(0, headBytes(start, bytes));
    file.head = readHead(head, bytes, checksum);
    return file;
  }

  private async keep(offset: number, bytes: number) {
    const read = await this.readPart(offset, bytes);
    this.kept.push({offset, bytes: read});
    return read;
  }

  private async read(offset: number, bytes: number, signal?: AbortSignal): Promise<Uint8Array> {
    for (const part of this.kept) {
      const skip = offset - part.offset;
      if (skip >= 0 && skip + bytes <= part.bytes.length)
        return part.bytes.subarray(skip, skip + bytes);
    }
    return await this.readPart(offset, bytes, signal);
  }

  private indexOf(level: number): Promise<LevelIndex> {
    let index = this.indexes.get(level);
    if (!index) {
      index = this.readIndexOf(level);
      this.indexes.set(level, index);
      index.catch(() => this.indexes.delete(level)); // to be tried again
    }
    return index;
  }

  private async readIndexOf(level: number) {
    const {offset, bytes} = this.head.levels[level]!;
    const there = this.kept.some(
      p => p.offset <= offset && p.offset + p.bytes.length >= offset + bytes,
    );
    if (bytes <= kWholeLevel && !there) await this.keep(offset, bytes);
    const size = kEntryBytes * tilesOf(this.head, level) + kChecksum;
    return readIndex(await this.read(offset, size), this.head, level, this.checksum);
  }

  // The tile as an image file.
  async tile(name: TileName, signal?: AbortSignal): Promise<Blob> {
    const [page, level, column, row] = name;
    const index = await this.indexOf(level);
    const number = numberOf(this.head, name),
      begin = number === 0 ? index.first : index.ends[number - 1]!;
    const bytes = await this.read(begin, index.ends[number]! - begin, signal);
    if (Number(this.checksum(bytes, 0n) & 0xffffffffn) !== index.checksums[number])
      throw damaged(
        `tile ${column}, ${row} of level ${level} of page ${page} has a wrong checksum`,
      );
    return new Blob([bytes as Uint8Array<ArrayBuffer>], {type: this.head.kinds[page]!});
  }
}

const kAtOnce = 6, // requests
  kMostUntaken = 8; // images that the page has not put on the card yet
const kAgain = 5000; // milliseconds until what failed is tried again

// Gets the tiles that are wanted, the first ones first; drops requests for what is wanted no more.
export class TileQueue {
  private wanted: TileName[] = [];
  private readonly underWay = new Map<string, AbortController>();
  private readonly failed = new Map<string, number>(); // until when, performance.now()
  private untaken = 0;
  private closed = false;

  constructor(
    private readonly file: TileFile,
    private readonly decode: (image: Blob) => Promise<ImageBitmap>,
    private readonly give: (name: TileName, image: ImageBitmap) => void,
    private readonly fail: (tile: TileName, error: unknown) => boolean, // whether it helps to try again
  ) {}

  want(tiles: TileName[]) {
    this.wanted = tiles;
    const names = new Set(tiles.map(String));
    for (const [name, control] of this.underWay) if (!names.has(name)) control.abort();
    this.send();
  }

  // The page has used so many of the images that it was given.
  taken(count: number) {
    this.untaken -= count;
    this.send();
  }

  close() {
    this.closed = true;
    for (const control of this.underWay.values()) control.abort();
  }

  private send() {
    const now = performance.now();
    for (const tile of this.wanted) {
      if (this.closed || this.underWay.size + this.untaken >= kMostUntaken) return;
      if (this.underWay.size >= kAtOnce) return;
      const name = String(tile);
      if (!this.underWay.has(name) && !((this.failed.get(name) ?? 0) > now)) void this.get(tile);
    }
  }

  private async get(tile: TileName) {
    const name = String(tile),
      control = new AbortController();
    this.underWay.set(name, control);
    this.wanted = this.wanted.filter(other => other !== tile);
    try {
      const blob = await this.file.tile(tile, control.signal);
      const image = await this.decode(blob);
      if (this.closed) return image.close();
      ++this.untaken;
      this.give(tile, image);
    } catch (error) {
      if (!control.signal.aborted && !this.closed) {
        this.failed.set(name, this.fail(tile, error) ? performance.now() + kAgain : Infinity);
      }
    } finally {
      this.underWay.delete(name);
      this.send();
    }
  }
}
