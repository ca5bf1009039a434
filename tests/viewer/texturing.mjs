// SPDX-License-Identifier: Apache-2.0
// Textured objects: each place has the colour that its page has there, at every level of detail.
import {mkdirSync, readFileSync, writeFileSync} from 'node:fs';
import {at, picture, surfaceUnder, test} from './scene.mjs';
import {png} from './png.mjs';
import {
  check,
  close,
  decode,
  exact,
  file,
  open,
  run,
  serve,
  serveFolder,
  until,
} from './testing.mjs';

const kHues = [
  [230, 40, 40],
  [230, 220, 40],
  [40, 200, 60],
  [40, 210, 220],
  [50, 70, 230],
  [220, 60, 220],
];
const kSide = 1100, // pixels of a page
  kCellsAcross = 8;
const kBare = [185, 178, 166]; // the surface's own colour
// No shift or turn maps the pattern of a page to itself, and each page has one of its own.
const hueOf = (page, i, j) => (7 * i * i + 3 * j + i * j + 2 * page) % 6;

// A wavy sheet over x and y from 0 to 3, y to 1: page 0 over the first square, page 1 mirrored and
// twice as often over the second, and nothing over the third.
const folder = file('textured');
mkdirSync(folder);
function writeSheet() {
  const n = 40,
    across = 3 * n + 1,
    lines = ['mtllib sheet.mtl'];
  for (let y = 0; y <= n; ++y)
    for (let x = 0; x < across; ++x)
      lines.push(
        `v ${x / n} ${y / n} ${(0.08 * Math.sin((5 * x) / n) * Math.cos((4 * y) / n)).toFixed(6)}`,
      );
  for (let y = 0; y <= n; ++y) for (let x = 0; x <= n; ++x) lines.push(`vt ${x / n} ${y / n}`);
  for (let y = 0; y <= n; ++y)
    for (let x = 0; x <= n; ++x) lines.push(`vt ${3 - (2 * x) / n} ${y / n}`);
  for (let square = 0; square < 3; ++square) {
    lines.push(`usemtl square${square}`);
    for (let y = 0; y < n; ++y)
      for (let x = 0; x < n; ++x) {
        const corner = (i, j) => {
          const vertex = j * across + square * n + i + 1,
            place = square * (n + 1) ** 2 + j * (n + 1) + i + 1;
          return square < 2 ? `${vertex}/${place}` : `${vertex}`;
        };
        lines.push(
          `f ${corner(x, y)} ${corner(x + 1, y)} ${corner(x + 1, y + 1)}`,
          `f ${corner(x, y)} ${corner(x + 1, y + 1)} ${corner(x, y + 1)}`,
        );
      }
  }
  writeFileSync(`${folder}/sheet.obj`, lines.join('\n') + '\n');
  writeFileSync(
    `${folder}/sheet.mtl`,
    'newmtl square0\nmap_Kd page0.png\nnewmtl square1\nmap_Kd page1.png\nnewmtl square2\nKd 1 1 1\n',
  );
  for (const page of [0, 1])
    writeFileSync(
      `${folder}/page${page}.png`,
      png(kSide, kSide, (x, y) => {
        const cell = kSide / kCellsAcross;
        return [...kHues[hueOf(page, Math.floor(x / cell), Math.floor(y / cell))], 255];
      }),
    );
}
writeSheet();
const textured = `${folder}/sheet.mtdb`;
run('ingest', `${folder}/sheet.obj`, textured, '--name', 'sheet', '--quiet');

// The colour at a place of the sheet; null near the border of a cell.
function colourAt([x, y], margin) {
  const square = Math.min(2, Math.floor(x));
  if (square === 2) return x > 2.02 ? kBare : null;
  const u = square === 0 ? x : 3 - 2 * (x - 1),
    column = (u - Math.floor(u)) * kCellsAcross,
    row = (1 - y) * kCellsAcross;
  if ([column, row].some(c => Math.abs(c - Math.round(c)) < margin)) return null;
  return kHues[hueOf(square, Math.floor(column), Math.floor(row))];
}

export const settled = page =>
  page.waitForFunction(
    () =>
      viewer.textures.settled &&
      [...viewer.scene.objects.values()].every(
        o => o.pages !== null || o.info.texture === undefined,
      ),
  );

