// SPDX-License-Identifier: Apache-2.0
// node build.mjs --build FOLDER --npm NPM --wasm-cxx CLANG++ [--launcher CCACHE]: makes the page
// into FOLDER/page, and FOLDER/viewer_files.cc, which has its files compressed. Where npm cannot
// get the packages, the program is built without the page: viewer_files.cc then says so, and so
// does a warning.
import {createRequire} from 'node:module';
import {copyFileSync, mkdirSync, readFileSync, readdirSync, rmSync, writeFileSync} from 'node:fs';
import {dirname, join} from 'node:path';
import {fileURLToPath} from 'node:url';
import {gzipSync} from 'node:zlib';
import {compileEngine} from '../web/engine.mjs';
import {compileWasm, installPackages, readLines, readOptions} from './steps.mjs';

const source = dirname(fileURLToPath(import.meta.url));
const root = join(source, '../..');
const options = readOptions();
const build = options.build;
const page = join(build, 'page');
const types = {
  html: 'text/html; charset=utf-8',
  css: 'text/css; charset=utf-8',
  js: 'text/javascript; charset=utf-8',
  wasm: 'application/wasm',
  svg: 'image/svg+xml',
};

// Comments and indentation of the shaders are for their readers.
const leanShaders = {
  name: 'lean shaders',
  setup: build =>
    build.onLoad({filter: /src\/shaders\.ts$/}, ({path}) => ({
      loader: 'ts',
      contents: readFileSync(path, 'utf8').replace(/`[^`]*`/g, shader =>
        shader.replace(/ *\/\/.*/g, '').replace(/\n\s+/g, '\n'),
      ),
    })),
};

// Three keeps the shaders of all its materials in the page, used or not: what the materials of
// handles, lines and points do not include is left out.
const kThreeShaders = ['meshbasic_vert', 'meshbasic_frag', 'points_vert', 'points_frag'];
function leaveShadersOut(module) {
  const table = /const ShaderChunk = \{([^}]*)\}/.exec(module)?.[1] ?? '';
  const variables = new Map(
    Array.from(table.matchAll(/(\w+): ([\w$]+)/g), ([, name, variable]) => [name, variable]),
  );
  const texts = new Map(
    Array.from(
      module.matchAll(/^(?:const|var) ([\w$]+) = ("(?:[^"\\]|\\.)*");$/gm),
      ([, variable, text]) => [variable, text],
    ),
  );
  const used = new Set();
  const use = name => {
    if (!texts.has(variables.get(name))) throw new Error(`three has no shader ${name}`);
    if (used.has(name)) return;
    used.add(name);
    for (const [, part] of texts.get(variables.get(name)).matchAll(/#include <(\w+)>/g)) use(part);
  };
  kThreeShaders.forEach(use);
  for (const [, name] of module.matchAll(/ShaderChunk\[ '(\w+)' \]/g)) use(name); // what its programs begin with
  const unused = new Set(
    [...variables].filter(([name]) => !used.has(name)).map(([, variable]) => variable),
  );
  return module.replace(
    /^((?:const|var) ([\w$]+) = )"(?:[^"\\]|\\.)*";$/gm,
    (line, begin, variable) => (unused.has(variable) ? `${begin}"";` : line),
  );
}
const leanThree = {
  name: 'lean three',
  setup: build =>
    build.onLoad({filter: /three\.module\.js$/}, ({path}) => ({
      loader: 'js',
      contents: leaveShadersOut(readFileSync(path, 'utf8')),
    })),
};

async function bundle() {
  const esbuild = createRequire(join(build, 'package.json'))('esbuild');
  await esbuild.build({
    entryPoints: {
      viewer: join(source, 'src/viewer.ts'),
      decoder: join(source, 'src/decoder.ts'),
      engine: join(source, 'src/engine.ts'),
      draping: join(source, 'src/draping.ts'),
      visitor: join(source, 'src/visitor.ts'),
      texturing: join(source, 'src/texturing.ts'),
      texture_tiles: join(source, 'src/texture_tiles.ts'),
    },
    outdir: page,
    bundle: true,
    minify: true,
    format: 'esm',
    target: 'es2022',
    legalComments: 'eof',
    nodePaths: [join(build, 'node_modules')],
    logLevel: 'warning',
    tsconfigRaw: {},
    plugins: [leanShaders, leanThree],
  });
  for (const name of readdirSync(join(source, 'static')).filter(n => !n.endsWith('.css')))
    copyFileSync(join(source, 'static', name), join(page, name));
  await esbuild.build({
    entryPoints: [join(source, 'static/viewer.css')],
    outdir: page,
    minify: true,
    logLevel: 'warning',
  });
}

const compileDecoder = () =>
  compileWasm({
    root,
    build: join(build, 'decoder'),
    cxx: options['wasm-cxx'],
    launcher: options.launcher,
    out: join(page, 'decoder.wasm'),
    stackBytes: 262144,
    sources: [
      ...readLines(join(root, 'codecs/client_sources.txt')),
      'tools/viewer/wasm/decoder.cc',
    ],
    headers: ['xxhash.h'],
    flags: [],
    // What no update spends its time in is made small.
    optimize: file =>
      /attribute_coder|cluster_model|coding\/(patch|rans)|base\/(grid|attribute_grid|hash|status)/.test(
        file,
      )
        ? ['-Os']
        : ['-O2'],
  });

function writeFiles(names, why) {
  let text =
    '// Made by tools/viewer/build.mjs.\n#include "tools/viewer/viewer_files.h"\n\nnamespace mtdb {\n\nnamespace {\n';
  const rows = [];
  names.forEach((name, i) => {
    const bytes = gzipSync(readFileSync(join(page, name)), {level: 9});
    text += `constexpr unsigned char kFile${i}[] = {${Array.from(bytes)
      .join(',')
      .replace(/(.{100}[^,]*,)/g, '$1\n')}};\n`;
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
  installPackages(source, build, options.npm);
} catch (error) {
  packages = false;
  const reason = String(error.stderr || error.message)
    .split('\n')
    .filter(line => /npm (err|error)/i.test(line))
    .slice(0, 2)
    .join(' ');
  console.log(
    `viewer: WARNING: npm could not get the packages of package-lock.json, so mtdb is built without the viewer. ${reason}\n` +
      `viewer: to try again: touch ${join(source, 'package.json')}`,
  );
  writeFiles([], 'npm could not get its packages when it was built');
}
if (packages) {
  await bundle();
  await compileDecoder();
  await compileEngine({
    build: join(build, 'engine'),
    cxx: options['wasm-cxx'],
    launcher: options.launcher,
    out: join(page, 'engine.wasm'),
  });
  writeFiles(readdirSync(page).sort(), '');
}
