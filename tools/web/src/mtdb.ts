// SPDX-License-Identifier: Apache-2.0
// mtdb: reads packed files of mtdb (`mtdb pack`) from any web server that answers ranges, and cuts
// meshes out of them. Runs in a worker of a page, or in node; calls of update() take the time that
// they are given, and some milliseconds more.
//
//   const file = await openFile('https://example.org/statue.mtdbp');
//   const object = await file.open('statue');
//   await object.settle({threshold: 0.001}, frame => show(frame));
import {decompress} from 'fzstd';

/** What went wrong; `code` is a word for programs, `message` a sentence for people. */
export class MtdbError extends Error {
  constructor(message: string, readonly code: ErrorCode) {
    super(message);
    this.name = 'MtdbError';
  }
}
/** memory: the page has no more. budget: maxBytes were read. closed: close() was called. */
export type ErrorCode =
  | 'invalid_argument' | 'not_found' | 'corrupt' | 'unsupported' | 'io' | 'no_space' | 'budget'
  | 'not_yet' | 'aborted' | 'memory' | 'closed' | 'other';

/** A query as docs/query.md has it: region, threshold, max_triangles. */
export type Query = Record<string, unknown>;
export type Point = [number, number, number];

export interface ObjectInfo {
  object: string;
  triangles: number;
  vertices: number;
  clusters: number;
  rounds: number;
  diagonal: number;
  rounding_error: number;
  bounds: {min: Point; max: Point};
  attributes: {name: string; type: string}[];
  /** Of lengths: um, mm, cm, m, km, in, ft, or empty: not said. */
  units: string;
  /** What is up, of length 1; not there in files of older programs. */
  up?: Point;
  /** Whether ingest was told so; else it was found from the shape. */
  up_given?: boolean;
  /** Of a terrain that was a raster. */
  raster?: {crs: string; height_units: string};
  /** Of an object whose triangles have texture coordinates; see Changes. */
  texture?: TextureInfo;
}

/** Bytes of the packed file: MeshObject.read() gets them. */
export interface FilePart {
  offset: number;
  bytes: number;
}

export interface TextureInfo {
  /** The image files, as they came; 0 bytes: the file has none. Sizes in pixels are 0 where they are not known. */
  pages: ({name: string; media_type: string; width: number; height: number} & FilePart)[];
  /** The pages in small images of several sizes (store/FORMAT.md, "Tiles"); null: of older programs. */
  tiles: FilePart | null;
}

export interface FileOptions {
  /** The engine: its URL, its bytes, or compiled. Default: engine.wasm beside this module. */
  wasm?: string | URL | BufferSource | WebAssembly.Module;
  /** Requests under way at once; default 6. */
  requests?: number;
  /** At most so many bytes are read; what is missing then stays missing. Default: no limit. */
  maxBytes?: number;
  /** So many bytes are asked for in a second at most; may be changed later (PackedFile.bytesPerSecond).
   * Default: no limit. */
  bytesPerSecond?: number;
  /** Of further ranges, once the first answer has told the ETag (as the header has it): a URL that never leads to another
   * file, whose answers may be kept. Default: the same URL. */
  urlOf?: (etag: string) => string | URL;
  /** Milliseconds without an answer after which a request is tried again; default 15000. */
  timeoutMilliseconds?: number;
  /** In place of the global fetch. */
  fetch?: typeof fetch;
  signal?: AbortSignal;
}

/** What a ray meets first, at full resolution. */
export interface Hit {
  point: Point;
  errorBound: number;
  /** The point is origin + parameter * direction. */
  parameter: number;
}

/** A mesh in arrays of its own. */
export interface Mesh {
  /** Three a vertex, model units. */
  positions: Float64Array;
  /** Three a triangle, counter-clockwise from outside. */
  indices: Uint32Array;
  /** The attributes of each vertex, `rowBytes` each, in the order of ObjectInfo.attributes. */
  rows: Uint8Array;
  rowBytes: number;
  errorBound: number;
  limit: Frame['limit'];
}

export interface ObjectOptions {
  /** Most memory of decoded clusters; default 256 MiB. What has no room leaves the mesh coarser. */
  cacheBytes?: number;
  /** Normals are those of the positions times this: for coordinates whose units differ, as degrees and metres. */
  stretch?: Point;
}

