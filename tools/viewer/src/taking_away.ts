// SPDX-License-Identifier: Apache-2.0
// What the user takes along: meshes, pictures, a link to the view.
import type * as three from 'three';
import type {Navigation} from './navigation';
import {byId, download, figure, input, select, whole} from './page';
import type {Scene} from './scene';
import {halfSpaceOf, planesOf, regionOf} from './shapes';
import type {Store} from './source';

// What it needs of the page.
export interface TakingContext {
  readonly canvas: HTMLCanvasElement;
  readonly renderer: three.WebGLRenderer;
  readonly scene: Scene;
  readonly navigation: Navigation;
  readonly store: Pick<Store, 'mesh'>;
  readonly textures: {readonly settled: boolean};
  draw(): void;
  resize(): void;
  saveView(): void;
  text(units: number): string;
}

export class TakingAway {
  pictureViewport: [number, number] | null = null; // while a picture is made

  constructor(private readonly viewer: TakingContext) {}

  async takeMesh() {
    const error = Number(input('take-error').value),
      format = select('format').value,
      said = byId('take-said');
    if (!(error >= 0) || !Number.isFinite(error) || input('take-error').value === '') {
      said.textContent = 'The error is to be a number that is not negative.';
      return;
    }
    const {focus, stretch} = this.viewer.scene;
    const planes =
      focus && input('take-cut').checked
        ? planesOf(focus.region).map(p => halfSpaceOf(p, stretch))
        : [];
    if (planes.length > 0 && format === 'drc') {
      said.textContent =
        'Draco is not written of what is cut along planes: take PLY, OBJ, STL or GLB.';
      return;
    }
    for (const name of this.viewer.scene.objects.keys()) {
      said.textContent = `${name}: cutting…`;
      try {
        const mesh = await this.viewer.store.mesh(
          name,
          {
            threshold: error === 0 ? 'full' : error,
            ...(focus ? {region: regionOf(focus.region, stretch), clip: true} : {}),
          },
          format,
          planes,
        );
        download(mesh.blob, `${name}.${format}`);
        said.textContent = `${name}: ${whole(mesh.triangles)} triangles, off by at most ${this.viewer.text(mesh.errorBound)}, ${figure(mesh.blob.size / 1e6)} MB.`;
      } catch (failure) {
        said.textContent = `${name}: ${(failure as Error).message}`;
      }
    }
  }

  async takePicture() {
    const choice = select('picture-size').value,
      said = byId('take-said');
    const ratio = this.viewer.renderer.getPixelRatio(),
      w = this.viewer.canvas.clientWidth,
      h = this.viewer.canvas.clientHeight;
    const own: [number, number] = [
      Number(input('picture-width').value),
      Number(input('picture-height').value),
    ];
    const size: [number, number] =
      choice === 'own'
        ? own
        : choice.includes('x')
          ? (choice.split('x').map(Number) as [number, number])
          : [w * ratio * Number(choice), h * ratio * Number(choice)];
    const most = this.viewer.renderer.capabilities.maxTextureSize;
    if (size.some(n => !(n >= 1))) {
      said.textContent = 'Width and height are to be whole numbers of pixels.';
      return;
    }
    if (size.some(n => n > most)) {
      said.textContent = `This graphics card draws at most ${most} pixels a side.`;
      return;
    }
    said.textContent = 'The picture is made as exact as the view…';
    this.pictureViewport = [Math.round(size[0]), Math.round(size[1])];
    try {
      await this.whenExact();
      this.viewer.renderer.setPixelRatio(1);
      this.viewer.renderer.setSize(size[0], size[1], false);
      this.viewer.navigation.camera.aspect = size[0] / size[1];
      this.viewer.navigation.camera.updateProjectionMatrix();
      this.viewer.draw();
      const blob = await new Promise<Blob | null>(done =>
        this.viewer.canvas.toBlob(done, 'image/png'),
      );
      if (!blob) throw new Error('The picture does not fit the memory of this page.');
      download(blob, `${[...this.viewer.scene.objects.keys()].join(' ') || 'mtdb'}.png`);
      said.textContent = `A picture of ${Math.round(size[0])} × ${Math.round(size[1])} pixels.`;
    } catch (error) {
      said.textContent = (error as Error).message;
    } finally {
      this.pictureViewport = null;
      this.viewer.renderer.setPixelRatio(ratio);
      this.viewer.resize();
    }
  }

  // Resolves when what is shown is the answer to what is asked, or cannot become so.
  whenExact(): Promise<void> {
    return new Promise(done => {
      const begin = performance.now();
      const look = () => {
        const kind = this.viewer.scene.exactness().kind;
        if (
          (performance.now() - begin > 300 && kind !== 'loading' && this.viewer.textures.settled) ||
          performance.now() - begin > 30_000
        )
          done();
        else setTimeout(look, 50);
      };
      look();
    });
  }

  async copyLink() {
    this.viewer.saveView();
    try {
      await navigator.clipboard.writeText(location.href);
      byId('take-said').textContent = 'The link is in the clipboard.';
    } catch {
      byId('take-said').textContent =
        'This page may not write to the clipboard; the link is in the address bar.';
    }
  }
}
