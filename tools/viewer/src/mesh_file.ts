// SPDX-License-Identifier: Apache-2.0
// Meshes as files, where no server writes them.
import type {Mesh} from '../../web/src/mtdb';

const names: Record<string, string> = {int8: 'char', uint8: 'uchar', int16: 'short', uint16: 'ushort', int32: 'int', uint32: 'uint', float32: 'float', float64: 'double'};

type Attribute = {name: string; type: string};

// Binary, little-endian; positions are double where float would move them.
function plyFile(mesh: Mesh, attributes: Attribute[]): Blob {
  const vertices = mesh.positions.length / 3, triangles = mesh.indices.length / 3;
  const wide = mesh.positions.some(x => Math.fround(x) !== x), size = wide ? 8 : 4;
  const row = 3 * size + mesh.rowBytes;
  const header = ['ply', 'format binary_little_endian 1.0', `element vertex ${vertices}`, ...['x', 'y', 'z'].map(axis => `property ${wide ? 'double' : 'float'} ${axis}`),
    ...attributes.map(a => `property ${names[a.type]} ${a.name.replace(/\s/g, '_')}`), `element face ${triangles}`, 'property list uchar int vertex_indices', 'end_header', ''].join('\n');
  const data = new Uint8Array(vertices * row), view = new DataView(data.buffer);
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
  for (let i = 0; i < mesh.positions.length; i += 3) add(`v ${mesh.positions[i]} ${mesh.positions[i + 1]} ${mesh.positions[i + 2]}\n`);
  for (let i = 0; i < mesh.indices.length; i += 3) add(`f ${mesh.indices[i]! + 1} ${mesh.indices[i + 1]! + 1} ${mesh.indices[i + 2]! + 1}\n`);
  return new Blob([...parts, lines.join('')]);
}

export function meshFile(mesh: Mesh, attributes: Attribute[], format: string): Blob {
  return format === 'obj' ? objFile(mesh) : plyFile(mesh, attributes);
}
