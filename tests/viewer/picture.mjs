// SPDX-License-Identifier: Apache-2.0
// node tests/viewer/picture.mjs OUT.png [WIDTHxHEIGHT [LINK]]: the picture of the main README, a box of full resolution in a
// sculpture of 400,000 triangles; or of that store by another link. MTDB_BINARY and MTDB_VIEWER_BUILD as for the tests.
import {writeFileSync} from 'node:fs';
import {close, exact, file, launch, open, run, serve} from './testing.mjs';

const [out, size = '1366x768', link = '#o=sculpture&eye=2.12,-4.102,2.132&look=-0.151,0.027,0.067&px=6&wireframe=true&region=box:-0.2,-1.2,0.1,0.5,-0.3,0.8'] = process.argv.slice(2);
const [width, height] = size.split('x').map(Number);
run('generate', 'sculpture', file('sculpture.ply'), '--triangles', '400000');
run('ingest', file('sculpture.ply'), file('s.mtdb'), '--quiet');
const server = await serve(file('s.mtdb')), browser = await launch();
const page = await open(`${server.url}/${link}`, {viewport: {width, height}});
await exact(page);
writeFileSync(out, await page.screenshot());
await close(page);
await browser.close();
await server.stop('SIGTERM');
