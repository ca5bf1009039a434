// SPDX-License-Identifier: Apache-2.0
// How the surface looks: shading, colours and what they stand for, light and theme.
import * as three from 'three';
import {colourTable} from './colour_maps';
import type {Navigation} from './navigation';
import {select} from './page';
import type {Scene} from './scene';
import type {Uniforms} from './shaders';
import {planesOf} from './shapes';
import type {ObjectInfo, TriangleValue, ValueChoice, Way} from './source';
import {plainStyle, type Style} from './view_state';
import {apexOf, slopeOf} from './wish';

// How the shaders take what is known of triangles; see colourBy there.
const kTriangleValues: Record<TriangleValue, number> = {error: 6, round: 2, cluster: 7};

const kSurface = '#b9b2a6',
  kBack = '#9a6a4f',
  kMark = '#f0b429';
// Of what is shown, the camera's, the sky's, and the eye's share of light.
const kLights: Record<Style['light'], [number, number, number]> = {
  camera: [0.62, 0.14, 0.26],
  northwest: [0.98, 0.06, 0.1],
  none: [0, 0, 0], // colours as they are
};

// What it needs of the page.
export interface LookContext {
  readonly shared: Uniforms;
  readonly renderer: three.WebGLRenderer;
  readonly scene: Scene;
  readonly navigation: Navigation;
  readonly loading: {readonly way: Way};
  readonly panel: {fill(): void};
  panelDirty: boolean;
  drawn: string;
  shownInfos(): ObjectInfo[];
  terrains(): boolean;
  heights(): [number, number];
  roundingError(): number;
  viewport(): [number, number];
}

export class Look {
  style: Style = {...plainStyle};

  constructor(private readonly viewer: LookContext) {}

  attributesOf(info: ObjectInfo) {
    const at = (name: string) => info.attributes.findIndex(a => a.name === name);
    const colour = [at('red'), at('green'), at('blue')];
    return {colour: colour.every(i => i >= 0) ? (colour as [number, number, number]) : null, at};
  }

  // That of the object, when nobody chose another: its own colours, if it has some.
  usualColour() {
    const infos = this.viewer.shownInfos();
    if (infos.some(i => this.hasTexture(i))) return 'texture';
    return infos.some(i => this.attributesOf(i).colour) && !this.viewer.terrains()
      ? 'vertex'
      : 'plain';
  }

  // Whether its texture can be shown, as far as that is known: the thick way has the places of
  // corners, and files of older programs have no tiles.
  hasTexture(info: ObjectInfo): boolean {
    const {loading, scene} = this.viewer;
    return (
      info.texture !== undefined &&
      loading.way === 'thick' &&
      scene.objects.get(info.object)?.pages !== 0
    );
  }

  // What is shown of single triangles, if the way of cutting tells it.
  triangleValue(): TriangleValue | null {
    const {colour} = this.style;
    return this.viewer.loading.way === 'thick' && colour in kTriangleValues
      ? (colour as TriangleValue)
      : null;
  }

  choiceFor(info: ObjectInfo): ValueChoice {
    const of = this.triangleValue();
    if (of) return {kind: 'triangle', of};
    const {colour, at} = this.attributesOf(info);
    if (this.style.colour === 'texture' && this.hasTexture(info)) return {kind: 'texture'};
    if (this.style.colour === 'vertex' && colour) return {kind: 'colour', attributes: colour};
    if (this.style.colour.startsWith('a:') && at(this.style.colour.slice(2)) >= 0)
      return {kind: 'scalar', attribute: at(this.style.colour.slice(2))};
    return {kind: 'none'};
  }