const distance = (a, b) => Math.hypot(...a.map((x, k) => x - b[k]));
async function compare(page, {margin = 0.12, spared = 0.01, least = 50, z = () => true} = {}) {
  await exact(page);
  await settled(page);
  const now = await picture(page),
    [places, hits] = await surfaceUnder(page, 29, 23);
  const wrong = [];
  let count = 0;
  hits.forEach((point, n) => {
    const right = point && z(point) && colourAt(point, margin);
    if (!right) return;
    ++count;
    // Tiles are JPEG files: it is enough that no other colour is nearer.
    const shown = at(now, ...places[n]),
      others = [...kHues, kBare].filter(hue => hue !== right);
    if (
      others.some(hue => distance(shown, hue) < distance(shown, right)) ||
      distance(shown, right) > 60
    )
      wrong.push(`at ${places[n]} (${point.map(x => x.toFixed(3))}): ${shown} and not ${right}`);
  });
  check(count > least, `only ${count} places show the texture`);
  check(
    wrong.length <= spared * count,
    `${wrong.length} of ${count} places are wrong: ${wrong.slice(0, 4).join('; ')}`,
  );
}
// Coarser and finer meshes, other shading, and other colours in between.
async function change(page) {
  await page.evaluate(() => viewer.navigation.view('home', false));
  // A coarse mesh, and a fine one again: triangles come and go.
  const triangles = () => page.evaluate(() => viewer.scene.total(o => o.mesh.triangles)),
    all = await triangles();
  await page.evaluate(() => ((viewer.scene.pixels = 8), viewer.scene.restart()));
  await compare(page, {margin: 0.25, spared: 0.03, least: 20});
  check((await triangles()) < all / 4, `${await triangles()} of ${all} triangles`);
  await page.evaluate(() => viewer.look.restyle({wireframe: true}));
  await compare(page, {margin: 0.25, spared: 0.5, least: 20}); // edges are over it
  await page.evaluate(() => viewer.look.restyle({wireframe: false}));
  await page.evaluate(() => ((viewer.scene.pixels = 0.5), viewer.scene.restart()));
  await compare(page);
  await page.evaluate(() => viewer.look.restyle({shading: 'flat'}));
  await compare(page);
  // Other colours in between.
  for (const colour of ['cluster', 'plain']) {
    await page.evaluate(c => viewer.look.restyle({colour: c}), colour);
    await until(
      () => page.evaluate(() => !viewer.scene.objects.get('sheet').mesh.isTextured),
      `${colour} is shown`,
      60,
    );
  }
  await page.evaluate(() => viewer.look.restyle({colour: 'texture', shading: 'smooth'}));
  await until(
    () => page.evaluate(() => viewer.scene.objects.get('sheet').mesh.isTextured),
    'the texture is back',
    60,
  );
  await compare(page);
}

const unlit = '&light=none&back=same';

for (const [name, from] of [
  ['a server', async () => await serve(textured)],
  [
    'a packed file',
    async () => {
      run('view', '--write-page', `${folder}/site`);
      run('pack', textured, `${folder}/site/sheet.mtdbp`);
      const web = await serveFolder(`${folder}/site`);
      return {...web, url: `${web.url}/index.html?src=sheet.mtdbp`};
    },
  ],
])
  test(`textures: each place has the colour of its page, at every level of detail (${name})`, async () => {
    const own = await from(),
      address = name === 'a server' ? `${own.url}/` : own.url;
    const page = await open(`${address}#o=sheet${unlit}`);
    await exact(page);
    check(
      (await page.evaluate(() => viewer.look.style.colour)) === 'texture',
      'the texture is shown by itself',
    );
    check(!/colour=/.test(page.url()), page.url());
    await compare(page);
    // Close by, and at an angle.
    await page.evaluate(() => viewer.navigation.set([1.03, 0.28, 0.32], [1.02, 0.45, 0], false));
    await compare(page, {margin: 0.08});
    const levels = await page.evaluate(() => {
      const [row] = viewer.textures.figures();
      return row;
    });
    check(/tiles/.test(levels[0]) && /^\d+, in \d+ MiB$/.test(levels[1]), JSON.stringify(levels));
    if (name === 'a server') await change(page);
    check(page.wrong.length === 0, page.wrong.join('; '));
    await close(page);
    await own.stop('SIGTERM');
  });

