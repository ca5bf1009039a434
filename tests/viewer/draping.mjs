// SPDX-License-Identifier: Apache-2.0
// Images over the surface: where they lie, how they are given, and what is refused.
import {mkdirSync, readFileSync, writeFileSync} from 'node:fs';
import {png} from './png.mjs';
import {at, kName, picture, server, store, surfaceUnder, test} from './scene.mjs';
import {
  check,
  close,
  decode,
  exact,
  file,
  open,
  run,
  serveFolder,
  start,
  until,
} from './testing.mjs';

const kHues = [
  [255, 0, 0],
  [255, 255, 0],
  [0, 255, 0],
  [0, 255, 255],
  [0, 0, 255],
  [255, 0, 255],
];
// No two cells beside each other have one colour, and no shift or turn maps the pattern to itself.
const hueOf = (i, j) => (7 * i * i + 3 * j + i * j) % 6;

const clear = (i, j) => i === 3 && j > 0; // cells that are transparent
// `numbers` as in a world file; cells of `cell` pixels a side. Returns what is to be compared.
function writeImage(name, numbers, columns, rows, cell, folder = file('')) {
  const pixel = (x, y) => {
    const i = Math.floor(x / cell),
      j = Math.floor(y / cell);
    return [...kHues[hueOf(i, j)], cell > 1 && clear(i, j) ? 0 : 255];
  };
  writeFileSync(`${folder}/${name}.png`, png(columns, rows, pixel));
  writeFileSync(`${folder}/${name}.pgw`, numbers.join('\n') + '\n');
  return {numbers, columns, rows, cell, files: [`${folder}/${name}.png`, `${folder}/${name}.pgw`]};
}

const hue = ([r, g, b]) => {
  const most = Math.max(r, g, b),
    range = most - Math.min(r, g, b);
  if (range < 40) return null;
  const sector =
    most === r ? ((g - b) / range + 6) % 6 : most === g ? (b - r) / range + 2 : (r - g) / range + 4;
  return sector;
};

const differing = (a, b) => {
  let n = 0;
  for (let i = 0; i < a.data.length; i += 4)
    if ([0, 1, 2].some(k => Math.abs(a.data[i + k] - b.data[i + k]) > 16)) ++n;
  return n;
};

// All over the picture: the hue of the cell that the world file puts there; where there is none,
// what is shown without the image. A pixel at a ridge may show two cells at once.
async function compare(page, image, before, {margin = 0.14, spared = 0.003} = {}) {
  const now = await picture(page),
    [places, hits] = await surfaceUnder(page, 17, 13);
  const [a, d, b, e, c, f] = image.numbers,
    found = {over: 0, beside: 0, wrong: 0},
    wrong = [];
  hits.forEach((point, n) => {
    if (!point) return;
    const dx = point[0] - c,
      dy = point[1] - f,
      determinant = a * e - b * d;
    const column = (e * dx - b * dy) / determinant + 0.5,
      row = (a * dy - d * dx) / determinant + 0.5; // from the image's corner
    const u = column / image.cell,
      v = row / image.cell,
      i = Math.floor(u),
      j = Math.floor(v);
    if ([u, v].some(w => Math.abs(w - Math.round(w)) < margin)) return;
    const shown = at(now, ...places[n]),
      inside = column > 0 && row > 0 && column < image.columns && row < image.rows;
    let right;
    if (inside && !(image.cell > 1 && clear(i, j))) {
      const off = hue(shown) === null ? 3 : Math.abs(((hue(shown) - hueOf(i, j) + 9) % 6) - 3);
      right = off < 0.4;
      ++found.over;
    } else {
      right = !before || at(before, ...places[n]).every((x, k) => Math.abs(x - shown[k]) < 12);
      ++found.beside;
    }
    if (!right) wrong.push(`at ${places[n]}, cell ${i} ${j}${inside ? '' : ' (beside)'}: ${shown}`);
  });
  check(
    wrong.length <= spared * (found.over + found.beside),
    `${wrong.length} of ${found.over + found.beside} places are wrong: ${wrong.slice(0, 4).join('; ')}`,
  );
  check(found.over > 60, `only ${found.over} places of the picture show the image`);
  return found;
}

