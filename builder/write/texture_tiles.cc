// SPDX-License-Identifier: Apache-2.0
#include "builder/write/texture_tiles.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <memory>
#include <optional>
#include <utility>

#include "builder/disk/parallel.h"
#include "codecs/image_file/encode_image.h"
#include "store/base/hash.h"

namespace mtdb::internal {

namespace {

constexpr int kQuality = 90;
// Of an image that is not in rows; the same for all builds, so that what is stored does not depend
// on their memory.
constexpr uint64_t kMostAtOnce = uint64_t{208} << 20;
// Palettes and the like, of which each pixel counts.
constexpr uint32_t kSmallPage = 256;

// Of sRGB, to light and back, in steps of 1/65535.
class LightTables {
 public:
  LightTables() {
    for (size_t i = 0; i < light_.size(); ++i) {
      const double s = static_cast<double>(i) / 255;
      const double l = s <= 0.04045 ? s / 12.92 : std::pow((s + 0.055) / 1.055, 2.4);
      light_[i] = static_cast<uint16_t>(std::lround(65535 * l));
    }
    for (size_t i = 0; i < shade_.size(); ++i) {
      const double l = static_cast<double>(i) / 65535;
      const double s = l <= 0.0031308 ? 12.92 * l : 1.055 * std::pow(l, 1 / 2.4) - 0.055;
      shade_[i] = static_cast<uint8_t>(std::lround(255 * s));
    }
  }
  uint32_t Light(uint8_t shade) const { return light_[shade]; }
  uint8_t Shade(uint32_t light) const { return shade_[light]; }

 private:
  std::array<uint16_t, 256> light_;
  std::array<uint8_t, 65536> shade_;
};

const LightTables& Tables() {
  static const LightTables kTables;
  return kTables;
}

// The mean of some pixels: of opaque ones, and of those with alpha.
void MeanOf3(std::span<const uint8_t* const> pixels, uint8_t* out) {
  const auto count = static_cast<uint32_t>(pixels.size());
  for (size_t c = 0; c < 3; ++c) {
    uint32_t sum = count / 2;
    for (const uint8_t* const p : pixels) sum += Tables().Light(p[c]);
    out[c] = Tables().Shade(sum / count);
  }
}

void MeanOf4(std::span<const uint8_t* const> pixels, uint8_t* out) {
  const auto count = static_cast<uint32_t>(pixels.size());
  uint32_t alpha = 0;
  for (const uint8_t* const p : pixels) alpha += p[3];
  out[3] = static_cast<uint8_t>((alpha + count / 2) / count);
  if (alpha == 0) return MeanOf3(pixels, out);
  for (size_t c = 0; c < 3; ++c) {
    uint32_t sum = alpha / 2;
    for (const uint8_t* const p : pixels) sum += Tables().Light(p[c]) * p[3];
    out[c] = Tables().Shade(sum / alpha);
  }
}

}  // namespace

// A level of the page at hand, of which the rows come from above.
class TileMaker::PageLevel {
 public:
  PageLevel(const TiledPage& page, uint32_t level, size_t bytes_a_pixel)
      : number(level),
        width(page.width_of(level)),
        height(page.height_of(level)),
        columns(page.columns_of(level)),
        kind(page.kind),
        channels(bytes_a_pixel),
        row(width * channels) {}

  const uint32_t number, width, height, columns;
  const TiledPage::Kind kind;
  const size_t channels;
  std::vector<uint8_t> row;  // the next one, to be filled before Take()

  // The row is there.
  void Take() {
    if (strip_.capacity() == 0) {
      strip_.reserve(std::min(height, kTileSide + 2 * kTileMargin) * row.size());
    }
    strip_.insert(strip_.end(), row.begin(), row.end());
    ++rows_;
  }
  bool done() const { return tile_row_ * kTileSide >= height; }
  // Whether all of the next tiles' rows are there.
  bool has_tiles() const {
    return !done() && rows_ >= std::min(height, (tile_row_ + 1) * kTileSide + kTileMargin);
  }
  void EndTiles() {
    ++tile_row_;
    const uint32_t keep = FirstRow();
    const uint32_t gone = std::min(keep, rows_) - first_;
    strip_.erase(strip_.begin(), strip_.begin() + static_cast<ptrdiff_t>(gone * row.size()));
    first_ += gone;
  }

