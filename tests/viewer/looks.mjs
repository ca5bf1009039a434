// SPDX-License-Identifier: Apache-2.0
// Pictures of the page to look at: three sizes, both ways, dark and light. MTDB_BINARY and
// MTDB_VIEWER_BUILD as for the tests.
//   node tests/viewer/looks.mjs FOLDER [WORD]      of those whose name has the word: SIZE-WHAT-WAY-THEME.png
import {mkdirSync, writeFileSync} from 'node:fs';
import {join} from 'node:path';
import {close, exact, launch, open, until} from './testing.mjs';
import {imageOverDegrees} from './draping.mjs';
import {box, drag, kName, kOdd, server} from './scene.mjs';

const [folder, word = ''] = process.argv.slice(2);
if (!folder) {
  console.error('usage: node looks.mjs FOLDER [WORD]');
  process.exit(2);
}
mkdirSync(folder, {recursive: true});

const sizes = {phone: [390, 844], laptop: [1366, 768], large: [1920, 1080]};
const object = (name, more = '') => `#o=${encodeURIComponent(name)}${more}`;
const openAll = page =>
  page.evaluate(() => document.querySelectorAll('details').forEach(d => (d.open = true)));
const measure = async page => {
  await page.keyboard.press('m');
  // Where the surface is, here and there.
  const places = await page.evaluate(async () => {
    const [w, h] = [viewer.canvas.clientWidth, viewer.canvas.clientHeight],
      found = [];
    for (const [x, y] of [
      [0.4, 0.3],
      [0.35, 0.5],
      [0.5, 0.62],
      [0.42, 0.75],
      [0.62, 0.4],
      [0.6, 0.7],
      [0.5, 0.45],
    ])
      if (await viewer.probe(x * w, y * h)) found.push([x * w, y * h]);
    return found.slice(0, 4);
  });
  for (const [i, [x, y]] of places.entries()) {
    await page.mouse.click(x, y);
    await until(
      () =>
        page.evaluate(
          n => viewer.measuring.lines.reduce((sum, l) => sum + l.points.length, 0) === n,
          i + 1,
        ),
      'a point is there',
      60,
    );
  }
};
const drape = async (page, files) => {
  await page.setInputFiles('#drape-files', files);
  await page.evaluate(() => {
    if (document.body.classList.contains('closed')) document.getElementById('toggle').click();
    document.getElementById('section-image').open = true;
    document.getElementById('section-image').scrollIntoView();
  });
};
// What: its link, and what is done then.
const whats = {
  list: ['', page => page.waitForSelector('#start-list button')],
  object: [object(kName)],
  closed: [object(kName), page => page.click('#toggle')],
  panel: [
    object(kName),
    async page => {
      await page.evaluate(
        () =>
          document.body.classList.contains('closed') && document.getElementById('toggle').click(),
      );
      await openAll(page);
    },
  ],
  scene: [`#o=utm&o=${encodeURIComponent(kOdd)}&colour=vertex`],
  dragger: [
    object(kName, `${box}&outside=view&px=4&wireframe=true`),
    page => drag(page, 'maxx', 20, 5),
  ],
  ball: [object(kName, '&region=sphere:0,-0.8,0.4,0.5&outside=coarse&wireframe=true')],
  section: [object(kName, '&region=half_space:0,0,0,1,0,0&outside=clip&back=cap')],
  measuring: [object(kName, '&unit=mm'), measure],
  legend: [object('utm', '&colour=a:quality')],
  error: [object(kName, '&colour=permitted')],
  terrain: [object('degrees')],
  wedge: [
    object(
      'terrain',
      '&region=wedge:5,0,1,0,50,8&inside=distance&outside=coarse&px=2&wireframe=true',
    ),
  ],
  missing: ['#o=nothing', page => page.waitForSelector('#start-list button')],
  image: [object('degrees', '&wireframe=true'), page => drape(page, imageOverDegrees.files)],
  unplaced: [object('degrees'), page => drape(page, imageOverDegrees.files.slice(0, 1))],
  keys: [object(kName), page => page.keyboard.press('?')],
};

const browser = await launch();
for (const [size, [width, height]] of Object.entries(sizes)) {
  for (const [i, [what, [link, act]]] of Object.entries(whats).entries()) {
    for (const [way, theme] of i % 2
      ? [
          ['thick', 'dark'],
          ['thin', 'light'],
        ]
      : [
          ['thick', 'light'],
          ['thin', 'dark'],
        ]) {
      const name = `${size}-${what}-${way}-${theme}`;
      if (!name.includes(word)) continue;
      const phone = size === 'phone' ? {hasTouch: true, isMobile: true, deviceScaleFactor: 2} : {};
      const page = await open(`${server.url}/?way=${way}${link}`, {
        viewport: {width, height},
        colorScheme: theme,
        ...phone,
      });
      if (link.startsWith('#o') && what !== 'missing') await exact(page);
      await act?.(page);
      if (link.startsWith('#o') && what !== 'missing') await exact(page);
      await page.waitForTimeout(400); // for what the page tells about the picture
      writeFileSync(join(folder, `${name}.png`), await page.screenshot());
      if (page.wrong.length > 0 && what !== 'missing')
        console.log(`${name}: ${page.wrong.join('; ')}`);
      await close(page);
    }
  }
}
await browser.close();
await server.stop('SIGTERM');
process.exit(0);
