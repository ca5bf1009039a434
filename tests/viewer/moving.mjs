// SPDX-License-Identifier: Apache-2.0
// The camera, and flights.
import {camera, distance, kName, server, test} from './scene.mjs';
import {check, close, exact, near, open, quantile, tasksDuring, until} from './testing.mjs';

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
  near(
    distance(turned.eye, turned.target),
    distance(start.eye, start.target),
    1e-3,
    'the distance',
  );
  near(distance(turned.target, start.target), 0, 1e-3, 'what the camera turns around');
  check(distance(turned.eye, start.eye) > 0.5, 'the camera turned');
  await drag('right', 60, 0);
  const moved = await camera(page);
  near(
    distance(moved.eye, turned.eye),
    distance(moved.target, turned.target),
    1e-3,
    'panning moves both',
  );
  check(distance(moved.eye, turned.eye) > 0.05, 'the camera was moved');
  // The point under the cursor stays there.
  const at = [470, 250];
  const hit = await page.evaluate(([x, y]) => viewer.probe(x, y), at);
  check(hit, 'there is surface under the cursor');
  const onScreen = p =>
    page.evaluate(q => {
      const s = viewer.navigation.toScene(q).project(viewer.navigation.camera);
      return [(s.x + 1) * 400, (1 - s.y) * 300];
    }, p);
  await page.mouse.move(...at);
  for (let i = 0; i < 4; ++i) await page.mouse.wheel(0, -120);
  await until(async () => {
    const c = await camera(page);
    return distance(c.eye, hit.point) < 0.9 * distance(moved.eye, hit.point);
  }, 'the wheel zooms');
  await exact(page);
  const stays = await onScreen(hit.point);
  near(Math.hypot(stays[0] - at[0], stays[1] - at[1]), 0, 12, 'the point under the cursor');
  // A double click goes to the exact hit.
  const target = await page.evaluate(() => viewer.probe(400, 300));
  if (target) {
    await page.mouse.dblclick(400, 300);
    await until(
      async () => distance((await camera(page)).target, target.point) < 1e-6,
      'the double click goes there',
    );
    const ray = await page.evaluate(() => viewer.navigation.ray(400, 300));
    void ray;
  }
  await page.keyboard.press('1');
  await until(async () => {
    const c = await camera(page);
    return c.eye[2] - c.target[2] > 0.99 * distance(c.eye, c.target);
  }, '1 looks from above');
  await page.keyboard.press('h');
  await until(async () => {
    const c = await camera(page);
    return Math.abs(c.eye[0] - start.eye[0]) < 1e-3;
  }, 'H shows all');
  await page.keyboard.press('f');
  await page.keyboard.down('w');
  await until(async () => {
    const c = await camera(page);
    return distance(c.eye, start.eye) > 0.2;
  }, 'W flies');
  await page.keyboard.up('w');
  const flown = await camera(page);
  const straight =
    distance(flown.eye, start.eye) -
    (distance(start.eye, start.target) - distance(flown.eye, start.target));
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

