// SPDX-License-Identifier: Apache-2.0
// Meshes as files, where no server writes them.
import type {Mesh} from '../../web/src/mtdb';
import {cross, sub, unit, type Point} from './query';
import {offsetsOf, reader} from './slots';

const names: Record<string, string> = {
  int8: 'char',
  uint8: 'uchar',
  int16: 'short',
  uint16: 'ushort',
  int32: 'int',
  uint32: 'uint',
  float32: 'float',
  float64: 'double',
};

type Attribute = {name: string; type: string};

// Binary, little-endian; positions are double where float would move them.
function plyFile(mesh: Mesh, attributes: Attribute[]): Blob {
  const vertices = mesh.positions.length / 3,
    triangles = mesh.indices.length / 3;
  const wide = mesh.positions.some(x => Math.fround(x) !== x),
    size = wide ? 8 : 4;
  const row = 3 * size + mesh.rowBytes;
  const header = [
    'ply',
    'format binary_little_endian 1.0',
    `element vertex ${vertices}`,
    ...['x', 'y', 'z'].map(axis => `property ${wide ? 'double' : 'float'} ${axis}`),
    ...attributes.map(a => `property ${names[a.type]} ${a.name.replace(/\s/g, '_')}`),
    `element face ${triangles}`,
    'property list uchar int vertex_indices',
    'end_header',
    '',
  ].join('\n');
  const data = new Uint8Array(vertices * row),
    view = new DataView(data.buffer);
  for (let v = 0; v < vertices; ++v) {
    for (let k = 0; k < 3; ++k) {
      const x = mesh.positions[3 * v + k]!;
      if (wide) view.setFloat64(v * row + 8 * k, x, true);
      else view.setFloat32(v * row + 4 * k, x, true);
    }
    data.set(mesh.rows.subarray(v * mesh.rowBytes, (v + 1) * mesh.rowBytes), v * row + 3 * size);
  }
  const faces = new DataView(new ArrayBuffer(13 * triangles));
  for (let t = 0; t < triangles; ++t) {
    faces.setUint8(13 * t, 3);
    for (let c = 0; c < 3; ++c) faces.setInt32(13 * t + 1 + 4 * c, mesh.indices[3 * t + c]!, true);
  }
  return new Blob([header, data, faces.buffer]);
}

function objFile(mesh: Mesh): Blob {
  const parts: string[] = [];
  let lines: string[] = [];
  const add = (line: string) => {
    lines.push(line);
    if (lines.length < 65536) return;
    parts.push(lines.join(''));
    lines = [];
  };
  for (let i = 0; i < mesh.positions.length; i += 3)
    add(`v ${mesh.positions[i]} ${mesh.positions[i + 1]} ${mesh.positions[i + 2]}\n`);
  for (let i = 0; i < mesh.indices.length; i += 3)
    add(`f ${mesh.indices[i]! + 1} ${mesh.indices[i + 1]! + 1} ${mesh.indices[i + 2]! + 1}\n`);
  return new Blob([...parts, lines.join('')]);
}

