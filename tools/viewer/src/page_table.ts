// SPDX-License-Identifier: Apache-2.0
// What the shader knows of a texture (shaders.ts): its pages, and for each tile of each level which
// tile on the card shows that place best, itself or one of a coarser level.
import {sizeOf, tileSize, type TiledPage, type TileName} from './texture_tiles';

export const kTableWidth = 1024, // of the tables, as textures
  kPageTexels = 3 + 32; // of a page: width, height, levels, and where the entries of each level begin

// Layers on the card have 4 x 4 cells, of which a tile takes 1, 2 or 4 each way, and all tiles of
// a layer as many. A cell has room for an eighth of 1024 pixels, and the margins.
export const kCell = 136,
  kCells = 4,
  kLayer = kCells * kCell;
export interface Shape {
  columns: number; // cells
  rows: number;
}
const cellsFor = (pixels: number) => (pixels <= kCell ? 1 : pixels <= 2 * kCell ? 2 : 4);
export function shapeOf(page: TiledPage, tile: TileName): Shape {
  const {width, height} = tileSize(page, tile);
  return {columns: cellsFor(width), rows: cellsFor(height)};
}
export const sameShape = (a: Shape, b: Shape) => a.columns === b.columns && a.rows === b.rows;
// Of tiles of a shape in a layer.
export const slotsOf = ({columns, rows}: Shape) => (kCells * kCells) / (columns * rows);
// In cells.
export function slotAt({columns, rows}: Shape, slot: number) {
  const across = kCells / columns;
  return {column: (slot % across) * columns, row: Math.floor(slot / across) * rows};
}

// Where a tile lies on the card, and its level, as an entry of the table; never 0.
export const placeOf = (layer: number, column: number, row: number) =>
  layer | (column << 10) | (row << 12) | (1 << 31);
const kLevelAt = 14;
const levelIn = (entry: number) => (entry >>> kLevelAt) & 31;

export class PageTable {
  readonly pages: Uint32Array<ArrayBuffer>;
  readonly entries: Uint32Array<ArrayBuffer>;
  // Where the entries of each level of each page begin, in ascending order.
  private readonly begins: {first: number; page: number; level: number; columns: number}[] = [];

  constructor(readonly list: TiledPage[]) {
    const padded = (size: number) =>
      new Uint32Array(Math.max(1, Math.ceil(size / kTableWidth)) * kTableWidth);
    this.pages = padded(kPageTexels * list.length);
    let next = 0;
    list.forEach((page, p) => {
      const at = kPageTexels * p;
      this.pages.set([page.width, page.height, page.levels], at);
      for (let level = 0; level < page.levels; ++level) {
        const {columns, rows} = sizeOf(page, level);
        this.pages[at + 3 + level] = next;
        this.begins.push({first: next, page: p, level, columns});
        next += columns * rows;
      }
    });
    this.size = next;
    this.entries = padded(next);
  }
  readonly size: number; // entries

  entryOf([page, level, column, row]: TileName): number {
    const first = this.pages[kPageTexels * page + 3 + level]!;
    return first + row * sizeOf(this.list[page]!, level).columns + column;
  }

  nameOf(entry: number): TileName {
    let low = 0,
      high = this.begins.length;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.begins[middle]!.first <= entry) low = middle;
      else high = middle;
    }
    const {first, page, level, columns} = this.begins[low]!,
      number = entry - first;
    return [page, level, number % columns, Math.floor(number / columns)];
  }

  // The coarsest tile of each page.
  coarsest(): TileName[] {
    return this.list.flatMap((page, p) =>
      page.levels > 0 ? [[p, page.levels - 1, 0, 0] as const] : [],
    );
  }

  parentOf([page, level, column, row]: TileName): TileName | null {
    return level + 1 < this.list[page]!.levels ? [page, level + 1, column >> 1, row >> 1] : null;
  }

  // The level of what shows a tile; null: nothing does.
  shownLevel(entry: number): number | null {
    const found = this.entries[entry]!;
    return found === 0 ? null : levelIn(found);
  }

  // Calls for the tile and all of finer levels that lie in it.
  private within([page, level, column, row]: TileName, act: (entry: number) => void) {
    for (let fine = level; fine >= 0; --fine) {
      const {columns, rows} = sizeOf(this.list[page]!, fine),
        scale = 2 ** (level - fine),
        first = this.entryOf([page, fine, 0, 0]);
      const right = Math.min(columns, (column + 1) * scale),
        below = Math.min(rows, (row + 1) * scale);
      for (let y = row * scale; y < below; ++y)
        for (let x = column * scale; x < right; ++x) act(first + y * columns + x);
    }
  }

  // The tile is at that place from now on; see placeOf.
  put(tile: TileName, place: number) {
    const [, level] = tile,
      entry = (place | (level << kLevelAt)) >>> 0;
    this.within(tile, at => {
      const there = this.entries[at]!;
      if (there === 0 || levelIn(there) >= level) this.entries[at] = entry;
    });
  }

  // The tile is there no more.
  drop(tile: TileName) {
    const gone = this.entries[this.entryOf(tile)]!,
      parent = this.parentOf(tile),
      instead = parent ? this.entries[this.entryOf(parent)]! : 0;
    this.within(tile, at => {
      if (this.entries[at] === gone) this.entries[at] = instead;
    });
  }
}

// A tile that is wanted, by so many pixels.
export interface Wanted {
  shape: Shape;
  pixels: number;
}

// Counts the layers that tiles take.
export class LayerCount {
  layers = 0;
  private readonly free = new Map<number, number>(); // slots, by shape
  add(shape: Shape) {
    const key = kCells * shape.columns + shape.rows,
      free = this.free.get(key) ?? 0;
    if (free === 0) ++this.layers;
    this.free.set(key, (free || slotsOf(shape)) - 1);
  }
  // Whether it takes no layer more.
  hasRoom(shape: Shape) {
    return (this.free.get(kCells * shape.columns + shape.rows) ?? 0) > 0;
  }
}

// Those that most pixels want, as many as fit so many layers. And how many layers all would take.
export function choose<T extends Wanted>(all: T[], layers: number): {chosen: T[]; needed: number} {
  const count = new LayerCount(),
    fits = new LayerCount(),
    chosen: T[] = [];
  for (const tile of [...all].sort((a, b) => b.pixels - a.pixels)) {
    count.add(tile.shape);
    if (fits.layers >= layers && !fits.hasRoom(tile.shape)) continue;
    fits.add(tile.shape);
    chosen.push(tile);
  }
  return {chosen, needed: count.layers};
}

// What is asked for by the pixels of a small picture: bytes of an entry, lowest first, and the
// object. Counts the entries of each object.
export function countAsked(pixels: Uint8Array): Map<number, Map<number, number>> {
  const books = new Map<number, Map<number, number>>();
  for (let i = 0; i < pixels.length; i += 4) {
    const book = pixels[i + 3]!;
    if (book === 0) continue;
    let counts = books.get(book);
    if (!counts) books.set(book, (counts = new Map()));
    const entry = pixels[i]! | (pixels[i + 1]! << 8) | (pixels[i + 2]! << 16);
    counts.set(entry, (counts.get(entry) ?? 0) + 1);
  }
  return books;
}
