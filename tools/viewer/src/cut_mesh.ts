// SPDX-License-Identifier: Apache-2.0
// A mesh cut along planes: triangles that a plane crosses are divided there, and attributes are
// interpolated along the edges that it crosses.
import type {Mesh} from '../../web/src/mtdb';
import {offsetsOf, reader, sizes, writer} from './slots';
import {dot, type HalfSpace, type Point} from './query';

// What of `mesh` is inside of all half-spaces. Vertices on a plane stay where they are, and new
// ones are shared by the triangles of their edge: what was conforming stays so.
export function cutMesh(mesh: Mesh, attributes: {type: string}[], planes: HalfSpace[]): Mesh {
  return planes.reduce((m, plane) => cutByPlane(m, attributes, plane), mesh);
}

function cutByPlane(mesh: Mesh, attributes: {type: string}[], {point, normal}: HalfSpace): Mesh {
  const count = mesh.positions.length / 3,
    sides = new Float64Array(count);
  const at = (v: number): Point => [
    mesh.positions[3 * v]!,
    mesh.positions[3 * v + 1]!,
    mesh.positions[3 * v + 2]!,
  ];
  for (let v = 0; v < count; ++v)
    sides[v] = dot([at(v)[0] - point[0], at(v)[1] - point[1], at(v)[2] - point[2]], normal);
  if (sides.every(s => s <= 0)) return mesh;
  const ends: [number, number][] = [],
    made = new Map<number, number>(),
    corners: number[] = []; // a vertex of the old mesh, or count + one of `ends`
  const between = (a: number, b: number) => {
    const [low, high] = a < b ? [a, b] : [b, a],
      key = low * count + high;
    let vertex = made.get(key);
    if (vertex === undefined) made.set(key, (vertex = count + ends.push([low, high]) - 1));
    return vertex;
  };
  for (let t = 0; t < mesh.indices.length; t += 3) {
    const kept: number[] = [];
    for (let c = 0; c < 3; ++c) {
      const a = mesh.indices[t + c]!,
        b = mesh.indices[t + ((c + 1) % 3)]!;
      if (sides[a]! <= 0) kept.push(a);
      if ((sides[a]! < 0 && sides[b]! > 0) || (sides[a]! > 0 && sides[b]! < 0))
        kept.push(between(a, b));
    }
    for (let c = 2; c < kept.length; ++c) corners.push(kept[0]!, kept[c - 1]!, kept[c]!);
  }
  return gathered(mesh, attributes, corners, ends, sides);
}

function gathered(
  mesh: Mesh,
  attributes: {type: string}[],
  corners: number[],
  ends: [number, number][],
  sides: Float64Array,
): Mesh {
  const count = mesh.positions.length / 3,
    numbers = new Map<number, number>();
  const indices = Uint32Array.from(corners, v => {
    if (!numbers.has(v)) numbers.set(v, numbers.size);
    return numbers.get(v)!;
  });
  const positions = new Float64Array(3 * numbers.size),
    rows = new Uint8Array(mesh.rowBytes * numbers.size);
  const from = new DataView(mesh.rows.buffer, mesh.rows.byteOffset, mesh.rows.byteLength),
    to = new DataView(rows.buffer),
    offsets = offsetsOf(attributes);
  const values = attributes.map(({type}, i) => ({
    get: reader(from, type),
    set: writer(to, type),
    offset: offsets[i]!,
    whole: !type.startsWith('float'),
    bytes: sizes[type]!,
  }));
  for (const [v, n] of numbers) {
    const [a, b] = v < count ? [v, v] : ends[v - count]!,
      part = a === b ? 0 : sides[a]! / (sides[a]! - sides[b]!);
    const mixed = (x: number, y: number) => (x === y ? x : x + (y - x) * part);
    for (let k = 0; k < 3; ++k)
      positions[3 * n + k] = mixed(mesh.positions[3 * a + k]!, mesh.positions[3 * b + k]!);
    for (const {get, set, offset, whole} of values) {
      const value = mixed(get(a * mesh.rowBytes + offset), get(b * mesh.rowBytes + offset));
      set(n * mesh.rowBytes + offset, whole ? Math.round(value) : value);
    }
  }
  return {...mesh, indices, positions, rows};
}
