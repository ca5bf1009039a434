// SPDX-License-Identifier: Apache-2.0
// What the workers send of a mesh in slots: the elements of changed ranges, in arrays of their own.
import type {MeshUpdate, Slots, ValueChoice} from './source';

export const sizes: Record<string, number> = {
  int8: 1,
  uint8: 1,
  int16: 2,
  uint16: 2,
  int32: 4,
  uint32: 4,
  float32: 4,
  float64: 8,
};

// The elements of ranges of slots, `count` a slot.
export function gather<T extends Uint32Array | Float32Array | Int16Array>(
  Kind: new (length: number) => T,
  all: T,
  ranges: Uint32Array,
  count: number,
): Slots<T> {
  let size = 0;
  for (let i = 0; i < ranges.length; i += 2) size += ranges[i + 1]! - ranges[i]!;
  const data = new Kind(size * count);
  for (let i = 0, at = 0; i < ranges.length; i += 2) {
    data.set(all.subarray(ranges[i]! * count, ranges[i + 1]! * count) as never, at);
    at += (ranges[i + 1]! - ranges[i]!) * count;
  }
  return {ranges, data};
}

export const offsetsOf = (attributes: {type: string}[]) =>
  attributes.map((_, i) => attributes.slice(0, i).reduce((sum, a) => sum + sizes[a.type]!, 0));

export function reader(view: DataView, type: string): (at: number) => number {
  switch (type) {
    case 'int8':
      return at => view.getInt8(at);
    case 'uint8':
      return at => view.getUint8(at);
    case 'int16':
      return at => view.getInt16(at, true);
    case 'uint16':
      return at => view.getUint16(at, true);
    case 'int32':
      return at => view.getInt32(at, true);
    case 'uint32':
      return at => view.getUint32(at, true);
    case 'float32':
      return at => view.getFloat32(at, true);
    default:
      return at => view.getFloat64(at, true);
  }
}

export function writer(view: DataView, type: string): (at: number, value: number) => void {
  switch (type) {
    case 'int8':
      return (at, x) => view.setInt8(at, x);
    case 'uint8':
      return (at, x) => view.setUint8(at, x);
    case 'int16':
      return (at, x) => view.setInt16(at, x, true);
    case 'uint16':
      return (at, x) => view.setUint16(at, x, true);
    case 'int32':
      return (at, x) => view.setInt32(at, x, true);
    case 'uint32':
      return (at, x) => view.setUint32(at, x, true);
    case 'float32':
      return (at, x) => view.setFloat32(at, x, true);
    default:
      return (at, x) => view.setFloat64(at, x, true);
  }
}

// A colour's component as 0 .. 255.
const components: Record<string, (value: number) => number> = {
  uint8: v => v,
  uint16: v => v / 257,
  float32: v => v * 255,
  float64: v => v * 255,
};

// The attributes that the page wants to see, out of rows of all.
export class ValueReader {
  range: [number, number] | null = null; // of a scalar, so far
  private all = false; // vertices are to be told anew
  private values: ValueChoice = {kind: 'none'};

  constructor(private readonly types: string[]) {}

  choose(values: ValueChoice) {
    this.values = values;
    this.all = true;
    this.range = null;
  }

  private offsetOf(attribute: number) {
    let offset = 0;
    for (let i = 0; i < attribute; ++i) offset += sizes[this.types[i]!]!;
    return offset;
  }

  // Of the slots in `ranges`, or of all that there are when the choice is new.
  gather(
    rows: Uint8Array,
    rowBytes: number,
    slots: number,
    ranges: Uint32Array,
  ): MeshUpdate['values'] {
    const {values} = this;
    if ((values.kind !== 'colour' && values.kind !== 'scalar') || rowBytes === 0) return null;
    const all = this.all ? new Uint32Array([0, slots]) : ranges;
    this.all = false;
    let size = 0;
    for (let i = 0; i < all.length; i += 2) size += all[i + 1]! - all[i]!;
    const view = new DataView(rows.buffer, rows.byteOffset, slots * rowBytes);
    if (values.kind === 'colour') {
      const data = new Uint8Array(4 * size);
      const read = values.attributes.map(a => ({
        get: reader(view, this.types[a]!),
        offset: this.offsetOf(a),
        level: components[this.types[a]!] ?? ((v: number) => v),
      }));
      for (let i = 0, at = 0; i < all.length; i += 2) {
        for (let v = all[i]!; v < all[i + 1]!; ++v, at += 4) {
          for (let k = 0; k < 3; ++k)
            data[at + k] = Math.max(
              0,
              Math.min(255, read[k]!.level(read[k]!.get(v * rowBytes + read[k]!.offset))),
            );
          data[at + 3] = 255;
        }
      }
      return {ranges: all, data};
    }
    const data = new Float32Array(size);
    const get = reader(view, this.types[values.attribute]!);
    const offset = this.offsetOf(values.attribute);
    let [low, high] = this.range ?? [Infinity, -Infinity];
    for (let i = 0, at = 0; i < all.length; i += 2) {
      for (let v = all[i]!; v < all[i + 1]!; ++v, ++at) {
        const value = get(v * rowBytes + offset);
        data[at] = value;
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    this.range = low <= high ? [low, high] : null;
    return {ranges: all, data};
  }
}

export const buffersOf = (update: MeshUpdate) =>
  [
    update.indices,
    update.positions,
    update.normals,
    update.values,
    update.triangleValues,
    update.corners,
    update.pages,
  ].flatMap(s => (s ? [s.data.buffer] : []));
