// SPDX-License-Identifier: Apache-2.0
// The worker of one session: it has the WebSocket and the mesh (decoder.wasm), and tells the page
// what changes. While the page has not taken an update, further ones are gathered into one.
import type {Point} from './query';
import {buffersOf, gather, ValueReader} from './slots';
import type {MeshUpdate} from './source';
import type {Answer, FromWorker, ToWorker} from './worker_session';

interface Exports {
  memory: WebAssembly.Memory;
  _initialize(): void;
  open(triangles: number, vertices: number): void;
  input(size: number): number;
  feed(): number;
  error(): number;
  error_size(): number;
  started(): number;
  counts(): number;
  origin(): number;
  indices(): number;
  positions(): number;
  normals(): number;
  rows(): number;
  take_changes(): number;
  stretch(x: number, y: number, z: number): void;
}

const kSpareVertices = 1024;

let wasm: Exports;
let socket: WebSocket | null = null;
let opened = false;
let fresh = true;
let dirty = false;
let taken = true;
let answers: Answer[] = [];
let bytes = 0;
let milliseconds = 0;
let values = new ValueReader([]);
let remember = 0;
let stretch: Point = [1, 1, 1];

const post = (message: FromWorker, transfer: Transferable[] = []) =>
  (self as unknown as Worker).postMessage(message, transfer);

function close(sentence: string, code = 0) {
  if (socket) {
    socket.onmessage = socket.onclose = socket.onerror = null;
    socket.close();
    socket = null;
  }
  post({kind: 'closed', opened, code, sentence});
}

async function loadDecoder(): Promise<Exports> {
  const nothing = () => 52; // ENOSYS
  // What the C++ library would ask of a system: it is there to say its last words, and to end.
  const system = new Proxy(
    {},
    {
      get: (_, name) =>
        name === 'proc_exit'
          ? () => {
              throw new Error('the decoder ended');
            }
          : nothing,
      has: () => true,
    },
  );
  const response = await fetch(new URL('decoder.wasm', import.meta.url));
  if (!response.ok) throw new Error(`decoder.wasm: HTTP ${response.status}`);
  const module = await WebAssembly.compile(await response.arrayBuffer());
  const imports: Record<string, Record<string, WebAssembly.ImportValue>> = {};
  for (const {module: from, name} of WebAssembly.Module.imports(module)) {
    (imports[from] ??= {})[name] = (system as Record<string, WebAssembly.ImportValue>)[name]!;
  }
  const instance = await WebAssembly.instantiate(module, imports);
  const exports = instance.exports as unknown as Exports;
  exports._initialize();
  return exports;
}

async function open(url: string) {
  try {
    wasm = await loadDecoder();
  } catch (error) {
    return close(`The decoder cannot be loaded: ${(error as Error).message}.`);
  }
  socket = new WebSocket(url);
  socket.binaryType = 'arraybuffer';
  socket.onclose = event => close('', event.code);
  socket.onmessage = event => {
    try {
      typeof event.data === 'string' ? onText(event.data) : onBytes(event.data as ArrayBuffer);
    } catch (error) {
      // WebAssembly ends by a trap when it has no more memory.
      const full = error instanceof WebAssembly.RuntimeError || error instanceof RangeError;
      close(
        full
          ? 'This page has no more memory for the mesh; ask for fewer triangles.'
          : `The mesh cannot be read: ${(error as Error).message}.`,
        -1,
      );
    }
  };
}

function onText(text: string) {
  const message = JSON.parse(text);
  if (message.hello) {
    const hello = message.hello;
    if (hello.protocol !== 1)
      return close(
        `The server speaks version ${Number(hello.protocol)} of the protocol, and this page version 1; load the page anew.`,
        -1,
      );
    opened = true;
    const most = Math.min(hello.max_triangles, 2 ** 26);
    wasm.open(most + kSpareVertices, 3 * most + remember + kSpareVertices);
    wasm.stretch(...stretch);
    post({kind: 'hello', hello});
    return;
  }
  answers.push(message);
  flush();
}

function onBytes(data: ArrayBuffer) {
  const begin = performance.now();
  bytes += data.byteLength;
  const at = wasm.input(data.byteLength);
  new Uint8Array(wasm.memory.buffer, at, data.byteLength).set(new Uint8Array(data));
  if (wasm.feed() !== 0) {
    const why = new TextDecoder().decode(
      new Uint8Array(wasm.memory.buffer, wasm.error(), wasm.error_size()),
    );
    return close(`The server sent what is no mesh: ${why}.`, -1);
  }
  dirty = true;
  milliseconds += performance.now() - begin;
  flush();
}

function makeUpdate(): MeshUpdate {
  const list = wasm.take_changes();
  const buffer = wasm.memory.buffer;
  const [triangleRanges, vertexRanges, normalRanges] = new Uint32Array(buffer, list, 3);
  let at = list + 12;
  const ranges = (count: number) => {
    const part = new Uint32Array(buffer, at, 2 * count).slice();
    at += 8 * count;
    return part;
  };
  const triangles = ranges(triangleRanges!),
    vertices = ranges(vertexRanges!),
    changedNormals = ranges(normalRanges!);
  const counts = new Uint32Array(buffer, wasm.counts(), 5).slice();
  const slots = counts[3]!;
  const update: MeshUpdate = {
    fresh,
    triangles: counts[0]!,
    vertices: counts[1]!,
    triangleSlots: counts[2]!,
    vertexSlots: slots,
    origin: [...new Float64Array(buffer, wasm.origin(), 3)] as MeshUpdate['origin'],
    indices: gather(
      Uint32Array,
      new Uint32Array(buffer, wasm.indices(), 3 * counts[2]!),
      triangles,
      3,
    ),
    positions: gather(
      Float32Array,
      new Float32Array(buffer, wasm.positions(), 3 * slots),
      vertices,
      3,
    ),
    normals: gather(
      Int16Array,
      new Int16Array(buffer, wasm.normals(), 4 * slots),
      changedNormals,
      4,
    ),
    values: values.gather(
      new Uint8Array(buffer, wasm.rows(), slots * counts[4]!),
      counts[4]!,
      slots,
      vertices,
    ),
    triangleValues: null,
    corners: null,
    pages: null,
    valueRange: values.range,
  };
  fresh = false;
  return update;
}

function flush() {
  if (!taken || (!dirty && answers.length === 0)) return;
  const begin = performance.now();
  const update = dirty && wasm.started() ? makeUpdate() : null;
  dirty = false;
  milliseconds += performance.now() - begin;
  taken = false;
  post(
    {kind: 'update', update, answers, bytes, milliseconds, load: null},
    update ? buffersOf(update) : [],
  );
  answers = [];
  milliseconds = 0;
}

self.onmessage = (event: MessageEvent<ToWorker>) => {
  const message = event.data;
  switch (message.kind) {
    case 'open':
      values = new ValueReader(message.types);
      remember = message.remember;
      stretch = message.stretch;
      void open(message.url);
      break;
    case 'ask':
      if (socket?.readyState === WebSocket.OPEN)
        socket.send(JSON.stringify({id: message.id, query: message.query}));
      break;
    case 'choose':
      values.choose(message.values);
      dirty = opened;
      if (opened) flush();
      break;
    case 'taken':
      taken = true;
      flush();
  }
};
