// SPDX-License-Identifier: Apache-2.0
// The objects that are shown, and what is asked for them, with one budget of triangles for all.
//
// Without pixels (the default) the budget is filled, since shading shows finer things than a pixel
// of distance. Objects that fit it are there whole, wherever the camera is. Of others comes at
// first what a pixel of error takes, at rest as much as the budget allows, and while the camera
// moves as much as the device draws fluently.
//
// With pixels, that is the error at rest, unless the budget does not allow it: then it is as much
// larger as it must be, everywhere. While the camera moves it may be larger.
import * as three from 'three';
import {ObjectMesh} from './object_mesh';
import {length, sub, unitsPerPixel, type Camera, type Point, type Query} from './query';
import type {Uniforms} from './shaders';
import type {
  Done,
  Limits,
  MeshListener,
  MeshSource,
  ObjectInfo,
  Store,
  TextureNews,
  ValueChoice,
  Way,
} from './source';
import {kNoStretch} from './stretch';
import {queryFor, type Focus} from './wish';

const kRest = 200; // milliseconds without a movement
const kWhileMoving = 2.5; // by how much the error rises then
const kStep = 1.3; // of the error, when the budget does not suffice
// Of filling the budget:
const kFirstPixels = 1; // of what comes first
const kFinest = 2 ** -10; // pixels, which the budget ends long before
const kMostThin = 300_000; // triangles that a server keeps for this page
const kSlow = 60,
  kFast = 24; // milliseconds between frames
const kLeastMoving = 30_000; // triangles
const kGrowth = 0.85; // error grows as triangles to the power of -kGrowth

export interface SceneObject {
  name: string;
  info: ObjectInfo;
  mesh: ObjectMesh;
  source: MeshSource;
  state: 'opening' | 'open' | 'lost' | 'gone';
  sentence: string;
  failure: string; // of the last query
  wanted: Query | null;
  wantedText: string;
  done: Done | null; // the last answer
  doneText: string; // of which query
  pages: number | null; // of its texture, that have tiles; null: not known yet
}

export interface Exactness {
  kind: 'nothing' | 'loading' | 'exact' | 'short';
  by: 'pixels' | 'budget' | 'whole'; // what decides, and what was reached: the budget, or all triangles
  pixels: number; // that are promised; when "short", that could not be kept. By budget: about, at the camera's depth
  bound: number; // the largest of the objects' error bounds
  limited: boolean; // the budget raised the error
  limit: 'triangles' | 'memory'; // which, then
}

export class Scene {
  readonly objects = new Map<string, SceneObject>();
  readonly root = new three.Group();
  pixels: number | null = null; // null: the budget is filled
  budget = 600_000;
  focus: Focus | null = null;
  stretch: Point = kNoStretch;
  limits: Limits = {cacheBytes: 256 * 2 ** 20, bytesPerSecond: Infinity}; // of all objects together
  wireframe = false;
  moving = false;
  // Turned by itself, without an end: what fits the budget is asked for as a whole, at once, since a
  // query that changes with each frame is never answered.
  turning = false;
  onTexture: (object: SceneObject, news: TextureNews) => void = () => {};
  changes = 0; // counts what would be drawn otherwise now
  private factor = 1;
  private refused = 0; // a factor that was too small for this camera
  private limit: Exactness['limit'] = 'triangles'; // that raised the factor last
  private camera: Camera | null = null;
  private cameraText = '';
  private lastMove = 0;
  private fill: 'first' | 'full' = 'first'; // what is asked for at rest when the budget is filled
  private room = Infinity; // triangles that this device moves fluently, as far as is known
  private firstPixels = kFirstPixels; // of the first picture at rest
  private firstTriangles = 0; // that they took
  private noMemory = 0; // pixels, for which memory suffices; 0: also for wholes
  private lastFrame = 0;
  private slowness = 0; // of the last frames that moved, smoothed milliseconds

  constructor(
    private readonly store: Store,
    private way: Way,
    private readonly shared: Uniforms,
    private readonly changed: () => void,
  ) {}

  show(info: ObjectInfo, frame: Point, choice: ValueChoice) {
    const mesh = new ObjectMesh(this.shared, frame, this.stretch);
    mesh.wireframe = this.wireframe;
    const object: SceneObject = {
      name: info.object,
      info,
      mesh,
      source: null as unknown as MeshSource,
      state: 'opening',
      sentence: '',
      failure: '',
      wanted: null,
      wantedText: '',
      done: null,
      doneText: '',
      pages: null,
    };
    this.objects.set(info.object, object);
    this.open(object);
    object.source.choose(choice);
    this.root.add(mesh.group);
    this.shareLimits();
    this.restart();
  }

