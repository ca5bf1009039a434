// SPDX-License-Identifier: Apache-2.0
// Triangles with corners of their own, in place of an indexed mesh: for what belongs to triangles
// and not to vertices.
import * as three from 'three';
import type {MeshUpdate, Slots} from './source';

const kGap = 256; // ranges of slots that are closer are sent to the card as one

// What faces are made from: the mesh's arrays, after an update.
export interface Indexed {
  index: ArrayLike<number>;
  positions: ArrayLike<number>;
  normals: ArrayLike<number>; // four a vertex
  triangleSlots: number;
}

// Slots in ascending order, as ranges.
class Written {
  readonly ranges: number[] = [];
  add(slot: number) {
    const {ranges} = this;
    if (ranges.length > 0 && slot < ranges.at(-1)! + kGap) ranges[ranges.length - 1] = slot + 1;
    else ranges.push(slot, slot + 1);
  }
}

function send(attribute: three.BufferAttribute, ranges: ArrayLike<number>, count: number) {
  for (let r = 0; r < ranges.length; r += 2)
    attribute.addUpdateRange(count * ranges[r]!, count * (ranges[r + 1]! - ranges[r]!));
  if (ranges.length > 0) attribute.needsUpdate = true;
}

abstract class Faces {
  readonly geometry = new three.BufferGeometry();
  private readonly places: three.BufferAttribute;

  constructor(readonly room: number) {
    this.places = this.attribute('position', new Float32Array(9 * room), 3);
  }

  protected attribute(
    name: string,
    array: Float32Array | Int16Array | Uint32Array,
    count: number,
    normalized = false,
  ) {
    const attribute = new three.BufferAttribute(array, count, normalized);
    attribute.setUsage(three.DynamicDrawUsage);
    this.geometry.setAttribute(name, attribute);
    return attribute;
  }

  // `changed`: slots whose triangles are others now, or all of them when the faces are new.
  protected writePlaces(mesh: Indexed, changed: ArrayLike<number>) {
    const to = this.places.array,
      {index, positions} = mesh;
    for (let r = 0; r < changed.length; r += 2) {
      for (let corner = 3 * changed[r]!; corner < 3 * changed[r + 1]!; ++corner) {
        for (let k = 0; k < 3; ++k) to[3 * corner + k] = positions[3 * index[corner]! + k]!;
      }
    }
    send(this.places, changed, 9);
    this.geometry.setDrawRange(0, 3 * mesh.triangleSlots);
  }

  // Whether they show what the update has.
  abstract takes(update: MeshUpdate): boolean;
  abstract write(update: MeshUpdate, mesh: Indexed, changed: ArrayLike<number>): void;
}

// Each triangle has a value; without normals, so they are flat.
export class ValuedFaces extends Faces {
  readonly values: Float32Array;
  private readonly scalar: three.BufferAttribute;

  constructor(room: number, before: Faces | null) {
    super(room);
    this.values = new Float32Array(3 * room);
    if (before instanceof ValuedFaces)
      this.values.set(before.values.subarray(0, Math.min(before.values.length, 3 * room)));
    this.scalar = this.attribute('scalar', this.values, 1);
  }

  takes(update: MeshUpdate) {
    return update.triangleValues !== null;
  }

  write(update: MeshUpdate, mesh: Indexed, changed: ArrayLike<number>) {
    const {ranges, data} = update.triangleValues!;
    for (let r = 0, at = 0; r < ranges.length; r += 2) {
      for (let i = ranges[r]!; i < ranges[r + 1]!; ++i)
        this.values.fill(data[at++]!, 3 * i, 3 * i + 3);
    }
    send(this.scalar, ranges, 3);
    this.writePlaces(mesh, changed);
  }
}

// Each corner lies somewhere on a page of a texture. Normals are those of the vertices.
export class TexturedFaces extends Faces {
  private readonly corner: three.BufferAttribute;
  private readonly page: three.BufferAttribute;
  private readonly normal: three.BufferAttribute;

  constructor(room: number, before: Faces | null) {
    super(room);
    this.corner = this.attribute('corner', new Float32Array(6 * room), 2);
    this.page = this.attribute('page', new Uint32Array(3 * room), 1);
    this.normal = this.attribute('normal', new Int16Array(12 * room), 4, true);
    if (!(before instanceof TexturedFaces)) return;
    for (const [to, from] of [
      [this.corner, before.corner],
      [this.page, before.page],
    ] as const)
      (to.array as Float32Array).set(
        (from.array as Float32Array).subarray(0, Math.min(from.array.length, to.array.length)),
      );
  }

  takes(update: MeshUpdate) {
    return update.corners !== null;
  }

  write(update: MeshUpdate, mesh: Indexed, changed: ArrayLike<number>) {
    const pages = this.page.array as Uint32Array,
      corners = this.corner.array as Float32Array,
      {ranges, data} = update.corners!;
    for (let r = 0, at = 0; r < ranges.length; r += 2) {
      const begin = ranges[r]!,
        end = ranges[r + 1]!;
      corners.set(data.subarray(6 * at, 6 * (at + end - begin)), 6 * begin);
      for (let i = begin; i < end; ++i) pages.fill(update.pages!.data[at++]!, 3 * i, 3 * i + 3);
    }
    send(this.corner, ranges, 6);
    send(this.page, ranges, 3);
    this.writePlaces(mesh, changed);
    this.writeNormals(mesh, changed, update.normals);
  }

  // Those of triangles that have not changed may be others, too.
  private writeNormals(mesh: Indexed, changed: ArrayLike<number>, touched: Slots<Int16Array>) {
    const {index, normals, triangleSlots} = mesh,
      to = this.normal.array,
      written = new Written();
    const copy = (triangle: number) => {
      let same = true;
      for (let corner = 3 * triangle; corner < 3 * triangle + 3; ++corner) {
        for (let k = 0, from = 4 * index[corner]!; k < 3; ++k) {
          same &&= to[4 * corner + k] === normals[from + k];
          to[4 * corner + k] = normals[from + k]!;
        }
      }
      if (!same) written.add(triangle);
    };
    const is = new Uint8Array(touched.ranges.at(-1) ?? 0);
    for (let r = 0; r < touched.ranges.length; r += 2)
      is.fill(1, touched.ranges[r], touched.ranges[r + 1]);
    let next = 0; // of `changed`
    for (let t = 0; t < triangleSlots; ++t) {
      while (next < changed.length && t >= changed[next + 1]!) next += 2;
      if (
        (next < changed.length && t >= changed[next]!) ||
        is[index[3 * t]!] ||
        is[index[3 * t + 1]!] ||
        is[index[3 * t + 2]!]
      )
        copy(t);
    }
    send(this.normal, written.ranges, 12);
  }
}