/** Slots [begin, end), one after the other in an array: begin, end, begin, end, ... */
export type Ranges = Uint32Array;

/** The mesh after an update. Slots without a triangle have the indices 0, 0, 0. */
export interface Frame {
  triangles: number;
  vertices: number;
  triangleSlots: number;
  vertexSlots: number;
  /** In the region, mesh and input are nowhere farther apart; model units. */
  errorBound: number;
  /** accuracy: the query is met. missing: clusters are on their way, failed, or have no room. time:
   * update() goes on with the same query. triangles: its limit was reached. */
  limit: 'accuracy' | 'triangles' | 'bytes' | 'time' | 'missing';
  /** Triangles whose bound is above the threshold around them, and by how much at most, model units. */
  shortfall: {triangles: number; excess: number} | null;
  missing: number;
  /** The largest error of what is missing over the threshold there. */
  worst: number;
  failed: number;
  /** Why the worst of these failed. */
  failure: string;
  failureCode: ErrorCode;
  /** Missing because cacheBytes are used up, as far as that was found; others were not even asked for. */
  noRoom: number;
  insertions: number;
  removals: number;
  bytesRead: number;
  requests: number;
  cacheBytes: number;
  decodedClusters: number;
}

/** Slots that changed since the last call of changes(). Views on the engine's memory: they hold until
 * the caller awaits anything, or calls another function. */
export interface Changes {
  triangleRanges: Ranges;
  vertexRanges: Ranges;
  normalRanges: Ranges;
  /** Three a triangle slot. */
  indices: Uint32Array;
  /** Three a vertex slot, relative to `origin`. */
  positions: Float32Array;
  origin: Point;
  /** Four a vertex slot: x, y, z in steps of 1/32767, and 0. */
  normals: Int16Array;
  /** The attributes of each vertex slot, `rowBytes` each, in the order of ObjectInfo.attributes. */
  rows: Uint8Array;
  rowBytes: number;
  /** Of textured objects, else empty: u and v of the three corners of each triangle slot, in the order of `indices`. u goes
   * to the right and v up, from 0 to 1 across the page; values beyond repeat it. */
  corners: Float32Array;
  /** Likewise: the page of each triangle slot, a place in TextureInfo.pages, or kNoPage. */
  pages: Uint32Array;
}

/** A triangle without an image. */
export const kNoPage = 0xffffffff;

/** What is known of each triangle slot; of empty ones nothing. Views on the engine's memory, as Changes. */
export interface TriangleFacts {
  /** The bound b(t) of docs/query.md, in model units. With a minus: at most so much, since the cluster that
   * would refine the triangle is not in memory. */
  errors: Float32Array;
  /** The cluster that made the triangle; from ObjectInfo.clusters on: pieces of the root. */
  clusters: Uint32Array;
  /** That cluster's round: 1 is the finest, 255 the root. */
  rounds: Uint8Array;
}

interface Exports {
  memory: WebAssembly.Memory;
  _initialize(): void;
  input(size: number): number;
  error(): number;
  error_size(): number;
  text(): number;
  text_size(): number;
  begin(size: number): void;
  keep(offset: number): void;
  open_file(): number;
  open_object(cacheBytes: number): number;
  wishes(): number;
  answer(ticket: number, code: number): void;
  update(milliseconds: number): number;
  report(): number;
  retry(): void;
  cast_ray(): number;
  extract(): number;
  found(): number;
  mesh_positions(): number;
  mesh_triangles(): number;
  mesh_rows(): number;
  mesh_free(): void;
  triangle_slots(): number;
  vertex_slots(): number;
  row_bytes(): number;
  origin(): number;
  indices(): number;
  positions(): number;
  normals(): number;
  stretch(x: number, y: number, z: number): void;
  rows(): number;
  corners(): number;
  pages(): number;
  checksum(seed: bigint): bigint;
  take_changes(): number;
  triangle_facts(): void;
  errors(): number;
  clusters(): number;
  rounds(): number;
}