test('textures: the panel offers them where they can be shown, says why not, and links carry it', async () => {
  const own = await serve(textured);
  const page = await open(`${own.url}/`);
  await exact(page);
  const offered = () =>
    page.evaluate(() => {
      const option = document.querySelector('#colour option[value=texture]');
      return [option?.disabled, document.getElementById('texture-hint').hidden];
    });
  check(String(await offered()) === 'false,true', String(await offered()));
  await page.selectOption('#colour', 'plain');
  await until(() => /colour=plain/.test(page.url()), 'the link has the colour', 60);
  await page.selectOption('#colour', 'texture');
  await page.selectOption('#light', 'none');
  await until(
    () => /light=none/.test(page.url()) && !/colour=/.test(page.url()),
    'the link has the light',
    60,
  );
  await compare(page);
  // The server's sessions have no corners.
  await page.selectOption('#way', 'thin');
  check(String(await offered()) === 'true,false', String(await offered()));
  check(
    /cut in this page/.test(await page.textContent('#texture-hint')),
    await page.textContent('#texture-hint'),
  );
  await exact(page);
  const plain = await picture(page);
  check(distance(at(plain, 400, 330), kBare) < 30, `${at(plain, 400, 330)}`);
  await page.selectOption('#way', 'thick');
  await compare(page);
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
  await own.stop('SIGTERM');
});

test('textures: regions, edges, pictures, and a card that was reset', async () => {
  const own = await serve(textured);
  const page = await open(
    `${own.url}/#o=sheet${unlit}&region=sphere:1.2,0.5,0,0.8&outside=clip&inside=full`,
  );
  await compare(page, {
    margin: 0.15,
    spared: 0.03,
    least: 20,
    z: ([x, y]) => Math.hypot(x - 1.2, y - 0.5) < 0.75,
  });
  await page.evaluate(() => document.querySelectorAll('details').forEach(d => (d.open = true)));
  await page.selectOption('#region', '');
  // Larger than the page's, and finer.
  await page.selectOption('#picture-size', '2');
  const [download] = await Promise.all([page.waitForEvent('download'), page.click('#picture')]);
  const taken = await decode(readFileSync(await download.path()));
  check(taken.width === 1600 && taken.height === 1200, `${taken.width} x ${taken.height}`);
  const hues = new Set();
  for (let y = 300; y < 900; y += 20)
    for (let x = 300; x < 1300; x += 20) {
      const hue = kHues.findIndex(h => distance(at(taken, x, y), h) < 40);
      if (hue >= 0) hues.add(hue);
    }
  check(hues.size === 6, `${hues.size} of six colours are in the picture`);
  await page.evaluate(async () => {
    const lose = viewer.renderer.getContext().getExtension('WEBGL_lose_context');
    const event = name =>
      new Promise(done => viewer.canvas.addEventListener(name, done, {once: true}));
    const lost = event('webglcontextlost');
    lose.loseContext();
    await lost;
    await new Promise(done => setTimeout(done, 50));
    const restored = event('webglcontextrestored');
    lose.restoreContext();
    await restored;
  });
  await compare(page);
  check(
    page.wrong.every(text => /context/i.test(text)),
    page.wrong.join('; '),
  );
  await close(page);
  await own.stop('SIGTERM');
});

test('textures: a tile that is damaged leaves its place coarser, and the page says so', async () => {
  run('view', '--write-page', `${folder}/damaged`);
  run('pack', textured, `${folder}/damaged/sheet.mtdbp`);
  const bytes = readFileSync(`${folder}/damaged/sheet.mtdbp`),
    begin = bytes.indexOf('MTTL'),
    pages = bytes.readUInt32LE(begin + 12),
    levels = bytes.readUInt16LE(begin + 10),
    finest = begin + 16 + 12 * pages + 16 * (levels - 1);
  const end = begin + Number(bytes.readBigUInt64LE(finest) + bytes.readBigUInt64LE(finest + 8));
  bytes[end - 100] ^= 0x55; // of the last tile, the lower right one of the last page
  writeFileSync(`${folder}/damaged/sheet.mtdbp`, bytes);
  const web = await serveFolder(`${folder}/damaged`);
  const page = await open(`${web.url}/index.html?src=sheet.mtdbp#o=sheet${unlit}`);
  await exact(page);
  await page.evaluate(() => viewer.navigation.set([1.03, 0.05, 0.1], [1.03, 0.051, 0], false));
  await until(
    async () => /wrong checksum/.test(await page.textContent('#banner')),
    'the damaged tile is said',
  );
  await compare(page, {margin: 0.25, spared: 0.05, least: 40});
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
  await web.stop();
});
