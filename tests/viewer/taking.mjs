// SPDX-License-Identifier: Apache-2.0
// What is measured, linked and taken away.
import {readFileSync, writeFileSync} from 'node:fs';
import {box, camera, distance, info, kCone, kName, server, store, test} from './scene.mjs';
import {
  check,
  close,
  decode,
  exact,
  file,
  near,
  open,
  run,
  runJson,
  same,
  trianglesOnScreen,
  until,
} from './testing.mjs';

test('measured points are those of mtdb probe', async () => {
  const page = await open(`${server.url}/#o=${kName}&px=4&unit=mm`);
  await exact(page);
  await page.keyboard.press('m');
  const places = [
    [430, 250],
    [455, 420],
    [380, 480],
  ];
  for (const [i, [x, y]] of places.entries()) {
    await page.mouse.click(x, y);
    await until(
      () =>
        page.evaluate(
          n => viewer.measuring.lines.reduce((sum, l) => sum + l.points.length, 0) === n,
          i + 1,
        ),
      'the point is there',
    );
  }
  const points = await page.evaluate(() => viewer.measuring.lines[0].points);
  for (const [i, [x, y]] of places.entries()) {
    const {origin, direction} = await page.evaluate(
      ([a, b]) => viewer.navigation.ray(a, b),
      [x, y],
    );
    const probed = runJson(
      'probe',
      store,
      '--name',
      kName,
      `--ray=${[...origin, ...direction].join(',')}`,
    );
    check(probed.hit, 'mtdb probe hits');
    near(distance(probed.point, points[i].point), 0, 1e-12, 'the point');
    check(points[i].error_bound === probed.error_bound, 'its bound');
  }
  const length =
    distance(points[0].point, points[1].point) + distance(points[1].point, points[2].point);
  check(
    (await page.textContent('#measured')).includes(
      `${Number(length.toPrecision(4))} mm over 3 points`,
    ),
    await page.textContent('#measured'),
  );
  check((await page.locator('.label').count()) === 3, 'a label for each segment, and for the line');
  const take = async button => {
    const [download] = await Promise.all([page.waitForEvent('download'), page.click(button)]);
    return readFileSync(await download.path(), 'utf8');
  };
  const rows = (await take('#csv'))
    .trim()
    .split('\n')
    .map(row => row.split(','));
  check(
    rows.length === 4 &&
      rows[3].slice(2, 5).every((text, k) => Number(text) === points[2].point[k]),
    'the CSV file',
  );
  near(Number(rows[3][7]), length, 1e-12, 'the length in it');
  const json = JSON.parse(await take('#geojson'));
  check(json.features[0].geometry.coordinates.length === 3, 'the GeoJSON file');
  near(
    json.features[0].properties.height_difference,
    points[2].point[2] - points[0].point[2],
    1e-12,
    'the height difference',
  );
  await page.keyboard.press('Backspace');
  check(
    (await page.evaluate(() => viewer.measuring.lines[0].points.length)) === 2,
    'Backspace takes the last point back',
  );
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('a link brings back camera, region, style and lines', async () => {
  const page = await open(
    `${server.url}/#o=${kName}${box}&outside=coarse&inside=0.004&px=2&wireframe=true&shading=flat&colour=height&map=cividis&unit=m&line=0,0,0,1,1,1`,
  );
  await exact(page);
  await page.mouse.move(400, 100);
  await page.mouse.down();
  await page.mouse.move(470, 130, {steps: 5});
  await page.mouse.up();
  await exact(page);
  const read = p => p.evaluate(() => JSON.stringify({...viewer.view(), eye: 0, target: 0}));
  await until(
    async () => decodeURIComponent(page.url()).includes((await camera(page)).eye.join(',')),
    'the address has the camera',
  );
  const other = await open(page.url());
  await exact(other);
  check((await read(page)) === (await read(other)), `${await read(page)} and ${await read(other)}`);
  const a = await camera(page),
    b = await camera(other);
  near(
    distance(a.eye, b.eye) + distance(a.target, b.target),
    0,
    1e-9 * info.diagonal,
    'the camera',
  );
  same(
    await trianglesOnScreen(other, kName, info),
    await trianglesOnScreen(page, kName, info),
    'the mesh',
  );
  check(
    await other.evaluate(
      () =>
        document.getElementById('wireframe').checked &&
        document.getElementById('shading').value === 'flat',
    ),
    'the panel shows the style',
  );
  check(!(await other.locator('#legend').isHidden()), 'the legend is there');
  await close(other);
  await close(page);
  // Whatever is in a link, the page opens.
  const odd = await open(
    `${server.url}/#o=${kName}&eye=NaN,1&look=x&px=-3&triangles=1e99&region=box:3,2,1,0,0,0&colour=a:none&map=<b>&line=a,b,c&unit=furlong`,
  );
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
    run(
      'extract',
      store,
      file(`box.${format}`),
      '--name',
      kName,
      '--error',
      '0.002',
      '--box=-0.3,-1.3,0.1,0.4,-0.2,0.8',
      '--clip',
    );
    check(
      readFileSync(await download.path()).equals(readFileSync(file(`box.${format}`))),
      `the ${format} file`,
    );
  }
  check(
    /triangles, off by at most/.test(await page.textContent('#take-said')),
    await page.textContent('#take-said'),
  );
  await page.selectOption('#picture-size', '1920x1080');
  const [download] = await Promise.all([page.waitForEvent('download'), page.click('#picture')]);
  const picture = await decode(readFileSync(await download.path()));
  check(picture.width === 1920 && picture.height === 1080, `${picture.width} x ${picture.height}`);
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('a mesh is cut along the planes of its region, and taken as STL', async () => {
  const page = await open(`${server.url}/#o=${kCone}&region=half_space:0,10,0,0,1,0&outside=clip`);
  await exact(page);
  await page.evaluate(() => document.querySelectorAll('details').forEach(d => (d.open = true)));
  await page.check('#take-cut');
  await page.fill('#take-error', '0');
  for (const format of ['ply', 'stl']) {
    await page.selectOption('#format', format);
    const [download] = await Promise.all([page.waitForEvent('download'), page.click('#take')]);
    writeFileSync(file(`cut.${format}`), readFileSync(await download.path()));
    run(
      'ingest',
      file(`cut.${format}`),
      file('cut.mtdb'),
      '--name',
      format,
      '--quiet',
      '--replace',
      '--bits',
      '24',
    );
    const cut = runJson('info', file('cut.mtdb'), '--name', format).objects[0];
    near(cut.bounds.max[1], 10, 1e-5, `${format}: the plane`);
    near(cut.bounds.min[1], 0, 1e-5, `${format}: the base`);
    check(
      cut.components === 1 && cut.boundary_loops === 1 && cut.input.nonmanifold_edges === 0,
      JSON.stringify(cut),
    );
  }
  await page.uncheck('#take-cut');
  const [whole] = await Promise.all([page.waitForEvent('download'), page.click('#take')]);
  writeFileSync(file('meets.stl'), readFileSync(await whole.path()));
  run(
    'extract',
    store,
    file('theirs.stl'),
    '--name',
    kCone,
    '--full',
    '--half-space=0,10,0,0,1,0',
    '--clip',
  );
  check(
    readFileSync(file('meets.stl')).equals(readFileSync(file('theirs.stl'))),
    'without planes it is the file of mtdb extract',
  );
  await page.check('#take-cut');
  await page.selectOption('#format', 'drc');
  await page.click('#take');
  await until(
    async () => /Draco is not written/.test(await page.textContent('#take-said')),
    'the page says what does not go',
  );
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});
