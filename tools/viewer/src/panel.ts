// SPDX-License-Identifier: Apache-2.0
// The panel beside the picture: its controls say what is shown, and change it.
import {colourMaps} from './colour_maps';
import type {Look} from './look';
import {lengthError, lineLength, rise, type Measuring} from './measuring';
import type {Navigation} from './navigation';
import {byId, download, figure, input, select, whole} from './page';
import type {Scene} from './scene';
import {kindOf, numbersOf, planesOf, shapeOf, titles, type Shape} from './shapes';
import type {ObjectEntry, ObjectInfo, Way} from './source';
import {kZUp, upAxes, upName} from './up';
import {kUnits, type Style} from './view_state';
import type {Focus} from './wish';

// What it needs of the page: its controls change much.
export interface PanelContext {
  readonly scene: Scene;
  readonly navigation: Navigation;
  readonly look: Look;
  readonly measuring: Measuring;
  readonly gestures: {
    readonly measureOn: boolean;
    setFlying(on: boolean): void;
    setMeasuring(on: boolean): void;
  };
  readonly taking: {
    takeMesh(): Promise<void>;
    takePicture(): Promise<void>;
    copyLink(): Promise<void>;
  };
  readonly loading: {readonly way: Way};
  readonly entries: readonly ObjectEntry[];
  readonly ui: 'full' | 'simple' | 'none';
  readonly upChoice: string;
  readonly exaggerate: number;
  unit: string;
  drawn: string;
  panelDirty: boolean;
  show(name: string): Promise<void>;
  hide(name: string): void;
  shownInfos(): ObjectInfo[];
  terrains(): boolean;
  setUp(choice: string, looks: boolean): void;
  setExaggeration(factor: number): void;
  newRegion(kind: string): Shape | null;
  setRegion(region: Shape | null): void;
  setHandles(): void;
  text(units: number): string;
  coordinate(x: number): string;
}

export class Panel {
  constructor(private readonly viewer: PanelContext) {}

  open(open: boolean) {
    document.body.classList.toggle('closed', !open);
    byId('toggle').setAttribute('aria-expanded', String(open));
  }

  bind() {
    const on = (id: string, event: string, act: () => void) =>
      byId(id).addEventListener(event, act);
    this.open(innerWidth > 700);
    on('toggle', 'click', () => this.open(document.body.classList.contains('closed')));
    for (const button of document.querySelectorAll<HTMLElement>('[data-view]'))
      button.onclick = () => this.viewer.navigation.view(button.dataset.view!);
    on('fly', 'click', () => this.viewer.gestures.setFlying(!this.viewer.navigation.flying));
    on('measure', 'click', () =>
      this.viewer.gestures.setMeasuring(!this.viewer.gestures.measureOn),
    );
    on('shading', 'change', () =>
      this.viewer.look.restyle({shading: select('shading').value as Style['shading']}),
    );
    on('wireframe', 'change', () =>
      this.viewer.look.restyle({wireframe: input('wireframe').checked}),
    );
    on('colour', 'change', () =>
      this.viewer.look.restyle({
        colour: select('colour').value,
        ...(select('colour').value === 'height' && this.viewer.look.style.map === 'viridis'
          ? {map: 'tints'}
          : {}),
      }),
    );
    on('map', 'change', () => this.viewer.look.restyle({map: select('map').value}));
    on('light', 'change', () =>
      this.viewer.look.restyle({light: select('light').value as Style['light']}),
    );
    on('back', 'change', () =>
      this.viewer.look.restyle({back: select('back').value as Style['back']}),
    );
    on('unit', 'change', () => {
      this.viewer.unit = select('unit').value;
      this.viewer.measuring.rebuild();
      this.fill();
    });
    on('theme', 'change', () => this.viewer.look.setTheme());
    on('up', 'change', () => this.viewer.setUp(select('up').value, true));
    on('exaggerate', 'input', () => {
      this.viewer.setExaggeration(Number(input('exaggerate').value));
      this.fill();
    });
    on('detail', 'change', () => {
      this.viewer.scene.pixels = select('detail').value === 'pixels' ? 1 : null;
      this.viewer.scene.restart();
      this.fill();
    });
    on('pixels', 'input', () => {
      this.viewer.scene.pixels = 2 ** Number(input('pixels').value);
      this.viewer.scene.restart();
      this.fill();
    });
    on('triangles', 'input', () => {
      this.viewer.scene.budget = Math.round(10 ** (Number(input('triangles').value) / 10));
      this.viewer.scene.restart();
      this.fill();
    });
    on('region', 'change', () => {
      this.viewer.scene.focus = this.viewer.scene.focus && {...this.viewer.scene.focus};
      this.viewer.setRegion(
        select('region').value ? this.viewer.newRegion(select('region').value) : null,
      );
    });
    const refocus = () => {
      if (!this.viewer.scene.focus) return;
      const inside = select('inside').value,
        error = Number(input('inside-error').value);
      const usable = error > 0 && Number.isFinite(error) ? error : this.suggestedError();
      this.viewer.scene.focus = {
        ...this.viewer.scene.focus,
        inside: inside === 'error' ? usable : (inside as 'full' | 'view' | 'distance'),
        outside: select('outside').value as Focus['outside'],
        follow: input('follow').checked,
      };
      this.viewer.setHandles();
      this.viewer.scene.restart();
      this.fill();
    };
    for (const id of ['inside', 'inside-error', 'outside', 'follow']) on(id, 'change', refocus);
    on('line-end', 'click', () => this.viewer.measuring.endLine());
    on('line-undo', 'click', () => this.viewer.measuring.undo());
    on('line-clear', 'click', () => this.viewer.measuring.clear());
    on('csv', 'click', () =>
      download(new Blob([this.viewer.measuring.csv()], {type: 'text/csv'}), 'measured.csv'),
    );
    on('geojson', 'click', () =>
      download(
        new Blob([this.viewer.measuring.geoJson()], {type: 'application/geo+json'}),
        'measured.geojson',
      ),
    );
    on('take', 'click', () => void this.viewer.taking.takeMesh());
    on(
      'picture-size',
      'change',
      () => (byId('picture-own').hidden = select('picture-size').value !== 'own'),
    );
    on('picture', 'click', () => void this.viewer.taking.takePicture());
    on('link', 'click', () => void this.viewer.taking.copyLink());
    select('up').append(...Object.keys(upAxes).map(name => new Option(name, name)));
    select('unit').append(...kUnits.map(unit => new Option(unit, unit)));
    select('map').replaceChildren(...Object.keys(colourMaps).map(name => new Option(name, name)));
  }

