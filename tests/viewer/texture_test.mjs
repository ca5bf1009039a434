// SPDX-License-Identifier: Apache-2.0
// The page's parts for textures that need no browser: the file of tiles, which requests are made,
// the table by which the shader finds tiles, and which are chosen. MTDB_VIEWER_BUILD: where the
// page was built.
import assert from 'node:assert/strict';
import {existsSync, mkdtempSync, rmSync} from 'node:fs';
import {createRequire} from 'node:module';
import {tmpdir} from 'node:os';
import {dirname, join} from 'node:path';
import {fileURLToPath, pathToFileURL} from 'node:url';

const build = process.env.MTDB_VIEWER_BUILD;
const source = join(dirname(fileURLToPath(import.meta.url)), '../../tools/viewer/src');
if (!existsSync(join(build, 'node_modules'))) {
  console.log('skipped: npm could not get the packages of the viewer');
  process.exit(77);
}
const folder = mkdtempSync(join(tmpdir(), 'mtdb-texture-'));
process.on('exit', () => rmSync(folder, {recursive: true, force: true}));
const load = async name => {
  await createRequire(join(build, 'package.json'))('esbuild').build({
    entryPoints: [join(source, `${name}.ts`)],
    outfile: join(folder, `${name}.mjs`),
    bundle: true,
    format: 'esm',
    logLevel: 'warning',
    tsconfigRaw: {},
  });
  return await import(pathToFileURL(join(folder, `${name}.mjs`)).href);
};
const tiles = await load('texture_tiles'),
  table = await load('page_table');

// In place of Hash64, which the engine has.
function checksum(bytes, seed) {
  let hash = (seed ^ 0xcbf29ce484222325n) & (2n ** 64n - 1n);
  for (const byte of bytes) hash = ((hash ^ BigInt(byte)) * 0x100000001b3n) & (2n ** 64n - 1n);
  return hash;
}

// A file of tiles as store/FORMAT.md has it, written by its words alone. `tile` gives bytes.
function writeTiles(pages, tile) {
  const levels = Math.max(0, ...pages.map(p => p.levels)),
    parts = [];
  const headBytes = 16 + 12 * pages.length + 16 * levels + 8;
  let at = headBytes;
  const places = [];
  for (let level = levels - 1; level >= 0; --level) {
    const images = [];
    pages.forEach((page, p) => {
      if (level >= page.levels) return;
      const across = side => Math.ceil(Math.ceil(side / 2 ** level) / 504);
      for (let row = 0; row < across(page.height); ++row)
        for (let column = 0; column < across(page.width); ++column)
          images.push(Buffer.from(tile(p, level, column, row)));
    });
    const index = Buffer.alloc(8 * images.length + 8);
    images.forEach((image, i) => {
      index.writeUInt32LE(image.length, 8 * i);
      index.writeUInt32LE(Number(checksum(image, 0n) & 0xffffffffn), 8 * i + 4);
    });
    const seed = tiles.indexSeed(level);
    index.writeBigUInt64LE(checksum(index.subarray(0, -8), seed), index.length - 8);
    const bytes = index.length + images.reduce((sum, image) => sum + image.length, 0);
    places.push([at, bytes]);
    at += bytes;
    parts.push(index, ...images);
  }
  const head = Buffer.alloc(headBytes);
  head.writeUInt32LE(0x4c54544d, 0);
  [1, 504, 4, levels].forEach((n, i) => head.writeUInt16LE(n, 4 + 2 * i));
  head.writeUInt32LE(pages.length, 12);
  pages.forEach(({width, height, levels: count, kind}, p) => {
    head.writeUInt32LE(width, 16 + 12 * p);
    head.writeUInt32LE(height, 20 + 12 * p);
    head.writeUInt8(count, 24 + 12 * p);
    head.writeUInt8(kind ?? 0, 25 + 12 * p);
  });
  places.forEach((place, i) =>
    place.forEach((n, k) =>
      head.writeBigUInt64LE(BigInt(n), 16 + 12 * pages.length + 16 * i + 8 * k),
    ),
  );
  head.writeBigUInt64LE(checksum(head.subarray(0, -8), 76n), headBytes - 8);
  return Buffer.concat([head, ...parts]);
}

const pages = [
  {width: 3000, height: 1000, levels: 6},
  {width: 0, height: 0, levels: 0},
  {width: 120, height: 7, levels: 1, kind: 1},
  {width: 121, height: 505, levels: 4},
];
const text = (...name) => `tile ${name} ${'x'.repeat((7 * name[2] + 11 * name[3]) % 97)}`;
const file = writeTiles(pages, text);
const open = (bytes, reads = []) =>
  tiles.TileFile.open(
    bytes.length,
    async (offset, size) => {
      reads.push([offset, size]);
      assert.ok(offset + size <= bytes.length);
      return new Uint8Array(bytes.subarray(offset, offset + size));
    },
    checksum,
  );

