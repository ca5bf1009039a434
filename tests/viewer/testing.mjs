// SPDX-License-Identifier: Apache-2.0
// What the tests of the page share: stores, servers, Chromium, and meshes as sets of triangles.
import {createRequire} from 'node:module';
import {spawn, execFileSync} from 'node:child_process';
import {existsSync, mkdtempSync, readFileSync, rmSync, statSync, writeFileSync} from 'node:fs';
import {createServer} from 'node:http';
import {tmpdir} from 'node:os';
import {join} from 'node:path';

export const mtdb = process.env.MTDB_BINARY;
export const chromiumPath = '/usr/bin/chromium';
const require = createRequire(join(process.env.MTDB_VIEWER_BUILD, 'package.json'));

export function skip(why) {
  console.log(`skipped: ${why}`);
  process.exit(77);
}

export const folder = mkdtempSync(join(tmpdir(), 'mtdb-viewer-'));
export const file = name => join(folder, name);
process.on('exit', () => rmSync(folder, {recursive: true, force: true}));

export const run = (...args) => execFileSync(mtdb, args, {encoding: 'utf8', maxBuffer: 1 << 28});
export const runJson = (...args) => JSON.parse(run(...args, '--json'));

export function check(condition, what) {
  if (!condition) throw new Error(what);
}
export function near(a, b, tolerance, what) {
  check(Math.abs(a - b) <= tolerance, `${what}: ${a} and ${b} differ by more than ${tolerance}`);
}

export async function until(f, what, seconds = 900) {
  const end = Date.now() + 1000 * seconds;
  for (;;) {
    const value = await f();
    if (value) return value;
    if (Date.now() > end) throw new Error(`waited ${seconds} s in vain until ${what}`);
    await new Promise(done => setTimeout(done, 30));
  }
}

const servers = new Set();
process.on('exit', () => servers.forEach(s => s.kill('SIGKILL')));

export const serve = (store, port = 0) => start('serve', store, '--listen', `127.0.0.1:${port}`);

// A verb that prints its URL and serves.
export async function start(...args) {
  const process = spawn(mtdb, args, {stdio: ['ignore', 'pipe', 'inherit']});
  servers.add(process);
  const url = await new Promise((done, fail) => {
    process.stdout.once('data', data => done(String(data).trim()));
    process.once('exit', code => fail(new Error(`mtdb ${args[0]} ended with ${code}`)));
  });
  return {
    url,
    port: Number(new URL(url).port),
    stop: signal =>
      new Promise(done => {
        servers.delete(process);
        process.once('exit', done);
        process.kill(signal);
      }),
  };
}

// A web server of a folder that knows nothing of mtdb: nginx, or one of a few lines. `origin`: of
// other pages that may read from it. Without `parts` each answer is a whole file.
export async function serveFolder(folder, {nginx = false, origin = '', parts = true} = {}) {
  if (nginx) return await serveByNginx(folder);
  const kinds = {
    html: 'text/html',
    js: 'text/javascript',
    css: 'text/css',
    wasm: 'application/wasm',
    svg: 'image/svg+xml',
  };
  const server = createServer((request, response) => {
    const path = join(folder, decodeURIComponent(new URL(request.url, 'http://x').pathname));
    if (!existsSync(path) || statSync(path).isDirectory())
      return response.writeHead(404).end('no such file');
    const bytes = readFileSync(path),
      headers = {
        'Content-Type': kinds[path.split('.').at(-1)] ?? 'application/octet-stream',
        ETag: `"${statSync(path).mtimeMs}-${bytes.length}"`,
      };
    if (origin)
      Object.assign(headers, {
        'Access-Control-Allow-Origin': origin,
        'Access-Control-Expose-Headers': 'Content-Range, ETag',
        'Access-Control-Allow-Headers': 'Range',
      });
    if (request.method === 'OPTIONS') return response.writeHead(204, headers).end();
    const range = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range ?? '');
    if (!range || !parts) return response.writeHead(200, headers).end(bytes);
    const body = bytes.subarray(Number(range[1]), Number(range[2]) + 1);
    response
      .writeHead(206, {
        ...headers,
        'Content-Range': `bytes ${range[1]}-${Number(range[1]) + body.length - 1}/${bytes.length}`,
      })
      .end(body);
  });
  await new Promise(done => server.listen(0, '127.0.0.1', done));
  return {
    url: `http://127.0.0.1:${server.address().port}`,
    stop: async () => {
      server.closeAllConnections();
      await new Promise(done => server.close(done));
    },
  };
}

