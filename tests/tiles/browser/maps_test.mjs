// SPDX-License-Identifier: Apache-2.0
// node maps_test.mjs MTDB FOLDER [PICTURES]: MapLibre in Chromium draws a terrain of terrain-RGB, from
// a folder and from PMTiles, and its heights are those of the object.
import assert from 'node:assert/strict';
import {writeFileSync} from 'node:fs';
import {join} from 'node:path';
import {folder, launch, open, packages, picture, run, serve} from './browsing.mjs';

const page = `<!doctype html><link rel="icon" href="data:,"><link rel="stylesheet" href="/maplibre/maplibre-gl.css">
<style>html, body, #map { margin: 0; width: 100%; height: 100% }</style><div id="map"></div><script src="/pmtiles/pmtiles.js"></script>
<script type="module">
import * as maplibregl from '/maplibre/maplibre-gl.mjs';
window.maplibregl = maplibregl;
maplibregl.addProtocol('pmtiles', new pmtiles.Protocol({metadata: true}).tile);
</script>`;
const server = await serve(page, {'/maplibre/': join(packages, 'maplibre-gl/dist') + '/', '/pmtiles/': join(packages, 'pmtiles/dist') + '/'});
const browser = await launch();

// In the page.
async function draw({source, center}) {
  const map = new maplibregl.Map({container: 'map', center, zoom: 11.5, pitch: 65, maxPitch: 80, canvasContextAttributes: {preserveDrawingBuffer: true}, attributionControl: false,
    style: {version: 8, sources: {land: source, shade: source}, layers: [{id: 'back', type: 'background', paint: {'background-color': '#ddd'}}, {id: 'shade', type: 'hillshade', source: 'shade'}],
      terrain: {source: 'land', exaggeration: 1}, sky: {'sky-color': '#f0f', 'horizon-color': '#f0f', 'fog-color': '#f0f', 'sky-horizon-blend': 0, 'horizon-fog-blend': 0, 'fog-ground-blend': 1}}});
  const failures = [];
  map.on('error', event => failures.push(String(event.error?.message ?? event)));
  await new Promise(done => map.once('idle', done));
  await new Promise(done => setTimeout(done, 1000));
  return {failures, height: map.queryTerrainElevation(center), zoom: map.getZoom()};
}

try {
  const n = 301, height = (i, j) => Math.round(1500 + 700 * Math.sin(i / 20) * Math.cos(j / 17) + 90 * Math.sin(i / 7 + j / 9));
  let text = `ncols ${n}\nnrows ${n}\nxllcenter 11\nyllcenter 47\ncellsize 0.001\n`;
  for (let j = 0; j < n; ++j) text += Array.from({length: n}, (_, i) => height(i, j)).join(' ') + '\n';
  writeFileSync(join(folder, 'map.asc'), text);
  writeFileSync(join(folder, 'map.prj'), 'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]');
  run('ingest', 'map.asc', 'map.mtdb', '--quiet');
  const center = [11.15, 47.15];
  const [truth] = JSON.parse(run('probe', 'map.mtdb', '--height', center.join(), '--json')).heights;
  for (const [name, output, encoding, size] of [['terrarium', 'rgb', 'terrarium', 256], ['mapbox_pmtiles', 'rgb.pmtiles', 'mapbox', 512]]) {
    run('tile', 'map.mtdb', output, '--as', 'terrain-rgb', '--encoding', encoding, '--tile-pixels', String(size), '--quiet');
    const place = output === 'rgb' ? {tiles: [`${server.url}/rgb/{z}/{x}/{y}.png`], maxzoom: size === 256 ? 11 : 10, bounds: [11, 47, 11.3, 47.3]} : {url: `pmtiles://${server.url}/${output}`};
    const {tab, said} = await open(browser, server.url);
    await tab.waitForFunction(() => window.maplibregl);
    const seen = await tab.evaluate(draw, {source: {type: 'raster-dem', encoding, tileSize: size, ...place}, center});
    const {data} = await picture(tab, 'maplibre_' + name);
    const greys = new Set(data.filter((_, i) => i % 4 === 0)).size;
    console.log(`maplibre, ${name}: ${seen.height?.toFixed(1)} m at the middle, ${truth.height.toFixed(1)} m is true; ${greys} shades`);
    assert.deepEqual([said, seen.failures, server.missing], [[], [], []]);
    assert.ok(Math.abs(seen.height - truth.height) < 20);
    assert.ok(greys > 50, 'no hills are seen');
    await tab.close();
  }
} finally {
  await browser.close();
  server.close();
}
