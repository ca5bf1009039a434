// SPDX-License-Identifier: Apache-2.0
// The page: puts store, scene, camera and panel together, and draws.
import * as three from 'three';
import {FocusHandles, regionFor} from './focus_handles';
import {Gestures} from './gestures';
import {Look} from './look';
import {Measuring} from './measuring';
import {Navigation} from './navigation';
import {byId, figure, whole} from './page';
import {Panel} from './panel';
import {add, length, scale, sub, type Point, type Region} from './query';
import {Scene} from './scene';
import {ServerStore} from './server_store';
import {sharedUniforms} from './shaders';
import {StoreError, type Hit, type ObjectEntry, type ObjectInfo, type Store} from './source';
import {Status} from './status';
import {TakingAway} from './taking_away';
import {plainStyle, readView, writeView, type ViewState} from './view_state';

export class Viewer {
  readonly store: Store = new ServerStore(new URL('.', location.href));
  readonly canvas = byId<HTMLCanvasElement>('canvas');
  readonly renderer: three.WebGLRenderer;
  readonly world = new three.Scene();
  readonly shared = sharedUniforms();
  readonly navigation: Navigation;
  readonly scene: Scene;
  readonly handles: FocusHandles;
  readonly measuring: Measuring;
  readonly look = new Look(this);
  readonly panel = new Panel(this);
  readonly gestures = new Gestures(this);
  readonly taking = new TakingAway(this);
  readonly status = new Status(this);
  entries: ObjectEntry[] = [];
  private readonly infos = new Map<string, ObjectInfo>();
  frame: Point | null = null;
  unit = '';
  defaults: ViewState;
  drawn = '';
  private lastFrame = 0;
  readonly frames: number[] = [];
  drawMilliseconds = 0;
  panelDirty = true;
  private savedHash = '';
  private lastStatus = 0;

