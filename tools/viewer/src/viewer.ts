// SPDX-License-Identifier: Apache-2.0
// The page: puts store, scene, camera and panel together.
import * as three from 'three';
import {colourMaps, colourTable} from './colour_maps';
import {FocusHandles, kindOf, numbersOf, regionFor, regionOf} from './focus_handles';
import {lengthError, lineLength, Measuring, rise} from './measuring';
import {Navigation} from './navigation';
import {add, length, scale, sub, unitsPerPixel, type Point, type Region} from './query';
import {Scene} from './scene';
import {ServerStore} from './server_store';
import {sharedUniforms} from './shaders';
import {StoreError, type Hit, type ObjectEntry, type ObjectInfo, type Store, type ValueChoice} from './source';
import {plainStyle, readView, writeView, type Style, type ViewState} from './view_state';

const byId = <T extends HTMLElement = HTMLElement>(id: string) => document.getElementById(id) as T;
const select = (id: string) => byId<HTMLSelectElement>(id);
const input = (id: string) => byId<HTMLInputElement>(id);

const kSurface = '#b9b2a6', kBack = '#9a6a4f';

// A few figures, as people write them.
export function figure(x: number, digits = 3): string {
  if (x === 0 || !Number.isFinite(x)) return String(x);
  const a = Math.abs(x);
  if (a >= 1e6 || a < 1e-4) return x.toExponential(digits - 1);
  return String(Number(x.toPrecision(Math.max(digits, Math.ceil(Math.log10(a) + 1e-9)))));
}
const whole = (x: number) => Math.round(x).toLocaleString('en');

class Viewer {
  readonly store: Store = new ServerStore(new URL('.', location.href));
  readonly canvas = byId<HTMLCanvasElement>('canvas');
  readonly renderer: three.WebGLRenderer;
  readonly world = new three.Scene();
  readonly shared = sharedUniforms();
  readonly navigation: Navigation;
  readonly scene: Scene;
  readonly handles: FocusHandles;
  readonly measuring: Measuring;
  private entries: ObjectEntry[] = [];
  private readonly infos = new Map<string, ObjectInfo>();
  private frame: Point | null = null;
  private style: Style = {...plainStyle};
  private unit = '';
  private defaults: ViewState;
  private drawn = '';
  private lastFrame = 0;
  private readonly frames: number[] = [];
  private drawMilliseconds = 0;
  private panelDirty = true;
  private savedHash = '';
  private measureOn = false;

  constructor(context: WebGL2RenderingContext) {
    this.renderer = new three.WebGLRenderer({canvas: this.canvas, context, antialias: true});
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.scene = new Scene(this.store, this.shared, () => (this.panelDirty = true));
    this.scene.budget = matchMedia('(max-width: 700px)').matches ? 200_000 : 600_000;
    this.defaults = {objects: [], eye: null, target: null, pixels: 1, triangles: this.scene.budget, style: plainStyle, focus: null, unit: '', lines: []};
    this.navigation = new Navigation(this.canvas, async (x, y) => (await this.probe(x, y))?.point ?? null);
    this.handles = new FocusHandles(this.canvas, this.navigation, region => this.setRegion(region, false));
    this.measuring = new Measuring(byId('labels'), this.navigation, units => this.text(units), () => this.showMeasured());
    this.world.add(this.scene.root, this.handles.root, this.measuring.root);
    this.handles.set(null);
    this.bindPanel();
    this.bindCanvas();
    this.bindKeys();
    addEventListener('resize', () => this.resize());
    addEventListener('hashchange', () => void this.load(readView(location.hash, this.defaults)));
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.setTheme());
    this.setTheme();
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
    this.style = {...view.style};
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
    this.applyStyle();
    this.scene.restart();
    this.fillPanel();
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
    this.scene.show(info, this.frame, this.choiceFor(info));
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

  private shownInfos() {
    return [...this.scene.objects.values()].map(o => o.info);
  }

  private placeAll() {
    const infos = this.shownInfos();
    if (infos.length > 0) {
      const extreme = (pick: (...n: number[]) => number, key: 'min' | 'max') => [0, 1, 2].map(k => pick(...infos.map(i => i.bounds[key][k]!))) as Point;
      this.navigation.place(this.frame!, {min: extreme(Math.min, 'min'), max: extreme(Math.max, 'max')});
    }
    this.fillPanel();
  }

