// SPDX-License-Identifier: Apache-2.0
// The page: puts store, scene, camera and panel together, and draws.
import * as three from 'three';
import {FocusHandles} from './focus_handles';
import {Gestures} from './gestures';
import {Loading, wayOf} from './loading';
import {Images} from './images';
import {Look} from './look';
import {Measuring} from './measuring';
import {Navigation} from './navigation';
import {PackedStore, sourceOf} from './packed_store';
import {byId, figure, whole} from './page';
import {Panel} from './panel';
import {add, dot, length, scale, sub, type Camera, type Point} from './query';
import {Scene} from './scene';
import {ServerStore} from './server_store';
import {sharedUniforms, tableTexture} from './shaders';
import {StoreError, type Hit, type ObjectEntry, type ObjectInfo, type Store} from './source';
import {kindOf, newShape, numbersOf, shapeOf, type Shape} from './shapes';
import {Status} from './status';
import {inDegrees, isTerrain, stretchOf, toModel, toPage} from './stretch';
import {TakingAway} from './taking_away';
import {Textures} from './textures';
import {kZUp, upAxes} from './up';
import {kUnits, plainStyle, readView, writeView, type ViewState} from './view_state';

export class Viewer {
  readonly canvas = byId<HTMLCanvasElement>('canvas');
  readonly renderer: three.WebGLRenderer;
  readonly world = new three.Scene();
  readonly shared = sharedUniforms();
  readonly navigation: Navigation;
  readonly scene: Scene;
  readonly loading: Loading;
  readonly handles: FocusHandles;
  readonly measuring: Measuring;
  readonly look: Look = new Look(this);
  readonly panel: Panel = new Panel(this);
  readonly gestures: Gestures = new Gestures(this);
  readonly taking = new TakingAway(this);
  readonly status = new Status(this);
  readonly images = new Images(this);
  readonly textures = new Textures(this);
  entries: ObjectEntry[] = [];
  frame: Point | null = null;
  readonly ui =
    (['simple', 'none'] as const).find(
      ui => new URLSearchParams(location.search).get('ui') === ui,
    ) ?? 'full';
  unit = '';
  upChoice = ''; // see ViewState
  exaggerate = 1;
  defaults: ViewState;
  drawn = '';
  private middle: Point = [0, 0, 0]; // of the first object, in its coordinates
  // The view from home is made as close as the mesh allows, once some of it is there, and again
  // when it is as fine as the picture, if nobody has moved it.
  private home: {eye: Point; waits: 'mesh' | 'answer'} | null = null;
  private lastFrame = 0;
  readonly frames: number[] = [];
  drawMilliseconds = 0;
  panelDirty = true;
  private savedHash = '';
  private lastStatus = 0;

