// SPDX-License-Identifier: Apache-2.0
// A store behind `mtdb serve` (docs/protocol.md): the server cuts, a session brings what changes,
// and a worker (decoder.ts) keeps the mesh.
import type {FromDecoder, ToDecoder} from './decoder';
import type {Point, Query} from './query';
import {StoreError} from './source';
import {stretchOf} from './stretch';
import type {Done, Hit, MeshListener, MeshSource, ObjectEntry, ObjectInfo, Store, TakenMesh, Traffic, ValueChoice} from './source';

const kRemember = 65536; // removed vertices that need not travel again
const kPatience = 120; // milliseconds before a newer query takes the place of one on its way
const kFirstPause = 500, kLongestPause = 5000; // milliseconds between two tries to find a lost server

const unreachable = 'The server cannot be reached; is mtdb still running?';

async function errorOf(response: Response): Promise<StoreError> {
  try {
    const body = await response.json();
    return new StoreError(String(body.error), String(body.code));
  } catch {
    return new StoreError(`The server answered ${response.status} ${response.statusText}`, 'http');
  }
}

export class ServerStore implements Store {
  // `base`: the URL that ends before "objects".
  constructor(private readonly base: URL) {}

  private url(path: string) {
    return new URL(path, this.base);
  }

  private async get(path: string, init?: RequestInit): Promise<Response> {
    let response: Response;
    try {
      response = await fetch(this.url(path), init);
    } catch (error) {
      if ((error as Error).name === 'AbortError') throw error;
      throw new StoreError(unreachable, 'unreachable');
    }
    if (!response.ok) throw await errorOf(response);
    return response;
  }

  async objects(): Promise<ObjectEntry[]> {
    return (await (await this.get('objects')).json()).objects;
  }

  async info(name: string): Promise<ObjectInfo> {
    return await (await this.get(`objects/${encodeURIComponent(name)}`)).json();
  }

  async probe(name: string, origin: Point, direction: Point, signal?: AbortSignal): Promise<Hit | null> {
    const answer = await (await this.get(`objects/${encodeURIComponent(name)}/probe?ray=${[...origin, ...direction].join(',')}`, {signal: signal ?? null})).json();
    return answer.hit ? {point: answer.point, error_bound: answer.error_bound} : null;
  }

  async mesh(name: string, query: Query, format: string): Promise<TakenMesh> {
    const response = await this.get(`objects/${encodeURIComponent(name)}/mesh?format=${format}`, {method: 'POST', body: JSON.stringify(query)});
    const blob = await response.blob().catch(() => {
      throw new StoreError('The connection broke off before the whole mesh had come', 'broken');
    });
    return {blob, triangles: Number(response.headers.get('X-Mtdb-Triangles')), errorBound: Number(response.headers.get('X-Mtdb-Error-Bound'))};
  }

  open(name: string, listener: MeshListener): MeshSource {
    return new ServerSession(this, name, this.url(`objects/${encodeURIComponent(name)}/session?remember=${kRemember}`), listener);
  }
}

class ServerSession implements MeshSource {
  maxTriangles = 1_000_000;
  readonly traffic: Traffic = {bytes: 0, applyMilliseconds: 0};
  private worker: Worker | null = null;
  private closed = false;
  private ready = false;
  private pause = kFirstPause;
  private timer = 0;
  private wanted: Query | null = null;
  private sent: {id: number; query: Query; at: number}[] = [];
  private nextId = 1;
  private choice: ValueChoice = {kind: 'none'};
  private bytesBefore = 0;
  private askTimer = 0;
  private answered: Query | null = null; // the last that has its answer

  constructor(private readonly store: ServerStore, private readonly name: string, private readonly url: URL, private readonly listener: MeshListener) {
    this.url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
    listener.state('opening', '');
    void this.start();
  }

  private post(message: ToDecoder) {
    this.worker?.postMessage(message);
  }

