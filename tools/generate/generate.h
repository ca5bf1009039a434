// SPDX-License-Identifier: Apache-2.0
// Meshes of any size to feed the rest of mtdb: shapes that are rough at every scale, streamed.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "store/base/mesh_sink.h"
#include "store/base/status.h"

namespace mtdb {

struct GenerateOptions {
  uint64_t triangles = 0;  // wanted: 100 .. 20e9
  uint64_t seed = 1;
};

// Sends a closed, outward-oriented, connected manifold of genus above zero: a weathered stone of
// four rings, marching cubes over a displaced implicit function (sculpture_field.h). The same seed
// gives the same shape at every size, finer sampled. The count is met within 3 %. Below 1,000
// triangles the cells are too coarse for all this: closed and manifold still, but the rings may
// fall apart. Vertices come before the triangles that name them, positions are float32 values;
// counts are not known at Begin. Memory: proportional to the square root of the count (one slab of
// blocks along the surface). Errors: kInvalidArgument for a count out of range; the sink's.
Status GenerateSculpture(const GenerateOptions& options, MeshSink& sink);

// Sends a height field over the square [0, 10] x [0, 10], some 2 high, with an open border: a
// mountain range of damped fractal noise, two triangles a grid cell. Row by row; counts are known
// at Begin. Otherwise as GenerateSculpture.
Status GenerateTerrain(const GenerateOptions& options, MeshSink& sink);

// Sends what is not a manifold: a dented torus around z, of which ten patches with a third of the
// area have an opposite copy of each triangle; fins, one for 400 triangles, of 36 to 192 triangles,
// that hang along paths of its edges, so that three sheets meet there; for two fins three flaps,
// each two opposite triangles that hang on an edge or a vertex; and crumbs, one for 80 triangles,
// tetrahedra and octahedra of an edge's size that float above it. No edge has sheets that
// disagree in orientation. The count is met within 3 % from 5,000 triangles on; below 800 there is
// the torus alone. Memory: constant. Otherwise as GenerateSculpture.
Status GenerateSheets(const GenerateOptions& options, MeshSink& sink);

struct GenerateReport {
  uint64_t vertices = 0, triangles = 0;  // that were written
};

// Writes "sculpture", "terrain" or "sheets" to `output_path`, as its extension says: as binary
// little-endian PLY (float32 positions, uint32 indices), or as another of
// codecs/mesh_file/mesh_file.h, for which the whole mesh is held in memory. The file appears under
// its name when it is complete. PLY takes, while it is written, the space of the faces twice.
// Errors: kInvalidArgument (another shape; a count out of range, which ends where 32-bit indices
// do), kNoSpace, kIoError.
Status GenerateFile(std::string_view shape, const GenerateOptions& options,
                    const std::string& output_path, GenerateReport* report = nullptr);

}  // namespace mtdb
