// SPDX-License-Identifier: Apache-2.0
// The regions that one drags in the picture, and what they are in queries and links. Shapes are in
// the page's coordinates (see stretch.ts), where lengths have one unit.
import * as three from 'three';
import {add, length, scale, sub, unit, type HalfSpace, type Point, type Region} from './query';
import {kNoStretch, toModel, toPage} from './stretch';

export interface Box {
  box: {min: Point; max: Point};
}
export interface TurnedBox {
  turned_box: {centre: Point; half: Point; angles: Point}; // degrees about z, then y, then x
}
// Of terrain: what is above and below it. `angle` in degrees, from side to side.
export interface Wedge {
  apex: Point;
  direction: [number, number];
  angle: number;
  far: number;
}
export type Shape =
  | Box
  | TurnedBox
  | {sphere: {centre: Point; radius: number}}
  | {half_space: HalfSpace}
  | {wedge: Wedge};

export const kindOf = (shape: Shape) => Object.keys(shape)[0]!;

const kRadians = Math.PI / 180;

// The directions of a turned box's edges.
export function axesOf(angles: Point): [Point, Point, Point] {
  const m = new three.Matrix4().makeRotationFromEuler(
    new three.Euler(angles[2] * kRadians, angles[1] * kRadians, angles[0] * kRadians, 'ZYX'),
  );
  return [0, 1, 2].map(k => new three.Vector3().setFromMatrixColumn(m, k).toArray()) as [
    Point,
    Point,
    Point,
  ];
}

export function anglesOf(axes: [Point, Point, Point]): Point {
  const [x, y, z] = axes.map(a => new three.Vector3(...a)) as [
    three.Vector3,
    three.Vector3,
    three.Vector3,
  ];
  const e = new three.Euler().setFromRotationMatrix(new three.Matrix4().makeBasis(x, y, z), 'ZYX');
  return [e.z / kRadians, e.y / kRadians, e.x / kRadians];
}

export const turned = ([x, y]: [number, number], degrees: number): [number, number] => {
  const c = Math.cos(degrees * kRadians),
    s = Math.sin(degrees * kRadians);
  return [c * x - s * y, s * x + c * y];
};

// The half-spaces whose intersection a shape is; none for a ball.
export function planesOf(shape: Shape): HalfSpace[] {
  if ('box' in shape) {
    const {min, max} = shape.box;
    return [0, 1, 2].flatMap(k => {
      const axis = [0, 0, 0] as Point;
      axis[k] = 1;
      return [
        {point: max, normal: axis},
        {point: min, normal: scale(axis, -1)},
      ];
    });
  }
  if ('turned_box' in shape) {
    const {centre, half, angles} = shape.turned_box;
    return axesOf(angles).flatMap((axis, k) =>
      [1, -1].map(sign => ({
        point: add(centre, scale(axis, sign * half[k]!)),
        normal: scale(axis, sign),
      })),
    );
  }
  if ('half_space' in shape) return [shape.half_space];
  if ('wedge' in shape) {
    const {apex, direction, angle, far} = shape.wedge;
    const [x, y] = direction;
    const side = (sign: number): HalfSpace => ({
      point: apex,
      normal: [...turned(direction, sign * (angle / 2 + 90)), 0],
    });
    return [side(1), side(-1), {point: add(apex, [x * far, y * far, 0]), normal: [x, y, 0]}];
  }
  return [];
}

// A half-space of the page, as the model has it.
export const halfSpaceOf = ({point, normal}: HalfSpace, stretch: Point): HalfSpace => ({
  point: toModel(point, stretch),
  normal: toPage(normal, stretch),
});

// What a shape is in a query.
export function regionOf(shape: Shape, stretch: Point = kNoStretch): Region {
  if ('box' in shape)
    return {box: {min: toModel(shape.box.min, stretch), max: toModel(shape.box.max, stretch)}};
  if ('half_space' in shape) return {half_space: halfSpaceOf(shape.half_space, stretch)};
  const even = stretch.every(s => s === 1);
  if ('sphere' in shape && even) return {sphere: shape.sphere};
  if ('wedge' in shape && even) {
    const {apex, direction, angle, far} = shape.wedge;
    return {wedge: {apex: [apex[0], apex[1]], direction, angle, far}};
  }
  const planes =
    'sphere' in shape ? planesAround(shape.sphere.centre, shape.sphere.radius) : planesOf(shape);
  return {polyhedron: planes.map(p => halfSpaceOf(p, stretch))};
}

