// SPDX-License-Identifier: Apache-2.0
// What is drawn: triangles, colours, limits, pictures.
import {readFileSync, writeFileSync} from 'node:fs';
import {box, info, kName, server, status, store, test} from './scene.mjs';
import {
  check,
  close,
  decode,
  exact,
  extracted,
  file,
  open,
  run,
  runJson,
  same,
  trianglesOnScreen,
  until,
} from './testing.mjs';

const limits = JSON.parse(readFileSync(new URL('sizes.json', import.meta.url), 'utf8'));
for (const way of ['thick', 'thin'])
  test(`the page draws an object, and is no larger than it may be (${way})`, async () => {
    const page = await open(`${server.url}/?way=${way}#o=${kName}`);
    await exact(page);
    await until(async () => (await status(page)).startsWith('the whole: '), 'the status line');
    const {'/engine.wasm': engine, ...bytes} = Object.fromEntries(
      Object.entries(page.bytes).filter(([path]) => !path.startsWith('/objects')),
    );
    check(
      (way === 'thick') === (engine !== undefined) && (way === 'thin') === '/decoder.wasm' in bytes,
      `the wrong way: ${Object.keys(page.bytes)}`,
    );
    check(
      Object.values(bytes).reduce((sum, n) => sum + n, 0) < limits.page,
      `the page has ${JSON.stringify(bytes)} bytes`,
    );
    check((engine ?? 0) < limits.engine, `the engine has ${engine} bytes`);
    const picture = await decode(await page.locator('#canvas').screenshot());
    const levels = new Set();
    for (let i = 0; i < picture.data.length; i += 4) levels.add(picture.data[i]);
    check(levels.size > 60, `the picture has ${levels.size} levels of red`);
    check(page.wrong.length === 0, page.wrong.join('; '));
    await close(page);
  });

