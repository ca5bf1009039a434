// SPDX-License-Identifier: Apache-2.0
// The worker of the thick way: the query engine over ranges of a packed file (tools/web). For an
// object that is shown it keeps the mesh and tells the page what changes; beside that it answers
// single questions about the file (packed_store.ts).
import {
  MtdbError,
  openFile,
  type Frame,
  type MeshObject,
  type ObjectInfo as FileObject,
  type PackedFile,
} from '../../web/src/mtdb';
import {meshFile} from './mesh_file';
import {cutMesh} from './cut_mesh';
import type {HalfSpace, Point, Query} from './query';
import {buffersOf, gather, ValueReader} from './slots';
import type {Done, Limits, Load, MeshUpdate, TextureNews, TriangleValue} from './source';
import type {TileQueue} from './texture_tiles';
import type {Answer, FromWorker, ToWorker} from './worker_session';

export type Question =
  | {kind: 'objects'; id: number; url: string}
  | {kind: 'probe'; id: number; url: string; object: string; origin: Point; direction: Point}
  | {
      kind: 'mesh';
      id: number;
      url: string;
      object: string;
      query: Query;
      format: string;
      planes: HalfSpace[];
    }
  | {kind: 'forget'; id: number}; // the answer is not wanted any more

export type Reply =
  | {kind: 'objects'; id: number; objects: FileObject[]}
  | {kind: 'probe'; id: number; hit: {point: Point; error_bound: number} | null}
  | {kind: 'mesh'; id: number; blob: Blob; triangles: number; errorBound: number}
  | {kind: 'refused'; id: number; sentence: string; code: string};

const kSlice = 8; // milliseconds of a call
const kMostTriangles = 2 ** 24;
const kFirstPause = 500,
  kLongestPause = 5000; // between two tries to get what failed
const kQuestionCache = 96 * 2 ** 20;

const post = (message: FromWorker | Reply, transfer: Transferable[] = []) =>
  (self as unknown as Worker).postMessage(message, transfer);
const tell = (news: TextureNews, transfer: Transferable[] = []) =>
  post({kind: 'texture', news}, transfer);
const sentenceOf = (error: unknown) => (error as Error).message;

// ---- an object that is shown ----

interface Asked {
  id: number;
  query: Query;
  budget: boolean; // the mesh goes over max_triangles without it
}

class Shown {
  private object: MeshObject | null = null;
  private file: PackedFile | null = null;
  private readonly values: ValueReader;
  private triangleValue: TriangleValue | null = null;
  private allTriangles = false; // are to be told anew
  private textured = false; // corners of triangles are told, and tiles
  private tiles: TileQueue | null = null;
  private tilesOf: MeshObject | null = null;
  private asked: Asked | null = null;
  private budgeted = false; // the last answer had as many triangles as it may
  private limits: Limits = {cacheBytes: 256 * 2 ** 20, bytesPerSecond: Infinity};
  private frame: Frame | null = null;
  private fresh = true;
  private dirty = false;
  private clips = false;
  private reclip = false; // what is clipped is another part
  private taken = true;
  private answers: Answer[] = [];
  private milliseconds = 0;
  private cut = 0;
  private scheduled = false;
  private pause = kFirstPause;
  private inTrouble = false;
  private retrying = 0;
  private opening = 0; // counts, since the last is the one that matters
  private readonly turn = new MessageChannel();

  constructor(
    private readonly to: ToWorker & {kind: 'open_packed'},
    limits: Limits | null,
  ) {
    this.values = new ValueReader(to.types);
    if (limits) this.limits = limits;
    this.turn.port1.onmessage = () => this.step();
    void this.open();
  }

  private async open() {
    const opening = ++this.opening;
    try {
      const file =
        this.file ??
        (await openFile(this.to.url, {
          ...(this.to.byHash
            ? {urlOf: (etag: string) => `${this.to.url}?hash=${etag.replace(/^W\/|"/g, '')}`}
            : {}),
        }));
      file.bytesPerSecond = this.limits.bytesPerSecond;
      this.file = file;
      const object = await file.open(this.to.object, {
        cacheBytes: this.limits.cacheBytes,
        stretch: this.to.stretch,
      });
      if (opening !== this.opening) return object.close();
      this.object?.close();
      this.object = object;
      this.fresh = true;
      this.frame = null;
      object.onprogress = () => this.schedule();
      post({kind: 'hello', hello: {max_triangles: kMostTriangles}});
      if (this.textured) void this.openTiles(object);
      this.schedule();
    } catch (error) {
      if (opening !== this.opening) return;
      const code = error instanceof MtdbError ? error.code : 'other';
      post({
        kind: 'closed',
        opened: false,
        code: code === 'io' || (code === 'not_found' && this.to.byHash) ? 0 : -1,
        sentence: sentenceOf(error),
      });
    }
  }

