// SPDX-License-Identifier: Apache-2.0
// What the builds of pages share: packages as locked, C++ to WebAssembly.
import {execFile, execFileSync} from 'node:child_process';
import {promisify} from 'node:util';
import {
  copyFileSync,
  existsSync,
  mkdirSync,
  readFileSync,
  symlinkSync,
  writeFileSync,
} from 'node:fs';
import {availableParallelism, cpus} from 'node:os';
import {join} from 'node:path';

const run = promisify(execFile);

// --name value ..., of the command line.
export function readOptions() {
  const options = {};
  for (let i = 2; i + 1 < process.argv.length; i += 2)
    options[process.argv[i].slice(2)] = process.argv[i + 1];
  return options;
}

// The packages, exactly as locked in `source`, into `build`, without running their scripts. Throws
// when they cannot be had.
export function installPackages(source, build, npm) {
  const lock = readFileSync(join(source, 'package-lock.json'));
  const installed = join(build, 'installed-lock.json');
  if (existsSync(installed) && readFileSync(installed).equals(lock)) return;
  for (const name of ['package.json', 'package-lock.json'])
    copyFileSync(join(source, name), join(build, name));
  execFileSync(
    npm,
    [
      'ci',
      '--ignore-scripts',
      '--no-audit',
      '--no-fund',
      '--prefer-offline',
      '--fetch-retries=1',
      '--fetch-timeout=30000',
    ],
    {cwd: build, stdio: ['ignore', 'ignore', 'pipe'], timeout: 300000},
  );
  writeFileSync(installed, lock);
}

// Compiles `sources`, which lie in `root`, into `out`, a module without main(). `launcher`: of the
// compiler, as ccache. `headers` of /usr/include are those that do not depend on the machine.
export async function compileWasm({
  root,
  build,
  cxx,
  launcher,
  sources,
  headers,
  flags,
  optimize = () => ['-O2'],
  stackBytes,
  out,
}) {
  const include = join(build, 'include');
  const objects = join(build, 'objects');
  for (const folder of [include, objects]) mkdirSync(folder, {recursive: true});
  for (const header of headers) {
    if (!existsSync(join(include, header)))
      symlinkSync(join('/usr/include', header), join(include, header));
  }
  const all = [
    '--target=wasm32-wasi',
    '-nostdinc++',
    '-isystem',
    '/usr/lib/llvm-16/include/wasm32-wasi/c++/v1',
    '-std=c++20',
    '-fno-exceptions',
    '-ffp-contract=off',
    '-DXXH_INLINE_ALL',
    ...flags,
    `-I${root}`,
    `-I${include}`,
  ];
  const queue = sources.map(file => [
    join(root, file),
    join(objects, file.replaceAll('/', '_') + '.o'),
    optimize(file),
  ]);
  const made = queue.map(([, object]) => object);
  const worker = async () => {
    for (let job; (job = queue.pop());) {
      const command = [
        ...(launcher ? [launcher] : []),
        cxx,
        ...all,
        ...job[2],
        '-c',
        job[0],
        '-o',
        job[1],
      ];
      await run(command[0], command.slice(1));
    }
  };
  const threads = Math.min(4, availableParallelism ? availableParallelism() : cpus().length);
  await Promise.all(Array.from({length: threads}, worker));
  await run(cxx, [
    '--target=wasm32-wasi',
    '-mexec-model=reactor',
    ...made,
    '-L/usr/lib/llvm-16/lib/wasm32-wasi',
    `-Wl,-z,stack-size=${stackBytes}`,
    '-Wl,--strip-all',
    '-Wl,--gc-sections',
    '-o',
    out,
  ]);
}

export const readLines = file =>
  readFileSync(file, 'utf8')
    .trim()
    .split('\n')
    .filter(line => line && !line.startsWith('#'));