  private async start() {
    let info: ObjectInfo;
    try {
      info = await this.store.info(this.name);
    } catch (error) {
      return this.lose(error as StoreError);
    }
    if (this.closed) return;
    const worker = new Worker(new URL('decoder.js', import.meta.url), {type: 'module'});
    this.worker = worker;
    worker.onmessage = (event: MessageEvent<FromDecoder>) => this.onMessage(event.data);
    worker.onerror = () => this.lose(new StoreError('The decoder could not be started; load the page anew.', 'decoder'));
    this.post({kind: 'open', url: this.url.href, remember: kRemember, types: info.attributes.map(a => a.type), stretch: stretchOf(info)});
  }

  private stop() {
    this.worker?.terminate();
    this.worker = null;
    this.ready = false;
    this.sent = [];
    this.answered = null;
    clearTimeout(this.askTimer);
    this.askTimer = 0;
    this.bytesBefore = this.traffic.bytes;
  }

  private onMessage(message: FromDecoder) {
    if (message.kind === 'hello') {
      this.maxTriangles = message.hello.max_triangles;
      this.ready = true;
      this.pause = kFirstPause;
      this.post({kind: 'choose', values: this.choice});
      this.listener.state('open', '');
      this.send();
    } else if (message.kind === 'update') {
      this.traffic.bytes = this.bytesBefore + message.bytes;
      this.traffic.applyMilliseconds = message.milliseconds;
      if (message.update) this.listener.changed(message.update);
      for (const answer of message.answers) this.onAnswer(answer as {id?: number; done?: Done; error?: string; code?: string});
      requestAnimationFrame(() => this.post({kind: 'taken'}));
    } else {
      void this.onClosed(message);
    }
  }

  private onAnswer(answer: {id?: number; done?: Done; error?: string; code?: string}) {
    const at = this.sent.findIndex(s => s.id === answer.id);
    const query = at >= 0 ? this.sent[at]!.query : null;
    this.sent.splice(0, at + 1);
    if (query && (answer.done || answer.error !== undefined)) this.answered = query;
    if (answer.done && query) this.listener.answered(query, answer.done);
    if (answer.error !== undefined) {
      if (answer.code === 'gone' || answer.code === 'shutting_down') {
        this.lose(new StoreError(answer.error, answer.code));
        return;
      }
      if (query) this.listener.failed(query, answer.error);
    }
    this.send();
  }

  // Why a WebSocket did not open its page is not told; the object's answer does.
  private async onClosed(message: FromDecoder & {kind: 'closed'}) {
    this.stop();
    if (message.code === -1) {
      this.closed = true;
      return this.listener.state('gone', message.sentence);
    }
    if (message.sentence) return this.lose(new StoreError(message.sentence, 'decoder'));
    try {
      await this.store.info(this.name);
      const why = message.code === 1013 || !message.opened ? 'The server has no room for another session' : 'The connection to the server was lost';
      this.lose(new StoreError(why, 'lost'));
    } catch (error) {
      this.lose(error as StoreError);
    }
  }

  private lose(error: StoreError) {
    this.stop();
    if (this.closed) return;
    if (error.code === 'no_such_object') {
      this.closed = true;
      return this.listener.state('gone', `The object “${this.name}” is not in the store any more.`);
    }
    this.listener.state('lost', `${error.message.replace(/\.$/, '')}. Trying again…`);
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.start(), this.pause);
    this.pause = Math.min(2 * this.pause, kLongestPause);
  }

  ask(query: Query) {
    this.wanted = query;
    this.send();
  }

  // One query is on its way at a time; a newer one takes its place when it takes long.
  private send() {
    const query = this.wanted;
    if (!this.ready || !query || this.sent.at(-1)?.query === query || this.answered === query) return;
    const last = this.sent.at(-1);
    if (last && performance.now() - last.at < kPatience) {
      if (this.askTimer === 0) {
        this.askTimer = window.setTimeout(() => {
          this.askTimer = 0;
          this.send();
        }, kPatience);
      }
      return;
    }
    const id = this.nextId++;
    this.sent.push({id, query, at: performance.now()});
    this.post({kind: 'ask', id, query});
  }

  choose(values: ValueChoice) {
    this.choice = values;
    if (this.ready) this.post({kind: 'choose', values});
  }

  close() {
    this.closed = true;
    clearTimeout(this.timer);
    this.stop();
  }
}
