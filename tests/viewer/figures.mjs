// SPDX-License-Identifier: Apache-2.0
// Figures of the page for the benchmark page, as a table in Markdown. MTDB_BINARY and
// MTDB_VIEWER_BUILD as for the tests.
//   node tests/viewer/figures.mjs [--json] STORE...      each with one object, as of: mtdb generate sculpture s.ply --triangles 2000000; mtdb ingest s.ply s.mtdb
// For each store, each way to get a mesh, and two networks (this machine; 50 ms there and back, and
// 20 Mbit/s): from opening the page to the first mesh and to the exact one, and the bytes until
// then. On this machine also, without drawing, which there is no graphics card for: along a path of
// 300 frames, milliseconds of cut, of the worker and of the page's arrays, and the processor's time
// of the tasks of the page's thread; after dragging a box, milliseconds to full resolution in it.
// Beside it a naive page: the whole mesh as a Draco file (up to 30 million triangles), of which the
// download is measured, without the time to decode and draw it.
import {createServer, connect} from 'node:net';
import {once} from 'node:events';
import {loadavg} from 'node:os';
import {existsSync, readFileSync, statSync} from 'node:fs';
import {createServer as createHttp} from 'node:http';
import {close, file, launch, open, quantile, run, runJson, serve, tasksDuring} from './testing.mjs';

const json = process.argv[2] === '--json',
  stores = process.argv.slice(json ? 3 : 2);
if (stores.length === 0 || !stores.every(path => existsSync(path))) {
  console.error('usage: node figures.mjs [--json] STORE...');
  process.exit(2);
}

// A way to `port` with half a round trip each way, and so many bits a second.
async function slowly(port, roundTrip = 50, bitsPerSecond = 20e6) {
  const pass = (from, to) => {
    let free = 0,
      waiting = 0;
    from.on('data', chunk => {
      const now = performance.now();
      free = Math.max(free, now) + (chunk.length * 8000) / bitsPerSecond;
      waiting += chunk.length;
      if (waiting > 1 << 18) from.pause();
      setTimeout(
        () => {
          to.write(chunk);
          waiting -= chunk.length;
          if (waiting < 1 << 17) from.resume();
        },
        free - now + roundTrip / 2,
      );
    });
    from.on('end', () =>
      setTimeout(() => to.end(), Math.max(0, free - performance.now()) + roundTrip / 2),
    );
    from.on('error', () => to.destroy());
    from.on('close', () =>
      setTimeout(() => to.destroy(), Math.max(0, free - performance.now()) + roundTrip),
    );
  };
  const server = createServer(client => {
    const target = connect(port, '127.0.0.1');
    client.setNoDelay();
    target.setNoDelay();
    pass(client, target);
    pass(target, client);
  });
  server.listen(0, '127.0.0.1');
  await once(server, 'listening');
  return server;
}

const ms = x => (x < 10 ? x.toFixed(1) : x.toFixed(0));

// Notes when meshes come, from the page's beginning on.
const watch = () => {
  window.noted = {};
  const look = () => {
    const scene = window.viewer?.scene;
    if (scene) {
      if (window.noted.first === undefined && scene.total(o => o.mesh.triangles) > 0)
        window.noted.first = performance.now();
      if (window.noted.exact === undefined && ['exact', 'short'].includes(scene.exactness().kind)) {
        window.noted.exact = performance.now();
        window.noted.bytes = scene.total(o => o.source.traffic.bytes);
        window.noted.triangles = scene.total(o => o.mesh.triangles);
        window.noted.pixels = scene.exactness().pixels;
      }
    }
    setTimeout(look, 2);
  };
  look();
};

async function opening(url, name) {
  const page = await open(`${url}#o=${encodeURIComponent(name)}&px=1`, {
    viewport: {width: 1366, height: 768},
    init: watch,
  });
  await page.waitForFunction(() => window.noted.exact !== undefined);
  const noted = await page.evaluate(() => window.noted);
  return {
    page,
    noted,
    pageBytes: Object.entries(page.bytes)
      .filter(([path]) => !path.startsWith('/objects'))
      .reduce((sum, [, n]) => sum + (n || 0), 0),
  };
}

// A flight around the object and towards it: what each answer and each frame cost.
async function flight(page) {
  return page.evaluate(async () => {
    viewer.draw = () => {};
    const object = [...viewer.scene.objects.values()][0],
      centre = viewer.navigation.target(),
      size = viewer.navigation.radius();
    const cut = [],
      worker = [],
      arrays = [],
      apply = object.mesh.apply.bind(object.mesh);
    object.mesh.apply = update => {
      const begin = performance.now();
      apply(update);
      arrays.push(performance.now() - begin);
      worker.push(object.source.traffic.applyMilliseconds);
    };
    let last = null;
    for (let i = 0; i < 300; ++i) {
      const a = (i / 300) * 2 * Math.PI,
        r = size * (1.9 - 0.9 * Math.sin(a / 2));
      viewer.navigation.set(
        [centre[0] + r * Math.sin(a), centre[1] - r * Math.cos(a), centre[2] + 0.4 * r],
        centre,
        false,
      );
      await new Promise(done => requestAnimationFrame(done));
      if (object.done && object.done !== last) cut.push((last = object.done).milliseconds);
    }
    return {cut, worker, arrays};
  });
}