  ask(id: number, query: Query) {
    this.reclip ||= this.clips || query.clip === true;
    this.clips = query.clip === true;
    this.asked = {id, query, budget: this.budgeted};
    this.schedule();
  }

  limit(limits: Limits) {
    const other = limits.cacheBytes !== this.limits.cacheBytes;
    this.limits = limits;
    if (this.file) this.file.bytesPerSecond = limits.bytesPerSecond;
    if (other && this.file) void this.open(); // with another cache
  }

  choose(message: ToWorker & {kind: 'choose'}) {
    this.values.choose(message.values);
    this.triangleValue = message.values.kind === 'triangle' ? message.values.of : null;
    this.textured = message.values.kind === 'texture';
    if (this.textured && this.object) void this.openTiles(this.object);
    else this.tiles?.want([]);
    this.allTriangles = true;
    this.dirty = this.frame !== null;
    this.flush();
  }

  // A part of the program of its own: most objects have no texture.
  private async openTiles(object: MeshObject) {
    if (this.tilesOf === object) return;
    this.tilesOf = object;
    this.tiles?.close();
    this.tiles = null;
    const part = object.info.texture?.tiles;
    if (!part) return tell({kind: 'pages', checksum: '', pages: []});
    try {
      const module = await (import(new URL('texture_tiles.js', import.meta.url).href) as Promise<
        typeof import('./texture_tiles')
      >);
      const file = await module.TileFile.open(
        part.bytes,
        (offset, bytes, signal) => object.read({offset: part.offset + offset, bytes}, signal),
        (bytes, seed) => object.checksum(bytes, seed),
      );
      if (this.tilesOf !== object) return;
      this.tiles = new module.TileQueue(
        file,
        image =>
          createImageBitmap(image, {colorSpaceConversion: 'none', premultiplyAlpha: 'premultiply'}),
        (tile, image) => tell({kind: 'tile', tile, image}, [image]),
        (tile, error) => {
          const again = error instanceof MtdbError && error.code === 'io';
          tell({kind: 'failed', tile, again, sentence: sentenceOf(error)});
          return again;
        },
      );
      const {pages, checksum} = file.head;
      tell({kind: 'pages', checksum: String(checksum), pages});
    } catch (error) {
      if (this.tilesOf !== object) return;
      const again = error instanceof MtdbError && error.code === 'io';
      tell({kind: 'failed', tile: null, again, sentence: sentenceOf(error)});
      if (!again) return tell({kind: 'pages', checksum: '', pages: []});
      this.tilesOf = null;
      setTimeout(() => this.object === object && void this.openTiles(object), kLongestPause);
    }
  }

  wantTiles(message: ToWorker & {kind: 'tiles'}) {
    this.tiles?.taken(message.taken);
    this.tiles?.want(message.wanted);
  }

  onTaken() {
    this.taken = true;
    this.flush();
  }

  private schedule() {
    if (this.scheduled) return;
    this.scheduled = true;
    this.turn.port2.postMessage(null);
  }

  // Moves a little towards what was asked last; whatever comes for this worker comes between.
  private step() {
    this.scheduled = false;
    const {object, asked} = this;
    if (!object || !asked) return;
    const {max_triangles: most, ...without} = asked.query;
    const begin = performance.now();
    try {
      // Without a budget the engine goes on from the cut of the last query; with one it searches
      // anew for each.
      const frame = object.update(asked.budget ? asked.query : without, kSlice);
      this.note(begin);
      if (!frame) {
        if (object.pending > 0) return;
        const {failure, failureCode} = object;
        if (object.replaced || !failure || failureCode === 'io')
          return this.trouble(object, failure || 'The file cannot be read');
        this.object = null;
        object.close();
        return post({kind: 'closed', opened: true, code: -1, sentence: failure});
      }
      if (frame.insertions > 0 || frame.removals > 0 || !this.frame || this.reclip)
        this.dirty = true;
      this.reclip = false;
      this.frame = frame;
      if (most !== undefined && frame.triangles > most && !asked.budget) {
        asked.budget = true;
        return this.schedule();
      }
      // A search under a budget begins at the root: until it ends, what is shown stays.
      if (asked.budget && frame.limit === 'time') return this.schedule();
      this.weigh(object, asked, frame);
      this.flush();
    } catch (error) {
      if (error instanceof MtdbError && error.code === 'invalid_argument') {
        this.answers.push({id: asked.id, error: error.message, code: error.code});
        this.asked = null;
        return this.flush();
      }
      this.object = null;
      object.close();
      post({
        kind: 'closed',
        opened: true,
        code: error instanceof MtdbError && error.code === 'memory' ? -1 : 0,
        sentence: sentenceOf(error),
      });
    }
  }

