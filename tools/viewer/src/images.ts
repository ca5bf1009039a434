// SPDX-License-Identifier: Apache-2.0
// How images that are to lie over the surface come in: chosen, dropped, or by the page's address.
// What is done with them is a module of its own (draping.ts), which is loaded with the first one.
import type {Draping, DrapingContext} from './draping';
import {byId, input} from './page';

const kSaid = 12_000; // milliseconds that a refusal is shown

// What they need of the page.
export interface ImagesContext extends DrapingContext {
  say(sentence: string, milliseconds?: number): void;
}

export class Images {
  draping: Draping | null = null;
  private linked = false; // the page's address was looked at

  constructor(private readonly viewer: ImagesContext) {}

  bind() {
    const files = input('drape-files');
    byId('drape').onclick = () => files.click();
    byId('undrape').onclick = () => this.draping?.remove();
    files.onchange = () => {
      this.take([...files.files!]);
      files.value = '';
    };
    const on = (kind: 'dragover' | 'dragleave' | 'drop', act: (data: DataTransfer) => void) =>
      addEventListener(kind, event => {
        if (!event.dataTransfer?.types.includes('Files')) return;
        event.preventDefault();
        document.body.classList.toggle(
          'dropping',
          kind === 'dragover' || event.relatedTarget !== null,
        );
        act(event.dataTransfer);
      });
    on('dragover', () => {});
    on('dragleave', () => {});
    on('drop', data => this.take([...data.files]));
  }

  private take(files: File[]) {
    if (files.length > 0) void this.use(draping => draping.take(files));
  }

  // To be called when objects are shown.
  follow() {
    const link = new URLSearchParams(location.search).get('drape');
    if (this.linked || link === null) return;
    this.linked = true;
    void this.use(draping => draping.follow(link));
  }

  // `act` resolves to what is to be said.
  private async use(act: (draping: Draping) => Promise<string>) {
    const said = byId('drape-said'),
      hint = (said.dataset.hint ??= said.textContent!);
    said.textContent = 'The image is being read…';
    let sentence: string;
    try {
      const module = await (import(new URL('draping.js', import.meta.url).href) as Promise<
        typeof import('./draping')
      >);
      sentence = await act((this.draping ??= new module.Draping(this.viewer)));
    } catch {
      sentence = 'The page cannot load its part that reads images; is its server still there?';
    }
    if (this.draping) this.draping.tell();
    else said.textContent = hint;
    if (sentence) this.viewer.say(sentence, kSaid);
  }
}
