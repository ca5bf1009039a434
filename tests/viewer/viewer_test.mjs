// SPDX-License-Identifier: Apache-2.0
// The page of the viewer in a real browser, against what the command line says. Waits for states,
// never for times. node viewer_test.mjs [WORD]: the tests whose names have the word.
import {readFileSync, writeFileSync} from 'node:fs';
import {check, close, decode, exact, extracted, file, launch, near, nginxPath, open, run, runJson, same, serve, serveFolder, stepsOf, trianglesOfPly, trianglesOnScreen, until} from './testing.mjs';

const tests = [];
const test = (name, f) => tests.push([name, f]);
const kName = 'sculpture', kOdd = 'Hügel <img src=x onerror=alert(1)> &amp; sehr langer Name '.repeat(3).trim();

const store = file('s.mtdb');
let info, server;
const status = page => page.textContent('#exactness');
const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
const camera = page => page.evaluate(() => ({eye: viewer.navigation.eye(), target: viewer.navigation.target()}));
const region = page => page.evaluate(() => viewer.scene.focus?.region);
const box = '&region=box:-0.3,-1.3,0.1,0.4,-0.2,0.8';

for (const way of ['thick', 'thin']) test(`the page draws an object, in less than 250 kB (${way})`, async () => {
  const page = await open(`${server.url}/?way=${way}#o=${kName}`);
  await exact(page);
  check((await status(page)).startsWith('exact to 1 px = '), await status(page));
  const {'/engine.wasm': engine, ...bytes} = Object.fromEntries(Object.entries(page.bytes).filter(([path]) => !path.startsWith('/objects')));
  check((way === 'thick') === (engine !== undefined) && (way === 'thin') === ('/decoder.wasm' in bytes), `the wrong way: ${Object.keys(page.bytes)}`);
  check(Object.values(bytes).reduce((sum, n) => sum + n, 0) < 250000, `the page has ${JSON.stringify(bytes)} bytes`);
  check((engine ?? 0) < 300000, `the engine has ${engine} bytes`);
  const picture = await decode(await page.locator('#canvas').screenshot());
  const levels = new Set();
  for (let i = 0; i < picture.data.length; i += 4) levels.add(picture.data[i]);
  check(levels.size > 60, `the picture has ${levels.size} levels of red`);
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

for (const way of ['thick', 'thin']) test(`what is on the screen is what mtdb extract gives (${way})`, async () => {
  for (const more of ['', '&px=3', `${box}&outside=view&px=4`, `${box}&outside=coarse`, `${box}&outside=clip`, '&region=sphere:0,-0.8,0.4,0.5&outside=coarse&inside=0.003',
    '&region=half_space:0,0,0,1,0,0&outside=clip&inside=view', '&triangles=20000']) {
    const page = await open(`${server.url}/?way=${way}#o=${kName}${more}`);
    await exact(page);
    const onScreen = await trianglesOnScreen(page, kName, info);
    same(onScreen, await extracted(page, store, kName, info), more);
    check(page.wrong.length === 0, page.wrong.join('; '));
    await close(page);
  }
});

test('errors of triangles are drawn as colours, as are rounds and clusters; of a server none', async () => {
  // All of space, so that each triangle counts for the bound of the mesh.
  const page = await open(`${server.url}/#o=${kName}&region=half_space:100,0,0,1,0,0&inside=0.003&outside=coarse&colour=error`);
  await exact(page);
  const values = () => page.evaluate(name => [...viewer.scene.objects.get(name).mesh.readValues()], kName);
  const errors = await values(), query = await page.evaluate(name => viewer.scene.objects.get(name).wanted, kName);
  writeFileSync(file('query.json'), JSON.stringify(query));
  const stats = runJson('extract', store, file('extracted.ply'), '--name', kName, '--query', file('query.json'));
  check(errors.length === stats.triangles && Math.max(...errors) === Math.fround(stats.error_bound) && new Set(errors).size > 10, `${errors.length} ${Math.max(...errors)} ${JSON.stringify(stats)}`);
  check(await page.textContent('#legend-high') === String(Number(stats.error_bound.toPrecision(4))), await page.textContent('#legend'));
  const colours = async () => {
    const picture = await decode(await page.locator('#canvas').screenshot()), hues = new Set();
    for (let i = 0; i < picture.data.length; i += 4) hues.add(Math.round((picture.data[i] - picture.data[i + 2]) / 16));
    return hues.size;
  };
  const many = await colours();
  await page.selectOption('#colour', 'round');
  await until(async () => new Set(await values()).size < 9, 'the rounds are there');
  const rounds = await values();
  check(rounds.every(round => Number.isInteger(round) && round > 0), 'rounds');
  await page.selectOption('#colour', 'cluster');
  await until(async () => (await values()).some((cluster, i) => cluster !== rounds[i]), 'the clusters are there');
  await page.selectOption('#colour', 'plain');
  await until(async () => await page.evaluate(name => viewer.scene.objects.get(name).mesh.readValues() === null, kName), 'no values any more');
  const few = await colours();
  check(many > 2 * few, `${many} hues, ${few} without`);
  await page.selectOption('#way', 'thin');
  await exact(page);
  check(await page.isVisible('#colour-hint') && await page.evaluate(() => document.querySelector('#colour option[value=error]').disabled), 'the panel says what the server does not tell');
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('the memory that the engine may take holds: the error rises, and the page says to what', async () => {
  const page = await open(`${server.url}/#o=${kName}&px=0.25`);
  await exact(page);
  const ample = await page.evaluate(() => viewer.scene.total(o => o.mesh.triangles));
  const most = 2 ** 20 * 1.5;
  await page.evaluate(bytes => viewer.scene.setLimits({cacheBytes: bytes, bytesPerSecond: 1e6}), most);
  await until(async () => /px = .*; the memory of 2 MiB allows no less/.test(await status(page)), 'the page says what the memory allows');
  await exact(page);
  const [triangles, load, pixels] = await page.evaluate(() => [viewer.scene.total(o => o.mesh.triangles), [...viewer.scene.objects.values()][0].source.traffic.load, viewer.scene.exactness().pixels]);
  check(triangles < ample && triangles > 100 && load.cacheBytes <= most && pixels > 0.25, JSON.stringify([triangles, ample, load, pixels]));
  await page.evaluate(() => viewer.scene.setLimits({cacheBytes: 2 ** 28, bytesPerSecond: Infinity}));
  await until(async () => (await page.evaluate(() => viewer.scene.total(o => o.mesh.triangles))) === ample, 'with more memory the mesh is as fine as before');
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('the switch changes the way, and nothing that is seen', async () => {
  const page = await open(`${server.url}/#o=${kName}${box}&outside=view&px=4`);
  await exact(page);
  const thick = await trianglesOnScreen(page, kName, info);
  check(await page.evaluate(() => viewer.loading.way) === 'thick', 'the engine in the page is the default');
  await page.evaluate(() => document.querySelectorAll('details').forEach(d => (d.open = true)));
  for (const way of ['thin', 'thick']) {
    await page.selectOption('#way', way);
    await exact(page);
    check((new URL(page.url()).searchParams.get('way') ?? 'thick') === way, page.url());
    same(await trianglesOnScreen(page, kName, info), thick, way);
  }
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

for (const way of ['thick', 'thin']) test(`a budget that does not suffice raises the error everywhere, and the page says to what (${way})`, async () => {
  const page = await open(`${server.url}/?way=${way}#o=${kName}&triangles=3000`);
  await exact(page);
  check(/^exact to [0-9.]+ px = .*budget of 3,000 triangles/.test(await status(page)), await status(page));
  const figures = await page.evaluate(() => [viewer.scene.exactness().pixels, viewer.scene.total(o => o.mesh.triangles)]);
  check(figures[0] > 1 && figures[1] <= 3000 && figures[1] > 800, figures.join(' '));
  await close(page);
});

test('dragging the box changes the mesh where the box is', async () => {
  const page = await open(`${server.url}/#o=${kName}${box}&outside=view&px=4`);
  await exact(page);
  const before = await trianglesOnScreen(page, kName, info), first = (await region(page)).box;
  const places = await page.evaluate(() => viewer.handles.places());
  const [x, y] = places.maxx;
  await page.mouse.move(x, y);
  await page.mouse.down();
  const answers = () => page.evaluate(() => viewer.scene.changes);
  const atGrip = await answers();
  for (let i = 1; i <= 10; ++i) await page.mouse.move(x + 8 * i, y + i);
  await until(async () => (await answers()) > atGrip + 5, 'the mesh follows while the box is dragged');
  await page.mouse.up();
  await exact(page);
  const last = (await region(page)).box;
  check(last.max[0] > first.max[0] + 0.1, 'the face was dragged');
  for (const [a, b] of [[first.min, last.min], [[0, ...first.max.slice(1)], [0, ...last.max.slice(1)]]]) near(distance(a, b), 0, 1e-9, 'the other faces stay');
  const after = await trianglesOnScreen(page, kName, info);
  same(after, await extracted(page, store, kName, info), 'after dragging');
  // What has changed lies near the box: where it was, where it is, and where the mesh grows coarse.
  const old = new Set(before);
  const changed = after.filter(t => !old.has(t));
  check(changed.length > 500, `${changed.length} triangles have changed`);
  const reach = 0.12 * info.diagonal;
  const isFar = text => !text.split(',')[0].split(' ').map((n, k) => info.bounds.min[k] + info.step * Number(n))
    .every((c, k) => c > Math.min(first.min[k], last.min[k]) - reach && c < Math.max(first.max[k], last.max[k]) + reach);
  // A few others lie further away, since what is fine needs what it was made of.
  const far = after.filter(isFar), changedFar = far.filter(t => !old.has(t));
  check(far.length > 300, `${far.length} triangles lie far from the box`);
  check(changedFar.length < 0.08 * far.length && changedFar.length < 0.1 * changed.length, `${changedFar.length} of ${changed.length} triangles that changed lie far from the box, where ${far.length} are`);
  const middle = (await page.evaluate(() => viewer.handles.places())).centre;
  await page.mouse.move(...middle);
  await page.mouse.down();
  await page.mouse.move(middle[0] + 30, middle[1] + 40, {steps: 4});
  await page.mouse.up();
  const moved = (await region(page)).box;
  near(distance(moved.min, moved.max), distance(last.min, last.max), 1e-6, 'the whole box moves');
  check(distance(moved.min, last.min) > 0.05, 'the box was moved');
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

// Drags a handle by mouse events; what `during` makes of the page while it is held.
async function drag(page, handle, dx, dy, during = async () => {}) {
  const [x, y] = (await page.evaluate(() => viewer.handles.places()))[handle];
  await page.mouse.move(x, y);
  await page.mouse.down();
  for (let i = 1; i <= 8; ++i) await page.mouse.move(x + (dx * i) / 8, y + (dy * i) / 8);
  const result = await during();
  await page.mouse.up();
  return result;
}
const placesOf = (texts, of) => texts.map(text => text.split(',').map(corner => corner.split(' ').map((n, k) => of.bounds.min[k] + stepsOf(of)[k] * Number(n))));

test('rings turn the box, and what is outside of it is cut away', async () => {
  const page = await open(`${server.url}/#o=${kName}${box}&outside=clip&inside=0.01&back=cap`);
  await exact(page);
  const straight = await trianglesOnScreen(page, kName, info);
  await drag(page, 'turnz', 60, 10);
  await exact(page);
  const {turned_box: turned} = await region(page);
  check(turned && Math.abs(turned.angles[0]) > 5, `the box is turned: ${JSON.stringify(await region(page))}`);
  near(Math.abs(turned.angles[1]) + Math.abs(turned.angles[2]), 0, 1e-9, 'about z only');
  near(distance(turned.half, [0.35, 0.55, 0.35]), 0, 1e-9, 'its size');
  near(distance(turned.centre, [0.05, -0.75, 0.45]), 0, 1e-9, 'its centre');
  const after = await trianglesOnScreen(page, kName, info);
  same(after, await extracted(page, store, kName, info), 'turned');
  check(after.length !== straight.length, 'other triangles are there');
  // All of them reach into the turned box, as computed here.
  const a = (turned.angles[0] * Math.PI) / 180, to = p => {
    const [x, y, z] = p.map((c, k) => c - turned.centre[k]);
    return [Math.cos(a) * x + Math.sin(a) * y, Math.cos(a) * y - Math.sin(a) * x, z];
  };
  for (const corners of placesOf(after, info)) {
    const local = corners.map(to);
    for (let k = 0; k < 3; ++k) {
      check(!local.every(p => p[k] > turned.half[k] + 1e-6) && !local.every(p => p[k] < -turned.half[k] - 1e-6), 'no triangle lies beside the box');
    }
  }
  await drag(page, 'maxx', 30, 0);
  const wider = (await region(page)).turned_box;
  check(Math.abs(wider.half[0] - turned.half[0]) > 1e-3, 'a face is dragged');
  near(distance(wider.centre, turned.centre), Math.abs(wider.half[0] - turned.half[0]), 1e-9, 'the face across stays');
  // The link brings it back.
  await exact(page);
  await until(async () => page.url().includes('turned_box'), 'the address has it');
  const other = await open(page.url());
  await exact(other);
  same(await trianglesOnScreen(other, kName, info), await trianglesOnScreen(page, kName, info), 'the linked page');
  check(page.wrong.length + other.wrong.length === 0, [...page.wrong, ...other.wrong].join('; '));
  await close(other);
  await close(page);
});

test('ball and half-space are dragged', async () => {
  const page = await open(`${server.url}/#o=${kName}&region=sphere:0,-0.8,0.4,0.5&outside=coarse&inside=0.003`);
  await exact(page);
  await drag(page, 'radiusx', 40, 0);
  await exact(page);
  const ball = (await region(page)).sphere;
  check(Math.abs(ball.radius - 0.5) > 0.01 && distance(ball.centre, [0, -0.8, 0.4]) === 0, JSON.stringify(ball));
  same(await trianglesOnScreen(page, kName, info), await extracted(page, store, kName, info), 'the ball');
  await page.evaluate(() => document.querySelectorAll('details').forEach(d => (d.open = true)));
  await page.selectOption('#region', 'half_space');
  await exact(page);
  const before = (await region(page)).half_space;
  await drag(page, 'normal', 50, -40);
  await drag(page, 'centre', 20, 20);
  await exact(page);
  const after = (await region(page)).half_space;
  check(distance(before.normal, after.normal) > 0.05 && distance(before.point, after.point) > 0.01, JSON.stringify(after));
  same(await trianglesOnScreen(page, kName, info), await extracted(page, store, kName, info), 'the half-space');
  await close(page);
});

test('while a box of full resolution is dragged, it is at full resolution soon', async () => {
  const page = await open(`${server.url}/#o=${kName}${box}&outside=coarse`);
  await exact(page);
  const times = [];
  for (let i = 0; i < 4; ++i) {
    // From the last move of the mouse, which the page gets, to the answer in its arrays.
    times.push(await drag(page, 'centre', i % 2 ? -24 : 24, 0, () => page.evaluate(() => new Promise(done => {
      const begin = performance.now();
      const look = () => {
        const object = [...viewer.scene.objects.values()][0];
        if (object.doneText === object.wantedText) done(performance.now() - begin);
        else setTimeout(look, 1);
      };
      look();
    }))));
    same(await trianglesOnScreen(page, kName, info), await extracted(page, store, kName, info), 'while it is held');
  }
  console.log(`        full resolution in the box after ${times.map(t => t.toFixed(0)).join(', ')} ms`);
  await close(page);
});

test('a wedge of a terrain: linear errors from its apex, dragged, and where the camera is', async () => {
  const page = await open(`${server.url}/#o=terrain&region=wedge:5,0,1,0,50,8&inside=distance&outside=coarse&px=2`);
  await exact(page);
  const terrain = JSON.parse(run('info', store, '--name', 'terrain', '--json')).objects[0];
  const query = await page.evaluate(() => viewer.scene.objects.get('terrain').wanted);
  check(query.region.wedge.angle === 50 && query.threshold.linear.slope > 0, JSON.stringify(query));
  same(await trianglesOnScreen(page, 'terrain', terrain), await extracted(page, store, 'terrain', terrain), 'the wedge');
  await page.evaluate(() => viewer.navigation.view('top', false));
  await exact(page);
  await drag(page, 'far', 60, 0);
  await drag(page, 'left', -20, 0);
  await drag(page, 'apex', 10, -20);
  await exact(page);
  const wedge = (await region(page)).wedge;
  check(wedge.direction[0] > 0.05 && Math.abs(wedge.angle - 50) > 1 && distance(wedge.apex, [5, 0, 1]) > 0.05, JSON.stringify(wedge));
  near(wedge.apex[2], 1, 1e-9, 'the apex keeps its height');
  same(await trianglesOnScreen(page, 'terrain', terrain), await extracted(page, store, 'terrain', terrain), 'dragged');
  await page.evaluate(() => document.querySelectorAll('details').forEach(d => (d.open = true)));
  await page.check('#follow');
  await page.evaluate(() => viewer.navigation.set([2, -1, 2], [5, 5, 0], false));
  await until(async () => distance((await region(page)).wedge.apex, [2, -1, 2]) < 1e-9, 'the wedge is where the camera is');
  await exact(page);
  same(await trianglesOnScreen(page, 'terrain', terrain), await extracted(page, store, 'terrain', terrain), 'the cockpit');
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('a terrain in degrees is drawn in metres, as exact as the camera asks, and measured in its own coordinates', async () => {
  const page = await open(`${server.url}/#o=degrees`);
  await exact(page);
  const terrain = JSON.parse(run('info', store, '--name', 'degrees', '--json')).objects[0];
  const {stretch, size, unit} = await page.evaluate(() => ({stretch: viewer.scene.stretch, size: viewer.navigation.radius(), unit: viewer.unit}));
  near(stretch[0] / stretch[1], Math.cos((46 * Math.PI) / 180), 0.01, 'a degree of longitude');
  check(size > 1000 && size < 20000, `${size} metres`);
  void unit;
  same(await trianglesOnScreen(page, 'degrees', terrain), await extracted(page, store, 'degrees', terrain), 'degrees');
  // Each sample of the full surface is drawn at most a pixel from where it belongs: heights of the
  // page's mesh at the vertices of the full one that are in sight.
  run('extract', store, file('full.ply'), '--name', 'degrees', '--full');
  const full = placesOf(trianglesOfPly(file('full.ply'), terrain), terrain).map(t => t[0]);
  const drawn = placesOf(await trianglesOnScreen(page, 'degrees', terrain), terrain);
  const worst = await page.evaluate(([samples, triangles, s]) => {
    const camera = viewer.navigation.query([viewer.canvas.width, viewer.canvas.height]), pixel = (2 * Math.tan((camera.fov * Math.PI) / 360)) / camera.viewport[1];
    const forward = [0, 1, 2].map(k => camera.target[k] - camera.eye[k]), size = Math.hypot(...forward);
    let most = 0, found = 0;
    for (const [x, y, z] of samples) {
      for (const [a, b, c] of triangles) {
        const d = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        const u = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / d, v = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / d;
        if (!(u >= -1e-9 && v >= -1e-9 && u + v <= 1 + 1e-9)) continue;
        const depth = [x * s[0], y * s[1], z].reduce((sum, q, k) => sum + ((q - camera.eye[k]) * forward[k]) / size, 0);
        most = Math.max(most, Math.abs(a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]) - z) / (depth * pixel));
        ++found;
        break;
      }
    }
    return {most, found};
  }, [full.filter((_, i) => i % 7 === 0), drawn, stretch]);
  check(worst.found > 200, `${worst.found} samples`);
  check(worst.most <= 1, `${worst.most} pixels off`);
  check(worst.most > 0.05, `${worst.most} pixels: more exact than asked for`);
  // Points are the terrain's own, lengths metres.
  await page.keyboard.press('m');
  for (const x of [380, 420]) {
    await page.mouse.click(x, 320);
    await until(() => page.evaluate(n => viewer.measuring.lines.reduce((sum, l) => sum + l.points.length, 0) === n, x === 380 ? 1 : 2), 'the point is there');
  }
  const [a, b] = await page.evaluate(() => viewer.measuring.lines[0].points.map(p => p.point));
  check(a[0] > terrain.bounds.min[0] && a[0] < terrain.bounds.max[0] && a[1] > terrain.bounds.min[1] && a[1] < terrain.bounds.max[1], `${a}`);
  const metres = Math.hypot(...[0, 1, 2].map(k => stretch[k] * (b[k] - a[k])));
  check((await page.textContent('#measured')).includes(String(Number(metres.toPrecision(4)))), `${metres} in ${await page.textContent('#measured')}`);
  // A region in it is a region of the terrain.
  await page.evaluate(() => document.querySelectorAll('details').forEach(d => (d.open = true)));
  for (const kind of ['box', 'turned_box', 'sphere', 'wedge']) {
    await page.selectOption('#region', kind);
    await exact(page);
    same(await trianglesOnScreen(page, 'degrees', terrain), await extracted(page, store, 'degrees', terrain), kind);
  }
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('orbit, pan, zoom to the cursor, double click, views and keys move the camera', async () => {
  const page = await open(`${server.url}/#o=${kName}&px=4`);
  await exact(page);
  const drag = async (button, dx, dy) => {
    await page.mouse.move(420, 300);
    await page.mouse.down({button});
    await page.mouse.move(420 + dx, 300 + dy, {steps: 6});
    await page.mouse.up({button});
    await exact(page);
  };
  const start = await camera(page);
  await drag('left', 120, 30);
  const turned = await camera(page);
  near(distance(turned.eye, turned.target), distance(start.eye, start.target), 1e-3, 'the distance');
  near(distance(turned.target, start.target), 0, 1e-3, 'what the camera turns around');
  check(distance(turned.eye, start.eye) > 0.5, 'the camera turned');
  await drag('right', 60, 0);
  const moved = await camera(page);
  near(distance(moved.eye, turned.eye), distance(moved.target, turned.target), 1e-3, 'panning moves both');
  check(distance(moved.eye, turned.eye) > 0.05, 'the camera was moved');
  // The point under the cursor stays there.
  const at = [470, 250];
  const hit = await page.evaluate(([x, y]) => viewer.probe(x, y), at);
  check(hit, 'there is surface under the cursor');
  const onScreen = p => page.evaluate(q => { const s = viewer.navigation.toScene(q).project(viewer.navigation.camera); return [(s.x + 1) * 400, (1 - s.y) * 300]; }, p);
  await page.mouse.move(...at);
  for (let i = 0; i < 4; ++i) await page.mouse.wheel(0, -120);
  await until(async () => { const c = await camera(page); return distance(c.eye, hit.point) < 0.9 * distance(moved.eye, hit.point); }, 'the wheel zooms');
  await exact(page);
  const stays = await onScreen(hit.point);
  near(Math.hypot(stays[0] - at[0], stays[1] - at[1]), 0, 12, 'the point under the cursor');
  // A double click goes to the exact hit.
  const target = await page.evaluate(() => viewer.probe(400, 300));
  if (target) {
    await page.mouse.dblclick(400, 300);
    await until(async () => distance((await camera(page)).target, target.point) < 1e-6, 'the double click goes there');
    const ray = await page.evaluate(() => viewer.navigation.ray(400, 300));
    void ray;
  }
  await page.keyboard.press('1');
  await until(async () => { const c = await camera(page); return c.eye[2] - c.target[2] > 0.99 * distance(c.eye, c.target); }, '1 looks from above');
  await page.keyboard.press('h');
  await until(async () => { const c = await camera(page); return Math.abs(c.eye[0] - start.eye[0]) < 1e-3; }, 'H shows all');
  await page.keyboard.press('f');
  await page.keyboard.down('w');
  await until(async () => { const c = await camera(page); return distance(c.eye, start.eye) > 0.2; }, 'W flies');
  await page.keyboard.up('w');
  const flown = await camera(page);
  const straight = distance(flown.eye, start.eye) - (distance(start.eye, start.target) - distance(flown.eye, start.target));
  near(straight, 0, 1e-3, 'flying goes where the camera looks');
  await page.mouse.move(300, 200);
  await page.mouse.down();
  await page.mouse.move(360, 200, {steps: 4});
  await page.mouse.up();
  const looked = await camera(page);
  near(distance(looked.eye, flown.eye), 0, 1e-6, 'looking around stays at the place');
  check(distance(looked.target, flown.target) > 0.05, 'dragging looks around');
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('two fingers zoom, one turns', async () => {
  const page = await open(`${server.url}/#o=${kName}&px=4`, {hasTouch: true, isMobile: true, viewport: {width: 390, height: 844}});
  await exact(page);
  const fingers = await page.context().newCDPSession(page);
  const touch = (type, points) => fingers.send('Input.dispatchTouchEvent', {type, touchPoints: points.map(([x, y], id) => ({x, y, id}))});
  const start = await camera(page);
  await touch('touchStart', [[150, 300]]);
  for (let i = 1; i <= 6; ++i) await touch('touchMove', [[150 + 15 * i, 300]]);
  await touch('touchEnd', []);
  await until(async () => distance((await camera(page)).eye, start.eye) > 0.3, 'one finger turns');
  await exact(page);
  const turned = await camera(page);
  await touch('touchStart', [[150, 400], [240, 400]]);
  for (let i = 1; i <= 6; ++i) await touch('touchMove', [[150 - 10 * i, 400], [240 + 10 * i, 400]]);
  await touch('touchEnd', []);
  await until(async () => { const c = await camera(page); return distance(c.eye, c.target) < 0.8 * distance(turned.eye, turned.target); }, 'two fingers zoom');
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('measured points are those of mtdb probe', async () => {
  const page = await open(`${server.url}/#o=${kName}&px=4&unit=mm`);
  await exact(page);
  await page.keyboard.press('m');
  const places = [[430, 250], [455, 420], [380, 480]];
  for (const [i, [x, y]] of places.entries()) {
    await page.mouse.click(x, y);
    await until(() => page.evaluate(n => viewer.measuring.lines.reduce((sum, l) => sum + l.points.length, 0) === n, i + 1), 'the point is there');
  }
  const points = await page.evaluate(() => viewer.measuring.lines[0].points);
  for (const [i, [x, y]] of places.entries()) {
    const {origin, direction} = await page.evaluate(([a, b]) => viewer.navigation.ray(a, b), [x, y]);
    const probed = runJson('probe', store, '--name', kName, `--ray=${[...origin, ...direction].join(',')}`);
    check(probed.hit, 'mtdb probe hits');
    near(distance(probed.point, points[i].point), 0, 1e-12, 'the point');
    check(points[i].error_bound === probed.error_bound, 'its bound');
  }
  const length = distance(points[0].point, points[1].point) + distance(points[1].point, points[2].point);
  check((await page.textContent('#measured')).includes(`${Number(length.toPrecision(4))} mm over 3 points`), await page.textContent('#measured'));
  check(await page.locator('.label').count() === 3, 'a label for each segment, and for the line');
  const take = async button => {
    const [download] = await Promise.all([page.waitForEvent('download'), page.click(button)]);
    return readFileSync(await download.path(), 'utf8');
  };
  const rows = (await take('#csv')).trim().split('\n').map(row => row.split(','));
  check(rows.length === 4 && rows[3].slice(2, 5).every((text, k) => Number(text) === points[2].point[k]), 'the CSV file');
  near(Number(rows[3][7]), length, 1e-12, 'the length in it');
  const json = JSON.parse(await take('#geojson'));
  check(json.features[0].geometry.coordinates.length === 3, 'the GeoJSON file');
  near(json.features[0].properties.height_difference, points[2].point[2] - points[0].point[2], 1e-12, 'the height difference');
  await page.keyboard.press('Backspace');
  check(await page.evaluate(() => viewer.measuring.lines[0].points.length) === 2, 'Backspace takes the last point back');
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('a link brings back camera, region, style and lines', async () => {
  const page = await open(`${server.url}/#o=${kName}${box}&outside=coarse&inside=0.004&px=2&wireframe=true&shading=flat&colour=height&map=cividis&unit=m&line=0,0,0,1,1,1`);
  await exact(page);
  await page.mouse.move(400, 100);
  await page.mouse.down();
  await page.mouse.move(470, 130, {steps: 5});
  await page.mouse.up();
  await exact(page);
  const read = p => p.evaluate(() => JSON.stringify({...viewer.view(), eye: 0, target: 0}));
  await until(async () => decodeURIComponent(page.url()).includes((await camera(page)).eye.join(',')), 'the address has the camera');
  const other = await open(page.url());
  await exact(other);
  check(await read(page) === await read(other), `${await read(page)} and ${await read(other)}`);
  const a = await camera(page), b = await camera(other);
  near(distance(a.eye, b.eye) + distance(a.target, b.target), 0, 1e-9 * info.diagonal, 'the camera');
  same(await trianglesOnScreen(other, kName, info), await trianglesOnScreen(page, kName, info), 'the mesh');
  check(await other.evaluate(() => document.getElementById('wireframe').checked && document.getElementById('shading').value === 'flat'), 'the panel shows the style');
  check(!(await other.locator('#legend').isHidden()), 'the legend is there');
  await close(other);
  await close(page);
  // Whatever is in a link, the page opens.
  const odd = await open(`${server.url}/#o=${kName}&eye=NaN,1&look=x&px=-3&triangles=1e99&region=box:3,2,1,0,0,0&colour=a:none&map=<b>&line=a,b,c&unit=furlong`);
  await exact(odd);
  check(odd.wrong.length === 0, odd.wrong.join('; '));
  await close(odd);
});

test('the mesh that is taken away is that of mtdb extract', async () => {
  const page = await open(`${server.url}/#o=${kName}${box}&outside=view&px=4`);
  await exact(page);
  await page.evaluate(() => document.querySelectorAll('details').forEach(d => (d.open = true)));
  for (const format of ['ply', 'obj', 'glb', 'drc']) {
    await page.selectOption('#format', format);
    await page.fill('#take-error', '0.002');
    const [download] = await Promise.all([page.waitForEvent('download'), page.click('#take')]);
    check(download.suggestedFilename() === `${kName}.${format}`, download.suggestedFilename());
    run('extract', store, file(`box.${format}`), '--name', kName, '--error', '0.002', '--box=-0.3,-1.3,0.1,0.4,-0.2,0.8', '--clip');
    check(readFileSync(await download.path()).equals(readFileSync(file(`box.${format}`))), `the ${format} file`);
  }
  check(/triangles, off by at most/.test(await page.textContent('#take-said')), await page.textContent('#take-said'));
  await page.selectOption('#picture-size', '1920x1080');
  const [download] = await Promise.all([page.waitForEvent('download'), page.click('#picture')]);
  const picture = await decode(readFileSync(await download.path()));
  check(picture.width === 1920 && picture.height === 1080, `${picture.width} x ${picture.height}`);
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('pictures after changes are those of a page that was opened so', async () => {
  const page = await open(`${server.url}/#o=${kName}&px=8`);
  await exact(page);
  const set = (id, value) => page.evaluate(([i, v]) => {
    const element = document.getElementById(i);
    if (element.type === 'checkbox') element.checked = v;
    else element.value = v;
    element.dispatchEvent(new Event(element.type === 'range' ? 'input' : 'change'));
  }, [id, value]);
  for (const [id, value] of [['wireframe', true], ['pixels', '0'], ['wireframe', false], ['pixels', '2'], ['colour', 'height'], ['pixels', '1'], ['wireframe', true], ['shading', 'flat'], ['pixels', '0']]) {
    await set(id, value);
    await exact(page);
  }
  // The address follows the page some time later.
  const fresh = await open(await page.evaluate(() => (viewer.saveView(), location.href)));
  await exact(fresh);
  await until(() => fresh.evaluate(() => viewer.scene.wireframe), 'the fresh page has the style');
  const pictures = [];
  for (const p of [page, fresh]) {
    await p.evaluate(() => [...document.body.children].forEach(e => e.id !== 'stage' && (e.style.display = 'none')));
    pictures.push(await decode(await p.screenshot()));
  }
  // Slots differ, and with them which of two triangles is drawn where both have the same depth.
  let other = 0;
  for (let i = 0; i < pictures[0].data.length; i += 4) if (Math.abs(pictures[0].data[i] - pictures[1].data[i]) > 24) ++other;
  check(other < 400, `${other} pixels differ`);
  for (const p of [page, fresh]) await close(p);
});

test('the picture covers what mtdb render draws', async () => {
  const eye = [1.9, -3.2, 1.4], target = [0, 0, 0.2];
  const page = await open(`${server.url}/#o=${kName}&eye=${eye}&look=${target}`);
  await exact(page);
  // The page's labels and panels are not of the scene.
  await page.evaluate(() => [...document.body.children].forEach(e => e.id !== 'stage' && (e.style.display = 'none')));
  const ours = await decode(await page.screenshot());
  run('render', store, file('r.png'), '--name', kName, '--pixels', '1', '--frustum', '--eye=' + eye, '--target=' + target, '--fov', '45', '--viewport', '800x600', '--size', '800x600');
  const theirs = await decode(readFileSync(file('r.png')));
  check(theirs.width === ours.width && theirs.height === ours.height, 'the sizes');
  // The page's ground has one colour; in that of mtdb render blue is 8 or 9 above red.
  const pixels = (picture, covers) => Array.from({length: picture.width * picture.height}, (_, i) => covers(picture.data.subarray(4 * i, 4 * i + 3)));
  const ground = ours.data.slice(0, 3);
  const a = pixels(ours, pixel => pixel.some((c, k) => Math.abs(c - ground[k]) > 8));
  const b = pixels(theirs, ([red, , blue]) => blue - red < 8 || blue - red > 9);
  let both = 0, one = 0;
  a.forEach((x, i) => (x && b[i] ? ++both : x !== b[i] && ++one));
  check(both > 20000, `${both} pixels are covered in both`);
  check(one < 0.02 * both, `${one} pixels are covered in one picture only, ${both} in both`);
  await close(page);
});

test('names and attributes are never markup; objects go on and off', async () => {
  const page = await open(server.url + '/');
  await page.waitForSelector('#start-list button');
  check((await page.locator('#start-list button').allTextContents()).some(text => text.startsWith(kOdd)), 'the list has the odd name');
  await page.locator('#start-list button').filter({hasText: 'Hügel'}).click();
  await exact(page);
  check(await page.textContent('#title') === kOdd, 'the title has the odd name');
  check(await page.locator('img').count() === 0, 'no markup came of it');
  await page.locator('#objects label').filter({hasText: kName}).locator('input').check();
  await exact(page);
  const shown = await page.evaluate(() => [...viewer.scene.objects].map(([, o]) => o.mesh.triangles));
  check(shown.length === 2 && shown.every(n => n > 100), `${shown}`);
  await page.selectOption('#colour', 'a:quality');
  await exact(page);
  await until(async () => await page.isVisible('#legend') && (await page.textContent('#legend-name')) === 'quality', 'the legend of the attribute');
  await page.selectOption('#colour', 'vertex');
  await exact(page);
  await page.locator('#objects label').filter({hasText: kName}).locator('input').uncheck();
  await until(() => page.evaluate(() => viewer.scene.objects.size === 1), 'the object is off');
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('coordinates of UTM keep their digits', async () => {
  const utm = JSON.parse(run('info', store, '--name', 'utm', '--json'));
  const object = utm.objects ? utm.objects[0] : utm;
  const page = await open(`${server.url}/#o=utm`);
  await exact(page);
  same(await trianglesOnScreen(page, 'utm', object), await extracted(page, store, 'utm', object), 'utm');
  // Where float32 takes a point of the mesh on the screen, and where it belongs.
  const off = await page.evaluate(() => {
    const {mesh} = viewer.scene.objects.get('utm'), camera = viewer.navigation.camera;
    mesh.group.updateMatrixWorld(true);
    const t = mesh.readTriangles();
    const view = mesh.group.matrixWorld.clone().premultiply(camera.matrixWorldInverse);
    const single = Float32Array.from(view.elements), projection = Float32Array.from(camera.projectionMatrix.elements), f = Math.fround;
    let worst = 0;
    for (let i = 0; i < Math.min(t.length, 30000); i += 3) {
      const p = [0, 1, 2].map(k => f(t[i + k] - mesh.origin[k]));
      const v = [0, 1, 2].map(r => f(f(f(single[r] * p[0]) + f(single[4 + r] * p[1])) + f(f(single[8 + r] * p[2]) + single[12 + r])));
      const x = f(projection[0] * v[0]) / -v[2], y = f(projection[5] * v[1]) / -v[2];
      const s = viewer.navigation.toScene([t[i], t[i + 1], t[i + 2]]).project(camera);
      worst = Math.max(worst, Math.abs(x - s.x) * 400, Math.abs(y - s.y) * 300);
    }
    return worst;
  });
  check(off < 0.05, `${off} pixels off`);
  await page.mouse.move(400, 300);
  await until(async () => /^5[0-9]{5}\.\d+ {2}54[0-9]{5}\.\d+ {2}/.test(await page.textContent('#where')), 'the coordinates under the cursor have their digits');
  await close(page);
});

for (const way of ['thick', 'thin']) test(`a lost server is said, and found again with the same view (${way})`, async () => {
  let own = await serve(store);
  const page = await open(`${own.url}/?way=${way}#o=${kName}&px=3`);
  await exact(page);
  const before = await trianglesOnScreen(page, kName, info), view = await camera(page);
  await own.stop('SIGKILL');
  // The engine in the page notices when it wants more.
  const pixels = p => page.evaluate(x => (viewer.scene.pixels = x, viewer.scene.restart()), p);
  if (way === 'thick') await pixels(0.1);
  await until(async () => await page.isVisible('#banner') && /lost|reached/.test(await page.textContent('#banner')), 'the page says that the server is lost');
  check(await page.evaluate(() => viewer.scene.total(o => o.mesh.triangles)) >= before.length, 'the mesh is still there');
  own = await serve(store, own.port);
  await until(async () => !(await page.isVisible('#banner')), 'the server is found again');
  if (way === 'thick') {
    await exact(page);
    same(await trianglesOnScreen(page, kName, info), await extracted(page, store, kName, info), 'the finer mesh');
    await pixels(3);
  }
  await exact(page);
  same(await trianglesOnScreen(page, kName, info), before, 'the mesh of the same view');
  near(distance((await camera(page)).eye, view.eye), 0, 1e-9, 'the camera');
  await close(page);
  await own.stop('SIGTERM');
});

// The page and a packed file in a folder, for web servers without mtdb.
let www = null;
function writeSite() {
  if (www) return www;
  www = file('www');
  run('view', '--write-page', www);
  run('pack', store, `${www}/scan.mtdbp`, '--name', kName, '--name', 'utm', '--name', 'degrees');
  return www;
}

for (const nginx of [false, true]) test(`a packed file is shown from any web server (${nginx ? 'nginx' : 'one of a few lines'})`, async () => {
  if (nginx && !nginxPath) return console.log('skipped: nginx is not installed');
  const web = await serveFolder(writeSite(), {nginx});
  for (const more of ['&px=1', `${box}&outside=view&px=4`, `${box}&outside=clip`]) {
    const page = await open(`${web.url}/index.html?src=scan.mtdbp#o=${kName}${more}`);
    await exact(page);
    same(await trianglesOnScreen(page, kName, info), await extracted(page, store, kName, info), more);
    check(page.wrong.length === 0, page.wrong.join('; '));
    await close(page);
  }
  const page = await open(`${web.url}/index.html?src=scan.mtdbp&way=thin#o=${kName}${box}&outside=view&px=4`);
  await exact(page);
  await page.evaluate(() => document.querySelectorAll('details').forEach(d => (d.open = true)));
  check(await page.locator('#way-row').isHidden(), 'there is no server that could cut');
  const [ray, hit] = await page.evaluate(async () => [viewer.navigation.ray(400, 300), await viewer.probe(400, 300)]);
  const found = runJson('probe', store, '--name', kName, `--ray=${[...ray.origin, ...ray.direction]}`);
  check(hit !== null && distance(hit.point, found.point) === 0 && hit.error_bound === found.error_bound, JSON.stringify([hit, found]));
  for (const format of ['ply', 'obj', 'glb']) {
    await page.selectOption('#format', format);
    await page.fill('#take-error', '0.002');
    const [download] = await Promise.all([page.waitForEvent('download'), page.click('#take')]);
    run('ingest', await download.path().then(path => (writeFileSync(file(`taken.${format}`), readFileSync(path)), file(`taken.${format}`))), file('taken.mtdb'), '--name', format, '--quiet', '--force');
    run('extract', store, file(`cut.${format}`), '--name', kName, '--error', '0.002', '--box=-0.3,-1.3,0.1,0.4,-0.2,0.8', '--clip');
    run('ingest', file(`cut.${format}`), file('taken.mtdb'), '--name', `cut ${format}`, '--quiet', '--force');
    const digests = [format, `cut ${format}`].map(name => runJson('info', file('taken.mtdb'), '--name', name).objects[0]);
    check(digests[0].triangles > 500 && digests[0].triangles === digests[1].triangles && digests[0].vertices === digests[1].vertices, JSON.stringify(digests));
    near(Math.max(...digests[0].bounds.min.map((x, k) => Math.abs(x - digests[1].bounds.min[k]))), 0, 1e-6, 'the bounds');
  }
  check(await page.evaluate(() => document.querySelector('#format option[value=drc]').disabled), 'what only mtdb writes is not offered');
  await page.locator('#objects label').filter({hasText: 'utm'}).locator('input').check();
  await exact(page);
  await page.locator('#objects label').filter({hasText: kName}).locator('input').uncheck();
  await page.selectOption('#region', '');
  const [download] = await Promise.all([page.waitForEvent('download'), page.click('#take')]);
  writeFileSync(file('utm.glb'), readFileSync(await download.path()));
  run('ingest', file('utm.glb'), file('taken.mtdb'), '--name', 'utm', '--quiet', '--force');
  const taken = runJson('info', file('taken.mtdb'), '--name', 'utm').objects[0];
  near(Math.max(...taken.bounds.min.map((x, k) => Math.abs(x - runJson('info', store, '--name', 'utm').objects[0].bounds.min[k]))), 0, 0.02, 'UTM in GLB');
  check(taken.attributes.map(a => a.name).sort().join() === 'blue,green,quality,red', JSON.stringify(taken.attributes));
  // A terrain in degrees tells its coordinate system in a packed file, too.
  const terrain = await open(`${web.url}/index.html?src=scan.mtdbp#o=degrees`);
  await exact(terrain);
  check(await terrain.evaluate(() => viewer.scene.stretch[1] > 1e5), 'degrees are drawn in metres');
  same(await trianglesOnScreen(terrain, 'degrees', runJson('info', store, '--name', 'degrees').objects[0]), await extracted(terrain, store, 'degrees', runJson('info', store, '--name', 'degrees').objects[0]), 'degrees');
  check(terrain.wrong.length === 0, terrain.wrong.join('; '));
  await close(terrain);
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
  await web.stop();
});

test('a page on a web server says what it cannot show, and shows what it may', async () => {
  const site = writeSite(), web = await serveFolder(site), other = await serveFolder(site, {origin: web.url});
  const said = async (search, words, wrong = /404|Failed to load/) => {
    const page = await open(`${web.url}/index.html${search}`);
    await until(async () => (await page.textContent('#banner')).includes(words), `the page says "${words}"`);
    check(page.wrong.every(text => wrong.test(text)), page.wrong.join('; '));
    await close(page);
  };
  await said('?src=none.mtdbp', 'There is no file “none.mtdbp”');
  await said('?src=viewer.css', 'packed file');
  await said('', 'There is no mtdb behind this page.');
  await said(`?src=${other.url}/scan.mtdbp`, 'files of its own server only');
  await said('?src=file:///etc/passwd', 'files of its own server only');
  await said('?src=data:,x', 'files of its own server only');
  await said('?src=http://[', 'is no address');
  run('view', '--write-page', site, '--allow-source', other.url);
  const page = await open(`${web.url}/index.html?src=${other.url}/scan.mtdbp#o=${kName}&px=3`);
  await exact(page);
  same(await trianglesOnScreen(page, kName, info), await extracted(page, store, kName, info), 'from another origin');
  check(page.wrong.length === 0, page.wrong.join('; '));
  // A file that is replaced under the page.
  run('ingest', file('small.ply'), file('second.mtdb'), '--quiet', '--name', kName);
  run('pack', file('second.mtdb'), `${site}/scan.mtdbp`);
  await page.evaluate(() => (viewer.scene.pixels = 0.2, viewer.scene.restart()));
  const triangles = runJson('info', file('second.mtdb')).objects[0].triangles;
  await until(() => page.evaluate(n => viewer.scene.total(o => o.mesh.triangles) <= n && viewer.scene.exactness().kind !== 'loading', triangles), 'the file that replaced it is shown');
  await close(page);
  www = null;
  await web.stop();
  await other.stop();
});

test('what cannot be shown is a sentence', async () => {
  const said = async (url, words, options) => {
    const page = await open(url, options);
    await until(async () => (await page.textContent('body')).includes(words) && (await page.getByText(words).first().isVisible()), `the page says "${words}"`);
    await close(page);
  };
  await said(`${server.url}/#o=nothing`, 'There is no object “nothing” in this store.');
  await said(server.url + '/', 'This browser has no WebGL 2', {init: () => {
    const get = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...more) { return kind === 'webgl2' ? null : get.call(this, kind, ...more); };
  }});
  // An object that is removed while one looks at it, and a store without any.
  const other = file('other.mtdb');
  run('ingest', file('small.ply'), other, '--quiet', '--name', 'brief');
  const own = await serve(other);
  const page = await open(own.url + '/');
  await exact(page);
  run('remove', other, 'brief');
  await page.evaluate(() => viewer.navigation.view('top', false));
  await page.evaluate(() => (viewer.scene.pixels = 0.5));
  await until(async () => /not in the store any more|gone|removed/.test(await page.textContent('#banner')) || (await page.evaluate(() => viewer.scene.exactness().kind === 'exact')), 'the removed object is said, or its session goes on');
  await close(page);
  await said(own.url + '/', 'This store has no objects yet.');
  await own.stop('SIGTERM');
});

for (const way of ['thick', 'thin']) test(`a flight leaves no errors, and takes no more memory the second time (${way})`, async () => {
  const page = await open(`${server.url}/?way=${way}#o=${kName}&px=2`);
  await exact(page);
  const cdp = await page.context().newCDPSession(page);
  const flight = async () => {
    const times = await page.evaluate(async rounds => {
      const centre = viewer.navigation.target(), size = viewer.navigation.radius(), tasks = [];
      const observer = new PerformanceObserver(list => tasks.push(...list.getEntries().map(e => e.duration)));
      observer.observe({entryTypes: ['longtask']});
      for (let i = 0; i <= 90 * rounds; ++i) {
        const a = (i / 90) * 2 * Math.PI, r = size * (1.6 + Math.cos(3 * a));
        viewer.navigation.set([centre[0] + r * Math.sin(a), centre[1] - r * Math.cos(a), centre[2] + 0.4 * r], centre, false);
        await new Promise(done => requestAnimationFrame(done));
      }
      observer.disconnect();
      return tasks;
    }, Number(process.env.MTDB_VIEWER_ROUNDS ?? 1));
    await exact(page);
    await cdp.send('HeapProfiler.collectGarbage');
    // A figure for people, not a test: it depends on the machine, and drawing without a graphics card is in it.
    if (process.env.MTDB_VIEWER_ROUNDS) console.log(`        ${times.length} tasks of 50 ms or more on the main thread, the longest ${Math.round(Math.max(0, ...times))} ms`);
    return {heap: (await cdp.send('Runtime.getHeapUsage')).usedSize, ...(await page.evaluate(() => ({...viewer.renderer.info.memory, programs: viewer.renderer.info.programs.length,
      engine: viewer.scene.total(o => o.source.traffic.load?.engineBytes ?? 0)})))};
  };
  await flight();
  const first = await flight(), second = await flight();
  check(second.heap < 1.2 * first.heap + 2e6, `heap ${first.heap}, then ${second.heap}`);
  check(second.engine <= 1.2 * first.engine && (way === 'thin' || first.engine > 0), `engine ${first.engine}, then ${second.engine}`);
  check(second.geometries === first.geometries && second.textures === first.textures && second.programs === first.programs, JSON.stringify([first, second]));
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

// ---- stores, and the run ----

function writeUtm(path) {
  const n = 80, lines = ['ply', 'format ascii 1.0', `element vertex ${n * n}`, 'property double x', 'property double y', 'property double z',
    'property uchar red', 'property uchar green', 'property uchar blue', 'property float quality', `element face ${2 * (n - 1) ** 2}`, 'property list uchar int vertex_indices', 'end_header'];
  for (let i = 0; i < n * n; ++i) {
    const x = i % n, y = Math.floor(i / n), z = 4 * Math.sin(x / 7) * Math.cos(y / 9) + 0.7 * Math.sin(x * 1.7 + y);
    lines.push(`${500000 + x * 0.75} ${5400000 + y * 0.75} ${(300 + z).toFixed(4)} ${3 * x} ${3 * y} 120 ${(x + y / 2).toFixed(2)}`);
  }
  for (let y = 0; y + 1 < n; ++y) for (let x = 0; x + 1 < n; ++x) {
    const a = y * n + x;
    lines.push(`3 ${a} ${a + 1} ${a + n}`, `3 ${a + 1} ${a + n + 1} ${a + n}`);
  }
  writeFileSync(path, lines.join('\n') + '\n');
}

// An ESRI ASCII grid of heights, by longitude and latitude.
function writeDegrees(path) {
  const n = 60, rows = [];
  for (let y = 0; y < n; ++y) rows.push(Array.from({length: n}, (_, x) => Math.round(1500 + 900 * Math.exp(-((x - 30) ** 2 + (y - 28) ** 2) / 220) + 60 * Math.sin(x / 2.1) * Math.cos(y / 1.7))).join(' '));
  writeFileSync(path, `ncols ${n}\nnrows ${n}\nxllcorner -122.25\nyllcorner 46.0\ncellsize 0.0008333333\nNODATA_value -9999\n${rows.join('\n')}\n`);
  writeFileSync(path.replace(/asc$/, 'prj'), 'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]');
}

run('generate', 'sculpture', file('sculpture.ply'), '--triangles', '60000');
run('generate', 'terrain', file('small.ply'), '--triangles', '3000');
writeUtm(file('utm.ply'));
run('ingest', file('sculpture.ply'), store, '--quiet', '--name', kName);
run('ingest', file('utm.ply'), store, '--quiet', '--name', kOdd, '--step', '0.01');
run('ingest', file('utm.ply'), store, '--quiet', '--name', 'utm', '--step', '0.01');
run('generate', 'terrain', file('terrain.ply'), '--triangles', '20000');
run('ingest', file('terrain.ply'), store, '--quiet', '--name', 'terrain');
writeDegrees(file('degrees.asc'));
run('ingest', file('degrees.asc'), store, '--quiet', '--name', 'degrees');
const described = JSON.parse(run('info', store, '--name', kName, '--json'));
info = described.objects ? described.objects[0] : described;
void trianglesOfPly;
server = await serve(store);
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
    console.log(`FAILED  ${name}\n        ${error.message.split('\n').slice(0, 4).join('\n        ')}\n${error.stack.split('\n').filter(l => l.includes('viewer_test')).slice(0, 2).join('\n')}`);
  }
}
await browser.close();
await server.stop('SIGTERM');
process.exit(failed > 0 ? 1 : 0);