  constructor(context: WebGL2RenderingContext) {
    this.renderer = new three.WebGLRenderer({canvas: this.canvas, context, antialias: true});
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.scene = new Scene(this.store, this.shared, () => (this.panelDirty = true));
    this.scene.budget = matchMedia('(max-width: 700px)').matches ? 200_000 : 600_000;
    this.defaults = {objects: [], eye: null, target: null, pixels: 1, triangles: this.scene.budget, style: plainStyle, focus: null, unit: '', lines: []};
    this.navigation = new Navigation(this.canvas, async (x, y) => (await this.probe(x, y))?.point ?? null);
    this.handles = new FocusHandles(this.canvas, this.navigation, region => this.setRegion(region, false));
    this.measuring = new Measuring(byId('labels'), this.navigation, units => this.text(units), () => this.panel.showMeasured());
    this.world.add(this.scene.root, this.handles.root, this.measuring.root);
    this.handles.set(null);
    this.panel.bind();
    this.gestures.bindCanvas();
    this.gestures.bindKeys();
    addEventListener('resize', () => this.resize());
    addEventListener('hashchange', () => void this.load(readView(location.hash, this.defaults)));
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.look.setTheme());
    this.look.setTheme();
    this.resize();
    requestAnimationFrame(now => this.tick(now));
  }

  // ---- objects ----

  async begin() {
    try {
      this.entries = await this.store.objects();
    } catch (error) {
      this.say((error as Error).message + ' Trying again…');
      setTimeout(() => void this.begin(), 2000);
      return;
    }
    this.say('');
    const view = readView(location.hash, this.defaults);
    if (view.objects.length === 0 && this.entries.length === 1) view.objects = [this.entries[0]!.object];
    if (view.objects.length > 0) return this.load(view);
    this.showStart();
  }

  private showStart() {
    byId('start').hidden = false;
    byId('start-text').textContent = this.entries.length === 0 ? 'This store has no objects yet. mtdb ingest puts some in; then load this page anew.' : 'Which object would you like to see?';
    byId('start-list').replaceChildren(...this.entries.map(entry => {
      const button = document.createElement('button'), name = document.createElement('span'), size = document.createElement('span');
      name.textContent = entry.object;
      size.textContent = `${whole(entry.triangles)} triangles`;
      button.append(name, size);
      button.onclick = () => void this.load({...this.defaults, objects: [entry.object]});
      return button;
    }));
  }

  // Makes the page show a view.
  async load(view: ViewState) {
    byId('start').hidden = true;
    this.look.style = {...view.style};
    this.unit = view.unit;
    this.scene.pixels = view.pixels;
    this.scene.budget = view.triangles;
    for (const name of [...this.scene.objects.keys()]) if (!view.objects.includes(name)) this.hide(name);
    for (const name of view.objects) await this.show(name);
    if (this.scene.objects.size === 0) return this.showStart();
    if (view.eye && view.target) this.navigation.set(view.eye, view.target, false);
    else this.navigation.view('home', false);
    if (view.focus) this.scene.focus = view.focus;
    this.setRegion(view.focus?.region ?? null);
    if (view.lines.length > 0 || this.measuring.lines.length > 0) {
      this.measuring.replace(view.lines.map(points => ({points: points.map(point => ({point, error_bound: this.roundingError()}))})));
    }
    this.look.apply();
    this.scene.restart();
    this.panel.fill();
    this.canvas.focus({preventScroll: true});
  }

  async show(name: string) {
    if (this.scene.objects.has(name)) return;
    let info: ObjectInfo;
    try {
      info = await this.store.info(name);
    } catch (error) {
      const sentence = (error as StoreError).code === 'no_such_object' ? `There is no object “${name}” in this store.` : (error as Error).message;
      this.say(sentence, 8000);
      return;
    }
    this.infos.set(name, info);
    if (this.scene.objects.size === 0) this.frame = null;
    this.frame ??= scale(add(info.bounds.min, info.bounds.max), 0.5);
    this.scene.show(info, this.frame, this.look.choiceFor(info));
    this.placeAll();
    // They are where they were, in a scene that may have another origin.
    this.measuring.rebuild();
    this.handles.set(this.scene.focus?.region ?? null);
    this.applyClip();
  }

  hide(name: string) {
    this.scene.hide(name);
    this.placeAll();
  }

  shownInfos() {
    return [...this.scene.objects.values()].map(o => o.info);
  }

  private placeAll() {
    const infos = this.shownInfos();
    if (infos.length > 0) {
      const extreme = (pick: (...n: number[]) => number, key: 'min' | 'max') => [0, 1, 2].map(k => pick(...infos.map(i => i.bounds[key][k]!))) as Point;
      this.navigation.place(this.frame!, {min: extreme(Math.min, 'min'), max: extreme(Math.max, 'max')});
    }
    this.panel.fill();
  }

  bounds() {
    const infos = this.shownInfos();
    const extreme = (pick: (...n: number[]) => number, key: 'min' | 'max') => [0, 1, 2].map(k => pick(...infos.map(i => i.bounds[key][k]!))) as Point;
    return infos.length > 0 ? {min: extreme(Math.min, 'min'), max: extreme(Math.max, 'max')} : {min: [-1, -1, -1] as Point, max: [1, 1, 1] as Point};
  }

  roundingError() {
    return Math.max(0, ...this.shownInfos().map(i => i.rounding_error));
  }

  // ---- region ----

  setRegion(region: Region | null, fill = true) {
    this.scene.focus = region ? {inside: 'full', outside: 'view', ...this.scene.focus, region} : null;
    if (fill || !region) this.handles.set(region);
    this.applyClip();
    if (fill) this.panel.fill();
    else this.panel.fillNumbers();
    ++this.scene.changes;
  }

  applyClip() {
    const u = this.shared, focus = this.scene.focus;
    const a = u.clipA!.value as three.Vector3, b = u.clipB!.value as three.Vector3;
    u.clipKind!.value = 0;
    if (!focus || focus.outside !== 'clip') return;
    const region = focus.region;
    if ('box' in region) {
      u.clipKind!.value = 1;
      a.copy(this.navigation.toScene(region.box.min));
      b.copy(this.navigation.toScene(region.box.max));
    } else if ('sphere' in region) {
      u.clipKind!.value = 2;
      a.copy(this.navigation.toScene(region.sphere.centre));
      b.set(region.sphere.radius, 0, 0);
    } else {
      u.clipKind!.value = 3;
      a.copy(this.navigation.toScene(region.half_space.point));
      b.set(...region.half_space.normal);
    }
  }

  newRegion(kind: string): Region | null {
    const {min, max} = this.bounds();
    const size = length(sub(max, min)) * 0.12;
    // Around what the camera turns around, when that is in the scene.
    const target = this.navigation.target();
    const inside = target.every((x, k) => x >= min[k]! && x <= max[k]!);
    return regionFor(kind, inside ? target : scale(add(min, max), 0.5), size);
  }

  // ---- the surface under a place ----

  // The nearest hit of what is shown, at full resolution.
  async probe(x: number, y: number, signal?: AbortSignal): Promise<Hit | null> {
    const {origin, direction} = this.navigation.ray(x, y);
    try {
      const shown = [...this.scene.objects.values()].filter(o => o.state === 'open');
      const hits = await Promise.all(shown.map(o => this.store.probe(o.name, origin, direction, signal)));
      let best: Hit | null = null;
      for (const hit of hits) if (hit && (!best || length(sub(hit.point, origin)) < length(sub(best.point, origin)))) best = hit;
      return best;
    } catch (error) {
      if ((error as Error).name !== 'AbortError' && (error as StoreError).code !== 'unreachable') this.say((error as Error).message, 5000);
      return null;
    }
  }

  // A number of model units.
  text(units: number) {
    return figure(units, 4) + (this.unit ? ' ' + this.unit : '');
  }

  // A coordinate, with all digits that mean something.
  coordinate(x: number) {
    const step = Math.max(this.roundingError(), this.navigation.radius() * 1e-7);
    return x.toFixed(Math.max(0, Math.min(12, Math.ceil(-Math.log10(step)))));
  }

  say(sentence: string, milliseconds = 0) {
    const banner = byId('banner');
    banner.textContent = sentence;
    banner.hidden = sentence === '';
    if (milliseconds > 0) setTimeout(() => banner.textContent === sentence && (banner.hidden = true), milliseconds);
  }

  // ---- the view as a link ----

  view(): ViewState {
    return {objects: [...this.scene.objects.keys()], eye: this.navigation.eye(), target: this.navigation.target(), pixels: this.scene.pixels, triangles: this.scene.budget,
      style: this.look.style, focus: this.scene.focus, unit: this.unit, lines: this.measuring.lines.map(line => line.points.map(p => p.point))};
  }

  saveView() {
    if (this.scene.objects.size === 0) return;
    const hash = writeView(this.view(), this.defaults);
    if (hash === this.savedHash) return;
    this.savedHash = hash;
    history.replaceState(null, '', hash);
  }

  // ---- drawing ----

  resize() {
    const w = this.canvas.clientWidth, h = this.canvas.clientHeight;
    if (w === 0 || h === 0) return;
    this.renderer.setSize(w, h, false);
    this.navigation.camera.aspect = w / h;
    this.navigation.camera.updateProjectionMatrix();
    this.drawn = '';
  }

  viewport(): [number, number] {
    return this.taking.pictureViewport ?? [this.canvas.width, this.canvas.height];
  }

  draw() {
    const light = this.shared.light!.value as three.Vector3;
    if (this.look.style.light === 'camera') light.set(-0.35, 0.5, 0.8).normalize();
    else light.set(-1, 1, 1.4).normalize().transformDirection(this.navigation.camera.matrixWorldInverse);
    const range = this.look.mapRange(), shift = this.shared.colourBy!.value === 3 ? (this.frame?.[2] ?? 0) : 0;
    if (range) (this.shared.range!.value as three.Vector2).set(range[0] - shift, range[1] - shift);
    this.handles.update();
    this.renderer.render(this.world, this.navigation.camera);
  }

  private tick(now: number) {
    requestAnimationFrame(next => this.tick(next));
    if (this.taking.pictureViewport) {
      if (this.scene.objects.size > 0) this.scene.follow(this.navigation.query(this.viewport()), now);
      return;
    }
    const seconds = Math.min(0.1, (now - this.lastFrame) / 1000);
    this.lastFrame = now;
    this.navigation.update(seconds);
    if (this.scene.objects.size > 0) this.scene.follow(this.navigation.query(this.viewport()), now);
    const state = JSON.stringify([this.scene.changes, this.navigation.camera.position, this.navigation.camera.quaternion, this.canvas.width, this.handles.dragging, this.look.style]);
    if (state !== this.drawn) {
      this.drawn = state;
      const begin = performance.now();
      this.draw();
      this.drawMilliseconds = performance.now() - begin;
      this.measuring.update(this.canvas.clientWidth, this.canvas.clientHeight);
      this.status.showAxes();
      this.panelDirty = true;
      this.frames.push(now);
    }
    while (this.frames.length > 0 && this.frames[0]! < now - 1000) this.frames.shift();
    if (this.panelDirty && now - this.lastStatus > 100) {
      this.lastStatus = now;
      this.panelDirty = false;
      this.status.show();
      if (!this.scene.moving && !this.handles.dragging) this.saveView();
    }
  }
}

function begin() {
  const canvas = byId<HTMLCanvasElement>('canvas');
  const context = canvas.getContext('webgl2', {antialias: true, powerPreference: 'high-performance'});
  if (!context) {
    const banner = byId('banner');
    banner.hidden = false;
    banner.textContent = 'This browser has no WebGL 2, which drawing needs; another browser may have it, or its settings may allow it.';
    return;
  }
  const viewer = new Viewer(context);
  (window as unknown as {viewer: Viewer}).viewer = viewer;
  void viewer.begin();
}
begin();
