// SPDX-License-Identifier: Apache-2.0
// node neuroglancer_test.mjs MTDB FOLDER [PICTURES]: neuroglancer in Chromium looks at segments, in
// files of their own and in shards, from afar and from near, where several levels meet.
import assert from 'node:assert/strict';
import {readFileSync} from 'node:fs';
import {join} from 'node:path';
import {build} from 'esbuild';
import {countBackground, folder, launch, open, packages, picture, run, serve, serveTiles} from './browsing.mjs';

const library = join(packages, 'neuroglancer/lib');
const app = join(folder, 'app');
// Its icons come from a package that npm does not have.
const icons = {name: 'icons', setup(bundle) {
  bundle.onResolve({filter: /^ikonate\//}, ({path}) => ({path, namespace: 'icon'}));
  bundle.onLoad({filter: /.*/, namespace: 'icon'}, () => ({contents: 'export default "<svg></svg>"'}));
}};
await build({entryPoints: ['main', 'chunk_worker', 'async_computation'].map(name => join(library, name + '.bundle.js')),
  bundle: true, format: 'esm', outdir: app, plugins: [icons], loader: {'.svg': 'text', '.html': 'text'}, logLevel: 'error', target: 'chrome110'});

const page = `<!doctype html><link rel="icon" href="data:,"><link rel="stylesheet" href="/app/main.bundle.css"><script type="module" src="/app/main.bundle.js"></script>
<style>html, body { margin: 0 } #neuroglancer-container { width: 100vw; height: 100vh }</style><div id="neuroglancer-container"></div>`;
const server = await serve(page, {'/app/neuroglancer_draco.wasm': join(library, 'mesh/draco/neuroglancer_draco.wasm'), '/app/': app + '/'});
const browser = await launch();

// The levels of the fragments that were fetched, by where they lie in the file.
function levelsFetched(tree, id) {
  const index = readFileSync(join(folder, tree, id + '.index'));
  const lods = index.readUInt32LE(24), ends = [];
  let at = 28 + 20 * lods, end = 0;
  for (let lod = 0; lod < lods; ++lod) {
    const count = index.readUInt32LE(28 + 16 * lods + 4 * lod);
    for (let i = 0; i < count; ++i) end += index.readUInt32LE(at + 12 * count + 4 * i);
    at += 16 * count;
    ends.push(end);
  }
  const begins = server.asked.filter(({path}) => path === `/${tree}/${id}`).map(({range}) => Number(/bytes=(\d+)-/.exec(range)[1]));
  return new Set(begins.map(begin => ends.findIndex(e => begin < e)));
}

async function look(name, tree, segments, view, source = `${server.url}/${tree}`) {
  const state = {layers: [{type: 'segmentation', name: tree, source: `precomputed://${source}`, segments}],
    layout: '3d', showAxisLines: false, showSlices: false, projectionBackgroundColor: '#ff00ff', ...view};
  server.asked.length = 0;
  const {tab, said} = await open(browser, `${server.url}/#!${encodeURIComponent(JSON.stringify(state))}`);
  await tab.waitForFunction(() => window.viewer, {timeout: 60000});
  const begin = Date.now();
  let count = -1, quiet = 0;
  while (quiet < 6 && Date.now() - begin < 120000) {
    await new Promise(done => setTimeout(done, 500));
    const isReady = await tab.evaluate(() => viewer.isReady());
    quiet = isReady && server.asked.length === count ? quiet + 1 : 0;
    count = server.asked.length;
  }
  assert.ok(quiet >= 6, 'fragments did not come in time');
  const names = await tab.evaluate(() => viewer.layerManager.managedLayers[0].layer.displayState.segmentationGroupState.value.segmentPropertyMap.value?.segmentPropertyMap.inlineProperties.properties[0].values);
  const seen = countBackground(await picture(tab, name));
  assert.deepEqual([said, server.missing], [[], []]);
  assert.ok(seen.background < 0.9 * seen.pixels, 'nothing is seen');
  await tab.close();
  return {...seen, names};
}

try {
  run('generate', 'terrain', 'land.ply', '--triangles', '400k', '--quiet');
  run('ingest', 'land.ply', 'land.mtdb', '--units', 'um', '--quiet');
  run('tile', 'land.mtdb', 'near', '--as', 'neuroglancer', '--tile-triangles', '4000', '--quiet');
  const {bounds, diagonal} = JSON.parse(run('info', 'land.mtdb', '--json')).objects[0];
  const unit = 1000, middle = [0, 1, 2].map(i => unit * (bounds.min[i] + bounds.max[i]) / 2);
  const dimensions = {x: [1e-9, 'm'], y: [1e-9, 'm'], z: [1e-9, 'm']};
  // From the side, so that what is near is finer than what is far.
  const near = {dimensions, position: middle, projectionScale: 0.35 * unit * diagonal, projectionOrientation: [Math.sin(-1.05), 0, 0, Math.cos(-1.05)]};
  const seen = await look('neuroglancer', 'near', ['1'], near);
  const levels = levelsFetched('near', '1');
  console.log(`neuroglancer: ${levels.size} levels, ${seen.cracks} pixels of cracks, ${seen.background} of ${seen.pixels} of background`);
  assert.ok(levels.size >= 3, 'few levels only');
  assert.equal(seen.cracks, 0);
  // The same fragments from a server of another origin: the same picture.
  const tiles = await serveTiles('land.mtdb', server.url);
  const served = await look('neuroglancer_served', 'near', ['1'], near, `${tiles.url}/objects/land/neuroglancer/tile-triangles=4000`);
  tiles.stop();
  console.log(`neuroglancer, served: ${served.cracks} pixels of cracks, ${served.background} of background`);
  assert.deepEqual([served.cracks, served.background], [0, seen.background]);

  for (const [name, triangles] of [['left', '20000'], ['7', '5000']]) {
    run('generate', 'sculpture', name + '.ply', '--triangles', triangles, '--quiet');
    run('ingest', name + '.ply', 'cells.mtdb', '--name', name, '--units', 'um', '--quiet');
  }
  run('tile', 'cells.mtdb', 'cells', '--as', 'neuroglancer', '--ids', 'all', '--sharded', '--tile-triangles', '1000', '--quiet');
  const both = await look('neuroglancer_sharded', 'cells', ['1', '7'], {dimensions, projectionScale: 6000});
  assert.deepEqual(both.names, ['left', '7']);
  console.log(`neuroglancer, sharded: segments ${both.names.join(' and ')}, ${both.pixels - both.background} pixels of them`);
} finally {
  await browser.close();
  server.close();
}
