// SPDX-License-Identifier: Apache-2.0
// Mouse, fingers and keys in the picture. Moving the camera is in navigation.ts, dragging in
// focus_handles.ts.
import type {Measuring} from './measuring';
import type {Navigation} from './navigation';
import {byId} from './page';
import type {Scene} from './scene';
import type {Shape} from './shapes';
import type {Hit} from './source';
import {toPage} from './stretch';
import type {Style} from './view_state';

// What they need of the page.
export interface GesturesContext {
  readonly canvas: HTMLCanvasElement;
  readonly scene: Scene;
  readonly navigation: Navigation;
  readonly measuring: Measuring;
  readonly look: {readonly style: Style; restyle(change: Partial<Style>): void};
  readonly panel: {open(open: boolean): void};
  readonly taking: {takePicture(): Promise<void>};
  drawn: string;
  probe(x: number, y: number, signal?: AbortSignal): Promise<Hit | null>;
  newRegion(kind: string): Shape | null;
  setRegion(region: Shape | null): void;
  coordinate(x: number): string;
  say(sentence: string, milliseconds?: number): void;
}

export class Gestures {
  measureOn = false;

  constructor(private readonly viewer: GesturesContext) {}

  setMeasuring(on: boolean) {
    this.measureOn = on;
    byId('measure').setAttribute('aria-pressed', String(on));
    this.viewer.canvas.classList.toggle('pick', on);
    byId('crosshair').hidden = !on;
    if (on) (byId('section-measure') as HTMLDetailsElement).open = true;
    else this.viewer.measuring.endLine();
  }

  setFlying(on: boolean) {
    this.viewer.navigation.fly(on);
    byId('fly').setAttribute('aria-pressed', String(on));
  }

  bindCanvas() {
    let down: {x: number; y: number; time: number} | null = null,
      lastTap: {x: number; y: number; time: number} | null = null;
    this.viewer.canvas.addEventListener('pointerdown', event => {
      down =
        event.button === 0 && event.isPrimary
          ? {x: event.clientX, y: event.clientY, time: event.timeStamp}
          : null;
      this.viewer.canvas.focus({preventScroll: true});
    });
    this.viewer.canvas.addEventListener('pointerup', event => {
      if (
        !down ||
        Math.hypot(event.clientX - down.x, event.clientY - down.y) >
          (event.pointerType === 'mouse' ? 4 : 12)
      ) {
        lastTap = null;
        return;
      }
      const box = this.viewer.canvas.getBoundingClientRect(),
        x = event.clientX - box.left,
        y = event.clientY - box.top;
      if (this.measureOn) return void this.addPoint(x, y);
      const twice =
        lastTap &&
        event.timeStamp - lastTap.time < 450 &&
        Math.hypot(lastTap.x - x, lastTap.y - y) < 24;
      lastTap = twice ? null : {x, y, time: event.timeStamp};
      if (twice) void this.goTo(x, y);
    });
    // What is under the cursor, when it rests.
    let timer = 0,
      asked: AbortController | null = null;
    const forget = () => {
      clearTimeout(timer);
      asked?.abort();
      asked = null;
    };
    this.viewer.canvas.addEventListener('pointermove', event => {
      forget();
      if (event.buttons !== 0 || event.pointerType === 'touch') return;
      const box = this.viewer.canvas.getBoundingClientRect(),
        x = event.clientX - box.left,
        y = event.clientY - box.top;
      timer = window.setTimeout(async () => {
        asked = new AbortController();
        const hit = await this.viewer.probe(x, y, asked.signal);
        byId('where').textContent = hit
          ? hit.point.map(c => this.viewer.coordinate(c)).join('  ')
          : '';
      }, 60);
    });
    this.viewer.canvas.addEventListener('pointerleave', () => {
      forget();
      byId('where').textContent = '';
    });
    this.viewer.canvas.addEventListener('webglcontextlost', event => {
      event.preventDefault();
      this.viewer.say(
        'The graphics card has no more memory for the scene, or was reset; waiting for it…',
      );
    });
    this.viewer.canvas.addEventListener('webglcontextrestored', () => {
      this.viewer.drawn = '';
      this.viewer.say('');
    });
  }

  bindKeys() {
    const views: Record<string, string> = {
      h: 'home',
      '1': 'top',
      '2': 'front',
      '3': 'right',
      '4': 'back',
      '5': 'left',
      '6': 'bottom',
    };
    const centre = (): [number, number] => [
      this.viewer.canvas.clientWidth / 2,
      this.viewer.canvas.clientHeight / 2,
    ];
    addEventListener('keydown', event => {
      const at = event.target as HTMLElement;
      const pressed =
        (event.key === 'Enter' || event.key === ' ') && at.closest?.('button, summary');
      if (
        at.closest?.('input, select, textarea') ||
        pressed ||
        event.ctrlKey ||
        event.metaKey ||
        event.altKey
      ) {
        if (event.key === 'Escape') this.viewer.canvas.focus();
        return;
      }
      const key = event.key.toLowerCase();
      if (views[key]) this.viewer.navigation.view(views[key]!);
      else if (key === 'f') this.setFlying(!this.viewer.navigation.flying);
      else if (key === 'm') this.setMeasuring(!this.measureOn);
      else if (key === 'enter' && this.measureOn) void this.addPoint(...centre());
      else if (key === ' ') void this.goTo(...centre());
      else if (key === 'n') this.viewer.measuring.endLine();
      else if (key === 'backspace') this.viewer.measuring.undo();
      else if (key === 'w' && !this.viewer.navigation.flying)
        this.viewer.look.restyle({wireframe: !this.viewer.look.style.wireframe});
      else if (key === 'l')
        this.viewer.look.restyle({
          shading: this.viewer.look.style.shading === 'flat' ? 'smooth' : 'flat',
        });
      else if (key === 'b')
        this.viewer.setRegion(this.viewer.scene.focus ? null : this.viewer.newRegion('box'));
      else if (key === 'p') void this.viewer.taking.takePicture();
      else if (key === 't') this.viewer.panel.open(document.body.classList.contains('closed'));
      else if (key === '?') {
        this.viewer.panel.open(true);
        (byId('section-keys') as HTMLDetailsElement).open = true;
        byId('section-keys').scrollIntoView();
      } else if (key === 'escape') {
        this.setMeasuring(false);
        this.setFlying(false);
      } else return;
      event.preventDefault();
    });
  }

  async goTo(x: number, y: number) {
    const hit = await this.viewer.probe(x, y);
    if (hit) this.viewer.navigation.goTo(toPage(hit.point, this.viewer.scene.stretch));
  }

  async addPoint(x: number, y: number) {
    const hit = await this.viewer.probe(x, y);
    if (hit) this.viewer.measuring.addPoint(hit);
    else this.viewer.say('There is no surface at this place.', 2500);
  }
}
