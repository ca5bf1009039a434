// SPDX-License-Identifier: Apache-2.0
// Terrains may also be drawn with their heights exaggerated; what is measured is without that.
// Objects are drawn where they lie, but for terrains in degrees: of these the page multiplies x and
// y by the metres of a degree at their middle, so that all its lengths are metres. "The page's
// coordinates" are those; what is shown to people, written to files and asked for is in the
// object's own, the model's.
import type {Point} from './query';
import type {ObjectInfo} from './source';

export const kNoStretch: Point = [1, 1, 1];
const kMetresOfADegree = 111_195; // on a sphere, as `mtdb render` has it

export const inDegrees = (info: ObjectInfo) => /^GEO(G|DCRS)/.test(info.raster?.crs ?? '');

export function stretchOf(info: ObjectInfo): Point {
  if (!inDegrees(info)) return kNoStretch;
  const latitude = (info.bounds.min[1] + info.bounds.max[1]) / 2;
  return [
    kMetresOfADegree * Math.max(Math.cos((latitude * Math.PI) / 180), 1e-3),
    kMetresOfADegree,
    1,
  ];
}

export const isTerrain = (info: ObjectInfo) =>
  info.raster !== undefined || info.error_measure === 'vertical';

export const toPage = (p: Point, s: Point): Point => [p[0] * s[0], p[1] * s[1], p[2] * s[2]];
export const toModel = (p: Point, s: Point): Point => [p[0] / s[0], p[1] / s[1], p[2] / s[2]];
