// SPDX-License-Identifier: Apache-2.0
// A packed file on any web server (`?src=`): all is done in this page, by workers (engine.ts).
import type {Question, Reply} from './engine';
import type {HalfSpace, Point, Query} from './query';
import {StoreError} from './source';
import type {
  Hit,
  MeshListener,
  MeshSource,
  ObjectEntry,
  ObjectInfo,
  Store,
  TakenMesh,
  Way,
} from './source';
import {stretchOf} from './stretch';
import {WorkerSession} from './worker_session';

type Asked = Question extends infer Q
  ? Q extends {id: number}
    ? Omit<Q, 'id' | 'url'>
    : never
  : never;

// Which packed file the page is to show, or why it does not.
export function sourceOf(search: string, page: URL): URL | StoreError | null {
  const text = new URLSearchParams(search).get('src');
  return text === null ? null : ownUrl(text, page);
}

// A file that the page may read, or why it does not.
export function ownUrl(text: string, page: URL): URL | StoreError {
  let url: URL;
  try {
    url = new URL(text, page);
  } catch {
    return new StoreError(`“${text}” is no address of a file.`, 'address');
  }
  if (url.origin === page.origin && /^https?:$/.test(url.protocol)) return url;
  // As the page's policy has it: workers have none of their own where a server sends no headers.
  const policy =
    document.querySelector<HTMLMetaElement>('meta[http-equiv="Content-Security-Policy"]')
      ?.content ?? '';
  const allowed = /connect-src([^;]*)/.exec(policy)?.[1]?.trim().split(/\s+/) ?? [];
  if (allowed.includes(url.origin) && /^https?:$/.test(url.protocol)) return url;
  return new StoreError(
    `This page reads files of its own server only, and ${url.host || text} is another one. Whoever runs this page can allow it: mtdb view --write-page … --allowed-source ${url.origin}`,
    'foreign',
  );
}

export class PackedStore implements Store {
  readonly ways: readonly Way[] = ['thick'];
  readonly formats = ['ply', 'obj', 'stl', 'glb'];
  private worker: Worker | null = null;
  private readonly waiting = new Map<
    number,
    {done: (reply: Reply) => void; fail: (error: Error) => void}
  >();
  private nextId = 1;

  constructor(private readonly url: URL) {}

  private helper(): Worker {
    if (this.worker) return this.worker;
    const worker = new Worker(new URL('engine.js', import.meta.url), {type: 'module'});
    worker.onmessage = (event: MessageEvent<Reply>) => {
      const reply = event.data,
        asked = this.waiting.get(reply.id);
      this.waiting.delete(reply.id);
      if (reply.kind === 'refused')
        asked?.fail(new StoreError(this.sentenceFor(reply), reply.code));
      else asked?.done(reply);
    };
    worker.onerror = () => {
      this.worker = null;
      for (const {fail} of this.waiting.values())
        fail(new StoreError('The engine could not be started; load the page anew.', 'engine'));
      this.waiting.clear();
    };
    this.worker = worker;
    return worker;
  }

  private sentenceFor(refusal: Reply & {kind: 'refused'}) {
    return refusal.code === 'not_found'
      ? `There is no file “${decodeURIComponent(this.url.pathname.split('/').at(-1)!)}” on the server of this page.`
      : refusal.sentence;
  }

  private ask<Kind extends Reply['kind']>(
    question: Asked,
    signal?: AbortSignal,
  ): Promise<Reply & {kind: Kind}> {
    const id = this.nextId++;
    return new Promise((done, fail) => {
      this.waiting.set(id, {done: done as (reply: Reply) => void, fail});
      this.helper().postMessage({...question, id, url: this.url.href});
      signal?.addEventListener('abort', () => {
        if (!this.waiting.delete(id)) return;
        this.helper().postMessage({kind: 'forget', id} satisfies Question);
        fail(new DOMException('not wanted any more', 'AbortError'));
      });
    });
  }

  async objects(): Promise<ObjectEntry[]> {
    return (await this.ask<'objects'>({kind: 'objects'})).objects;
  }

  async info(name: string): Promise<ObjectInfo> {
    const info = (await this.ask<'objects'>({kind: 'objects'})).objects.find(
      o => o.object === name,
    );
    if (!info) throw new StoreError(`There is no object “${name}” in this file.`, 'no_such_object');
    return info;
  }

  async probe(
    object: string,
    origin: Point,
    direction: Point,
    signal?: AbortSignal,
  ): Promise<Hit | null> {
    return (await this.ask<'probe'>({kind: 'probe', object, origin, direction}, signal)).hit;
  }

  async mesh(
    object: string,
    query: Query,
    format: string,
    planes: HalfSpace[] = [],
  ): Promise<TakenMesh> {
    return await this.ask<'mesh'>({kind: 'mesh', object, query, format, planes});
  }

  open(name: string, _: Way, listener: MeshListener): MeshSource {
    return new WorkerSession(name, listener, {
      script: 'engine.js',
      info: () => this.info(name),
      open: info => ({
        kind: 'open_packed',
        url: this.url.href,
        object: name,
        byHash: false,
        types: info.attributes.map(a => a.type),
        stretch: stretchOf(info),
      }),
    });
  }
}
