// SPDX-License-Identifier: Apache-2.0
// node build.mjs --build FOLDER [--npm NPM] [--wasm-cxx CLANG++]: makes the package mtdb into
// FOLDER/package, where `npm pack` finds it.
import {execFileSync} from 'node:child_process';
import {createRequire} from 'node:module';
import {copyFileSync, mkdirSync, readFileSync, rmSync, writeFileSync} from 'node:fs';
import {dirname, join, resolve} from 'node:path';
import {fileURLToPath} from 'node:url';
import {gzipSync} from 'node:zlib';
import {installPackages, readOptions} from '../viewer/steps.mjs';
import {compileEngine} from './engine.mjs';

const source = dirname(fileURLToPath(import.meta.url));
const options = readOptions();
const build = resolve(options.build);
const made = join(build, 'package');
mkdirSync(build, {recursive: true});
rmSync(made, {recursive: true, force: true});
mkdirSync(made);
installPackages(source, build, options.npm ?? 'npm');
const require = createRequire(join(build, 'package.json'));

await compileEngine({build, cxx: options['wasm-cxx'] ?? 'clang++-16', launcher: options.launcher, out: join(made, 'engine.wasm')});
await require('esbuild').build({
  entryPoints: [join(source, 'src/mtdb.ts')], outdir: made, bundle: true, minify: true, format: 'esm', target: 'es2022',
  legalComments: 'eof', nodePaths: [join(build, 'node_modules')], logLevel: 'warning', tsconfigRaw: {},
});
writeFileSync(join(build, 'tsconfig.json'), JSON.stringify({
  compilerOptions: {
    strict: true, noUncheckedIndexedAccess: true, target: 'es2022', module: 'es2022', moduleResolution: 'bundler',
    lib: ['es2023', 'dom'], declaration: true, emitDeclarationOnly: true, outDir: made, types: [], skipLibCheck: true,
    baseUrl: build, paths: {fzstd: ['node_modules/fzstd']},
  },
  files: [join(source, 'src/mtdb.ts')],
}));
execFileSync(process.execPath, [require.resolve('typescript/bin/tsc'), '-p', build], {stdio: 'inherit'});
const description = JSON.parse(readFileSync(join(source, 'package.json'), 'utf8'));
delete description.devDependencies;
writeFileSync(join(made, 'package.json'), JSON.stringify(description, null, 2) + '\n');
copyFileSync(join(source, 'README.md'), join(made, 'README.md'));
for (const name of ['engine.wasm', 'mtdb.js']) console.log(`${name}: ${gzipSync(readFileSync(join(made, name)), {level: 9}).length} bytes compressed`);
