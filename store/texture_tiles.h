// SPDX-License-Identifier: Apache-2.0
// The tiles of a texture: its pages in levels of half the size, each cut into small images, so that
// a picture takes no more than it shows. Format: store/FORMAT.md, "Tiles".
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/cluster_source.h"

namespace mtdb {

namespace internal {
struct TilesHead;
}

inline constexpr uint32_t kTileSide = 504;  // pixels of a level that a tile shows, at most
inline constexpr uint32_t kTileMargin = 4;  // more of them, on each side
inline constexpr uint32_t kMostPageSide = 1 << 20;

// What the tiles say of a page. Level l is the page scaled by 2^-l.
struct TiledPage {
  enum class Kind : uint8_t { kJpeg = 0, kPng = 1 };
  uint32_t width = 0, height = 0;  // pixels
  uint32_t levels = 0;             // 0: the page has no tiles
  Kind kind = Kind::kJpeg;

  // Of the level, in pixels and in tiles.
  uint32_t width_of(uint32_t level) const { return Scaled(width, level); }
  uint32_t height_of(uint32_t level) const { return Scaled(height, level); }
  uint32_t columns_of(uint32_t level) const { return TilesAcross(width_of(level)); }
  uint32_t rows_of(uint32_t level) const { return TilesAcross(height_of(level)); }

  // A page of this size with all its levels.
  static TiledPage Of(uint32_t width, uint32_t height, Kind kind);
  friend bool operator==(const TiledPage&, const TiledPage&) = default;

 private:
  static uint32_t Scaled(uint32_t side, uint32_t level) {
    return static_cast<uint32_t>((uint64_t{side} + (uint64_t{1} << level) - 1) >> level);
  }
  static uint32_t TilesAcross(uint32_t side) { return (side + kTileSide - 1) / kTileSide; }
};

// Which tile.
struct TilePlace {
  uint32_t page = 0, level = 0, column = 0, row = 0;
  friend auto operator<=>(const TilePlace&, const TilePlace&) = default;
};

// Reads tiles out of their file. Keeps the indexes of levels that were used: eight bytes a tile.
// Safe for many threads.
class TextureTiles {
 public:
  // Bytes of the file; safe for many threads.
  using Read = std::function<Result<Bytes>(uint64_t offset, uint64_t bytes)>;

  // Reads the head. `where` names the object. Errors: kCorrupt, kUnsupported (a version that is not
  // known), those of `read`.
  static Result<std::shared_ptr<const TextureTiles>> Open(std::string where, uint64_t file_bytes,
                                                          Read read);
  // The tiles of a textured object; null when it has none.
  static Result<std::shared_ptr<const TextureTiles>> Open(std::shared_ptr<ClusterSource> source);

  ~TextureTiles();

  const std::vector<TiledPage>& pages() const;
  // The tile as an image file, after its checksum was compared. Errors: kInvalidArgument (no such
  // tile), kCorrupt, those of `read`.
  Result<Bytes> Tile(const TilePlace& place) const;

 private:
  struct LevelIndex {
    std::vector<uint64_t> ends;  // of the tiles, from the first one's beginning
    std::vector<uint32_t> checksums;
  };
  TextureTiles(std::string where, Read read, std::unique_ptr<const internal::TilesHead> head);
  Result<std::shared_ptr<const LevelIndex>> IndexOf(uint32_t level) const;

  const std::string where_;
  const Read read_;
  const std::unique_ptr<const internal::TilesHead> head_;
  mutable std::mutex mutex_;
  mutable std::vector<std::shared_ptr<const LevelIndex>> indexes_;  // by level
};

}  // namespace mtdb
