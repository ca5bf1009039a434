// SPDX-License-Identifier: Apache-2.0
// The worker of one session: it has the WebSocket and the mesh (decoder.wasm), and tells the page
// what changes. While the page has not taken an update, further ones are gathered into one.
import type {Point} from './query';
import type {MeshUpdate, Slots, ValueChoice} from './source';

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

export type ToDecoder =
  | {kind: 'open'; url: string; remember: number; types: string[]; stretch: Point}
  | {kind: 'ask'; id: number; query: unknown}
  | {kind: 'choose'; values: ValueChoice}
  | {kind: 'taken'};

export type FromDecoder =
  | {kind: 'hello'; hello: {max_triangles: number; triangles: number}}
  | {kind: 'update'; update: MeshUpdate | null; answers: unknown[]; bytes: number; milliseconds: number}
  | {kind: 'closed'; opened: boolean; code: number; sentence: string};

const sizes: Record<string, number> = {int8: 1, uint8: 1, int16: 2, uint16: 2, int32: 4, uint32: 4, float32: 4, float64: 8};
const kSpareVertices = 1024;

let wasm: Exports;
let socket: WebSocket | null = null;
let opened = false;
let fresh = true;
let dirty = false;
let taken = true;
let answers: unknown[] = [];
let bytes = 0;
let milliseconds = 0;
let types: string[] = [];
let values: ValueChoice = {kind: 'none'};
let valuesAll = false; // all vertices are to be told anew
let valueRange: [number, number] | null = null;
let remember = 0;
let stretch: Point = [1, 1, 1];

const post = (message: FromDecoder, transfer: Transferable[] = []) => (self as unknown as Worker).postMessage(message, transfer);

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
  const system = new Proxy({}, {
    get: (_, name) => (name === 'proc_exit' ? () => { throw new Error('the decoder ended'); } : nothing),
    has: () => true,
  });
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
      close(full ? 'This page has no more memory for the mesh; ask for fewer triangles.' : `The mesh cannot be read: ${(error as Error).message}.`, -1);
    }
  };
}

function onText(text: string) {
  const message = JSON.parse(text);
  if (message.hello) {
    const hello = message.hello;
    if (hello.protocol !== 1) return close(`The server speaks version ${Number(hello.protocol)} of the protocol, and this page version 1; load the page anew.`, -1);
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
    const why = new TextDecoder().decode(new Uint8Array(wasm.memory.buffer, wasm.error(), wasm.error_size()));
    return close(`The server sent what is no mesh: ${why}.`, -1);
  }
  dirty = true;
  milliseconds += performance.now() - begin;
  flush();
}

// The elements of ranges of slots, `count` a slot.
function gather<T extends Uint32Array | Float32Array | Int16Array>(Kind: new (length: number) => T, all: T, ranges: Uint32Array, count: number): Slots<T> {
  let size = 0;
  for (let i = 0; i < ranges.length; i += 2) size += ranges[i + 1]! - ranges[i]!;
  const data = new Kind(size * count);
  for (let i = 0, at = 0; i < ranges.length; i += 2) {
    data.set(all.subarray(ranges[i]! * count, ranges[i + 1]! * count) as never, at);
    at += (ranges[i + 1]! - ranges[i]!) * count;
  }
  return {ranges, data};
}

function offsetOf(attribute: number) {
  let offset = 0;
  for (let i = 0; i < attribute; ++i) offset += sizes[types[i]!]!;
  return offset;
}

function reader(view: DataView, type: string): (at: number) => number {
  switch (type) {
    case 'int8': return at => view.getInt8(at);
    case 'uint8': return at => view.getUint8(at);
    case 'int16': return at => view.getInt16(at, true);
    case 'uint16': return at => view.getUint16(at, true);
    case 'int32': return at => view.getInt32(at, true);
    case 'uint32': return at => view.getUint32(at, true);
    case 'float32': return at => view.getFloat32(at, true);
    default: return at => view.getFloat64(at, true);
  }
}

// A colour's component as 0 .. 255.
const components: Record<string, (value: number) => number> = {uint8: v => v, uint16: v => v / 257, float32: v => v * 255, float64: v => v * 255};

function gatherValues(ranges: Uint32Array, rowBytes: number, slots: number): MeshUpdate['values'] {
  if (values.kind === 'none' || rowBytes === 0) return null;
  const all = valuesAll ? new Uint32Array([0, slots]) : ranges;
  valuesAll = false;
  let size = 0;
  for (let i = 0; i < all.length; i += 2) size += all[i + 1]! - all[i]!;
  const view = new DataView(wasm.memory.buffer, wasm.rows(), slots * rowBytes);
  if (values.kind === 'colour') {
    const data = new Uint8Array(4 * size);
    const read = values.attributes.map(a => ({get: reader(view, types[a]!), offset: offsetOf(a), level: components[types[a]!] ?? ((v: number) => v)}));
    for (let i = 0, at = 0; i < all.length; i += 2) {
      for (let v = all[i]!; v < all[i + 1]!; ++v, at += 4) {
        for (let k = 0; k < 3; ++k) data[at + k] = Math.max(0, Math.min(255, read[k]!.level(read[k]!.get(v * rowBytes + read[k]!.offset))));
        data[at + 3] = 255;
      }
    }
    return {ranges: all, data};
  }
  const data = new Float32Array(size);
  const get = reader(view, types[values.attribute]!);
  const offset = offsetOf(values.attribute);
  let [low, high] = valueRange ?? [Infinity, -Infinity];
  for (let i = 0, at = 0; i < all.length; i += 2) {
    for (let v = all[i]!; v < all[i + 1]!; ++v, ++at) {
      const value = get(v * rowBytes + offset);
      data[at] = value;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  valueRange = low <= high ? [low, high] : null;
  return {ranges: all, data};
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
  const triangles = ranges(triangleRanges!), vertices = ranges(vertexRanges!), changedNormals = ranges(normalRanges!);
  const counts = new Uint32Array(buffer, wasm.counts(), 5).slice();
  const slots = counts[3]!;
  const update: MeshUpdate = {
    fresh, triangles: counts[0]!, vertices: counts[1]!, triangleSlots: counts[2]!, vertexSlots: slots,
    origin: [...new Float64Array(buffer, wasm.origin(), 3)] as MeshUpdate['origin'],
    indices: gather(Uint32Array, new Uint32Array(buffer, wasm.indices(), 3 * counts[2]!), triangles, 3),
    positions: gather(Float32Array, new Float32Array(buffer, wasm.positions(), 3 * slots), vertices, 3),
    normals: gather(Int16Array, new Int16Array(buffer, wasm.normals(), 4 * slots), changedNormals, 4),
    values: gatherValues(vertices, counts[4]!, slots), valueRange,
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
  const transfer = update ? [update.indices, update.positions, update.normals, ...(update.values ? [update.values] : [])].map(s => s.data.buffer) : [];
  taken = false;
  post({kind: 'update', update, answers, bytes, milliseconds}, transfer);
  answers = [];
  milliseconds = 0;
}

self.onmessage = (event: MessageEvent<ToDecoder>) => {
  const message = event.data;
  switch (message.kind) {
    case 'open':
      types = message.types;
      remember = message.remember;
      stretch = message.stretch;
      void open(message.url);
      break;
    case 'ask':
      if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({id: message.id, query: message.query}));
      break;
    case 'choose':
      values = message.values;
      valuesAll = true;
      valueRange = null;
      dirty = opened;
      if (opened) flush();
      break;
    case 'taken':
      taken = true;
      flush();
  }
};
