// SPDX-License-Identifier: Apache-2.0
// Textured objects: what comes of their tiles, until the module that draws them is there
// (texturing.ts), which is loaded with the first one.
import type {SceneObject} from './scene';
import type {TextureNews} from './source';
import type {Texturing, TexturingContext} from './texturing';

export class Textures {
  private texturing: Texturing | null = null;
  private early: [SceneObject, TextureNews][] | null = null; // what came before the module

  constructor(private readonly viewer: TexturingContext) {}

  take(object: SceneObject, news: TextureNews) {
    if (this.texturing) return this.texturing.take(object, news);
    if (this.early) return void this.early.push([object, news]);
    if (news.kind === 'pages' && news.pages.length === 0) return;
    this.early = [[object, news]];
    void (
      import(new URL('texturing.js', import.meta.url).href) as Promise<typeof import('./texturing')>
    ).then(
      module => {
        this.texturing = new module.Texturing(this.viewer);
        for (const [to, what] of this.early!) this.texturing.take(to, what);
      },
      () => {
        this.early = null;
        this.viewer.say('The page cannot load its part for textures; is its server still there?');
      },
    );
  }

  frame(now: number, moved: boolean) {
    return this.texturing?.frame(now, moved) ?? false;
  }

  // Whether nothing is on the way.
  get settled() {
    return this.texturing?.settled ?? this.early === null;
  }

  figures(): [string, string][] {
    return this.texturing?.figures() ?? [];
  }
}
