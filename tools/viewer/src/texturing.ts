// SPDX-License-Identifier: Apache-2.0
// Textures on the card: the tiles that the picture takes, in the layers of one array, and for each
// object the tables by which the shader finds them. Which tiles are wanted is asked of the picture
// itself, drawn small, now and then. The page loads this with the first texture.
import type * as three from 'three';
import type {TextureTables} from './object_mesh';
import {
  choose,
  countAsked,
  kCell,
  kLayer,
  LayerCount,
  PageTable,
  placeOf,
  sameShape,
  shapeOf,
  slotAt,
  slotsOf,
  type Shape,
  type Wanted,
} from './page_table';
import type {Scene, SceneObject} from './scene';
import type {Uniforms} from './shaders';
import type {TextureNews} from './source';
import {tileSize, type TileName} from './texture_tiles';

const kBytes = 2 ** 26,
  kBytesOnPhones = 2 ** 25,
  kLayerBytes = 4 * kLayer * kLayer;
const kShrink = 8; // the picture is asked at an eighth of its size, each time at other pixels
const kPasses = 6; // after a change
const kRemembered = 6; // passes for which a tile stays wanted
const kPause = 120, // milliseconds between passes, and
  kShare = 6, // as many frames, but
  kLongestPause = 500;
const kUploads = 4, // in a frame
  kUploadMilliseconds = 4;
const kAgain = 5500; // milliseconds until what failed is wanted again
const kBiasStep = 0.5,
  kMostBias = 8;

// What it needs of the page.
export interface TexturingContext {
  readonly renderer: three.WebGLRenderer;
  readonly shared: Uniforms;
  readonly scene: Scene;
  readonly canvas: HTMLCanvasElement;
  drawing: {
    texture(): three.Texture; // one that is filled elsewhere
    table(data: Uint32Array): three.DataTexture;
    target(width: number, height: number): three.WebGLRenderTarget;
    // Draws what the shader asks for, in place of what it shows, into the target, `x` and `y` pixels
    // off; `read` is called while it is bound.
    ask(
      target: three.WebGLRenderTarget,
      shrink: number,
      x: number,
      y: number,
      read: () => void,
    ): void;
  };
  viewport(): [number, number];
  say(sentence: string, milliseconds?: number): void;
}

// A tile on the card.
interface Resident {
  book: Book;
  tile: TileName;
  layer: number;
  slot: number;
  wanted: number; // the last pass that chose it; Infinity: it stays
}

interface Layer {
  shape: Shape; // of its tiles
  slots: (Resident | null)[];
}

const newest = (layer: Layer) => Math.max(...layer.slots.map(r => r?.wanted ?? -1));

// The array of layers.
class Layers {
  private readonly layers: (Layer | null)[];

  constructor(readonly count: number) {
    this.layers = Array.from({length: count}, () => null);
  }

  // A place for a tile, where nothing is or what is wanted least, and nothing that pass `now` chose.
  take(shape: Shape, now: number): {layer: number; slot: number} | null {
    const best = {layer: -1, slot: 0, wanted: now};
    const weigh = (layer: number, slot: number, wanted: number) => {
      if (wanted < best.wanted) Object.assign(best, {layer, slot, wanted});
    };
    this.layers.forEach((layer, i) => {
      if (layer && sameShape(layer.shape, shape))
        layer.slots.forEach((resident, slot) => weigh(i, slot, resident?.wanted ?? -2));
      else weigh(i, 0, layer ? newest(layer) : -1);
    });
    if (best.layer < 0) return null;
    const layer = this.layers[best.layer];
    if (layer && sameShape(layer.shape, shape)) {
      const before = layer.slots[best.slot];
      before?.book.drop(before);
    } else {
      for (const resident of layer?.slots ?? []) resident?.book.drop(resident);
      const slots = Array.from({length: slotsOf(shape)}, () => null);
      this.layers[best.layer] = {shape, slots};
    }
    return best;
  }

  set(resident: Resident) {
    this.layers[resident.layer]!.slots[resident.slot] = resident;
  }

  forget(book: Book) {
    for (const layer of this.layers)
      layer?.slots.forEach((resident, i) => resident?.book === book && (layer.slots[i] = null));
  }
}

