// SPDX-License-Identifier: Apache-2.0
// The types of the page's sources, which the bundler does not look at; and that no source imports
// itself by way of others, be it for types alone.
import {spawnSync} from 'node:child_process';
import {existsSync, readFileSync, readdirSync, writeFileSync} from 'node:fs';
import {dirname, join} from 'node:path';
import {fileURLToPath} from 'node:url';

const build = process.env.MTDB_VIEWER_BUILD,
  modules = join(build, 'node_modules');
const source = join(dirname(fileURLToPath(import.meta.url)), '../../tools/viewer');
if (!existsSync(modules)) {
  console.log('skipped: npm could not get the packages of the viewer');
  process.exit(77);
}
// Packages lie in the build folder, where imports of the sources do not look by themselves.
writeFileSync(
  join(build, 'tsconfig.json'),
  JSON.stringify({
    extends: join(source, 'tsconfig.json'),
    include: [join(source, 'src')],
    compilerOptions: {paths: {'*': [join(modules, '@types/*'), join(modules, '*')]}},
  }),
);
const {status} = spawnSync(process.execPath, [join(modules, 'typescript/bin/tsc'), '-p', build], {
  stdio: 'inherit',
});

const folder = join(source, 'src'),
  imports = new Map();
for (const name of readdirSync(folder)) {
  const text = readFileSync(join(folder, name), 'utf8');
  imports.set(
    name,
    Array.from(text.matchAll(/(?:from|import\() *'\.\/(\w+)'/g), found => `${found[1]}.ts`),
  );
}
// The first circle that is met from `name`, as a path.
const done = new Set();
function circle(name, path = []) {
  if (path.includes(name)) return [...path.slice(path.indexOf(name)), name];
  if (done.has(name)) return null;
  for (const next of imports.get(name) ?? []) {
    const found = circle(next, [...path, name]);
    if (found) return found;
  }
  done.add(name);
  return null;
}
const found = [...imports.keys()].map(name => circle(name)).find(path => path);
if (found) console.log(`a circle of imports: ${found.join(' -> ')}`);
process.exit(status === 0 && !found && imports.get('viewer.ts').length > 10 ? 0 : 1);
