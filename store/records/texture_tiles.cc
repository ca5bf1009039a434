// SPDX-License-Identifier: Apache-2.0
#include "store/texture_tiles.h"

#include <utility>

#include "store/base/hash.h"
#include "store/base/out_of_memory.h"
#include "store/tiles_head.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr uint32_t kCoarsestSide = 120;

}  // namespace

TiledPage TiledPage::Of(uint32_t width, uint32_t height, Kind kind) {
  TiledPage page{width, height, 1, kind};
  while (page.width_of(page.levels - 1) > kCoarsestSide ||
         page.height_of(page.levels - 1) > kCoarsestSide) {
    ++page.levels;
  }
  return page;
}

TextureTiles::TextureTiles(std::string where, Read read,
                           std::unique_ptr<const internal::TilesHead> head)
    : where_(std::move(where)),
      read_(std::move(read)),
      head_(std::move(head)),
      indexes_(head_->levels.size()) {}

TextureTiles::~TextureTiles() = default;

const std::vector<TiledPage>& TextureTiles::pages() const { return head_->pages; }

Result<std::shared_ptr<const TextureTiles>> TextureTiles::Open(std::string where,
                                                               uint64_t file_bytes, Read read) {
  return CatchOutOfMemory([&]() -> Result<std::shared_ptr<const TextureTiles>> {
    if (file_bytes < kTilesHeadStart) return DamagedTiles(where, "the head is cut off");
    MTDB_ASSIGN_OR_RETURN(const Bytes start, read(0, kTilesHeadStart));
    MTDB_ASSIGN_OR_RETURN(const uint64_t bytes, TilesHeadBytes(start, where));
    if (bytes > file_bytes) return DamagedTiles(where, "the head is cut off");
    MTDB_ASSIGN_OR_RETURN(const Bytes read_head, read(0, bytes));
    MTDB_ASSIGN_OR_RETURN(TilesHead head, DecodeTilesHead(read_head, file_bytes, where));
    return std::shared_ptr<const TextureTiles>(new TextureTiles(
        std::move(where), std::move(read), std::make_unique<const TilesHead>(std::move(head))));
  });
}

Result<std::shared_ptr<const TextureTiles>> TextureTiles::Open(
    std::shared_ptr<ClusterSource> source) {
  const ObjectRecord& record = source->record();
  if (!record.texture || record.texture->tiles.bytes == 0) {
    return std::shared_ptr<const TextureTiles>();
  }
  const uint32_t file = record.texture->files() - 1;
  const uint64_t bytes = record.texture->tiles.bytes;
  const std::string where = "object " + record.name;
  return Open(where, bytes, [source = std::move(source), file](uint64_t offset, uint64_t count) {
    return source->ReadTextureFile(file, offset, count);
  });
}

Result<std::shared_ptr<const TextureTiles::LevelIndex>> TextureTiles::IndexOf(
    uint32_t level) const {
  {
    const std::lock_guard lock(mutex_);
    if (indexes_[level]) return indexes_[level];
  }
  const uint64_t count = head_->TilesOf(level);
  const uint64_t bytes = kTileEntryBytes * count + kTileChecksumBytes;
  MTDB_ASSIGN_OR_RETURN(const Bytes read, read_(head_->levels[level].offset, bytes));
  const ByteSpan entries = ByteSpan(read).first(read.size() - kTileChecksumBytes);
  ByteReader r(read);
  auto index = std::make_shared<LevelIndex>();
  index->ends.reserve(count);
  index->checksums.reserve(count);
  uint64_t end = 0;
  for (uint64_t i = 0; i < count; ++i) {
    end += r.Get<uint32_t>();
    index->ends.push_back(end);
    index->checksums.push_back(r.Get<uint32_t>());
  }
  if (r.Get<uint64_t>() != Hash64(entries, TileIndexSeed(level)) ||
      bytes + end != head_->levels[level].bytes) {
    return DamagedTiles(where_, "the index of level " + std::to_string(level) + " is wrong");
  }
  const std::lock_guard lock(mutex_);
  indexes_[level] = std::move(index);
  return indexes_[level];
}

Result<Bytes> TextureTiles::Tile(const TilePlace& place) const {
  return CatchOutOfMemory([&]() -> Result<Bytes> {
    const std::string name = "tile " + std::to_string(place.column) + ", " +
                             std::to_string(place.row) + " of level " +
                             std::to_string(place.level) + " of page " + std::to_string(place.page);
    const bool there = place.page < head_->pages.size() &&
                       place.level < head_->pages[place.page].levels &&
                       place.column < head_->pages[place.page].columns_of(place.level) &&
                       place.row < head_->pages[place.page].rows_of(place.level);
    if (!there) return InvalidArgument(where_ + ": its texture has no " + name);
    MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<const LevelIndex> index, IndexOf(place.level));
    const uint64_t number = head_->NumberOf(place);
    const uint64_t begin = number == 0 ? 0 : index->ends[number - 1];
    const uint64_t first = head_->levels[place.level].offset +
                           kTileEntryBytes * index->ends.size() + kTileChecksumBytes;
    MTDB_ASSIGN_OR_RETURN(Bytes tile, read_(first + begin, index->ends[number] - begin));
    if (static_cast<uint32_t>(Hash64(tile)) != index->checksums[number]) {
      return DamagedTiles(where_, name + " has a wrong checksum");
    }
    return tile;
  });
}

}  // namespace mtdb