// Milliseconds from the last event of the mouse to full resolution in the box, in the page's
// arrays.
async function dragging(url, name) {
  const page = await open(`${url}#o=${encodeURIComponent(name)}&px=16`, {
    viewport: {width: 1366, height: 768},
  });
  const exact = () =>
    page.waitForFunction(
      () => window.viewer && ['exact', 'short'].includes(viewer.scene.exactness().kind),
    );
  await exact();
  await page.evaluate(() => {
    viewer.draw = () => viewer.handles.update();
    viewer.setRegion(viewer.newRegion('box'));
  });
  await page.evaluate(() => (viewer.scene.focus = {...viewer.scene.focus, outside: 'coarse'}));
  await exact();
  const times = [];
  for (let i = 0; i < 10; ++i) {
    const [x, y] = (await page.evaluate(() => viewer.handles.places())).centre;
    await page.mouse.move(x, y);
    await page.mouse.down();
    await page.evaluate(() => {
      addEventListener('pointermove', () => (window.moved = performance.now()), {capture: true});
    });
    for (let k = 1; k <= 8; ++k) await page.mouse.move(x + (i % 2 ? -3 : 3) * k, y + (k % 2));
    times.push(
      await page.evaluate(
        () =>
          new Promise(done => {
            const object = [...viewer.scene.objects.values()][0];
            const look = () => {
              // The query of the last place is made in the next frame.
              if (
                viewer.scene.focus &&
                object.doneText === object.wantedText &&
                JSON.stringify(object.wanted.region) ===
                  JSON.stringify({box: viewer.scene.focus.region.box})
              )
                done(performance.now() - window.moved);
              else setTimeout(look, 1);
            };
            look();
          }),
      ),
    );
    await page.mouse.up();
  }
  const triangles = await page.evaluate(() => viewer.scene.total(o => o.mesh.triangles));
  await close(page);
  return {times, triangles};
}

const kMostNaive = 3e7; // triangles: Draco's encoder would take more memory than there is

async function measureStore(store) {
  const object = runJson('info', store).objects[0],
    name = object.object,
    rows = [];
  const server = await serve(store),
    slow = await slowly(server.port);
  for (const way of ['thin', 'thick']) {
    for (const [network, port] of [
      ['this machine', server.port],
      ['50 ms, 20 Mbit/s', slow.address().port],
    ]) {
      const {page, noted, pageBytes} = await opening(`http://127.0.0.1:${port}/?way=${way}`, name);
      const row = {
        triangles: object.triangles,
        way,
        network,
        first_seconds: noted.first / 1000,
        exact_seconds: noted.exact / 1000,
        exact_pixels: noted.pixels,
        exact_triangles: noted.triangles,
        mesh_bytes: noted.bytes,
        page_bytes: pageBytes,
      };
      rows.push(row);
      if (port === server.port) {
        const flown = await tasksDuring(page, () => flight(page)),
          two = list => [quantile(list, 0.5), quantile(list, 0.95)];
        Object.assign(row, {
          cut_ms: two(flown.cut),
          worker_ms: two(flown.worker),
          arrays_ms: two(flown.arrays),
          task_ms: [quantile(flown.tasks, 0.95), Math.max(0, ...flown.tasks)],
        });
      }
      await close(page);
    }
  }
  const {times, triangles} = await dragging(server.url + '/?way=thin', name);
  rows.push({triangles: object.triangles, way: 'thin', drag_ms: times, drag_triangles: triangles});
  const done = () => (slow.close(), server.stop('SIGTERM'));
  if (object.triangles > kMostNaive) return (await done(), rows);
  run('extract', store, file('naive.drc'), '--full', '--name', name);
  const bytes = statSync(file('naive.drc')).size,
    naive = createHttp((_, response) => response.end(readFileSync(file('naive.drc')))).listen(
      0,
      '127.0.0.1',
    );
  await once(naive, 'listening');
  const slower = await slowly(naive.address().port),
    begin = performance.now();
  await (await fetch(`http://127.0.0.1:${slower.address().port}/`)).arrayBuffer();
  rows.push({
    triangles: object.triangles,
    way: 'Draco',
    network: '50 ms, 20 Mbit/s',
    exact_seconds: (performance.now() - begin) / 1000,
    mesh_bytes: bytes,
  });
  for (const s of [slower, naive]) s.close();
  await done();
  return rows;
}

const browser = await launch();
const said = {load: loadavg()[0], chromium: browser.version()};
const rows = [];
for (const store of stores) rows.push(...(await measureStore(store)));
await browser.close();
if (json) {
  console.log(JSON.stringify({...said, rows}));
} else {
  console.log(
    `Load of the machine: ${said.load.toFixed(1)}; Chromium ${said.chromium}, drawn by the processor.\n`,
  );
  console.log(
    '| triangles | way | network | first mesh, s | exact, s | triangles then | MB of mesh | KB of page | cut, ms: median, 95 % | worker, ms | arrays, ms | tasks, ms: 95 %, longest |\n|--:|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|',
  );
  const count = x => x.toLocaleString('en');
  for (const row of rows) {
    if (row.drag_ms) continue;
    const cells = [
      count(row.triangles),
      row.way,
      row.network,
      row.first_seconds?.toFixed(2) ?? '',
      row.exact_seconds.toFixed(2),
      row.exact_triangles ? count(row.exact_triangles) : '',
      (row.mesh_bytes / 1e6).toFixed(2),
      row.page_bytes ? (row.page_bytes / 1000).toFixed(0) : '',
      ...[row.cut_ms, row.worker_ms, row.arrays_ms, row.task_ms].map(
        pair => pair?.map(ms).join(', ') ?? '',
      ),
    ];
    console.log(`| ${cells.join(' | ')} |`);
  }
  for (const row of rows.filter(r => r.drag_ms)) {
    console.log(
      `\n${count(row.triangles)} triangles: a dragged box is at full resolution (${count(row.drag_triangles)} triangles) ${ms(quantile(row.drag_ms, 0.5))} ms after the mouse's last event; the slowest of ${row.drag_ms.length} took ${ms(Math.max(...row.drag_ms))}.`,
    );
  }
}
process.exit(0);
