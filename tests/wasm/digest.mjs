// SPDX-License-Identifier: Apache-2.0
// node digest.mjs node|chromium PROGRAM.wasm INPUT [FILE]: what the program prints that reads INPUT from its standard input, or
// as FILE. chromium: headless, by the playwright-core of $MTDB_BUILD/viewer; exit status 77 when one of them is not there.
import {existsSync, readFileSync} from 'node:fs';
import {createRequire} from 'node:module';
import {createServer} from 'node:http';
import {join, resolve} from 'node:path';
import {fileURLToPath} from 'node:url';
import {runProgram} from './run_program.mjs';

const [where, program, input, file = ''] = process.argv.slice(2), kChromium = '/usr/bin/chromium';

async function inChromium() {
  const packages = join(process.env.MTDB_BUILD ?? 'build-test', 'viewer/package.json');
  if (!existsSync(kChromium) || !existsSync(join(packages, '../node_modules/playwright-core'))) process.exit(77);
  const {chromium} = createRequire(resolve(packages))('playwright-core');
  const files = {'/': '<!doctype html>', '/run.mjs': readFileSync(fileURLToPath(new URL('run_program.mjs', import.meta.url))), '/program.wasm': readFileSync(program), '/input': readFileSync(input)};
  const kinds = {'/': 'text/html', '/run.mjs': 'text/javascript', '/program.wasm': 'application/wasm'};
  const server = createServer((request, response) => {
    const body = files[request.url];
    response.writeHead(body === undefined ? 404 : 200, {'Content-Type': kinds[request.url] ?? 'application/octet-stream'}).end(body);
  });
  await new Promise(done => server.listen(0, '127.0.0.1', done));
  const browser = await chromium.launch({executablePath: kChromium, timeout: 120000, args: ['--headless', '--no-sandbox', '--disable-gpu', '--no-first-run']});
  const page = await browser.newPage();
  await page.goto(`http://127.0.0.1:${server.address().port}/`);
  const printed = await page.evaluate(async name => {
    const {runProgram: run} = await import('/run.mjs');
    const bytes = async path => await (await fetch(path)).arrayBuffer();
    return await run(await WebAssembly.compile(await bytes('/program.wasm')), new Uint8Array(await bytes('/input')), name);
  }, file);
  await browser.close();
  server.close();
  return printed;
}

console.log(where === 'chromium' ? await inChromium() : await runProgram(await WebAssembly.compile(readFileSync(program)), readFileSync(input), file));
process.exit(0);
