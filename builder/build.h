// SPDX-License-Identifier: Apache-2.0
// BuildObject: from a triangle mesh to the Multi-Triangulation in a store. Start here.
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
#include "store/database.h"
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
  // such has two opposed triangles, that do not lie back to back (internal/seam_join.h). This keeps
  // the vertices as they are.
  bool keep_apart = false;
  // When set, 4..16: rounds normals. nx, ny, nz (float32, side by side) keep their direction, with
  // this many bits for each of its two coordinates on the octahedron. Attributes that neither this
  // nor attribute_steps names are lossless.
  std::optional<int> normal_bits;
  // Rounds the float attributes of these names to multiples of their steps.
  std::vector<AttributeStep> attribute_steps;
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
  // thread takes some 24 MiB, and more with attributes (internal/memory_plan.h); when the memory
  // does not suffice for all threads, fewer work. The result does not depend on it.
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
  const char* stage = "";       // "read", "join", "round", "root", "publish"
  uint32_t round = 0;           // 1 = finest; 0 outside rounds
  uint64_t triangles_done = 0;  // of the stage
  uint64_t triangles_total = 0;
  double overall = 0;      // 0..1
  uint64_t tmp_bytes = 0;  // in temporary files
};
// Called now and then, on the calling thread. An error cancels the build and is returned.
using ProgressCallback = std::function<Status(const BuildProgress&)>;

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

// What a stage took. This is not in the record, which does not depend on the machine's speed.
struct StageCost {
  std::string stage;       // "read", "join", "round 1", ..., "root", "publish"
  double seconds = 0;      // wall
  double cpu_seconds = 0;  // of all threads
  uint64_t tmp_bytes = 0;  // largest size of the temporary files at the stage's reports
};
struct BuildReport {
  std::vector<StageCost> stages;
  MeshSurvey survey;
  bool journal_left = false;  // the build failed, and the same one with `resume` goes on from there
};

// Pushes the mesh into the sink: Begin, blocks of vertices and triangles, End.
using MeshProducer = std::function<Status(MeshSink&)>;

// Builds the Multi-Triangulation of the mesh that `input` produces, and publishes it through
// `writer`. The record's InputReport counts what the mesh has that cannot be kept. Out of core: no
// step holds the whole mesh, except that the root is held as a whole. Deterministic: the same mesh
// and options give the same keys and values. `report`, when given, says where the time went.
//
// Errors: kBadInput (no triangles; coordinates that are not finite, or do not fit float32 when
// lossless; indices out of range; attributes that do not fit their step), kInvalidArgument (wrong
// options, or such as name an attribute that the input does not have, or a grid on which most
// triangles have no area, which is kBadInput when no grid suits the mesh; the journal of another
// build), kNoSpace and kIoError (temporary files; kNoSpace also when memory runs out),
// kBudgetExceeded (memory_bytes is too little for the attributes, the vertices or the root, and the
// message says how much is needed; or max_tmp_bytes is reached), and those of `input` and `writer`.
Result<ObjectRecord> BuildObject(const MeshProducer& input, const BuildOptions& options,
                                 ObjectWriter& writer, const ProgressCallback& progress = {},
                                 BuildReport* report = nullptr);
Result<ObjectRecord> BuildObject(const TriangleMesh& mesh, const BuildOptions& options,
                                 ObjectWriter& writer, const ProgressCallback& progress = {});

// A journal that an interrupted build has left, or that a running one writes.
struct JournalInfo {
  std::string note;     // BuildOptions::journal_note
  uint64_t bytes = 0;   // size of the file
  bool in_use = false;  // a running build has locked it
  bool usable = false;  // its header is whole, and of this version
  // True when its build had published one of the objects of `published`, and was killed before it
  // removed the journal.
  bool finished = false;
};
// `published`: the objects of the store that the journal's note names. Changes nothing. Errors:
// kNotFound, kIoError.
Result<JournalInfo> ReadJournalInfo(const std::string& path,
                                    std::span<const ObjectRecord> published = {});
// Removes the journal when it is finished, or empty since its build was killed at
// once, and not in use, and when the process may remove it.
void RemoveFinishedJournal(const std::string& path, std::span<const ObjectRecord> published);

}  // namespace mtdb