{
  // Mix('L', 3), by the C++ program.
  assert.equal(tiles.indexSeed(3), 0x951b37b552655f08n);
  assert.equal(tiles.levelsOf(120, 120), 1);
  assert.equal(tiles.levelsOf(121, 1), 2);
  assert.equal(tiles.levelsOf(8192, 8192), 8);
  assert.deepEqual(tiles.sizeOf(pages[0], 1), {width: 1500, height: 500, columns: 3, rows: 1});
  assert.deepEqual(tiles.tileSize(pages[0], [0, 1, 2, 0]), {width: 500, height: 508});
  assert.deepEqual(tiles.tileSize(pages[0], [0, 0, 0, 0]), {width: 512, height: 512});
}
{
  // Each tile of each level, and few reads: what is coarse comes together.
  const reads = [],
    read = await open(file, reads);
  assert.deepEqual(
    read.head.pages,
    pages.map(({width, height, levels}) => ({width, height, levels})),
  );
  let count = 0;
  for (let level = 5; level >= 0; --level)
    for (const [p, page] of pages.entries()) {
      if (level >= page.levels) continue;
      const {columns, rows} = tiles.sizeOf(page, level);
      for (let row = 0; row < rows; ++row)
        for (let column = 0; column < columns; ++column, ++count) {
          const blob = await read.tile([p, level, column, row]);
          assert.equal(await blob.text(), text(p, level, column, row));
          assert.equal(blob.type, p === 2 ? 'image/png' : 'image/jpeg');
        }
    }
  assert.equal(count, 12 + 3 + 2 + 1 + 1 + 1 + 1 + 2 + 1 + 1 + 1);
  assert.deepEqual(reads, [[0, file.length]]);
}
{
  // A large one: the head, whole levels as long as they are small, indexes and single tiles.
  const reads = [],
    many = writeTiles([{width: 4096, height: 4096, levels: 7}], () => Buffer.alloc(20000)),
    read = await open(many, reads);
  await read.tile([0, 6, 0, 0]);
  await read.tile([0, 5, 0, 0]);
  await read.tile([0, 0, 3, 4]);
  await read.tile([0, 0, 4, 4]);
  assert.equal(reads.length, 6);
  assert.deepEqual(
    reads.map(([, bytes]) => bytes),
    [16384, 20016, 20016, 8 * 81 + 8, 20000, 20000],
  );
}
{
  // A head of more bytes than the first read has.
  const list = Array.from({length: 2000}, () => ({width: 1, height: 1, levels: 1})),
    many = writeTiles(list, p => `${p}`);
  assert.equal(await (await (await open(many)).tile([1999, 0, 0, 0])).text(), '1999');
}
{
  // Every prefix of the head, and every flipped byte of head and indexes, is refused.
  const {bytes: headBytes} = (await open(file)).head;
  for (let n = 0; n < headBytes; ++n) await assert.rejects(open(file.subarray(0, n)));
  for (let n = 0; n < headBytes; ++n) {
    const wrong = Buffer.from(file);
    wrong[n] ^= 1 << (n % 8);
    await assert.rejects(open(wrong), Error, `byte ${n}`);
  }
  for (let n = headBytes; n < file.length; ++n) {
    const wrong = Buffer.from(file);
    wrong[n] ^= 0x10;
    const read = await open(wrong);
    let failed = 0;
    for (let level = 0; level < 6; ++level)
      for (const [p, page] of pages.entries()) {
        const {columns, rows} = level < page.levels ? tiles.sizeOf(page, level) : {rows: 0};
        for (let row = 0; row < rows; ++row)
          for (let column = 0; column < columns; ++column)
            await read.tile([p, level, column, row]).catch(error => {
              assert.match(error.message, /checksum|index/);
              ++failed;
            });
      }
    assert.ok(failed >= 1, `byte ${n}`);
  }
  await assert.rejects(open(Buffer.concat([file, Buffer.alloc(1)])), /impossible levels/);
}
console.log('files of tiles');