type Chosen = Wanted & {book: Book; entry: number; tile: TileName};

// The texture of one object.
class Book {
  readonly table: PageTable;
  readonly tables: TextureTables & {pages: three.DataTexture; entries: three.DataTexture};
  readonly residents = new Map<number, Resident>(); // by entry
  readonly failed = new Map<number, number>(); // until when; performance.now()
  readonly recent: Map<number, number>[] = []; // what the last passes asked for
  waiting: Chosen[] = []; // chosen, and not there
  came: {tile: TileName; image: ImageBitmap}[] = [];
  taken = 0; // images, since the worker was told

  constructor(
    readonly object: SceneObject,
    readonly checksum: string,
    pages: ConstructorParameters<typeof PageTable>[0],
    number: number,
    table: (data: Uint32Array) => three.DataTexture,
  ) {
    this.table = new PageTable(pages);
    this.tables = {
      pages: table(this.table.pages),
      entries: table(this.table.entries),
      pageCount: pages.length,
      book: number,
    };
    object.mesh.pages = this.tables;
  }

  drop(resident: Resident) {
    this.residents.delete(this.table.entryOf(resident.tile));
    this.table.drop(resident.tile);
    this.tables.entries.needsUpdate = true;
  }

  put(resident: Resident, place: number) {
    this.residents.set(this.table.entryOf(resident.tile), resident);
    this.table.put(resident.tile, place);
    this.tables.entries.needsUpdate = true;
  }

  // Nothing is on the card.
  empty() {
    this.residents.clear();
    this.table.entries.fill(0);
    this.tables.entries.needsUpdate = true;
  }

  // What the last passes asked for and the tiles before these, between which the shader mixes.
  wanted(): Chosen[] {
    const pixels = new Map<number, number>();
    const add = (entry: number, more: number) => pixels.set(entry, (pixels.get(entry) ?? 0) + more);
    for (const counts of this.recent)
      for (const [entry, count] of counts) {
        add(entry, count);
        const parent = this.table.parentOf(this.table.nameOf(entry));
        if (parent) add(this.table.entryOf(parent), count);
      }
    return Array.from(pixels, ([entry, count]) => this.choice(entry, count));
  }

  choice(entry: number, pixels: number): Chosen {
    const tile = this.table.nameOf(entry);
    return {book: this, entry, tile, pixels, shape: shapeOf(this.table.list[tile[0]]!, tile)};
  }

  // How long a place should have been finer, in levels, times the pixels that show it.
  lack({entry, tile, pixels}: Chosen) {
    return pixels * (1 + (this.table.shownLevel(entry) ?? 32) - tile[1]);
  }

  send() {
    const now = performance.now();
    const there = new Set(this.came.map(({tile}) => String(tile)));
    const list = this.waiting.filter(
      ({entry, tile}) =>
        !this.residents.has(entry) &&
        !there.has(String(tile)) &&
        !((this.failed.get(entry) ?? 0) > now),
    );
    this.waiting = list;
    this.object.source.wantTiles(
      list.map(({tile}) => tile),
      this.taken,
    );
    this.taken = 0;
  }

  close() {
    for (const {image} of this.came.splice(0)) image.close();
    this.tables.pages.dispose();
    this.tables.entries.dispose();
  }
}

export class Texturing {
  private readonly books = new Map<string, Book>();
  private readonly most: number;
  private layers: Layers | null = null;
  private array: WebGLTexture | null = null;
  private readonly handle: three.Texture;
  private target: three.WebGLRenderTarget | null = null;
  private pass = 0;
  private due = 0; // passes
  private asking = false;
  private lastAsk = 0;
  private lastFrame = 0;
  private frameTime = 16; // smoothed milliseconds
  private bias = 0; // levels that the layers do not suffice for
  private lastViewport = '';
  private retryAt = Infinity; // when what failed is chosen again
  private said = '';

