// SPDX-License-Identifier: Apache-2.0
// node clients_test.mjs MTDB FOLDER: what `mtdb tile` writes, read by other people's programs: the
// Khronos validator, loaders.gl and the decoder of quantized-mesh that deck.gl uses. tools/tile_check
// runs a copy of it beside these packages.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {readFileSync, readdirSync, writeFileSync} from 'node:fs';
import {dirname, join} from 'node:path';
import quantizedMesh from '@here/quantized-mesh-decoder';
import {Tiles3DLoader} from '@loaders.gl/3d-tiles';
import {parse} from '@loaders.gl/core';
import validator from 'gltf-validator';

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

await checkThreeDTiles();
await checkColours();
await checkTerrain();
