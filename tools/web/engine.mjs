// SPDX-License-Identifier: Apache-2.0
// Compiles the engine, for the package and for the viewer's page.
import {dirname, join} from 'node:path';
import {fileURLToPath} from 'node:url';
import {compileWasm, readLines} from '../viewer/steps.mjs';

const source = dirname(fileURLToPath(import.meta.url));
const root = join(source, '../..');

export const engineSources = () => [...readLines(join(root, 'query/engine_sources.txt')), ...readLines(join(source, 'engine_sources.txt'))];

// What a flight does for each node, and where a cluster's bits are decoded, is made fast.
const kFast = [
  'codecs/cluster/cluster.cc', 'codecs/cluster/cluster_codec.cc', 'codecs/coding/cluster_model.cc',
  'codecs/coding/hole_frame.cc', 'codecs/coding/patch.cc', 'codecs/coding/rans.cc',
  'query/cut/judge.cc', 'query/cut/survey.cc',
];
// What comes next; all else is made small.
const kLessSmall = ['query/fields/convex.cc', 'query/fields/threshold.cc', 'query/moving/moving_survey.cc'];
const optionsOf = sources => {
  for (const file of [...kFast, ...kLessSmall]) {
    if (!sources.includes(file)) throw new Error(`tools/web/engine.mjs: ${file} is no source of the engine`);
  }
  return file => (kFast.includes(file) ? ['-O2', '-msimd128'] : [kLessSmall.includes(file) ? '-Os' : '-Oz']);
};

export const compileEngine = ({build, cxx, launcher, out}) => compileWasm({
  root, build, cxx, launcher, out, stackBytes: 1048576, sources: engineSources(),
  headers: ['xxhash.h', 'zstd.h', 'zstd_errors.h'],
  optimize: optionsOf(engineSources()),
  flags: [],
});
