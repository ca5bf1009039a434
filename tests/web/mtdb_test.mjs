// SPDX-License-Identifier: Apache-2.0
// node mtdb_test.mjs PACKAGE MTDB FOLDER: the package mtdb against `mtdb extract`, over a server of
// ranges that is late, out of order, or broken.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {randomBytes} from 'node:crypto';
import {readFileSync, writeFileSync} from 'node:fs';
import {createServer} from 'node:http';
import {join} from 'node:path';
import {pathToFileURL} from 'node:url';
import {png} from '../viewer/png.mjs';

const [made, mtdb, folder] = process.argv.slice(2);
const {openFile, MtdbError, kNoPage} = await import(pathToFileURL(join(made, 'mtdb.js')));
const wasm = readFileSync(join(made, 'engine.wasm'));
const run = (...args) => execFileSync(mtdb, args, {cwd: folder, stdio: ['ignore', 'pipe', 'inherit']});

run('generate', 'sculpture', 'a.ply', '--triangles', '60000');
run('ingest', 'a.ply', 'a.mtdb', '--name', 'a');
run('pack', 'a.mtdb', 'a.mtdbp');
const bytes = readFileSync(join(folder, 'a.mtdbp'));
let served = bytes;

// What the server does with a request: null, or a function of (response).
let rule = () => null;
let etag = '"1"';
const seen = {requests: 0, aborted: 0};
const server = createServer((request, response) => {
  ++seen.requests;
  response.on('close', () => { if (!response.writableEnded) ++seen.aborted; });
  const special = rule(request);
  if (special) return special(response);
  const [, begin, end] = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range).map(Number);
  const body = served.subarray(begin, Math.min(end + 1, served.length));
  setTimeout(() => {
    response.writeHead(206, {'Content-Range': `bytes ${begin}-${begin + body.length - 1}/${served.length}`, 'Content-Length': body.length, ETag: etag});
    response.end(body);
  }, Math.random() * 10);
});
await new Promise(done => server.listen(0, '127.0.0.1', done));
const url = `http://127.0.0.1:${server.address().port}/a.mtdbp`;
const open = (options = {}) => openFile(url, {wasm, ...options});

function trianglesOf(object, clipped = false) {
  const {indices, positions, origin, normals} = object.changes();
  const corner = v => [0, 1, 2].map(k => positions[3 * v + k] + origin[k]);
  const list = [];
  for (let i = 0; i < indices.length; i += 3) {
    if (indices[i] !== indices[i + 1]) list.push([corner(indices[i]), corner(indices[i + 1]), corner(indices[i + 2])]);
  }
  assert.equal(normals.length, positions.length / 3 * 4);
  if (!clipped) checkNormals({indices, positions, normals});
  return list;
}
// Those of all triangles at each vertex, however few of them the last update touched.
function checkNormals({indices, positions, normals}) {
  const sums = new Float64Array(positions.length);
  for (let i = 0; i < indices.length; i += 3) {
    const [a, b, c] = [0, 1, 2].map(k => [0, 1, 2].map(x => positions[3 * indices[i + k] + x]));
    const u = b.map((x, k) => x - a[k]), v = c.map((x, k) => x - a[k]);
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    for (let k = 0; k < 9; ++k) sums[3 * indices[i + Math.floor(k / 3)] + k % 3] += n[k % 3];
  }
  for (let v = 0; v < positions.length / 3; ++v) {
    const n = sums.subarray(3 * v, 3 * v + 3), length = Math.hypot(...n);
    if (length > 1e-9) for (let k = 0; k < 3; ++k) assert.ok(Math.abs(normals[4 * v + k] - (n[k] / length) * 32767) < 40, `normal of ${v}: ${normals.slice(4 * v, 4 * v + 3)}, not ${n.map(x => (x / length) * 32767)}`);
  }
}
function extracted(query) {
  writeFileSync(join(folder, 'query.json'), JSON.stringify(query));
  run('extract', 'a.mtdb', 'out.obj', '--query', 'query.json');
  const vertices = [], triangles = [];
  for (const line of readFileSync(join(folder, 'out.obj'), 'utf8').split('\n')) {
    const part = line.split(' ');
    if (part[0] === 'v') vertices.push(part.slice(1, 4).map(Number));
    if (part[0] === 'f') triangles.push(part.slice(1, 4).map(v => vertices[parseInt(v) - 1]));
  }
  return triangles;
}
// Makes triangles texts by the vertices of `expected`, whichever corner comes first. Positions that are float32 from
// different origins differ by less than a hundredth of the grid's step.
function namesBy(expected) {
  const step = info.rounding_error, ids = new Map();
  const cells = p => p.map(x => Math.floor(x / step));
  for (const p of expected.flat()) {
    const key = cells(p).join();
    if (!ids.has(key)) ids.set(key, []);
    if (!ids.get(key).some(v => v.every((x, k) => x === p[k]))) ids.get(key).push(p);
  }
  const near = p => {
    const [i, j, k] = cells(p);
    for (const a of [i, i - 1, i + 1]) for (const b of [j, j - 1, j + 1]) for (const c of [k, k - 1, k + 1]) {
      const found = ids.get(`${a},${b},${c}`)?.find(v => v.every((x, n) => Math.abs(x - p[n]) < 0.05 * step));
      if (found) return found.join(' ');
    }
    return assert.fail(`no vertex at ${p}`);
  };
  return triangles => triangles.map(t => {
    const corners = t.map(near), least = corners.indexOf(corners.slice().sort()[0]);
    return [0, 1, 2].map(k => corners[(least + k) % 3]).join(', ');
  });
}
// The same triangles, whatever their order.
function assertSame(triangles, expected) {
  const names = namesBy(expected);
  assert.deepEqual(names(triangles).sort(), names(expected).sort());
}