for (const way of ['thick', 'thin'])
  test(`what is on the screen is what mtdb extract gives (${way})`, async () => {
    for (const more of [
      '',
      '&px=1',
      '&px=3',
      `${box}&outside=view&px=4`,
      `${box}&outside=coarse`,
      `${box}&outside=clip`,
      '&region=sphere:0,-0.8,0.4,0.5&outside=coarse&inside=0.003',
      '&region=half_space:0,0,0,1,0,0&outside=clip&inside=view',
      '&triangles=20000',
      '&px=0.2&triangles=20000',
    ]) {
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
  const page = await open(
    `${server.url}/#o=${kName}&region=half_space:100,0,0,1,0,0&inside=0.003&outside=coarse&colour=error`,
  );
  await exact(page);
  const values = () =>
    page.evaluate(name => [...viewer.scene.objects.get(name).mesh.readValues()], kName);
  const errors = await values(),
    query = await page.evaluate(name => viewer.scene.objects.get(name).wanted, kName);
  writeFileSync(file('query.json'), JSON.stringify(query));
  const stats = runJson(
    'extract',
    store,
    file('extracted.ply'),
    '--name',
    kName,
    '--query',
    file('query.json'),
    '--double-positions',
  );
  check(
    errors.length === stats.triangles &&
      Math.max(...errors) === Math.fround(stats.error_bound) &&
      new Set(errors).size > 10,
    `${errors.length} ${Math.max(...errors)} ${JSON.stringify(stats)}`,
  );
  check(
    (await page.textContent('#legend-high')) === String(Number(stats.error_bound.toPrecision(4))),
    await page.textContent('#legend'),
  );
  const colours = async () => {
    const picture = await decode(await page.locator('#canvas').screenshot()),
      hues = new Set();
    for (let i = 0; i < picture.data.length; i += 4)
      hues.add(Math.round((picture.data[i] - picture.data[i + 2]) / 16));
    return hues.size;
  };
  const many = await colours();
  await page.selectOption('#colour', 'round');
  await until(async () => new Set(await values()).size < 9, 'the rounds are there');
  const rounds = await values();
  check(
    rounds.every(round => Number.isInteger(round) && round > 0),
    'rounds',
  );
  await page.selectOption('#colour', 'cluster');
  await until(
    async () => (await values()).some((cluster, i) => cluster !== rounds[i]),
    'the clusters are there',
  );
  await page.selectOption('#colour', 'plain');
  await until(
    async () =>
      await page.evaluate(name => viewer.scene.objects.get(name).mesh.readValues() === null, kName),
    'no values any more',
  );
  const few = await colours();
  check(many > 2 * few, `${many} hues, ${few} without`);
  await page.selectOption('#way', 'thin');
  await exact(page);
  check(
    (await page.isVisible('#colour-hint')) &&
      (await page.evaluate(() => document.querySelector('#colour option[value=error]').disabled)),
    'the panel says what the server does not tell',
  );
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('the memory that the engine may take holds: the error rises, and the page says to what', async () => {
  const page = await open(`${server.url}/#o=${kName}&px=0.25`);
  await exact(page);
  const ample = await page.evaluate(() => viewer.scene.total(o => o.mesh.triangles));
  const most = 2 ** 20 * 1.5;
  await page.evaluate(
    bytes => viewer.scene.setLimits({cacheBytes: bytes, bytesPerSecond: 1e6}),
    most,
  );
  await until(
    async () => /px = .*; the memory of 2 MiB allows no less/.test(await status(page)),
    'the page says what the memory allows',
  );
  await exact(page);
  const [triangles, load, pixels] = await page.evaluate(() => [
    viewer.scene.total(o => o.mesh.triangles),
    [...viewer.scene.objects.values()][0].source.traffic.load,
    viewer.scene.exactness().pixels,
  ]);
  check(
    triangles < ample && triangles > 100 && load.cacheBytes <= most && pixels > 0.25,
    JSON.stringify([triangles, ample, load, pixels]),
  );
  await page.evaluate(() =>
    viewer.scene.setLimits({cacheBytes: 2 ** 28, bytesPerSecond: Infinity}),
  );
  await until(
    async () => (await page.evaluate(() => viewer.scene.total(o => o.mesh.triangles))) === ample,
    'with more memory the mesh is as fine as before',
  );
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('the switch changes the way, and nothing that is seen', async () => {
  const page = await open(`${server.url}/#o=${kName}${box}&outside=view&px=4`);
  await exact(page);
  const thick = await trianglesOnScreen(page, kName, info);
  check(
    (await page.evaluate(() => viewer.loading.way)) === 'thick',
    'the engine in the page is the default',
  );
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

for (const way of ['thick', 'thin'])
  test(`a budget that does not suffice raises the error everywhere, and the page says to what (${way})`, async () => {
    const page = await open(`${server.url}/?way=${way}#o=${kName}&px=1&triangles=3000`);
    await exact(page);
    check(
      /^exact to [0-9.]+ px = .*budget of 3,000 triangles/.test(await status(page)),
      await status(page),
    );
    const figures = await page.evaluate(() => [
      viewer.scene.exactness().pixels,
      viewer.scene.total(o => o.mesh.triangles),
    ]);
    check(figures[0] > 1 && figures[1] <= 3000 && figures[1] > 800, figures.join(' '));
    await close(page);
  });

test('pictures after changes are those of a page that was opened so', async () => {
  const page = await open(`${server.url}/#o=${kName}&px=8`);
  await exact(page);
  const set = (id, value) =>
    page.evaluate(
      ([i, v]) => {
        const element = document.getElementById(i);
        if (element.type === 'checkbox') element.checked = v;
        else element.value = v;
        element.dispatchEvent(new Event(element.type === 'range' ? 'input' : 'change'));
      },
      [id, value],
    );
  for (const [id, value] of [
    ['wireframe', true],
    ['pixels', '0'],
    ['wireframe', false],
    ['pixels', '2'],
    ['colour', 'height'],
    ['pixels', '1'],
    ['wireframe', true],
    ['shading', 'flat'],
    ['pixels', '0'],
  ]) {
    await set(id, value);
    await exact(page);
  }
  // The address follows the page some time later.
  const fresh = await open(await page.evaluate(() => (viewer.saveView(), location.href)));
  await exact(fresh);
  await until(() => fresh.evaluate(() => viewer.scene.wireframe), 'the fresh page has the style');
  const pictures = [];
  for (const p of [page, fresh]) {
    await p.evaluate(() =>
      [...document.body.children].forEach(e => e.id !== 'stage' && (e.style.display = 'none')),
    );
    pictures.push(await decode(await p.locator('#canvas').screenshot()));
  }
  // Slots differ, and with them which of two triangles is drawn where both have the same depth.
  let other = 0;
  for (let i = 0; i < pictures[0].data.length; i += 4)
    if (Math.abs(pictures[0].data[i] - pictures[1].data[i]) > 24) ++other;
  check(other < 400, `${other} pixels differ`);
  for (const p of [page, fresh]) await close(p);
});

test('the picture covers what mtdb render draws', async () => {
  const eye = [1.9, -3.2, 1.4],
    target = [0, 0, 0.2];
  const page = await open(`${server.url}/#o=${kName}&px=1&eye=${eye}&look=${target}`);
  await exact(page);
  // The page's labels and panels are not of the scene.
  await page.evaluate(() =>
    [...document.body.children].forEach(e => e.id !== 'stage' && (e.style.display = 'none')),
  );
  const ours = await decode(await page.locator('#canvas').screenshot());
  run(
    'render',
    store,
    file('r.png'),
    '--name',
    kName,
    '--pixels',
    '1',
    '--frustum',
    '--eye=' + eye,
    '--target=' + target,
    '--fov',
    '45',
    '--viewport',
    '800x600',
    '--size',
    '800x600',
  );
  const theirs = await decode(readFileSync(file('r.png')));
  check(theirs.width === ours.width && theirs.height === ours.height, 'the sizes');
  // The page's ground has one colour; in that of mtdb render blue is 8 or 9 above red.
  const pixels = (picture, covers) =>
    Array.from({length: picture.width * picture.height}, (_, i) =>
      covers(picture.data.subarray(4 * i, 4 * i + 3)),
    );
  const ground = ours.data.slice(0, 3);
  const a = pixels(ours, pixel => pixel.some((c, k) => Math.abs(c - ground[k]) > 8));
  const b = pixels(theirs, ([red, , blue]) => blue - red < 8 || blue - red > 9);
  let both = 0,
    one = 0;
  a.forEach((x, i) => (x && b[i] ? ++both : x !== b[i] && ++one));
  check(both > 20000, `${both} pixels are covered in both`);
  check(one < 0.02 * both, `${one} pixels are covered in one picture only, ${both} in both`);
  await close(page);
});

test('coordinates of UTM keep their digits', async () => {
  const utm = JSON.parse(run('info', store, '--name', 'utm', '--json'));
  const object = utm.objects ? utm.objects[0] : utm;
  const page = await open(`${server.url}/#o=utm`);
  await exact(page);
  same(
    await trianglesOnScreen(page, 'utm', object),
    await extracted(page, store, 'utm', object),
    'utm',
  );
  // Where float32 takes a point of the mesh on the screen, and where it belongs.
  const off = await page.evaluate(() => {
    const {mesh} = viewer.scene.objects.get('utm'),
      camera = viewer.navigation.camera;
    mesh.group.updateMatrixWorld(true);
    const t = mesh.readTriangles();
    const view = mesh.group.matrixWorld.clone().premultiply(camera.matrixWorldInverse);
    const single = Float32Array.from(view.elements),
      projection = Float32Array.from(camera.projectionMatrix.elements),
      f = Math.fround;
    let worst = 0;
    for (let i = 0; i < Math.min(t.length, 30000); i += 3) {
      const p = [0, 1, 2].map(k => f(t[i + k] - mesh.origin[k]));
      const v = [0, 1, 2].map(r =>
        f(
          f(f(single[r] * p[0]) + f(single[4 + r] * p[1])) +
            f(f(single[8 + r] * p[2]) + single[12 + r]),
        ),
      );
      const x = f(projection[0] * v[0]) / -v[2],
        y = f(projection[5] * v[1]) / -v[2];
      const s = viewer.navigation.toScene([t[i], t[i + 1], t[i + 2]]).project(camera);
      worst = Math.max(worst, Math.abs(x - s.x) * 400, Math.abs(y - s.y) * 300);
    }
    return worst;
  });
  check(off < 0.05, `${off} pixels off`);
  await page.mouse.move(400, 240); // in front of the surface
  await until(
    async () => /^5[0-9]{5}\.\d+ {2}54[0-9]{5}\.\d+ {2}/.test(await page.textContent('#where')),
    'the coordinates under the cursor have their digits',
  );
  await close(page);
});
