// SPDX-License-Identifier: Apache-2.0
#include "store/tiles_head.h"

#include <algorithm>
#include <array>
#include <bit>

#include "store/base/hash.h"
#include "store/base/texture.h"
#include "store/records/keys.h"

namespace mtdb::internal {

namespace {

constexpr std::array<char, 4> kMagic{'M', 'T', 'T', 'L'};
constexpr uint16_t kVersion = 1;
constexpr uint32_t kMostLevels = 32;
constexpr uint64_t kPageBytes = 12;
constexpr uint64_t kLevelBytes = 16;

uint64_t HeadBytes(uint64_t pages, uint64_t levels) {
  return kTilesHeadStart + kPageBytes * pages + kLevelBytes * levels + kTileChecksumBytes;
}

struct Start {
  uint16_t levels = 0;
  uint32_t pages = 0;
};

Result<Start> ReadStart(ByteReader* r, const std::string& where) {
  const auto magic = r->Get<uint32_t>();
  const auto version = r->Get<uint16_t>();
  const auto side = r->Get<uint16_t>();
  const auto margin = r->Get<uint16_t>();
  Start start;
  start.levels = r->Get<uint16_t>();
  start.pages = r->Get<uint32_t>();
  if (r->failed()) return DamagedTiles(where, "the head is cut off");
  if (magic != std::bit_cast<uint32_t>(kMagic)) return DamagedTiles(where, "no such file");
  if (version != kVersion) {
    return Unsupported(where + ": the tiles of its texture have version " +
                       std::to_string(version) + ", this program reads " +
                       std::to_string(kVersion));
  }
  if (side != kTileSide || margin != kTileMargin || start.levels > kMostLevels ||
      start.pages > kMostPages) {
    return DamagedTiles(where, "impossible numbers in the head");
  }
  return start;
}

// What a page may say.
bool Fits(const TiledPage& page) {
  if (page.levels == 0) return page == TiledPage{};
  return page.width > 0 && page.height > 0 && page.width <= kMostPageSide &&
         page.height <= kMostPageSide && page == TiledPage::Of(page.width, page.height, page.kind);
}

}  // namespace

uint64_t TilesHead::TilesOf(uint32_t level) const {
  uint64_t count = 0;
  for (const TiledPage& page : pages) {
    if (level < page.levels) count += uint64_t{page.columns_of(level)} * page.rows_of(level);
  }
  return count;
}

uint64_t TilesHead::NumberOf(const TilePlace& place) const {
  uint64_t number = 0;
  for (uint32_t p = 0; p < place.page; ++p) {
    if (place.level >= pages[p].levels) continue;
    number += uint64_t{pages[p].columns_of(place.level)} * pages[p].rows_of(place.level);
  }
  return number + uint64_t{place.row} * pages[place.page].columns_of(place.level) + place.column;
}

uint64_t TilesHead::bytes() const { return HeadBytes(pages.size(), levels.size()); }

Bytes EncodeTilesHead(const TilesHead& head) {
  ByteWriter w;
  w.Put(std::bit_cast<uint32_t>(kMagic));
  w.Put(kVersion);
  w.Put(static_cast<uint16_t>(kTileSide));
  w.Put(static_cast<uint16_t>(kTileMargin));
  w.Put(static_cast<uint16_t>(head.levels.size()));
  w.Put(static_cast<uint32_t>(head.pages.size()));
  for (const TiledPage& page : head.pages) {
    w.Put(page.width);
    w.Put(page.height);
    w.Put(static_cast<uint8_t>(page.levels));
    w.Put(static_cast<uint8_t>(page.kind));
    w.Put(uint16_t{0});
  }
  for (size_t level = head.levels.size(); level-- > 0;) {
    w.Put(head.levels[level].offset);
    w.Put(head.levels[level].bytes);
  }
  w.Put(Hash64(w.bytes(), 'L'));
  return w.Take();
}

Result<uint64_t> TilesHeadBytes(ByteSpan start, const std::string& where) {
  ByteReader r(start);
  MTDB_ASSIGN_OR_RETURN(const Start read, ReadStart(&r, where));
  return HeadBytes(read.pages, read.levels);
}

Result<TilesHead> DecodeTilesHead(ByteSpan bytes, uint64_t file_bytes, const std::string& where) {
  ByteReader r(bytes);
  MTDB_ASSIGN_OR_RETURN(const Start start, ReadStart(&r, where));
  if (bytes.size() != HeadBytes(start.pages, start.levels)) {
    return DamagedTiles(where, "the head is cut off");
  }
  ByteReader end_of(bytes.last(kTileChecksumBytes));
  if (end_of.Get<uint64_t>() != Hash64(bytes.first(bytes.size() - kTileChecksumBytes), 'L')) {
    return DamagedTiles(where, "the checksum of the head is wrong");
  }
  TilesHead head;
  head.pages.resize(start.pages);
  uint32_t most = 0;
  for (TiledPage& page : head.pages) {
    page.width = r.Get<uint32_t>();
    page.height = r.Get<uint32_t>();
    page.levels = r.Get<uint8_t>();
    const auto kind = r.Get<uint8_t>();
    const auto zero = r.Get<uint16_t>();
    if (kind > 1 || zero != 0) return DamagedTiles(where, "impossible numbers of a page");
    page.kind = static_cast<TiledPage::Kind>(kind);
    if (!Fits(page)) return DamagedTiles(where, "impossible numbers of a page");
    most = std::max(most, page.levels);
  }
  head.levels.resize(start.levels);
  uint64_t end = bytes.size();
  for (size_t level = head.levels.size(); level-- > 0;) {
    TilesHead::Level& l = head.levels[level];
    l.offset = r.Get<uint64_t>();
    l.bytes = r.Get<uint64_t>();
    if (l.offset != end || l.bytes > file_bytes - end) {
      return DamagedTiles(where, "levels that do not follow each other");
    }
    end += l.bytes;
  }
  if (most != start.levels || end != file_bytes) return DamagedTiles(where, "impossible levels");
  uint64_t tiles = 0;
  for (uint32_t level = 0; level < most; ++level) {
    const uint64_t count = head.TilesOf(level);
    tiles += count;
    if (tiles > kMostTiles ||
        head.levels[level].bytes < kTileEntryBytes * count + kTileChecksumBytes) {
      return DamagedTiles(where, "impossible numbers of tiles");
    }
  }
  return head;
}

Bytes EncodeTileIndex(std::span<const TileEntry> tiles, uint32_t level) {
  ByteWriter w;
  for (const TileEntry& tile : tiles) {
    w.Put(tile.bytes);
    w.Put(tile.checksum);
  }
  w.Put(Hash64(w.bytes(), TileIndexSeed(level)));
  return w.Take();
}

uint64_t TileIndexSeed(uint32_t level) { return MixAll('L', level); }

Status DamagedTiles(const std::string& where, const std::string& what) {
  return Corrupt(where + ": the tiles of its texture: " + what +
                 "; run verify, get the file anew or restore it from a copy");
}

}  // namespace mtdb::internal
