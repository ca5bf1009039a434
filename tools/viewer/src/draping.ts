// SPDX-License-Identifier: Apache-2.0
// The image that lies over the surface, and what it lies over. The page loads this with the first
// image.
import type * as three from 'three';
import {ownUrl} from './packed_store';
import {byId, whole} from './page';
import {ImageReader, liesOver, whyNotOver, type PlacedImage} from './placed_image';
import type {Scene} from './scene';
import type {ObjectInfo} from './source';

const kMost = 8192,
  kMostOnPhones = 4096; // columns and rows of a texture: 340 and 85 MiB of the card's memory

const sizeOf = (columns: number, rows: number) => `${whole(columns)} × ${whole(rows)}`;
const namesOf = (infos: {object: string}[]) => infos.map(info => `“${info.object}”`).join(', ');

const isSmaller = ({bitmap, columns, rows}: PlacedImage) =>
  bitmap.width < columns || bitmap.height < rows;

// What it needs of the page.
export interface DrapingContext {
  readonly renderer: three.WebGLRenderer;
  readonly scene: Scene;
  shownInfos(): ObjectInfo[];
  textureOf(bitmap: ImageBitmap): three.Texture;
}

export class Draping {
  image: PlacedImage | null = null;
  private texture: three.Texture | null = null;
  private given = 0; // counts images; the last one counts
  private readonly reader: ImageReader;
  private readonly hint = byId('drape-said').dataset.hint!;

  constructor(private readonly viewer: DrapingContext) {
    const most = matchMedia('(max-width: 700px)').matches ? kMostOnPhones : kMost;
    this.reader = new ImageReader(Math.min(most, viewer.renderer.capabilities.maxTextureSize));
  }

  // Files of the user. Where they lie elsewhere, what was there stays. Says what there is to say;
  // so does follow().
  async take(files: File[]): Promise<string> {
    if (this.viewer.scene.objects.size === 0)
      return 'Choose an object first, then the image that is to lie over it.';
    return this.read(
      () => this.reader.fromFiles(files),
      image => {
        const why = whyNotOver(image, this.viewer.shownInfos());
        if (why) return why;
        this.forgetLink();
        this.set(image);
        return '';
      },
    );
  }

  // Of the page's address (`?drape=`). It stays in any case: other objects may lie there.
  async follow(link: string): Promise<string> {
    const url = ownUrl(link, new URL(location.href));
    if (!(url instanceof URL)) return url.message;
    return this.read(
      () => this.reader.fromUrl(url),
      image => {
        this.set(image);
        return whyNotOver(image, this.viewer.shownInfos());
      },
    );
  }

  remove() {
    ++this.given;
    this.forgetLink();
    this.set(null);
  }

  // `use` says why it does not.
  private async read(
    from: () => Promise<PlacedImage>,
    use: (image: PlacedImage) => string,
  ): Promise<string> {
    const number = ++this.given;
    try {
      const image = await from();
      const why = number === this.given ? use(image) : '';
      if (this.image !== image) image.bitmap.close();
      if (why || this.image !== image || !isSmaller(image)) return why;
      return `“${image.name}” is shown with ${sizeOf(image.bitmap.width, image.bitmap.height)} of its ${sizeOf(image.columns, image.rows)} pixels; a page shows at most ${whole(this.reader.most)} each way.`;
    } catch (error) {
      return number === this.given ? (error as Error).message : '';
    }
  }

  // Links to this page have the image of its address no more.
  private forgetLink() {
    const url = new URL(location.href);
    if (!url.searchParams.has('drape')) return;
    url.searchParams.delete('drape');
    history.replaceState(null, '', url);
  }

  private set(image: PlacedImage | null) {
    this.texture?.dispose();
    this.image?.bitmap.close();
    this.image = image;
    this.texture = image && this.viewer.textureOf(image.bitmap);
    this.reconsider();
  }

  // Other objects are shown, or another image.
  reconsider() {
    const {image} = this;
    for (const {info, mesh} of this.viewer.scene.objects.values()) {
      mesh.drape =
        image && liesOver(image.place, info) ? {texture: this.texture!, place: image.place} : null;
    }
    ++this.viewer.scene.changes;
    this.tell();
  }

  tell() {
    const {image} = this;
    byId('undrape').hidden = !image;
    byId('drape-said').textContent = image ? this.sentenceFor(image) : this.hint;
    if (image) (byId('section-image') as HTMLDetailsElement).open = true;
  }

  private sentenceFor(image: PlacedImage) {
    const {name, columns, rows, bitmap, place} = image;
    const infos = this.viewer.shownInfos(),
      over = infos.filter(info => liesOver(place, info));
    const smaller = isSmaller(image) ? `, shown with ${sizeOf(bitmap.width, bitmap.height)}` : '';
    const where =
      over.length === infos.length
        ? ''
        : over.length > 0
          ? ` It lies over ${namesOf(over)}.`
          : ' It lies elsewhere than what is shown now.';
    return `“${name}”, ${sizeOf(columns, rows)} pixels${smaller}.${where}`;
  }
}