// As `mtdb extract` writes it, but for the order of the bytes: where float would move positions,
// they are relative to the node's translation. Colours of 8 bits are COLOR_0; other attributes are
// float, with names that begin with _.
function glbFile(mesh: Mesh, attributes: Attribute[]): Blob {
  const vertices = mesh.positions.length / 3,
    triangles = mesh.indices.length / 3;
  if (triangles === 0) return glb({asset, scene: 0, scenes: [{}]}, []);
  const wide = mesh.positions.some(x => Math.fround(x) !== x),
    origin = wide ? [...mesh.positions.subarray(0, 3)] : [0, 0, 0];
  const positions = Float32Array.from(mesh.positions, (x, i) => x - origin[i % 3]!),
    low = [Infinity, Infinity, Infinity],
    high = [-Infinity, -Infinity, -Infinity];
  positions.forEach((x, i) => {
    low[i % 3] = Math.min(low[i % 3]!, x);
    high[i % 3] = Math.max(high[i % 3]!, x);
  });
  const views: {array: Uint8Array; target: number; byteStride?: number}[] = [],
    accessors: object[] = [],
    named: Record<string, number> = {};
  const add = (
    array: Uint32Array | Float32Array | Uint8Array,
    target: number,
    accessor: object,
  ) => {
    views.push({array: new Uint8Array(array.buffer, array.byteOffset, array.byteLength), target});
    return accessors.push({bufferView: views.length - 1, ...accessor}) - 1;
  };
  add(mesh.indices, 34963, {componentType: 5125, count: 3 * triangles, type: 'SCALAR'});
  named.POSITION = add(positions, 34962, {
    componentType: 5126,
    count: vertices,
    type: 'VEC3',
    min: low,
    max: high,
  });
  const view = new DataView(mesh.rows.buffer, mesh.rows.byteOffset, mesh.rows.byteLength),
    offsets = offsetsOf(attributes);
  const bytesOf = (name: string) =>
    attributes.findIndex(a => a.name === name && a.type === 'uint8');
  const components = ['red', 'green', 'blue', ...(bytesOf('alpha') >= 0 ? ['alpha'] : [])].map(
      bytesOf,
    ),
    coloured = components.every(c => c >= 0);
  if (coloured) {
    const colours = new Uint8Array(4 * vertices);
    for (let v = 0; v < vertices; ++v)
      components.forEach(
        (c, k) => (colours[4 * v + k] = mesh.rows[v * mesh.rowBytes + offsets[c]!]!),
      );
    named.COLOR_0 = add(colours, 34962, {
      componentType: 5121,
      normalized: true,
      count: vertices,
      type: `VEC${components.length}`,
    });
    views.at(-1)!.byteStride = 4;
  }
  attributes.forEach((attribute, a) => {
    if (coloured && components.includes(a)) return;
    const get = reader(view, attribute.type),
      plain = '_' + attribute.name.toUpperCase().replace(/[^A-Z0-9]/g, '_');
    const values = Float32Array.from({length: vertices}, (_, v) =>
      get(v * mesh.rowBytes + offsets[a]!),
    ).map(x => (Number.isFinite(x) ? x : 0));
    let name = plain;
    for (let i = 2; name in named; ++i) name = `${plain}_${i}`;
    named[name] = add(values, 34962, {componentType: 5126, count: vertices, type: 'SCALAR'});
  });
  let at = 0;
  const bufferViews = views.map(({array, ...view}) => {
    at += array.length;
    return {buffer: 0, byteOffset: at - array.length, byteLength: array.length, ...view};
  });
  return glb(
    {
      asset,
      scene: 0,
      scenes: [{nodes: [0]}],
      nodes: [{mesh: 0, ...(wide ? {translation: origin} : {})}],
      materials: [{pbrMetallicRoughness: {metallicFactor: 0}, doubleSided: true}],
      meshes: [{primitives: [{attributes: named, indices: 0, material: 0}]}],
      accessors,
      bufferViews,
      buffers: [{byteLength: at}],
    },
    views.map(v => v.array),
  );
}
const asset = {version: '2.0', generator: 'mtdb'};

// The parts have lengths that are multiples of 4.
function glb(document: object, parts: Uint8Array[]): Blob {
  const text = new TextEncoder().encode(JSON.stringify(document)),
    spaces = ' '.repeat((4 - (text.length % 4)) % 4);
  const json = text.length + spaces.length,
    binary = parts.reduce((sum, part) => sum + part.length, 0);
  const words = (...list: number[]) => new Uint32Array(list);
  return new Blob([
    words(0x46546c67, 2, 20 + json + (binary > 0 ? 8 + binary : 0), json, 0x4e4f534a),
    text,
    spaces,
    ...(binary > 0 ? [words(binary, 0x004e4942), ...parts] : []),
  ] as BlobPart[]);
}

// Binary; positions are float, as the format has them.
function stlFile(mesh: Mesh): Blob {
  const triangles = mesh.indices.length / 3,
    view = new DataView(new ArrayBuffer(84 + 50 * triangles));
  new TextEncoder().encodeInto('mtdb', new Uint8Array(view.buffer));
  view.setUint32(80, triangles, true);
  for (let t = 0; t < triangles; ++t) {
    const [a, b, c] = [0, 1, 2].map(
      k =>
        [
          ...mesh.positions.subarray(
            3 * mesh.indices[3 * t + k]!,
            3 * mesh.indices[3 * t + k]! + 3,
          ),
        ] as Point,
    ) as [Point, Point, Point];
    [unit(cross(sub(b, a), sub(c, a))), a, b, c].forEach((p, i) =>
      p.forEach((x, k) => view.setFloat32(84 + 50 * t + 12 * i + 4 * k, x, true)),
    );
  }
  return new Blob([view.buffer]);
}

export function meshFile(mesh: Mesh, attributes: Attribute[], format: string): Blob {
  return format === 'stl'
    ? stlFile(mesh)
    : format === 'obj'
      ? objFile(mesh)
      : format === 'glb'
        ? glbFile(mesh, attributes)
        : plyFile(mesh, attributes);
}