  fill() {
    const names = [...this.viewer.scene.objects.keys()];
    byId('title').textContent = names.join(', ');
    if (
      this.viewer.ui === 'simple' &&
      byId('visit-caption').textContent === '' &&
      byId('visit-title').textContent === ''
    )
      byId('visit-title').textContent = names.join(', ');
    if (this.viewer.ui === 'full')
      document.title = names.length > 0 ? `${names.join(', ')} · mtdb` : 'mtdb';
    byId('objects').replaceChildren(
      ...this.viewer.entries.map(entry => {
        const label = document.createElement('label'),
          box = document.createElement('input'),
          text = document.createElement('span'),
          size = document.createElement('small');
        box.type = 'checkbox';
        box.checked = this.viewer.scene.objects.has(entry.object);
        box.onchange = async () => {
          const first = this.viewer.scene.objects.size === 0;
          if (box.checked) await this.viewer.show(entry.object);
          else this.viewer.hide(entry.object);
          if (first && box.checked) this.viewer.navigation.view('home', false);
          this.viewer.look.apply();
        };
        text.className = 'name';
        text.textContent = text.title = entry.object;
        size.textContent = whole(entry.triangles);
        label.append(box, text, size);
        return label;
      }),
    );
    const style = this.viewer.look.style;
    const infos = this.viewer.shownInfos();
    const attributes = [...new Set(infos.flatMap(i => i.attributes.map(a => a.name)))].filter(
      name => !['red', 'green', 'blue', 'alpha', 'nx', 'ny', 'nz'].includes(name),
    );
    const colours = [
      ['plain', 'one colour'],
      ...(infos.some(i => i.texture) ? [['texture', 'texture']] : []),
      ...(infos.some(i => this.viewer.look.attributesOf(i).colour)
        ? [['vertex', 'vertex colours']]
        : []),
      ['height', 'height'],
      ['steepness', 'steepness'],
      ['permitted', 'permitted error'],
      ['error', 'errors of triangles'],
      ['round', 'rounds'],
      ['cluster', 'clusters'],
      ...attributes.map(name => [`a:${name}`, name]),
    ];
    if (!colours.some(([value]) => value === style.colour)) style.colour = 'plain';
    select('colour').replaceChildren(...colours.map(([value, text]) => new Option(text!, value!)));
    const thin = this.viewer.loading.way === 'thin';
    const textured = infos.some(i => this.viewer.look.hasTexture(i));
    for (const option of select('colour').options)
      option.disabled =
        (thin && ['error', 'round', 'cluster'].includes(option.value)) ||
        (!textured && option.value === 'texture');
    byId('colour-hint').hidden = !thin;
    byId('texture-hint').hidden = textured || !infos.some(i => i.texture);
    byId('texture-hint').textContent = thin
      ? 'Textures are shown where the mesh is cut in this page: the server does not send them.'
      : 'There are no tiles of the texture. mtdb makes them at ingest; older versions did not, and it does not of images that it cannot read.';
    select('colour').value = style.colour;
    if (!colourMaps[style.map]) style.map = 'viridis';
    select('map').value = style.map;
    byId('map-row').hidden = ['plain', 'vertex', 'texture'].includes(style.colour);
    select('shading').value = style.shading;
    input('wireframe').checked = style.wireframe;
    select('light').value = style.light;
    select('back').value = style.back;
    byId('cap-hint').hidden = style.back !== 'cap';
    this.fillUp();
    select('unit').value = this.viewer.unit;
    const {pixels} = this.viewer.scene;
    select('detail').value = pixels === null ? 'budget' : 'pixels';
    byId('pixels-row').hidden = pixels === null;
    input('pixels').value = String(Math.log2(pixels ?? 1));
    byId('pixels-text').textContent = `${figure(pixels ?? 1, 2)} pixel${pixels === 1 ? '' : 's'}`;
    input('triangles').value = String(10 * Math.log10(this.viewer.scene.budget));
    byId('triangles-text').textContent = `${whole(this.viewer.scene.budget)} triangles`;
    const focus = this.viewer.scene.focus;
    select('region').value = focus ? kindOf(focus.region) : '';
    byId('region-more').hidden = !focus;
    if (focus) {
      (byId('section-region') as HTMLDetailsElement).open = true;
      select('inside').value = typeof focus.inside === 'number' ? 'error' : focus.inside;
      byId('inside-row').hidden = typeof focus.inside !== 'number';
      if (typeof focus.inside === 'number') input('inside-error').value = figure(focus.inside, 3);
      select('outside').value = focus.outside;
      const wedge = kindOf(focus.region) === 'wedge';
      byId('follow-row').hidden = byId('inside-distance').hidden = !wedge;
      input('follow').checked = focus.follow;
      this.fillNumbers();
    }
    if (input('take-error').value === '' && infos.length > 0)
      input('take-error').value = figure(this.suggestedError(), 2);
    byId('take-cut-row').hidden = !focus || planesOf(focus.region).length === 0;
    byId('take-what').textContent =
      `${names.length > 1 ? 'Each object' : 'The object'}: ${focus ? 'what meets the region' : 'all of it'}. Model units${this.viewer.unit ? ` (${this.viewer.unit})` : ''}.`;
    this.viewer.panelDirty = true;
  }

