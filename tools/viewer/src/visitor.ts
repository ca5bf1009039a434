// SPDX-License-Identifier: Apache-2.0
// The page for visitors (`?ui=simple` or `none`): without the panel, with title, caption and places
// with texts, from a JSON file beside the page (`?notes=FILE`). A module of its own, which is
// loaded where the address asks for it.
import type {Navigation} from './navigation';
import {ownUrl} from './packed_store';
import {byId} from './page';
import {add, length, scale, sub, type Point} from './query';
import type {Scene} from './scene';
import {StoreError, type Store} from './source';
import {toModel, toPage} from './stretch';

// In the object's coordinates.
interface Spot {
  at: Point;
  title: string;
  text: string;
  view: {eye: Point; look: Point} | null;
}

const kTurn = (2 * Math.PI) / 60; // radians a second
const kMost = 200; // spots
const kHidden = 0.01; // of the radius: what lies so much behind the surface is hidden

const isPoint = (x: unknown): x is Point =>
  Array.isArray(x) && x.length === 3 && x.every(n => typeof n === 'number' && Number.isFinite(n));
const textOf = (x: unknown) => (typeof x === 'string' ? x : '');

// What it needs of the page.
export interface VisitorContext {
  readonly canvas: HTMLCanvasElement;
  readonly scene: Scene;
  readonly navigation: Navigation;
  readonly store: Pick<Store, 'probe'>;
  say(sentence: string, milliseconds?: number): void;
}

export class Visitor {
  private spots: {spot: Spot; button: HTMLButtonElement; behind: boolean}[] = [];
  private chosen = -1;
  private turning = false;
  private looked = ''; // where from it was found what the surface hides
  private looking = 0; // counts

  constructor(
    private readonly viewer: VisitorContext,
    search: URLSearchParams,
  ) {
    byId('visit').hidden = false;
    byId('visit-turn').onclick = () => this.turn(!this.turning);
    const full = byId<HTMLButtonElement>('visit-full');
    full.hidden = !document.fullscreenEnabled;
    full.onclick = () =>
      void (document.fullscreenElement
        ? document.exitFullscreen()
        : document.documentElement.requestFullscreen());
    byId('visit-home').onclick = () => viewer.navigation.view('home');
    byId('spot-close').onclick = () => this.choose(-1);
    viewer.canvas.addEventListener('pointerdown', () => this.turn(false));
    addEventListener('keydown', event => event.key === 'Escape' && this.choose(-1));
    if (search.has('turn')) this.turn(true);
    const notes = search.get('notes');
    if (notes !== null) void this.read(notes);
    let last = performance.now();
    const tick = (now: number) => {
      if (this.turning)
        void viewer.navigation.controls.rotate(
          -kTurn * Math.min(0.1, (now - last) / 1000),
          0,
          false,
        );
      last = now;
      this.place();
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  private turn(on: boolean) {
    this.turning = on;
    this.viewer.scene.turning = on;
    byId('visit-turn').setAttribute('aria-pressed', String(on));
  }

  private async read(notes: string) {
    const url = ownUrl(notes, new URL(location.href));
    if (url instanceof StoreError) return this.viewer.say(url.message);
    try {
      const answer = await fetch(url);
      if (!answer.ok) throw new Error(`the server answers ${answer.status}`);
      this.take(await answer.json());
    } catch (error) {
      this.viewer.say(
        `The notes of this page, ${notes}, cannot be read: ${(error as Error).message}.`,
      );
    }
  }

  // Anything may be in a file: what is no spot is said.
  private take(notes: {title?: unknown; caption?: unknown; spots?: unknown}) {
    byId('visit-caption').textContent = textOf(notes?.caption);
    if (textOf(notes?.title))
      byId('visit-title').textContent = document.title = textOf(notes.title);
    const list = Array.isArray(notes?.spots) ? notes.spots : [];
    const spots = list
      .slice(0, kMost)
      .filter(s => isPoint(s?.at))
      .map(
        s =>
          ({
            at: s.at,
            title: textOf(s.title),
            text: textOf(s.text),
            view:
              isPoint(s.view?.eye) && isPoint(s.view?.look)
                ? {eye: s.view.eye, look: s.view.look}
                : null,
          }) as Spot,
      );
    if (spots.length < list.length)
      this.viewer.say(
        `${list.length - spots.length} of ${list.length} places in the notes have no "at": [x, y, z], or are beyond the ${kMost} that are shown.`,
        12_000,
      );
    this.spots = spots.map((spot, i) => {
      const button = document.createElement('button');
      button.textContent = String(i + 1);
      button.title = spot.title;
      button.setAttribute('aria-label', spot.title || `Place ${i + 1}`);
      button.onclick = () => this.choose(i);
      return {spot, button, behind: false};
    });
    byId('spots').replaceChildren(...this.spots.map(s => s.button));
  }

  private choose(index: number) {
    this.chosen = index;
    const spot = this.spots[index]?.spot;
    byId('spot-card').hidden = !spot;
    if (!spot) return;
    this.turn(false);
    byId('spot-title').textContent = spot.title;
    byId('spot-text').textContent = spot.text;
    const {navigation, scene} = this.viewer,
      at = toPage(spot.at, scene.stretch);
    if (spot.view)
      return navigation.set(
        toPage(spot.view.eye, scene.stretch),
        toPage(spot.view.look, scene.stretch),
      );
    // From the side where it is, half as far from it as all of the object is high.
    const away = sub(navigation.eye(), at);
    navigation.set(
      add(at, scale(away, Math.min(1, (1.2 * navigation.radius()) / (length(away) || 1)))),
      at,
    );
  }

  // Buttons follow their places, and those behind the surface are faint.
  private place() {
    const {navigation, canvas, scene} = this.viewer;
    const open = [...scene.objects.values()].some(o => o.state === 'open');
    for (const [i, {spot, button, behind}] of this.spots.entries()) {
      const p = navigation.toScene(toPage(spot.at, scene.stretch)).project(navigation.camera);
      button.hidden = !open || p.z > 1 || p.z < -1 || Math.abs(p.x) > 1 || Math.abs(p.y) > 1;
      button.style.transform = `translate(${((p.x + 1) / 2) * canvas.clientWidth}px, ${((1 - p.y) / 2) * canvas.clientHeight}px) translate(-50%, -50%)`;
      button.classList.toggle('behind', behind);
      button.setAttribute('aria-pressed', String(i === this.chosen));
    }
    const from = JSON.stringify(navigation.eye());
    if (open && !scene.moving && from !== this.looked && this.spots.length > 0) {
      this.looked = from;
      void this.findHidden(++this.looking);
    }
  }

  private async findHidden(mine: number) {
    const {navigation, scene, store} = this.viewer,
      eye = navigation.eye(),
      {stretch} = scene;
    for (const entry of this.spots) {
      const at = toPage(entry.spot.at, stretch),
        way = sub(at, eye);
      let nearest = Infinity;
      for (const object of scene.objects.values()) {
        const hit = await store
          .probe(object.name, toModel(eye, stretch), toModel(way, stretch))
          .catch(() => null);
        if (mine !== this.looking) return;
        if (hit) nearest = Math.min(nearest, length(sub(toPage(hit.point, stretch), eye)));
      }
      entry.behind = nearest < length(way) - kHidden * navigation.radius();
    }
  }
}