  private open(object: SceneObject) {
    const {mesh} = object;
    const listener: MeshListener = {
      changed: update => {
        mesh.apply(update);
        ++this.changes;
      },
      answered: (query, done) => this.onAnswer(object, query, done),
      failed: (query, sentence) => {
        object.failure = sentence;
        this.changed();
        if (query === object.wanted) object.doneText = '';
      },
      state: (state, sentence) => {
        object.state = state;
        object.sentence = sentence;
        if (state !== 'open') object.done = null;
        this.changed();
      },
      texture: news => {
        if (news.kind === 'pages') object.pages = news.pages.filter(p => p.levels > 0).length;
        this.onTexture(object, news);
      },
    };
    object.source = this.store.open(object.name, this.way, listener);
    object.wantedText = object.doneText = '';
    object.done = null;
  }

  // Cuts are made elsewhere from now on; what is shown stays until the first mesh from there. The
  // new sources know no choice of values yet.
  setWay(way: Way) {
    if (way === this.way) return;
    this.way = way;
    for (const object of this.objects.values()) {
      object.source.close();
      this.open(object);
    }
    this.shareLimits();
    this.restart();
  }

  setLimits(limits: Limits) {
    this.limits = limits;
    this.shareLimits();
    this.restart();
  }

  private shareLimits() {
    const n = Math.max(1, this.objects.size);
    for (const object of this.objects.values()) {
      object.source.limit({
        cacheBytes: Math.floor(this.limits.cacheBytes / n),
        bytesPerSecond: this.limits.bytesPerSecond / n,
      });
    }
  }

  hide(name: string) {
    const object = this.objects.get(name);
    if (!object) return;
    object.source.close();
    this.root.remove(object.mesh.group);
    object.mesh.dispose();
    this.objects.delete(name);
    this.shareLimits();
    this.restart();
  }

  setWireframe(on: boolean) {
    this.wireframe = on;
    for (const object of this.objects.values()) object.mesh.wireframe = on;
    ++this.changes;
  }

  // Budget or pixels are others now.
  restart() {
    this.factor = 1;
    this.refused = 0;
    this.fill = 'first';
    this.firstPixels = kFirstPixels;
    this.noMemory = 0;
    ++this.changes;
    this.changed();
  }

  private shareOf(object: SceneObject) {
    const share = Math.floor(this.budget / Math.max(1, this.objects.size));
    const most = this.pixels === null && this.way === 'thin' ? kMostThin : Infinity;
    return Math.max(1, Math.min(share, most, object.source.maxTriangles));
  }

  // Whether all that is shown can be there whole.
  private fits() {
    return (
      this.noMemory === 0 &&
      [...this.objects.values()].every(o => o.info.triangles <= this.shareOf(o))
    );
  }

  // By itself, with all of it.
  private turns() {
    return this.turning && this.pixels === null && this.fits();
  }

  // The error to ask for, in pixels; 0: none at all.
  private wanted(): number {
    if (this.pixels !== null) return this.pixels * this.factor * (this.moving ? kWhileMoving : 1);
    const whole = this.total(o => o.info.triangles);
    if (this.turns()) return 0;
    if (this.moving) {
      if (this.fits() && whole <= this.room)
        return this.fill === 'full' || whole <= kLeastMoving ? 0 : kFirstPixels;
      const room = Math.min(this.room, this.budget / 2);
      const pixels =
        this.firstTriangles > 0
          ? this.firstPixels * (this.firstTriangles / room) ** kGrowth
          : kWhileMoving;
      return Math.max(this.noMemory, 1 / 8, Math.min(kWhileMoving, pixels));
    }
    if (this.fill === 'first') return this.firstPixels;
    return this.fits() ? 0 : Math.max(this.noMemory, kFinest);
  }

  // What the device draws fluently, by the frames that move.
  private watch(now: number) {
    const between = now - this.lastFrame;
    this.lastFrame = now;
    if (!this.moving || between > 1000) return;
    this.slowness += (between - this.slowness) / 8;
    const drawn = this.total(o => o.mesh.triangles);
    if (this.slowness > kSlow) this.room = Math.max(kLeastMoving, 0.7 * Math.min(this.room, drawn));
    else if (this.slowness < kFast && this.room < Infinity && drawn > 0.6 * this.room)
      this.room *= 1.1;
    else return;
    this.slowness = (kSlow + kFast) / 2;
  }