const turn = (milliseconds = 0) => new Promise(done => setTimeout(done, milliseconds));
{
  // What is wanted comes in its order, six requests at once; what is wanted no more is given up;
  // eight images wait for the page at most; what failed for good is not tried again.
  const asked = [],
    given = [],
    failed = [];
  let aborted = 0;
  const slow = {
    tile: (name, signal) =>
      new Promise((done, fail) => {
        asked.push({name: String(name), done: () => done('bytes'), fail});
        signal.addEventListener('abort', () => {
          ++aborted;
          fail(new Error('aborted'));
        });
      }),
  };
  const queue = new tiles.TileQueue(
    slow,
    async () => ({close() {}}),
    name => given.push(String(name)),
    (name, error) => {
      failed.push(String(name));
      return error.again === true;
    },
  );
  const names = Array.from({length: 20}, (_, i) => [0, 0, i, 0]);
  queue.want(names);
  assert.deepEqual(
    asked.map(a => a.name),
    names.slice(0, 6).map(String),
  );
  asked[0].done();
  await turn();
  assert.deepEqual(given, ['0,0,0,0']);
  assert.equal(asked.length, 7);
  queue.want(names.slice(3));
  await turn();
  assert.equal(aborted, 2);
  assert.equal(asked.length, 9);
  assert.equal(failed.length, 0);
  // What comes is asked for next, until eight images wait.
  for (let i = 3; i < 30; ++i) {
    asked[i]?.done();
    await turn();
  }
  assert.equal(given.length, 8);
  assert.equal(asked.length, 10);
  queue.taken(8);
  assert.equal(asked.length, 16);
  for (const request of asked.slice(-6)) request.fail(new Error('damaged'));
  await turn();
  assert.equal(failed.length >= 6, true);
  const before = asked.length;
  queue.want(names.filter(name => failed.includes(String(name))));
  await turn();
  assert.equal(asked.length, before);
  queue.close();
}
console.log('requests of tiles');

{
  // After any insertions and removals, each entry is that of the nearest coarser tile that is
  // there.
  const list = pages.map(({width, height, levels}) => ({width, height, levels})),
    t = new table.PageTable(list),
    there = new Map(),
    names = Array.from({length: t.size}, (_, entry) => t.nameOf(entry));
  names.forEach((name, entry) => assert.equal(t.entryOf(name), entry));
  assert.equal(names.length, new Set(names.map(String)).size);
  assert.deepEqual(t.coarsest(), [
    [0, 5, 0, 0],
    [2, 0, 0, 0],
    [3, 3, 0, 0],
  ]);
  let random = 1;
  const next = n => (random = (random * 48271) % 2147483647) % n;
  for (let step = 0; step < 400; ++step) {
    const name = names[next(names.length)];
    if (there.has(String(name))) {
      t.drop(name);
      there.delete(String(name));
    } else {
      const place = table.placeOf(next(64), next(4), next(4));
      t.put(name, place);
      there.set(String(name), (place | (name[1] << 14)) >>> 0);
    }
    names.forEach((start, entry) => {
      let at = start;
      while (at && !there.has(String(at))) at = t.parentOf(at);
      assert.equal(t.entries[entry], at ? there.get(String(at)) : 0, `${start} after ${step}`);
      assert.equal(t.shownLevel(entry), at ? at[1] : null);
    });
  }
}
{
  // Those that most pixels want; small ones share layers.
  const want = (columns, rows, pixels) => ({shape: {columns, rows}, pixels});
  const all = [
    ...Array.from({length: 5}, (_, i) => want(4, 4, 10 + i)),
    ...Array.from({length: 17}, () => want(1, 1, 1)),
    want(2, 2, 100),
    want(1, 4, 0.5),
  ];
  const {chosen, needed} = table.choose(all, 6);
  assert.equal(needed, 5 + 2 + 1 + 1);
  assert.equal(chosen.length, 6);
  assert.equal(table.choose(all, 7).chosen.length, 6 + 16);
  assert.equal(table.choose(all, 8).chosen.length, 6 + 17);
  assert.equal(table.choose(all, 9).chosen.length, 6 + 18);
  assert.deepEqual(
    table.choose(all, 2).chosen.map(t => t.pixels),
    [100, 14],
  );
  // A page of 8192 pixels a side: its coarse levels take few cells, and so do remainders of tiles.
  const page = {width: 8192, height: 8192, levels: 8};
  const shapes = [7, 6, 5, 4].map(level => table.shapeOf(page, [0, level, 0, 0]));
  assert.deepEqual(
    shapes.map(s => s.columns),
    [1, 1, 2, 4],
  );
  assert.deepEqual(table.shapeOf(page, [0, 4, 1, 0]), {columns: 1, rows: 4});
  for (const columns of [1, 2, 4])
    for (const rows of [1, 2, 4]) {
      const places = Array.from({length: table.slotsOf({columns, rows})}, (_, slot) =>
        table.slotAt({columns, rows}, slot),
      );
      assert.equal(new Set(places.map(p => `${p.column} ${p.row}`)).size, 16 / columns / rows);
      for (const {column, row} of places)
        assert.ok(column + columns <= 4 && row + rows <= 4 && !(column % columns) && !(row % rows));
    }
  const counts = table.countAsked(
    Uint8Array.from([1, 2, 0, 3, 1, 2, 0, 3, 0, 0, 1, 3, 9, 9, 9, 0, 1, 2, 0, 1]),
  );
  assert.deepEqual([...counts.keys()], [3, 1]);
  assert.deepEqual(
    [...counts.get(3)],
    [
      [513, 2],
      [65536, 1],
    ],
  );
}
console.log('the table of tiles');
