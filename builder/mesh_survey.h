// SPDX-License-Identifier: Apache-2.0
// SurveyMesh: what a mesh is like before it is stored, and which accuracy suits it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "builder/build_options.h"
#include "store/base/grid.h"
#include "store/base/mesh_sink.h"
#include "store/base/status.h"

namespace mtdb {

// What decided on the grid's step.
enum class GridReason : uint8_t {
  kGiven,         // bits, step or mode of the options
  kLeastBits,     // 16 bits are enough
  kEdges,         // the step is at most a quarter of the edges' first percentile
  kSlivers,       // a coarser step would take the area of thin triangles
  kDecimals,      // the coordinates are multiples of the step: they are kept as they are written
  kSomeDecimals,  // those of some axes are, such as heights
};

// The lengths of a mesh's edges, in model units; percentiles are up to 4 % too small.
struct EdgeLengths {
  double shortest = 0;
  double percentile1 = 0;
  double median = 0;
  double longest = 0;
};

// Vertices so far off the others that a grid over all of them is too coarse for the mesh.
struct FarVertices {
  uint64_t count = 0;
  uint64_t vertices = 0;           // all that triangles use
  std::optional<uint64_t> vertex;  // the first of the far ones, by its number in the input
  Vec3d position;                  // of that one
  Box3d others;                    // where the others are
};
// "3 of the 3601 vertices lie far off the others (... to ...): the first is vertex 3598 ...".
std::string FarVerticesText(const FarVertices& far);

// How triangles agree about the outside. A sheet is what hangs together across edges of two
// triangles (builder/surface/sheet_links.h).
struct SheetReport {
  uint64_t inconsistent_edges = 0;   // of two triangles that run along it in the same direction
  uint64_t unorientable_sheets = 0;  // have one side only, as a Moebius band
  uint64_t turned_triangles = 0;     // that BuildOptions::orient turns over, or would
};

// What a mesh is like before it is built, and what its grid does to it.
struct MeshSurvey {
  MeshHeader header;             // attributes as they are stored
  uint64_t vertices = 0;         // of a soup after equal positions were joined; less welded ones
  uint64_t welded_vertices = 0;  // that became others
  // Not joined, though they lie where others do; and whether `weld` would join some along an edge
  // that different attributes keep apart. 0 and false with `weld` or `keep_apart`.
  uint64_t equal_vertices = 0;
  bool attributes_differ = false;
  uint64_t triangles = 0;       // as read
  uint64_t kept_triangles = 0;  // less those with two equal vertices, welded ones too
  uint64_t flat_triangles = 0;  // of the kept ones: without area, as exact as coordinates are
  Box3d bounds;                 // of the vertices that triangles use
  EdgeLengths edges;            // without edges of length 0
  std::optional<uint64_t> components;  // SurveyMesh() only
  SheetReport sheets;
  bool oriented = false;  // BuildOptions::orient
  Grid grid;
  uint8_t bits = 0;
  GridReason reason = GridReason::kGiven;
  // Triangles that are not flat, and whose corners the grid rounds to points of one line. Lossless:
  // 0, as are the edges and flat_triangles of BuildObject.
  uint64_t collapsed_triangles = 0;
  uint64_t collapsed_at_16_bits = 0;  // likewise, if the grid were one of 16 bits
  // Set when the grid is too coarse for the mesh's edges, and that is why.
  std::optional<FarVertices> far_vertices;
  // Why BuildObject would refuse the mesh: a grid that leaves too many triangles no area. Ok: it
  // would not.
  Status refusal;
  bool fits_float32 = false;  // PositionMode::kLossless is possible. When collapsed or refused
  // The grid that would be chosen, when it is not `grid`, for advice: bits and step.
  uint8_t advised_bits = 0;
  double advised_step = 0;
  uint64_t store_bytes = 0;      // about what the object will take
  uint64_t temporary_bytes = 0;  // at most what the temporary files will take; 0: memory suffices
};

// Says all that is known of a mesh before it is built, the mesh's components included, and which
// grid BuildObject would choose; stores nothing. Out of core, within options.memory_bytes; the
// components are left out when their table, of four bytes a vertex, does not fit. Errors: those of
// BuildObject that concern the input, the options and the temporary files; but a mesh that is
// refused for what its grid would do to it is surveyed, and MeshSurvey::refusal says why.
Result<MeshSurvey> SurveyMesh(const MeshProducer& input, const BuildOptions& options);

}  // namespace mtdb
