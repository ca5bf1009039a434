// SPDX-License-Identifier: Apache-2.0
// What is up. Objects say it (their record has it from ingest), and the user may say otherwise.
// The views are named after it as `mtdb render` names them.
import {add, cross, dot, scale, sub, unit, type Point} from './query';

export const kZUp: Point = [0, 0, 1];
export const upAxes: Record<string, Point> = {
  x: [1, 0, 0],
  y: [0, 1, 0],
  z: kZUp,
  '-x': [-1, 0, 0],
  '-y': [0, -1, 0],
  '-z': [0, 0, -1],
};

// Its name among the axes, or its numbers.
export const upName = (up: Point) =>
  Object.keys(upAxes).find(name => dot(upAxes[name]!, up) > 1 - 1e-9) ??
  up.map(x => x.toFixed(2)).join(' ');

// Directions of length 1 at right angles: `front` is where the viewer of the front looks.
export interface Basis {
  right: Point;
  front: Point;
  up: Point;
}

export function basisOf(up: Point): Basis {
  const u = unit(up),
    [x, y, z] = u.map(Math.abs) as Point;
  const look: Point = y > z && y > x ? [0, 0, -1] : [0, 1, 0];
  const front = unit(sub(look, scale(u, dot(look, u))));
  return {right: cross(front, u), front, up: u};
}

// From (right, front, up) to the page's coordinates.
export const inBasis = (b: Basis, [x, y, z]: Point): Point =>
  add(add(scale(b.right, x), scale(b.front, y)), scale(b.up, z));