  // Asks for what `camera`, in the page's coordinates, wants. To be called once a frame.
  follow(camera: Camera, now: number) {
    const text = JSON.stringify(camera);
    if (text !== this.cameraText) {
      this.cameraText = text;
      this.camera = camera;
      this.lastMove = now;
      this.refused = 0;
    }
    const moving = now - this.lastMove < kRest && !this.turns();
    if (moving !== this.moving) this.changed();
    this.moving = moving;
    this.watch(now);
    // Also when the answer came while it moved, and is that of the query at rest.
    if (this.pixels === null && this.fill === 'first') this.goOn([...this.objects.values()]);
    const pixels = this.wanted();
    for (const object of this.objects.values()) {
      const wish = {
        camera,
        pixels,
        focus: this.focus,
        distancePixels: this.pixels === null ? kFirstPixels : pixels,
        maxTriangles: this.shareOf(object),
        stretch: this.stretch,
      };
      const query = queryFor(wish),
        wanted = JSON.stringify(query);
      if (wanted === object.wantedText) continue;
      object.wanted = query;
      object.wantedText = wanted;
      object.failure = '';
      object.source.ask(query);
    }
  }

  private onAnswer(object: SceneObject, query: Query, done: Done) {
    object.done = done;
    object.doneText = query === object.wanted ? object.wantedText : '';
    ++this.changes;
    if (query === object.wanted) this.weigh();
    this.changed();
  }

  // Whether the budget suffices, with the error as it is.
  private weigh() {
    const all = [...this.objects.values()];
    if (this.pixels === null) return this.goOn(all);
    const byCamera =
      !this.focus ||
      this.focus.outside === 'view' ||
      this.focus.inside === 'view' ||
      this.focus.inside === 'distance';
    if (!byCamera) return;
    const short = all.find(
      o =>
        (o.done?.limit === 'triangles' || o.done?.limit === 'memory') &&
        o.doneText === o.wantedText,
    );
    if (short) {
      this.limit = short.done!.limit as Exactness['limit'];
      if (this.factor > 200) return;
      this.refused = Math.max(this.refused, this.factor);
      this.factor *= kStep;
    } else if (
      this.factor > 1 &&
      !this.moving &&
      all.every(o => o.doneText !== '' && o.doneText === o.wantedText)
    ) {
      const lower = Math.max(1, this.factor / kStep);
      const triangles = all.reduce((sum, o) => sum + o.mesh.triangles, 0);
      if (lower > this.refused * 1.001 && triangles * kStep * kStep < this.budget)
        this.factor = lower;
    }
  }

  // After an answer, when the budget is filled.
  private goOn(all: SceneObject[]) {
    if (all.some(o => o.done?.limit === 'memory' && o.doneText === o.wantedText)) {
      if (this.noMemory < 64) this.noMemory = Math.max(1 / 8, kStep * this.noMemory);
      return;
    }
    if (
      this.moving ||
      this.fill === 'full' ||
      !all.every(o => o.doneText !== '' && o.doneText === o.wantedText)
    )
      return;
    const triangles = this.total(o => o.mesh.triangles);
    if (all.some(o => o.done!.limit === 'triangles')) {
      // A pixel takes more than there may be: so does the rest.
      this.firstPixels *= kStep;
      if (this.firstPixels < 64) return;
    }
    this.firstTriangles = triangles;
    this.fill = 'full';
  }

  exactness(): Exactness {
    const shown = [...this.objects.values()].filter(o => o.state !== 'gone');
    const result: Exactness = {
      kind: 'nothing',
      by: this.pixels === null ? 'budget' : 'pixels',
      pixels: (this.pixels ?? this.firstPixels) * this.factor,
      bound: 0,
      limited: this.factor > 1.001,
      limit: this.limit,
    };
    if (shown.length === 0) return result;
    const filling = this.pixels === null && this.fill === 'first';
    const ready =
      !this.moving &&
      !filling &&
      shown.every(o => o.done && o.state === 'open' && o.doneText === o.wantedText);
    result.kind = ready ? 'exact' : 'loading';
    for (const object of shown)
      result.bound = Math.max(result.bound, object.done?.error_bound ?? 0);
    if (this.pixels === null) return this.howFull(result, shown, ready);
    for (const object of shown) {
      if (ready && (object.done!.shortfall || object.done!.limit !== 'accuracy'))
        result.kind = 'short';
      if (ready && object.done!.limit !== 'accuracy') result.limited = true;
    }
    return result;
  }

  private howFull(result: Exactness, shown: SceneObject[], ready: boolean): Exactness {
    const camera = shown[0]!.wanted === null ? null : this.camera;
    if (camera)
      result.pixels =
        (result.bound / (unitsPerPixel(camera, length(sub(camera.target, camera.eye))) || 1)) *
        this.stretch[2];
    if (!ready) return result;
    if (shown.every(o => o.mesh.triangles >= o.info.triangles)) result.by = 'whole';
    result.limited = this.noMemory > 0 || shown.some(o => o.done!.limit !== 'accuracy');
    result.limit = this.noMemory > 0 ? 'memory' : 'triangles';
    return result;
  }

  total(pick: (object: SceneObject) => number) {
    let sum = 0;
    for (const object of this.objects.values()) sum += pick(object);
    return sum;
  }
}
