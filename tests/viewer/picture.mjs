// SPDX-License-Identifier: Apache-2.0
// Pictures of the page, for the main README and the quickstart. MTDB_BINARY and MTDB_VIEWER_BUILD
// as for the tests.
//   node tests/viewer/picture.mjs sculpture docs/viewer.png                     a turned box of full resolution in 400,000 triangles
//   node tests/viewer/picture.mjs helens docs/viewer_terrain.png FILE.dem       the wedge; FILE.dem: see tests/viewer/README.md
//   node tests/viewer/picture.mjs store OUT.png STORE [WIDTHxHEIGHT [LINK]]     any store
import {existsSync, writeFileSync} from 'node:fs';
import {close, exact, file, launch, open, run, serve} from './testing.mjs';

const [kind, out, source, size = '1366x768', otherLink = ''] = process.argv.slice(2);
const links = {
  sculpture:
    '#o=sculpture&eye=2.12,-4.102,2.132&look=-0.151,0.027,0.067&px=6&wireframe=true&region=turned_box:0.1,-0.75,0.45,0.9,0.8,0.7,30,12,0',
  helens:
    '#o=helens&eye=561700,5105600,3600&look=562600,5116500,1300&px=2&wireframe=true&colour=height&map=tints&light=northwest&unit=m' +
    '&region=wedge:562000,5110500,1900,4,46,11000&inside=distance&outside=coarse',
  store: otherLink,
};
if (links[kind] === undefined || !out || (kind !== 'sculpture' && !existsSync(source ?? ''))) {
  console.error(
    'usage: node picture.mjs sculpture OUT.png | helens OUT.png FILE.dem | store OUT.png STORE [WIDTHxHEIGHT [LINK]]',
  );
  process.exit(2);
}
const store = kind === 'store' ? source : file('s.mtdb');
if (kind === 'sculpture')
  run('generate', 'sculpture', file('sculpture.ply'), '--triangles', '400000');
if (kind === 'sculpture') run('ingest', file('sculpture.ply'), store, '--quiet');
if (kind === 'helens') run('ingest', source, store, '--quiet', '--name', 'helens');
const [width, height] = size.split('x').map(Number);
const server = await serve(store),
  browser = await launch();
const page = await open(`${server.url}/${links[kind]}`, {viewport: {width, height}});
await exact(page);
if (kind === 'helens') {
  await page.keyboard.press('t'); // the panel goes, and the picture is larger
  await exact(page);
}
await page.waitForTimeout(300); // for what the page tells about the picture
writeFileSync(out, await page.screenshot());
await close(page);
await browser.close();
await server.stop('SIGTERM');
