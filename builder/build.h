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

struct BuildOptions {
  PositionMode mode = PositionMode::kGrid;
  int bits = 16;               // grid: cells along the longest side are 2^bits - 1; 1..24
  std::optional<double> step;  // grid: model units, instead of bits
  // Attributes are lossless but for these. nx, ny, nz (float32, side by side) keep their direction
  // as so many bits a component on the octahedron, 4..16; none: lossless.
  std::optional<int> normal_bits;
  // Float attributes, by name, are rounded to multiples of a step.
  std::vector<AttributeStep> attribute_steps;
  unsigned threads = 0;  // 0: one per core. The result does not depend on it
  // What the build may keep in memory; the rest goes to temporary files. At least 256 MiB. A thread
  // takes some 16 MiB of it, and attributes more: what a tile of them takes is in
  // internal/memory_plan.h, and fewer threads work where not all of them fit. The result does not
  // depend on it.
  uint64_t memory_bytes = uint64_t{1} << 30;
  std::string tmp_directory =
      ".";  // of temporary files, which have no names and go with the process
  // Where finished tiles are noted down, so that the build can go on after an interruption; empty:
  // nowhere. Takes some 25 bytes a triangle. Removed when the object is published, and when the
  // build fails for what its input or options are. Of a build that was killed in between it is
  // left: RemoveFinishedJournal(). After a power failure it lacks at most the last 64 MiB of
  // results.
  std::string journal_path;
  std::string journal_note;  // kept in it, for whoever finds it: up to 64 KiB
  // Go on with what the journal holds, if it is there. It serves only a build of the same input
  // (triangles, attributes and their order) and of the options that shape the result; threads,
  // memory and the temporary folder may be others.
  bool resume = false;
  uint32_t degree_limit = 12;  // of a removed vertex; 4..16
  uint32_t tile_triangles = 8192;
  uint32_t reduction = 4;  // a round leaves about 1 / reduction of a tile's triangles
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

// What a stage took; not in the record, which is the same however fast the machine is.
struct StageCost {
  std::string stage;       // "read", "join", "round 1", ..., "root", "publish"
  double seconds = 0;      // wall
  double cpu_seconds = 0;  // of all threads
  uint64_t tmp_bytes = 0;  // largest size of the temporary files at the stage's reports
};
struct BuildReport {
  std::vector<StageCost> stages;
  bool journal_left = false;  // the build failed, and the same one with `resume` goes on from there
};

// Pushes the mesh into the sink: Begin, blocks of vertices and triangles, End.
using MeshProducer = std::function<Status(MeshSink&)>;

// Builds the MT of the mesh that `input` produces and publishes it through `writer`. What the mesh
// has that cannot be kept is counted in the record's InputReport. Out of core: no step holds the
// whole mesh, but for the root. Deterministic: the same mesh and options give the same keys and
// values. Errors: kBadInput (no triangles, coordinates that are not finite or do not fit float32
// when lossless, indices out of range, attributes that do not fit their step), kInvalidArgument
// (options, also when the input has no such attribute, or the journal is another build's), kNoSpace
// and kIoError (temporary files; kNoSpace also when memory runs out), kBudgetExceeded (attributes,
// vertices or a root that memory_bytes are too few for, with what is needed), and what `input` and
// `writer` return. `report`, when given, says where the time went.
Result<ObjectRecord> BuildObject(const MeshProducer& input, const BuildOptions& options,
                                 ObjectWriter& writer, const ProgressCallback& progress = {},
                                 BuildReport* report = nullptr);
Result<ObjectRecord> BuildObject(const TriangleMesh& mesh, const BuildOptions& options,
                                 ObjectWriter& writer, const ProgressCallback& progress = {});

// A journal that an interrupted build has left, or that a running one writes.
struct JournalInfo {
  std::string note;     // BuildOptions::journal_note
  uint64_t bytes = 0;   // size of the file
  bool in_use = false;  // a build is running
  bool usable = false;  // it is whole at its beginning, and of this version
  // Its build ended with one of the objects that are `published` in its store, and was killed
  // before it removed the journal.
  bool finished = false;
};
// Changes nothing. Errors: kNotFound, kIoError.
Result<JournalInfo> ReadJournalInfo(const std::string& path,
                                    std::span<const ObjectRecord> published = {});
// Removes a journal that is finished and not in use, where that is permitted.
void RemoveFinishedJournal(const std::string& path, std::span<const ObjectRecord> published);

}  // namespace mtdb