const kFirstRead = 65536;
const kTries = 5;
const kNotYet = 303, kIoError = 300;
const kLimits = ['accuracy', 'triangles', 'bytes', 'time', 'missing'] as const;
// Of store/base/status.h.
const kCodes: Record<number, ErrorCode> = {
  100: 'invalid_argument', 101: 'not_found', 103: 'unsupported', 104: 'aborted', 105: 'no_space',
  201: 'corrupt', 300: 'io', 301: 'memory', 303: 'not_yet',
};
const kNoParts = 'the web server sends no parts of files (it ignores Range), as python3 -m http.server does; nginx, Apache, Caddy and mtdb serve do';
const kSmallFile = 64e6; // bytes that are taken whole from a server that sends no parts
const transient = new Set([408, 425, 429, 500, 502, 503, 504]);

/** The bytes of one file on a server: ranges, tried again where that may help. */
class FileRanges {
  size = 0;
  bytes = 0;
  private asked = 0;
  requests = 0;
  bytesPerSecond: number;
  replaced = false;
  private etag: string | null = null;
  private from: string; // where the next range is asked for
  private whole: Uint8Array | null = null; // of a server that sends no parts
  private readonly get: typeof fetch;
  private free = 0; // when more may be asked for; performance.now()

  constructor(readonly url: string, private readonly options: FileOptions) {
    this.get = options.fetch ?? ((input, init) => fetch(input, init));
    this.bytesPerSecond = options.bytesPerSecond ?? Infinity;
    this.from = url;
  }

  /** Milliseconds until more may be asked for. */
  wait() {
    return this.bytesPerSecond < Infinity ? Math.max(0, this.free - performance.now()) : 0;
  }

  /** The first bytes; learns the size. */
  async first(): Promise<Uint8Array> {
    return await this.read(0, kFirstRead, this.options.signal);
  }

  async read(offset: number, length: number, signal?: AbortSignal): Promise<Uint8Array> {
    if (this.whole) return this.whole.slice(offset, offset + length);
    const most = this.options.maxBytes ?? Infinity;
    if (this.asked + length > most) throw new MtdbError(`${this.url}: the limit of ${most} bytes is reached`, 'budget');
    this.asked += length; // what is on its way counts, too
    try {
      const read = await this.tryOften(offset, length, signal);
      this.asked += read.length - length;
      return read;
    } catch (error) {
      this.asked -= length;
      throw error;
    }
  }

  private async tryOften(offset: number, length: number, signal?: AbortSignal): Promise<Uint8Array> {
    this.free = Math.max(this.free, performance.now()) + (1000 * length) / this.bytesPerSecond;
    for (let tries = 1, pause = 250; ; ++tries, pause *= 2) {
      try {
        return await this.tryRead(offset, length, signal);
      } catch (error) {
        if (signal?.aborted) throw new MtdbError(`${this.url}: cancelled`, 'aborted');
        if (error instanceof MtdbError && (error.code !== 'io' || tries >= kTries)) throw error;
        if (tries >= kTries) throw new MtdbError(`${this.url}: cannot be reached: ${(error as Error).message}`, 'io');
        await new Promise(done => setTimeout(done, pause));
      }
    }
  }

  private otherFile() {
    this.replaced = true;
    return new MtdbError(`${this.url}: the file was replaced; open it anew`, 'corrupt');
  }

  /** All of a small file. `more`: to be called when some of it has come. */
  private async takeWhole(response: Response, where: string, more: () => void): Promise<Uint8Array> {
    const most = this.options.maxBytes ?? Infinity, parts: Uint8Array[] = [], reader = response.body!.getReader();
    let size = Number(response.headers.get('Content-Length') ?? 0), at = 0;
    for (;;) {
      if (size > kSmallFile) throw new MtdbError(`${where}: ${kNoParts}; files of more than ${kSmallFile / 1e6} MB are not taken whole`, 'unsupported');
      if (size > most) throw new MtdbError(`${this.url}: the limit of ${most} bytes is reached, and ${kNoParts}`, 'budget');
      const {done, value} = await reader.read();
      if (done) break;
      more();
      parts.push(value);
      this.bytes += value.length;
      at += value.length;
      size = Math.max(size, at);
    }
    if (at < size && !response.headers.has('Content-Encoding')) throw new MtdbError(`${where}: ${at} bytes came instead of ${size}`, 'io');
    const whole = new Uint8Array(at);
    parts.reduce((begin, part) => (whole.set(part, begin), begin + part.length), 0);
    return whole;
  }