  constructor(
    context: WebGL2RenderingContext,
    readonly store: Store,
  ) {
    this.renderer = new three.WebGLRenderer({canvas: this.canvas, context, antialias: true});
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    const way = wayOf(location.search, store);
    this.scene = new Scene(store, way, this.shared, () => (this.panelDirty = true));
    this.scene.onTexture = (object, news) => {
      this.textures.take(object, news);
      if (news.kind === 'pages' && object.pages === 0) {
        this.look.apply(); // without it
        this.panel.fill();
      }
    };
    this.loading = new Loading(store, way, this.scene, () => {
      this.look.apply();
      this.panel.fill();
    });
    this.scene.budget = matchMedia('(max-width: 700px)').matches ? 200_000 : 600_000;
    this.defaults = {
      objects: [],
      eye: null,
      target: null,
      pixels: null,
      triangles: this.scene.budget,
      style: {...plainStyle, colour: ''},
      focus: null,
      unit: '',
      up: '',
      exaggerate: 1,
      lines: [],
    };
    this.navigation = new Navigation(this.canvas, async (x, y) => {
      const hit = await this.probe(x, y);
      return hit && toPage(hit.point, this.scene.stretch);
    });
    this.navigation.onSpeed = speed => this.say(`Flying ${figure(speed, 2)} times as fast`, 1200);
    this.navigation.shape = () => this.shape();
    this.handles = new FocusHandles(this.canvas, this.navigation, shape =>
      this.setRegion(shape, false),
    );
    this.measuring = new Measuring(
      byId('labels'),
      this.navigation,
      units => this.text(units),
      () => this.panel.showMeasured(),
    );
    this.world.add(this.scene.root, this.handles.root, this.measuring.root);
    this.handles.set(null);
    this.panel.bind();
    this.images.bind();
    this.receive();
    this.gestures.bindCanvas();
    this.gestures.bindKeys();
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    addEventListener('hashchange', () => void this.load(readView(location.hash, this.defaults)));
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () =>
      this.look.setTheme(),
    );
    this.look.setTheme();
    this.resize();
    requestAnimationFrame(now => this.tick(now));
  }

  // Visitors get the picture and what is told of it.
  private receive() {
    if (this.ui === 'full') return;
    document.body.classList.add('closed', `ui-${this.ui}`);
  }

  // Once the objects are known, since what is said before that goes.
  private tellVisitors() {
    if (this.ui !== 'simple') return;
    const search = new URLSearchParams(location.search);
    void (
      import(new URL('visitor.js', import.meta.url).href) as Promise<typeof import('./visitor')>
    ).then(
      module => new module.Visitor(this, search),
      () => this.say('The page cannot load its part for visitors; is its server still there?'),
    );
  }

  // ---- objects ----

  async begin() {
    try {
      this.entries = await this.store.objects();
    } catch (error) {
      const {message, passes} = error as StoreError;
      this.say(message.replace(/\.$/, '') + (passes ? '. Trying again…' : '.'));
      if (passes) setTimeout(() => void this.begin(), 2000);
      return;
    }
    this.say('');
    this.tellVisitors();
    const view = readView(location.hash, this.defaults);
    const [first] = this.entries;
    // Where there is nothing but the picture, nobody can choose.
    if (view.objects.length === 0 && first && (this.entries.length === 1 || this.ui === 'none'))
      view.objects = [first.object];
    if (view.objects.length > 0) return this.load(view);
    this.showStart();
  }

  // The list of objects lies over all else, which no key leads to meanwhile.
  private coverWithStart(shown: boolean) {
    byId('start').hidden = !shown;
    for (const id of ['stage', 'bar', 'tools', 'panel']) byId(id).inert = shown;
  }

  // `missing`: what the address names, and is not there.
  private showStart(missing: string[] = []) {
    this.coverWithStart(true);
    const none =
      missing.length > 0
        ? `There is no object ${missing.map(name => `“${name}”`).join(' or ')} here. `
        : '';
    byId('start-text').textContent =
      none +
      (this.entries.length === 0
        ? 'This store has no objects yet. mtdb ingest puts some in; then load this page anew.'
        : none
          ? 'There are these:'
          : 'Which object would you like to see?');
    byId('start-list').replaceChildren(
      ...this.entries.map(entry => {
        const button = document.createElement('button'),
          name = document.createElement('span'),
          size = document.createElement('span');
        name.textContent = entry.object;
        size.textContent = `${whole(entry.triangles)} triangles`;
        button.append(name, size);
        button.onclick = () => void this.load({...this.defaults, objects: [entry.object]});
        return button;
      }),
    );
    byId('start-list').querySelector('button')?.focus({preventScroll: true});
  }

  // Makes the page show a view.
  async load(view: ViewState) {
    this.coverWithStart(false);
    this.look.style = {...view.style};
    this.unit = view.unit;
    this.upChoice = view.up;
    this.exaggerate = view.exaggerate;
    this.scene.pixels = view.pixels;
    this.scene.budget = view.triangles;
    for (const name of [...this.scene.objects.keys()])
      if (!view.objects.includes(name)) this.hide(name);
    for (const name of view.objects) await this.show(name);
    if (this.scene.objects.size === 0) {
      const missing = view.objects.filter(
        name => !this.entries.some(entry => entry.object === name),
      );
      if (missing.length === view.objects.length) this.say(''); // the list says it, and stays
      return this.showStart(missing);
    }
    this.setUp(view.up, false);
    this.setExaggeration(view.exaggerate);
    const stretch = this.scene.stretch;
    this.home = view.eye && view.target ? null : {eye: [0, 0, 0], waits: 'mesh'};
    if (view.eye && view.target)
      this.navigation.set(toPage(view.eye, stretch), toPage(view.target, stretch), false);
    else this.navigation.view('home', false);
    const region = view.focus && shapeOf(view.focus.kind, view.focus.numbers, stretch);
    this.scene.focus = view.focus &&
      region && {
        region,
        inside: view.focus.inside,
        outside: view.focus.outside,
        follow: view.focus.follow,
      };
    this.setRegion(region);
    if (view.lines.length > 0 || this.measuring.lines.length > 0) {
      this.measuring.replace(
        view.lines.map(points => ({
          points: points.map(point => ({point, error_bound: this.roundingError()})),
        })),
      );
    }
    if (view.style.colour === '') this.look.style.colour = this.look.usualColour();
    const terrain =
      this.shownInfos().every(isTerrain) &&
      !view.eye &&
      JSON.stringify(view.style) === JSON.stringify(this.defaults.style);
    if (terrain)
      this.look.style = {...this.look.style, colour: 'height', map: 'tints', light: 'northwest'};
    this.look.apply();
    this.scene.restart();
    this.panel.fill();
    this.canvas.focus({preventScroll: true});
    this.images.follow();
  }

  async show(name: string) {
    if (this.scene.objects.has(name)) return;
    let info: ObjectInfo;
    try {
      info = await this.store.info(name);
    } catch (error) {
      const there = this.entries.map(entry => entry.object),
        names = there.slice(0, 5).join(', ') + (there.length > 5 ? ', …' : '');
      const sentence =
        (error as StoreError).code === 'no_such_object'
          ? `There is no object “${name}” here, but ${names || 'none at all'}.`
          : (error as Error).message;
      this.say(sentence, 8000);
      return;
    }
    const others = this.shownInfos();
    if (others.length > 0 && inDegrees(others[0]!) !== inDegrees(info)) {
      this.say(
        `“${name}” is not in the same coordinates as “${others[0]!.object}”: one of them is in degrees. Switch the other off first.`,
        8000,
      );
      return this.panel.fill();
    }
    if (others.length === 0) {
      this.frame = null;
      this.setStretch(stretchOf(info), isTerrain(info) ? this.exaggerate : 1);
      const unit = info.raster?.height_units || info.units || '';
      if (kUnits.includes(unit) && !this.unit) this.unit = unit;
      this.middle = scale(add(info.bounds.min, info.bounds.max), 0.5);
      this.navigation.setUp(this.upOf(info));
    }
    this.frame ??= toPage(this.middle, this.scene.stretch);
    this.scene.show(info, this.frame, this.look.choiceFor(info));
    this.placeAll();
    // They are where they were, in a scene that may have another origin.
    this.measuring.rebuild();
    this.setHandles();
  }

  private setStretch(stretch: Point, exaggerate: number) {
    const drawn: Point = [stretch[0], stretch[1], stretch[2] * exaggerate];
    this.scene.stretch = this.measuring.drawn = drawn;
    this.measuring.stretch = stretch;
    (this.shared.stretch!.value as three.Vector3).set(...drawn);
    this.shared.lean!.value = 1 / exaggerate;
  }

  // Whether all that is shown are terrains, whose heights may be drawn higher.
  terrains() {
    return this.scene.objects.size > 0 && this.shownInfos().every(isTerrain);
  }

  // Camera and region stay where they are on the surface.
  setExaggeration(factor: number) {
    this.exaggerate = factor;
    const before = this.scene.stretch,
      base = this.measuring.stretch,
      drawn = this.terrains() ? factor : 1;
    if (before[2] === base[2] * drawn) return;
    const moved = (p: Point) => toPage(toModel(p, before), this.scene.stretch);
    const eye = this.navigation.eye(),
      target = this.navigation.target(),
      focus = this.scene.focus;
    this.setStretch(base, drawn);
    this.frame = toPage(this.middle, this.scene.stretch);
    for (const {mesh} of this.scene.objects.values()) mesh.place(this.frame, this.scene.stretch);
    this.placeAll();
    this.navigation.set(moved(eye), moved(target), false);
    if (focus) {
      const kind = kindOf(focus.region),
        region = shapeOf(kind, numbersOf(focus.region, before), this.scene.stretch);
      if (region) this.scene.focus = {...focus, region};
    }
    this.setHandles();
    this.measuring.rebuild();
    this.scene.restart();
    this.drawn = '';
  }

  private upOf(info: ObjectInfo): Point {
    return isTerrain(info) ? kZUp : (upAxes[this.upChoice] ?? info.up ?? kZUp);
  }

  // Of the first object, when the user does not say.
  setUp(choice: string, looks: boolean) {
    this.upChoice = choice;
    const [first] = this.shownInfos();
    if (first) this.navigation.setUp(this.upOf(first));
    (this.shared.up!.value as three.Vector3).set(...this.navigation.up);
    this.measuring.rebuild();
    if (looks) this.navigation.view('home', false);
    this.panel.fill();
    ++this.scene.changes;
  }

  // What a view is to have in the picture, once some of it is there.
  private shape(): Float64Array | null {
    const shown = [...this.scene.objects.values()];
    if (
      shown.length === 0 ||
      shown.some(o => o.mesh.vertices === 0) ||
      this.scene.focus?.outside === 'clip'
    )
      return null;
    const parts = shown.map(o => o.mesh.someVertices(30_000 / shown.length));
    const all = new Float64Array(parts.reduce((sum, p) => sum + p.length, 0));
    parts.reduce((at, p) => (all.set(p, at), at + p.length), 0);
    return all;
  }

  // Along up, for colours.
  heights(): [number, number] {
    const {min, max} = this.bounds(),
      {up} = this.navigation;
    const corner = (pick: (a: number, b: number) => number) =>
      up.reduce((sum, x, k) => sum + pick(x * min[k]!, x * max[k]!), 0) /
      (this.terrains() ? this.exaggerate : 1);
    return [corner(Math.min), corner(Math.max)];
  }

  hide(name: string) {
    this.scene.hide(name);
    this.placeAll();
  }

  shownInfos() {
    return [...this.scene.objects.values()].map(o => o.info);
  }

  private placeAll() {
    if (this.scene.objects.size > 0) this.navigation.place(this.frame!, this.bounds());
    this.panel.fill();
    this.images.draping?.reconsider();
  }

  // Of what is shown.
  bounds() {
    const infos = this.shownInfos();
    const extreme = (pick: (...n: number[]) => number, key: 'min' | 'max') =>
      toPage(
        [0, 1, 2].map(k => pick(...infos.map(i => i.bounds[key][k]!))) as Point,
        this.scene.stretch,
      );
    return infos.length > 0
      ? {min: extreme(Math.min, 'min'), max: extreme(Math.max, 'max')}
      : {min: [-1, -1, -1] as Point, max: [1, 1, 1] as Point};
  }

  roundingError() {
    return Math.max(0, ...this.shownInfos().map(i => i.rounding_error));
  }

  // ---- region ----

  setRegion(region: Shape | null, fill = true) {
    this.scene.focus = region
      ? {inside: 'full', outside: 'view', follow: false, ...this.scene.focus, region}
      : null;
    if (this.scene.focus && kindOf(this.scene.focus.region) !== 'wedge') {
      this.scene.focus.follow = false;
      if (this.scene.focus.inside === 'distance') this.scene.focus.inside = 'full';
    }
    if (fill || !region) this.setHandles();
    if (fill) this.panel.fill();
    else this.panel.fillNumbers();
    ++this.scene.changes;
  }

  setHandles() {
    this.handles.set(this.scene.focus?.follow ? null : (this.scene.focus?.region ?? null));
  }

  newRegion(kind: string): Shape | null {
    const {min, max} = this.bounds();
    const size = length(sub(max, min)) * 0.12;
    // Around what the camera turns around, when that is in the scene.
    const target = this.navigation.target();
    const inside = target.every((x, k) => x >= min[k]! && x <= max[k]!);
    return newShape(
      kind,
      inside ? target : scale(add(min, max), 0.5),
      size,
      sub(target, this.navigation.eye()),
    );
  }

  // A wedge that follows is what the camera sees of the ground.
  private followCamera(camera: Camera) {
    const focus = this.scene.focus;
    if (!focus?.follow || !('wedge' in focus.region)) return;
    const forward = sub(camera.target, camera.eye),
      flat = Math.hypot(forward[0], forward[1]);
    if (!(flat > 1e-9)) return;
    const wide =
      2 *
      Math.atan((Math.tan((camera.fov * Math.PI) / 360) * camera.viewport[0]) / camera.viewport[1]);
    const region: Shape = {
      wedge: {
        ...focus.region.wedge,
        apex: camera.eye,
        direction: [forward[0] / flat, forward[1] / flat],
        angle: Math.min(170, (wide * 180) / Math.PI),
      },
    };
    if (JSON.stringify(region) === JSON.stringify(focus.region)) return;
    this.scene.focus = {...focus, region};
    ++this.scene.changes;
  }

  private comeCloser() {
    const {home} = this;
    if (
      !home ||
      !this.shape() ||
      (home.waits === 'answer' && this.scene.exactness().kind === 'loading')
    )
      return;
    if (
      home.waits === 'answer' &&
      length(sub(this.navigation.eye(), home.eye)) > 1e-6 * this.navigation.radius()
    )
      return void (this.home = null);
    this.navigation.view('home', false);
    this.navigation.update(0);
    this.home = home.waits === 'mesh' ? {eye: this.navigation.eye(), waits: 'answer'} : null;
  }

  // ---- the surface under a place ----

  // The nearest hit of what is shown, at full resolution.
  async probe(x: number, y: number, signal?: AbortSignal): Promise<Hit | null> {
    const ray = this.navigation.ray(x, y),
      stretch = this.scene.stretch;
    const origin = toModel(ray.origin, stretch),
      direction = toModel(ray.direction, stretch);
    try {
      const shown = [...this.scene.objects.values()].filter(o => o.state === 'open');
      const hits = await Promise.all(
        shown.map(o => this.store.probe(o.name, origin, direction, signal)),
      );
      let best: Hit | null = null;
      for (const hit of hits)
        if (
          hit &&
          (!best ||
            length(toPage(sub(hit.point, origin), stretch)) <
              length(toPage(sub(best.point, origin), stretch)))
        )
          best = hit;
      return best;
    } catch (error) {
      if ((error as Error).name !== 'AbortError' && (error as StoreError).code !== 'unreachable')
        this.say((error as Error).message, 5000);
      return null;
    }
  }

  // A length.
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
    if (milliseconds > 0)
      setTimeout(() => banner.textContent === sentence && (banner.hidden = true), milliseconds);
  }

  // ---- the view as a link ----

  view(): ViewState {
    const focus = this.scene.focus,
      stretch = this.scene.stretch;
    return {
      objects: [...this.scene.objects.keys()],
      eye: toModel(this.navigation.eye(), stretch),
      target: toModel(this.navigation.target(), stretch),
      pixels: this.scene.pixels,
      triangles: this.scene.budget,
      style: this.look.style,
      focus: focus && {
        kind: kindOf(focus.region),
        numbers: numbersOf(focus.region, stretch),
        inside: focus.inside,
        outside: focus.outside,
        follow: focus.follow,
      },
      unit: this.unit,
      up: this.upChoice,
      exaggerate: this.exaggerate,
      lines: this.measuring.lines.map(line => line.points.map(p => p.point)),
    };
  }

  saveView() {
    if (this.scene.objects.size === 0) return;
    const hash = writeView(this.view(), {
      ...this.defaults,
      style: {...plainStyle, colour: this.look.usualColour()},
    });
    if (hash === this.savedHash) return;
    this.savedHash = hash;
    history.replaceState(null, '', hash);
  }

  // ---- drawing ----

  // Of an image over the surface. The bitmap is kept: a card that was reset gets it again.
  textureOf(bitmap: ImageBitmap) {
    const texture = new three.Texture(bitmap as unknown as HTMLImageElement);
    texture.flipY = false;
    texture.minFilter = three.LinearMipmapLinearFilter;
    texture.anisotropy = Math.min(8, this.renderer.capabilities.getMaxAnisotropy());
    texture.needsUpdate = true;
    return texture;
  }

  // What textures need of the renderer (texturing.ts).
  readonly drawing = {
    texture: () => new three.Texture(),
    table: tableTexture,
    target: (width: number, height: number) => new three.WebGLRenderTarget(width, height),
    ask: (
      target: three.WebGLRenderTarget,
      shrink: number,
      x: number,
      y: number,
      read: () => void,
    ) => {
      const {renderer, shared} = this,
        {camera} = this.navigation,
        w = shrink * target.width,
        h = shrink * target.height;
      const others = [this.handles.root, this.measuring.root],
        visible = others.map(o => o.visible);
      const clear = renderer.getClearColor(new three.Color()).clone(),
        alpha = renderer.getClearAlpha();
      others.forEach(o => (o.visible = false));
      shared.asks!.value = true;
      camera.setViewOffset(w, h, x, y, w, h);
      renderer.setRenderTarget(target);
      renderer.setClearColor(0, 0);
      renderer.render(this.world, camera);
      read();
      renderer.setRenderTarget(null);
      renderer.setClearColor(clear, alpha);
      camera.clearViewOffset();
      shared.asks!.value = false;
      others.forEach((o, i) => (o.visible = visible[i]!));
    },
  };

  resize() {
    const w = this.canvas.clientWidth,
      h = this.canvas.clientHeight;
    if (w === 0 || h === 0) return;
    this.renderer.setSize(w, h, false);
    this.navigation.camera.aspect = w / h;
    this.navigation.camera.updateProjectionMatrix();
    this.draw(); // before the browser shows the empty one
    this.drawn = '';
  }

  viewport(): [number, number] {
    return this.taking.pictureViewport ?? [this.canvas.width, this.canvas.height];
  }

  draw() {
    const light = this.shared.light!.value as three.Vector3;
    if (this.look.style.light === 'camera') light.set(-0.35, 0.5, 0.8).normalize();
    else
      light
        .set(...this.navigation.direction([-1, 1, 1.4]))
        .normalize()
        .transformDirection(this.navigation.camera.matrixWorldInverse);
    this.look.mark();
    const range = this.look.mapRange(),
      heights = this.shared.colourBy!.value === 3;
    // The shader's heights are drawn ones, above the scene's origin.
    const shift = heights ? dot(this.frame ?? [0, 0, 0], this.navigation.up) : 0,
      drawn = heights && this.terrains() ? this.exaggerate : 1;
    if (range)
      (this.shared.range!.value as three.Vector2).set(
        range[0] * drawn - shift,
        range[1] * drawn - shift,
      );
    this.handles.update();
    this.renderer.render(this.world, this.navigation.camera);
  }

  private tick(now: number) {
    requestAnimationFrame(next => this.tick(next));
    if (this.taking.pictureViewport) {
      if (this.scene.objects.size > 0)
        this.scene.follow(this.navigation.query(this.viewport()), now);
      this.textures.frame(now, false);
      return;
    }
    const seconds = Math.min(0.1, (now - this.lastFrame) / 1000);
    this.lastFrame = now;
    this.navigation.update(seconds);
    this.comeCloser();
    if (this.scene.objects.size > 0) {
      const camera = this.navigation.query(this.viewport());
      this.followCamera(camera);
      this.scene.follow(camera, now);
    }
    const state = JSON.stringify([
      this.scene.changes,
      this.navigation.camera.position,
      this.navigation.camera.quaternion,
      this.canvas.width,
      this.handles.dragging,
      this.look.style,
    ]);
    const moved = state !== this.drawn,
      changed = this.textures.frame(now, moved);
    if (moved || changed) {
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
  const context = canvas.getContext('webgl2', {
    antialias: true,
    powerPreference: 'high-performance',
  });
  if (!context) {
    const banner = byId('banner');
    banner.hidden = false;
    banner.textContent =
      'This browser has no WebGL 2, which drawing needs; another browser may have it, or its settings may allow it.';
    return;
  }
  const source = sourceOf(location.search, new URL(location.href));
  if (source instanceof StoreError) {
    const banner = byId('banner');
    banner.hidden = false;
    banner.textContent = source.message;
    return;
  }
  const viewer = new Viewer(
    context,
    source ? new PackedStore(source) : new ServerStore(new URL('.', location.href)),
  );
  (window as unknown as {viewer: Viewer}).viewer = viewer;
  void viewer.begin();
}
begin();
