// SPDX-License-Identifier: Apache-2.0
// What the tests in Chromium share: a web server that gives parts of files, a tab that keeps what was
// said, and pictures.
import {execFileSync, spawn} from 'node:child_process';
import {existsSync, mkdirSync, readFileSync, writeFileSync} from 'node:fs';
import {createServer} from 'node:http';
import {dirname, join} from 'node:path';
import {fileURLToPath} from 'node:url';
import {chromium} from 'playwright-core';
import {PNG} from 'pngjs';

export const [mtdb, folder, pictures] = process.argv.slice(2);
export const packages = join(dirname(fileURLToPath(import.meta.url)), 'node_modules');
export const run = (...args) => execFileSync(mtdb, args, {cwd: folder, stdio: ['ignore', 'pipe', 'inherit']});
const types = {html: 'text/html', js: 'text/javascript', mjs: 'text/javascript', json: 'application/json', css: 'text/css', wasm: 'application/wasm', png: 'image/png'};

// `mounts`: paths of URLs and the folders or files behind them. What was asked for: {path, range}.
export async function serve(page, mounts) {
  const missing = [], asked = [];
  const server = createServer((request, response) => {
    const path = new URL(request.url, 'http://x').pathname;
    if (path === '/') return response.writeHead(200, {'Content-Type': 'text/html'}).end(page);
    const mount = Object.keys(mounts).find(m => path.startsWith(m));
    const file = mount ? join(mounts[mount], path.slice(mount.length)) : join(folder, path);
    asked.push({path, range: request.headers.range});
    if (!existsSync(file)) {
      missing.push(path);
      return response.writeHead(404).end();
    }
    let bytes = readFileSync(file);
    const headers = {'Content-Type': types[file.split('.').pop()] ?? 'application/octet-stream', 'Accept-Ranges': 'bytes'};
    const range = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range ?? '');
    if (range) {
      const [begin, end] = [Number(range[1]), Math.min(Number(range[2]), bytes.length - 1)];
      headers['Content-Range'] = `bytes ${begin}-${end}/${bytes.length}`;
      bytes = bytes.subarray(begin, end + 1);
    }
    response.writeHead(range ? 206 : 200, headers).end(bytes);
  });
  await new Promise(done => server.listen(0, '127.0.0.1', done));
  return {url: `http://127.0.0.1:${server.address().port}`, missing, asked, close: () => server.close()};
}

// `mtdb serve` of a store in the folder, whose tiles pages of `origin` may read.
export async function serveTiles(store, origin) {
  const child = spawn(mtdb, ['serve', store, '--listen', '0', '--allowed-origin', origin], {cwd: folder, stdio: ['ignore', 'pipe', 'inherit']});
  const url = await new Promise(done => child.stdout.once('data', data => done(String(data).trim())));
  return {url, stop: () => child.kill()};
}

export const launch = () => chromium.launch({executablePath: '/usr/bin/chromium', timeout: 120000,
  args: ['--headless', '--no-sandbox', '--use-angle=swiftshader', '--use-gl=angle', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist']});

// A tab, and the errors that its console and its page told.
export async function open(browser, url, viewport = {width: 640, height: 480}) {
  const tab = await browser.newPage({viewport});
  const said = [];
  tab.on('console', message => { if (message.type() === 'error') said.push(message.text()); });
  tab.on('pageerror', error => said.push(error.message));
  await tab.goto(url);
  return {tab, said};
}

export async function picture(tab, name) {
  const bytes = await tab.screenshot();
  if (pictures) {
    mkdirSync(pictures, {recursive: true});
    writeFileSync(join(pictures, name + '.png'), bytes);
  }
  return PNG.sync.read(bytes);
}

// Pixels of magenta, and those of them that no way along magenta joins with the top.
export function countBackground({width, height, data}) {
  const isBackground = i => data[4 * i] > 250 && data[4 * i + 1] < 5 && data[4 * i + 2] > 250;
  const reached = new Uint8Array(width * height), stack = [];
  const visit = i => {
    if (reached[i] || !isBackground(i)) return;
    reached[i] = 1;
    stack.push(i);
  };
  for (let i = 0; i < width * height / 3; ++i) visit(i);
  while (stack.length > 0) {
    const i = stack.pop(), x = i % width;
    if (x > 0) visit(i - 1);
    if (x + 1 < width) visit(i + 1);
    if (i >= width) visit(i - width);
    if (i + width < width * height) visit(i + width);
  }
  let background = 0, cracks = 0;
  for (let i = 0; i < width * height; ++i) {
    background += isBackground(i) ? 1 : 0;
    cracks += isBackground(i) && !reached[i] ? 1 : 0;
  }
  return {background, cracks, pixels: width * height};
}
