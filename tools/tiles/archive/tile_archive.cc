// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/archive/tile_archive.h"

#include <filesystem>
#include <system_error>

#include "tools/tiles/archive/pmtiles.h"
#include "tools/tiles/archive/three_tz.h"
#include "tools/tiles/json_reading.h"
#include "tools/tiles/tile_folder.h"

namespace mtdb {

bool IsTileArchive(const std::string& path) {
  return path.ends_with(".3tz") || path.ends_with(".pmtiles");
}

Status CheckTileArchive(const std::string& path, bool force) {
  std::error_code error;
  const auto status = std::filesystem::symlink_status(path, error);
  if (!std::filesystem::exists(status)) return Status::Ok();
  const auto files = OpenTileFiles(path);
  const bool is_ours = files.ok() && (*files)->Read(kTileRecord).ok();
  // Where the folder is there, a run was killed that was about to replace the archive, or had made
  // it.
  const bool goes_on = std::filesystem::is_directory(path + kArchiveParts, error);
  if ((force || goes_on) && is_ours) return Status::Ok();
  return {StatusCode::kAlreadyExists,
          path + ": is there already, and nothing was written; --replace replaces tiles by mtdb"};
}

Status PackTiles(const std::string& folder, const std::string& path) {
  try {
    MTDB_RETURN_IF_ERROR(path.ends_with(".3tz") ? PackThreeTz(folder, path)
                                                : PackPmtiles(folder, path));
  } catch (const UnexpectedJson& error) {
    return Corrupt(folder + ": " + error.what() + "; remove the folder, and begin anew");
  }
  return TileFolder::Remove(folder);
}

}  // namespace mtdb
