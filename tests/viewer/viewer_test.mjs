// SPDX-License-Identifier: Apache-2.0
// The page of the viewer in a real browser, against what the command line says. Waits for states,
// never for times. node viewer_test.mjs [WORD]: the tests whose names have the word.
import {launch} from './testing.mjs';
import {server, tests} from './scene.mjs';
import './drawing.mjs';
import './regions.mjs';
import './moving.mjs';
import './taking.mjs';
import './sources.mjs';
import './draping.mjs';
import './texturing.mjs';
import './showing.mjs';

const browser = await launch();
if ((await fetch(server.url + '/')).status !== 200) {
  console.log('skipped: this mtdb was built without the viewer');
  process.exit(77);
}
let failed = 0;
for (const [name, f] of tests.filter(([n]) => n.includes(process.argv[2] ?? ''))) {
  const begin = Date.now();
  try {
    await f();
    console.log(`ok      ${((Date.now() - begin) / 1000).toFixed(1)} s  ${name}`);
  } catch (error) {
    ++failed;
    console.log(
      `FAILED  ${name}\n        ${error.message.split('\n').slice(0, 4).join('\n        ')}\n${error.stack
        .split('\n')
        .filter(l => l.includes('tests/viewer/'))
        .slice(0, 2)
        .join('\n')}`,
    );
  }
}
await browser.close();
await server.stop('SIGTERM');
process.exit(failed > 0 ? 1 : 0);