  private note(begin: number) {
    const milliseconds = performance.now() - begin;
    this.milliseconds += milliseconds;
    this.cut = Math.max(this.cut, milliseconds);
  }

  // Whether there is more to do, or the mesh is what can be had.
  private weigh(object: MeshObject, asked: Asked, frame: Frame) {
    if (frame.limit === 'time') return this.schedule();
    if (frame.limit === 'missing' && object.pending > 0) return;
    if (frame.limit === 'missing' && frame.failed > 0) {
      // What is damaged stays so: the mesh is coarser there.
      if (object.replaced || frame.failureCode === 'io') return this.trouble(object, frame.failure);
      this.asked = null;
      return void this.answers.push({id: asked.id, error: frame.failure, code: frame.failureCode});
    }
    if (this.inTrouble) {
      this.inTrouble = false;
      this.pause = kFirstPause;
      post({kind: 'trouble', sentence: ''});
    }
    this.asked = null;
    this.budgeted = frame.limit === 'triangles';
    // Errors of triangles that have not changed may be known better now.
    if (this.triangleValue === 'error') this.allTriangles = this.dirty = true;
    this.answers.push({id: asked.id, done: this.doneOf(frame)});
  }

  private doneOf(frame: Frame): Done {
    return {
      triangles: frame.triangles,
      vertices: frame.vertices,
      error_bound: frame.errorBound,
      shortfall: frame.shortfall,
      limit: frame.limit === 'missing' ? 'memory' : frame.limit,
      messages: 0,
      bytes: frame.bytesRead,
      milliseconds: this.cut,
    };
  }

  // What does not come is asked for again, until it does.
  private trouble(object: MeshObject, sentence: string) {
    this.flush();
    if (object.replaced) {
      this.object = this.file = null;
      object.close();
      return post({kind: 'closed', opened: true, code: 0, sentence: 'The file was replaced'});
    }
    if (this.retrying) return;
    this.inTrouble = true;
    post({kind: 'trouble', sentence});
    this.retrying = self.setTimeout(() => {
      this.retrying = 0;
      if (this.object !== object) return;
      object.retry();
      this.schedule();
    }, this.pause);
    this.pause = Math.min(2 * this.pause, kLongestPause);
  }

  private loadOf(object: MeshObject, frame: Frame): Load {
    return {
      clusters: frame.decodedClusters,
      cacheBytes: frame.cacheBytes,
      engineBytes: object.memoryBytes,
      requests: object.pending,
      requestBytes: object.pendingBytes,
      missing: frame.missing,
      cutMilliseconds: this.cut,
    };
  }

  // What was chosen of each slot, and what it spans; errors of 0, which no logarithm knows, aside.
  private trianglesOf(
    object: MeshObject,
    frame: Frame,
  ): {values: Float32Array; range: [number, number] | null} | null {
    if (!this.triangleValue) return null;
    const {errors, clusters, rounds} = object.triangleFacts();
    const root = object.info.rounds + 1;
    const value = {
      error: (slot: number) => Math.abs(errors[slot]!),
      cluster: (slot: number) => clusters[slot]!,
      round: (slot: number) => Math.min(rounds[slot]!, root),
    }[this.triangleValue];
    const values = new Float32Array(frame.triangleSlots);
    let low = Infinity,
      high = -Infinity;
    for (let slot = 0; slot < values.length; ++slot) {
      const x = (values[slot] = value(slot));
      if (rounds[slot] === 0 || x === 0) continue;
      low = Math.min(low, x);
      high = Math.max(high, x);
    }
    return {values, range: low <= high ? [low, high] : null};
  }

