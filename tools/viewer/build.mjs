// node build.mjs --build FOLDER --npm NPM --wasm-cxx CLANG++: makes the page into FOLDER/page, and
// FOLDER/viewer_files.cc, which has its files compressed. Where npm cannot get the packages, the
// program is built without the page: viewer_files.cc then says so, and so does a warning.
import {execFile, execFileSync} from 'node:child_process';
import {createRequire} from 'node:module';
import {promisify} from 'node:util';
import {copyFileSync, existsSync, mkdirSync, readFileSync, readdirSync, rmSync, symlinkSync, writeFileSync} from 'node:fs';
import {availableParallelism, cpus} from 'node:os';
import {dirname, join} from 'node:path';
import {fileURLToPath} from 'node:url';
import {gzipSync} from 'node:zlib';

const run = promisify(execFile);
const source = dirname(fileURLToPath(import.meta.url));
const root = join(source, '../..');
const options = {};
for (let i = 2; i + 1 < process.argv.length; i += 2) options[process.argv[i].slice(2)] = process.argv[i + 1];
const build = options.build;
const page = join(build, 'page');
const types = {html: 'text/html; charset=utf-8', css: 'text/css; charset=utf-8', js: 'text/javascript; charset=utf-8', wasm: 'application/wasm', svg: 'image/svg+xml'};

// The packages, exactly as locked, without running their scripts. Throws when they cannot be had.
function installPackages() {
  const lock = readFileSync(join(source, 'package-lock.json'));
  const installed = join(build, 'installed-lock.json');
  if (existsSync(installed) && readFileSync(installed).equals(lock)) return;
  for (const name of ['package.json', 'package-lock.json']) copyFileSync(join(source, name), join(build, name));
  execFileSync(options.npm, ['ci', '--ignore-scripts', '--no-audit', '--no-fund', '--prefer-offline',
    '--fetch-retries=1', '--fetch-timeout=30000'], {cwd: build, stdio: ['ignore', 'ignore', 'pipe'], timeout: 300000});
  writeFileSync(installed, lock);
}

async function bundle() {
  const esbuild = createRequire(join(build, 'package.json'))('esbuild');
  await esbuild.build({
    entryPoints: {viewer: join(source, 'src/viewer.ts'), decoder: join(source, 'src/decoder.ts')},
    outdir: page, bundle: true, minify: true, format: 'esm', target: 'es2022', legalComments: 'eof',
    nodePaths: [join(build, 'node_modules')], logLevel: 'warning', tsconfigRaw: {},
  });
  for (const name of readdirSync(join(source, 'static'))) copyFileSync(join(source, 'static', name), join(page, name));
}

async function compileDecoder() {
  const include = join(build, 'include');
  const objects = join(build, 'objects');
  for (const folder of [include, objects]) mkdirSync(folder, {recursive: true});
  // Of the system's headers just this one, which does not depend on the machine.
  if (!existsSync(join(include, 'xxhash.h'))) symlinkSync('/usr/include/xxhash.h', join(include, 'xxhash.h'));
  const sources = readFileSync(join(root, 'codecs/client_sources.txt'), 'utf8').trim().split('\n');
  sources.push('tools/viewer/wasm/decoder.cc');
  const flags = ['--target=wasm32-wasi', '-nostdinc++', '-isystem', '/usr/lib/llvm-16/include/wasm32-wasi/c++/v1',
    '-std=c++20', '-O2', '-fno-exceptions', '-ffp-contract=off', '-DXXH_INLINE_ALL', `-I${root}`, `-I${include}`];
  const queue = sources.map(file => [join(root, file), join(objects, file.replaceAll('/', '_') + '.o')]);
  const made = queue.map(([, object]) => object);
  const worker = async () => {
    for (let job; (job = queue.pop());) await run(options['wasm-cxx'], [...flags, '-c', job[0], '-o', job[1]]);
  };
  const threads = Math.min(4, availableParallelism ? availableParallelism() : cpus().length);
  await Promise.all(Array.from({length: threads}, worker));
  await run(options['wasm-cxx'], ['--target=wasm32-wasi', '-mexec-model=reactor', ...made,
    '-L/usr/lib/llvm-16/lib/wasm32-wasi', '-Wl,-z,stack-size=262144', '-Wl,--strip-all', '-Wl,--gc-sections',
    '-o', join(page, 'decoder.wasm')]);
}

function writeFiles(names, why) {
  let text = '// Made by tools/viewer/build.mjs.\n#include "tools/viewer/viewer_files.h"\n\nnamespace mtdb {\n\nnamespace {\n';
  const rows = [];
  names.forEach((name, i) => {
    const bytes = gzipSync(readFileSync(join(page, name)), {level: 9});
    text += `constexpr unsigned char kFile${i}[] = {${Array.from(bytes).join(',').replace(/(.{100}[^,]*,)/g, '$1\n')}};\n`;
    rows.push(`    {"${name}", "${types[name.split('.').pop()]}", kFile${i}},`);
    console.log(`viewer: ${name}: ${bytes.length} bytes compressed`);
  });
  if (rows.length > 0) text += `constexpr ViewerFile kFiles[] = {\n${rows.join('\n')}\n};\n`;
  text += `}  // namespace\n\nstd::span<const ViewerFile> ViewerFiles() { return ${rows.length > 0 ? 'kFiles' : '{}'}; }\n`;
  text += `const char* WhyNoViewerFiles() { return "${why}"; }\n\n}  // namespace mtdb\n`;
  writeFileSync(join(build, 'viewer_files.cc'), text);
}

mkdirSync(build, {recursive: true});
rmSync(page, {recursive: true, force: true});
mkdirSync(page, {recursive: true});
let packages = true;
try {
  installPackages();
} catch (error) {
  packages = false;
  const reason = String(error.stderr || error.message).split('\n').filter(line => /npm (err|error)/i.test(line)).slice(0, 2).join(' ');
  console.log(`viewer: WARNING: npm could not get the packages of package-lock.json, so mtdb is built without the viewer. ${reason}\n` +
    `viewer: to try again: touch ${join(source, 'package.json')}`);
  writeFiles([], 'npm could not get its packages when it was built');
}
if (packages) {
  await Promise.all([bundle(), compileDecoder()]);
  writeFiles(readdirSync(page).sort(), '');
}
