// SPDX-License-Identifier: Apache-2.0
// node clients_test.mjs MTDB FOLDER: what `mtdb tile` writes, read by other people's programs: the
// Khronos validator, loaders.gl, the decoder of quantized-mesh that deck.gl uses, pmtiles, and
// neuroglancer's decoder. tools/tile_check runs a copy of it beside these packages.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {readFileSync, readdirSync, writeFileSync} from 'node:fs';
import {dirname, join} from 'node:path';
import {fileURLToPath} from 'node:url';
import quantizedMesh from '@here/quantized-mesh-decoder';
import {Tiles3DArchiveFileLoader, Tiles3DLoader} from '@loaders.gl/3d-tiles';
import {parse} from '@loaders.gl/core';
import validator from 'gltf-validator';
import {PMTiles} from 'pmtiles';
import {PNG} from 'pngjs';

const [mtdb, folder] = process.argv.slice(2);
const run = (...args) => execFileSync(mtdb, args, {cwd: folder, stdio: ['ignore', 'pipe', 'inherit']});
const bytesOf = path => {
  const b = readFileSync(join(folder, path));
  return b.buffer.slice(b.byteOffset, b.byteOffset + b.byteLength);
};
const filesOf = (path, suffix) => readdirSync(join(folder, path), {recursive: true})
  .filter(name => name.endsWith(suffix)).map(name => join(path, name));

async function validate(path) {
  const glbs = filesOf(path, '.glb');
  assert.ok(glbs.length > 0);
  for (const glb of glbs) {
    const {issues} = await validator.validateBytes(new Uint8Array(bytesOf(glb)));
    assert.equal(issues.numErrors + issues.numWarnings, 0, `${glb}: ${JSON.stringify(issues.messages)}`);
  }
  return glbs.length;
}

// The tiles of a tree as loaders.gl reads it: a list of {tile, path}, also those of the files that it
// names.
async function tilesOf(path) {
  const options = {'3d-tiles': {isTileset: true}, core: {worker: false}};
  const tileset = await parse(bytesOf(path), Tiles3DLoader, options);
  const list = [];
  const walk = async (tile, parent) => {
    if (parent) assert.ok(tile.geometricError <= parent.geometricError);
    const uri = tile.content?.uri;
    if (uri?.endsWith('.json')) {
      list.push(...await tilesOf(join(dirname(path), uri)));
    } else if (uri) {
      list.push({tile, path: join(dirname(path), uri)});
    }
    for (const child of tile.children ?? []) await walk(child, tile);
  };
  await walk(tileset.root);
  return list;
}

// A tile's triangles of the surface, without skirts, as texts that are equal where they are.
async function trianglesOf(path, step, origin) {
  const options = {'3d-tiles': {isTileset: false, loadGLTF: true}, core: {worker: false}, worker: false};
  const {gltf} = await parse(bytesOf(path), Tiles3DLoader, options);
  const {attributes, indices, extras} = gltf.meshes[0].primitives[0];
  const m = gltf.nodes[0].matrix, p = attributes.POSITION.value;
  const stride = p.length / attributes.POSITION.count;
  const corner = i => {
    const [x, y, z] = [0, 1, 2].map(c => p[stride * i + c]);
    const [gx, gy, gz] = [0, 1, 2].map(r => m[r] * x + m[4 + r] * y + m[8 + r] * z + m[12 + r]);
    return [gx, -gz, gy].map((v, c) => Math.round((v - origin[c]) / step)).join();
  };
  const list = [];
  for (let t = 0; t < extras.surfaceTriangles; ++t) {
    list.push(turned([0, 1, 2].map(c => corner(indices.value[3 * t + c]))));
  }
  return list;
}
const turned = t => [t, [t[1], t[2], t[0]], [t[2], t[0], t[1]]].map(a => a.join(';')).sort()[0];

function objTriangles(path, step, origin) {
  const corners = [], list = [];
  for (const line of readFileSync(join(folder, path), 'utf8').split('\n')) {
    const words = line.split(' ');
    if (words[0] === 'v') corners.push(words.slice(1, 4).map((w, c) => Math.round((Number(w) - origin[c]) / step)).join());
    if (words[0] === 'f') list.push(turned(words.slice(1).map(w => corners[Number(w) - 1])));
  }
  return list;
}

