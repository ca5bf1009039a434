// node tests/viewer/picture.mjs OUT.png [WIDTHxHEIGHT [LINK]]: the picture of the main README, a box of full resolution in a
// sculpture of two million triangles; or of that store by another link. MTDB_BINARY and MTDB_VIEWER_BUILD as for the tests.
import {writeFileSync} from 'node:fs';
import {close, exact, file, launch, open, run, serve} from './testing.mjs';

const [out, size = '1200x800', link = '#o=sculpture&px=5&wireframe=true&region=box:-0.2,-1.2,0.1,0.5,-0.3,0.8'] = process.argv.slice(2);
const [width, height] = size.split('x').map(Number);
const triangles = process.env.MTDB_TRIANGLES ?? '2000000';
run('generate', 'sculpture', file('sculpture.ply'), '--triangles', triangles);
run('ingest', file('sculpture.ply'), file('s.mtdb'), '--quiet');
const server = await serve(file('s.mtdb')), browser = await launch();
const page = await open(`${server.url}/${link}`, {viewport: {width, height}});
await exact(page);
writeFileSync(out, await page.screenshot());
await close(page);
await browser.close();
await server.stop('SIGTERM');
