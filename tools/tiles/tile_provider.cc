// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/tile_provider.h"

#include <utility>

#include "store/base/out_of_memory.h"

namespace mtdb {

namespace {

// A level of an object has some 60 bytes a triangle, and all levels four thirds of the finest.
constexpr uint64_t kBytesPerTriangle = 80;

}  // namespace

uint64_t TileProviderBytes(uint64_t triangles) { return triangles * kBytesPerTriangle; }

Result<std::unique_ptr<TileFiles>> TileProvider::Make(const Surface& surface,
                                                      std::unique_ptr<TileFormat> format,
                                                      const TileFilesOptions& options) {
  std::unique_ptr<TileProvider> provider(new TileProvider(options.most_triangles));
  provider->format_ = std::move(format);
  TileFormat& tiles = *provider->format_;
  PrepareOptions prepare;
  prepare.tmp_directory = options.tmp_directory;
  prepare.tell = [control = options.control](const char*, uint64_t) {
    const bool stopped = control != nullptr && control->cancelled();
    return stopped ? Status(StatusCode::kCancelled, "cancelled") : Status::Ok();
  };
  while (std::optional<Query> query = tiles.NextLevel()) {
    query->control = options.control;
    MTDB_ASSIGN_OR_RETURN(std::unique_ptr<PreparedLevel> level,
                          PreparedLevel::Make(surface, tiles, *query, prepare));
    if (level == nullptr) continue;
    tiles.EndLevel();
    provider->file_bytes_ += level->file_bytes();
    provider->levels_.push_back(std::move(level));
  }
  MTDB_ASSIGN_OR_RETURN(auto files, tiles.Finish());
  for (auto& [name, text] : files) provider->files_.emplace(std::move(name), std::move(text));
  return std::unique_ptr<TileFiles>(std::move(provider));
}

Result<std::unique_ptr<const TileContent>> TileProvider::Find(const std::string& path) const {
  std::unique_ptr<const TileContent> content;
  if (const auto file = files_.find(path); file != files_.end()) {
    const ByteSpan text = AsBytes(file->second);
    content = std::make_unique<TileBytes>(Bytes(text.begin(), text.end()));
    return content;
  }
  const std::optional<TileId> id = format_->Find(path);
  if (!id) return content;
  const uint64_t count = levels_[id->level]->CountOf(id->tile);
  if (count > most_triangles_) {
    return Status(StatusCode::kUnsupported,
                  "the tile has " + std::to_string(count) + " triangles, but at most " +
                      std::to_string(most_triangles_) +
                      " are encoded on request; ask for smaller tiles (tile-triangles) or for a "
                      "deeper level, or let `mtdb tile` write the tree");
  }
  std::vector<LevelTriangle> triangles;
  MTDB_ASSIGN_OR_RETURN(TileFile file, levels_[id->level]->Encode(*format_, *id, &triangles));
  if (!file.bytes.empty()) content = std::make_unique<TileBytes>(std::move(file.bytes));
  return content;
}

}  // namespace mtdb