async function checkThreeDTiles() {
  run('generate', 'sculpture', 'a.ply', '--triangles', '60000');
  run('ingest', 'a.ply', 'a.mtdb', '--name', 'a', '--quiet');
  const answer = JSON.parse(run('tile', 'a.mtdb', 'a', '--tile-triangles', '2000', '--at=11.5,48,500', '--json'));
  assert.equal(await validate('a'), answer.tiles);
  const tiles = await tilesOf('a/tileset.json');
  assert.equal(tiles.length, answer.tiles);
  run('extract', 'a.mtdb', 'a.obj');
  const info = JSON.parse(run('info', 'a.mtdb', '--json')).objects[0];
  const origin = [info.bounds.min[0], info.bounds.min[1], info.bounds.min[2]];
  const finest = answer.levels.length - 1;
  const found = new Set();
  for (const {tile, path} of tiles) {
    const triangles = await trianglesOf(path, info.step, origin);
    assert.ok(triangles.length > 0);
    if (path.startsWith(`a/${finest}/`)) triangles.forEach(t => found.add(t));
    assert.ok(tile.boundingVolume.box.length === 12);
  }
  const wanted = new Set(objTriangles('a.obj', info.step, origin));
  assert.equal(found.size, wanted.size);
  for (const t of wanted) assert.ok(found.has(t));
  console.log(`3D Tiles: ${tiles.length} tiles are valid; the finest, put together, are the mesh`);
}

async function checkColours() {
  const n = 40;
  let text = `ply\nformat ascii 1.0\nelement vertex ${n * n}\n` + ['x', 'y', 'z'].map(a => `property float ${a}\n`).join('') +
    ['red', 'green', 'blue'].map(c => `property uchar ${c}\n`).join('') +
    `element face ${2 * (n - 1) * (n - 1)}\nproperty list uchar int vertex_indices\nend_header\n`;
  for (let j = 0; j < n; ++j) for (let i = 0; i < n; ++i) text += `${i} ${j} ${Math.fround(Math.sin(i * j / 50))} ${5 * i} ${5 * j} 200\n`;
  for (let j = 0; j + 1 < n; ++j) {
    for (let i = 0; i + 1 < n; ++i) {
      const a = j * n + i;
      text += `3 ${a} ${a + 1} ${a + n + 1}\n3 ${a} ${a + n + 1} ${a + n}\n`;
    }
  }
  writeFileSync(join(folder, 'c.ply'), text);
  run('ingest', 'c.ply', 'c.mtdb', '--lossless', '--quiet');
  run('tile', 'c.mtdb', 'c', '--tile-triangles', '300', '--quiet');
  const count = await validate('c');
  for (const {path} of await tilesOf('c/tileset.json')) {
    const {gltf} = await parse(bytesOf(path), Tiles3DLoader, {'3d-tiles': {isTileset: false, loadGLTF: true}, worker: false});
    assert.ok(gltf.meshes[0].primitives[0].attributes.COLOR_0.count > 0);
  }
  console.log(`3D Tiles with colours, lossless positions, and a border: ${count} tiles are valid`);
}