export const nginxPath = ['/usr/sbin/nginx', '/usr/bin/nginx'].find(path => existsSync(path));
async function serveByNginx(folder) {
  const port = await new Promise(done => {
    const probe = createServer().listen(0, '127.0.0.1', () => {
      const {port: free} = probe.address();
      probe.close(() => done(free));
    });
  });
  const own = mkdtempSync(join(tmpdir(), 'mtdb-nginx-'));
  const user = process.getuid() === 0 ? 'user root;' : '';
  const temporary = ['client_body', 'proxy', 'fastcgi', 'uwsgi', 'scgi']
    .map(kind => `${kind}_temp_path ${own}/${kind};`)
    .join(' ');
  writeFileSync(
    join(own, 'nginx.conf'),
    `${user} worker_processes 1; pid ${own}/pid; error_log ${own}/error.log; daemon off;
    events {} http { access_log off; ${temporary} include /etc/nginx/mime.types; server { listen 127.0.0.1:${port}; location / { root ${folder}; gzip off; } } }`,
  );
  const nginx = spawn(
    nginxPath,
    ['-p', own, '-e', join(own, 'error.log'), '-c', join(own, 'nginx.conf')],
    {stdio: ['ignore', 'ignore', 'inherit']},
  );
  servers.add(nginx);
  const url = `http://127.0.0.1:${port}`;
  await until(
    async () =>
      await fetch(`${url}/index.html`).then(
        r => r.ok,
        () => false,
      ),
    'nginx answers',
    60,
  );
  return {
    url,
    stop: () =>
      new Promise(done => {
        servers.delete(nginx);
        nginx.once('exit', () => {
          rmSync(own, {recursive: true, force: true});
          done();
        });
        nginx.kill('SIGQUIT');
      }),
  };
}

let browser;
export async function launch() {
  if (!existsSync(chromiumPath)) skip('chromium is not installed');
  const {chromium} = require('playwright-core');
  browser = await chromium.launch({
    executablePath: chromiumPath,
    timeout: 120000,
    args: [
      '--headless',
      '--no-sandbox',
      '--use-angle=swiftshader',
      '--use-gl=angle',
      '--enable-unsafe-swiftshader',
      '--ignore-gpu-blocklist',
      '--disable-gpu-watchdog',
      '--disable-gpu-process-crash-limit',
      '--disable-quic',
      '--no-first-run',
      '--disable-background-networking',
      '--disable-component-update',
      '--disable-sync',
    ],
  });
  return browser;
}

const kPanel = 286; // pixels that the panel takes from the picture

// A page with what went wrong in it, unless the test expects it: `page.wrong`. The picture has 800
// x 600 pixels, as far as the test does not say another size of the page; the mouse's coordinates
// are the picture's.
export async function open(url, options = {}) {
  const context = await browser.newContext({
    viewport: {width: 800 + kPanel, height: 600},
    acceptDownloads: true,
    reducedMotion: 'reduce',
    ...options,
  });
  const page = await context.newPage();
  page.setDefaultTimeout(900000);
  page.wrong = [];
  page.bytes = {};
  page.on(
    'console',
    m =>
      ['error', 'warning'].includes(m.type()) &&
      !/GPU stall|GL Driver|swiftshader/i.test(m.text()) &&
      page.wrong.push(m.text()),
  );
  page.on('pageerror', e => page.wrong.push(String(e)));
  page.on(
    'response',
    r => (page.bytes[new URL(r.url()).pathname] = Number(r.headers()['content-length'])),
  );
  for (const act of ['move', 'click']) {
    // dblclick() is click()
    const inPage = page.mouse[act].bind(page.mouse);
    page.mouse[act] = async (x, y, more) => {
      const left = await page.evaluate(
        () => document.getElementById('canvas').getBoundingClientRect().left,
      );
      await inPage(left + x, y, more);
    };
  }
  if (options.init) await page.addInitScript(options.init);
  await page.goto(url);
  return page;
}
export const close = page => page.context().close();

// Until the mesh is the answer to what the camera asks for.
export async function exact(page) {
  await page.waitForFunction(
    () =>
      window.viewer &&
      ['exact', 'short'].includes(viewer.scene.exactness().kind) &&
      !viewer.handles.dragging,
  );
  // It stays so for some frames: nothing else was under way.
  await page.evaluate(
    () =>
      new Promise(done => {
        let frames = 0;
        const look = () => (
          ['exact', 'short'].includes(viewer.scene.exactness().kind) ? ++frames : (frames = 0),
          frames > 5 ? done() : requestAnimationFrame(look)
        );
        look();
      }),
  );
}

export const quantile = (list, q) =>
  [...list].sort((a, b) => a - b)[Math.min(list.length - 1, Math.floor(q * list.length))] ?? 0;

// Milliseconds of processor time of tasks of the page's thread, those below a millisecond aside.
export async function tasksDuring(page, act) {
  await browser.startTracing(page, {
    categories: ['toplevel', 'disabled-by-default-devtools.timeline', '__metadata'],
  });
  const result = await act();
  const {traceEvents: events} = JSON.parse((await browser.stopTracing()).toString());
  // The page's process has the most tasks on a thread of that name.
  const mains = events
      .filter(e => e.name === 'thread_name' && e.args.name === 'CrRendererMain')
      .map(e => `${e.pid} ${e.tid}`),
    times = {};
  for (const e of events)
    if (e.name === 'RunTask' && mains.includes(`${e.pid} ${e.tid}`))
      (times[`${e.pid} ${e.tid}`] ??= []).push((e.tdur ?? e.dur) / 1000);
  const tasks = Object.values(times).sort((a, b) => b.length - a.length)[0] ?? [];
  return {...result, tasks: tasks.filter(t => t >= 1)};
}

