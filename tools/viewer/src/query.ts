// SPDX-License-Identifier: Apache-2.0
// Queries as docs/query.md has them, as far as the page asks them, and what it knows of space.
// Coordinates are doubles; z is up.
export type Point = [number, number, number];

export interface Camera {
  eye: Point;
  target: Point;
  up?: Point; // z without it
  fov: number; // degrees, from the bottom to the top of the picture
  viewport: [number, number]; // pixels
}

export interface HalfSpace {
  point: Point;
  normal: Point; // points out
}

export type Region =
  | {box: {min: Point; max: Point}}
  | {sphere: {centre: Point; radius: number}}
  | {half_space: HalfSpace}
  | {polyhedron: HalfSpace[]}
  | {wedge: {apex: [number, number]; direction: [number, number]; angle: number; far: number}}
  | {frustum: Camera}
  | {union: Region[]};

export type Threshold =
  | number
  | 'full'
  | 'coarsest'
  | {screen: {camera: Camera; pixels: number}}
  | {linear: {point: Point; base: number; slope: number}}
  | {by_region: {region: Region; inside: Threshold; outside: Threshold}}
  | {largest: Threshold[]};

export interface Query {
  region?: Region;
  threshold?: Threshold;
  max_triangles?: number;
  clip?: boolean;
}

export const add = (a: Point, b: Point): Point => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const sub = (a: Point, b: Point): Point => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a: Point, s: number): Point => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a: Point, b: Point) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const length = (a: Point) => Math.hypot(a[0], a[1], a[2]);
export const cross = (a: Point, b: Point): Point => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const unit = (a: Point): Point => scale(a, 1 / (length(a) || 1));

// What a pixel covers at a depth.
export function unitsPerPixel(camera: Camera, depth: number): number {
  return (2 * depth * Math.tan((camera.fov * Math.PI) / 360)) / camera.viewport[1];
}