  private makeUpdate(object: MeshObject, frame: Frame): MeshUpdate {
    const triangles = this.trianglesOf(object, frame),
      c = object.changes();
    const told = this.allTriangles
      ? new Uint32Array([0, frame.triangleSlots])
      : c.triangleRanges.slice();
    const update: MeshUpdate = {
      fresh: this.fresh,
      triangles: frame.triangles,
      vertices: frame.vertices,
      triangleSlots: frame.triangleSlots,
      vertexSlots: frame.vertexSlots,
      origin: c.origin,
      indices: gather(Uint32Array, c.indices, c.triangleRanges.slice(), 3),
      positions: gather(Float32Array, c.positions, c.vertexRanges.slice(), 3),
      normals: gather(Int16Array, c.normals, c.normalRanges.slice(), 4),
      values: this.values.gather(c.rows, c.rowBytes, frame.vertexSlots, c.vertexRanges.slice()),
      triangleValues: triangles && gather(Float32Array, triangles.values, told, 1),
      corners: this.textured ? gather(Float32Array, c.corners, told, 6) : null,
      pages: this.textured ? gather(Uint32Array, c.pages, told, 1) : null,
      valueRange: triangles ? triangles.range : this.values.range,
    };
    this.allTriangles = false;
    this.fresh = false;
    return update;
  }

  private flush() {
    const {object, frame} = this;
    if (!this.taken || !object || !frame || (!this.dirty && this.answers.length === 0)) return;
    const begin = performance.now();
    const update = this.dirty ? this.makeUpdate(object, frame) : null;
    this.dirty = false;
    this.taken = false;
    this.milliseconds += performance.now() - begin;
    post(
      {
        kind: 'update',
        update,
        answers: this.answers,
        bytes: frame.bytesRead,
        milliseconds: this.milliseconds,
        load: this.loadOf(object, frame),
      },
      update ? buffersOf(update) : [],
    );
    this.answers = [];
    this.milliseconds = this.cut = 0;
  }
}

// ---- single questions ----

const files = new Map<string, Promise<PackedFile>>();
const objects = new Map<string, Promise<MeshObject>>();
const underWay = new Map<number, AbortController>();

// What failed or was replaced is opened anew the next time.
async function kept<T>(
  all: Map<string, Promise<T>>,
  key: string,
  make: () => Promise<T>,
): Promise<T> {
  let value = all.get(key);
  if (!value) {
    value = make();
    all.set(key, value);
    value.catch(() => all.delete(key));
  }
  return await value;
}
const fileOf = (url: string) => kept(files, url, () => openFile(url));
const objectOf = (url: string, name: string) =>
  kept(
    objects,
    JSON.stringify([url, name]),
    async () => await (await fileOf(url)).open(name, {cacheBytes: kQuestionCache}),
  );

async function answer(question: Exclude<Question, {kind: 'forget'}>) {
  const {id, url} = question,
    control = new AbortController();
  underWay.set(id, control);
  try {
    if (question.kind === 'objects')
      return post({kind: 'objects', id, objects: (await fileOf(url)).objects});
    const object = await objectOf(url, question.object);
    if (question.kind === 'probe') {
      const hit = await object.castRay(question.origin, question.direction, control.signal);
      return post({kind: 'probe', id, hit: hit && {point: hit.point, error_bound: hit.errorBound}});
    }
    const mesh = cutMesh(
      await object.extract({...question.query}, control.signal),
      object.info.attributes,
      question.planes,
    );
    post({
      kind: 'mesh',
      id,
      blob: meshFile(mesh, object.info.attributes, question.format),
      triangles: mesh.indices.length / 3,
      errorBound: mesh.errorBound,
    });
  } catch (error) {
    const code = error instanceof MtdbError ? error.code : 'other';
    if (/replaced/.test(sentenceOf(error)) || code === 'memory') {
      files.delete(url);
      objects.clear();
    }
    post({kind: 'refused', id, sentence: sentenceOf(error), code});
  } finally {
    underWay.delete(id);
  }
}

// ---- messages ----

let shown: Shown | null = null;
let limits: Limits | null = null;

self.onmessage = (event: MessageEvent<ToWorker | Question>) => {
  const message = event.data;
  switch (message.kind) {
    case 'open_packed':
      shown = new Shown(message, limits);
      break;
    case 'ask':
      shown?.ask(message.id, message.query);
      break;
    case 'choose':
      shown?.choose(message);
      break;
    case 'tiles':
      shown?.wantTiles(message);
      break;
    case 'taken':
      shown?.onTaken();
      break;
    case 'limit':
      limits = message.limits;
      shown?.limit(limits);
      break;
    case 'forget':
      underWay.get(message.id)?.abort();
      break;
    case 'objects':
    case 'probe':
    case 'mesh':
      void answer(message);
  }
};
