// SPDX-License-Identifier: Apache-2.0
#include "tools/server/internal/server_tiles.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <string_view>
#include <utility>

#include "store/base/hash.h"

namespace mtdb::internal {

namespace {

constexpr std::array<std::string_view, 4> kServedFormats{"3dtiles", "quantized-mesh", "terrain-rgb",
                                                         "neuroglancer"};
constexpr size_t kFormatAt = 2;  // in the path
// Of the bytes that a tree has: another program may make others of the same object.
constexpr std::string_view kTileVersion = "1";

Status SetOptions(const std::string& text, TileChoice* choice) {
  for (size_t begin = 0; begin <= text.size();) {
    const size_t end = std::min(text.find('&', begin), text.size());
    const std::string option = text.substr(begin, end - begin);
    const size_t equals = option.find('=');
    if (equals == std::string::npos) {
      return InvalidArgument("options of tiles: " + Unexpected(option, "NAME=VALUE").message());
    }
    MTDB_RETURN_IF_ERROR(
        SetTileOption(option.substr(0, equals), option.substr(equals + 1), choice));
    begin = end + 1;
  }
  return Status::Ok();
}

}  // namespace

bool IsTileTarget(const RequestTarget& target) {
  const std::vector<std::string>& path = target.path;
  return path.size() > kFormatAt + 1 && path[0] == "objects" && !path[1].empty() &&
         std::find(kServedFormats.begin(), kServedFormats.end(), path[kFormatAt]) !=
             kServedFormats.end();
}

Result<TileTarget> ParseTileTarget(const RequestTarget& target) {
  TileTarget tile;
  tile.choice.format = target.path[kFormatAt];
  size_t next = kFormatAt + 1;
  if (target.path[next].find('=') != std::string::npos) {
    MTDB_RETURN_IF_ERROR(SetOptions(target.path[next++], &tile.choice));
  }
  for (; next < target.path.size(); ++next) {
    tile.file += (tile.file.empty() ? "" : "/") + target.path[next];
  }
  for (const auto& [name, value] : target.parameters) {
    if (name != "v") {
      return InvalidArgument(name +
                             ": no such parameter; known is v, and options of tiles stand in the "
                             "path, as in /objects/NAME/3dtiles/pixels=4/tileset.json");
    }
    tile.version = value;
  }
  return tile;
}

std::string TileTag(const ObjectRecord& record, const std::string& tree, const std::string& file) {
  const std::string all = tree + '\n' + file + '\n' + std::string(kTileVersion);
  char hash[24];
  std::snprintf(hash, sizeof(hash), "%016llx",
                static_cast<unsigned long long>(Hash64(AsBytes(all))));
  return '"' + record.digest_hex() + "-" + hash + '"';
}

bool HasTag(const std::string& if_none_match, const std::string& tag) {
  return if_none_match == "*" || if_none_match.find(tag) != std::string::npos;
}

const char* FirstFileOf(const TileChoice& choice) {
  if (choice.format == "quantized-mesh") return "layer.json";
  if (choice.format == "neuroglancer") return "segment_properties/info";
  return choice.format == "terrain-rgb" ? "tiles.json" : "tileset.json";
}

const char* TileContentType(const std::string& file) {
  if (file.ends_with(".json") || file.ends_with("info")) return "application/json";
  if (file.ends_with(".glb")) return "model/gltf-binary";
  if (file.ends_with(".terrain")) return "application/vnd.quantized-mesh";
  if (file.ends_with(".png")) return "image/png";
  return "application/octet-stream";
}

ServedTiles::Tree ServedTiles::Find(const std::string& name) {
  const std::lock_guard lock(mutex_);
  const auto at = std::find_if(entries_.begin(), entries_.end(),
                               [&](const Entry& entry) { return entry.name == name; });
  if (at == entries_.end()) return nullptr;
  std::rotate(at, at + 1, entries_.end());
  return entries_.back().tree;
}

ServerMetrics::Shared ServedTiles::figures() {
  const std::lock_guard lock(mutex_);
  uint64_t bytes = 0;
  for (const Entry& entry : entries_) bytes += entry.tree->file_bytes();
  return {bytes, most_bytes_, evictions_};
}

Status ServedTiles::Reserve(uint64_t bytes) {
  if (bytes > most_bytes_) {
    return {StatusCode::kUnsupported, "tiles of this object take about " + std::to_string(bytes) +
                                          " bytes of temporary files, but this server has " +
                                          std::to_string(most_bytes_) +
                                          " for all tiles (--tile-space); `mtdb tile` writes them "
                                          "into a folder instead"};
  }
  std::vector<Entry> closed;  // after the lock
  const std::lock_guard lock(mutex_);
  uint64_t taken = reserved_bytes_ + bytes;
  for (const Entry& entry : entries_) taken += entry.tree->file_bytes();
  while (taken > most_bytes_ && !entries_.empty()) {
    ++evictions_;
    taken -= entries_.front().tree->file_bytes();
    closed.push_back(std::move(entries_.front()));
    entries_.erase(entries_.begin());
  }
  if (taken > most_bytes_) return {StatusCode::kBusy, "other trees of tiles are being made"};
  reserved_bytes_ += bytes;
  return Status::Ok();
}

Result<ServedTiles::Tree> ServedTiles::Open(
    const std::string& name, uint64_t bytes,
    const std::function<Result<std::unique_ptr<TileFiles>>()>& make) {
  if (Tree tree = Find(name)) return tree;
  MTDB_ASSIGN_OR_RETURN(const NamedLocks::Held making, making_.Take(name));
  if (Tree tree = Find(name)) return tree;
  MTDB_RETURN_IF_ERROR(Reserve(bytes));
  const auto give_back = [this](uint64_t* reserved) {
    const std::lock_guard lock(mutex_);
    reserved_bytes_ -= *reserved;
  };
  const std::unique_ptr<uint64_t, decltype(give_back)> reserved(&bytes, give_back);
  MTDB_ASSIGN_OR_RETURN(Tree tree, make());
  const std::lock_guard lock(mutex_);
  entries_.push_back({name, tree});
  return tree;
}

}  // namespace mtdb::internal
