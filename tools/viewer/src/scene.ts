// SPDX-License-Identifier: Apache-2.0
// The objects that are shown, and what is asked for them: the camera's pixels of error, one budget
// of triangles for all. While the camera moves, the error may be larger; at rest it is what was
// asked for, unless the budget does not allow that: then it is as much larger as it must be,
// everywhere.
import * as three from 'three';
import {ObjectMesh} from './object_mesh';
import type {Camera, Point, Query} from './query';
import type {Uniforms} from './shaders';
import type {Done, Limits, MeshListener, MeshSource, ObjectInfo, Store, ValueChoice, Way} from './source';
import {kNoStretch} from './stretch';
import {queryFor, type Focus} from './wish';

const kRest = 200; // milliseconds without a movement
const kWhileMoving = 2.5; // by how much the error rises then
const kStep = 1.3; // of the error, when the budget does not suffice

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
}

export interface Exactness {
  kind: 'nothing' | 'loading' | 'exact' | 'short';
  pixels: number; // that are promised; when "short", that could not be kept
  bound: number; // the largest of the objects' error bounds
  limited: boolean; // the budget raised the error
  limit: 'triangles' | 'memory'; // which, then
}

export class Scene {
  readonly objects = new Map<string, SceneObject>();
  readonly root = new three.Group();
  pixels = 1;
  budget = 600_000;
  focus: Focus | null = null;
  stretch: Point = kNoStretch;
  limits: Limits = {cacheBytes: 256 * 2 ** 20, bytesPerSecond: Infinity}; // of all objects together
  wireframe = false;
  moving = false;
  changes = 0; // counts what would be drawn otherwise now
  private factor = 1;
  private refused = 0; // a factor that was too small for this camera
  private limit: Exactness['limit'] = 'triangles'; // that raised the factor last
  private cameraText = '';
  private lastMove = 0;

  constructor(private readonly store: Store, private way: Way, private readonly shared: Uniforms, private readonly changed: () => void) {}

  show(info: ObjectInfo, frame: Point, choice: ValueChoice) {
    const mesh = new ObjectMesh(this.shared, frame, this.stretch);
    mesh.wireframe = this.wireframe;
    const object: SceneObject = {name: info.object, info, mesh, source: null as unknown as MeshSource, state: 'opening', sentence: '', failure: '',
      wanted: null, wantedText: '', done: null, doneText: ''};
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
      object.source.limit({cacheBytes: Math.floor(this.limits.cacheBytes / n), bytesPerSecond: this.limits.bytesPerSecond / n});
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
    ++this.changes;
    this.changed();
  }

  // Asks for what `camera`, in the page's coordinates, wants. To be called once a frame.
  follow(camera: Camera, now: number) {
    const text = JSON.stringify(camera);
    if (text !== this.cameraText) {
      this.cameraText = text;
      this.lastMove = now;
      this.refused = 0;
    }
    const moving = now - this.lastMove < kRest;
    if (moving !== this.moving) this.changed();
    this.moving = moving;
    const share = Math.floor(this.budget / Math.max(1, this.objects.size));
    for (const object of this.objects.values()) {
      const wish = {camera, pixels: this.pixels * this.factor * (moving ? kWhileMoving : 1), focus: this.focus,
        maxTriangles: Math.max(1, Math.min(share, object.source.maxTriangles)), stretch: this.stretch};
      const query = queryFor(wish), wanted = JSON.stringify(query);
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
    const byCamera = !this.focus || this.focus.outside === 'view' || this.focus.inside === 'view' || this.focus.inside === 'distance';
    if (!byCamera) return;
    const all = [...this.objects.values()];
    const short = all.find(o => (o.done?.limit === 'triangles' || o.done?.limit === 'memory') && o.doneText === o.wantedText);
    if (short) {
      this.limit = short.done!.limit as Exactness['limit'];
      if (this.factor > 200) return;
      this.refused = Math.max(this.refused, this.factor);
      this.factor *= kStep;
    } else if (this.factor > 1 && !this.moving && all.every(o => o.doneText !== '' && o.doneText === o.wantedText)) {
      const lower = Math.max(1, this.factor / kStep);
      const triangles = all.reduce((sum, o) => sum + o.mesh.triangles, 0);
      if (lower > this.refused * 1.001 && triangles * kStep * kStep < this.budget) this.factor = lower;
    }
  }

  exactness(): Exactness {
    const shown = [...this.objects.values()].filter(o => o.state !== 'gone');
    const result: Exactness = {kind: 'nothing', pixels: this.pixels * this.factor, bound: 0, limited: this.factor > 1.001, limit: this.limit};
    if (shown.length === 0) return result;
    const ready = !this.moving && shown.every(o => o.done && o.state === 'open' && o.doneText === o.wantedText);
    result.kind = ready ? 'exact' : 'loading';
    for (const object of shown) {
      result.bound = Math.max(result.bound, object.done?.error_bound ?? 0);
      if (ready && (object.done!.shortfall || object.done!.limit !== 'accuracy')) result.kind = 'short';
      if (ready && object.done!.limit !== 'accuracy') result.limited = true;
    }
    return result;
  }

  total(pick: (object: SceneObject) => number) {
    let sum = 0;
    for (const object of this.objects.values()) sum += pick(object);
    return sum;
  }
}