  apply() {
    const u = this.viewer.shared;
    const triangles = this.triangleValue();
    for (const object of this.viewer.scene.objects.values())
      object.source.choose(this.choiceFor(object.info));
    const kinds: Record<string, number> = {
      plain: 0,
      vertex: 1,
      height: 3,
      steepness: 4,
      permitted: 5,
      texture: 8,
    };
    u.colourBy!.value = triangles
      ? kTriangleValues[triangles]
      : this.style.colour.startsWith('a:')
        ? 2
        : (kinds[this.style.colour] ?? 0);
    u.flatShading!.value = this.style.shading === 'flat';
    u.backFaces!.value = ['same', 'colour', 'cap'].indexOf(this.style.back);
    (u.weights!.value as three.Vector3).set(...kLights[this.style.light]);
    (u.mark!.value as three.Color).setStyle(kMark, three.LinearSRGBColorSpace);
    (u.surface!.value as three.Color).setStyle(kSurface, three.LinearSRGBColorSpace);
    (u.back!.value as three.Color).setStyle(kBack, three.LinearSRGBColorSpace);
    const map = u.map!.value as three.DataTexture;
    (map.image.data as Uint8Array).set(colourTable(this.style.map));
    map.needsUpdate = true;
    this.viewer.scene.setWireframe(this.style.wireframe);
    this.viewer.panelDirty = true;
  }

  // What the colour map spans.
  mapRange(): [number, number] | null {
    const kind = this.viewer.shared.colourBy!.value;
    if (kind === 3) return this.viewer.heights();
    if (kind === 4) return [0, 90];
    if (kind === 5) return this.permittedRange();
    if (kind !== 2 && kind !== 6) return null;
    let range: [number, number] | null = null;
    for (const {mesh} of this.viewer.scene.objects.values()) {
      if (mesh.valueRange)
        range = range
          ? [Math.min(range[0], mesh.valueRange[0]), Math.max(range[1], mesh.valueRange[1])]
          : [...mesh.valueRange];
    }
    return range;
  }

  // The least and the most error that the camera asks for in what is shown. The map is logarithmic.
  private permittedRange(): [number, number] {
    const {scene, navigation} = this.viewer;
    const slope =
      slopeOf(navigation.query(this.viewer.viewport()), Math.max(scene.exactness().pixels, 1e-3)) /
      scene.stretch[2];
    const most = slope * navigation.camera.far,
      least = Math.max(slope * navigation.camera.near, most * 1e-3);
    return [least, most];
  }

  // What the shaders know of region and permitted errors. To be called before drawing.
  mark() {
    const u = this.viewer.shared,
      {scene, navigation} = this.viewer,
      focus = scene.focus;
    const ball = u.ball!.value as three.Vector4,
      planes = u.planes!.value as three.Vector4[],
      permitted = u.permitted!.value as three.Vector4;
    ball.set(0, 0, 0, -1);
    u.planeCount!.value = 0;
    u.clips!.value = focus?.outside === 'clip';
    const camera = navigation.query(this.viewer.viewport()),
      slope = slopeOf(camera, Math.max(scene.exactness().pixels, 1e-3)) / scene.stretch[2];
    permitted.set(slope, 0, 0, focus && focus.outside !== 'view' ? 1 : 0);
    if (!focus) return;
    planesOf(focus.region).forEach((plane, i) => {
      const normal = new three.Vector3(...plane.normal).normalize();
      planes[i]!.set(normal.x, normal.y, normal.z, -normal.dot(navigation.toScene(plane.point)));
      ++(u.planeCount!.value as number);
    });
    if ('sphere' in focus.region)
      ball.set(
        ...navigation.toScene(focus.region.sphere.centre).toArray(),
        focus.region.sphere.radius,
      );
    permitted.z = focus.inside === 'view' ? 0 : focus.inside === 'distance' ? 2 : 1;
    permitted.y =
      focus.inside === 'distance'
        ? slope
        : typeof focus.inside === 'number'
          ? focus.inside
          : this.viewer.roundingError();
    (u.apex!.value as three.Vector3).copy(navigation.toScene(apexOf(focus.region, camera)));
  }

  setTheme() {
    const chosen =
      select('theme').value ||
      (matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light');
    document.documentElement.dataset.theme = chosen;
    this.viewer.renderer.setClearColor(chosen === 'dark' ? 0x12171c : 0xe9edf1);
    (this.viewer.shared.edge!.value as three.Color).setStyle(
      chosen === 'dark' ? '#0b2135' : '#10283f',
      three.LinearSRGBColorSpace,
    );
    this.viewer.drawn = '';
  }

  restyle(change: Partial<Style>) {
    this.style = {...this.style, ...change};
    this.apply();
    this.viewer.panel.fill();
  }
}