// Of the grid that vertices lie on; of a terrain, samples and steps of height.
export const stepsOf = info =>
  info.raster
    ? [Math.abs(info.raster.geotransform[1]), Math.abs(info.raster.geotransform[5]), info.step]
    : [info.step, info.step, info.step];

// Triangles as texts of grid coordinates, each beginning with its smallest corner, sorted.
function normalized(corners, info) {
  const {min} = info.bounds,
    steps = stepsOf(info);
  const texts = [];
  for (let t = 0; t < corners.length; t += 9) {
    const points = [0, 3, 6].map(c =>
      [0, 1, 2].map(k => Math.round((corners[t + c + k] - min[k]) / steps[k])).join(' '),
    );
    const first = points.indexOf([...points].sort()[0]);
    texts.push(`${points[first]},${points[(first + 1) % 3]},${points[(first + 2) % 3]}`);
  }
  return texts.sort();
}

export async function trianglesOnScreen(page, name, info) {
  const base64 = await page.evaluate(async object => {
    const bytes = new Uint8Array(viewer.scene.objects.get(object).mesh.readTriangles().buffer);
    let text = '';
    for (let i = 0; i < bytes.length; i += 32768)
      text += String.fromCharCode(...bytes.subarray(i, i + 32768));
    return btoa(text);
  }, name);
  const bytes = Buffer.from(base64, 'base64');
  return normalized(new Float64Array(bytes.buffer, bytes.byteOffset, bytes.length / 8), info);
}

// A binary PLY file of mtdb: float or double positions first, lists of three ints.
export function trianglesOfPly(path, info) {
  const bytes = readFileSync(path);
  const end = bytes.indexOf('end_header\n') + 11;
  const sizes = {float: 4, double: 8, uchar: 1, char: 1, short: 2, ushort: 2, int: 4, uint: 4};
  let vertices = 0,
    faces = 0,
    row = 0,
    element = '',
    wide = false;
  for (const line of bytes.subarray(0, end).toString('latin1').split('\n')) {
    const words = line.split(' ');
    if (words[0] === 'element') {
      element = words[1];
      if (element === 'vertex') vertices = Number(words[2]);
      else faces = Number(words[2]);
    } else if (words[0] === 'property' && element === 'vertex') {
      if (words[2] === 'x') wide = words[1] === 'double';
      row += sizes[words[1]];
    }
  }
  const corners = new Float64Array(9 * faces);
  for (let f = 0, at = end + row * vertices; f < faces; ++f, at += 13) {
    for (let c = 0; c < 3; ++c) {
      const vertex = end + row * bytes.readUInt32LE(at + 1 + 4 * c);
      for (let k = 0; k < 3; ++k)
        corners[9 * f + 3 * c + k] = wide
          ? bytes.readDoubleLE(vertex + 8 * k)
          : bytes.readFloatLE(vertex + 4 * k);
    }
  }
  return normalized(corners, info);
}

// What `mtdb extract` gives for the query that the page has asked last.
export async function extracted(page, store, name, info) {
  const query = await page.evaluate(object => viewer.scene.objects.get(object).wanted, name);
  writeFileSync(file('query.json'), JSON.stringify(query));
  run(
    'extract',
    store,
    file('extracted.ply'),
    '--name',
    name,
    '--query',
    file('query.json'),
    '--double-positions',
  );
  return trianglesOfPly(file('extracted.ply'), info);
}

export function same(a, b, what) {
  check(
    a.length === b.length,
    `${what}: ${a.length} triangles on the screen, ${b.length} expected`,
  );
  check(a.length > 0, `${what}: no triangles`);
  for (let i = 0; i < a.length; ++i)
    check(a[i] === b[i], `${what}: ${a[i]} on the screen, ${b[i]} expected`);
}

// Pictures (PNG) as {width, height, data}, decoded by the browser.
export async function decode(png) {
  const page = await (await browser.newContext()).newPage();
  const result = await page.evaluate(async base64 => {
    const image = new Image();
    image.src = 'data:image/png;base64,' + base64;
    await image.decode();
    const canvas = document.createElement('canvas');
    [canvas.width, canvas.height] = [image.width, image.height];
    const context = canvas.getContext('2d');
    context.drawImage(image, 0, 0);
    const data = context.getImageData(0, 0, image.width, image.height).data;
    let text = '';
    for (let i = 0; i < data.length; i += 32768)
      text += String.fromCharCode(...data.subarray(i, i + 32768));
    return {width: image.width, height: image.height, data: btoa(text)};
  }, png.toString('base64'));
  await close(page);
  return {...result, data: Buffer.from(result.data, 'base64')};
}
