// SPDX-License-Identifier: Apache-2.0
// The sources of the page and its tests look as prettier has it, at 100 columns; `--write` makes
// them so. MTDB_VIEWER_BUILD as for the tests.
import {spawnSync} from 'node:child_process';
import {existsSync} from 'node:fs';
import {dirname, join} from 'node:path';
import {fileURLToPath} from 'node:url';

const prettier = join(process.env.MTDB_VIEWER_BUILD, 'node_modules/prettier/bin/prettier.cjs');
const root = join(dirname(fileURLToPath(import.meta.url)), '../..');
if (!existsSync(prettier)) {
  console.log('skipped: npm could not get the packages of the viewer');
  process.exit(77);
}
const files = [
  'tools/viewer/*.mjs',
  'tools/viewer/src/*.ts',
  'tools/viewer/static/*.css',
  'tests/viewer/*.mjs',
];
const mode = process.argv.includes('--write') ? '--write' : '--check';
const {status} = spawnSync(
  process.execPath,
  [prettier, '--config', 'tools/viewer/prettier.json', '--log-level', 'warn', mode, ...files],
  {cwd: root, stdio: 'inherit'},
);
process.exit(status === 0 ? 0 : 1);
