// SPDX-License-Identifier: Apache-2.0
// Where meshes come from. The page draws, measures and takes away by these interfaces alone. Two
// ways fill them: thin, by a session of a server, which cuts and sends what changes; and thick, by
// the engine in a worker of this page, which reads ranges of a packed file.
import type {HalfSpace, Point, Query} from './query';
import type {TiledPage, TileName} from './texture_tiles';

export type Way = 'thin' | 'thick';

export interface ObjectEntry {
  object: string;
  triangles: number;
  vertices: number;
}

export interface ObjectInfo extends ObjectEntry {
  bounds: {min: Point; max: Point};
  diagonal: number;
  rounding_error: number;
  attributes: {name: string; type: string}[];
  units?: string; // of lengths; empty: not said
  up?: Point; // of length 1; none: an older program's object
  up_given?: boolean; // ingest was told so
  error_measure?: string; // vertical: of a terrain
  raster?: {crs: string; height_units: string}; // of a terrain
  texture?: {pages: unknown[]}; // triangles have places in images
}

// Elements of some slots: `data` has them one range after the other; range i is
// [ranges[2 i], ranges[2 i + 1]).
export interface Slots<Data> {
  ranges: Uint32Array;
  data: Data;
}

// What changed in a mesh that is kept in slots. A triangle slot without a triangle has the indices
// 0, 0, 0.
export interface MeshUpdate {
  fresh: boolean; // the first of a new mesh: all that was there before is gone
  triangles: number;
  vertices: number;
  triangleSlots: number;
  vertexSlots: number;
  origin: Point; // positions are relative to it
  indices: Slots<Uint32Array>; // three a triangle
  positions: Slots<Float32Array>; // three a vertex
  normals: Slots<Int16Array>; // four a vertex: x, y, z in steps of 1/32767, and 0
  values: Slots<Float32Array | Uint8Array> | null; // see ValueChoice
  triangleValues: Slots<Float32Array> | null; // likewise
  corners: Slots<Float32Array> | null; // likewise: u and v of three corners a triangle
  pages: Slots<Uint32Array> | null; // and the page of each triangle; kNoPage: none
  valueRange: [number, number] | null; // of a scalar, so far; of triangles, now
}

// What the thick way knows of each triangle: its error (b(t) of docs/query.md, or what is known to
// be no less), the round (1 is the finest) and the number of the cluster that made it.
export type TriangleValue = 'error' | 'round' | 'cluster';

// Which attributes come with the vertices, or what with the triangles: that only the thick way has.
export type ValueChoice =
  | {kind: 'none'}
  | {kind: 'colour'; attributes: [number, number, number]} // four bytes a vertex
  | {kind: 'scalar'; attribute: number} // a float a vertex
  | {kind: 'triangle'; of: TriangleValue} // a float a triangle
  | {kind: 'texture'}; // corners and pages of triangles, and tiles: of the thick way

// What a query came to; see docs/protocol.md.
export interface Done {
  triangles: number;
  vertices: number;
  error_bound: number;
  shortfall: {triangles: number; excess: number} | null;
  limit: 'accuracy' | 'triangles' | 'bytes' | 'time' | 'memory';
  messages: number;
  bytes: number;
  milliseconds: number;
}

// What comes of the tiles of a texture, once it was chosen.
export type TextureNews =
  // What pages there are; the first time, and when they may be others. None: the file has no tiles.
  | {kind: 'pages'; checksum: string; pages: TiledPage[]}
  | {kind: 'tile'; tile: TileName; image: ImageBitmap} // as it is stored, with margins; premultiplied
  // A tile does not come, now or ever; null: nothing does.
  | {kind: 'failed'; tile: TileName | null; again: boolean; sentence: string};

export interface MeshListener {
  // The mesh has changed.
  changed(update: MeshUpdate): void;
  // The mesh is the answer of a query; `query` is the object that was given to ask(). The update
  // with its last change came before.
  answered(query: Query, done: Done): void;
  // A query has failed, and the mesh stays as it is.
  failed(query: Query, sentence: string): void;
  // lost: it is being tried again, and the last query will be asked again. gone: for good.
  state(state: 'opening' | 'open' | 'lost' | 'gone', sentence: string): void;
  texture(news: TextureNews): void;
}

export interface Traffic {
  bytes: number; // received so far
  applyMilliseconds: number; // of the last update
  load: Load | null; // of the thick way
}

// What the engine in the page does.
export interface Load {
  clusters: number; // decoded so far
  cacheBytes: number; // of those in memory
  engineBytes: number; // all memory of the engine
  requests: number; // under way, or waiting
  requestBytes: number; // that they ask for
  missing: number; // clusters that the query lacks
  cutMilliseconds: number; // the longest call since the last update
}

// What the thick way may take.
export interface Limits {
  cacheBytes: number; // of decoded clusters
  bytesPerSecond: number; // Infinity: no limit
}

export interface MeshSource {
  // Makes the mesh the answer to this query. The latest counts.
  ask(query: Query): void;
  choose(values: ValueChoice): void;
  // These tiles, the first ones first, and no others any more; and how many images of tiles were
  // used or dropped since the last call.
  wantTiles(tiles: TileName[], taken: number): void;
  limit(limits: Limits): void;
  readonly maxTriangles: number; // that a query may ask for
  readonly traffic: Traffic;
  close(): void;
}

export interface Hit {
  point: Point;
  error_bound: number;
}

export interface TakenMesh {
  blob: Blob;
  triangles: number;
  errorBound: number;
}

// What may be otherwise soon: the codes of docs/protocol.md with status 503, those of the engine,
// and of this page.
const kPassing = new Set([
  'too_many_connections',
  'too_many_sessions',
  'too_many_objects',
  'no_session_memory',
  'no_temporary_space',
  'timeout',
  'budget_exceeded',
  'no_space',
  'shutting_down',
  'gone',
  'io',
  'memory',
  'unreachable',
  'lost',
  'decoder',
  'engine',
]);

// Errors are StoreErrors, whose message is a sentence for the user.
export class StoreError extends Error {
  constructor(
    message: string,
    readonly code: string,
  ) {
    super(message);
  }

  // Whether it helps to try again.
  get passes() {
    return kPassing.has(this.code);
  }
}

export interface Store {
  readonly ways: readonly Way[]; // that there are; the first is the default
  readonly formats: readonly string[]; // of mesh()
  objects(): Promise<ObjectEntry[]>;
  info(name: string): Promise<ObjectInfo>;
  open(name: string, way: Way, listener: MeshListener): MeshSource;
  // Where a ray first meets the surface, at full resolution; null when it does not.
  probe(name: string, origin: Point, direction: Point, signal?: AbortSignal): Promise<Hit | null>;
  // `planes`, in the model's coordinates: what is outside of one is cut off. Draco is not written
  // then.
  mesh(name: string, query: Query, format: string, planes?: HalfSpace[]): Promise<TakenMesh>;
}
