// SPDX-License-Identifier: Apache-2.0
// Where the cuts are made, and what that may take: the panel's switch, sliders and figures.
import type {Scene} from './scene';
import type {Limits, Store, Way} from './source';

const kMiB = 2 ** 20;
const kNoLimit = 15; // the slider's last step; 2^step kB a second before it

const byId = <T extends HTMLElement = HTMLElement>(id: string) => document.getElementById(id) as T;

// As the link says it, if the store has that way.
export function wayOf(search: string, store: Store): Way {
  const asked = new URLSearchParams(search).get('way');
  return store.ways.find(way => way === asked) ?? store.ways[0]!;
}

// Of the device's memory, as far as the browser tells: an eighth, half a GiB at most.
function usualMemory(): number {
  const {deviceMemory} = navigator as {deviceMemory?: number};
  return Math.min(512, Math.max(64, (deviceMemory ?? 2) * 64)) * kMiB;
}

export class Loading {
  readonly limits: Limits = {cacheBytes: usualMemory(), bytesPerSecond: Infinity};

  // `reopened`: the scene's sources are new.
  constructor(
    store: Store,
    public way: Way,
    private readonly scene: Scene,
    reopened: () => void,
  ) {
    scene.setLimits({...this.limits});
    byId('way-row').hidden = store.ways.length < 2;
    for (const option of byId<HTMLSelectElement>('format').options)
      option.hidden = option.disabled = !store.formats.includes(option.value);
    byId('way').addEventListener('change', () => {
      this.way = byId<HTMLSelectElement>('way').value as Way;
      const url = new URL(location.href);
      if (this.way === store.ways[0]) url.searchParams.delete('way');
      else url.searchParams.set('way', this.way);
      history.replaceState(null, '', url);
      scene.setWay(this.way);
      reopened();
      this.fill();
    });
    const limit = () => {
      this.limits.cacheBytes = 2 ** Number(byId<HTMLInputElement>('memory').value) * kMiB;
      const rate = Number(byId<HTMLInputElement>('rate').value);
      this.limits.bytesPerSecond = rate >= kNoLimit ? Infinity : 2 ** rate * 1000;
      this.fill();
    };
    for (const id of ['memory', 'rate']) {
      byId(id).addEventListener('input', limit);
      byId(id).addEventListener('change', () => scene.setLimits({...this.limits}));
    }
    this.fill();
  }

  fill() {
    const thick = this.way === 'thick';
    byId<HTMLSelectElement>('way').value = this.way;
    byId('memory-row').hidden = byId('rate-row').hidden = !thick;
    byId<HTMLInputElement>('memory').value = String(Math.log2(this.limits.cacheBytes / kMiB));
    byId('memory-text').textContent =
      `${Math.round(this.limits.cacheBytes / kMiB)} MiB of clusters`;
    const {bytesPerSecond} = this.limits;
    byId<HTMLInputElement>('rate').value =
      bytesPerSecond < Infinity ? String(Math.log2(bytesPerSecond / 1000)) : String(kNoLimit);
    byId('rate-text').textContent =
      bytesPerSecond >= Infinity
        ? 'as fast as it comes'
        : bytesPerSecond < 1e6
          ? `${bytesPerSecond / 1000} kB a second`
          : `${(bytesPerSecond / 1e6).toFixed(1)} MB a second`;
  }

  // What is shown while it loads; empty when there is nothing to say.
  progress(): string {
    let requests = 0,
      bytes = 0;
    for (const {source} of this.scene.objects.values()) {
      requests += source.traffic.load?.requests ?? 0;
      bytes += source.traffic.load?.requestBytes ?? 0;
    }
    return requests > 0 ? `${(bytes / 1e6).toFixed(bytes < 1e6 ? 2 : 1)} MB on the way` : '';
  }

  // Rows of the panel of figures.
  figures(): [string, string][] {
    const objects = [...this.scene.objects.values()],
      loads = objects.flatMap(o => o.source.traffic.load ?? []);
    const sum = (pick: (load: (typeof loads)[number]) => number) =>
      loads.reduce((total, load) => total + pick(load), 0);
    const ms = (x: number) => `${x.toFixed(1)} ms`,
      mib = (x: number) => `${(x / kMiB).toFixed(1)} MiB`;
    const most = (pick: (o: (typeof objects)[number]) => number) =>
      Math.max(0, ...objects.map(pick));
    const rows: [string, string][] = [
      ['received', `${(this.scene.total(o => o.source.traffic.bytes) / 1e6).toFixed(2)} MB`],
    ];
    if (this.way === 'thin') {
      rows.push(
        ['last answer', `${most(o => o.done?.bytes ?? 0).toLocaleString('en')} bytes`],
        ['cut (server)', ms(most(o => o.done?.milliseconds ?? 0))],
        ['decode (worker)', ms(most(o => o.source.traffic.applyMilliseconds))],
      );
    } else {
      rows.push(
        [
          'waiting for',
          `${sum(l => l.requests)} requests, ${(sum(l => l.requestBytes) / 1e6).toFixed(2)} MB`,
        ],
        ['clusters decoded', sum(l => l.clusters).toLocaleString('en')],
        ['clusters missing', sum(l => l.missing).toLocaleString('en')],
        ['clusters in memory', mib(sum(l => l.cacheBytes))],
        ['memory of the engine', mib(sum(l => l.engineBytes))],
        ['cut (worker), longest', ms(Math.max(0, ...loads.map(l => l.cutMilliseconds)))],
        ['cut and changes', ms(most(o => o.source.traffic.applyMilliseconds))],
      );
    }
    rows.push(['upload (arrays)', ms(most(o => o.mesh.applyMilliseconds))]);
    return rows;
  }
}