const shown = page => page.evaluate(() => viewer.images.draping?.image?.name ?? '');
const choose = async (page, image) => {
  await page.setInputFiles('#drape-files', image.files);
  const name = image.files[0].split('/').at(-1);
  await until(async () => (await shown(page)) === name, `${name} is shown`, 60);
};
const banner = page => page.textContent('#banner');

// A turned image over a part of the surface, in UTM coordinates, which single precision has in
// steps of half a metre.
const turned = writeImage('turned', [0.62, -0.19, -0.23, -0.58, 500012.3, 5400051.7], 60, 48, 6);
// Pixels of a quarter of a metre, whose middle single precision does not have.
const fine = writeImage('fine', [0.25, 0, 0, -0.25, 500000.255, 5400060.065], 240, 240, 1);
const step = 0.05 / 96;
export const imageOverDegrees = writeImage(
  'degrees',
  [step, 0, 0, -step, -122.25 + 7.3 * step, 46.05 - 9.1 * step],
  72,
  80,
  8,
);

for (const way of ['thick', 'thin'])
  test(`an image lies where its world file says, at every level of detail (${way})`, async () => {
    const page = await open(`${server.url}/?way=${way}#o=utm`);
    await exact(page);
    const before = await picture(page);
    await choose(page, turned);
    const found = await compare(page, turned, before);
    check(found.beside > 40, `only ${found.beside} places lie beside the image`);
    check(
      /“turned.png”, 60 × 48 pixels\.$/.test(await page.textContent('#drape-said')),
      await page.textContent('#drape-said'),
    );
    const triangles = () => page.evaluate(() => viewer.scene.total(o => o.mesh.triangles)),
      fineTriangles = await triangles();
    await page.evaluate(() => ((viewer.scene.pixels = 12), viewer.scene.restart()));
    await exact(page);
    check((await triangles()) < 0.5 * fineTriangles, 'the mesh is coarser');
    await compare(page, turned, null, {spared: 0.04}); // the surface moved by up to 12 pixels
    await page.evaluate(() => ((viewer.scene.pixels = 0.5), viewer.scene.restart()));
    await compare(page, turned, null);
    // Close by, from above.
    await choose(page, fine);
    await page.evaluate(() =>
      viewer.navigation.set([500031, 5400024.9, 314], [500031, 5400025, 300], false),
    );
    await compare(page, fine, null, {margin: 0.38});
    check(page.wrong.length === 0, page.wrong.join('; '));
    await close(page);
  });

for (const way of ['thick', 'thin'])
  test(`a terrain in degrees has its image in degrees, beside its usual colours (${way})`, async () => {
    const page = await open(`${server.url}/?way=${way}#o=degrees`);
    await exact(page);
    await page.evaluate(() => viewer.look.restyle({back: 'same'}));
    const before = await picture(page);
    await choose(page, imageOverDegrees);
    const found = await compare(page, imageOverDegrees, before);
    check(
      found.beside > 60,
      `only ${found.beside} places lie beside the image, or under what is transparent`,
    );
    // With other colours beside it, flat, and with values of triangles.
    for (const colour of way === 'thick' ? ['steepness', 'cluster'] : ['permitted']) {
      await page.click('#undrape');
      await page.evaluate(c => viewer.look.restyle({colour: c, shading: 'flat'}), colour);
      await exact(page);
      if (colour === 'cluster')
        await until(
          () => page.evaluate(() => viewer.scene.objects.get('degrees').mesh.readValues() !== null),
          'the clusters are there',
        );
      const other = await picture(page);
      await choose(page, imageOverDegrees);
      await compare(page, imageOverDegrees, other);
    }
    await page.evaluate(() => viewer.look.restyle({wireframe: true}));
    await compare(page, imageOverDegrees, null, {spared: 0.35}); // edges are over it
    check(page.wrong.length === 0, page.wrong.join('; '));
    await close(page);
  });