test('keys alone choose an object, turn, measure, take a region and go through the panel', async () => {
  const page = await open(server.url + '/');
  await page.waitForSelector('#start-list button');
  const focused = () => page.evaluate(() => document.activeElement.textContent.trim());
  for (let i = 0; i < 10 && !(await focused()).startsWith(kName); ++i)
    await page.keyboard.press('Tab');
  await page.keyboard.press('Enter');
  await exact(page);
  check((await page.textContent('#title')) === kName, await page.textContent('#title'));
  const start = await camera(page);
  await page.keyboard.down('ArrowLeft');
  await until(async () => distance((await camera(page)).eye, start.eye) > 0.1, 'an arrow turns');
  await page.keyboard.up('ArrowLeft');
  // The cross is in the middle of the picture; from one of the sides there is surface.
  await page.evaluate(() => {
    const probe = viewer.probe.bind(viewer);
    viewer.answers = 0;
    viewer.probe = (...place) => probe(...place).finally(() => ++viewer.answers);
  });
  await page.keyboard.press('m');
  const points = () =>
    page.evaluate(() => viewer.measuring.lines.reduce((sum, l) => sum + l.points.length, 0));
  const sides = ['2', '3', '1', 'h', '4', '5', '6'];
  for (let i = 0; (await points()) < 1; ++i) {
    check(i < sides.length, 'a point is measured');
    await page.keyboard.press(sides[i]);
    await exact(page);
    await page.keyboard.press('Enter');
    await until(() => page.evaluate(n => viewer.answers > n, i), 'the surface answers');
  }
  await page.keyboard.press('Escape');
  check((await page.getAttribute('#measure', 'aria-pressed')) === 'false', 'Escape ends measuring');
  await page.keyboard.press('b');
  check(await page.evaluate(() => 'box' in viewer.scene.focus.region), 'B makes a box');
  // Tab reaches each control that is shown, and none that is not.
  const shown = await page.evaluate(
    () =>
      [...document.querySelectorAll('button, select, input, summary, canvas')].filter(
        e => e.checkVisibility() && !e.disabled,
      ).length,
  );
  await page.evaluate(() => viewer.canvas.focus());
  const reached = new Set();
  for (let i = 0; i < shown + 5; ++i) {
    reached.add(
      await page.evaluate(() => {
        const e = document.activeElement;
        e.dataset.reached ??= String(Math.random());
        return e.checkVisibility() ? e.dataset.reached : 'hidden';
      }),
    );
    await page.keyboard.press('Tab');
  }
  check(!reached.has('hidden') && reached.size >= shown, `${reached.size} of ${shown} controls`);
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('two fingers zoom, one turns', async () => {
  const page = await open(`${server.url}/#o=${kName}&px=4`, {
    hasTouch: true,
    isMobile: true,
    viewport: {width: 390, height: 844},
  });
  await exact(page);
  const fingers = await page.context().newCDPSession(page);
  const touch = (type, points) =>
    fingers.send('Input.dispatchTouchEvent', {
      type,
      touchPoints: points.map(([x, y], id) => ({x, y, id})),
    });
  const start = await camera(page);
  await touch('touchStart', [[150, 300]]);
  for (let i = 1; i <= 6; ++i) await touch('touchMove', [[150 + 15 * i, 300]]);
  await touch('touchEnd', []);
  await until(async () => distance((await camera(page)).eye, start.eye) > 0.3, 'one finger turns');
  await exact(page);
  const turned = await camera(page);
  await touch('touchStart', [
    [150, 400],
    [240, 400],
  ]);
  for (let i = 1; i <= 6; ++i)
    await touch('touchMove', [
      [150 - 10 * i, 400],
      [240 + 10 * i, 400],
    ]);
  await touch('touchEnd', []);
  await until(async () => {
    const c = await camera(page);
    return distance(c.eye, c.target) < 0.8 * distance(turned.eye, turned.target);
  }, 'two fingers zoom');
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

// Around the object, nearer and farther, a round in 90 frames, for so many seconds; a round at
// least.
async function fly(page, seconds) {
  await page.evaluate(async least => {
    const centre = viewer.navigation.target(),
      size = viewer.navigation.radius(),
      end = performance.now() + 1000 * least;
    for (let i = 0; i <= 90 || performance.now() < end; ++i) {
      const a = (i / 90) * 2 * Math.PI,
        r = size * (1.6 + Math.cos(3 * a));
      viewer.navigation.set(
        [centre[0] + r * Math.sin(a), centre[1] - r * Math.cos(a), centre[2] + 0.4 * r],
        centre,
        false,
      );
      await new Promise(done => requestAnimationFrame(done));
    }
  }, seconds);
  await exact(page);
}

const seconds = Number(process.env.MTDB_VIEWER_SECONDS ?? 0);
const mb = bytes => `${(bytes / 1e6).toFixed(2)} MB`;

for (const way of ['thick', 'thin'])
  test(`a flight leaves no errors, and takes no more memory the second time (${way})`, async () => {
    const page = await open(`${server.url}/?way=${way}#o=${kName}&px=2`);
    await exact(page);
    const cdp = await page.context().newCDPSession(page);
    const flight = async () => {
      await fly(page, seconds);
      await cdp.send('HeapProfiler.collectGarbage');
      return {
        heap: (await cdp.send('Runtime.getHeapUsage')).usedSize,
        ...(await page.evaluate(() => ({
          ...viewer.renderer.info.memory,
          programs: viewer.renderer.info.programs.length,
          engine: viewer.scene.total(o => o.source.traffic.load?.engineBytes ?? 0),
        }))),
      };
    };
    await flight();
    const first = await flight(),
      second = await flight();
    console.log(
      `        heap ${mb(first.heap)}, then ${mb(second.heap)}; engine ${mb(first.engine)}, then ${mb(second.engine)}`,
    );
    check(second.heap < 1.2 * first.heap + 2e6, `heap ${first.heap}, then ${second.heap}`);
    check(
      second.engine <= 1.2 * first.engine && (way === 'thin' || first.engine > 0),
      `engine ${first.engine}, then ${second.engine}`,
    );
    check(
      second.geometries === first.geometries &&
        second.textures === first.textures &&
        second.programs === first.programs,
      JSON.stringify([first, second]),
    );
    check(page.wrong.length === 0, page.wrong.join('; '));
    await close(page);
  });

for (const way of ['thick', 'thin'])
  test(`no task of the page's thread is long in a flight, drawing aside (${way})`, async () => {
    const page = await open(`${server.url}/?way=${way}#o=${kName}&px=2`);
    await exact(page);
    await page.evaluate(() => (viewer.draw = () => {}));
    await fly(page, 0); // code is compiled, arrays have grown
    const {tasks} = await tasksDuring(page, async () => (await fly(page, seconds), {}));
    const longest = Math.max(...tasks),
      most = quantile(tasks, 0.95);
    console.log(
      `        ${tasks.length} tasks of a millisecond or more of processor time, 95 % below ${most.toFixed(1)} ms, the longest ${longest.toFixed(1)}`,
    );
    check(
      tasks.length > 10 && longest < 50 && most < 12,
      `${tasks.length} tasks, 95 % below ${most} ms, the longest ${longest} ms`,
    );
    check(page.wrong.length === 0, page.wrong.join('; '));
    await close(page);
  });
