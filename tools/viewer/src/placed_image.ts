// SPDX-License-Identifier: Apache-2.0
// Images with a place, from files or URLs. Refusals are Errors whose messages are sentences for the
// user.
import type {ObjectInfo} from './source';

type Pair = [number, number];

// From a point of the object's coordinates, less `middle`, its products with `across` and `down`
// are where it is in the image: from -0.5 to 0.5, from left to right and from top to bottom. So
// only differences from points nearby go to the graphics card, however large the coordinates are.
export interface Place {
  middle: Pair;
  across: Pair;
  down: Pair;
}

export interface PlacedImage {
  name: string;
  columns: number; // of the file; `bitmap` may have less
  rows: number;
  bitmap: ImageBitmap; // premultiplied
  place: Place;
}

const kTranslate = 'gdal_translate -of PNG -co WORLDFILE=YES in.tif out.png';
const kWorldFile = /\.(wld|[a-z]{2,4}w)$/i;
const kMostText = 4096; // bytes of a world file
const kLeastPart = 1e-6; // of the object, each way

const refuse = (sentence: string): never => {
  throw new Error(sentence);
};
const oneOf = (names: string[]) => names.join(', ').replace(/, ([^,]*)$/, ' or $1');
const stem = (name: string) => name.replace(/\.[^.]*$/, '').toLowerCase();
const isTiff = (name: string, type: string) => /\.tiff?$/i.test(name) || type === 'image/tiff';

function refuseTiff(name: string) {
  refuse(
    `“${name}”: browsers do not show TIFF. This makes a PNG and its world file of a GeoTIFF: ${kTranslate}`,
  );
}
function refuseUnplaced(name: string, missing: string): never {
  return refuse(
    `“${name}” has no place: ${missing}. Of a GeoTIFF, this makes image and world file: ${kTranslate}`,
  );
}

// Numbers a, d, b, e, c, f: the middle of a pixel is at x = a * column + b * row + c, y = d *
// column + e * row + f.
function numbersOf(file: string, text: string): number[] {
  const words = text
      .trim()
      .split(/\s+/)
      .filter(word => word !== ''),
    numbers = words.map(Number);
  const expected = 'A world file has six numbers, one a line, with points for decimals.';
  const odd = numbers.findIndex(n => !Number.isFinite(n));
  if (odd >= 0)
    refuse(`“${file}”: number ${odd + 1} is “${words[odd]!.slice(0, 40)}”. ${expected}`);
  if (words.length !== 6) refuse(`“${file}” has ${words.length} numbers. ${expected}`);
  return numbers;
}

function placeOf(file: string, numbers: number[], columns: number, rows: number): Place {
  const [a, d, b, e, c, f] = numbers as [number, number, number, number, number, number];
  const determinant = a * e - b * d;
  const place: Place = {
    middle: [
      a * ((columns - 1) / 2) + b * ((rows - 1) / 2) + c,
      d * ((columns - 1) / 2) + e * ((rows - 1) / 2) + f,
    ],
    across: [e / determinant / columns, -b / determinant / columns],
    down: [-d / determinant / rows, a / determinant / rows],
  };
  const flat = !(Math.abs(determinant) > 1e-9 * Math.hypot(a, d) * Math.hypot(b, e));
  if (
    flat ||
    !Object.values(place)
      .flat()
      .every(n => Number.isFinite(Math.fround(n)))
  ) {
    refuse(
      `“${file}” places the image on a line or a point: numbers 1 and 2 are the step from a column to the next one, 3 and 4 that from a row to the next one, and the two must point in different ways.`,
    );
  }
  return place;
}

// The image's corners, in the object's coordinates.
function cornersOf({middle, across, down}: Place): Pair[] {
  const determinant = across[0] * down[1] - across[1] * down[0];
  return [
    [-0.5, -0.5],
    [0.5, -0.5],
    [0.5, 0.5],
    [-0.5, 0.5],
  ].map(([u, v]) => [
    middle[0] + (u! * down[1] - v! * across[1]) / determinant,
    middle[1] + (v! * across[0] - u! * down[0]) / determinant,
  ]);
}

