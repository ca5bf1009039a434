// SPDX-License-Identifier: Apache-2.0
// Compiles the engine, for the package and for the viewer's page.
import {dirname, join} from 'node:path';
import {fileURLToPath} from 'node:url';
import {compileWasm, readLines} from '../viewer/steps.mjs';

const source = dirname(fileURLToPath(import.meta.url));
const root = join(source, '../..');

export const engineSources = () => [...readLines(join(root, 'query/engine_sources.txt')), ...readLines(join(source, 'engine_sources.txt'))];

// What runs seldom is made small.
const isSeldom = file => /^tools|^store|json|region|camera|probe|promise|missing|query\/cut\.cc|surface\.cc|cluster_cache|reads|unit_reader|available|deadlines|session|batches|root_codec|streams|explicit|circle_masks|convex|segment_tree|threshold|spill|unit_image|compact_cluster|strength|survey|insertion|removal|search|moving|budget|levels|scaled|cut_impl|loaded_unit|root_numbering|lattice|attribute_coder|vertical|stored_order|update_batches/.test(file);
// Where a cluster's bits are decoded.
const isHot = file => file.startsWith('codecs/c') && !/lattice/.test(file);

export const compileEngine = ({build, cxx, launcher, out}) => compileWasm({
  root, build, cxx, launcher, out, stackBytes: 1048576, sources: engineSources(),
  headers: ['xxhash.h', 'zstd.h', 'zstd_errors.h', 'nlohmann'],
  optimize: file => (isSeldom(file) ? ['-Oz'] : isHot(file) ? ['-O2', '-msimd128'] : ['-Os']),
  flags: ['-DJSON_HAS_FILESYSTEM=0', '-DJSON_HAS_EXPERIMENTAL_FILESYSTEM=0', '-DJSON_NOEXCEPTION', '-DJSON_NO_IO'],
});