async function checkTerrain() {
  const n = 181;
  let text = `ncols ${n}\nnrows ${n}\nxllcenter 11\nyllcenter 47\ncellsize 0.001\n`;
  for (let j = 0; j < n; ++j) {
    text += Array.from({length: n}, (_, i) => Math.round(1200 + 700 * Math.sin(i / 20) * Math.cos(j / 17) + 90 * Math.sin(i * j / 99))).join(' ') + '\n';
  }
  writeFileSync(join(folder, 't.asc'), text);
  writeFileSync(join(folder, 't.prj'), 'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]');
  run('ingest', 't.asc', 't.mtdb', '--quiet');
  run('tile', 't.mtdb', 't3', '--tile-triangles', '4000', '--quiet');
  const threeD = await validate('t3');
  const answer = JSON.parse(run('tile', 't.mtdb', 'q', '--as', 'quantized-mesh', '--json'));
  const layer = JSON.parse(readFileSync(join(folder, 'q/layer.json'), 'utf8'));
  let count = 0;
  layer.available.forEach((ranges, level) => ranges.forEach(({startX, startY, endX, endY}) => {
    for (let x = startX; x <= endX; ++x) {
      for (let y = startY; y <= endY; ++y) {
        const tile = (quantizedMesh.default ?? quantizedMesh)(bytesOf(`q/${level}/${x}/${y}.terrain`));
        const vertices = tile.vertexData.length / 3;
        assert.ok(tile.triangleIndices.every(v => v < vertices));
        assert.equal(tile.extensions.vertexNormals.length, 2 * vertices);
        for (const v of tile.westIndices) assert.equal(tile.vertexData[v], 0);
        for (const v of tile.eastIndices) assert.equal(tile.vertexData[v], 32767);
        for (const v of tile.southIndices) assert.equal(tile.vertexData[vertices + v], 0);
        for (const v of tile.northIndices) assert.equal(tile.vertexData[vertices + v], 32767);
        ++count;
      }
    }
  }));
  assert.equal(count, answer.tiles);
  console.log(`terrain: ${threeD} tiles of glTF are valid, ${count} of quantized-mesh are read`);
}

// Each file of the folder is in the archive, where loaders.gl finds it by the index.
async function checkArchive() {
  run('tile', 'a.mtdb', 'a.3tz', '--tile-triangles', '2000', '--at=11.5,48,500', '--quiet');
  const archive = bytesOf('a.3tz');
  const names = ['tileset.json', ...filesOf('a', '.glb').map(name => name.slice(2))];
  for (const name of names) {
    const found = await Tiles3DArchiveFileLoader.parse(archive, {'3d-tiles-archive': {path: name}});
    assert.deepEqual(new Uint8Array(found), new Uint8Array(bytesOf(join('a', name))), name);
  }
  console.log(`.3tz: loaders.gl finds ${names.length} files by the index`);
}

// The archive's tiles, as the package pmtiles finds them, are those of the folder, and heights are
// those of the terrain, within the bound that is stated.
async function checkHeights() {
  for (const [encoding, height] of [
    ['terrarium', (r, g, b) => r * 256 + g + b / 256 - 32768],
    ['mapbox', (r, g, b) => -10000 + (r * 65536 + g * 256 + b) * 0.1]]) {
    run('tile', 't.mtdb', encoding, '--as', 'terrain-rgb', '--encoding', encoding, '--quiet');
    run('tile', 't.mtdb', encoding + '.pmtiles', '--as', 'terrain-rgb', '--encoding', encoding, '--quiet');
    const file = bytesOf(encoding + '.pmtiles');
    const archive = new PMTiles({getKey: () => encoding, getBytes: async (offset, length) => ({data: file.slice(offset, offset + length)})});
    const header = await archive.getHeader(), metadata = await archive.getMetadata();
    const tiles = filesOf(encoding, '.png');
    assert.equal(header.numAddressedTiles, tiles.length);
    assert.deepEqual([header.tileType, header.clustered, header.minZoom], [2, true, 0]);
    assert.equal(metadata.encoding, encoding);
    const places = [], heights = [];
    for (const tile of tiles) {
      const [z, x, y] = tile.split('/').slice(1).map(part => parseInt(part));
      const {data} = await archive.getZxy(z, x, y);
      assert.deepEqual(new Uint8Array(data), new Uint8Array(bytesOf(tile)), tile);
      if (z !== header.maxZoom) continue;
      const png = PNG.sync.read(Buffer.from(data));
      assert.deepEqual([png.width, png.height], [256, 256]);
      for (let i = 0; i < 65536; i += 997) {
        const column = (x * 256 + i % 256 + 0.5) / 256 / 2 ** z, row = (y * 256 + Math.floor(i / 256) + 0.5) / 256 / 2 ** z;
        const latitude = Math.atan(Math.sinh(Math.PI * (1 - 2 * row))) * 180 / Math.PI;
        places.push(`${column * 360 - 180},${latitude}`);
        heights.push(height(...png.data.slice(4 * i, 4 * i + 3)));
      }
    }
    assert.equal(await archive.getZxy(header.maxZoom, 0, 0), undefined);
    writeFileSync(join(folder, 'places'), places.join('\n') + '\n');
    const bound = metadata.errorBounds[header.maxZoom];
    let known = 0, farthest = 0;
    JSON.parse(run('probe', 't.mtdb', '--heights', 'places', '--json')).heights.forEach((found, i) => {
      if (found.height === null) return;
      ++known;
      farthest = Math.max(farthest, Math.abs(found.height - heights[i]));
    });
    assert.ok(known > 100 && farthest <= bound, `${known} places, ${farthest} m off, not ${bound}`);
    console.log(`${encoding}: ${tiles.length} tiles of PMTiles are those of the folder; ${known} heights are at most ${farthest.toFixed(2)} m off, ${bound.toFixed(2)} is stated`);
  }
}

