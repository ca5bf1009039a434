// SPDX-License-Identifier: Apache-2.0
// A mesh that a worker keeps: decoder.ts (thin) or engine.ts (thick). Finds it again when it is
// lost.
import type {Point, Query} from './query';
import {StoreError} from './source';
import type {
  Done,
  Limits,
  Load,
  MeshListener,
  MeshSource,
  MeshUpdate,
  ObjectInfo,
  TextureNews,
  Traffic,
  ValueChoice,
} from './source';
import type {TileName} from './texture_tiles';

export type ToWorker =
  | {kind: 'open'; url: string; remember: number; types: string[]; stretch: Point} // of decoder.ts
  | {
      kind: 'open_packed';
      url: string;
      object: string;
      byHash: boolean;
      types: string[];
      stretch: Point;
    } // of engine.ts
  | {kind: 'ask'; id: number; query: Query}
  | {kind: 'choose'; values: ValueChoice}
  | {kind: 'tiles'; wanted: TileName[]; taken: number}
  | {kind: 'limit'; limits: Limits}
  | {kind: 'taken'};

export interface Answer {
  id?: number;
  done?: Done;
  error?: string;
  code?: string;
}

export type FromWorker =
  | {kind: 'hello'; hello: {max_triangles: number}}
  | {
      kind: 'update';
      update: MeshUpdate | null;
      answers: Answer[];
      bytes: number;
      milliseconds: number;
      load: Load | null;
    }
  | {kind: 'texture'; news: TextureNews}
  // Something does not come; the worker tries again. Empty: it does.
  | {kind: 'trouble'; sentence: string}
  | {kind: 'closed'; opened: boolean; code: number; sentence: string};

const kPatience = 120; // milliseconds before a newer query takes the place of one that a server works on
const kFirstPause = 500,
  kLongestPause = 5000; // milliseconds between two tries to find a lost server

// What differs between the two ways.
export interface WorkerKind {
  script: 'decoder.js' | 'engine.js';
  info: () => Promise<ObjectInfo>;
  open: (info: ObjectInfo) => ToWorker;
}

export class WorkerSession implements MeshSource {
  maxTriangles = 1_000_000;
  readonly traffic: Traffic = {bytes: 0, applyMilliseconds: 0, load: null};
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
  private limits: Limits = {cacheBytes: 256 * 2 ** 20, bytesPerSecond: Infinity};

  constructor(
    private readonly name: string,
    private readonly listener: MeshListener,
    private readonly way: WorkerKind,
  ) {
    listener.state('opening', '');
    void this.start();
  }

  private post(message: ToWorker) {
    this.worker?.postMessage(message);
  }

  private async start() {
    let info: ObjectInfo;
    try {
      info = await this.way.info();
    } catch (error) {
      return this.lose(error as StoreError);
    }
    if (this.closed) return;
    const worker = new Worker(new URL(this.way.script, import.meta.url), {type: 'module'});
    this.worker = worker;
    worker.onmessage = (event: MessageEvent<FromWorker>) => this.onMessage(event.data);
    worker.onerror = () =>
      this.lose(new StoreError('The decoder could not be started; load the page anew.', 'decoder'));
    this.post({kind: 'limit', limits: this.limits});
    this.post(this.way.open(info));
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

  private onMessage(message: FromWorker) {
    if (message.kind === 'hello') {
      this.maxTriangles = message.hello.max_triangles;
      this.ready = true;
      this.pause = kFirstPause;
      this.sent = [];
      this.answered = null;
      this.post({kind: 'choose', values: this.choice});
      this.listener.state('open', '');
      this.send();
    } else if (message.kind === 'update') {
      this.traffic.bytes = this.bytesBefore + message.bytes;
      this.traffic.applyMilliseconds = message.milliseconds;
      this.traffic.load = message.load;
      if (message.update) this.listener.changed(message.update);
      for (const answer of message.answers) this.onAnswer(answer);
      requestAnimationFrame(() => this.post({kind: 'taken'}));
    } else if (message.kind === 'texture') {
      this.listener.texture(message.news);
    } else if (message.kind === 'trouble') {
      if (message.sentence)
        this.listener.state('lost', `${message.sentence.replace(/\.$/, '')}. Trying again…`);
      else this.listener.state('open', '');
    } else {
      void this.onClosed(message);
    }
  }

  private onAnswer(answer: Answer) {
    const at = this.sent.findIndex(s => s.id === answer.id);
    const query = at >= 0 ? this.sent[at]!.query : null;
    this.sent.splice(0, at + 1);
    if (query && (answer.done || answer.error !== undefined)) this.answered = query;
    if (answer.done && query) this.listener.answered(query, answer.done);
    if (answer.error !== undefined) {
      // Of what is not found, the next try tells whether it is gone for good.
      if (['gone', 'shutting_down', 'not_found'].includes(answer.code ?? '')) {
        this.lose(new StoreError(answer.error, 'gone'));
        return;
      }
      if (query) this.listener.failed(query, answer.error);
    }
    this.send();
  }

  // Why a WebSocket did not open its page is not told; the object's answer does.
  private async onClosed(message: FromWorker & {kind: 'closed'}) {
    this.stop();
    if (message.code === -1) {
      this.closed = true;
      return this.listener.state('gone', message.sentence);
    }
    if (message.sentence) return this.lose(new StoreError(message.sentence, 'decoder'));
    try {
      await this.way.info();
      const why =
        message.code === 1013 || !message.opened
          ? 'The server has no room for another session'
          : 'The connection to the server was lost';
      this.lose(new StoreError(why, 'lost'));
    } catch (error) {
      this.lose(error as StoreError);
    }
  }

  private lose(error: StoreError) {
    this.stop();
    if (this.closed) return;
    if (!error.passes) {
      this.closed = true;
      return this.listener.state(
        'gone',
        error.code === 'no_such_object'
          ? `The object “${this.name}” is not in the store any more.`
          : error.message,
      );
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

  // A server has one query at a time; a newer one takes its place when it takes long. The engine in
  // the page takes the newest at once.
  private send() {
    const query = this.wanted;
    if (!this.ready || !query || this.sent.at(-1)?.query === query || this.answered === query)
      return;
    const last = this.sent.at(-1);
    if (this.way.script === 'engine.js') this.sent = [];
    else if (last && performance.now() - last.at < kPatience) {
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

  wantTiles(wanted: TileName[], taken: number) {
    if (this.ready) this.post({kind: 'tiles', wanted, taken});
  }

  limit(limits: Limits) {
    if (
      limits.cacheBytes === this.limits.cacheBytes &&
      limits.bytesPerSecond === this.limits.bytesPerSecond
    )
      return;
    this.limits = limits;
    this.post({kind: 'limit', limits});
  }

  close() {
    this.closed = true;
    clearTimeout(this.timer);
    this.stop();
  }
}
