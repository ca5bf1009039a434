// SPDX-License-Identifier: Apache-2.0
// The engine in WebAssembly, in node: calls along a flight with everything in memory, and its rate of decoding.
//   node bench/wasm_flight.mjs flight PACKAGE FILE.mtdbp QUERIES.json [--milliseconds 4] [--json OUT]
//     PACKAGE: the npm package (node tools/web/build.mjs). QUERIES: remote_bench flight --queries. A call is update() and
//     changes(): the mesh in arrays, normals too.
//   node bench/wasm_flight.mjs decode BUILD STORE.mtdb [--json OUT]
//     All clusters of a store from their payloads, natively (BUILD/tests/decode_digest) and in WebAssembly as the package
//     compiles it: processor time of either, and whether the digests are equal.
import {execFileSync} from 'node:child_process';
import {existsSync, fstatSync, mkdirSync, openSync, readFileSync, readSync, readdirSync, writeFileSync} from 'node:fs';
import {dirname, join, resolve} from 'node:path';
import {fileURLToPath, pathToFileURL} from 'node:url';
import {runProgram} from '../tests/wasm/run_program.mjs';

const root = join(dirname(fileURLToPath(import.meta.url)), '..');
const [what, ...rest] = process.argv.slice(2);
const plain = [], options = {};
for (let i = 0; i < rest.length; ++i) rest[i].startsWith('--') ? (options[rest[i].slice(2)] = rest[++i]) : plain.push(rest[i]);
const rows = [];

// A file as a web server gives it.
function serve(path) {
  const file = openSync(path, 'r'), {size} = fstatSync(file);
  return async (_, {headers}) => {
    const [, from, to] = /bytes=(\d+)-(\d+)/.exec(headers.Range).map(Number);
    const bytes = Buffer.alloc(Math.min(to + 1, size) - from);
    readSync(file, bytes, 0, bytes.length, from);
    return new Response(bytes, {status: 206, headers: {'Content-Range': `bytes ${from}-${from + bytes.length - 1}/${size}`, ETag: '"1"'}});
  };
}

const mean = list => list.reduce((a, b) => a + b, 0) / list.length;
const cpu = () => {
  const {user, system} = process.cpuUsage();
  return (user + system) / 1e3;
};

async function flight(folder, path, queryFile) {
  const {openFile} = await import(pathToFileURL(join(resolve(folder), 'mtdb.js')));
  const file = await openFile('http://here/file', {wasm: readFileSync(join(folder, 'engine.wasm')), fetch: serve(path)});
  const queries = JSON.parse(readFileSync(queryFile, 'utf8'));
  const object = await file.open(undefined, {cacheBytes: 3 * 2 ** 29});
  for (const query of queries) await object.settle(query);
  for (const milliseconds of [undefined, Number(options.milliseconds ?? 4)]) {
    await object.settle(queries[0]);
    object.changes();
    const wall = [], used = [];
    let onTheWay = 0, frame;
    for (const query of queries) {
      const begin = performance.now(), before = cpu();
      frame = object.update(query, milliseconds);
      object.changes();
      wall.push(performance.now() - begin);
      used.push(cpu() - before);
      if (frame.limit === 'time') ++onTheWay;
      if (frame.limit === 'missing') throw new Error('a cluster was not in memory');
    }
    rows.push({what: 'flight', engine: 'WebAssembly', milliseconds: milliseconds ?? null, triangles: frame.triangles, mean_ms: mean(wall), longest_ms: Math.max(...wall),
      cpu_mean_ms: mean(used), cpu_longest_ms: Math.max(...used), calls: wall.length, on_the_way: onTheWay});
    const r = rows.at(-1);
    console.log(`flight, ${milliseconds ? 'with a time' : 'to the end'}: ${r.triangles} triangles; a call ${r.mean_ms.toFixed(2)} ms, the longest ${r.longest_ms.toFixed(2)}; ` +
      `of processor time ${r.cpu_mean_ms.toFixed(2)}, ${r.cpu_longest_ms.toFixed(2)}; ${onTheWay} of ${wall.length} on the way`);
  }
}

async function decode(build, store) {
  const work = join(build, 'wasm_decode');
  mkdirSync(join(work, 'include'), {recursive: true});
  const run = (...command) => execFileSync(command[0], command.slice(1), {cwd: root, encoding: 'utf8'});
  run(join(build, 'tests/decode_dump'), store, join(work, 'payloads'));
  const program = join(work, 'decode.wasm');
  if (!existsSync(program)) {
    for (const h of ['zstd.h', 'zstd_errors.h', 'xxhash.h']) run('ln', '-sf', `/usr/include/${h}`, join(work, 'include'));
    const folders = ['store/base', 'codecs/coding', 'codecs/cluster', 'codecs/cluster/internal'];
    const sources = folders.flatMap(f => readdirSync(join(root, f)).filter(n => n.endsWith('.cc')).map(n => join(f, n)));
    run('clang++-16', '--target=wasm32-wasi', '-nostdinc++', '-isystem', '/usr/lib/llvm-16/include/wasm32-wasi/c++/v1', '-std=c++20', '-O2', '-msimd128', '-fno-exceptions',
      '-ffp-contract=off', '-DXXH_INLINE_ALL', '-I.', `-I${join(work, 'include')}`, 'tests/codecs/decode_check/decode_digest.cc', 'tests/codecs/decode_check/no_zstd.cc', ...sources,
      '-L/usr/lib/llvm-16/lib/wasm32-wasi', '-Wl,-z,stack-size=1048576', '-o', program);
  }
  // The least of several runs: the machine's code is made better beside the first ones.
  const payloads = readFileSync(join(work, 'payloads')), module = new WebAssembly.Module(readFileSync(program));
  let native = Infinity, wasm = Infinity, nativeDigest = '', wasmDigest = '';
  for (let i = 0; i < 7; ++i) {
    const [text, times] = run('bash', '-c', 'TIMEFORMAT="|%U %S"; { time "$0" "$1"; } 2>&1', join(build, 'tests/decode_digest'), join(work, 'payloads')).split('|');
    native = Math.min(native, times.trim().split(' ').map(Number).reduce((a, b) => a + b));
    nativeDigest = text.trim();
    const before = cpu();
    wasmDigest = await runProgram(module, payloads, '/payloads');
    wasm = Math.min(wasm, (cpu() - before) / 1e3);
  }
  rows.push({what: 'decode', native_seconds: native, wasm_seconds: wasm, ratio: native / wasm});
  console.log(`${nativeDigest}\n${wasmDigest}\nnatively ${native.toFixed(2)} s, in WebAssembly ${wasm.toFixed(2)} s: ${(native / wasm).toFixed(2)} of the native rate`);
  if (nativeDigest !== wasmDigest) throw new Error('the digests differ');
}

if (what === 'flight') await flight(...plain);
else await decode(...plain.map(p => resolve(p)));
if (options.json) writeFileSync(options.json, JSON.stringify(rows, null, 1) + '\n');