test('without the image all is as before; so it is when the graphics card was reset', async () => {
  const page = await open(`${server.url}/#o=degrees`);
  await exact(page);
  const before = await picture(page);
  check(await page.isHidden('#undrape'), 'there is no image to take away');
  await choose(page, imageOverDegrees);
  const over = await picture(page);
  check(differing(before, over) > 50000, `${differing(before, over)} pixels show the image`);
  await page.evaluate(async () => {
    const lose = viewer.renderer.getContext().getExtension('WEBGL_lose_context');
    const event = name =>
      new Promise(done => viewer.canvas.addEventListener(name, done, {once: true}));
    const lost = event('webglcontextlost');
    lose.loseContext();
    await lost;
    await new Promise(done => setTimeout(done, 50));
    const restored = event('webglcontextrestored');
    lose.restoreContext();
    await restored;
  });
  const again = await picture(page);
  check(
    differing(over, again) < 50,
    `${differing(over, again)} pixels are others after the card was reset`,
  );
  await page.click('#undrape');
  check(differing(before, await picture(page)) < 50, 'the image is gone');
  check(
    (await page.isHidden('#undrape')) &&
      /choose both at once/.test(await page.textContent('#drape-said')),
    await page.textContent('#drape-said'),
  );
  check(
    page.wrong.every(text => /context/i.test(text)),
    page.wrong.join('; '),
  );
  await close(page);
});

