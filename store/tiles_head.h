// SPDX-License-Identifier: Apache-2.0
// The head and the indexes of the file of a texture's tiles, in bytes. See store/FORMAT.md,
// "Tiles".
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/texture_tiles.h"

namespace mtdb::internal {

// What the head of the file says.
struct TilesHead {
  struct Level {
    uint64_t offset = 0, bytes = 0;  // with its index
    friend bool operator==(const Level&, const Level&) = default;
  };
  std::vector<TiledPage> pages;
  std::vector<Level> levels;  // by number: 0 is the finest

  // Of the pages' tiles of a level; and the number of one of these among them.
  uint64_t TilesOf(uint32_t level) const;
  uint64_t NumberOf(const TilePlace& place) const;
  uint64_t bytes() const;  // of the head itself
};

// The bytes of the head of a file whose levels have these pages' tiles; and back. `file_bytes`: of
// the whole file. Errors: kCorrupt; kUnsupported (a version that is not known). `where` names the
// object.
Bytes EncodeTilesHead(const TilesHead& head);
Result<TilesHead> DecodeTilesHead(ByteSpan bytes, uint64_t file_bytes, const std::string& where);
// How many bytes the head has, from the first 16 of the file. Errors: likewise.
inline constexpr size_t kTilesHeadStart = 16;
Result<uint64_t> TilesHeadBytes(ByteSpan start, const std::string& where);

// The index of a level: for each tile its length, and its checksum.
struct TileEntry {
  uint32_t bytes = 0;
  uint32_t checksum = 0;  // the lower half of Hash64
};
inline constexpr uint64_t kTileEntryBytes = 8;
Bytes EncodeTileIndex(std::span<const TileEntry> tiles, uint32_t level);

inline constexpr uint64_t kMostTiles = uint64_t{1} << 24;
// What ends a head and an index.
inline constexpr size_t kTileChecksumBytes = 8;
uint64_t TileIndexSeed(uint32_t level);

// An error of this file of an object.
Status DamagedTiles(const std::string& where, const std::string& what);

}  // namespace mtdb::internal