  private bounds() {
    const infos = this.shownInfos();
    const extreme = (pick: (...n: number[]) => number, key: 'min' | 'max') => [0, 1, 2].map(k => pick(...infos.map(i => i.bounds[key][k]!))) as Point;
    return infos.length > 0 ? {min: extreme(Math.min, 'min'), max: extreme(Math.max, 'max')} : {min: [-1, -1, -1] as Point, max: [1, 1, 1] as Point};
  }

  private roundingError() {
    return Math.max(0, ...this.shownInfos().map(i => i.rounding_error));
  }

  // ---- style ----

  private attributesOf(info: ObjectInfo) {
    const at = (name: string) => info.attributes.findIndex(a => a.name === name);
    const colour = [at('red'), at('green'), at('blue')];
    return {colour: colour.every(i => i >= 0) ? (colour as [number, number, number]) : null, at};
  }

  private choiceFor(info: ObjectInfo): ValueChoice {
    const {colour, at} = this.attributesOf(info);
    if (this.style.colour === 'vertex' && colour) return {kind: 'colour', attributes: colour};
    if (this.style.colour.startsWith('a:') && at(this.style.colour.slice(2)) >= 0) return {kind: 'scalar', attribute: at(this.style.colour.slice(2))};
    return {kind: 'none'};
  }

  private applyStyle() {
    const u = this.shared;
    for (const object of this.scene.objects.values()) object.source.choose(this.choiceFor(object.info));
    const kinds: Record<string, number> = {plain: 0, vertex: 1, height: 3, steepness: 4};
    u.colourBy!.value = this.style.colour.startsWith('a:') ? 2 : (kinds[this.style.colour] ?? 0);
    u.flatShading!.value = this.style.shading === 'flat';
    u.showBack!.value = this.style.back;
    (u.surface!.value as three.Color).setStyle(kSurface, three.LinearSRGBColorSpace);
    (u.back!.value as three.Color).setStyle(kBack, three.LinearSRGBColorSpace);
    const map = u.map!.value as three.DataTexture;
    (map.image.data as Uint8Array).set(colourTable(this.style.map));
    map.needsUpdate = true;
    this.scene.setWireframe(this.style.wireframe);
    this.panelDirty = true;
  }

  // What the colour map spans.
  private mapRange(): [number, number] | null {
    const kind = this.shared.colourBy!.value;
    if (kind === 3) return [this.bounds().min[2], this.bounds().max[2]];
    if (kind === 4) return [0, 90];
    if (kind !== 2) return null;
    let range: [number, number] | null = null;
    for (const {mesh} of this.scene.objects.values()) {
      if (mesh.valueRange) range = range ? [Math.min(range[0], mesh.valueRange[0]), Math.max(range[1], mesh.valueRange[1])] : [...mesh.valueRange];
    }
    return range;
  }

