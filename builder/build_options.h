// SPDX-License-Identifier: Apache-2.0
// BuildOptions: how a mesh is built, and what a build reports while it runs.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "store/base/grid.h"
#include "store/base/mesh_sink.h"
#include "store/base/status.h"
#include "store/object_record.h"

namespace mtdb {

struct AttributeStep {
  std::string name;
  double step = 0;  // > 0
};

// Which triangles fill the hole of a vertex that is removed from a terrain.
enum class Triangulation : uint8_t {
  kDelaunay = 0,  // codecs/FORMAT.md, "The Delaunay rule"
  // Those of the least errors. For comparisons only: on 2 of 7 million samples of a tile it was
  // farther off than promised (docs/design.md, section 8).
  kFree = 1,
};

// What makes an input a terrain: its positions are integers, (column, row, steps of height) of a
// raster's lattice, and a height field seen along z. It is built with the vertical error measure.
struct TerrainInput {
  Grid grid;  // PositionMode::kRaster: what the integers mean
  RasterFrame frame;
  std::string crs;
  Triangulation triangulation = Triangulation::kDelaunay;
  // What was done to heights while they were read.
  struct Reading {
    double rounding = 0;  // how far they were moved to be integers, at most
    uint64_t filled = 0;  // samples that got one
    uint64_t holes = 0;   // samples that have none; with any, the border is simplified, too
  };
  std::function<Reading()> reading;  // asked when the input was read
};

struct BuildOptions {
  PositionMode mode = PositionMode::kGrid;
  // Grid: cells along the longest side are 2^bits - 1; 1..24. Without bits and step, the grid is
  // chosen from the data (GridReason).
  std::optional<int> bits;
  std::optional<double> step;  // grid: model units, instead of bits
  // Refuses a grid of these options on which more than this part of the triangles lose their area;
  // and a chosen one on which a fifth of it does, when it is less than 1.
  double max_collapsed = 0.5;
  // When set, >= 0: vertices that are at most so far apart, in model units, become one, the first
  // of them with its attributes; 0: those of equal positions. A chain of near vertices becomes one
  // too. Where more than two triangles then meet in an edge, or two that run along it in the same
  // direction, the edge is non-manifold, as in any input: kept, never simplified.
  std::optional<double> weld;
  // Without `weld`, a mesh that was cut along edges, at seams of textures or face by face, is
  // joined there: vertices of equal positions and equal attributes become one where an edge between
  // such has two opposed triangles, that do not lie back to back (builder/intake/seam_join.h). This
  // keeps the vertices as they are.
  bool keep_apart = false;
  // Makes sheets consistent: what hangs together across edges of two triangles gets the orientation
  // that most of its triangles have (builder/surface/sheet_sides.h). Two-sided triangles stay as
  // they are, and so do sheets that have one side only. Normals stay, too. Not for rasters.
  bool orient = false;
  // When set, 4..16: rounds normals. nx, ny, nz (float32, side by side) keep their direction, with
  // this many bits for each of its two coordinates on the octahedron. Attributes that neither this
  // nor attribute_steps names are lossless.
  std::optional<int> normal_bits;
  // Rounds the float attributes of these names to multiples of their steps.
  std::vector<AttributeStep> attribute_steps;
  // Of textured input: u and v are rounded to multiples of this, up to 1; 0: they stay as they are.
  // None: an eighth of a texel of the largest page, 2^-15 where no size is known, and more where u
  // and v are beyond 2^22 steps; 0 when lossless.
  std::optional<double> texture_step;
  // Texture coordinates are not kept, so that seams of the texture are no creases.
  bool drop_texture = false;
  // The mesh is a height field seen along z, and becomes a terrain: it is built with the vertical
  // error measure, and keeps its own triangles at full resolution. kBadInput names the place where
  // it is none. Not lossless.
  bool height_field = false;
  // When set, the input is a terrain; mode, bits, step and weld are not for it.
  std::optional<TerrainInput> terrain;
  // What is up, any length above 0. None: a terrain's is z, else it is found from the shape
  // (store/base/estimate_up.h). It is kept for those who draw the object, and changes no triangle.
  std::optional<Vec3d> up;
  std::string units;     // of lengths, one of kLengthUnits, or empty: not said; kept, likewise
  unsigned threads = 0;  // 0: one per core. The result does not depend on it
  // The most memory that the build may take, at least 256 MiB; the rest goes to temporary files. A
  // thread takes some 24 MiB, and more with attributes (builder/intake/memory_plan.h); when the
  // memory does not suffice for all threads, fewer work. The result does not depend on it.
  uint64_t memory_bytes = uint64_t{1} << 30;
  // The folder of temporary files. They have no names, so that the system deletes them with the
  // process.
  std::string tmp_directory = ".";
  // The most that temporary files and the journal may have together; more is kBudgetExceeded.
  uint64_t max_tmp_bytes = ~uint64_t{0};
  // The file to which the build writes the results of finished tiles, so that it can go on after an
  // interruption; empty: none. It takes some 15 bytes a triangle. The build removes it when the
  // object is published, and when it fails because of its input or options. A build that is killed
  // in between leaves it: see RemoveFinishedJournal(). After a power failure it lacks at most the
  // last 64 MiB of results.
  std::string journal_path;
  std::string journal_note;  // a text that the journal keeps for who finds it, up to 64 KiB
  // Goes on with the journal's results, if the journal exists. It must be of a build of the same
  // input (triangles, attributes and their order), with the same options; threads, memory,
  // the temporary folder, up and units may be others.
  bool resume = false;
  uint32_t degree_limit = 12;      // of a removed vertex; 4..16
  uint32_t tile_triangles = 8192;  // 64..16384
  uint32_t reduction = 4;          // a round leaves about 1 / reduction of a tile's triangles
};

struct BuildProgress {
  const char* stage = "";       // "read", "join", "texture", "round", "root", "publish"
  uint32_t round = 0;           // 1 = finest; 0 outside rounds
  uint64_t triangles_done = 0;  // of the stage
  uint64_t triangles_total = 0;
  double overall = 0;      // 0..1
  uint64_t tmp_bytes = 0;  // in temporary files
};
// Called now and then, on the calling thread. An error cancels the build and is returned.
using ProgressCallback = std::function<Status(const BuildProgress&)>;

// Pushes the mesh into the sink: Begin, blocks of vertices and triangles, End.
using MeshProducer = std::function<Status(MeshSink&)>;

}  // namespace mtdb