const info = (await open()).objects[0];
const {min, max} = info.bounds;
const centre = [0, 1, 2].map(k => (min[k] + max[k]) / 2);
const camera = {eye: [centre[0], centre[1] - 1.2 * info.diagonal, centre[2]], target: centre, fov: 45, viewport: [640, 480]};
const queries = [
  {threshold: 'coarsest'},
  {region: {frustum: camera}, threshold: {screen: {camera, pixels: 1}}},
  {region: {sphere: {centre: max, radius: 0.4 * info.diagonal}}},
  {threshold: 0.002 * info.diagonal},
];

{
  const object = await (await open()).open('a');
  for (const milliseconds of [undefined, 0]) {
    for (const query of queries) {
      let last = 0;
      const frame = await object.settle(query, f => { last = f.triangles; }, {milliseconds});
      assert.equal(frame.limit, 'accuracy');
      const triangles = trianglesOf(object);
      assert.equal(triangles.length, frame.triangles);
      const expected = extracted(query);
      assert.equal(triangles.length, expected.length);
      assertSame(triangles, expected);
      assert.ok(last === 0 || last === frame.triangles);
    }
  }
  object.close();
  assert.throws(() => object.update(queries[0]), {code: 'closed'});
}
console.log('the same triangles as mtdb extract');

{
  // Queries that follow each other while clusters come: as long as there is room, whatever is missing is on its way.
  for (let round = 0; round < 4; ++round) {
    const object = await (await open()).open('a');
    for (let i = 0; i < 60; ++i) {
      const angle = i >> 2, eye = [centre[0] + Math.sin(angle) * info.diagonal, centre[1] - Math.cos(angle) * info.diagonal, centre[2]];
      const view = {...camera, eye}, frame = object.update({region: {frustum: view}, threshold: {screen: {camera: view, pixels: i % 3 ? 0.2 : 2}}}, round > 1 ? 1 : 0);
      assert.ok(!frame || frame.limit !== 'missing' || object.pending > 0, JSON.stringify(frame));
      // All that is on its way comes before the next call, which has no time for all of it.
      if (round > 0) await new Promise(done => setTimeout(done, Math.random() < 0.3 ? 15 : 1));
      else while (object.pending > 0) await new Promise(done => setTimeout(done, 1));
    }
    object.close();
  }
}
console.log('what is missing is on its way');

