// SPDX-License-Identifier: Apache-2.0
// What the page tells: how exact the picture is, scale, axes, legend, figures.
import * as three from 'three';
import {colourTable} from './colour_maps';
import type {Navigation} from './navigation';
import {byId, figure, whole} from './page';
import {unitsPerPixel} from './query';
import type {Scene} from './scene';
import type {Style} from './view_state';

// What it needs of the page.
export interface StatusContext {
  readonly canvas: HTMLCanvasElement;
  readonly scene: Scene;
  readonly navigation: Navigation;
  readonly look: {readonly style: Style; mapRange(): [number, number] | null};
  readonly loading: {progress(): string; figures(): [string, string][]};
  readonly textures: {figures(): [string, string][]};
  readonly unit: string;
  readonly exaggerate: number;
  readonly frames: readonly number[];
  readonly drawMilliseconds: number;
  terrains(): boolean;
  viewport(): [number, number];
  text(units: number): string;
  say(sentence: string): void;
}

export class Status {
  private saidLost = false;

  constructor(private readonly viewer: StatusContext) {}

  showAxes() {
    const to = new three.Vector3();
    for (const [k, axis] of ['x', 'y', 'z'].entries()) {
      to.set(k === 0 ? 1 : 0, k === 1 ? 1 : 0, k === 2 ? 1 : 0).transformDirection(
        this.viewer.navigation.camera.matrixWorldInverse,
      );
      const line = document.getElementById(`axis-${axis}`)!,
        text = document.getElementById(`text-${axis}`)!;
      line.setAttribute('x2', String(19 * to.x));
      line.setAttribute('y2', String(-19 * to.y));
      text.setAttribute('x', String(25 * to.x));
      text.setAttribute('y', String(-25 * to.y));
    }
  }

  show() {
    const exact = this.viewer.scene.exactness(),
      camera = this.viewer.navigation.query(this.viewer.viewport());
    const pixel = unitsPerPixel(camera, this.viewer.navigation.depth());
    const objects = [...this.viewer.scene.objects.values()];
    const lost = objects.find(o => o.state === 'lost') ?? objects.find(o => o.state === 'gone');
    if (lost) this.viewer.say(lost.sentence);
    else if (this.saidLost) this.viewer.say('');
    this.saidLost = lost !== undefined;
    const failure = objects.map(o => o.failure).find(text => text !== '') ?? '';
    const promise = `${figure(exact.pixels, 2)} px = ${this.viewer.text(pixel * exact.pixels)}`;
    const drawn = whole(this.viewer.scene.total(o => o.mesh.triangles));
    const byRegion = this.viewer.scene.focus && this.viewer.scene.focus.outside !== 'view';
    const budget = !exact.limited
      ? ''
      : exact.limit === 'memory'
        ? `; the memory of ${whole(this.viewer.scene.limits.cacheBytes / 2 ** 20)} MiB allows no less`
        : `; the budget of ${whole(this.viewer.scene.budget)} triangles allows no less`;
    const onTheWay = this.viewer.loading.progress();
    byId('exactness').textContent = failure
      ? failure
      : exact.kind === 'nothing'
        ? ''
        : exact.kind === 'loading'
          ? `${drawn} triangles, refining…${onTheWay && ` ${onTheWay}`}`
          : exact.kind === 'short'
            ? `off by at most ${this.viewer.text(exact.bound)}${budget || ': nothing better is stored'}`
            : byRegion
              ? `in the region exact to ${this.viewer.text(exact.bound)}`
              : exact.by === 'whole'
                ? `the whole: ${drawn} triangles${exact.bound > 0 ? `, exact to ${this.viewer.text(exact.bound)}` : ''}`
                : exact.by === 'budget'
                  ? `as fine as ${drawn} triangles are: exact to ${this.viewer.text(exact.bound)}${exact.limited && exact.limit === 'memory' ? budget : ''}`
                  : `exact to ${promise}${budget}`;
    byId('exactness').dataset.kind = exact.kind;
    byId('exaggerated').hidden = !this.viewer.terrains() || this.viewer.exaggerate === 1;
    byId('exaggerated').textContent = `heights × ${figure(this.viewer.exaggerate)}`;
    this.showScale((camera.viewport[1] / this.viewer.canvas.clientHeight) * pixel);
    this.showLegend();
    const rows: [string, string][] = [
      ['triangles', whole(this.viewer.scene.total(o => o.mesh.triangles))],
      ['vertices', whole(this.viewer.scene.total(o => o.mesh.vertices))],
      ['of the whole', whole(this.viewer.scene.total(o => o.info.triangles))],
      ['error bound', this.viewer.text(exact.bound)],
      ...this.viewer.loading.figures(),
      ...this.viewer.textures.figures(),
      ['draw', `${figure(this.viewer.drawMilliseconds, 2)} ms`],
      ['frames in the last second', String(this.viewer.frames.length)],
    ];
    byId('figures').replaceChildren(
      ...rows.flatMap(([name, value]) => {
        const dt = document.createElement('dt'),
          dd = document.createElement('dd');
        dt.textContent = name;
        dd.textContent = value;
        return [dt, dd];
      }),
    );
  }

  private legendName() {
    const {colour} = this.viewer.look.style,
      unit = this.viewer.unit && `, ${this.viewer.unit}`;
    const names: Record<string, string> = {
      steepness: 'steepness in degrees',
      height: `height${unit}`,
      permitted: `permitted error${unit}`,
      error: `errors${unit}`,
      round: 'round',
    };
    return names[colour] ?? colour.replace(/^a:/, '');
  }

  // `pixel`: what a CSS pixel covers.
  showScale(pixel: number) {
    const most = pixel * 120,
      power = 10 ** Math.floor(Math.log10(most));
    const size = [5, 2, 1].map(f => f * power).find(s => s <= most) ?? power;
    const far = this.viewer.unit === 'm' && size >= 1000;
    byId('scale-text').textContent = far ? `${figure(size / 1000)} km` : this.viewer.text(size);
    byId('scale-bar').style.width = `${size / pixel}px`;
    byId('scale').hidden = this.viewer.scene.objects.size === 0 || !Number.isFinite(size);
  }

  showLegend() {
    const range = this.viewer.look.mapRange();
    byId('legend').hidden = !range;
    if (!range) return;
    const context = byId<HTMLCanvasElement>('legend-map').getContext('2d')!;
    context.putImageData(
      new ImageData(new Uint8ClampedArray(colourTable(this.viewer.look.style.map)), 256, 1),
      0,
      0,
    );
    byId('legend-low').textContent = figure(range[0], 4);
    byId('legend-high').textContent = figure(range[1], 4);
    byId('legend-name').textContent = this.legendName();
  }
}
