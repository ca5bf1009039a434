// SPDX-License-Identifier: Apache-2.0
// Regions that are dragged, and the mesh in them; terrains.
import {box, distance, drag, info, kName, region, server, store, test} from './scene.mjs';
import {
  check,
  close,
  exact,
  extracted,
  file,
  near,
  open,
  run,
  same,
  stepsOf,
  trianglesOnScreen,
  trianglesOfPly,
  until,
} from './testing.mjs';

test('dragging the box changes the mesh where the box is', async () => {
  const page = await open(`${server.url}/#o=${kName}${box}&outside=view&px=4`);
  await exact(page);
  const before = await trianglesOnScreen(page, kName, info),
    first = (await region(page)).box;
  const places = await page.evaluate(() => viewer.handles.places());
  const [x, y] = places.maxx;
  await page.mouse.move(x, y);
  await page.mouse.down();
  const answers = () => page.evaluate(() => viewer.scene.changes);
  const atGrip = await answers();
  for (let i = 1; i <= 10; ++i) await page.mouse.move(x + 8 * i, y + i);
  await until(
    async () => (await answers()) > atGrip + 5,
    'the mesh follows while the box is dragged',
  );
  await page.mouse.up();
  await exact(page);
  const last = (await region(page)).box;
  check(last.max[0] > first.max[0] + 0.1, 'the face was dragged');
  for (const [a, b] of [
    [first.min, last.min],
    [
      [0, ...first.max.slice(1)],
      [0, ...last.max.slice(1)],
    ],
  ])
    near(distance(a, b), 0, 1e-9, 'the other faces stay');
  const after = await trianglesOnScreen(page, kName, info);
  same(after, await extracted(page, store, kName, info), 'after dragging');
  // What has changed lies near the box: where it was, where it is, and where the mesh grows coarse.
  const old = new Set(before);
  const changed = after.filter(t => !old.has(t));
  check(changed.length > 500, `${changed.length} triangles have changed`);
  const reach = 0.12 * info.diagonal;
  const isFar = text =>
    !text
      .split(',')[0]
      .split(' ')
      .map((n, k) => info.bounds.min[k] + info.step * Number(n))
      .every(
        (c, k) =>
          c > Math.min(first.min[k], last.min[k]) - reach &&
          c < Math.max(first.max[k], last.max[k]) + reach,
      );
  // A few others lie further away, since what is fine needs what it was made of.
  const far = after.filter(isFar),
    changedFar = far.filter(t => !old.has(t));
  check(far.length > 300, `${far.length} triangles lie far from the box`);
  check(
    changedFar.length < 0.08 * far.length && changedFar.length < 0.1 * changed.length,
    `${changedFar.length} of ${changed.length} triangles that changed lie far from the box, where ${far.length} are`,
  );
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

const placesOf = (texts, of) =>
  texts.map(text =>
    text
      .split(',')
      .map(corner =>
        corner.split(' ').map((n, k) => of.bounds.min[k] + stepsOf(of)[k] * Number(n)),
      ),
  );

test('rings turn the box, and what is outside of it is cut away', async () => {
  const page = await open(`${server.url}/#o=${kName}${box}&outside=clip&inside=0.01&back=cap`);
  await exact(page);
  const straight = await trianglesOnScreen(page, kName, info);
  await drag(page, 'turnz', 60, 10);
  await exact(page);
  const {turned_box: turned} = await region(page);
  check(
    turned && Math.abs(turned.angles[0]) > 5,
    `the box is turned: ${JSON.stringify(await region(page))}`,
  );
  near(Math.abs(turned.angles[1]) + Math.abs(turned.angles[2]), 0, 1e-9, 'about z only');
  near(distance(turned.half, [0.35, 0.55, 0.35]), 0, 1e-9, 'its size');
  near(distance(turned.centre, [0.05, -0.75, 0.45]), 0, 1e-9, 'its centre');
  const after = await trianglesOnScreen(page, kName, info);
  same(after, await extracted(page, store, kName, info), 'turned');
  check(after.length !== straight.length, 'other triangles are there');
  // All of them reach into the turned box, as computed here.
  const a = (turned.angles[0] * Math.PI) / 180,
    to = p => {
      const [x, y, z] = p.map((c, k) => c - turned.centre[k]);
      return [Math.cos(a) * x + Math.sin(a) * y, Math.cos(a) * y - Math.sin(a) * x, z];
    };
  for (const corners of placesOf(after, info)) {
    const local = corners.map(to);
    for (let k = 0; k < 3; ++k) {
      check(
        !local.every(p => p[k] > turned.half[k] + 1e-6) &&
          !local.every(p => p[k] < -turned.half[k] - 1e-6),
        'no triangle lies beside the box',
      );
    }
  }
  await drag(page, 'maxx', 30, 0);
  const wider = (await region(page)).turned_box;
  check(Math.abs(wider.half[0] - turned.half[0]) > 1e-3, 'a face is dragged');
  near(
    distance(wider.centre, turned.centre),
    Math.abs(wider.half[0] - turned.half[0]),
    1e-9,
    'the face across stays',
  );
  // The link brings it back.
  await exact(page);
  await until(async () => page.url().includes('turned_box'), 'the address has it');
  const other = await open(page.url());
  await exact(other);
  same(
    await trianglesOnScreen(other, kName, info),
    await trianglesOnScreen(page, kName, info),
    'the linked page',
  );
  check(page.wrong.length + other.wrong.length === 0, [...page.wrong, ...other.wrong].join('; '));
  await close(other);
  await close(page);
});

test('ball and half-space are dragged', async () => {
  const page = await open(
    `${server.url}/#o=${kName}&region=sphere:0,-0.8,0.4,0.5&outside=coarse&inside=0.003`,
  );
  await exact(page);
  await drag(page, 'radiusx', 40, 0);
  await exact(page);
  const ball = (await region(page)).sphere;
  check(
    Math.abs(ball.radius - 0.5) > 0.01 && distance(ball.centre, [0, -0.8, 0.4]) === 0,
    JSON.stringify(ball),
  );
  same(
    await trianglesOnScreen(page, kName, info),
    await extracted(page, store, kName, info),
    'the ball',
  );
  await page.evaluate(() => document.querySelectorAll('details').forEach(d => (d.open = true)));
  await page.selectOption('#region', 'half_space');
  await exact(page);
  const before = (await region(page)).half_space;
  await drag(page, 'normal', 50, -40);
  await drag(page, 'centre', 20, 20);
  await exact(page);
  const after = (await region(page)).half_space;
  check(
    distance(before.normal, after.normal) > 0.05 && distance(before.point, after.point) > 0.01,
    JSON.stringify(after),
  );
  same(
    await trianglesOnScreen(page, kName, info),
    await extracted(page, store, kName, info),
    'the half-space',
  );
  await close(page);
});

test('while a box of full resolution is dragged, it is at full resolution soon', async () => {
  const page = await open(`${server.url}/#o=${kName}${box}&outside=coarse`);
  await exact(page);
  const times = [];
  for (let i = 0; i < 4; ++i) {
    // From the last move of the mouse, which the page gets, to the answer in its arrays.
    times.push(
      await drag(page, 'centre', i % 2 ? -24 : 24, 0, () =>
        page.evaluate(
          () =>
            new Promise(done => {
              const begin = performance.now();
              const look = () => {
                // The query of the last place is made in the next frame.
                const object = [...viewer.scene.objects.values()][0],
                  {box: asked} = object.wanted.region,
                  {box: there} = viewer.scene.focus.region;
                if (
                  object.doneText === object.wantedText &&
                  JSON.stringify(asked) === JSON.stringify(there)
                )
                  done(performance.now() - begin);
                else setTimeout(look, 1);
              };
              look();
            }),
        ),
      ),
    );
    same(
      await trianglesOnScreen(page, kName, info),
      await extracted(page, store, kName, info),
      'while it is held',
    );
  }
  console.log(
    `        full resolution in the box after ${times.map(t => t.toFixed(0)).join(', ')} ms`,
  );
  await close(page);
});

test('a wedge of a terrain: linear errors from its apex, dragged, and where the camera is', async () => {
  const page = await open(
    `${server.url}/#o=terrain&region=wedge:5,0,1,0,50,8&inside=distance&outside=coarse&px=2`,
  );
  await exact(page);
  const terrain = JSON.parse(run('info', store, '--name', 'terrain', '--json')).objects[0];
  const query = await page.evaluate(() => viewer.scene.objects.get('terrain').wanted);
  check(query.region.wedge.angle === 50 && query.threshold.linear.slope > 0, JSON.stringify(query));
  same(
    await trianglesOnScreen(page, 'terrain', terrain),
    await extracted(page, store, 'terrain', terrain),
    'the wedge',
  );
  await page.evaluate(() => viewer.navigation.view('top', false));
  await exact(page);
  await drag(page, 'far', 60, 0);
  await drag(page, 'left', -20, 0);
  await drag(page, 'apex', 10, -20);
  await exact(page);
  const wedge = (await region(page)).wedge;
  check(
    wedge.direction[0] > 0.05 &&
      Math.abs(wedge.angle - 50) > 1 &&
      distance(wedge.apex, [5, 0, 1]) > 0.05,
    JSON.stringify(wedge),
  );
  near(wedge.apex[2], 1, 1e-9, 'the apex keeps its height');
  same(
    await trianglesOnScreen(page, 'terrain', terrain),
    await extracted(page, store, 'terrain', terrain),
    'dragged',
  );
  await page.evaluate(() => document.querySelectorAll('details').forEach(d => (d.open = true)));
  await page.check('#follow');
  await page.evaluate(() => viewer.navigation.set([2, -1, 2], [5, 5, 0], false));
  await until(
    async () => distance((await region(page)).wedge.apex, [2, -1, 2]) < 1e-9,
    'the wedge is where the camera is',
  );
  await exact(page);
  same(
    await trianglesOnScreen(page, 'terrain', terrain),
    await extracted(page, store, 'terrain', terrain),
    'the cockpit',
  );
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('a terrain in degrees is drawn in metres, as exact as the camera asks, and measured in its own coordinates', async () => {
  const page = await open(`${server.url}/#o=degrees&px=1`);
  await exact(page);
  const terrain = JSON.parse(run('info', store, '--name', 'degrees', '--json')).objects[0];
  const {stretch, size, unit} = await page.evaluate(() => ({
    stretch: viewer.scene.stretch,
    size: viewer.navigation.radius(),
    unit: viewer.unit,
  }));
  near(stretch[0] / stretch[1], Math.cos((46 * Math.PI) / 180), 0.01, 'a degree of longitude');
  check(size > 1000 && size < 20000, `${size} metres`);
  void unit;
  same(
    await trianglesOnScreen(page, 'degrees', terrain),
    await extracted(page, store, 'degrees', terrain),
    'degrees',
  );
  // Each sample of the full surface is drawn at most a pixel from where it belongs: heights of the
  // page's mesh at the vertices of the full one that are in sight.
  run('extract', store, file('full.ply'), '--name', 'degrees', '--full', '--double-positions');
  const full = placesOf(trianglesOfPly(file('full.ply'), terrain), terrain).map(t => t[0]);
  const drawn = placesOf(await trianglesOnScreen(page, 'degrees', terrain), terrain);
  const worst = await page.evaluate(
    ([samples, triangles, s]) => {
      const camera = viewer.navigation.query([viewer.canvas.width, viewer.canvas.height]),
        pixel = (2 * Math.tan((camera.fov * Math.PI) / 360)) / camera.viewport[1];
      const forward = [0, 1, 2].map(k => camera.target[k] - camera.eye[k]),
        size = Math.hypot(...forward);
      let most = 0,
        found = 0;
      for (const [x, y, z] of samples) {
        for (const [a, b, c] of triangles) {
          const d = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
          const u = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / d,
            v = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / d;
          if (!(u >= -1e-9 && v >= -1e-9 && u + v <= 1 + 1e-9)) continue;
          const depth = [x * s[0], y * s[1], z].reduce(
            (sum, q, k) => sum + ((q - camera.eye[k]) * forward[k]) / size,
            0,
          );
          most = Math.max(
            most,
            Math.abs(a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]) - z) / (depth * pixel),
          );
          ++found;
          break;
        }
      }
      return {most, found};
    },
    [full.filter((_, i) => i % 7 === 0), drawn, stretch],
  );
  check(worst.found > 200, `${worst.found} samples`);
  check(worst.most <= 1, `${worst.most} pixels off`);
  check(worst.most > 0.05, `${worst.most} pixels: more exact than asked for`);
  // Points are the terrain's own, lengths metres.
  await page.keyboard.press('m');
  for (const x of [380, 420]) {
    await page.mouse.click(x, 320);
    await until(
      () =>
        page.evaluate(
          n => viewer.measuring.lines.reduce((sum, l) => sum + l.points.length, 0) === n,
          x === 380 ? 1 : 2,
        ),
      'the point is there',
    );
  }
  const [a, b] = await page.evaluate(() => viewer.measuring.lines[0].points.map(p => p.point));
  check(
    a[0] > terrain.bounds.min[0] &&
      a[0] < terrain.bounds.max[0] &&
      a[1] > terrain.bounds.min[1] &&
      a[1] < terrain.bounds.max[1],
    `${a}`,
  );
  const metres = Math.hypot(...[0, 1, 2].map(k => stretch[k] * (b[k] - a[k])));
  check(
    (await page.textContent('#measured')).includes(String(Number(metres.toPrecision(4)))),
    `${metres} in ${await page.textContent('#measured')}`,
  );
  // A region in it is a region of the terrain.
  await page.evaluate(() => document.querySelectorAll('details').forEach(d => (d.open = true)));
  for (const kind of ['box', 'turned_box', 'sphere', 'wedge']) {
    await page.selectOption('#region', kind);
    await exact(page);
    same(
      await trianglesOnScreen(page, 'degrees', terrain),
      await extracted(page, store, 'degrees', terrain),
      kind,
    );
  }
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});
