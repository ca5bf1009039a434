// SPDX-License-Identifier: Apache-2.0
// node run_wasi.mjs PROGRAM.wasm < INPUT: runs a program that needs standard input and output only.
import {readFileSync} from 'node:fs';
import {WASI} from 'node:wasi';
const wasi = new WASI({version: 'preview1', args: ['program'], returnOnExit: true});
const module = await WebAssembly.compile(readFileSync(process.argv[2]));
const instance = await WebAssembly.instantiate(module, {wasi_snapshot_preview1: wasi.wasiImport});
process.exitCode = wasi.start(instance);
