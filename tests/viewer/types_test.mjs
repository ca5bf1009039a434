// SPDX-License-Identifier: Apache-2.0
// The types of the page's sources, which the bundler does not look at.
import {spawnSync} from 'node:child_process';
import {existsSync, writeFileSync} from 'node:fs';
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
process.exit(status === 0 ? 0 : 1);
