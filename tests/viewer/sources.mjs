// SPDX-License-Identifier: Apache-2.0
// Stores, servers and packed files, and what the page says of them.
import {readFileSync, writeFileSync} from 'node:fs';
import {box, camera, distance, info, kName, kOdd, server, status, store, test} from './scene.mjs';
import {
  check,
  close,
  exact,
  extracted,
  file,
  near,
  nginxPath,
  open,
  run,
  runJson,
  same,
  serve,
  serveFolder,
  trianglesOnScreen,
  until,
} from './testing.mjs';

test('names and attributes are never markup; objects go on and off', async () => {
  const page = await open(server.url + '/');
  await page.waitForSelector('#start-list button');
  check(
    (await page.locator('#start-list button').allTextContents()).some(text =>
      text.startsWith(kOdd),
    ),
    'the list has the odd name',
  );
  await page.locator('#start-list button').filter({hasText: 'Hügel'}).click();
  await exact(page);
  check((await page.textContent('#title')) === kOdd, 'the title has the odd name');
  check((await page.locator('img').count()) === 0, 'no markup came of it');
  await page.locator('#objects label').filter({hasText: kName}).locator('input').check();
  await exact(page);
  const shown = await page.evaluate(() =>
    [...viewer.scene.objects].map(([, o]) => o.mesh.triangles),
  );
  check(shown.length === 2 && shown.every(n => n > 50), `${shown}`);
  await page.selectOption('#colour', 'a:quality');
  await exact(page);
  await until(
    async () =>
      (await page.isVisible('#legend')) && (await page.textContent('#legend-name')) === 'quality',
    'the legend of the attribute',
  );
  await page.selectOption('#colour', 'vertex');
  await exact(page);
  await page.locator('#objects label').filter({hasText: kName}).locator('input').uncheck();
  await until(() => page.evaluate(() => viewer.scene.objects.size === 1), 'the object is off');
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

for (const way of ['thick', 'thin'])
  test(`a lost server is said, and found again with the same view (${way})`, async () => {
    let own = await serve(store);
    const page = await open(`${own.url}/?way=${way}#o=${kName}&px=3`);
    await exact(page);
    const before = await trianglesOnScreen(page, kName, info),
      view = await camera(page);
    await own.stop('SIGKILL');
    // The engine in the page notices when it wants more.
    const pixels = p => page.evaluate(x => ((viewer.scene.pixels = x), viewer.scene.restart()), p);
    if (way === 'thick') await pixels(0.1);
    await until(
      async () =>
        (await page.isVisible('#banner')) && /lost|reached/.test(await page.textContent('#banner')),
      'the page says that the server is lost',
    );
    check(
      (await page.evaluate(() => viewer.scene.total(o => o.mesh.triangles))) >= before.length,
      'the mesh is still there',
    );
    own = await serve(store, own.port);
    await until(async () => !(await page.isVisible('#banner')), 'the server is found again');
    if (way === 'thick') {
      await exact(page);
      same(
        await trianglesOnScreen(page, kName, info),
        await extracted(page, store, kName, info),
        'the finer mesh',
      );
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

for (const nginx of [false, true])
  test(`a packed file is shown from any web server (${nginx ? 'nginx' : 'one of a few lines'})`, async () => {
    if (nginx && !nginxPath) return console.log('skipped: nginx is not installed');
    const web = await serveFolder(writeSite(), {nginx});
    for (const more of ['&px=1', `${box}&outside=view&px=4`, `${box}&outside=clip`]) {
      const page = await open(`${web.url}/index.html?src=scan.mtdbp#o=${kName}${more}`);
      await exact(page);
      same(
        await trianglesOnScreen(page, kName, info),
        await extracted(page, store, kName, info),
        more,
      );
      check(page.wrong.length === 0, page.wrong.join('; '));
      await close(page);
    }
    const page = await open(
      `${web.url}/index.html?src=scan.mtdbp&way=thin#o=${kName}${box}&outside=view&px=4`,
    );
    await exact(page);
    await page.evaluate(() => document.querySelectorAll('details').forEach(d => (d.open = true)));
    check(await page.locator('#way-row').isHidden(), 'there is no server that could cut');
    const [ray, hit] = await page.evaluate(async () => {
      const places = [
        [400, 300],
        [400, 200],
        [300, 300],
        [500, 300],
        [400, 400],
      ]; // the sculpture has holes
      const hits = await Promise.all(places.map(place => viewer.probe(...place))),
        i = hits.findIndex(found => found);
      return [viewer.navigation.ray(...places[i]), hits[i]];
    });
    const found = runJson(
      'probe',
      store,
      '--name',
      kName,
      `--ray=${[...ray.origin, ...ray.direction]}`,
    );
    check(
      hit !== null &&
        distance(hit.point, found.point) === 0 &&
        hit.error_bound === found.error_bound,
      JSON.stringify([hit, found]),
    );
    for (const format of ['ply', 'obj', 'glb']) {
      await page.selectOption('#format', format);
      await page.fill('#take-error', '0.002');
      const [download] = await Promise.all([page.waitForEvent('download'), page.click('#take')]);
      run(
        'ingest',
        await download
          .path()
          .then(
            path => (
              writeFileSync(file(`taken.${format}`), readFileSync(path)),
              file(`taken.${format}`)
            ),
          ),
        file('taken.mtdb'),
        '--name',
        format,
        '--quiet',
        '--replace',
      );
      run(
        'extract',
        store,
        file(`cut.${format}`),
        '--name',
        kName,
        '--error',
        '0.002',
        '--box=-0.3,-1.3,0.1,0.4,-0.2,0.8',
        '--clip',
        ...(format === 'ply' ? ['--double-positions'] : []),
      );
      run(
        'ingest',
        file(`cut.${format}`),
        file('taken.mtdb'),
        '--name',
        `cut ${format}`,
        '--quiet',
        '--replace',
      );
      const digests = [format, `cut ${format}`].map(
        name => runJson('info', file('taken.mtdb'), '--name', name).objects[0],
      );
      check(
        digests[0].triangles > 500 &&
          digests[0].triangles === digests[1].triangles &&
          digests[0].vertices === digests[1].vertices,
        JSON.stringify(digests),
      );
      near(
        Math.max(...digests[0].bounds.min.map((x, k) => Math.abs(x - digests[1].bounds.min[k]))),
        0,
        1e-6,
        'the bounds',
      );
    }
    check(
      await page.evaluate(() => document.querySelector('#format option[value=drc]').disabled),
      'what only mtdb writes is not offered',
    );
    await page.locator('#objects label').filter({hasText: 'utm'}).locator('input').check();
    await exact(page);
    await page.locator('#objects label').filter({hasText: kName}).locator('input').uncheck();
    await page.selectOption('#region', '');
    const [download] = await Promise.all([page.waitForEvent('download'), page.click('#take')]);
    writeFileSync(file('utm.glb'), readFileSync(await download.path()));
    run('ingest', file('utm.glb'), file('taken.mtdb'), '--name', 'utm', '--quiet', '--replace');
    const taken = runJson('info', file('taken.mtdb'), '--name', 'utm').objects[0];
    near(
      Math.max(
        ...taken.bounds.min.map((x, k) =>
          Math.abs(x - runJson('info', store, '--name', 'utm').objects[0].bounds.min[k]),
        ),
      ),
      0,
      0.02,
      'UTM in GLB',
    );
    check(
      taken.attributes
        .map(a => a.name)
        .sort()
        .join() === 'blue,green,quality,red',
      JSON.stringify(taken.attributes),
    );
    // A terrain in degrees tells its coordinate system in a packed file, too.
    const terrain = await open(`${web.url}/index.html?src=scan.mtdbp#o=degrees`);
    await exact(terrain);
    check(
      await terrain.evaluate(() => viewer.scene.stretch[1] > 1e5),
      'degrees are drawn in metres',
    );
    same(
      await trianglesOnScreen(
        terrain,
        'degrees',
        runJson('info', store, '--name', 'degrees').objects[0],
      ),
      await extracted(
        terrain,
        store,
        'degrees',
        runJson('info', store, '--name', 'degrees').objects[0],
      ),
      'degrees',
    );
    check(terrain.wrong.length === 0, terrain.wrong.join('; '));
    await close(terrain);
    check(page.wrong.length === 0, page.wrong.join('; '));
    await close(page);
    await web.stop();
  });

test('a page on a web server says what it cannot show, and shows what it may', async () => {
  const site = writeSite(),
    web = await serveFolder(site),
    other = await serveFolder(site, {origin: web.url});
  const said = async (search, words, wrong = /404|Failed to load/) => {
    const page = await open(`${web.url}/index.html${search}`);
    await until(
      async () => (await page.textContent('#banner')).includes(words),
      `the page says "${words}"`,
    );
    check(
      page.wrong.every(text => wrong.test(text)),
      page.wrong.join('; '),
    );
    await close(page);
  };
  await said('?src=none.mtdbp', 'There is no file “none.mtdbp”');
  await said('?src=viewer.css', 'packed file');
  await said('', 'There is no mtdb behind this page.');
  await said(`?src=${other.url}/scan.mtdbp`, 'files of its own server only');
  await said('?src=file:///etc/passwd', 'files of its own server only');
  await said('?src=data:,x', 'files of its own server only');
  await said('?src=http://[', 'is no address');
  const without = await serveFolder(site, {parts: false}),
    small = await open(`${without.url}/index.html?src=scan.mtdbp#o=${kName}&px=3`);
  await exact(small);
  same(
    await trianglesOnScreen(small, kName, info),
    await extracted(small, store, kName, info),
    'from a server that sends no parts',
  );
  check(small.wrong.length === 0, small.wrong.join('; '));
  await close(small);
  await without.stop();
  run('view', '--write-page', site, '--allowed-source', other.url);
  const page = await open(`${web.url}/index.html?src=${other.url}/scan.mtdbp#o=${kName}&px=3`);
  await exact(page);
  same(
    await trianglesOnScreen(page, kName, info),
    await extracted(page, store, kName, info),
    'from another origin',
  );
  check(page.wrong.length === 0, page.wrong.join('; '));
  // A file that is replaced under the page.
  run('ingest', file('small.ply'), file('second.mtdb'), '--quiet', '--name', kName);
  run('pack', file('second.mtdb'), `${site}/scan.mtdbp`);
  await page.evaluate(() => ((viewer.scene.pixels = 0.2), viewer.scene.restart()));
  const triangles = runJson('info', file('second.mtdb')).objects[0].triangles;
  await until(
    () =>
      page.evaluate(
        n =>
          viewer.scene.total(o => o.mesh.triangles) <= n &&
          viewer.scene.exactness().kind !== 'loading',
        triangles,
      ),
    'the file that replaced it is shown',
  );
  await close(page);
  www = null;
  await web.stop();
  await other.stop();
});

// A copy with a byte that is another one, `after` bytes behind where `text` begins last.
function damaged(from, to, text, after) {
  const bytes = readFileSync(from),
    at = bytes.lastIndexOf(text);
  check(at >= 0 && at + after < bytes.length, `${text} is in ${from}`);
  bytes[at + after] ^= 0xff;
  writeFileSync(to, bytes);
}

test('what is damaged is said once, and not tried for ever', async () => {
  const said = async (url, words) => {
    const page = await open(url);
    await until(
      async () => (await page.textContent('#banner')).includes(words),
      `the page says "${words}"`,
    );
    check(!/again/.test(await page.textContent('#banner')), await page.textContent('#banner'));
    let requests = 0;
    page.on('request', () => ++requests);
    await page.waitForTimeout(2500); // longer than it would wait to try again
    check(requests === 0, `${requests} further requests`);
    await close(page);
  };
  // A catalog, by a server.
  run('ingest', file('small.ply'), file('whole.mtdb'), '--quiet', '--name', 'brief');
  damaged(file('whole.mtdb'), file('damaged.mtdb'), 'brief', 40);
  const own = await serve(file('damaged.mtdb'));
  await said(own.url + '/', 'the object cannot be read');
  await said(own.url + '/#o=brief', 'the object cannot be read');
  await own.stop('SIGTERM');
  // The header of a packed file; and what is not one.
  const site = file('damaged');
  run('view', '--write-page', site);
  run('pack', store, `${site}/whole.mtdbp`, '--name', kName);
  const web = await serveFolder(site),
    bytes = readFileSync(`${site}/whole.mtdbp`);
  writeFileSync(
    `${site}/head.mtdbp`,
    bytes.map((b, i) => (i === 12 ? b ^ 255 : b)),
  );
  await said(`${web.url}/index.html?src=head.mtdbp`, 'head.mtdbp');
  // Its last bytes are clusters of the finest round: the mesh is coarser there, the page says why,
  // and one flies on.
  writeFileSync(
    `${site}/tail.mtdbp`,
    bytes.map((b, i) => (i > bytes.length - 5000 ? b ^ 255 : b)),
  );
  const page = await open(`${web.url}/index.html?src=tail.mtdbp#o=${kName}&px=0.1`);
  await until(async () => /checksum/.test(await status(page)), 'the page says what is damaged');
  const triangles = () => page.evaluate(() => viewer.scene.total(o => o.mesh.triangles));
  check((await triangles()) > 1000, `${await triangles()} triangles`);
  await page.evaluate(() => ((viewer.scene.pixels = 8), viewer.scene.restart()));
  await exact(page);
  check(page.wrong.length === 0 && !(await page.isVisible('#banner')), page.wrong.join('; '));
  await close(page);
  await web.stop();
});

test('what cannot be shown is a sentence', async () => {
  const said = async (url, words, options) => {
    const page = await open(url, options);
    await until(
      async () =>
        (await page.textContent('body')).includes(words) &&
        (await page.getByText(words).first().isVisible()),
      `the page says "${words}"`,
    );
    await close(page);
  };
  await said(`${server.url}/#o=nothing`, 'There is no object “nothing” here. There are these:');
  await said(`${server.url}/#o=nothing&o=utm`, 'There is no object “nothing” here, but');
  await said(server.url + '/', 'This browser has no WebGL 2', {
    init: () => {
      const get = HTMLCanvasElement.prototype.getContext;
      HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
        return kind === 'webgl2' ? null : get.call(this, kind, ...more);
      };
    },
  });
  // An object that is removed while one looks at it, and a store without any.
  const other = file('other.mtdb');
  run('ingest', file('small.ply'), other, '--quiet', '--name', 'brief');
  const own = await serve(other);
  const page = await open(own.url + '/');
  await exact(page);
  run('remove', other, 'brief');
  await page.evaluate(() => viewer.navigation.view('top', false));
  await page.evaluate(() => (viewer.scene.pixels = 0.5));
  await until(
    async () =>
      /not in the store any more|gone|removed/.test(await page.textContent('#banner')) ||
      (await page.evaluate(() => viewer.scene.exactness().kind === 'exact')),
    'the removed object is said, or its session goes on',
  );
  await close(page);
  await said(own.url + '/', 'This store has no objects yet.');
  await own.stop('SIGTERM');
});
