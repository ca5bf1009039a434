// SPDX-License-Identifier: Apache-2.0
// What a link carries to a colleague: objects, camera, region, style, measured lines.
import type {Point} from './query';
import {titles} from './shapes';
import {upAxes} from './up';
import type {Focus} from './wish';

export const kUnits = ['um', 'mm', 'cm', 'm', 'km', 'in', 'ft']; // of store/object_record.h

export interface Style {
  shading: 'smooth' | 'flat';
  wireframe: boolean;
  colour: string; // plain, vertex, texture, height, steepness, permitted, or a:NAME; empty in what was read: as is usual for the object
  map: string;
  light: 'camera' | 'northwest' | 'none'; // none: colours as they are
  back: 'same' | 'colour' | 'cap'; // how back faces look
}

// As a link has it; see numbersOf().
export interface FocusState extends Omit<Focus, 'region'> {
  kind: string;
  numbers: number[];
}

// Points are in the model's coordinates.
export interface ViewState {
  objects: string[];
  eye: Point | null;
  target: Point | null;
  pixels: number | null; // null: as fine as `triangles` allow
  triangles: number;
  style: Style;
  focus: FocusState | null;
  unit: string;
  up: string; // one of upAxes; empty: as the object says
  exaggerate: number; // heights of a terrain
  lines: Point[][]; // measured
}

export const plainStyle: Style = {
  shading: 'smooth',
  wireframe: false,
  colour: 'plain',
  map: 'viridis',
  light: 'camera',
  back: 'colour',
};

const point = (text: string | null): Point | null => {
  const n = (text ?? '').split(',').map(Number);
  return text && n.length === 3 && n.every(x => Number.isFinite(x)) ? (n as Point) : null;
};

export function writeView(view: ViewState, defaults: ViewState): string {
  const p = new URLSearchParams();
  for (const name of view.objects) p.append('o', name);
  if (view.eye && view.target) {
    p.set('eye', view.eye.join(','));
    p.set('look', view.target.join(','));
  }
  if (view.pixels !== null) p.set('px', String(view.pixels));
  if (view.triangles !== defaults.triangles) p.set('triangles', String(view.triangles));
  for (const key of Object.keys(plainStyle) as (keyof Style)[]) {
    if (view.style[key] !== defaults.style[key]) p.set(key, String(view.style[key]));
  }
  if (view.focus) {
    p.set('region', view.focus.kind + ':' + view.focus.numbers.join(','));
    p.set('inside', String(view.focus.inside));
    p.set('outside', view.focus.outside);
    if (view.focus.follow) p.set('follow', 'true');
  }
  if (view.unit) p.set('unit', view.unit);
  if (view.up) p.set('up', view.up);
  if (view.exaggerate !== 1) p.set('exaggerate', String(view.exaggerate));
  for (const line of view.lines) if (line.length > 0) p.append('line', line.flat().join(','));
  return '#' + p.toString();
}

// Anything may be in a link: what is no value is left out.
export function readView(hash: string, defaults: ViewState): ViewState {
  const p = new URLSearchParams(hash.replace(/^#/, ''));
  const oneOf = <T extends string>(key: string, values: readonly T[], otherwise: T): T =>
    values.includes(p.get(key) as T) ? (p.get(key) as T) : otherwise;
  const number = (key: string, otherwise: number) =>
    p.has(key) && Number(p.get(key)) > 0 && Number.isFinite(Number(p.get(key)))
      ? Number(p.get(key))
      : otherwise;
  const [kind = '', text = ''] = (p.get('region') ?? '').split(':');
  const numbers = text.split(',').map(Number);
  const usable = numbers.length === titles[kind]?.length && numbers.every(x => Number.isFinite(x));
  const inside = p.get('inside') ?? 'full';
  const error = Number(inside);
  const lines = p
    .getAll('line')
    .map(text => {
      const n = text.split(',').map(Number);
      const points: Point[] = [];
      for (let i = 0; i + 2 < n.length; i += 3) points.push([n[i]!, n[i + 1]!, n[i + 2]!]);
      return points.every(q => q.every(x => Number.isFinite(x))) ? points : [];
    })
    .filter(line => line.length > 0);
  return {
    objects: p.getAll('o'),
    eye: point(p.get('eye')),
    target: point(p.get('look')),
    pixels: number('px', 0) || null,
    triangles: number('triangles', defaults.triangles),
    style: {
      shading: oneOf('shading', ['smooth', 'flat'], defaults.style.shading),
      wireframe: p.has('wireframe') ? p.get('wireframe') === 'true' : defaults.style.wireframe,
      colour: p.get('colour') ?? defaults.style.colour,
      map: p.get('map') ?? defaults.style.map,
      light: oneOf('light', ['camera', 'northwest', 'none'], defaults.style.light),
      back: oneOf('back', ['same', 'colour', 'cap'], defaults.style.back),
    },
    focus: usable
      ? {
          kind,
          numbers,
          inside:
            inside === 'view' || inside === 'distance'
              ? inside
              : error > 0 && Number.isFinite(error)
                ? error
                : 'full',
          outside: oneOf('outside', ['view', 'coarse', 'clip'], 'view'),
          follow: kind === 'wedge' && p.get('follow') === 'true',
        }
      : null,
    unit: oneOf('unit', ['', ...kUnits], ''),
    up: oneOf('up', ['', ...Object.keys(upAxes)], ''),
    exaggerate: Math.min(10, Math.max(1, number('exaggerate', 1))),
    lines,
  };
}
