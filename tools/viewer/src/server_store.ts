// SPDX-License-Identifier: Apache-2.0
// A store behind `mtdb serve` (docs/protocol.md). Thin: the server cuts, a session brings what
// changes, and a worker (decoder.ts) keeps the mesh. Thick: the server reads ranges of the object
// as a packed file.
import {PackedStore} from './packed_store';
import type {HalfSpace, Point, Query} from './query';
import {StoreError} from './source';
import {stretchOf} from './stretch';
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
import {WorkerSession} from './worker_session';

const kRemember = 65536; // removed vertices that need not travel again

const unreachable = 'The server cannot be reached; is mtdb still running?';

async function errorOf(response: Response): Promise<StoreError> {
  try {
    const body = await response.json();
    return new StoreError(String(body.error), String(body.code));
  } catch {
    // Not mtdb: one in front of it may answer until it is back.
    return new StoreError(
      `The server answered ${response.status} ${response.statusText}`,
      response.status >= 500 ? 'unreachable' : 'http',
    );
  }
}

export class ServerStore implements Store {
  readonly ways: readonly Way[] = ['thick', 'thin'];
  readonly formats = ['ply', 'obj', 'stl', 'glb', 'drc'];

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
    try {
      return (await (await this.get('objects')).json()).objects;
    } catch (error) {
      // Not what mtdb answers.
      if (!(error instanceof StoreError) || error.code === 'http')
        throw new StoreError(
          'There is no mtdb behind this page. Name a packed file of this web server in the address: ?src=FILE, as mtdb pack makes it.',
          'not_found',
        );
      throw error;
    }
  }

  async info(name: string): Promise<ObjectInfo> {
    return await (await this.get(`objects/${encodeURIComponent(name)}`)).json();
  }

  async probe(
    name: string,
    origin: Point,
    direction: Point,
    signal?: AbortSignal,
  ): Promise<Hit | null> {
    const answer = await (
      await this.get(
        `objects/${encodeURIComponent(name)}/probe?ray=${[...origin, ...direction].join(',')}`,
        {signal: signal ?? null},
      )
    ).json();
    return answer.hit ? {point: answer.point, error_bound: answer.error_bound} : null;
  }

  // What is cut along planes is cut in this page.
  async mesh(
    name: string,
    query: Query,
    format: string,
    planes: HalfSpace[] = [],
  ): Promise<TakenMesh> {
    if (planes.length > 0)
      return await new PackedStore(this.url(`objects/${encodeURIComponent(name)}/packed`)).mesh(
        name,
        query,
        format,
        planes,
      );
    const response = await this.get(`objects/${encodeURIComponent(name)}/mesh?format=${format}`, {
      method: 'POST',
      body: JSON.stringify(query),
    });
    const blob = await response.blob().catch(() => {
      throw new StoreError('The connection broke off before the whole mesh had come', 'broken');
    });
    return {
      blob,
      triangles: Number(response.headers.get('X-Mtdb-Triangles')),
      errorBound: Number(response.headers.get('X-Mtdb-Error-Bound')),
    };
  }

  open(name: string, way: Way, listener: MeshListener): MeshSource {
    const info = () => this.info(name),
      types = (i: ObjectInfo) => i.attributes.map(a => a.type);
    if (way === 'thick') {
      const url = this.url(`objects/${encodeURIComponent(name)}/packed`).href;
      return new WorkerSession(name, listener, {
        script: 'engine.js',
        info,
        open: i => ({
          kind: 'open_packed',
          url,
          object: name,
          byHash: true,
          types: types(i),
          stretch: stretchOf(i),
        }),
      });
    }
    const url = this.url(`objects/${encodeURIComponent(name)}/session?remember=${kRemember}`);
    url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
    return new WorkerSession(name, listener, {
      script: 'decoder.js',
      info,
      open: i => ({
        kind: 'open',
        url: url.href,
        remember: kRemember,
        types: types(i),
        stretch: stretchOf(i),
      }),
    });
  }
}