// neuroglancer's own decoder takes each fragment apart.
async function checkNeuroglancer() {
  const wasm = join(dirname(fileURLToPath(import.meta.url)), 'node_modules/neuroglancer/lib/mesh/draco/neuroglancer_draco.wasm');
  let decoded, parts, exports;
  const words = (at, count) => new Uint32Array(exports.memory.buffer, at, count).slice();
  const env = {
    emscripten_notify_memory_growth() {},
    proc_exit(code) { throw new Error(`exit ${code}`); },
    neuroglancer_draco_receive_decoded_mesh(faces, vertices, indices, positions, offsets) {
      decoded = {indices: words(indices, 3 * faces), positions: words(positions, 3 * vertices), offsets: words(offsets, parts + 1)};
    },
  };
  ({exports} = (await WebAssembly.instantiate(readFileSync(wasm), {env, wasi_snapshot_preview1: env})).instance);
  exports._initialize();
  for (const bits of [16, 10]) {
    const tree = `n${bits}`;
    run('tile', 'a.mtdb', tree, '--as', 'neuroglancer', '--tile-triangles', '1000', '--bits', String(bits), '--quiet');
    const index = new DataView(bytesOf(`${tree}/1.index`)), data = new Uint8Array(bytesOf(`${tree}/1`));
    const lods = index.getUint32(24, true);
    let at = 28 + 16 * lods, begin = 0, fragments = 0;
    const counts = Array.from({length: lods}, (_, lod) => index.getUint32(at + 4 * lod, true));
    at += 4 * lods;
    const middle = 2 ** (bits - 1);
    counts.forEach((count, lod) => {
      for (let i = 0; i < count; ++i) {
        const size = index.getUint32(at + 12 * count + 4 * i, true);
        if (size === 0) continue;
        parts = lod > 0 ? 8 : 1;
        const heap = exports.malloc(size);
        new Uint8Array(exports.memory.buffer).set(data.subarray(begin, begin + size), heap);
        assert.equal(exports.neuroglancer_draco_decode(heap, size, lod > 0, bits, true), 0);
        begin += size;
        ++fragments;
        assert.equal(decoded.offsets[parts], decoded.indices.length);
        for (let part = 0; lod > 0 && part < 8; ++part) {
          for (let v = decoded.offsets[part]; v < decoded.offsets[part + 1]; ++v) {
            for (let axis = 0; axis < 3; ++axis) {
              const q = decoded.positions[3 * decoded.indices[v] + axis];
              assert.ok(q < 2 ** bits && (part >> axis & 1 ? q >= middle : q <= middle), 'a triangle crosses the middle');
            }
          }
        }
      }
      at += 16 * count;
    });
    assert.equal(begin, data.length);
    assert.equal(at, index.byteLength);
    console.log(`neuroglancer, ${bits} bits: its decoder takes ${fragments} fragments of ${lods} levels apart`);
  }
}

await checkThreeDTiles();
await checkColours();
await checkTerrain();
await checkArchive();
await checkHeights();
await checkNeuroglancer();