  constructor(private readonly viewer: TexturingContext) {
    const gl = this.gl(),
      phone = matchMedia('(max-width: 700px)').matches;
    this.most = Math.min(
      Math.floor((phone ? kBytesOnPhones : kBytes) / kLayerBytes),
      gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS) as number,
    );
    this.handle = viewer.drawing.texture();
    viewer.canvas.addEventListener('webglcontextrestored', () => {
      this.array = null; // it went with the context
      this.restart();
    });
  }

  private gl() {
    return this.viewer.renderer.getContext() as WebGL2RenderingContext;
  }

  // Whether the picture has all the tiles that it wants.
  get settled() {
    return (
      this.due === 0 &&
      !this.asking &&
      [...this.books.values()].every(
        book =>
          book.came.length === 0 &&
          book.waiting.every(({entry}) => book.residents.has(entry) || book.failed.has(entry)),
      )
    );
  }

  take(object: SceneObject, news: TextureNews) {
    if (news.kind === 'pages') return this.open(object, news);
    const book = this.books.get(object.name);
    if (news.kind === 'tile') {
      if (book?.object === object) book.came.push(news);
      else news.image.close();
      return;
    }
    if (book && news.tile) this.fail(book, book.table.entryOf(news.tile), news.again ? kAgain : 0);
    if (this.said === news.sentence) return;
    this.said = news.sentence;
    this.viewer.say(`${object.name}: ${news.sentence}`, 8000);
  }

  // `milliseconds` until it is tried again; 0: never.
  private fail(book: Book, entry: number, milliseconds: number) {
    const until = milliseconds > 0 ? performance.now() + milliseconds : Infinity;
    book.failed.set(entry, until);
    this.retryAt = Math.min(this.retryAt, until);
  }

  private open(object: SceneObject, news: TextureNews & {kind: 'pages'}) {
    const before = this.books.get(object.name);
    if (before?.object === object && before.checksum === news.checksum) {
      before.failed.clear();
      before.taken = 0; // the worker is another one
      before.came.splice(0).forEach(({image}) => image.close());
      this.due = kPasses;
      return before.send();
    }
    this.close(object.name);
    if (news.pages.length === 0) return;
    const numbers = new Set([...this.books.values()].map(book => book.tables.book));
    let number = 1;
    while (numbers.has(number)) ++number;
    if (number > 255) return; // the picture has no more names for objects
    const {table} = this.viewer.drawing;
    this.books.set(object.name, new Book(object, news.checksum, news.pages, number, table));
    this.restart();
  }

  private close(name: string) {
    const book = this.books.get(name);
    if (!book) return;
    this.layers?.forget(book);
    book.object.mesh.pages = null;
    book.close();
    this.books.delete(name);
  }

  // All tiles come anew, into as many layers as they take.
  private restart() {
    const all = new LayerCount();
    for (const {table} of this.books.values())
      for (let entry = 0; entry < table.size && all.layers < this.most; ++entry) {
        const tile = table.nameOf(entry);
        all.add(shapeOf(table.list[tile[0]]!, tile));
      }
    const {renderer, shared} = this.viewer,
      gl = this.gl();
    if (this.array) gl.deleteTexture(this.array);
    this.layers = new Layers(Math.min(this.most, all.layers + 1));
    this.array = gl.createTexture();
    renderer.state.bindTexture(gl.TEXTURE_2D_ARRAY, this.array);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA8, kLayer, kLayer, this.layers.count);
    for (const [name, value] of [
      [gl.TEXTURE_MIN_FILTER, gl.LINEAR],
      [gl.TEXTURE_MAG_FILTER, gl.LINEAR],
      [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE],
      [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE],
    ] as const)
      gl.texParameteri(gl.TEXTURE_2D_ARRAY, name, value);
    const sharper = Math.min(2, renderer.capabilities.getMaxAnisotropy());
    const extension = gl.getExtension('EXT_texture_filter_anisotropic');
    if (extension)
      gl.texParameterf(gl.TEXTURE_2D_ARRAY, extension.TEXTURE_MAX_ANISOTROPY_EXT, sharper);
    renderer.state.unbindTexture();
    const properties = renderer.properties.get(this.handle) as Record<string, unknown>;
    properties.__webglTexture = this.array;
    properties.__webglInit = true;
    shared.tiles!.value = this.handle;
    shared.sharper!.value = extension ? sharper : 1;
    for (const book of this.books.values()) book.empty();
    this.bias = 0;
    this.due = kPasses;
    this.chooseTiles();
  }

  // To be called once a frame, before it is drawn; `moved`: the picture will be another one.
  // Returns whether it will be now.
  frame(now: number, moved: boolean): boolean {
    for (const [name, book] of this.books)
      if (this.viewer.scene.objects.get(name) !== book.object) this.close(name);
    if (this.books.size === 0) return false;
    const between = now - this.lastFrame;
    this.lastFrame = now;
    if (between < 1000) this.frameTime += (between - this.frameTime) / 8;
    const changed = this.upload();
    const viewport = String(this.viewer.viewport());
    if (moved || viewport !== this.lastViewport) this.due = kPasses;
    this.lastViewport = viewport;
    if (this.retryAt < now) {
      this.retryAt = Infinity;
      this.due = Math.max(1, this.due);
    }
    const shown = [...this.books.values()].some(book => book.object.mesh.isTextured);
    if (!shown) this.due = 0;
    if (this.due > 0 && !this.asking && now - this.lastAsk > this.pause()) void this.ask(now);
    return changed;
  }

  private pause() {
    return Math.min(kLongestPause, Math.max(kPause, kShare * this.frameTime));
  }

  // As many tiles as a frame has time for.
  private upload(): boolean {
    const end = performance.now() + kUploadMilliseconds;
    let done = 0;
    for (const book of this.books.values()) {
      const before = book.taken;
      while (book.came.length > 0 && done < kUploads && (done === 0 || performance.now() < end)) {
        const {tile, image} = book.came.shift()!;
        if (this.place(book, tile, image)) ++done;
        ++book.taken;
        image.close();
      }
      if (book.taken > before) book.send();
    }
    return done > 0;
  }

  private place(book: Book, tile: TileName, image: ImageBitmap): boolean {
    const entry = book.table.entryOf(tile),
      page = book.table.list[tile[0]]!,
      {width, height} = tileSize(page, tile);
    const stays = tile[1] === page.levels - 1;
    if (book.residents.has(entry)) return false;
    if (!stays && !book.waiting.some(chosen => chosen.entry === entry)) return false;
    if (image.width !== width || image.height !== height) {
      this.fail(book, entry, 0);
      return false;
    }
    const layers = this.layers!,
      shape = shapeOf(page, tile),
      at = layers.take(shape, this.pass);
    if (!at) {
      this.fail(book, entry, kAgain); // there is no room for it
      return false;
    }
    const {column, row} = slotAt(shape, at.slot);
    const gl = this.gl(),
      {state} = this.viewer.renderer;
    state.bindTexture(gl.TEXTURE_2D_ARRAY, this.array);
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
    gl.texSubImage3D(
      gl.TEXTURE_2D_ARRAY,
      0,
      column * kCell,
      row * kCell,
      at.layer,
      width,
      height,
      1,
      gl.RGBA,
      gl.UNSIGNED_BYTE,
      image,
    );
    state.unbindTexture();
    const {layer, slot} = at,
      resident = {book, tile, layer, slot, wanted: stays ? Infinity : this.pass};
    layers.set(resident);
    book.put(resident, placeOf(at.layer, column, row));
    return true;
  }

  // What the picture wants, drawn small. What comes back is used once the card has it: nothing
  // waits for it.
  private async ask(now: number) {
    const {shared, drawing, canvas} = this.viewer;
    this.asking = true;
    this.lastAsk = now;
    const width = Math.max(1, Math.ceil(canvas.width / kShrink)),
      height = Math.max(1, Math.ceil(canvas.height / kShrink));
    if (this.target?.width !== width || this.target.height !== height) {
      this.target?.dispose();
      this.target = drawing.target(width, height);
    }
    // A picture that is taken may be larger than what is shown.
    const larger = Math.max(1, this.viewer.viewport()[0] / canvas.width);
    shared.levelBias!.value = this.bias - Math.log2(kShrink * larger);
    // Other pixels each time.
    const n = this.pass;
    const gl = this.gl(),
      buffer = gl.createBuffer(),
      pixels = new Uint8Array(4 * width * height);
    drawing.ask(this.target, kShrink, (3 * n) % kShrink, (5 * n + (n >> 3)) % kShrink, () => {
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
      gl.bufferData(gl.PIXEL_PACK_BUFFER, pixels.length, gl.STREAM_READ);
      gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, 0);
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
    });
    shared.levelBias!.value = this.bias;
    try {
      if (!(await this.done())) return; // the card was reset; it is asked again
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
      gl.getBufferSubData(gl.PIXEL_PACK_BUFFER, 0, pixels);
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
      const asked = countAsked(pixels);
      for (const book of this.books.values()) {
        book.recent.unshift(asked.get(book.tables.book) ?? new Map<number, number>());
        book.recent.length = Math.min(book.recent.length, kRemembered);
      }
      this.due = Math.max(0, this.due - 1);
      this.chooseTiles();
    } finally {
      gl.deleteBuffer(buffer);
      this.asking = false;
    }
  }

  // Whether the card has done what it was given, once it has.
  private async done(): Promise<boolean> {
    const gl = this.gl(),
      sync = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    for (;;) {
      if (!sync || gl.isContextLost()) return false;
      const state = gl.clientWaitSync(sync, 0, 0);
      if (state === gl.WAIT_FAILED) return false;
      if (state !== gl.TIMEOUT_EXPIRED) break;
      await new Promise(done => setTimeout(done, 8));
    }
    gl.deleteSync(sync);
    return true;
  }

  private chooseTiles() {
    ++this.pass;
    const books = [...this.books.values()],
      layers = this.layers!;
    // The coarsest tiles of all pages come first, and stay; of very many pages as many as take half
    // of the layers.
    const coarsest = books.flatMap(book =>
      book.table.coarsest().map(tile => book.choice(book.table.entryOf(tile), Infinity)),
    );
    const first = coarsest.slice(0, Math.max(16, layers.count * 8));
    const kept = new Set(first.map(({book, entry}) => `${book.tables.book} ${entry}`));
    const wanted = books
      .flatMap(book => book.wanted())
      .filter(({book, entry}) => !kept.has(`${book.tables.book} ${entry}`));
    const room = layers.count - Math.ceil(first.length / 16),
      {chosen, needed} = choose(wanted, Math.max(1, room));
    this.weigh(needed, room);
    for (const {book, entry} of chosen) {
      const resident = book.residents.get(entry);
      if (resident && resident.wanted < this.pass) resident.wanted = this.pass;
    }
    for (const book of books) {
      const mine = chosen
        .filter(tile => tile.book === book && !book.residents.has(tile.entry))
        .map(tile => ({tile, lack: book.lack(tile)}))
        .sort((a, b) => b.lack - a.lack)
        .map(({tile}) => tile);
      book.waiting = [
        ...first.filter(tile => tile.book === book && !book.residents.has(tile.entry)),
        ...mine,
      ];
      book.send();
    }
  }

  // Where the layers do not suffice, all of the picture is a little coarser, and finer again when
  // they do.
  private weigh(needed: number, room: number) {
    const before = this.bias;
    const finer = Math.ceil(Math.log2(needed / room)) * kBiasStep; // half a level takes half of them
    if (needed > room && this.bias < kMostBias) this.bias += Math.max(kBiasStep, finer);
    else if (this.bias > 0 && needed * 2.5 < room) this.bias -= kBiasStep;
    if (this.bias === before) return;
    this.viewer.shared.levelBias!.value = this.bias;
    ++this.viewer.scene.changes;
    for (const book of this.books.values()) book.recent.length = 0; // they asked for other levels
    this.due = kPasses;
  }

  // Rows of the panel of figures.
  figures(): [string, string][] {
    const books = [...this.books.values()];
    if (books.length === 0) return [];
    const tiles = books.reduce((sum, book) => sum + book.residents.size, 0),
      coming = books.reduce((sum, book) => sum + book.waiting.length, 0);
    return [
      [
        'tiles of textures',
        `${tiles}${coming > 0 ? `, ${coming} on the way` : ''}, in ${Math.round((this.layers!.count * kLayerBytes) / 2 ** 20)} MiB`,
      ],
      ...(this.bias > 0
        ? [['textures coarser by', `${this.bias} levels`] as [string, string]]
        : []),
    ];
  }
}
