// SPDX-License-Identifier: Apache-2.0
// node examples_test.mjs MTDB FOLDER [PICTURES]: the pages of docs/examples in Chromium, as they are:
// what they load from a network of servers comes from the packages, if it has their version; tiles come
// from `mtdb serve`, which is another origin, and from a folder.
import assert from 'node:assert/strict';
import {existsSync, readFileSync, writeFileSync} from 'node:fs';
import {join} from 'node:path';
import {folder, launch, open, packages, picture, run, serve, serveTiles} from './browsing.mjs';

const examples = process.env.MTDB_EXAMPLES;
const types = {js: 'text/javascript', mjs: 'text/javascript', json: 'application/json', css: 'text/css', wasm: 'application/wasm'};
const web = await serve('', {'/examples/': examples + '/'});
const browser = await launch();
const unknown = [];

// The package's file behind a URL of jsdelivr.
function packaged(url) {
  const found = /^\/npm\/((?:@[^/]+\/)?[^@/]+)@([^/]+)\/([^?]+)/.exec(new URL(url).pathname + '?');
  if (!found) return null;
  const [, name, version, path] = found;
  const have = JSON.parse(readFileSync(join(packages, name, 'package.json'))).version;
  const file = join(packages, name, path);
  return have === version && existsSync(file) ? file : null;
}

// Everything that a page may load from others, and nothing else.
async function answer(route) {
  const url = route.request().url();
  if (url.startsWith('https://cdn.jsdelivr.net/')) {
    const file = packaged(url);
    if (file) return route.fulfill({path: file, contentType: types[file.split('.').pop()], headers: {'Access-Control-Allow-Origin': '*'}});
  } else if (url.startsWith('https://neuroglancer-demo.appspot.com/')) {
    return route.fulfill({body: '<!doctype html>neuroglancer', contentType: 'text/html'});
  } else if (/^(http:\/\/127\.0\.0\.1:|blob:|data:)/.test(url)) {
    return route.continue();
  }
  unknown.push(url);
  return route.abort();
}

async function show(page, parameters) {
  const {tab, said} = await open(browser, 'about:blank');
  await tab.context().route('**/*', answer);
  await tab.goto(`${web.url}/examples/${page}?${new URLSearchParams(parameters)}`);
  return {tab, said, words: () => tab.evaluate(() => document.getElementById('said').textContent)};
}

// Waits until ready() holds in the page for a second.
async function wait(tab, ready) {
  const begin = Date.now();
  for (let quiet = 0; quiet < 4;) {
    assert.ok(Date.now() - begin < 180000, 'tiles did not come in time');
    await new Promise(done => setTimeout(done, 300));
    quiet = await tab.evaluate(ready) ? quiet + 1 : 0;
  }
}

async function check(name, page, parameters, ready, inspect) {
  const {tab, said, words} = await show(page, parameters);
  try {
    await wait(tab, ready);
  } catch (error) {
    throw Error(`${name}: ${error.message}; the page says '${await words()}', the console ${JSON.stringify(said)}`);
  }
  const told = await tab.evaluate(inspect);
  const {data} = await picture(tab, 'example_' + name);
  const shades = new Set();
  for (let i = 0; i < data.length; i += 4) shades.add(data[i] << 16 | data[i + 1] << 8 | data[i + 2]);
  console.log(`${page}, ${name}: ${JSON.stringify(told)}, ${shades.size} colours`);
  assert.deepEqual([said, await words(), unknown, web.missing], [[], '', [], []]);
  assert.ok(shades.size > 100, 'nothing is seen');
  await tab.close();
  return told;
}

// A page that is not told what to show, or what is not there, says so.
async function checkWords(page, parameters, part) {
  const {tab, words} = await show(page, parameters);
  await tab.waitForFunction(() => /[^ .]$/.test(document.getElementById('said').textContent), {timeout: 60000});
  assert.match(await words(), part);
  await tab.close();
}

