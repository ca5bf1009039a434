// SPDX-License-Identifier: Apache-2.0
// What the tests of the page look at: a store with a sculpture and terrains, behind a server; and
// what they do in the page.
import {writeFileSync} from 'node:fs';
import {decode, exact, file, run, runJson, serve} from './testing.mjs';

export const tests = [];
export const test = (name, f) => tests.push([name, f]);
export const kName = 'sculpture',
  kOdd = 'Hügel <img src=x onerror=alert(1)> &amp; sehr langer Name '.repeat(3).trim();
export const store = file('s.mtdb');

export const status = page => page.textContent('#exactness');
export const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
export const camera = page =>
  page.evaluate(() => ({eye: viewer.navigation.eye(), target: viewer.navigation.target()}));
export const region = page => page.evaluate(() => viewer.scene.focus?.region);
export const box = '&region=box:-0.3,-1.3,0.1,0.4,-0.2,0.8';

// Drags a handle by mouse events; what `during` makes of the page while it is held.
export async function drag(page, handle, dx, dy, during = async () => {}) {
  const [x, y] = (await page.evaluate(() => viewer.handles.places()))[handle];
  await page.mouse.move(x, y);
  await page.mouse.down();
  for (let i = 1; i <= 8; ++i) await page.mouse.move(x + (dx * i) / 8, y + (dy * i) / 8);
  const result = await during();
  await page.mouse.up();
  return result;
}

// The picture without what the page lays over it.
export async function picture(page) {
  await page.evaluate(() => {
    for (const e of document.body.children) if (e.id !== 'stage') e.style.visibility = 'hidden';
    document.activeElement.blur(); // and its frame
  });
  await exact(page);
  const shot = await decode(await page.locator('#canvas').screenshot());
  await page.evaluate(() => {
    for (const e of document.body.children) e.style.visibility = '';
  });
  return shot;
}
// Pixels all over the picture, so many apart, and what of the surface lies under each.
export async function surfaceUnder(page, stepX, stepY) {
  const places = [];
  for (let y = 12; y < 590; y += stepY) for (let x = 11; x < 790; x += stepX) places.push([x, y]);
  const hits = await page.evaluate(async all => {
    const found = [];
    while (found.length < all.length)
      found.push(
        ...(await Promise.all(
          all
            .slice(found.length, found.length + 25)
            .map(([x, y]) => viewer.probe(x + 0.5, y + 0.5).then(hit => hit?.point)),
        )),
      );
    return found;
  }, places);
  return [places, hits];
}
export const at = (shot, x, y) => [
  ...shot.data.subarray(4 * (y * shot.width + x), 4 * (y * shot.width + x) + 3),
];

function writeUtm(path) {
  const n = 80,
    lines = [
      'ply',
      'format ascii 1.0',
      `element vertex ${n * n}`,
      'property double x',
      'property double y',
      'property double z',
      'property uchar red',
      'property uchar green',
      'property uchar blue',
      'property float quality',
      `element face ${2 * (n - 1) ** 2}`,
      'property list uchar int vertex_indices',
      'end_header',
    ];
  for (let i = 0; i < n * n; ++i) {
    const x = i % n,
      y = Math.floor(i / n),
      z = 4 * Math.sin(x / 7) * Math.cos(y / 9) + 0.7 * Math.sin(x * 1.7 + y);
    lines.push(
      `${500000 + x * 0.75} ${5400000 + y * 0.75} ${(300 + z).toFixed(4)} ${3 * x} ${3 * y} 120 ${(x + y / 2).toFixed(2)}`,
    );
  }
  for (let y = 0; y + 1 < n; ++y)
    for (let x = 0; x + 1 < n; ++x) {
      const a = y * n + x;
      lines.push(`3 ${a} ${a + 1} ${a + n}`, `3 ${a + 1} ${a + n + 1} ${a + n}`);
    }
  writeFileSync(path, lines.join('\n') + '\n');
}

// An ESRI ASCII grid of heights, by longitude and latitude.
function writeDegrees(path) {
  const n = 60,
    rows = [];
  for (let y = 0; y < n; ++y)
    rows.push(
      Array.from({length: n}, (_, x) =>
        Math.round(
          1500 +
            900 * Math.exp(-((x - 30) ** 2 + (y - 28) ** 2) / 220) +
            60 * Math.sin(x / 2.1) * Math.cos(y / 1.7),
        ),
      ).join(' '),
    );
  writeFileSync(
    path,
    `ncols ${n}\nnrows ${n}\nxllcorner -122.25\nyllcorner 46.0\ncellsize 0.0008333333\nNODATA_value -9999\n${rows.join('\n')}\n`,
  );
  writeFileSync(
    path.replace(/asc$/, 'prj'),
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]',
  );
}

// A cone of 6,400 triangles that stands on y = 0, its tip at y = 30.
export const kCone = 'cone';
function writeCone(path) {
  const n = 80,
    rings = 40,
    lines = [];
  for (let r = 0; r < rings; ++r)
    for (let c = 0; c < n; ++c) {
      const a = (2 * Math.PI * c) / n,
        size = (10 + 0.3 * Math.sin(9 * a + r)) * (1 - r / rings);
      lines.push(`v ${size * Math.cos(a)} ${(30 * r) / rings} ${-size * Math.sin(a)}`);
    }
  lines.push('v 0 30 0', 'v 0 0 0');
  for (let c = 0; c < n; ++c) {
    const d = (c + 1) % n,
      last = (rings - 1) * n;
    for (let r = 0; r + 1 < rings; ++r)
      lines.push(
        `f ${r * n + c + 1} ${r * n + d + 1} ${(r + 1) * n + d + 1} ${(r + 1) * n + c + 1}`,
      );
    lines.push(
      `f ${last + c + 1} ${last + d + 1} ${rings * n + 1}`,
      `f ${d + 1} ${c + 1} ${rings * n + 2}`,
    );
  }
  writeFileSync(path, lines.join('\n') + '\n');
}

run('generate', 'sculpture', file('sculpture.ply'), '--triangles', '60000');
run('generate', 'terrain', file('small.ply'), '--triangles', '3000');
writeUtm(file('utm.ply'));
run('ingest', file('sculpture.ply'), store, '--quiet', '--name', kName);
run('ingest', file('utm.ply'), store, '--quiet', '--name', kOdd, '--step', '0.01');
run('ingest', file('utm.ply'), store, '--quiet', '--name', 'utm', '--step', '0.01');
run('generate', 'terrain', file('terrain.ply'), '--triangles', '20000');
run('ingest', file('terrain.ply'), store, '--quiet', '--name', 'terrain');
writeCone(file('cone.obj'));
run('ingest', file('cone.obj'), store, '--quiet', '--name', kCone, '--units', 'mm');
writeDegrees(file('degrees.asc'));
run('ingest', file('degrees.asc'), store, '--quiet', '--name', 'degrees');
export const info = runJson('info', store, '--name', kName).objects[0];
export const server = await serve(store);
