// SPDX-License-Identifier: Apache-2.0
// The file of a texture's tiles: sizes of levels, where tiles lie, and what of a damaged file is
// refused.
#include "store/texture_tiles.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <map>

#include "store/base/hash.h"
#include "store/tiles_head.h"

namespace mtdb::testing {

using namespace internal;

namespace {

constexpr TiledPage::Kind kJpeg = TiledPage::Kind::kJpeg;

// Bytes that tell which tile they stand for.
Bytes BytesOf(const TilePlace& place) {
  const std::string text = std::to_string(place.page) + "," + std::to_string(place.level) + "," +
                           std::to_string(place.column) + "," + std::to_string(place.row);
  Bytes bytes;
  for (const char c : text) bytes.push_back(static_cast<std::byte>(c));
  return bytes;
}

template <typename F>
void ForEachTile(const std::vector<TiledPage>& pages, uint32_t level, F&& f) {
  for (uint32_t p = 0; p < pages.size(); ++p) {
    if (level >= pages[p].levels) continue;
    for (uint32_t row = 0; row < pages[p].rows_of(level); ++row) {
      for (uint32_t column = 0; column < pages[p].columns_of(level); ++column) {
        f(TilePlace{p, level, column, row});
      }
    }
  }
}

// As store/FORMAT.md has it.
Bytes FileOf(const std::vector<TiledPage>& pages) {
  TilesHead head;
  head.pages = pages;
  for (const TiledPage& page : pages) {
    head.levels.resize(std::max<size_t>(head.levels.size(), page.levels));
  }
  Bytes body;
  for (uint32_t level = static_cast<uint32_t>(head.levels.size()); level-- > 0;) {
    std::vector<TileEntry> index;
    Bytes tiles;
    ForEachTile(pages, level, [&](const TilePlace& place) {
      const Bytes tile = BytesOf(place);
      index.push_back({static_cast<uint32_t>(tile.size()), static_cast<uint32_t>(Hash64(tile))});
      tiles.insert(tiles.end(), tile.begin(), tile.end());
    });
    const Bytes encoded = EncodeTileIndex(index, level);
    head.levels[level] = {head.bytes() + body.size(), encoded.size() + tiles.size()};
    body.insert(body.end(), encoded.begin(), encoded.end());
    body.insert(body.end(), tiles.begin(), tiles.end());
  }
  Bytes file = EncodeTilesHead(head);
  file.insert(file.end(), body.begin(), body.end());
  return file;
}

Result<std::shared_ptr<const TextureTiles>> Open(const Bytes& file) {
  return TextureTiles::Open("object x", file.size(), [file](uint64_t offset, uint64_t bytes) {
    // Whoever asks for more than there is does not get this far.
    REQUIRE(offset + bytes <= file.size());
    const auto begin = file.begin() + static_cast<ptrdiff_t>(offset);
    return Result<Bytes>(Bytes(begin, begin + static_cast<ptrdiff_t>(bytes)));
  });
}

const std::vector<TiledPage> kPages{TiledPage::Of(1300, 700, kJpeg), TiledPage{},
                                    TiledPage::Of(120, 1, TiledPage::Kind::kPng),
                                    TiledPage::Of(121, 505, kJpeg)};

}  // namespace

TEST_CASE("a page has levels of half the size, down to one of 120 pixels a side") {
  const TiledPage page = TiledPage::Of(1300, 701, kJpeg);
  CHECK(page.levels == 5);
  const std::vector<std::pair<uint32_t, uint32_t>> sizes{
      {1300, 701}, {650, 351}, {325, 176}, {163, 88}, {82, 44}};
  for (uint32_t level = 0; level < page.levels; ++level) {
    CHECK(std::pair(page.width_of(level), page.height_of(level)) == sizes[level]);
  }
  CHECK(page.columns_of(0) == 3);
  CHECK(page.rows_of(0) == 2);
  CHECK(page.columns_of(1) == 2);
  CHECK(page.rows_of(1) == 1);
  CHECK(TiledPage::Of(1, 1, kJpeg).levels == 1);
  CHECK(TiledPage::Of(120, 120, kJpeg).levels == 1);
  CHECK(TiledPage::Of(121, 1, kJpeg).levels == 2);
  CHECK(TiledPage::Of(504, 1, kJpeg).columns_of(0) == 1);
  CHECK(TiledPage::Of(505, 1, kJpeg).columns_of(0) == 2);
}

TEST_CASE("each tile of a file is found, and no other") {
  const auto tiles = Open(FileOf(kPages)).value();
  CHECK(tiles->pages() == kPages);
  size_t count = 0;
  for (uint32_t level = 0; level < 5; ++level) {
    ForEachTile(kPages, level, [&](const TilePlace& place) {
      ++count;
      CHECK(tiles->Tile(place).value() == BytesOf(place));
    });
  }
  CHECK(count == 17);
  for (const TilePlace& place :
       {TilePlace{1, 0, 0, 0}, TilePlace{4, 0, 0, 0}, TilePlace{0, 5, 0, 0}, TilePlace{0, 0, 3, 0},
        TilePlace{0, 0, 0, 2}, TilePlace{2, 1, 0, 0}}) {
    CHECK(tiles->Tile(place).status().code() == StatusCode::kInvalidArgument);
  }
}

TEST_CASE("a file without a tile is as good as another") {
  CHECK(Open(FileOf({TiledPage{}})).value()->pages().size() == 1);
  CHECK(Open(FileOf({})).value()->pages().empty());
}

TEST_CASE("of a damaged file of tiles no wrong byte comes out, wherever it is damaged") {
  const Bytes file = FileOf(kPages);
  for (size_t at = 0; at < file.size(); ++at) {
    Bytes other = file;
    other[at] ^= std::byte{0x41};
    const auto tiles = Open(other);
    if (!tiles.ok()) {
      CHECK((tiles.status().code() == StatusCode::kCorrupt ||
             tiles.status().code() == StatusCode::kUnsupported));
      continue;
    }
    size_t refused = 0;
    for (uint32_t level = 0; level < 5; ++level) {
      ForEachTile(kPages, level, [&](const TilePlace& place) {
        const Result<Bytes> tile = (*tiles)->Tile(place);
        if (!tile.ok()) {
          ++refused;
          CHECK(tile.status().code() == StatusCode::kCorrupt);
        } else {
          CHECK(*tile == BytesOf(place));
        }
      });
    }
    CHECK(refused > 0);
  }
}

TEST_CASE("a file of tiles that is cut off anywhere is refused") {
  const Bytes file = FileOf(kPages);
  for (size_t size = 0; size < file.size(); ++size) {
    const auto tiles = Open(Bytes(file.begin(), file.begin() + static_cast<ptrdiff_t>(size)));
    CHECK(tiles.status().code() == StatusCode::kCorrupt);
  }
}

TEST_CASE(
    "a head of another version, or with impossible numbers behind a right checksum, is refused") {
  const Bytes file = FileOf(kPages);
  TilesHead head;
  {
    const uint64_t bytes = TilesHeadBytes(file, "x").value();
    head = DecodeTilesHead(ByteSpan(file).first(bytes), file.size(), "x").value();
  }
  const auto refuses = [&](const TilesHead& other) {
    const Bytes bytes = EncodeTilesHead(other);
    return DecodeTilesHead(bytes, file.size(), "x").status().code() == StatusCode::kCorrupt;
  };
  CHECK(!refuses(head));
  TilesHead other = head;
  other.pages[0].levels = 4;
  CHECK(refuses(other));
  other = head;
  other.pages[0].width = 0;
  CHECK(refuses(other));
  other = head;
  other.pages[0] = TiledPage::Of(1 << 20, 1 << 20, kJpeg);  // more tiles than there are bytes
  CHECK(refuses(other));
  other = head;
  other.pages[1].width = 5;
  CHECK(refuses(other));
  other = head;
  std::swap(other.levels[0], other.levels[1]);
  CHECK(refuses(other));
  other = head;
  other.levels[0].bytes += 1;
  CHECK(refuses(other));
  other = head;
  other.levels[0].bytes = ~uint64_t{0};
  CHECK(refuses(other));
  Bytes later = file;
  later[4] = std::byte{2};
  CHECK(Open(later).status().code() == StatusCode::kUnsupported);
}

}  // namespace mtdb::testing