  private async tryRead(offset: number, length: number, outer?: AbortSignal): Promise<Uint8Array> {
    const control = new AbortController();
    const stop = () => control.abort();
    outer?.addEventListener('abort', stop);
    const wait = () => setTimeout(stop, this.options.timeoutMilliseconds ?? 15000);
    let timer = wait();
    try {
      ++this.requests;
      const response = await this.get(this.from, {headers: {Range: `bytes=${offset}-${offset + length - 1}`}, signal: control.signal});
      const where = `${this.url}: bytes ${offset} to ${offset + length}`;
      if (response.status === 200 && this.size === 0) {
        this.whole = await this.takeWhole(response, where, () => (clearTimeout(timer), timer = wait())).finally(stop);
        this.size = this.whole.length;
        return this.whole.slice(offset, offset + length);
      }
      if (response.status !== 206) {
        stop(); // a body may be the whole file
        if (this.size > 0 && [410, 412, 416].includes(response.status)) throw this.otherFile();
        const code: ErrorCode = transient.has(response.status) ? 'io' : response.status === 404 ? 'not_found' : 'unsupported';
        throw new MtdbError(`${where}: ${response.status === 200 ? kNoParts : `the server answers ${response.status} ${response.statusText}`}`, code);
      }
      const range = /^bytes (\d+)-(\d+)\/(\d+)$/.exec(response.headers.get('Content-Range') ?? '');
      if (!range) throw new MtdbError(`${where}: no Content-Range that can be read; a server of another origin has to expose it (docs/packed.md)`, 'unsupported');
      const size = Number(range[3]), etag = response.headers.get('ETag');
      if (this.size === 0) {
        this.size = size;
        this.etag = etag;
        if (etag !== null && this.options.urlOf) this.from = String(this.options.urlOf(etag));
      } else if (size !== this.size || (etag !== null && this.etag !== null && etag !== this.etag)) {
        throw this.otherFile();
      }
      const expected = Math.min(offset + length, size) - offset;
      const bytes = new Uint8Array(await response.arrayBuffer());
      this.bytes += bytes.length;
      if (Number(range[1]) !== offset || bytes.length !== expected) throw new MtdbError(`${where}: ${bytes.length} bytes came instead of ${expected}`, 'io');
      return bytes;
    } finally {
      clearTimeout(timer);
      outer?.removeEventListener('abort', stop);
    }
  }
}

async function compile(wasm: FileOptions['wasm']): Promise<WebAssembly.Module> {
  if (wasm instanceof WebAssembly.Module) return wasm;
  if (wasm !== undefined && typeof wasm !== 'string' && !(wasm instanceof URL)) return await WebAssembly.compile(wasm);
  const url = wasm ?? new URL('engine.wasm', import.meta.url);
  const response = await fetch(url);
  if (!response.ok) throw new MtdbError(`${url}: the server answers ${response.status}`, 'io');
  return await WebAssembly.compile(await response.arrayBuffer());
}

/** One instance of the engine, and the calls that fill and empty its memory. */
class Engine {
  readonly wasm: Exports;

  constructor(module: WebAssembly.Module) {
    let memory: WebAssembly.Memory | null = null;
    const view = () => new DataView(memory!.buffer);
    // What the C++ library asks of a system: the time, and to say its last words.
    const calls: Record<string, (...args: number[]) => number> = {
      zstd_decompress: (to, room, from, size) => {
        try {
          const bytes = decompress(new Uint8Array(memory!.buffer, from, size));
          if (bytes.length > room!) return -1;
          new Uint8Array(memory!.buffer, to, bytes.length).set(bytes);
          return bytes.length;
        } catch {
          return -1;
        }
      },
      clock_time_get: (...args) => {
        view().setBigUint64(args[2]!, BigInt(Math.round(performance.now() * 1e6)), true);
        return 0;
      },
      proc_exit: () => { throw new WebAssembly.RuntimeError('the engine ended'); },
    };
    const imports: Record<string, Record<string, WebAssembly.ImportValue>> = {};
    for (const {module: from, name} of WebAssembly.Module.imports(module)) {
      (imports[from] ??= {})[name] = calls[name] ?? (() => 52); // ENOSYS
    }
    this.wasm = new WebAssembly.Instance(module, imports).exports as unknown as Exports;
    memory = this.wasm.memory;
    this.wasm._initialize();
  }

