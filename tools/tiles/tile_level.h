// SPDX-License-Identifier: Apache-2.0
// PreparedLevel: a level of a tree of tiles, cut and sorted, from which each tile can be encoded.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "query/surface.h"
#include "store/base/status.h"
#include "tools/tiles/level/level_mesh.h"
#include "tools/tiles/level/tile_buckets.h"
#include "tools/tiles/tile_format.h"

namespace mtdb {

struct PrepareOptions {
  std::string tmp_directory;         // of temporary files
  uint64_t memory_bytes = 64 << 20;  // for sorting
  // Called again and again with what is going on and how many triangles are done with; an error
  // ends the work. May be null.
  std::function<Status(const char* what, uint64_t triangles)> tell;
};

// In temporary files. Any thread may encode tiles of it.
class PreparedLevel {
 public:
  // The level that `query`, which is the format's next one, asks for; null: the format passes it
  // over. Errors: those of the surface and of files, and of `tell`.
  static Result<std::unique_ptr<PreparedLevel>> Make(const Surface& surface, TileFormat& format,
                                                     const Query& query,
                                                     const PrepareOptions& options);

  const LevelMesh& mesh() const { return mesh_; }
  uint32_t tiles() const { return tiles_; }
  // Triangles of a tile, before any are added or left out.
  uint64_t CountOf(uint32_t tile) const { return buckets_.Count(tile); }
  uint64_t file_bytes() const { return mesh_.file_bytes() + buckets_.file_bytes(); }
  // A tile's file; `triangles` is for the caller to keep its memory.
  Result<TileFile> Encode(TileFormat& format, TileId id,
                          std::vector<LevelTriangle>* triangles) const;

 private:
  PreparedLevel(TileFormat& format, const PrepareOptions& options);
  Status Sort(TileFormat& format, const PrepareOptions& options);

  LevelMesh mesh_;
  TileBuckets buckets_;
  uint32_t tiles_ = 0;
};

}  // namespace mtdb
