// SPDX-License-Identifier: Apache-2.0
// How the surface looks: shading, colours and what they stand for, light and theme.
import * as three from 'three';
import {colourTable} from './colour_maps';
import {select} from './page';
import type {ObjectInfo, ValueChoice} from './source';
import {plainStyle, type Style} from './view_state';
import type {Viewer} from './viewer';

const kSurface = '#b9b2a6', kBack = '#9a6a4f';

export class Look {
  style: Style = {...plainStyle};

  constructor(private readonly viewer: Viewer) {}

  attributesOf(info: ObjectInfo) {
    const at = (name: string) => info.attributes.findIndex(a => a.name === name);
    const colour = [at('red'), at('green'), at('blue')];
    return {colour: colour.every(i => i >= 0) ? (colour as [number, number, number]) : null, at};
  }

  choiceFor(info: ObjectInfo): ValueChoice {
    const {colour, at} = this.attributesOf(info);
    if (this.style.colour === 'vertex' && colour) return {kind: 'colour', attributes: colour};
    if (this.style.colour.startsWith('a:') && at(this.style.colour.slice(2)) >= 0) return {kind: 'scalar', attribute: at(this.style.colour.slice(2))};
    return {kind: 'none'};
  }

  apply() {
    const u = this.viewer.shared;
    for (const object of this.viewer.scene.objects.values()) object.source.choose(this.choiceFor(object.info));
    const kinds: Record<string, number> = {plain: 0, vertex: 1, height: 3, steepness: 4};
    u.colourBy!.value = this.style.colour.startsWith('a:') ? 2 : (kinds[this.style.colour] ?? 0);
    u.flatShading!.value = this.style.shading === 'flat';
    u.showBack!.value = this.style.back;
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
    if (kind === 3) return [this.viewer.bounds().min[2], this.viewer.bounds().max[2]];
    if (kind === 4) return [0, 90];
    if (kind !== 2) return null;
    let range: [number, number] | null = null;
    for (const {mesh} of this.viewer.scene.objects.values()) {
      if (mesh.valueRange) range = range ? [Math.min(range[0], mesh.valueRange[0]), Math.max(range[1], mesh.valueRange[1])] : [...mesh.valueRange];
    }
    return range;
  }

  setTheme() {
    const chosen = select('theme').value || (matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light');
    document.documentElement.dataset.theme = chosen;
    this.viewer.renderer.setClearColor(chosen === 'dark' ? 0x12171c : 0xe9edf1);
    (this.viewer.shared.edge!.value as three.Color).setStyle(chosen === 'dark' ? '#0b2135' : '#10283f', three.LinearSRGBColorSpace);
    this.viewer.drawn = '';
  }

  restyle(change: Partial<Style>) {
    this.style = {...this.style, ...change};
    this.apply();
    this.viewer.panel.fill();
  }
}