  put(bytes: Uint8Array) {
    const at = this.wasm.input(bytes.length);
    new Uint8Array(this.wasm.memory.buffer, at, bytes.length).set(bytes);
  }
  putText(text: string) {
    this.put(new TextEncoder().encode(text));
  }
  private string(at: number, size: number) {
    return new TextDecoder().decode(new Uint8Array(this.wasm.memory.buffer, at, size));
  }
  text() {
    return this.string(this.wasm.text(), this.wasm.text_size());
  }
  error(code: number) {
    return new MtdbError(this.string(this.wasm.error(), this.wasm.error_size()), kCodes[code] ?? 'other');
  }
  failure() {
    return this.string(this.wasm.error(), this.wasm.error_size());
  }
  // WebAssembly ends by a trap when it has no more memory.
  guard<T>(call: () => T): T {
    try {
      return call();
    } catch (error) {
      if (error instanceof WebAssembly.RuntimeError || error instanceof RangeError) {
        throw new MtdbError('no more memory for the mesh: ask for fewer triangles, or give less cacheBytes', 'memory');
      }
      throw error;
    }
  }
  wishes() {
    const at = this.wasm.wishes() / 8;
    const list = new Float64Array(this.wasm.memory.buffer);
    const count = list[at]!;
    const asked = Array.from({length: count}, (_, i) => ({ticket: list[at + 1 + 3 * i]!, offset: list[at + 2 + 3 * i]!, bytes: list[at + 3 + 3 * i]!}));
    const end = at + 1 + 3 * count;
    return {asked, cancelled: Array.from(list.slice(end + 1, end + 1 + list[end]!))};
  }
}

/** Opens a packed file. Errors: MtdbError. */
export async function openFile(url: string | URL, options: FileOptions = {}): Promise<PackedFile> {
  const ranges = new FileRanges(String(url), options);
  const [module, first] = await Promise.all([compile(options.wasm), ranges.first()]);
  const parts: [number, Uint8Array][] = [[0, first]];
  const engine = await begin(module, ranges, parts);
  await untilThere(engine, ranges, parts, () => engine.wasm.open_file(), options.signal);
  return new PackedFile(module, ranges, parts, JSON.parse(engine.text()), options);
}

async function begin(module: WebAssembly.Module, ranges: FileRanges, parts: [number, Uint8Array][]) {
  const engine = new Engine(module);
  engine.putText(ranges.url);
  engine.wasm.begin(ranges.size);
  for (const [offset, bytes] of parts) {
    engine.put(bytes);
    engine.wasm.keep(offset);
  }
  return engine;
}

// Calls until all is there that the call needs to begin with.
async function untilThere(engine: Engine, ranges: FileRanges, parts: [number, Uint8Array][], call: () => number, signal?: AbortSignal) {
  for (;;) {
    const code = engine.guard(call);
    if (code === 0) return;
    const {asked} = engine.wishes();
    if (code !== kNotYet || asked.length === 0) throw engine.error(code);
    for (const wish of asked) {
      const bytes = await ranges.read(wish.offset, wish.bytes, signal);
      parts.push([wish.offset, bytes]);
      engine.put(bytes);
      engine.wasm.keep(wish.offset);
    }
  }
}

export class PackedFile {
  constructor(private readonly module: WebAssembly.Module, private readonly ranges: FileRanges, private readonly parts: [number, Uint8Array][],
    readonly objects: ObjectInfo[], private readonly options: FileOptions) {}

  /** So many bytes are asked for in a second at most, by all objects. */
  get bytesPerSecond() {
    return this.ranges.bytesPerSecond;
  }
  set bytesPerSecond(bytes: number) {
    this.ranges.bytesPerSecond = bytes;
  }

  /** Opens an object; default: the first. Each has an engine of its own. */
  async open(name?: string, options: ObjectOptions = {}): Promise<MeshObject> {
    const info = name === undefined ? this.objects[0] : this.objects.find(o => o.object === name);
    if (!info) throw new MtdbError(`${this.ranges.url}: no object ${name ?? ''}`, 'not_found');
    const parts = [...this.parts];
    const engine = await begin(this.module, this.ranges, parts);
    await untilThere(engine, this.ranges, parts, () => engine.wasm.open_file(), this.options.signal);
    await untilThere(engine, this.ranges, parts, () => {
      engine.putText(info.object);
      return engine.wasm.open_object(options.cacheBytes ?? 256 * 2 ** 20);
    }, this.options.signal);
    engine.wasm.stretch(...(options.stretch ?? [1, 1, 1]));
    return new MeshObject(engine, this.ranges, info, this.options);
  }
}