{
  // What is known of each triangle, against meshes of other thresholds: there is none of which more is wrong than is
  // asked for, and the largest error is the mesh's.
  const names = namesBy(extracted({})), object = await (await open()).open('a');
  const frame = await object.settle({threshold: 0.0005 * info.diagonal});
  const triangles = names(trianglesOf(object)), {indices} = object.changes(), facts = object.triangleFacts();
  const slots = Array.from({length: frame.triangleSlots}, (_, i) => i).filter(i => indices[3 * i] !== indices[3 * i + 1]);
  const all = slots.map((slot, i) => ({name: triangles[i], error: Math.abs(facts.errors[slot]), exact: facts.errors[slot] > 0, cluster: facts.clusters[slot], round: facts.rounds[slot]}));
  assert.equal(all.length, frame.triangles);
  assert.equal(Math.max(...all.map(t => t.error)), Math.fround(frame.errorBound));
  for (const t of all) assert.ok(t.cluster < info.clusters ? t.round >= 1 && t.round <= info.rounds : t.round === 255, JSON.stringify(t));
  assert.ok(new Set(all.map(t => t.cluster)).size > 1 && new Set(all.map(t => t.round)).size > 1, JSON.stringify([all.length, new Set(all.map(t => t.cluster)).size, all.filter(t => t.exact).length]));
  const errors = all.filter(t => t.exact).map(t => t.error).sort((a, b) => a - b);
  let stay = 0, gone = 0;
  for (const share of [0.2, 0.4, 0.6, 0.8, 0.95]) {
    const threshold = errors[Math.floor(share * errors.length)] * (1 + 1e-6), there = new Set(names(extracted({threshold})));
    for (const t of all) {
      if (t.exact && t.error > threshold * (1 + 1e-6)) assert.ok(!there.has(t.name), `${t.name}: ${t.error}, with ${threshold}`);
      if (there.has(t.name)) ++stay;
      else ++gone;
    }
  }
  assert.ok(stay > 1000 && gone > 1000, `${stay} ${gone}`);
  object.close();
}
console.log('the errors of triangles are those of mtdb');

{
  // What a ray meets, and meshes that are clipped, beside a mesh that is shown.
  const object = await (await open()).open('a');
  object.update(queries[1], 0);
  const rays = [[camera.eye, [0, 1, 0]], [max, min.map((x, k) => x - max[k])], [[0.1 * max[0], 0.2 * min[1], 2 * max[2]], [0, 0, -1]], [camera.eye, [0, -1, 0]]];
  const hits = await Promise.all(rays.map(([origin, direction]) => object.castRay(origin, direction)));
  rays.forEach(([origin, direction], i) => {
    const found = JSON.parse(run('probe', 'a.mtdb', `--ray=${[...origin, ...direction]}`, '--json').toString());
    assert.equal(hits[i] !== null, found.hit);
    if (!hits[i]) return;
    assert.deepEqual(hits[i].point, found.point);
    assert.equal(hits[i].errorBound, found.error_bound);
  });
  assert.ok(hits.some(h => h) && hits.some(h => !h));
  const clipped = {...queries[2], clip: true};
  const expected = extracted(clipped);
  const mesh = await object.extract(clipped);
  const corner = v => [...mesh.positions.subarray(3 * v, 3 * v + 3)];
  const triangles = Array.from({length: mesh.indices.length / 3}, (_, t) => [0, 1, 2].map(k => corner(mesh.indices[3 * t + k])));
  assert.equal(triangles.length, expected.length);
  assertSame(triangles, expected);
  // Clipped and not, in turn: slots of what is cut away are empty.
  for (const query of [clipped, queries[2], queries[3], {...clipped, region: {sphere: {centre: min, radius: 0.5 * info.diagonal}}}, clipped, queries[1]]) {
    const frame = await object.settle(query);
    const shown = trianglesOf(object, query.clip === true);
    assert.equal(shown.length, frame.triangles);
    assertSame(shown, extracted(query));
  }
  await assert.rejects(object.castRay([0, 0, 0], [0, 0, 0]), {code: 'invalid_argument'});
  const aborted = new AbortController();
  aborted.abort();
  await assert.rejects(object.extract({}, aborted.signal), {code: 'aborted'});
  object.close();
  await assert.rejects(object.castRay([0, 0, 0], [1, 0, 0]), {code: 'closed'});
}
{
  // A limit of bytes a second: the requests are spread over the time that they take.
  const lengths = [], begin = performance.now();
  const spy = (u, o) => {
    const [a, b] = o.headers.Range.slice(6).split('-').map(Number);
    lengths.push(b - a + 1);
    return fetch(u, o);
  };
  const slow = await (await open({bytesPerSecond: 300000, fetch: spy})).open();
  await slow.settle({});
  const seconds = (performance.now() - begin) / 1000, before = lengths.slice(0, -1).reduce((a, b) => a + b, 0);
  assert.ok(lengths.length > 1 && seconds > 0.95 * before / 300000, `${lengths} bytes in ${seconds} s`);
  slow.close();
  // Further ranges from a URL that the ETag names.
  const asked = [];
  const other = await (await openFile(url, {wasm, urlOf: tag => `${url}?hash=${tag.replaceAll('"', '')}`, fetch: (u, o) => { asked.push(String(u)); return fetch(u, o); }})).open();
  await other.settle({});
  assert.ok(asked[0] === url && asked.length > 1 && asked.slice(1).every(u => u === `${url}?hash=1`), asked.join());
  other.close();
}