  private setTheme() {
    const chosen = select('theme').value || (matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light');
    document.documentElement.dataset.theme = chosen;
    this.renderer.setClearColor(chosen === 'dark' ? 0x12171c : 0xe9edf1);
    (this.shared.edge!.value as three.Color).setStyle(chosen === 'dark' ? '#0b2135' : '#10283f', three.LinearSRGBColorSpace);
    this.drawn = '';
  }

  // ---- region ----

  setRegion(region: Region | null, fill = true) {
    this.scene.focus = region ? {inside: 'full', outside: 'view', ...this.scene.focus, region} : null;
    if (fill || !region) this.handles.set(region);
    this.applyClip();
    if (fill) this.fillPanel();
    else this.fillNumbers();
    ++this.scene.changes;
  }

  private applyClip() {
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

  private newRegion(kind: string): Region | null {
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

  async goTo(x: number, y: number) {
    const hit = await this.probe(x, y);
    if (hit) this.navigation.goTo(hit.point);
  }

  private async addPoint(x: number, y: number) {
    const hit = await this.probe(x, y);
    if (hit) this.measuring.addPoint(hit);
    else this.say('There is no surface at this place.', 2500);
  }

  // A number of model units.
  text(units: number) {
    return figure(units, 4) + (this.unit ? ' ' + this.unit : '');
  }

  // A coordinate, with all digits that mean something.
  private coordinate(x: number) {
    const step = Math.max(this.roundingError(), this.navigation.radius() * 1e-7);
    return x.toFixed(Math.max(0, Math.min(12, Math.ceil(-Math.log10(step)))));
  }

  private bindCanvas() {
    let down: {x: number; y: number; time: number} | null = null, lastTap: {x: number; y: number; time: number} | null = null;
    this.canvas.addEventListener('pointerdown', event => {
      down = event.button === 0 && event.isPrimary ? {x: event.clientX, y: event.clientY, time: event.timeStamp} : null;
      this.canvas.focus({preventScroll: true});
    });
    this.canvas.addEventListener('pointerup', event => {
      if (!down || Math.hypot(event.clientX - down.x, event.clientY - down.y) > (event.pointerType === 'mouse' ? 4 : 12)) {
        lastTap = null;
        return;
      }
      const box = this.canvas.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
      if (this.measureOn) return void this.addPoint(x, y);
      const twice = lastTap && event.timeStamp - lastTap.time < 450 && Math.hypot(lastTap.x - x, lastTap.y - y) < 24;
      lastTap = twice ? null : {x, y, time: event.timeStamp};
      if (twice) void this.goTo(x, y);
    });
    // What is under the cursor, when it rests.
    let timer = 0, asked: AbortController | null = null;
    const forget = () => {
      clearTimeout(timer);
      asked?.abort();
      asked = null;
    };
    this.canvas.addEventListener('pointermove', event => {
      forget();
      if (event.buttons !== 0 || event.pointerType === 'touch') return;
      const box = this.canvas.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
      timer = window.setTimeout(async () => {
        asked = new AbortController();
        const hit = await this.probe(x, y, asked.signal);
        byId('where').textContent = hit ? hit.point.map(c => this.coordinate(c)).join('  ') : '';
      }, 60);
    });
    this.canvas.addEventListener('pointerleave', () => {
      forget();
      byId('where').textContent = '';
    });
    this.canvas.addEventListener('webglcontextlost', event => {
      event.preventDefault();
      this.say('The graphics card has no more memory for the scene, or was reset; waiting for it…');
    });
    this.canvas.addEventListener('webglcontextrestored', () => {
      this.drawn = '';
      this.say('');
    });
  }

  // ---- keys ----

  private setMeasuring(on: boolean) {
    this.measureOn = on;
    byId('measure').setAttribute('aria-pressed', String(on));
    this.canvas.classList.toggle('pick', on);
    byId('crosshair').hidden = !on;
    if (on) (byId('section-measure') as HTMLDetailsElement).open = true;
    else this.measuring.endLine();
  }

  private setFlying(on: boolean) {
    this.navigation.fly(on);
    byId('fly').setAttribute('aria-pressed', String(on));
  }

  private setPanel(open: boolean) {
    document.body.classList.toggle('closed', !open);
    byId('toggle').setAttribute('aria-expanded', String(open));
  }

  private bindKeys() {
    const views: Record<string, string> = {h: 'home', '1': 'top', '2': 'front', '3': 'right', '4': 'back', '5': 'left', '6': 'bottom'};
    const centre = (): [number, number] => [this.canvas.clientWidth / 2, this.canvas.clientHeight / 2];
    addEventListener('keydown', event => {
      const at = event.target as HTMLElement;
      const pressed = (event.key === 'Enter' || event.key === ' ') && at.closest?.('button, summary');
      if (at.closest?.('input, select, textarea') || pressed || event.ctrlKey || event.metaKey || event.altKey) {
        if (event.key === 'Escape') this.canvas.focus();
        return;
      }
      const key = event.key.toLowerCase();
      if (views[key]) this.navigation.view(views[key]!);
      else if (key === 'f') this.setFlying(!this.navigation.flying);
      else if (key === 'm') this.setMeasuring(!this.measureOn);
      else if (key === 'enter' && this.measureOn) void this.addPoint(...centre());
      else if (key === ' ') void this.goTo(...centre());
      else if (key === 'n') this.measuring.endLine();
      else if (key === 'backspace') this.measuring.undo();
      else if (key === 'w' && !this.navigation.flying) this.restyle({wireframe: !this.style.wireframe});
      else if (key === 'l') this.restyle({shading: this.style.shading === 'flat' ? 'smooth' : 'flat'});
      else if (key === 'b') this.setRegion(this.scene.focus ? null : this.newRegion('box'));
      else if (key === 'p') void this.takePicture();
      else if (key === 't') this.setPanel(document.body.classList.contains('closed'));
      else if (key === '?') {
        this.setPanel(true);
        (byId('section-keys') as HTMLDetailsElement).open = true;
        byId('section-keys').scrollIntoView();
      } else if (key === 'escape') {
        this.setMeasuring(false);
        this.setFlying(false);
      } else return;
      event.preventDefault();
    });
  }

  // ---- the panel ----

  restyle(change: Partial<Style>) {
    this.style = {...this.style, ...change};
    this.applyStyle();
    this.fillPanel();
  }

  private bindPanel() {
    const on = (id: string, event: string, act: () => void) => byId(id).addEventListener(event, act);
    this.setPanel(innerWidth > 700);
    on('toggle', 'click', () => this.setPanel(document.body.classList.contains('closed')));
    for (const button of document.querySelectorAll<HTMLElement>('[data-view]')) button.onclick = () => this.navigation.view(button.dataset.view!);
    on('fly', 'click', () => this.setFlying(!this.navigation.flying));
    on('measure', 'click', () => this.setMeasuring(!this.measureOn));
    on('shading', 'change', () => this.restyle({shading: select('shading').value as Style['shading']}));
    on('wireframe', 'change', () => this.restyle({wireframe: input('wireframe').checked}));
    on('colour', 'change', () => this.restyle({colour: select('colour').value, ...(select('colour').value === 'height' && this.style.map === 'viridis' ? {map: 'tints'} : {})}));
    on('map', 'change', () => this.restyle({map: select('map').value}));
    on('light', 'change', () => this.restyle({light: select('light').value as Style['light']}));
    on('back', 'change', () => this.restyle({back: input('back').checked}));
    on('unit', 'change', () => {
      this.unit = select('unit').value;
      this.measuring.rebuild();
      this.fillPanel();
    });
    on('theme', 'change', () => this.setTheme());
    on('pixels', 'input', () => {
      this.scene.pixels = 2 ** Number(input('pixels').value);
      this.scene.restart();
      this.fillPanel();
    });
    on('triangles', 'input', () => {
      this.scene.budget = Math.round(10 ** (Number(input('triangles').value) / 10));
      this.scene.restart();
      this.fillPanel();
    });
    on('region', 'change', () => {
      this.scene.focus = this.scene.focus && {...this.scene.focus};
      this.setRegion(select('region').value ? this.newRegion(select('region').value) : null);
    });
    const refocus = () => {
      if (!this.scene.focus) return;
      const inside = select('inside').value, error = Number(input('inside-error').value);
      const usable = error > 0 && Number.isFinite(error) ? error : this.suggestedError();
      this.scene.focus = {...this.scene.focus, inside: inside === 'error' ? usable : (inside as 'full' | 'view'), outside: select('outside').value as 'view' | 'coarse' | 'clip'};
      this.applyClip();
      this.scene.restart();
      this.fillPanel();
    };
    for (const id of ['inside', 'inside-error', 'outside']) on(id, 'change', refocus);
    on('line-end', 'click', () => this.measuring.endLine());
    on('line-undo', 'click', () => this.measuring.undo());
    on('line-clear', 'click', () => this.measuring.clear());
    on('csv', 'click', () => this.download(new Blob([this.measuring.csv()], {type: 'text/csv'}), 'measured.csv'));
    on('geojson', 'click', () => this.download(new Blob([this.measuring.geoJson()], {type: 'application/geo+json'}), 'measured.geojson'));
    on('take', 'click', () => void this.takeMesh());
    on('picture', 'click', () => void this.takePicture());
    on('link', 'click', () => void this.copyLink());
    select('map').replaceChildren(...Object.keys(colourMaps).map(name => new Option(name, name)));
  }

  private fillPanel() {
    const names = [...this.scene.objects.keys()];
    byId('title').textContent = names.join(', ');
    document.title = names.length > 0 ? `${names.join(', ')} · mtdb` : 'mtdb';
    byId('objects').replaceChildren(...this.entries.map(entry => {
      const label = document.createElement('label'), box = document.createElement('input'), text = document.createElement('span'), size = document.createElement('small');
      box.type = 'checkbox';
      box.checked = this.scene.objects.has(entry.object);
      box.onchange = async () => {
        const first = this.scene.objects.size === 0;
        if (box.checked) await this.show(entry.object);
        else this.hide(entry.object);
        if (first && box.checked) this.navigation.view('home', false);
        this.applyStyle();
      };
      text.className = 'name';
      text.textContent = entry.object;
      size.textContent = whole(entry.triangles);
      label.append(box, text, size);
      return label;
    }));
    const style = this.style;
    const infos = this.shownInfos();
    const attributes = [...new Set(infos.flatMap(i => i.attributes.map(a => a.name)))].filter(name => !['red', 'green', 'blue', 'alpha', 'nx', 'ny', 'nz'].includes(name));
    const colours = [['plain', 'one colour'], ...(infos.some(i => this.attributesOf(i).colour) ? [['vertex', 'colours of the vertices']] : []), ['height', 'height'], ['steepness', 'steepness'],
      ...attributes.map(name => [`a:${name}`, name])];
    if (!colours.some(([value]) => value === style.colour)) style.colour = 'plain';
    select('colour').replaceChildren(...colours.map(([value, text]) => new Option(text!, value!)));
    select('colour').value = style.colour;
    if (!colourMaps[style.map]) style.map = 'viridis';
    select('map').value = style.map;
    byId('map-row').hidden = style.colour === 'plain' || style.colour === 'vertex';
    select('shading').value = style.shading;
    input('wireframe').checked = style.wireframe;
    select('light').value = style.light;
    input('back').checked = style.back;
    select('unit').value = this.unit;
    input('pixels').value = String(Math.log2(this.scene.pixels));
    byId('pixels-text').textContent = `${figure(this.scene.pixels, 2)} pixel${this.scene.pixels === 1 ? '' : 's'}`;
    input('triangles').value = String(10 * Math.log10(this.scene.budget));
    byId('triangles-text').textContent = `${whole(this.scene.budget)} triangles`;
    const focus = this.scene.focus;
    select('region').value = focus ? kindOf(focus.region) : '';
    byId('region-more').hidden = !focus;
    if (focus) {
      (byId('section-region') as HTMLDetailsElement).open = true;
      select('inside').value = typeof focus.inside === 'number' ? 'error' : focus.inside;
      byId('inside-row').hidden = typeof focus.inside !== 'number';
      if (typeof focus.inside === 'number') input('inside-error').value = figure(focus.inside, 3);
      select('outside').value = focus.outside;
      this.fillNumbers();
    }
    if (input('take-error').value === '' && infos.length > 0) input('take-error').value = figure(this.suggestedError(), 2);
    byId('take-what').textContent = `${names.length > 1 ? 'Each object' : 'The object'}: ${focus ? 'what meets the region' : 'all of it'}. Model units${this.unit ? ` (${this.unit})` : ''}.`;
    this.panelDirty = true;
  }

  private fillNumbers() {
    const focus = this.scene.focus;
    if (!focus) return;
    const kind = kindOf(focus.region), numbers = numbersOf(focus.region), root = byId('region-numbers');
    const titles: Record<string, string[]> = {box: ['x from', 'y from', 'z from', 'x to', 'y to', 'z to'], sphere: ['x', 'y', 'z', 'radius'], half_space: ['x', 'y', 'z', 'normal x', 'normal y', 'normal z']};
    if (root.dataset.kind !== kind) {
      root.dataset.kind = kind;
      root.replaceChildren(...titles[kind]!.map(title => {
        const label = document.createElement('label'), box = document.createElement('input');
        label.textContent = title;
        box.type = 'number';
        box.step = 'any';
        box.onchange = () => {
          const region = regionOf(kind, [...root.querySelectorAll('input')].map(i => Number(i.value)));
          if (region) this.setRegion(region);
          else this.fillNumbers();
        };
        label.append(box);
        return label;
      }));
    }
    root.querySelectorAll('input').forEach((box, i) => (box.value = this.coordinate(numbers[i]!)));
  }

  // A thousandth of the diagonal.
  private suggestedError() {
    return 1e-3 * Math.max(...this.shownInfos().map(i => i.diagonal), 0) || 1;
  }

  private showMeasured() {
    const lines = this.measuring.lines.filter(line => line.points.length > 0);
    byId('measured').replaceChildren(...lines.map((line, i) => {
      const row = document.createElement('p');
      row.className = 'hint';
      row.textContent = line.points.length === 1
        ? `${i + 1}: ${line.points[0]!.point.map(c => this.coordinate(c)).join('  ')}`
        : `${i + 1}: ${this.text(lineLength(line))} over ${line.points.length} points, ± ${this.text(lengthError(line))}; height ${rise(line) >= 0 ? '+' : '−'}${this.text(Math.abs(rise(line)))}`;
      return row;
    }));
    if (lines.length === 0) byId('measured').textContent = 'Nothing yet: “Measure”, then click points of the surface.';
    this.drawn = '';
  }

  say(sentence: string, milliseconds = 0) {
    const banner = byId('banner');
    banner.textContent = sentence;
    banner.hidden = sentence === '';
    if (milliseconds > 0) setTimeout(() => banner.textContent === sentence && (banner.hidden = true), milliseconds);
  }

  // ---- taking away ----

  private download(blob: Blob, name: string) {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(blob);
    link.download = name.replace(/[\/\\:*?"<>|\u0000-\u001f]/g, '_');
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
  }

  private async takeMesh() {
    const error = Number(input('take-error').value), format = select('format').value, said = byId('take-said');
    if (!(error >= 0) || !Number.isFinite(error) || input('take-error').value === '') {
      said.textContent = 'The error is to be a number that is not negative.';
      return;
    }
    const focus = this.scene.focus;
    for (const name of this.scene.objects.keys()) {
      said.textContent = `${name}: the server cuts…`;
      try {
        const mesh = await this.store.mesh(name, {threshold: error === 0 ? 'full' : error, ...(focus ? {region: focus.region, clip: true} : {})}, format);
        this.download(mesh.blob, `${name}.${format}`);
        said.textContent = `${name}: ${whole(mesh.triangles)} triangles, off by at most ${this.text(mesh.errorBound)}, ${figure(mesh.blob.size / 1e6)} MB.`;
      } catch (failure) {
        said.textContent = `${name}: ${(failure as Error).message}`;
      }
    }
  }

  async takePicture() {
    const choice = select('picture-size').value, said = byId('take-said');
    const ratio = this.renderer.getPixelRatio(), w = this.canvas.clientWidth, h = this.canvas.clientHeight;
    const size: [number, number] = choice.includes('x') ? (choice.split('x').map(Number) as [number, number]) : [w * ratio * Number(choice), h * ratio * Number(choice)];
    const most = this.renderer.capabilities.maxTextureSize;
    if (size.some(n => n > most)) {
      said.textContent = `This graphics card draws at most ${most} pixels a side.`;
      return;
    }
    said.textContent = 'The picture is made as exact as the view…';
    this.pictureViewport = [Math.round(size[0]), Math.round(size[1])];
    try {
      await this.whenExact();
      this.renderer.setPixelRatio(1);
      this.renderer.setSize(size[0], size[1], false);
      this.navigation.camera.aspect = size[0] / size[1];
      this.navigation.camera.updateProjectionMatrix();
      this.draw();
      const blob = await new Promise<Blob | null>(done => this.canvas.toBlob(done, 'image/png'));
      if (!blob) throw new Error('The picture does not fit the memory of this page.');
      this.download(blob, `${[...this.scene.objects.keys()].join(' ') || 'mtdb'}.png`);
      said.textContent = `A picture of ${Math.round(size[0])} × ${Math.round(size[1])} pixels.`;
    } catch (error) {
      said.textContent = (error as Error).message;
    } finally {
      this.pictureViewport = null;
      this.renderer.setPixelRatio(ratio);
      this.resize();
    }
  }
  private pictureViewport: [number, number] | null = null;

  // Resolves when what is shown is the answer to what is asked, or cannot become so.
  private whenExact(): Promise<void> {
    return new Promise(done => {
      const begin = performance.now();
      const look = () => {
        const kind = this.scene.exactness().kind;
        if ((performance.now() - begin > 300 && kind !== 'loading') || performance.now() - begin > 30_000) done();
        else setTimeout(look, 50);
      };
      look();
    });
  }

  private async copyLink() {
    this.saveView();
    try {
      await navigator.clipboard.writeText(location.href);
      byId('take-said').textContent = 'The link is in the clipboard.';
    } catch {
      byId('take-said').textContent = 'This page may not write to the clipboard; the link is in the address bar.';
    }
  }

  // ---- the view as a link ----

  view(): ViewState {
    return {objects: [...this.scene.objects.keys()], eye: this.navigation.eye(), target: this.navigation.target(), pixels: this.scene.pixels, triangles: this.scene.budget,
      style: this.style, focus: this.scene.focus, unit: this.unit, lines: this.measuring.lines.map(line => line.points.map(p => p.point))};
  }

  private saveView() {
    if (this.scene.objects.size === 0) return;
    const hash = writeView(this.view(), this.defaults);
    if (hash === this.savedHash) return;
    this.savedHash = hash;
    history.replaceState(null, '', hash);
  }

  // ---- drawing ----

  private resize() {
    const w = this.canvas.clientWidth, h = this.canvas.clientHeight;
    if (w === 0 || h === 0) return;
    this.renderer.setSize(w, h, false);
    this.navigation.camera.aspect = w / h;
    this.navigation.camera.updateProjectionMatrix();
    this.drawn = '';
  }

  private viewport(): [number, number] {
    return this.pictureViewport ?? [this.canvas.width, this.canvas.height];
  }

  private draw() {
    const light = this.shared.light!.value as three.Vector3;
    if (this.style.light === 'camera') light.set(-0.35, 0.5, 0.8).normalize();
    else light.set(-1, 1, 1.4).normalize().transformDirection(this.navigation.camera.matrixWorldInverse);
    const range = this.mapRange(), shift = this.shared.colourBy!.value === 3 ? (this.frame?.[2] ?? 0) : 0;
    if (range) (this.shared.range!.value as three.Vector2).set(range[0] - shift, range[1] - shift);
    this.handles.update();
    this.renderer.render(this.world, this.navigation.camera);
  }

  private tick(now: number) {
    requestAnimationFrame(next => this.tick(next));
    if (this.pictureViewport) {
      if (this.scene.objects.size > 0) this.scene.follow(this.navigation.query(this.viewport()), now);
      return;
    }
    const seconds = Math.min(0.1, (now - this.lastFrame) / 1000);
    this.lastFrame = now;
    this.navigation.update(seconds);
    if (this.scene.objects.size > 0) this.scene.follow(this.navigation.query(this.viewport()), now);
    const state = JSON.stringify([this.scene.changes, this.navigation.camera.position, this.navigation.camera.quaternion, this.canvas.width, this.handles.dragging, this.style]);
    if (state !== this.drawn) {
      this.drawn = state;
      const begin = performance.now();
      this.draw();
      this.drawMilliseconds = performance.now() - begin;
      this.measuring.update(this.canvas.clientWidth, this.canvas.clientHeight);
      this.showAxes();
      this.panelDirty = true;
      this.frames.push(now);
    }
    while (this.frames.length > 0 && this.frames[0]! < now - 1000) this.frames.shift();
    if (this.panelDirty && now - this.lastStatus > 100) {
      this.lastStatus = now;
      this.panelDirty = false;
      this.showStatus();
      if (!this.scene.moving && !this.handles.dragging) this.saveView();
    }
  }
  private lastStatus = 0;

  private showAxes() {
    const to = new three.Vector3();
    for (const [k, axis] of ['x', 'y', 'z'].entries()) {
      to.set(k === 0 ? 1 : 0, k === 1 ? 1 : 0, k === 2 ? 1 : 0).transformDirection(this.navigation.camera.matrixWorldInverse);
      const line = document.getElementById(`axis-${axis}`)!, text = document.getElementById(`text-${axis}`)!;
      line.setAttribute('x2', String(19 * to.x));
      line.setAttribute('y2', String(-19 * to.y));
      text.setAttribute('x', String(25 * to.x));
      text.setAttribute('y', String(-25 * to.y));
    }
  }

  private showStatus() {
    const exact = this.scene.exactness(), camera = this.navigation.query(this.viewport());
    const pixel = unitsPerPixel(camera, this.navigation.depth());
    const objects = [...this.scene.objects.values()];
    const lost = objects.find(o => o.state === 'lost') ?? objects.find(o => o.state === 'gone');
    if (lost) this.say(lost.sentence);
    else if (this.saidLost) this.say('');
    this.saidLost = lost !== undefined;
    const failure = objects.map(o => o.failure).find(text => text !== '') ?? '';
    const promise = `${figure(exact.pixels, 2)} px = ${this.text(pixel * exact.pixels)}`;
    const byRegion = this.scene.focus && this.scene.focus.outside !== 'view';
    const budget = exact.limited ? `; the budget of ${whole(this.scene.budget)} triangles allows no less` : '';
    byId('exactness').textContent = failure ? failure
      : exact.kind === 'nothing' ? ''
      : exact.kind === 'loading' ? `${whole(this.scene.total(o => o.mesh.triangles))} triangles, refining…`
      : exact.kind === 'short' ? `off by at most ${this.text(exact.bound)}${budget || ': nothing better is stored'}`
      : byRegion ? `in the region exact to ${this.text(exact.bound)}`
      : `exact to ${promise}${budget}`;
    byId('exactness').dataset.kind = exact.kind;
    this.showScale(camera.viewport[1] / this.canvas.clientHeight * pixel);
    this.showLegend();
    const rows: [string, string][] = [
      ['triangles', whole(this.scene.total(o => o.mesh.triangles))], ['vertices', whole(this.scene.total(o => o.mesh.vertices))],
      ['of the whole', whole(this.scene.total(o => o.info.triangles))], ['error bound', this.text(exact.bound)],
      ['received', `${figure(this.scene.total(o => o.source.traffic.bytes) / 1e6)} MB`],
      ['last answer', `${whole(Math.max(0, ...objects.map(o => o.done?.bytes ?? 0)))} bytes`],
      ['cut (server)', `${figure(Math.max(0, ...objects.map(o => o.done?.milliseconds ?? 0)), 2)} ms`],
      ['decode (worker)', `${figure(Math.max(0, ...objects.map(o => o.source.traffic.applyMilliseconds)), 2)} ms`],
      ['draw', `${figure(this.drawMilliseconds, 2)} ms`], ['frames in the last second', String(this.frames.length)],
    ];
    byId('figures').replaceChildren(...rows.flatMap(([name, value]) => {
      const dt = document.createElement('dt'), dd = document.createElement('dd');
      dt.textContent = name;
      dd.textContent = value;
      return [dt, dd];
    }));
  }
  private saidLost = false;

  // `pixel`: model units of a CSS pixel.
  private showScale(pixel: number) {
    const most = pixel * 120, power = 10 ** Math.floor(Math.log10(most));
    const size = [5, 2, 1].map(f => f * power).find(s => s <= most) ?? power;
    byId('scale-text').textContent = this.text(size);
    byId('scale-bar').style.width = `${size / pixel}px`;
    byId('scale').hidden = this.scene.objects.size === 0 || !Number.isFinite(size);
  }

  private showLegend() {
    const range = this.mapRange();
    byId('legend').hidden = !range;
    if (!range) return;
    const context = byId<HTMLCanvasElement>('legend-map').getContext('2d')!;
    context.putImageData(new ImageData(new Uint8ClampedArray(colourTable(this.style.map)), 256, 1), 0, 0);
    byId('legend-low').textContent = figure(range[0], 4);
    byId('legend-high').textContent = figure(range[1], 4);
    byId('legend-name').textContent = this.style.colour === 'steepness' ? 'steepness in degrees' : this.style.colour.replace(/^a:/, '');
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
