// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/verify/tile_files.h"

#include <filesystem>
#include <system_error>
#include <utility>

#include "tools/request/read_file.h"
#include "tools/tiles/archive/pmtiles.h"
#include "tools/tiles/archive/three_tz.h"

namespace mtdb {

namespace {

class FolderFiles final : public TileFiles {
 public:
  explicit FolderFiles(std::string folder) : folder_(std::move(folder)) {}
  // Below the folder, whatever a tileset calls it.
  Result<std::string> Read(const std::string& name) const override {
    if (name.empty() || name.starts_with("/") || name.starts_with("..")) {
      return BadInput("lies outside of the folder");
    }
    std::error_code error;
    const std::string path = folder_ + "/" + name;
    if (!std::filesystem::is_regular_file(path, error)) return BadInput("is not there, or no file");
    return ReadFile(path);
  }

 private:
  const std::string folder_;
};

}  // namespace

Result<std::unique_ptr<TileFiles>> OpenTileFiles(const std::string& path) {
  if (path.ends_with(".3tz")) return OpenThreeTz(path);
  if (path.ends_with(".pmtiles")) return OpenPmtiles(path);
  return std::unique_ptr<TileFiles>(std::make_unique<FolderFiles>(path));
}

}  // namespace mtdb