  // Of the tiles that are there.
  Result<Bytes> Encode(uint32_t column) const {
    const uint32_t left = column * kTileSide;
    const uint32_t top = tile_row_ * kTileSide;
    const uint32_t w = std::min(kTileSide, width - left) + 2 * kTileMargin;
    const uint32_t h = std::min(kTileSide, height - top) + 2 * kTileMargin;
    std::vector<uint8_t> pixels(size_t{w} * h * channels);
    for (uint32_t y = 0; y < h; ++y) {
      CopyRow(Clamped(top + y, height), left, w, &pixels[size_t{y} * w * channels]);
    }
    if (kind == TiledPage::Kind::kPng) {
      return EncodePng(w, h, static_cast<uint32_t>(channels), pixels, true);
    }
    return EncodeJpeg(w, h, pixels, kQuality, true);
  }

  // The two last rows, or one when the number is odd, as a row of the level after it.
  void Halve(uint8_t* out) const {
    const uint8_t* const lower = RowAt(rows_ - 1);
    const uint8_t* const upper = rows_ % 2 == 0 ? RowAt(rows_ - 2) : lower;
    for (uint32_t x = 0; x < width; x += 2, out += channels) {
      const size_t at = x * channels;
      const size_t next = x + 1 < width ? at + channels : at;
      const std::array<const uint8_t*, 4> pixels{upper + at, upper + next, lower + at,
                                                 lower + next};
      channels == 3 ? MeanOf3(pixels, out) : MeanOf4(pixels, out);
    }
  }
  bool has_pair() const { return rows_ % 2 == 0 || rows_ == height; }

 private:
  // Of the next tiles.
  uint32_t FirstRow() const { return tile_row_ == 0 ? 0 : tile_row_ * kTileSide - kTileMargin; }
  // A coordinate of a tile with its margin, from the first column or row that it shows.
  static uint32_t Clamped(uint32_t with_margin, uint32_t side) {
    return std::min(with_margin < kTileMargin ? 0 : with_margin - kTileMargin, side - 1);
  }
  const uint8_t* RowAt(uint32_t y) const { return &strip_[size_t{y - first_} * row.size()]; }
  void CopyRow(uint32_t y, uint32_t left, uint32_t count, uint8_t* out) const {
    const uint8_t* const from = RowAt(y);
    for (uint32_t x = 0; x < count;) {
      const uint32_t at = Clamped(left + x, width);
      // What is not repeated is copied at once.
      const bool inside = left + x >= kTileMargin && at + 1 < width;
      const uint32_t run = inside ? std::min(count - x, width - at) : 1;
      std::memcpy(out + x * channels, from + at * channels, run * channels);
      x += run;
    }
  }