/** An object and the mesh of its last query. */
export class MeshObject {
  /** Called when something has come that the last query wants: update() again. */
  onprogress: (() => void) | null = null;
  private readonly waiting: {ticket: number; offset: number; bytes: number}[] = [];
  private readonly underWay = new Map<number, AbortController>();
  private bytesUnderWay = 0;
  private timer: ReturnType<typeof setTimeout> | null = null; // until more may be asked for
  private closed = false;

  constructor(private readonly engine: Engine, private readonly ranges: FileRanges, readonly info: ObjectInfo, private readonly options: FileOptions) {}

  /** Moves towards the query through what is in memory, for about so many milliseconds (default: to
   * the end of what is there), and asks the server for what is missing. Null as long as nothing is
   * there. */
  update(query: Query, milliseconds?: number): Frame | null {
    if (this.closed) throw new MtdbError('the object was closed', 'closed');
    const {engine} = this;
    return engine.guard(() => {
      engine.putText(JSON.stringify(query));
      const code = engine.wasm.update(milliseconds ?? -1);
      this.serve();
      if (code === kNotYet) return null;
      if (code !== 0) throw engine.error(code);
      const r = new Float64Array(engine.wasm.memory.buffer, engine.wasm.report(), 17);
      return {
        triangles: r[0]!, vertices: r[1]!, errorBound: r[2]!, limit: kLimits[r[3]!] ?? 'missing', missing: r[4]!, worst: r[5]!,
        failed: r[6]!, failure: r[6]! > 0 ? engine.failure() : '', failureCode: kCodes[r[16]!] ?? 'other', noRoom: r[7]!, insertions: r[8]!, removals: r[9]!,
        cacheBytes: r[10]!, decodedClusters: r[11]!, bytesRead: this.ranges.bytes, requests: this.ranges.requests,
        shortfall: r[14]! > 0 ? {triangles: r[14]!, excess: r[15]!} : null,
        triangleSlots: engine.wasm.triangle_slots(), vertexSlots: engine.wasm.vertex_slots(),
      };
    });
  }

  /** Updates until nothing is on its way, and gives the last frame; `show` gets each that changed the
   * mesh. Throws what failed for good. */
  async settle(query: Query, show?: (frame: Frame) => void, options: {milliseconds?: number; signal?: AbortSignal} = {}): Promise<Frame> {
    for (;;) {
      if (options.signal?.aborted) throw new MtdbError('cancelled', 'aborted');
      const frame = this.update(query, options.milliseconds);
      if (frame && (frame.insertions > 0 || frame.removals > 0)) show?.(frame);
      if (frame?.limit === 'time') {
        await new Promise(done => setTimeout(done));
        continue;
      }
      if (this.pending === 0 && !frame) throw new MtdbError('nothing is on its way, and nothing is there', 'io');
      if (frame && (frame.limit !== 'missing' || this.pending === 0)) {
        if (frame.failed > 0) throw new MtdbError(frame.failure, /limit of \d+ bytes/.test(frame.failure) ? 'budget' : frame.failureCode);
        return frame;
      }
      await this.arrival(options.signal);
    }
  }

  /** What changed in the slots since the last call. */
  changes(): Changes {
    const {wasm} = this.engine;
    const list = wasm.take_changes();
    const buffer = wasm.memory.buffer;
    const counts = new Uint32Array(buffer, list, 3);
    let at = list + 12;
    const ranges = (count: number) => {
      const part = new Uint32Array(buffer, at, 2 * count);
      at += 8 * count;
      return part;
    };
    const triangles = wasm.triangle_slots(), vertices = wasm.vertex_slots(), rowBytes = wasm.row_bytes();
    return {
      triangleRanges: ranges(counts[0]!), vertexRanges: ranges(counts[1]!), normalRanges: ranges(counts[2]!),
      indices: new Uint32Array(buffer, wasm.indices(), 3 * triangles),
      positions: new Float32Array(buffer, wasm.positions(), 3 * vertices),
      origin: [...new Float64Array(buffer, wasm.origin(), 3)] as Point,
      normals: new Int16Array(buffer, wasm.normals(), 4 * vertices),
      rows: new Uint8Array(buffer, wasm.rows(), rowBytes * vertices), rowBytes,
      corners: new Float32Array(buffer, wasm.corners(), this.info.texture ? 6 * triangles : 0),
      pages: new Uint32Array(buffer, wasm.pages(), this.info.texture ? triangles : 0),
    };
  }