  private fillUp() {
    const [first] = this.viewer.shownInfos(),
      terrain = this.viewer.terrains();
    byId('up-row').hidden = terrain || !first;
    byId('exaggerate-row').hidden = !terrain;
    input('exaggerate').value = String(this.viewer.exaggerate);
    byId('exaggerate-text').textContent =
      this.viewer.exaggerate === 1
        ? 'as they are'
        : `${figure(this.viewer.exaggerate)} times as high`;
    const from = !first?.up
      ? 'not stored'
      : first.up_given
        ? 'as ingest was told'
        : 'from the shape';
    select('up').options[0]!.textContent = `${upName(first?.up ?? kZUp)} (${from})`;
    select('up').value = this.viewer.upChoice;
  }

  fillNumbers() {
    const focus = this.viewer.scene.focus;
    if (!focus) return;
    const kind = kindOf(focus.region),
      numbers = numbersOf(focus.region, this.viewer.scene.stretch),
      root = byId('region-numbers');
    if (root.dataset.kind !== kind) {
      root.dataset.kind = kind;
      root.replaceChildren(
        ...titles[kind]!.map(title => {
          const label = document.createElement('label'),
            box = document.createElement('input');
          label.textContent = title;
          box.type = 'number';
          box.step = 'any';
          box.onchange = () => {
            const region = shapeOf(
              kind,
              [...root.querySelectorAll('input')].map(i => Number(i.value)),
              this.viewer.scene.stretch,
            );
            if (region) this.viewer.setRegion(region);
            else this.fillNumbers();
          };
          label.append(box);
          return label;
        }),
      );
    }
    root
      .querySelectorAll('input')
      .forEach((box, i) => (box.value = String(Number(this.viewer.coordinate(numbers[i]!)))));
  }

  // A thousandth of the diagonal.
  suggestedError() {
    return 1e-3 * Math.max(...this.viewer.shownInfos().map(i => i.diagonal), 0) || 1;
  }

  showMeasured() {
    const lines = this.viewer.measuring.lines.filter(line => line.points.length > 0),
      {up} = this.viewer.navigation,
      {stretch} = this.viewer.measuring;
    byId('measured').replaceChildren(
      ...lines.map((line, i) => {
        const row = document.createElement('p');
        row.className = 'hint';
        row.textContent =
          line.points.length === 1
            ? `${i + 1}: ${line.points[0]!.point.map(c => this.viewer.coordinate(c)).join('  ')}`
            : `${i + 1}: ${this.viewer.text(lineLength(line, stretch))} over ${line.points.length} points, ± ${this.viewer.text(lengthError(line))}; height ${rise(line, up) >= 0 ? '+' : '−'}${this.viewer.text(Math.abs(rise(line, up)))}`;
        return row;
      }),
    );
    if (lines.length === 0)
      byId('measured').textContent = 'Nothing yet: “Measure”, then click points of the surface.';
    this.viewer.drawn = '';
  }
}