const servers = [];
try {
  run('generate', 'terrain', 'land.ply', '--triangles', '200k', '--quiet');
  run('ingest', 'land.ply', 'land.mtdb', '--units', 'm', '--quiet');
  const n = 301, height = (i, j) => Math.round(1500 + 700 * Math.sin(i / 20) * Math.cos(j / 17) + 90 * Math.sin(i / 7 + j / 9));
  let text = `ncols ${n}\nnrows ${n}\nxllcenter 11\nyllcenter 47\ncellsize 0.001\n`;
  for (let j = 0; j < n; ++j) text += Array.from({length: n}, (_, i) => height(i, j)).join(' ') + '\n';
  writeFileSync(join(folder, 'alps.asc'), text);
  writeFileSync(join(folder, 'alps.prj'), 'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]');
  run('ingest', 'alps.asc', 'alps.mtdb', '--quiet');
  run('tile', 'alps.mtdb', 'alps.pmtiles', '--as', 'terrain-rgb', '--quiet');
  run('tile', 'land.mtdb', 'cells', '--as', 'neuroglancer', '--quiet');
  const land = await serveTiles('land.mtdb', web.url), alps = await serveTiles('alps.mtdb', web.url);
  servers.push(land, alps);
  const tree = `${land.url}/objects/land/3dtiles/tile-triangles=500`;

  for (const [name, tiles] of [['local', `${tree}/tileset.json`], ['globe', `${tree}&at=11,47,500/tileset.json`]]) {
    const seen = await check('cesium_' + name, 'cesium.html', {tiles},
      () => window.tileset?.tilesLoaded && tileset._selectedTiles.length > 0,
      () => ({tiles: tileset._selectedTiles.length, levels: new Set(tileset._selectedTiles.map(t => t.geometricError)).size}));
    assert.ok(seen.tiles >= 4);
    const three = await check('three_' + name, 'three.html', {tiles},
      () => window.tiles?.visibleTiles.size > 0 && tiles.stats.downloading + tiles.stats.parsing === 0 && tiles.loadProgress === 1,
      () => {
        const {triangles} = renderer.info.render;
        return {tiles: tiles.visibleTiles.size, triangles, pixels: Math.max(...[...tiles.visibleTiles].map(t => t.traversal.error))};
      });
    assert.ok(three.tiles >= 4 && three.triangles > 2000);
    assert.ok(three.pixels > 0 && three.pixels <= 16, 'tiles are coarser than asked for');
  }
  const terrain = await check('cesium_terrain', 'cesium.html', {terrain: `${alps.url}/objects/alps/quantized-mesh`},
    () => window.viewer?.scene.globe.tilesLoaded && viewer.scene.globe._surface._tilesToRender.length > 0,
    () => ({tiles: viewer.scene.globe._surface._tilesToRender.length, level: Math.max(...viewer.scene.globe._surface._tilesToRender.map(t => t.level)),
      height: viewer.scene.globe.getHeight(Cesium.Cartographic.fromDegrees(11.15, 47.15))}));
  const [truth] = JSON.parse(run('probe', 'alps.mtdb', '--height', '11.15,47.15', '--json')).heights;
  assert.ok(terrain.level >= 8);
  assert.ok(Math.abs(terrain.height - truth.height) < 60, `${terrain.height} m, not ${truth.height}`);
  for (const tiles of [`${alps.url}/objects/alps/terrain-rgb/tiles.json`, `${alps.url}/objects/alps/terrain-rgb/encoding=mapbox&tile-pixels=512/tiles.json`, `${web.url}/alps.pmtiles`]) {
    const {height: drawn} = await check('maplibre_' + (tiles.endsWith('.pmtiles') ? 'pmtiles' : tiles.includes('mapbox') ? 'mapbox' : 'terrarium'), 'maplibre.html', {tiles},
      () => window.map?.loaded() && map.areTilesLoaded(), () => ({height: map.queryTerrainElevation([11.15, 47.15])}));
    assert.ok(Math.abs(drawn - truth.height) < 60, `${drawn} m, not ${truth.height}`);
  }

  const {tab} = await show('neuroglancer.html', {source: '/cells'});
  await tab.waitForURL('https://neuroglancer-demo.appspot.com/**');
  const state = JSON.parse(decodeURIComponent(tab.url().split('#!')[1]));
  assert.deepEqual(state.layers, [{type: 'segmentation', name: 'cells', source: `precomputed://${web.url}/cells`, segments: ['1']}]);
  await tab.close();
  const served = await show('neuroglancer.html', {source: `${land.url}/objects/land/neuroglancer`});
  await served.tab.waitForURL('https://neuroglancer-demo.appspot.com/**');
  await served.tab.close();

  await checkWords('cesium.html', {}, /\?tiles=URL/);
  await checkWords('three.html', {}, /\?tiles=URL/);
  await checkWords('maplibre.html', {}, /\?tiles=URL/);
  await checkWords('neuroglancer.html', {}, /\?source=URL/);
  await checkWords('maplibre.html', {tiles: `${land.url}/objects/land/terrain-rgb/tiles.json`}, /400/);
  await checkWords('three.html', {tiles: `${land.url}/objects/nothing/3dtiles/tileset.json`}, /404/);
} finally {
  await browser.close();
  web.close();
  for (const server of servers) server.stop();
}
