// SPDX-License-Identifier: Apache-2.0
#include "builder/intake/memory_plan.h"

#include <algorithm>
#include <string>

#include "builder/disk/tile.h"
#include "builder/tiles/round_level.h"
#include "builder/tiles/tile_cutter.h"

namespace mtdb::internal {

namespace {

constexpr uint64_t kMiB = uint64_t{1} << 20;
// The program, a reader's buffers, what the writer queues (32 MiB) and LMDB copies of it.
constexpr uint64_t kFixedBytes = 128 * kMiB;
// A thread's decimator and encoder on a tile of 8192 triangles, the surface beneath that, and its
// share of tiles on their way, without attributes. Where that surface may have more triangles, of
// small objects (kMostSurface), it is in the place of spools that stay empty.
constexpr uint64_t kThreadBytes = 24 * kMiB;
constexpr uint64_t kThreadTriangles = 8192;
constexpr uint64_t kLeastSpoolBytes = 64 * kMiB;
// A cluster's payload is at most 1 GiB, a root piece's 1 MiB (store/FORMAT.md).
constexpr uint64_t kMaxTileRowBytes = 1024 * kMiB;
constexpr uint64_t kMaxRowBytes = 256 << 10;

// What the coder's log takes for a value at most: 6 bytes an entry, of its length in steps of 15,
// two bits, and the rest in words of 16 bits.
uint64_t LogBytes(ScalarType type) {
  const uint64_t bits = 8 * ScalarSize(type);
  return 6 * (bits / 15 + 1 + 2 + (bits + 15) / 16);
}

// What attributes add, in bytes.
struct AttributeCost {
  uint64_t tile = 0;    // each tile on its way
  uint64_t worker = 0;  // each thread at work
  uint64_t writer = 0;  // once: the tile being noted down and stored
};

AttributeCost CostOf(const AttributeLayout& attributes, uint64_t tile_triangles) {
  constexpr uint64_t kModelBytes = 4096;  // of a channel in the coder
  const uint64_t row = attributes.row_bytes();
  uint64_t log = 0;
  for (const VertexAttribute& a : attributes.attributes) log += LogBytes(a.type);
  // A tile has as many vertices as triangles at most, if any of them can be removed, and half as
  // many are.
  const uint64_t vertex_rows = tile_triangles * row;
  AttributeCost cost;
  cost.tile = 3 * vertex_rows;  // of its corners
  // The encoder's two copies of the vertices' rows, log and payload; or the rows that are left.
  cost.worker = std::max(2 * vertex_rows + tile_triangles / 2 * (log + row), cost.tile) +
                kModelBytes * attributes.attributes.size();
  cost.writer = 2 * vertex_rows;
  return cost;
}

}  // namespace

Result<MemoryPlan> PlanMemory(const BuildOptions& options, unsigned threads,
                              const AttributeLayout& vertex_attributes, bool textured) {
  AttributeLayout attributes = vertex_attributes;
  if (textured) {
    const AttributeLayout corners = CornerLayout(0);
    attributes.attributes.insert(attributes.attributes.end(), corners.attributes.begin(),
                                 corners.attributes.end());
  }
  const uint64_t row = attributes.row_bytes();
  if (row > kMaxRowBytes || row * options.tile_triangles > kMaxTileRowBytes) {
    const uint64_t most = std::min(kMaxRowBytes, kMaxTileRowBytes / options.tile_triangles);
    return Unsupported("attributes of " + std::to_string(row) + " bytes a vertex: at most " +
                       std::to_string(most) + " are supported; leave some out");
  }
  const AttributeCost cost = CostOf(attributes, options.tile_triangles);
  const uint64_t thread_bytes = kThreadBytes *
                                std::max<uint64_t>(options.tile_triangles, kThreadTriangles) /
                                kThreadTriangles;
  const uint64_t window = TileCutter::WindowBytes(options.tile_triangles, row);
  const auto need = [&](uint64_t workers, uint64_t ahead) {
    return kFixedBytes + window + workers * (thread_bytes + cost.worker) + ahead * cost.tile +
           cost.writer + kLeastSpoolBytes;
  };
  for (unsigned workers = threads; workers >= 1; --workers) {
    const size_t most = workers == 1 ? 1 : 3 * size_t{workers};
    const size_t least = workers == 1 ? 1 : workers + size_t{1};
    for (size_t ahead = most; ahead >= least; --ahead) {
      const uint64_t bytes = need(workers, ahead);
      if (bytes > options.memory_bytes) continue;
      return MemoryPlan{workers, ahead, options.memory_bytes - bytes + kLeastSpoolBytes};
    }
  }
  return Status(StatusCode::kBudgetExceeded,
                std::to_string(attributes.attributes.size()) + " attributes of " +
                    std::to_string(row) + " bytes a vertex need at least " +
                    std::to_string((need(1, 1) + kMiB - 1) / kMiB) + " MiB, " +
                    std::to_string(options.memory_bytes / kMiB) +
                    " MiB are allowed; allow more --memory, or leave attributes out");
}

uint64_t TemporaryBytes(const BuildOptions& options, uint64_t triangles, size_t row_bytes,
                        uint64_t spool_bytes) {
  // Of a triangle: its corners as the join answers them, in a run of the sorter, left for the next
  // round, and in a SurfaceSpool. Neighbours that follow each other take half of it.
  const uint64_t answers = 3 * (11 + row_bytes);
  const uint64_t run = 30 + 3 * row_bytes;
  const auto left = static_cast<uint64_t>(static_cast<double>(run + 10) *
                                          RoundLevel::MostLeft(options.reduction));
  constexpr uint64_t kSurface = 20;
  const uint64_t need = triangles * (answers + run + left + kSurface);
  return need <= spool_bytes ? 0 : need;
}

}  // namespace mtdb::internal
