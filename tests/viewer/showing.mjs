// SPDX-License-Identifier: Apache-2.0
// How an object is shown to who knows nothing of it: standing, whole, in its colours; terrains
// higher; the page for visitors.
import {writeFileSync} from 'node:fs';
import {camera, distance, info, kCone, kName, server, status, store, test} from './scene.mjs';
import {
  check,
  close,
  exact,
  extracted,
  file,
  near,
  open,
  run,
  runJson,
  same,
  serveFolder,
  trianglesOnScreen,
  until,
} from './testing.mjs';

// Where points of the model are in the picture: x to the right and y up, from -1 to 1.
const places = (page, points) =>
  page.evaluate(
    list =>
      list.map(p => {
        const s = viewer.scene.stretch;
        return viewer.navigation
          .toScene(p.map((x, k) => x * s[k]))
          .project(viewer.navigation.camera)
          .toArray();
      }),
    points,
  );

test('an object stands as its record says, and one turns around that', async () => {
  const page = await open(`${server.url}/#o=${kCone}`),
    axis = [
      [0, 0, 0],
      [0, 30, 0],
    ];
  await exact(page);
  const stands = async (sign, what) => {
    await exact(page);
    const [base, tip] = await places(page, axis);
    check(
      sign * (tip[1] - base[1]) > 0.5 && Math.abs(tip[0] - base[0]) < 0.05,
      `${what}: ${base} ${tip}`,
    );
  };
  await stands(1, 'at first');
  check(
    (await page.textContent('#up option:checked')) === 'y (from the shape)',
    await page.textContent('#up option:checked'),
  );
  for (const turn of [0.7, 2, 4]) {
    await page.evaluate(
      a => (viewer.navigation.controls.rotate(a, 0.1, false), viewer.navigation.update(0)),
      turn,
    );
    await stands(1, `turned by ${turn}`);
  }
  for (const view of ['front', 'back', 'left', 'right']) {
    await page.evaluate(v => (viewer.navigation.view(v, false), viewer.navigation.update(0)), view);
    await stands(1, view);
  }
  // From above, and flying with a turned head.
  await page.evaluate(() => (viewer.navigation.view('top', false), viewer.navigation.update(0)));
  const eye = (await camera(page)).eye;
  check(eye[1] > 34 && Math.hypot(eye[0], eye[2]) < 1, `from above: ${eye}`);
  await page.selectOption('#up', '-y');
  await exact(page);
  await stands(-1, 'upside down');
  check(
    /up=-y/.test(await page.evaluate(() => (viewer.saveView(), location.hash))),
    'the link has it',
  );
  await page.evaluate(() => location.reload());
  await page.waitForFunction(() => window.viewer?.scene.objects.size > 0);
  await exact(page);
  await stands(-1, 'by its link');
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

for (const way of ['thick', 'thin'])
  test(`the query is of the camera that stands on another axis (${way})`, async () => {
    const page = await open(`${server.url}/?way=${way}#o=${kCone}&px=1&eye=14,22,9&look=0,24,0`);
    await exact(page);
    const query = await page.evaluate(name => viewer.scene.objects.get(name).wanted, kCone);
    check(JSON.stringify(query.region.frustum.up) === '[0,1,0]', JSON.stringify(query));
    same(
      await trianglesOnScreen(page, kCone, runJson('info', store, '--name', kCone).objects[0]),
      await extracted(page, store, kCone, runJson('info', store, '--name', kCone).objects[0]),
      'the mesh',
    );
    await close(page);
  });

for (const way of ['thick', 'thin'])
  test(`what fits the budget is there whole, and what does not as fine as fits (${way})`, async () => {
    const page = await open(`${server.url}/?way=${way}#o=${kName}`);
    await exact(page);
    const triangles = () => page.evaluate(() => viewer.scene.total(o => o.mesh.triangles));
    check((await triangles()) === info.triangles, `${await triangles()} of ${info.triangles}`);
    await until(
      async () =>
        (await status(page)).startsWith(
          `the whole: ${info.triangles.toLocaleString('en')} triangles`,
        ),
      'the page says so',
    );
    // It stays whole and nothing is asked for while one turns it.
    const still = await page.evaluate(async name => {
      viewer.scene.watch = () => {}; // a machine that is too slow to turn it whole draws less meanwhile
      viewer.scene.room = Infinity;
      const object = viewer.scene.objects.get(name),
        before = object.wanted;
      for (let i = 0; i < 10; ++i) {
        viewer.navigation.controls.rotate(0.05, 0, false);
        await new Promise(done => requestAnimationFrame(done));
      }
      return object.wanted === before;
    }, kName);
    check(still, 'a whole needs no other query');
    await page.evaluate(() => ((viewer.scene.budget = 20_000), viewer.scene.restart()));
    await exact(page);
    check(
      (await triangles()) <= 20_000 && (await triangles()) > 18_000,
      `${await triangles()} of 20,000`,
    );
    await until(
      async () => /^as fine as (19|20),\d+ triangles are: exact to /.test(await status(page)),
      'the page says so',
    );
    same(
      await trianglesOnScreen(page, kName, info),
      await extracted(page, store, kName, info),
      'as fine as fits',
    );
    // Closer, where the triangles are finer.
    const bound = await page.evaluate(() => viewer.scene.exactness().bound);
    await page.evaluate(
      () => (viewer.navigation.goTo([0.1, -0.75, 0.45]), viewer.navigation.update(1)),
    );
    await exact(page);
    check((await page.evaluate(() => viewer.scene.exactness().bound)) < bound, 'closer is finer');
    check((await triangles()) <= 20_000, `${await triangles()}`);
    check(page.wrong.length === 0, page.wrong.join('; '));
    await close(page);
  });

test('an error in pixels is for who wants it, and the page says which of both it keeps', async () => {
  const page = await open(`${server.url}/#o=${kName}&px=3`);
  await exact(page);
  await until(async () => (await status(page)).startsWith('exact to 3 px = '), 'pixels');
  check(
    (await page.isVisible('#pixels-row')) && (await page.inputValue('#detail')) === 'pixels',
    'the slider is there',
  );
  await page.selectOption('#detail', 'budget');
  await exact(page);
  await until(async () => (await status(page)).startsWith('the whole'), 'the budget');
  check(
    !(await page.isVisible('#pixels-row')) &&
      !/px=/.test(await page.evaluate(() => (viewer.saveView(), location.hash))),
    'without pixels',
  );
  await close(page);
});

test('colours are shown when an object has some, and one colour when that was chosen', async () => {
  const page = await open(`${server.url}/#o=utm`);
  await exact(page);
  check((await page.inputValue('#colour')) === 'vertex', await page.inputValue('#colour'));
  await page.selectOption('#colour', 'plain');
  const hash = await page.evaluate(() => (viewer.saveView(), location.hash));
  check(/colour=plain/.test(hash), hash);
  const other = await open(`${server.url}/${hash}`);
  await exact(other);
  check((await other.inputValue('#colour')) === 'plain', 'by its link');
  await close(other);
  const cone = await open(`${server.url}/#o=${kCone}`);
  await exact(cone);
  check((await cone.inputValue('#colour')) === 'plain', 'of an object without');
  check(
    (await cone.inputValue('#unit')) === 'mm' && / mm/.test(await cone.textContent('#scale-text')),
    'its units are shown',
  );
  await close(cone);
  await close(page);
});

test('the first view has the object as large as the picture allows', async () => {
  for (const name of [kCone, kName, 'degrees', 'terrain']) {
    const page = await open(`${server.url}/#o=${name}`);
    await exact(page);
    const [left, right, low, high] = await page.evaluate(() => {
      const all = viewer.shape(),
        n = viewer.navigation,
        r = [Infinity, -Infinity, Infinity, -Infinity];
      for (let i = 0; i < all.length; i += 3) {
        const p = n.toScene([all[i], all[i + 1], all[i + 2]]).project(n.camera);
        ((r[0] = Math.min(r[0], p.x)),
          (r[1] = Math.max(r[1], p.x)),
          (r[2] = Math.min(r[2], p.y)),
          (r[3] = Math.max(r[3], p.y)));
      }
      return r;
    });
    check(
      Math.max(-left, right, -low, high) < 1,
      `${name} is in the picture: ${[left, right, low, high]}`,
    );
    check(
      Math.abs(left + right) < 0.04 && Math.abs(low + high) < 0.04,
      `${name} is in its middle: ${[left, right, low, high]}`,
    );
    check(
      Math.max(right - left, high - low) > 1.75,
      `${name} fills it: ${[left, right, low, high]}`,
    );
    await close(page);
  }
});

test("a terrain's heights are exaggerated in the picture, and nowhere else", async () => {
  const page = await open(`${server.url}/#o=degrees&px=2`);
  await exact(page);
  const legend = await page.textContent('#legend-high'),
    terrain = runJson('info', store, '--name', 'degrees').objects[0],
    top = [-122.225, 46.0265, 2400];
  const rise = async () =>
    (await places(page, [[top[0], top[1], 1500], top])).reduce((a, b) => b[1] - a[1]);
  const before = await rise(),
    hit = await page.evaluate(() => viewer.probe(400, 300));
  await page.evaluate(() => {
    viewer.navigation.view('front', false);
    viewer.setExaggeration(4);
    viewer.panel.fill();
    viewer.navigation.view('home', false);
  });
  await exact(page);
  check((await rise()) > 2 * before, `${await rise()} and ${before}`);
  check(
    (await page.isVisible('#exaggerated')) &&
      (await page.textContent('#exaggerated')) === 'heights × 4',
    'the page says it',
  );
  check((await page.textContent('#legend-high')) === legend, 'the legend has the true heights');
  same(
    await trianglesOnScreen(page, 'degrees', terrain),
    await extracted(page, store, 'degrees', terrain),
    'the mesh',
  );
  const [ray, found] = await page.evaluate(async () => [
    viewer.navigation.ray(400, 300),
    await viewer.probe(400, 300),
  ]);
  const s = await page.evaluate(() => viewer.scene.stretch),
    model = v => v.map((x, k) => x / s[k]);
  const theirs = runJson(
    'probe',
    store,
    '--name',
    'degrees',
    `--ray=${[...model(ray.origin), ...model(ray.direction)]}`,
  );
  check(found && distance(found.point, theirs.point) < 1e-6, JSON.stringify([found, theirs, hit]));
  const length = await page.evaluate(
    ([a, b]) => {
      viewer.measuring.replace([{points: [a, b].map(point => ({point, error_bound: 0}))}]);
      return Number(viewer.measuring.csv().split('\n')[2].split(',')[6]);
    },
    [top, [top[0], top[1], 2000]],
  );
  near(length, 400, 1e-6, 'what is measured');
  const hash = await page.evaluate(() => (viewer.saveView(), location.hash));
  const other = await open(`${server.url}/${hash}`);
  await exact(other);
  check(
    (await other.evaluate(() => viewer.exaggerate)) === 4 &&
      distance((await camera(other)).eye, (await camera(page)).eye) < 1,
    'the link has it',
  );
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(other);
  await close(page);
});

const kNotes = {
  title: 'A cone',
  caption: 'It stands.',
  spots: [
    {at: [0, 30, 0], title: 'The <b>tip</b>', text: 'Sharp.'},
    {
      at: [0, 0.1, 0],
      title: 'Inside',
      text: 'Hidden.',
      view: {eye: [30, 10, 30], look: [0, 10, 0]},
    },
    {title: 'nowhere'},
  ],
};

test('visitors get the picture, and what the notes beside the page tell', async () => {
  const site = file('visitors');
  run('view', '--write-page', site);
  run('pack', store, `${site}/cone.mtdbp`, '--name', kCone);
  writeFileSync(`${site}/notes.json`, JSON.stringify(kNotes));
  writeFileSync(`${site}/broken.json`, '{"title"');
  const web = await serveFolder(site),
    at = more => `${web.url}/index.html?src=cone.mtdbp${more}`;
  for (const size of [
    {width: 390, height: 844},
    {width: 1366, height: 768},
    {width: 2560, height: 1440},
  ]) {
    const page = await open(at('&ui=simple&notes=notes.json'), {viewport: size});
    await exact(page);
    await until(async () => (await page.textContent('#visit-title')) === 'A cone', 'the title');
    check(
      (await page.textContent('#visit-caption')) === 'It stands.' &&
        (await page.title()) === 'A cone',
      'the caption',
    );
    for (const id of ['panel', 'toggle', 'tools', 'axes'])
      check(!(await page.isVisible(`#${id}`)), `${id} is not for visitors`);
    check(
      (await page.locator('#spots button').count()) === 2 &&
        /1 of 3 places/.test(await page.textContent('#banner')),
      'a place that is none is said',
    );
    await until(
      () =>
        page.evaluate(
          () =>
            document.querySelectorAll('#spots button')[1].classList.contains('behind') &&
            !document.querySelectorAll('#spots button')[0].classList.contains('behind'),
        ),
      'what is inside is faint',
    );
    const box = await page.locator('#spots button').first().boundingBox(),
      [[x, y]] = await places(page, [[0, 30, 0]]);
    near(box.x + box.width / 2, ((x + 1) / 2) * size.width, 2, 'where the place is');
    near(box.y + box.height / 2, ((1 - y) / 2) * size.height, 2, 'where the place is');
    await page.locator('#spots button').first().click();
    check(
      (await page.textContent('#spot-title')) === 'The <b>tip</b>' &&
        (await page.textContent('#spot-text')) === 'Sharp.',
      'its text, without markup',
    );
    const card = await page.locator('#spot-card').boundingBox();
    check(
      card.x >= 0 &&
        card.y >= 0 &&
        card.x + card.width <= size.width &&
        card.y + card.height <= size.height,
      JSON.stringify(card),
    );
    await page
      .locator('#spots button')
      .nth(1)
      .evaluate(button => button.click());
    await until(async () => distance((await camera(page)).eye, [30, 10, 30]) < 1e-3, 'its view');
    await page.click('#spot-close');
    check(!(await page.isVisible('#spot-card')), 'the card is closed');
    await page.click('#visit-turn');
    const before = (await camera(page)).eye;
    await until(async () => distance((await camera(page)).eye, before) > 0.5, 'it turns');
    near((await camera(page)).eye[1], before[1], 1e-3, 'about what is up');
    check(
      (await page.getAttribute('#visit-turn', 'aria-pressed')) === 'true',
      'the button says so',
    );
    check(page.wrong.length === 0, page.wrong.join('; '));
    await close(page);
  }
  const turning = await open(at('&ui=simple&turn'));
  const from = (await camera(turning)).eye;
  await until(
    () => turning.evaluate(() => viewer.scene.exactness().by === 'whole'),
    'what turns from the beginning is whole',
  );
  await until(async () => distance((await camera(turning)).eye, from) > 0.5, 'and turns');
  await close(turning);
  const plain = await open(at('&ui=none'));
  await exact(plain);
  for (const id of ['panel', 'toggle', 'title', 'tools', 'status', 'scale', 'axes', 'visit'])
    check(!(await plain.isVisible(`#${id}`)), `${id} is not there`);
  near(
    await plain.evaluate(() => viewer.canvas.clientWidth),
    1086,
    0,
    'the picture has all of the page',
  );
  await close(plain);
  const several = await open(`${server.url}/?ui=none`);
  await exact(several);
  check(!(await several.isVisible('#start')), 'the picture alone has no list of objects');
  check(
    (await several.evaluate(() => viewer.scene.objects.size)) === 1,
    'it is that of the first object',
  );
  await close(several);
  for (const [notes, words] of [
    ['none.json', 'the server answers 404'],
    ['broken.json', 'cannot be read'],
    ['https://elsewhere.example/n.json', 'files of its own server only'],
  ]) {
    const page = await open(at(`&ui=simple&notes=${notes}`));
    await until(async () => (await page.textContent('#banner')).includes(words), words);
    await exact(page);
    await close(page);
  }
  await web.stop();
});
