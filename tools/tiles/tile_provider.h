// SPDX-License-Identifier: Apache-2.0
// TileProvider: the files of a tree of tiles, each made when somebody asks for it.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "query/surface.h"
#include "store/base/status.h"
#include "tools/tiles/tile_files.h"
#include "tools/tiles/tile_format.h"
#include "tools/tiles/tile_level.h"

namespace mtdb {

// About what Make() needs of temporary files for an object of so many triangles.
uint64_t TileProviderBytes(uint64_t triangles);

// Has each level cut and sorted in temporary files, as WriteTileSet() has one after the other; so
// what it gives is what that one writes, byte for byte. Any thread may read.
class TileProvider final : public TileFiles {
 public:
  // `format` as it was made. Reads the whole object, and the finest level takes most of it. Errors:
  // kCancelled, those of the surface and of files.
  static Result<std::unique_ptr<TileFiles>> Make(const Surface& surface,
                                                 std::unique_ptr<TileFormat> format,
                                                 const TileFilesOptions& options);

  uint64_t file_bytes() const override { return file_bytes_; }
  Result<std::unique_ptr<const TileContent>> Find(const std::string& path) const override;

 private:
  explicit TileProvider(uint64_t most_triangles) : most_triangles_(most_triangles) {}

  const uint64_t most_triangles_;
  std::unique_ptr<TileFormat> format_;
  std::vector<std::unique_ptr<PreparedLevel>> levels_;
  std::map<std::string, std::string> files_;  // beside the tiles, by name
  uint64_t file_bytes_ = 0;
};

}  // namespace mtdb