test('an image that cannot be shown is refused in a sentence, and the one that was there stays', async () => {
  const page = await open(`${server.url}/#o=utm`);
  await exact(page);
  await choose(page, turned);
  const mine = (name, text) => (writeFileSync(file(name), text), file(name));
  const refused = async (files, ...words) => {
    await page.setInputFiles('#drape-files', files);
    await until(
      async () => {
        const text = await banner(page);
        return words.every(word => word.test(text));
      },
      `it is said that ${words.join(' ')}; it was “${await banner(page)}”`,
      20,
    );
    check((await shown(page)) === 'turned.png', 'the image before stays');
    await page.evaluate(() => viewer.say(''));
  };
  const image = mine('lonely.png', readFileSync(turned.files[0]));
  await refused(
    [image],
    /“lonely\.png” has no place/,
    /Choose or drop it, too; its name ends in \.pgw, \.pngw or \.wld\. Of a GeoTIFF/,
    /gdal_translate -of PNG -co WORLDFILE=YES in\.tif out\.png/,
  );
  await refused(
    [mine('photo.tif', 'II*')],
    /“photo\.tif”: browsers do not show TIFF/,
    /gdal_translate/,
  );
  await refused([image, turned.files[0]], /There are 2 images/);
  await refused([mine('notes.txt', 'notes')], /“notes\.txt” is no image/);
  await refused([mine('other.wld', '1')], /“other\.wld” says where an image lies/);
  const world = (...numbers) => [image, mine('lonely.pgw', numbers.join('\n'))];
  await refused(world(1, 0, 0, -1, 5), /“lonely\.pgw” has 5 numbers/);
  await refused(world(), /“lonely\.pgw” has 0 numbers/);
  await refused(world(1, 0, 0, -1, 5, 6, 7), /has 7 numbers/);
  await refused(
    world('0,5', 0, 0, -1, 5, 6),
    /number 1 is “0,5”\. A world file has six numbers, one a line, with points/,
  );
  await refused(world(1, 0, 0, 'NaN', 5, 6), /number 4 is “NaN”/);
  await refused(world(1, 0, 0, '1e999', 5, 6), /number 4 is “1e999”/);
  await refused(world(1, 2, 2, 4, 5, 6), /“lonely\.pgw” places the image on a line/);
  await refused(world(0, 0, 0, 0, 500000, 5400000), /on a line or a point/);
  await refused(
    world(1, 0, 0, -1, 1000, 2000),
    /“lonely\.png” lies elsewhere than “utm”: it covers x 999\.5 to 1059\.5, y 1952\.5 to 2000\.5, and what is shown x 500000 to 500059/,
    /gdalwarp/,
  );
  // Its bounding box meets the object; it does not.
  await refused(world(0.7, 0.7, 0.7, -0.7, 499936, 5400069), /lies elsewhere/);
  await refused(world(1e-9, 0, 0, -1e-9, 500020, 5400030), /less than a millionth/);
  await refused(
    [
      mine('broken.png', readFileSync(image).subarray(0, 60)),
      mine('broken.pgw', turned.numbers.join(' ')),
    ],
    /“broken\.png” cannot be shown as an image/,
  );
  await refused(
    [mine('text.png', 'no image'), mine('text.pgw', turned.numbers.join(' '))],
    /“text\.png” cannot be shown/,
  );
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('an image is dropped, its world file may come after it, and JPEG and WebP are shown', async () => {
  const page = await open(`${server.url}/#o=utm`);
  await exact(page);
  const before = await picture(page);
  const drop = files =>
    page.evaluate(list => {
      const data = new DataTransfer();
      for (const [name, type, base64] of list)
        data.items.add(
          new File([Uint8Array.from(atob(base64), c => c.charCodeAt(0))], name, {type}),
        );
      for (const kind of ['dragover', 'drop']) {
        document
          .getElementById('canvas')
          .dispatchEvent(
            new DragEvent(kind, {dataTransfer: data, bubbles: true, cancelable: true}),
          );
        if (document.body.classList.contains('dropping') !== (kind === 'dragover'))
          throw new Error('the page shows where to drop');
      }
    }, files);
  const base64 = path => readFileSync(path).toString('base64');
  await drop([['dropped.png', 'image/png', base64(turned.files[0])]]);
  await until(
    async () => /Choose or drop it, too/.test(await banner(page)),
    'the world file is asked for',
    60,
  );
  await drop([['dropped.PGW', '', base64(turned.files[1])]]);
  await until(async () => (await shown(page)) === 'dropped.png', 'the image is shown', 60);
  await compare(page, turned, before);
  // The same pixels as a photo that was held upright: its world file counts the pixels of the file.
  for (const kind of ['jpeg', 'webp']) {
    const other = await page.evaluate(
      async ([source, type]) => {
        const image = new Image(),
          canvas = document.createElement('canvas'),
          context = canvas.getContext('2d');
        image.src = 'data:image/png;base64,' + source;
        await image.decode();
        [canvas.width, canvas.height] = [image.width * 4, image.height * 4];
        context.imageSmoothingEnabled = false;
        context.drawImage(image, 0, 0, canvas.width, canvas.height);
        return canvas.toDataURL(type, 0.95).split(',')[1];
      },
      [base64(turned.files[0]), `image/${kind}`],
    );
    let bytes = Buffer.from(other, 'base64');
    if (kind === 'jpeg')
      bytes = Buffer.concat([
        bytes.subarray(0, 2),
        Buffer.from(
          'ffe100224578696600004d4d002a00000008000101120003000000010006000000000000',
          'hex',
        ),
        bytes.subarray(2),
      ]);
    const [a, d, b, e, c, f] = turned.numbers,
      part = n => n / 4,
      off = (p, q) => -0.375 * (p + q);
    const suffix = kind === 'jpeg' ? 'jgw' : 'wld';
    const four = {
      ...turned,
      numbers: [part(a), part(d), part(b), part(e), c + off(a, b), f + off(d, e)],
      columns: 240,
      rows: 192,
      cell: 24,
      files: [file(`photo.${kind}`), file(`photo.${suffix}`)],
    };
    writeFileSync(four.files[0], bytes);
    writeFileSync(four.files[1], four.numbers.join('\r\n'));
    await choose(page, four);
    const size = await page.evaluate(() => [
      viewer.images.draping.image.columns,
      viewer.images.draping.image.rows,
    ]);
    check(size.join() === '240,192', `${kind}: ${size}`);
    // JPEG has no transparency: black.
    await compare(page, four, kind === 'webp' ? before : null);
  }
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('an image larger than a texture is shown smaller, where it lies, and the page says so', async () => {
  const page = await open(`${server.url}/#o=utm`);
  await exact(page);
  const columns = 9000,
    cell = 1500,
    world = [60 / columns, 0, 0, -60 / 4, 500000 + 30 / columns, 5400060 - 7.5];
  writeFileSync(
    file('wide.png'),
    png(columns, 4, x => [...kHues[hueOf(Math.floor(x / cell), 0)], 255]),
  );
  writeFileSync(file('wide.pgw'), world.join('\n'));
  await page.setInputFiles('#drape-files', [file('wide.png'), file('wide.pgw')]);
  await until(async () => (await shown(page)) === 'wide.png', 'it is shown', 60);
  check(
    /“wide\.png” is shown with 8,192 × 4 of its 9,000 × 4 pixels; a page shows at most 8,192 each way/.test(
      await banner(page),
    ),
    await banner(page),
  );
  await page.evaluate(() => viewer.navigation.view('top', false));
  const now = await picture(page);
  for (let i = 0; i < 6; ++i) {
    const point = [500000 + 10 * i + 5, 5400030, 300];
    const [x, y] = await page.evaluate(async p => {
      const hit = await viewer.store.probe('utm', [p[0], p[1], 400], [0, 0, -1]);
      const s = viewer.navigation.toScene(hit.point).project(viewer.navigation.camera);
      return [Math.round((s.x + 1) * 400), Math.round((1 - s.y) * 300)];
    }, point);
    const off = Math.abs(((hue(at(now, x, y)) - hueOf(i, 0) + 9) % 6) - 3);
    check(off < 0.4, `column ${i}: ${at(now, x, y)}`);
  }
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('an image stays while objects change, and lies over all that it meets', async () => {
  const page = await open(`${server.url}/#o=utm`);
  await exact(page);
  await choose(page, turned);
  const draped = () =>
    page.evaluate(() =>
      [...viewer.scene.objects]
        .filter(([, o]) => o.mesh.own.draped.value)
        .map(([name]) => name)
        .join(),
    );
  const turn = async (name, on) => {
    await page.locator('#objects label').filter({hasText: name}).locator('input').setChecked(on);
    await until(
      () => page.evaluate(([n, yes]) => viewer.scene.objects.has(n) === yes, [name, on]),
      'the object is on or off',
    );
    await page.waitForFunction(
      () => viewer.scene.objects.size === 0 || viewer.scene.exactness().kind !== 'loading',
    );
  };
  check((await draped()) === 'utm', await draped());
  await turn(kName, true);
  check(
    (await draped()) === 'utm' &&
      /It lies over “utm”\./.test(await page.textContent('#drape-said')),
    await page.textContent('#drape-said'),
  );
  await turn('utm', false);
  check(
    (await draped()) === '' &&
      /lies elsewhere than what is shown now/.test(await page.textContent('#drape-said')),
    await page.textContent('#drape-said'),
  );
  await turn('utm', true);
  check((await draped()) === 'utm', 'it is there again');
  await turn(kName, false);
  await page.selectOption('#way', 'thin');
  await page.evaluate(() => viewer.navigation.view('home', false));
  await exact(page);
  await compare(page, turned, null);
  check(page.wrong.length === 0, page.wrong.join('; '));
  await close(page);
});

test('?drape= shows an image of the web server, and says what is not there', async () => {
  const www = file('drape-www');
  run('view', '--write-page', www);
  run('pack', store, `${www}/scan.mtdbp`, '--name', 'utm', '--name', 'degrees', '--name', kName);
  mkdirSync(`${www}/photos`);
  const image = writeImage(
    'a photo',
    imageOverDegrees.numbers,
    imageOverDegrees.columns,
    imageOverDegrees.rows,
    imageOverDegrees.cell,
    `${www}/photos`,
  );
  writeFileSync(`${www}/photos/alone.png`, readFileSync(image.files[0]));
  writeFileSync(`${www}/photos/odd.png`, readFileSync(image.files[0]));
  writeFileSync(`${www}/photos/odd.wld`, 'a b c');
  const web = await serveFolder(www),
    at = `${web.url}/index.html?src=scan.mtdbp`;
  const page = await open(`${at}&drape=photos/a%20photo.png#o=degrees`);
  await until(async () => (await shown(page)) === 'a photo.png', 'the image is shown', 60);
  await exact(page);
  await compare(page, image, null);
  await page.evaluate(() => viewer.saveView());
  check(new URL(page.url()).searchParams.get('drape') === 'photos/a photo.png', page.url());
  check(page.wrong.length === 0, page.wrong.join('; '));
  // What the user takes away does not come back with the address.
  await page.click('#undrape');
  check(!new URL(page.url()).searchParams.has('drape') && (await shown(page)) === '', page.url());
  await close(page);
  const said = async (search, words, object = 'degrees') => {
    const other = await open(`${at}${search}#o=${object}`);
    await until(
      async () => words.test(await banner(other)),
      `the page says ${words}; it says “${await banner(other)}”`,
      60,
    );
    check(
      other.wrong.every(text => /404|Failed to load/.test(text)),
      other.wrong.join('; '),
    );
    return other;
  };
  await close(
    await said(
      '&drape=photos/none.png',
      /There is no image “none\.png” on the server of this page/,
    ),
  );
  await close(
    await said(
      '&drape=photos/alone.png',
      /“alone\.png” has no place.*as alone\.pgw, alone\.pngw or alone\.wld.*gdal_translate/,
    ),
  );
  await close(await said('&drape=photos/odd.png', /“odd\.wld”: number 1 is “a”/));
  await close(
    await said('&drape=https://elsewhere.example/photo.png', /files of its own server only/),
  );
  await close(await said('&drape=viewer.css', /viewer\.css/));
  // Where it lies it shows, when one gets there.
  const elsewhere = await said(
    '&drape=photos/a%20photo.png',
    /“a photo\.png” lies elsewhere than “sculpture”/,
    kName,
  );
  await elsewhere.evaluate(() => (location.hash = '#o=degrees'));
  await until(
    () => elsewhere.evaluate(() => viewer.scene.objects.get('degrees')?.mesh.own.draped.value),
    'it is shown over another object',
    60,
  );
  await exact(elsewhere);
  await compare(elsewhere, image, null);
  await close(elsewhere);
  await web.stop();
  // mtdb serve has no other files than the page's.
  const other = await open(`${server.url}/?drape=photo.png#o=degrees`);
  await until(
    async () => /There is no image “photo\.png”/.test(await banner(other)),
    'mtdb serve has no images',
    60,
  );
  await close(other);
});

for (const way of ['thick', 'thin'])
  test(`mtdb view --drape shows the image (${way})`, async () => {
    const own = await start('view', store, '--no-browser', '--drape', turned.files[0]);
    const page = await open(`${own.url}&way=${way}#o=utm`);
    await until(async () => (await shown(page)) === 'drape.png', 'the image is shown', 60);
    await exact(page);
    await compare(page, turned, null);
    check((await page.evaluate(() => viewer.loading.way)) === way, 'the way');
    check(page.wrong.length === 0, page.wrong.join('; '));
    await close(page);
    await own.stop('SIGTERM');
  });