  std::vector<uint8_t> strip_;  // rows first_ .. rows_ - 1
  uint32_t first_ = 0;
  uint32_t rows_ = 0;      // that came
  uint32_t tile_row_ = 0;  // of the next tiles
};

TileMaker::Level& TileMaker::LevelOf(uint32_t level) {
  while (levels_.size() <= level) levels_.emplace_back(space_);
  return levels_[level];
}

Status TileMaker::PutTiles(const PageLevel& level) {
  std::vector<std::optional<Result<Bytes>>> tiles(level.columns);
  ParallelFor(tiles.size(), threads_, [&](unsigned, size_t i) {
    tiles[i].emplace(level.Encode(static_cast<uint32_t>(i)));
  });
  Level& all = LevelOf(level.number);
  for (const auto& tile : tiles) {
    MTDB_RETURN_IF_ERROR(tile->status());
    const Bytes& bytes = **tile;
    all.tiles.push_back(
        {all.bytes.size(),
         {static_cast<uint32_t>(bytes.size()), static_cast<uint32_t>(Hash64(bytes))}});
    MTDB_RETURN_IF_ERROR(all.bytes.Append(bytes.data(), bytes.size()));
  }
  return check_();
}

// The row of the finest level is there: it goes into that, and into what is made of it.
Status TileMaker::PushRow(std::vector<PageLevel>& levels) {
  for (size_t l = 0; l < levels.size(); ++l) {
    PageLevel& level = levels[l];
    level.Take();
    // Before rows go that the next level needs.
    const bool more = l + 1 < levels.size() && level.has_pair();
    if (more) level.Halve(levels[l + 1].row.data());
    while (level.has_tiles()) {
      MTDB_RETURN_IF_ERROR(PutTiles(level));
      level.EndTiles();
    }
    if (!more) break;
  }
  return Status::Ok();
}

Status TileMaker::ReadPage(ImageRows& rows) {
  const TiledPage& page = pages_.back();
  std::vector<PageLevel> levels;
  for (uint32_t l = 0; l < page.levels; ++l) levels.emplace_back(page, l, rows.channels());
  for (uint32_t y = 0; y < page.height; ++y) {
    MTDB_RETURN_IF_ERROR(rows.ReadRow(levels[0].row.data()));
    MTDB_RETURN_IF_ERROR(PushRow(levels));
  }
  return Status::Ok();
}

Status TileMaker::AddPage(ByteSpan image) {
  pages_.emplace_back();
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<ImageRows> rows, ImageRows::Open(image, kMostAtOnce));
  const bool png = rows->channels() == 4 || std::max(rows->width(), rows->height()) <= kSmallPage;
  pages_.back() = TiledPage::Of(rows->width(), rows->height(),
                                png ? TiledPage::Kind::kPng : TiledPage::Kind::kJpeg);
  uint64_t tiles = 0;
  for (const Level& level : levels_) tiles += level.tiles.size();
  for (uint32_t l = 0; l < pages_.back().levels; ++l) {
    tiles += uint64_t{pages_.back().columns_of(l)} * pages_.back().rows_of(l);
  }
  if (tiles > kMostTiles) {
    pages_.back() = {};
    return Unsupported("the images before it have as many tiles as there may be");
  }
  std::vector<size_t> before;
  for (const Level& level : levels_) before.push_back(level.tiles.size());
  const Status status = ReadPage(*rows);
  if (status.code() == StatusCode::kBadInput) {
    // What was made of it stays in the spools, and nobody reads it.
    pages_.back() = {};
    before.resize(levels_.size());
    for (size_t l = 0; l < levels_.size(); ++l) levels_[l].tiles.resize(before[l]);
  }
  return status;
}

Status TileMaker::WriteLevel(uint32_t level, const Append& append) {
  const Level& l = levels_[level];
  std::vector<TileEntry> index;
  for (const Tile& tile : l.tiles) index.push_back(tile.entry);
  MTDB_RETURN_IF_ERROR(append(EncodeTileIndex(index, level)));
  Bytes bytes;
  for (const Tile& tile : l.tiles) {
    bytes.resize(tile.entry.bytes);
    MTDB_RETURN_IF_ERROR(l.bytes.Read(tile.offset, bytes.data(), bytes.size()));
    MTDB_RETURN_IF_ERROR(append(bytes));
  }
  return check_();
}

Status TileMaker::Write(const Append& append) {
  TilesHead head;
  head.pages = pages_;
  uint32_t most = 0;
  for (const TiledPage& page : pages_) most = std::max(most, page.levels);
  if (most == 0) return Status::Ok();
  head.levels.resize(most);
  uint64_t end = head.bytes();
  for (uint32_t level = most; level-- > 0;) {
    MTDB_RETURN_IF_ERROR(LevelOf(level).bytes.Finish());
    uint64_t bytes = EncodeTileIndex({}, level).size();
    for (const Tile& tile : levels_[level].tiles) bytes += kTileEntryBytes + tile.entry.bytes;
    head.levels[level] = {end, bytes};
    end += bytes;
  }
  MTDB_RETURN_IF_ERROR(append(EncodeTilesHead(head)));
  for (uint32_t level = most; level-- > 0;) MTDB_RETURN_IF_ERROR(WriteLevel(level, append));
  return Status::Ok();
}

}  // namespace mtdb::internal
