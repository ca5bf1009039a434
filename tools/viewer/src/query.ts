// SPDX-License-Identifier: Apache-2.0
// Queries as docs/query.md has them, as far as the page asks them, and what it knows of space.
// All coordinates here are model units, as doubles; z is up.
export type Point = [number, number, number];

export interface Camera {
  eye: Point;
  target: Point;
  fov: number; // degrees, from the bottom to the top of the picture
  viewport: [number, number]; // pixels
}

export type Region =
  | {box: {min: Point; max: Point}}
  | {sphere: {centre: Point; radius: number}}
  | {half_space: {point: Point; normal: Point}};

export type Threshold =
  | number
  | 'full'
  | 'coarsest'
  | {screen: {camera: Camera; pixels: number}}
  | {by_region: {region: Region; inside: Threshold; outside: Threshold}};

export interface Query {
  region?: Region | {frustum: Camera} | {union: (Region | {frustum: Camera})[]} | {intersection: (Region | {frustum: Camera})[]};
  threshold?: Threshold;
  max_triangles?: number;
  clip?: boolean;
}

// What the user wants of a region of interest.
export interface Focus {
  region: Region;
  inside: 'full' | 'view' | number; // full resolution, as elsewhere in the view, or an error in model units
  outside: 'view' | 'coarse' | 'clip'; // as the camera asks, as coarse as possible, or left out
}

export interface Wish {
  camera: Camera;
  pixels: number;
  focus: Focus | null;
  maxTriangles: number;
}

// The query for what the user wants to see.
export function queryFor(wish: Wish): Query {
  const screen: Threshold = {screen: {camera: wish.camera, pixels: wish.pixels}};
  const frustum = {frustum: wish.camera};
  const query: Query = {max_triangles: wish.maxTriangles};
  const focus = wish.focus;
  if (!focus) return {...query, region: frustum, threshold: screen};
  const inside: Threshold = focus.inside === 'view' ? screen : focus.inside;
  if (focus.outside === 'view') {
    return {...query, region: {union: [frustum, focus.region]}, threshold: {by_region: {region: focus.region, inside, outside: screen}}};
  }
  return {...query, region: focus.region, threshold: inside, ...(focus.outside === 'clip' ? {clip: true} : {})};
}

export const add = (a: Point, b: Point): Point => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const sub = (a: Point, b: Point): Point => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a: Point, s: number): Point => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a: Point, b: Point) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const length = (a: Point) => Math.hypot(a[0], a[1], a[2]);
export const cross = (a: Point, b: Point): Point => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const unit = (a: Point): Point => scale(a, 1 / (length(a) || 1));

// Model units that a pixel covers at a depth.
export function unitsPerPixel(camera: Camera, depth: number): number {
  return (2 * depth * Math.tan((camera.fov * Math.PI) / 360)) / camera.viewport[1];
}