// A polyhedron around a ball, which reaches 3 % farther: what a ball is to a model in degrees.
function planesAround(centre: Point, radius: number): HalfSpace[] {
  const n = 64,
    golden = Math.PI * (3 - Math.sqrt(5));
  return Array.from({length: n}, (_, i) => {
    const z = 1 - (2 * i + 1) / n,
      r = Math.sqrt(1 - z * z);
    const normal: Point = [r * Math.cos(golden * i), r * Math.sin(golden * i), z];
    return {point: add(centre, scale(normal, radius)), normal};
  });
}

// A shape to begin with, around `centre`; `forward` is where the camera looks.
export function newShape(kind: string, centre: Point, size: number, forward: Point): Shape | null {
  const half: Point = [size, size, size];
  if (kind === 'box') return {box: {min: sub(centre, half), max: add(centre, half)}};
  if (kind === 'turned_box') return {turned_box: {centre, half, angles: [30, 0, 0]}};
  if (kind === 'sphere') return {sphere: {centre, radius: size}};
  if (kind === 'half_space') return {half_space: {point: centre, normal: [1, 0, 0]}};
  if (kind === 'wedge') {
    const flat = Math.hypot(forward[0], forward[1]),
      direction: [number, number] = flat > 1e-3 ? [forward[0] / flat, forward[1] / flat] : [0, 1];
    return {
      wedge: {
        apex: sub(centre, [direction[0] * size * 2, direction[1] * size * 2, 0]),
        direction,
        angle: 50,
        far: size * 4,
      },
    };
  }
  return null;
}

export const titles: Record<string, string[]> = {
  box: ['x from', 'y from', 'z from', 'x to', 'y to', 'z to'],
  sphere: ['x', 'y', 'z', 'radius'],
  half_space: ['x', 'y', 'z', 'normal x', 'normal y', 'normal z'],
  turned_box: ['x', 'y', 'z', 'length', 'width', 'height', 'about z °', 'about y °', 'about x °'],
  wedge: ['x', 'y', 'z', 'heading °', 'angle °', 'far'],
};

// The numbers of a shape, as `titles` names them: points in the model's coordinates, lengths in the
// page's unit.
export function numbersOf(shape: Shape, stretch: Point): number[] {
  if ('box' in shape)
    return [...toModel(shape.box.min, stretch), ...toModel(shape.box.max, stretch)];
  if ('turned_box' in shape) {
    const {centre, half, angles} = shape.turned_box;
    return [...toModel(centre, stretch), ...scale(half, 2), ...angles];
  }
  if ('sphere' in shape) return [...toModel(shape.sphere.centre, stretch), shape.sphere.radius];
  if ('half_space' in shape)
    return [...toModel(shape.half_space.point, stretch), ...shape.half_space.normal];
  const {apex, direction, angle, far} = shape.wedge;
  return [
    ...toModel(apex, stretch),
    (Math.atan2(direction[0], direction[1]) / kRadians + 360) % 360,
    angle,
    far,
  ];
}

// Null for numbers that make none.
export function shapeOf(kind: string, n: number[], stretch: Point): Shape | null {
  if (n.length !== titles[kind]?.length || n.some(x => !Number.isFinite(x))) return null;
  const at = (i: number) => toPage([n[i], n[i + 1], n[i + 2]] as Point, stretch),
    vector = (i: number) => [n[i], n[i + 1], n[i + 2]] as Point;
  if (kind === 'box')
    return [0, 1, 2].every(k => n[k]! <= n[k + 3]!) ? {box: {min: at(0), max: at(3)}} : null;
  if (kind === 'turned_box')
    return [3, 4, 5].every(i => n[i]! >= 0)
      ? {turned_box: {centre: at(0), half: scale(vector(3), 0.5), angles: vector(6)}}
      : null;
  if (kind === 'sphere') return n[3]! >= 0 ? {sphere: {centre: at(0), radius: n[3]!}} : null;
  if (kind === 'half_space')
    return length(vector(3)) > 0 ? {half_space: {point: at(0), normal: unit(vector(3))}} : null;
  const heading = n[3]! * kRadians;
  return n[4]! > 0 && n[4]! < 180 && n[5]! > 0
    ? {
        wedge: {
          apex: at(0),
          direction: [Math.sin(heading), Math.cos(heading)],
          angle: n[4]!,
          far: n[5]!,
        },
      }
    : null;
}
