// SPDX-License-Identifier: Apache-2.0
// node cesium_test.mjs MTDB FOLDER [PICTURES]: CesiumJS in Chromium looks at 3D Tiles and at
// quantized-mesh, where several levels meet. No file fails, nothing is said on the console, and no
// background is seen through the surface. tools/tile_check --browser runs a copy of it beside its
// packages. PICTURES: a folder for what was seen.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {existsSync, mkdirSync, readFileSync, writeFileSync} from 'node:fs';
import {createServer} from 'node:http';
import {dirname, join} from 'node:path';
import {fileURLToPath} from 'node:url';
import {chromium} from 'playwright-core';

const [mtdb, folder, pictures] = process.argv.slice(2);
const cesium = join(dirname(fileURLToPath(import.meta.url)), 'node_modules/cesium/Build/Cesium');
const run = (...args) => execFileSync(mtdb, args, {cwd: folder, stdio: ['ignore', 'pipe', 'inherit']});

const page = `<!doctype html><link rel="icon" href="data:,"><script>window.CESIUM_BASE_URL = '/cesium/'</script>
<script src="/cesium/Cesium.js"></script><style>html, body, #c, .cesium-widget, canvas { margin: 0; width: 100%; height: 100% }</style><div id="c"></div>`;
const types = {js: 'text/javascript', json: 'application/json', css: 'text/css'};
const missing = [];
const server = createServer((request, response) => {
  const path = new URL(request.url, 'http://x').pathname;
  if (path === '/') return response.writeHead(200, {'Content-Type': 'text/html'}).end(page);
  const file = path.startsWith('/cesium/') ? join(cesium, path.slice(8)) : join(folder, path);
  if (!existsSync(file)) {
    missing.push(path);
    return response.writeHead(404).end();
  }
  response.writeHead(200, {'Content-Type': types[file.split('.').pop()] ?? 'application/octet-stream'});
  response.end(readFileSync(file));
});
await new Promise(done => server.listen(0, '127.0.0.1', done));
const browser = await chromium.launch({executablePath: '/usr/bin/chromium', timeout: 120000,
  args: ['--headless', '--no-sandbox', '--use-angle=swiftshader', '--use-gl=angle', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist']});

// In the page. Waits until all tiles that the view wants are there, and returns the picture.
async function look({kind, tree, place}) {
  const C = Cesium;
  const isTerrain = kind === 'terrain';
  const terrainProvider = isTerrain ? await C.CesiumTerrainProvider.fromUrl('/' + tree, {requestVertexNormals: true}) : new C.EllipsoidTerrainProvider();
  const widget = new C.CesiumWidget('c', {baseLayer: false, skyBox: false, terrainProvider, contextOptions: {webgl: {preserveDrawingBuffer: true}}});
  const {scene, camera} = widget;
  scene.backgroundColor = C.Color.MAGENTA;
  scene.skyAtmosphere.show = scene.globe.showGroundAtmosphere = scene.fog.enabled = false;
  scene.globe.baseColor = C.Color.DARKGRAY;
  scene.globe.enableLighting = isTerrain;
  scene.globe.show = isTerrain;
  for (const star of [scene.sun, scene.moon]) if (star) star.show = false;
  const failures = [];
  let levels, isLoaded;
  if (isTerrain) {
    widget.clock.currentTime = C.JulianDate.fromIso8601('2026-06-21T10:00:00Z');
    camera.setView({destination: C.Cartesian3.fromDegrees(...place), orientation: {heading: 0, pitch: -0.5, roll: 0}});
    const rendered = () => scene.globe._surface._tilesToRender;
    isLoaded = () => rendered().length > 0 && scene.globe.tilesLoaded;
    levels = () => rendered().map(tile => tile.level);
  } else {
    const tiles = await C.Cesium3DTileset.fromUrl(`/${tree}/tileset.json`);
    tiles.tileFailed.addEventListener(event => failures.push(event.url + ': ' + event.message));
    scene.primitives.add(tiles);
    const ball = tiles.boundingSphere;
    camera.lookAt(ball.center, new C.HeadingPitchRange(0.7, -0.35, 0.8 * ball.radius));
    isLoaded = () => tiles.tilesLoaded && tiles._selectedTiles.length > 0;
    levels = () => tiles._selectedTiles.map(tile => tile.geometricError);
  }
  const begin = Date.now();
  let quiet = 0;
  while (quiet < 5 && Date.now() - begin < 240000) {
    await new Promise(done => setTimeout(done, 300));
    quiet = isLoaded() ? quiet + 1 : 0;
  }
  widget.useDefaultRenderLoop = false;
  widget.render();
  const height = isTerrain ? scene.globe.getHeight(camera.positionCartographic) : 0;
  const answer = {failures, levels: [...new Set(levels())], loaded: quiet >= 5, height, picture: widget.canvas.toDataURL('image/png')};
  const gl = widget.canvas.getContext('webgl2'), {width, height: rows} = widget.canvas;
  const pixels = new Uint8Array(4 * width * rows);
  gl.readPixels(0, 0, width, rows, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  const isBackground = i => pixels[4 * i] > 250 && pixels[4 * i + 1] < 5 && pixels[4 * i + 2] > 250;
  // What the background reaches from the picture's sides; the rest of it is seen through a crack.
  const reached = new Uint8Array(width * rows), stack = [];
  const visit = i => {
    if (reached[i] || !isBackground(i)) return;
    reached[i] = 1;
    stack.push(i);
  };
  for (let x = 0; x < width; ++x) { visit(x); visit((rows - 1) * width + x); }
  for (let y = 0; y < rows; ++y) { visit(y * width); visit(y * width + width - 1); }
  while (stack.length > 0) {
    const i = stack.pop(), x = i % width;
    if (x > 0) visit(i - 1);
    if (x + 1 < width) visit(i + 1);
    if (i >= width) visit(i - width);
    if (i + width < width * rows) visit(i + width);
  }
  answer.background = answer.cracks = 0;
  for (let i = 0; i < width * rows; ++i) {
    answer.background += isBackground(i) ? 1 : 0;
    answer.cracks += isBackground(i) && !reached[i] ? 1 : 0;
  }
  answer.pixels = width * rows;
  return answer;
}

async function check(name, what) {
  const tab = await browser.newPage({viewport: {width: 400, height: 300}});
  const said = [];
  tab.on('console', message => { if (message.type() === 'error') said.push(message.text()); });
  tab.on('pageerror', error => said.push(error.message));
  await tab.goto(`http://127.0.0.1:${server.address().port}/`);
  await tab.waitForFunction(() => window.Cesium);
  const seen = await tab.evaluate(look, what);
  if (pictures) {
    mkdirSync(pictures, {recursive: true});
    writeFileSync(join(pictures, name + '.png'), Buffer.from(seen.picture.split(',')[1], 'base64'));
  }
  console.log(`${name}: ${seen.levels.length} levels, ${seen.cracks} pixels of cracks, ${seen.background} of ${seen.pixels} of background`);
  assert.deepEqual([said, seen.failures, missing], [[], [], []]);
  assert.ok(seen.loaded, 'tiles did not come in time');
  assert.ok(seen.levels.length >= 2, 'one level only');
  assert.ok(seen.background < 0.9 * seen.pixels, 'nothing is seen');
  assert.equal(seen.cracks, 0);
  await tab.close();
  return seen;
}

try {
  run('generate', 'terrain', 'land.ply', '--triangles', '400k', '--quiet');
  run('ingest', 'land.ply', 'land.mtdb', '--units', 'm', '--quiet');
  run('tile', 'land.mtdb', 'land', '--tile-triangles', '4000', '--at=11,47,500', '--quiet');
  await check('3dtiles', {kind: 'tiles', tree: 'land'});

  const n = 301;
  const height = (i, j) => Math.round(1500 + 700 * Math.sin(i / 20) * Math.cos(j / 17) + 90 * Math.sin(i * j / 99));
  let text = `ncols ${n}\nnrows ${n}\nxllcenter 11\nyllcenter 47\ncellsize 0.001\n`;
  for (let j = 0; j < n; ++j) text += Array.from({length: n}, (_, i) => height(i, j)).join(' ') + '\n';
  writeFileSync(join(folder, 'alps.asc'), text);
  writeFileSync(join(folder, 'alps.prj'), 'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]');
  run('ingest', 'alps.asc', 'alps.mtdb', '--quiet');
  run('tile', 'alps.mtdb', 'alps', '--as', 'quantized-mesh', '--quiet');
  const seen = await check('quantized-mesh', {kind: 'terrain', tree: 'alps', place: [11.15, 47.02, 5000]});
  const [true_height] = JSON.parse(run('probe', 'alps.mtdb', '--height', '11.15,47.02', '--json')).heights;
  assert.ok(Math.abs(seen.height - true_height.height) < 40, `${seen.height} m, not ${true_height.height}`);
} finally {
  await browser.close();
  server.close();
}
