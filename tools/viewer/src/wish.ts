// SPDX-License-Identifier: Apache-2.0
// From what the user wants to see, in the page's coordinates, to the query for it, in the model's.
import {
  add,
  cross,
  scale,
  sub,
  unit,
  unitsPerPixel,
  type Camera,
  type HalfSpace,
  type Point,
  type Query,
  type Region,
  type Threshold,
} from './query';
import {halfSpaceOf, regionOf, type Shape} from './shapes';
import {toModel} from './stretch';

// What the user wants of a region of interest.
export interface Focus {
  region: Shape;
  // Full resolution; as elsewhere in the view; an error that grows with the distance from the
  // wedge's apex as if the camera were there; or one error.
  inside: 'full' | 'view' | 'distance' | number;
  outside: 'view' | 'coarse' | 'clip'; // as the camera asks, as coarse as possible, or left out
  follow: boolean; // a wedge that is where the camera is
}

export interface Wish {
  camera: Camera;
  pixels: number; // 0: all that there is, wherever the camera looks
  focus: Focus | null;
  distancePixels: number; // of errors that grow from a wedge's apex
  maxTriangles: number;
  stretch: Point;
}

// Errors of a pixel grow so much for each unit of depth.
export const slopeOf = (camera: Camera, pixels: number) => pixels * unitsPerPixel(camera, 1);

export function queryFor(wish: Wish): Query {
  const {stretch, focus} = wish;
  const even = stretch.every(s => s === 1);
  const screen: Threshold =
    wish.pixels === 0
      ? 'full'
      : even
        ? {screen: {camera: wish.camera, pixels: wish.pixels}}
        : byDistance(
            wish.camera.eye,
            (slopeOf(wish.camera, wish.pixels) * cornerCosine(wish.camera)) / stretch[2],
            stretch,
          );
  const frustum: Region = even
    ? {frustum: wish.camera}
    : {polyhedron: sidesOf(wish.camera).map(p => halfSpaceOf(p, stretch))};
  const query: Query = {max_triangles: wish.maxTriangles};
  if (!focus) return {...query, ...(wish.pixels === 0 ? {} : {region: frustum}), threshold: screen};
  const region = regionOf(focus.region, stretch);
  const inside: Threshold =
    focus.inside === 'view'
      ? screen
      : focus.inside === 'distance'
        ? byDistance(
            apexOf(focus.region, wish.camera),
            slopeOf(wish.camera, wish.distancePixels) / stretch[2],
            stretch,
          )
        : focus.inside;
  if (focus.outside === 'view')
    return {
      ...query,
      ...(wish.pixels === 0 ? {} : {region: {union: [frustum, region]}}),
      threshold: {by_region: {region, inside, outside: screen}},
    };
  return {...query, region, threshold: inside, ...(focus.outside === 'clip' ? {clip: true} : {})};
}

export const apexOf = (shape: Shape, camera: Camera): Point =>
  'wedge' in shape ? shape.wedge.apex : camera.eye;

// Cosine of the angle between the picture's middle and its corners: a depth is at least so much of
// a distance.
function cornerCosine(camera: Camera) {
  const tan = Math.tan((camera.fov * Math.PI) / 360),
    aspect = camera.viewport[0] / camera.viewport[1];
  return 1 / Math.sqrt(1 + tan * tan * (1 + aspect * aspect));
}

// slope times the distance from a point. In a stretched model, steps that are never above it: in
// boxes around the point, each 1.3 times as large as the one inside of it.
function byDistance(point: Point, slope: number, stretch: Point): Threshold {
  if (stretch.every(s => s === 1)) return {linear: {point, base: 0, slope}};
  const steps: Threshold[] = [0];
  for (let reach = 20; reach < 2e7; reach *= 1.3) {
    const half: Point = [reach, reach, reach];
    const box: Region = {
      box: {min: toModel(sub(point, half), stretch), max: toModel(add(point, half), stretch)},
    };
    steps.push({by_region: {region: box, inside: 0, outside: slope * reach}});
  }
  return {largest: steps};
}

// The frustum's sides, and the plane through the eye.
function sidesOf(camera: Camera): HalfSpace[] {
  const forward = unit(sub(camera.target, camera.eye));
  const right = unit(
      cross(forward, Math.hypot(forward[0], forward[1]) > 1e-9 ? [0, 0, 1] : [0, 1, 0]),
    ),
    up = cross(right, forward);
  const tan = Math.tan((camera.fov * Math.PI) / 360),
    wide = (tan * camera.viewport[0]) / camera.viewport[1];
  const side = (across: Point, reach: number): HalfSpace => ({
    point: camera.eye,
    normal: sub(across, scale(forward, reach)),
  });
  return [
    side(right, wide),
    side(scale(right, -1), wide),
    side(up, tan),
    side(scale(up, -1), tan),
    {point: camera.eye, normal: scale(forward, -1)},
  ];
}