function extentOf(points: Pair[]): [Pair, Pair] {
  const extreme = (pick: (...n: number[]) => number): Pair => [
    pick(...points.map(p => p[0])),
    pick(...points.map(p => p[1])),
  ];
  return [extreme(Math.min), extreme(Math.max)];
}

const boxOf = ({bounds: {min, max}}: ObjectInfo): Pair[] => [
  [min[0], min[1]],
  [max[0], min[1]],
  [max[0], max[1]],
  [min[0], max[1]],
];

// Where a box is in the image.
function inImage({middle, across, down}: Place, box: Pair[]) {
  return extentOf(
    box
      .map(([x, y]) => [x - middle[0], y - middle[1]])
      .map(([x, y]) => [across[0] * x! + across[1] * y!, down[0] * x! + down[1] * y!]),
  );
}

// Whether image and object, both seen along z, have a place in common: no side of either is between
// them.
export function liesOver(place: Place, info: ObjectInfo): boolean {
  const box = boxOf(info),
    [least, most] = inImage(place, box),
    [low, high] = extentOf(cornersOf(place)),
    [min, max] = extentOf(box);
  return [0, 1].every(
    k => least[k]! < 0.5 && most[k]! > -0.5 && low[k]! < max[k]! && high[k]! > min[k]!,
  );
}

// Why none of these objects shows the image; empty when one does, or there is none.
export function whyNotOver({name, place}: PlacedImage, infos: ObjectInfo[]): string {
  const over = infos.filter(info => liesOver(place, info)),
    names = infos.map(info => `“${info.object}”`).join(', ');
  if (infos.length === 0) return '';
  if (over.length === 0) {
    const text = ([least, most]: [Pair, Pair]) =>
      ['x', 'y']
        .map(
          (axis, k) =>
            `${axis} ${Number(least[k]!.toPrecision(8))} to ${Number(most[k]!.toPrecision(8))}`,
        )
        .join(', ');
    return `“${name}” lies elsewhere than ${names}: it covers ${text(extentOf(cornersOf(place)))}, and what is shown ${text(extentOf(infos.flatMap(boxOf)))}. An image in another coordinate system is brought into this one by gdalwarp -t_srs.`;
  }
  const tiny = over.every(info => {
    const [least, most] = inImage(place, boxOf(info));
    return [0, 1].some(k => (most[k]! - least[k]!) * kLeastPart > 1);
  });
  return tiny
    ? `“${name}” covers less than a millionth of ${names}, as its world file says; are its first four numbers the size of a pixel?`
    : '';
}

function nameOf(url: URL) {
  const name = url.pathname.split('/').at(-1)!;
  try {
    return decodeURIComponent(name);
  } catch {
    return name;
  }
}

// Null: there is no such file. Some servers answer with a page of theirs then.
async function get(url: URL): Promise<Response | null> {
  const response = await fetch(url).catch(() =>
    refuse(`“${nameOf(url)}” cannot be loaded: the server of this page cannot be reached.`),
  );
  if (!response.ok && response.status !== 404 && response.status !== 410)
    refuse(
      `“${nameOf(url)}” cannot be loaded: the server answered ${response.status} ${response.statusText}.`,
    );
  return response.ok && !/html/.test(response.headers.get('Content-Type') ?? '') ? response : null;
}

// The usual suffixes of world files: of photo.png, pgw, pngw and wld.
function worldSuffixes(name: string): string[] {
  const suffix = /\.([^.]+)$/.exec(name)?.[1] ?? '',
    upper = suffix !== '' && suffix === suffix.toUpperCase();
  return [...(suffix ? [suffix[0]! + suffix.at(-1)! + 'w', suffix + 'w'] : []), 'wld'].map(s =>
    upper ? s.toUpperCase() : s,
  );
}

