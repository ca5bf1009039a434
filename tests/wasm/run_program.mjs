// SPDX-License-Identifier: Apache-2.0
// Runs a program that was compiled to WebAssembly, in node and in browsers alike: with the calls of WASI that one needs which
// reads its standard input, or the one file that its command line names, and prints. (node:wasi of node 20 crashes.)
export async function runProgram(module, input, file = '') {
  let at = 0, memory = null, printed = '';
  const view = () => new DataView(memory.buffer), text = bytes => new TextDecoder().decode(bytes);
  const eachBuffer = (list, count, out, use) => {
    let sum = 0;
    for (let i = 0; i < count; ++i) sum += use(view().getUint32(list + 8 * i, true), view().getUint32(list + 8 * i + 4, true));
    view().setUint32(out, sum, true);
    return 0;
  };
  const words = ['program', ...(file ? [file] : [])].map(word => new TextEncoder().encode(word + '\0'));
  const calls = {
    args_sizes_get: (count, size) => {
      view().setUint32(count, words.length, true);
      view().setUint32(size, words.reduce((sum, word) => sum + word.length, 0), true);
      return 0;
    },
    args_get: (list, to) => {
      for (const [i, word] of words.entries()) {
        new Uint8Array(memory.buffer).set(word, to);
        view().setUint32(list + 4 * i, to, true);
        to += word.length;
      }
      return 0;
    },
    fd_prestat_get: (fd, to) => { if (fd !== 3) return 8; view().setUint8(to, 0); view().setUint32(to + 4, 1, true); return 0; },
    fd_prestat_dir_name: (_, to) => { view().setUint8(to, 47); return 0; },
    fd_fdstat_get: (fd, to) => {
      view().setUint8(to, fd < 3 ? 2 : fd === 3 ? 3 : 4);
      view().setUint16(to + 2, 0, true);
      for (const rights of [8, 16]) view().setBigUint64(to + rights, ~0n & 0xffffffffffffffffn, true);
      return 0;
    },
    path_open: (...args) => { view().setUint32(args[8], 4, true); return 0; },
    fd_read: (_, list, count, out) => eachBuffer(list, count, out, (to, size) => {
      const part = input.subarray(at, at + size);
      new Uint8Array(memory.buffer).set(part, to);
      at += part.length;
      return part.length;
    }),
    fd_write: (_, list, count, out) => eachBuffer(list, count, out, (from, size) => {
      printed += text(new Uint8Array(memory.buffer, from, size));
      return size;
    }),
    fd_close: () => 0,
    fd_seek: () => 29, // ESPIPE
    clock_time_get: (...args) => { view().setBigUint64(args[2], BigInt(Math.round(performance.now() * 1e6)), true); return 0; },
    proc_exit: code => { throw new Error(`the program ended with ${code}: ${printed}`); },
  };
  const imports = {};
  for (const {module: from, name} of WebAssembly.Module.imports(module)) (imports[from] ??= {})[name] = calls[name] ?? (() => 52); // ENOSYS
  const {exports} = await WebAssembly.instantiate(module, imports);
  memory = exports.memory;
  exports._start();
  return printed.replace(/\n+$/, '');
}
