// SPDX-License-Identifier: Apache-2.0
// How much the picture at rest looks like one of the whole mesh: the mean SSIM of luminance over
// windows of 8 x 8 pixels that lie in the silhouette of both, 900 x 700 pixels, as the page frames
// the object, with the light from the eye. MTDB_BINARY and MTDB_VIEWER_BUILD as for the tests.
//   node tests/viewer/likeness.mjs STORE [--name OBJECT] [--pixels 1,0.5,0.25] [--way thin]
//   node tests/viewer/likeness.mjs sculpture TRIANGLES [...]       of `mtdb generate sculpture`
// The first row is what the page shows by default; --pixels adds rows for errors in pixels. Prints
// JSON, a line each.
import {pathToFileURL} from 'node:url';
import {close, exact, file, launch, open, run, runJson, serve} from './testing.mjs';

const kWidth = 900,
  kHeight = 700,
  kPanel = 286;

// In the page. Keeps the picture's luminance, and -1 where there is only background, under `name`.
function keep(name) {
  viewer.draw();
  const {width, height} = viewer.canvas,
    gl = viewer.renderer.getContext(),
    rgba = new Uint8Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
  const ground = rgba.slice(0, 3),
    kept = new Float32Array(width * height);
  for (let i = 0; i < kept.length; ++i) {
    const [r, g, b] = rgba.subarray(4 * i, 4 * i + 3),
      empty = r === ground[0] && g === ground[1] && b === ground[2];
    kept[i] = empty ? -1 : 0.299 * r + 0.587 * g + 0.114 * b;
  }
  (window.kept ??= {})[name] = {width, height, kept};
}

// In the page: {ssim, windows}.
function compare(one, other) {
  const {width, height, kept: a} = window.kept[one],
    {kept: b} = window.kept[other],
    c1 = (0.01 * 255) ** 2,
    c2 = (0.03 * 255) ** 2;
  let sum = 0,
    windows = 0;
  for (let y = 0; y + 8 <= height; y += 4)
    for (let x = 0; x + 8 <= width; x += 4) {
      let sa = 0,
        sb = 0,
        saa = 0,
        sbb = 0,
        sab = 0,
        inside = true;
      for (let v = y; v < y + 8 && inside; ++v)
        for (let u = x; u < x + 8; ++u) {
          const p = a[v * width + u],
            q = b[v * width + u];
          if (p < 0 || q < 0) {
            inside = false;
            break;
          }
          ((sa += p), (sb += q), (saa += p * p), (sbb += q * q), (sab += p * q));
        }
      if (!inside) continue;
      const ma = sa / 64,
        mb = sb / 64,
        va = saa / 64 - ma * ma,
        vb = sbb / 64 - mb * mb,
        cov = sab / 64 - ma * mb;
      sum += ((2 * ma * mb + c1) * (2 * cov + c2)) / ((ma * ma + mb * mb + c1) * (va + vb + c2));
      ++windows;
    }
  return {ssim: sum / windows, windows};
}

// {triangles, whole, ssim, ...} of each error in `pixels`; null: the default. `url`: of a page, up
// to its hash.
export async function likeness(url, name, pixels = [null]) {
  const page = await open(`${url}#o=${encodeURIComponent(name)}`, {
    viewport: {width: kWidth + kPanel, height: kHeight},
    deviceScaleFactor: 1,
  });
  await exact(page);
  const rows = [];
  for (const px of pixels) {
    await page.evaluate(p => ((viewer.scene.pixels = p), viewer.scene.restart()), px);
    await exact(page);
    const key = String(px);
    await page.evaluate(keep, key);
    rows.push({
      key,
      pixels: px,
      ...(await page.evaluate(() => ({
        triangles: viewer.scene.total(o => o.mesh.triangles),
        whole: viewer.scene.total(o => o.info.triangles),
        seconds: performance.now() / 1000,
      }))),
    });
  }
  await page.evaluate(() => {
    viewer.scene.setLimits({cacheBytes: 2 ** 31, bytesPerSecond: Infinity});
    viewer.scene.pixels = null;
    viewer.scene.budget = 2 ** 24;
    viewer.scene.restart();
  });
  await exact(page);
  await page.evaluate(keep, 'all');
  const all = await page.evaluate(() => viewer.scene.total(o => o.mesh.triangles));
  for (const row of rows)
    Object.assign(row, {
      reference: all,
      ...(await page.evaluate(`(${compare})(${JSON.stringify(row.key)}, 'all')`)),
    });
  await close(page);
  return rows.map(({key, ...row}) => row);
}

async function main([what, ...more]) {
  const option = name => (more.includes(name) ? more[more.indexOf(name) + 1] : undefined);
  if (!what || (what === 'sculpture' && !(Number(more[0]) > 0))) {
    console.error(
      'usage: node likeness.mjs STORE [--name OBJECT] [--pixels 1,0.5] [--way thin] | sculpture TRIANGLES [...]',
    );
    process.exit(2);
  }
  const store = what === 'sculpture' ? file('likeness.mtdb') : what;
  if (what === 'sculpture') {
    run('generate', 'sculpture', file('likeness.ply'), '--triangles', more[0]);
    run('ingest', file('likeness.ply'), store, '--quiet', '--name', 'sculpture');
  }
  const names = option('--name')
    ? [option('--name')]
    : runJson('list', store).objects.map(o => o.object);
  const pixels = [null, ...(option('--pixels') ?? '').split(',').filter(Boolean).map(Number)];
  const server = await serve(store),
    browser = await launch();
  for (const name of names) {
    for (const row of await likeness(
      `${server.url}/${option('--way') ? `?way=${option('--way')}` : ''}`,
      name,
      pixels,
    ))
      console.log(JSON.stringify({object: name, ...row}));
  }
  await browser.close();
  await server.stop('SIGTERM');
}

if (import.meta.url === pathToFileURL(process.argv[1] ?? '').href)
  await main(process.argv.slice(2));