  /** Bytes of the file, of tiles and pages of textures for instance: within the limits of FileOptions, and tried again as
   * others are. They are not checked. */
  async read(part: FilePart, signal?: AbortSignal): Promise<Uint8Array> {
    for (let wait; (wait = this.ranges.wait()) > 0 && !signal?.aborted; ) await new Promise(done => setTimeout(done, wait));
    if (this.closed || signal?.aborted) throw new MtdbError('cancelled', this.closed ? 'closed' : 'aborted');
    if (!(part.offset >= 0 && part.bytes >= 0 && part.offset + part.bytes <= this.ranges.size))
      throw new MtdbError(`the file has no ${part.bytes} bytes from ${part.offset} on`, 'invalid_argument');
    return part.bytes === 0 ? new Uint8Array(0) : await this.ranges.read(part.offset, part.bytes, signal);
  }

  /** Hash64 of store/FORMAT.md, XXH3 with a seed: the checksum of tiles. */
  checksum(bytes: Uint8Array, seed = 0n): bigint {
    return this.engine.guard(() => {
      this.engine.put(bytes);
      return BigInt.asUintN(64, this.engine.wasm.checksum(BigInt.asIntN(64, seed)));
    });
  }

  /** Of the mesh of the last update. Errors get exact as clusters come. Takes time in proportion to the mesh. */
  triangleFacts(): TriangleFacts {
    const {wasm} = this.engine;
    return this.engine.guard(() => {
      wasm.triangle_facts();
      const {buffer} = wasm.memory, slots = wasm.triangle_slots();
      return {errors: new Float32Array(buffer, wasm.errors(), slots), clusters: new Uint32Array(buffer, wasm.clusters(), slots), rounds: new Uint8Array(buffer, wasm.rounds(), slots)};
    });
  }

  /** Where the ray first meets the surface at full resolution; null when it does not. */
  async castRay(origin: Point, direction: Point, signal?: AbortSignal): Promise<Hit | null> {
    const {wasm} = this.engine;
    return await this.untilAnswered(signal, () => {
      this.engine.put(new Uint8Array(Float64Array.from([...origin, ...direction]).buffer));
      return wasm.cast_ray();
    }, () => {
      const f = new Float64Array(wasm.memory.buffer, wasm.found(), 6);
      return f[0] === 1 ? {point: [f[1]!, f[2]!, f[3]!] as Point, errorBound: f[4]!, parameter: f[5]!} : null;
    });
  }

  /** The mesh of a query, as `mtdb extract` makes it, clipping included; update() shows another one, and goes on beside it. */
  async extract(query: Query, signal?: AbortSignal): Promise<Mesh> {
    const {wasm} = this.engine;
    return await this.untilAnswered(signal, () => {
      this.engine.putText(JSON.stringify(query));
      return wasm.extract();
    }, () => {
      const {buffer} = wasm.memory;
      const [vertices, triangles, rowBytes, errorBound, limit] = new Float64Array(buffer, wasm.found(), 5) as unknown as [number, number, number, number, number];
      const mesh: Mesh = {
        positions: new Float64Array(buffer, wasm.mesh_positions(), 3 * vertices).slice(),
        indices: new Uint32Array(buffer, wasm.mesh_triangles(), 6 * triangles).filter((_, i) => i % 2 === 0), // the low halves
        rows: new Uint8Array(buffer, wasm.mesh_rows(), rowBytes * vertices).slice(), rowBytes, errorBound, limit: kLimits[limit] ?? 'missing',
      };
      wasm.mesh_free();
      return mesh;
    });
  }

