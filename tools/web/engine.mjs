// SPDX-License-Identifier: Apache-2.0
// Compiles the engine, for the package and for the viewer's page.
import {dirname, join} from 'node:path';
import {fileURLToPath} from 'node:url';
import {compileWasm, readLines} from '../viewer/steps.mjs';

const source = dirname(fileURLToPath(import.meta.url));
const root = join(source, '../..');

export const engineSources = () => [...readLines(join(root, 'query/engine_sources.txt')), ...readLines(join(source, 'engine_sources.txt'))];

// What runs seldom is made small.
const isSeldom = file => /^tools|^store|json|region|camera|probe|promise|missing|query\/cut\.cc|surface\.cc|cluster_cache|reads|unit_reader|available|session|batches|root_codec|streams|explicit|circle_masks|convex|segment_tree|threshold|spill|kept_triangles|unit_image|compact_cluster|strength|survey|insertion|removal|search|moving|budget|levels|scaled|cut_impl|root_numbering|loaded_unit|attribute_coder|lattice|vertical|stored_order|update_batches/.test(file);
// What a flight does for each node, and where a cluster's bits are decoded.
const isFlown = file => /internal\/(survey|convex|judge)\.cc|query\/threshold\.cc|wasm\/engine\.cc/.test(file);
const isDecoding = file => file.startsWith('codecs/c') && !/lattice/.test(file) && !isSeldom(file);

export const compileEngine = ({build, cxx, launcher, out}) => compileWasm({
  root, build, cxx, launcher, out, stackBytes: 1048576, sources: engineSources(),
  headers: ['xxhash.h', 'zstd.h', 'zstd_errors.h'],
  optimize: file => (isFlown(file) || isDecoding(file) ? ['-O2', '-msimd128'] : isSeldom(file) ? ['-Oz'] : ['-Os']),
  flags: [],
});