// A JPEG without its note of how the camera was held, by which browsers turn it: world files count
// the pixels as they are in the file.
async function unturned(image: Blob): Promise<Blob> {
  const kHead = 1 << 20,
    head = new Uint8Array(await image.slice(0, kHead).arrayBuffer());
  if (head[0] !== 0xff || head[1] !== 0xd8) return image;
  const kNotes = 0xe1,
    kPixels = 0xda; // kinds of segments
  for (
    let at = 2;
    at + 4 < head.length && head[at] === 0xff && head[at + 1] !== kPixels;
    at += 2 + 256 * head[at + 2]! + head[at + 3]!
  ) {
    if (head[at + 1] === kNotes) head[at + 4] = 0; // is no "Exif" any more
  }
  return new Blob([head, image.slice(kHead)], {type: image.type});
}

export class ImageReader {
  private waiting: File | null = null; // an image whose world file may come yet

  // `most`: columns and rows of a bitmap.
  constructor(readonly most: number) {}

  // Of what the user chose or dropped at once; a world file may also come after its image.
  async fromFiles(files: readonly File[]): Promise<PlacedImage> {
    const worlds = files.filter(file => kWorldFile.test(file.name));
    const images = files.filter(
      file => !worlds.includes(file) && (file.type.startsWith('image/') || isTiff(file.name, '')),
    );
    const image = images[0] ?? (worlds.length === 1 ? this.waiting : null);
    this.waiting = null;
    if (images.length > 1)
      refuse(`There are ${images.length} images; one at a time can lie over the surface.`);
    if (!image)
      return refuse(
        worlds[0]
          ? `“${worlds[0].name}” says where an image lies. Choose that image with it.`
          : `“${files[0]!.name}” is no image. Choose a PNG, JPEG or WebP, and its world file with it.`,
      );
    if (isTiff(image.name, image.type)) refuseTiff(image.name);
    const world =
      worlds.find(file => stem(file.name) === stem(image.name)) ??
      (worlds.length === 1 ? worlds[0]! : null);
    if (!world) {
      this.waiting = image;
      return refuseUnplaced(
        image.name,
        `its world file is missing. Choose or drop it, too; its name ends in ${oneOf(worldSuffixes(image.name).map(s => '.' + s))}`,
      );
    }
    return this.read(image.name, image, world.name, await world.slice(0, kMostText).text());
  }

  async fromUrl(url: URL): Promise<PlacedImage> {
    const name = nameOf(url);
    if (isTiff(name, '')) refuseTiff(name);
    const image = await get(url);
    if (!image) return refuse(`There is no image “${name}” on the server of this page.`);
    const tried: string[] = [];
    for (const suffix of worldSuffixes(url.pathname)) {
      const beside = new URL(url);
      beside.pathname = url.pathname.replace(/\.[^./]*$/, '') + '.' + suffix;
      tried.push(nameOf(beside));
      const world = await get(beside);
      if (world)
        return this.read(
          name,
          await image.blob(),
          nameOf(beside),
          (await world.text()).slice(0, kMostText),
        );
    }
    return refuseUnplaced(name, `no world file lies beside it, as ${oneOf(tried)}`);
  }

  private async read(
    name: string,
    image: Blob,
    worldName: string,
    world: string,
  ): Promise<PlacedImage> {
    const numbers = numbersOf(worldName, world);
    const options: ImageBitmapOptions = {premultiplyAlpha: 'premultiply'};
    let bitmap: ImageBitmap;
    try {
      bitmap = await createImageBitmap(await unturned(image), options);
      const {width: columns, height: rows} = bitmap,
        part = this.most / Math.max(columns, rows);
      const place = placeOf(worldName, numbers, columns, rows);
      if (part >= 1) return {name, columns, rows, bitmap, place};
      const size = (n: number) => Math.max(1, Math.round(n * part));
      const smaller = await createImageBitmap(bitmap, {
        ...options,
        resizeWidth: size(columns),
        resizeHeight: size(rows),
        resizeQuality: 'high',
      });
      bitmap.close();
      return {name, columns, rows, bitmap: smaller, place};
    } catch (error) {
      if (!(error instanceof DOMException)) throw error;
      return refuse(
        `“${name}” cannot be shown as an image: it is damaged, too large for this browser, or of a kind that it does not read; PNG and JPEG it does.`,
      );
    }
  }
}