  // Calls until all is there that the call needs, and takes what it found. Throws what failed for good.
  private async untilAnswered<T>(signal: AbortSignal | undefined, call: () => number, take: () => T): Promise<T> {
    for (;;) {
      if (this.closed) throw new MtdbError('the object was closed', 'closed');
      if (signal?.aborted) throw new MtdbError('cancelled', 'aborted');
      const failures = this.failures;
      const code = this.engine.guard(call);
      if (code === 0) return this.engine.guard(take);
      if (code !== kNotYet) throw this.engine.error(code);
      this.serve();
      if (this.pending === 0) throw new MtdbError(this.lastFailure || 'nothing is on its way', this.lastCode);
      await this.arrival(signal);
      if (this.failures !== failures) throw new MtdbError(this.lastFailure, this.lastCode);
    }
  }
  private failures = 0;
  private lastFailure = '';
  private lastCode: ErrorCode = 'io';

  /** What failed is asked for again by the next update. */
  retry() {
    this.engine.wasm.retry();
  }

  /** Requests that wait or are under way. */
  get pending() {
    return this.waiting.length + this.underWay.size;
  }
  /** Bytes that they ask for. */
  get pendingBytes() {
    return this.waiting.reduce((sum, wish) => sum + wish.bytes, this.bytesUnderWay);
  }

  /** The file is not what it was: open it anew. */
  get replaced() {
    return this.ranges.replaced;
  }
  /** Why the last request failed; empty: none did. */
  get failure() {
    return this.lastFailure;
  }
  get failureCode() {
    return this.lastCode;
  }
  /** All memory of the object's engine; it never shrinks. */
  get memoryBytes() {
    return this.engine.wasm.memory.buffer.byteLength;
  }

  /** Cancels what is on its way. */
  close() {
    this.closed = true;
    this.waiting.length = 0;
    for (const control of this.underWay.values()) control.abort();
    this.underWay.clear();
    if (this.timer !== null) clearTimeout(this.timer);
    this.wake();
  }

  private wakeUp: (() => void)[] = [];
  private wake() {
    for (const wake of this.wakeUp.splice(0)) wake();
    this.onprogress?.();
  }
  private arrival(signal?: AbortSignal): Promise<void> {
    return new Promise(done => {
      this.wakeUp.push(done);
      signal?.addEventListener('abort', () => done(), {once: true});
    });
  }

  // Begins the requests that the engine wishes, and ends those that it does not want any more.
  private serve() {
    const {asked, cancelled} = this.engine.wishes();
    this.waiting.push(...asked);
    for (const ticket of cancelled) {
      const at = this.waiting.findIndex(w => w.ticket === ticket);
      if (at >= 0) this.waiting.splice(at, 1);
      this.underWay.get(ticket)?.abort();
      this.underWay.delete(ticket);
    }
    this.send();
  }

  private send() {
    while (this.waiting.length > 0 && this.underWay.size < (this.options.requests ?? 6)) {
      const wait = this.ranges.wait();
      if (wait > 0) {
        this.timer ??= setTimeout(() => {
          this.timer = null;
          this.send();
        }, wait);
        return;
      }
      void this.fetch(this.waiting.shift()!);
    }
  }

  private async fetch(wish: {ticket: number; offset: number; bytes: number}) {
    const control = new AbortController();
    this.underWay.set(wish.ticket, control);
    this.bytesUnderWay += wish.bytes;
    let bytes: Uint8Array | null = null;
    let failure = '', code: ErrorCode = 'io';
    try {
      bytes = await this.ranges.read(wish.offset, wish.bytes, control.signal);
    } catch (error) {
      failure = (error as Error).message;
      if (error instanceof MtdbError) code = error.code;
    }
    this.bytesUnderWay -= wish.bytes;
    if (this.closed || this.underWay.get(wish.ticket) !== control) return;
    this.underWay.delete(wish.ticket);
    if (!bytes) {
      ++this.failures;
      this.lastFailure = failure;
      this.lastCode = code;
    }
    this.engine.guard(() => {
      if (bytes) this.engine.put(bytes);
      else this.engine.putText(failure);
      this.engine.wasm.answer(wish.ticket, bytes ? 0 : Number(Object.keys(kCodes).find(number => kCodes[Number(number)] === code) ?? kIoError));
    });
    this.serve();
    this.wake();
  }
}