{
  // A coarse mesh at once, and a finer one as clusters come; errors on the way are tried again.
  let count = 0;
  rule = () => (++count % 3 === 0 ? response => { response.writeHead(503); response.end(); } : null);
  const object = await (await open()).open();
  const bounds = [];
  await object.settle({threshold: 0.0005 * info.diagonal}, frame => bounds.push(frame.errorBound));
  assert.ok(bounds.length > 0 && bounds[0] >= bounds.at(-1));
  object.close();
}
rule = () => null;
{
  // Requests for what is not wanted any more end; nothing is left over.
  const object = await (await open()).open();
  await object.settle(queries[0]);
  rule = () => response => { setTimeout(() => { if (!response.destroyed) response.end(); }, 60000).unref(); };
  object.update({});
  assert.ok(object.pending > 0);
  object.update(queries[0]);
  assert.equal(object.pending, 0);
  object.update({});
  object.close();
  assert.equal(object.pending, 0);
  rule = () => null;
}
{
  // Budgets hold.
  const most = 100000;
  const object = await (await open({maxBytes: most})).open();
  await assert.rejects(object.settle({}), {code: 'budget'});
  const frame = object.update({});
  assert.ok(frame.triangles > 0 && frame.triangles < info.triangles && frame.bytesRead <= most && frame.limit === 'missing' && frame.errorBound > 0);
  const small = await (await open()).open(undefined, {cacheBytes: 2 ** 20});
  const coarse = await small.settle({});
  assert.ok(coarse.limit === 'missing' && coarse.cacheBytes <= 2 ** 20 && coarse.triangles > 0 && coarse.triangles < info.triangles);
  const limited = await small.settle({threshold: 0, max_triangles: 5000});
  assert.ok(limited.triangles <= 5000);
}
{
  // Each has one error with a code.
  await assert.rejects(openFile(url.replace('127.0.0.1', '127.0.0.2').replace(/:\d+/, ':1'), {wasm}), {code: 'io'});
  rule = () => response => { response.writeHead(404); response.end(); };
  await assert.rejects(open(), {code: 'not_found'});
  // A server that sends no parts: small files are taken whole, by one request.
  rule = () => response => { response.writeHead(200); response.end(bytes); };
  const before = seen.requests, whole = await (await open()).open();
  assert.equal((await whole.settle({})).triangles, info.triangles);
  assert.equal(seen.requests, before + 1);
  whole.close();
  await assert.rejects(open({maxBytes: 100000}), {code: 'budget'});
  rule = () => response => { response.writeHead(200, {'Content-Length': 65e6}); response.write(bytes); };
  await assert.rejects(open(), error => error.code === 'unsupported' && /64 MB/.test(error.message));
  rule = () => response => { response.writeHead(200, {'Content-Length': bytes.length}); response.end(bytes.subarray(0, 1000)); };
  await assert.rejects(open(), {code: 'io'});
  rule = () => null;
  await assert.rejects((await open()).open('b'), {code: 'not_found'});
  const object = await (await open()).open();
  assert.throws(() => object.update({threshold: 'rough'}), error => error instanceof MtdbError && error.code === 'invalid_argument');
  await object.settle(queries[0]);
  etag = '"2"';
  await assert.rejects(object.settle({}), error => /replaced/.test(error.message));
  etag = '"1"';
  object.retry();
  assert.equal((await object.settle({})).triangles, info.triangles);
  // A byte that flipped on the way is found.
  const other = await (await open()).open();
  bytes[bytes.length - 5000] ^= 1;
  await assert.rejects(other.settle({}), {name: 'MtdbError'});
}
{
  // Corners of textured objects, wherever the mesh moved before, and the bytes of their images. A wavy sheet with two
  // charts on pages of their own, and a part without one; all lies on multiples of 1/64.
  const n = 64, lines = ['mtllib t.mtl'], images = {'left.png': png(8, 4, (x, y) => [x, y, 0, 255]), 'right.png': png(200, 200, () => [...randomBytes(4)])};
  const chart = x => (x < 24 ? 'left' : x < 48 ? 'right' : 'bare');
  for (let i = 0; i < n * n; ++i) lines.push(`v ${i % n} ${Math.floor(i / n)} ${Math.round(256 * Math.sin((i % n) / 5) * Math.cos(i / n / 7)) / 64}`);
  for (let i = 0; i < n * n; ++i) lines.push(`vt ${(i % n) / n} ${Math.floor(i / n) / 2 / n}`);
  for (let i = 0; i < n * n; ++i) lines.push(`vt ${(i % n) / 2 / n + 0.5} ${2 - Math.floor(i / n) / n}`);
  for (let x = 0; x + 1 < n; ++x) {
    lines.push(`usemtl ${chart(x)}`);
    for (let y = 0; y + 1 < n; ++y) {
      const corner = v => (chart(x) === 'bare' ? `${v + 1}` : `${v + 1}/${v + 1 + (chart(x) === 'right' ? n * n : 0)}`);
      const [a, b, c, d] = [y * n + x, y * n + x + 1, y * n + x + n + 1, y * n + x + n].map(corner);
      lines.push(`f ${a} ${b} ${c}`, `f ${a} ${c} ${d}`);
    }
  }
  writeFileSync(join(folder, 't.obj'), lines.join('\n') + '\n');
  writeFileSync(join(folder, 't.mtl'), 'newmtl left\nmap_Kd left.png\nnewmtl right\nmap_Kd right.png\nnewmtl bare\nKd 1 1 1\n');
  for (const [name, data] of Object.entries(images)) writeFileSync(join(folder, name), data);
  run('ingest', 't.obj', 't.mtdb', '--name', 't', '--step', '0.015625', '--texture-step', '0', '--quiet');
  run('pack', 't.mtdb', 't.mtdbp');
  served = readFileSync(join(folder, 't.mtdbp'));
  const file = await open(), {texture} = file.objects[0], object = await file.open('t');
  assert.deepEqual(Object.keys(texture), ['pages', 'tiles']);
  for (const page of texture.pages) assert.deepEqual(Buffer.from(await object.read(page)), images[page.name]);
  assert.deepEqual(texture.pages.map(p => p.name).sort(), Object.keys(images).sort());
  const corner = (p, u, v, page) => `${page} ${p.map(x => Math.round(64 * x))} ${Math.fround(u)} ${Math.fround(v)}`;
  // As texts, whichever corner comes first.
  const text = corners => corners.slice(corners.indexOf(corners.slice().sort()[0])).concat(corners.slice(0, corners.indexOf(corners.slice().sort()[0]))).join(', ');
  const ofExtract = query => {
    writeFileSync(join(folder, 'query.json'), JSON.stringify(query));
    run('extract', 't.mtdb', 'cut.obj', '--query', 'query.json');
    const [materials, mesh] = ['cut.mtl', 'cut.obj'].map(name => readFileSync(join(folder, name), 'utf8'));
    const page = Object.fromEntries(Array.from(materials.matchAll(/newmtl (\S+)\n(?:(?!newmtl)[^\n]*\n)*?map_Kd (\S+)/g), m => [m[1], m[2]]));
    const v = [], vt = [], list = [];
    let material = '';
    for (const line of mesh.split('\n')) {
      const [kind, ...rest] = line.split(' ');
      if (kind === 'v') v.push(rest.map(Number));
      if (kind === 'vt') vt.push(rest.map(Number));
      if (kind === 'usemtl') material = rest[0];
      if (kind === 'f') list.push(text(rest.map(part => {
        const [a, b] = part.split('/').map(i => Number(i) - 1);
        return page[material] ? corner(v[a], ...vt[b], page[material].split('/').at(-1)) : corner(v[a], 0, 0, 'none');
      })));
    }
    return list.sort();
  };
  const ofSession = () => {
    const {indices, positions, origin, corners, pages} = object.changes(), list = [];
    assert.equal(corners.length, 2 * indices.length);
    assert.equal(pages.length, indices.length / 3);
    for (let t = 0; t < pages.length; ++t) {
      if (indices[3 * t] === indices[3 * t + 1]) continue;
      const name = texture.pages[pages[t]]?.name ?? 'none';
      if (name === 'none') assert.equal(pages[t], kNoPage);
      list.push(text([0, 1, 2].map(c => {
        const at = [0, 1, 2].map(k => positions[3 * indices[3 * t + c] + k] + origin[k]);
        return name === 'none' ? corner(at, 0, 0, name) : corner(at, corners[6 * t + 2 * c], corners[6 * t + 2 * c + 1], name);
      })));
    }
    return list.sort();
  };
  const sphere = (x, y) => ({region: {sphere: {centre: [x, y, 0], radius: 18}}, threshold: 0.02});
  for (const query of [{threshold: 'coarsest'}, {}, sphere(20, 20), sphere(50, 40), {threshold: 0.3}, sphere(24, 60), {threshold: 0.05}, {}]) {
    await object.settle(query);
    const told = ofSession();
    assert.ok(told.length > 0);
    assert.deepEqual(told, ofExtract(query));
  }
  // XXH3 of no bytes, with a seed of 0.
  assert.equal(object.checksum(new Uint8Array()), 0x2d06800538d394c2n);
  assert.notEqual(object.checksum(new Uint8Array(), 1n), object.checksum(new Uint8Array(), 2n ** 63n));
  await assert.rejects(object.read({offset: served.length - 10, bytes: 11}), {code: 'invalid_argument'});
  const stopped = new AbortController();
  stopped.abort();
  await assert.rejects(object.read(texture.pages[0], stopped.signal), {code: 'aborted'});
  const limited = await open({maxBytes: 120000}), few = await limited.open('t');
  await assert.rejects(few.read(texture.pages.find(p => p.bytes > 120000)), {code: 'budget'});
  object.close();
  await assert.rejects(object.read(texture.pages[0]), {code: 'closed'});
  const plain = await (served = bytes, await open()).open();
  await plain.settle(queries[0]);
  assert.equal(plain.changes().corners.length + plain.changes().pages.length, 0);
  assert.equal(plain.info.texture, undefined);
}
console.log('corners and images of textures');
server.close();
server.closeAllConnections();
console.log(`${seen.requests} requests; all as it should be`);
