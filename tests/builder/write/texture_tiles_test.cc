// SPDX-License-Identifier: Apache-2.0
// The tiles of images against levels and squares that are made by the definition.
#include "builder/write/texture_tiles.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>

#include "codecs/image_file/image_rows.h"
#include "tests/codecs/image_file/image_testing.h"

namespace mtdb::testing {

using namespace internal;

namespace {

SpoolSpace Space() { return {std::filesystem::temp_directory_path().string()}; }

Bytes Written(TileMaker& maker) {
  Bytes file;
  REQUIRE(maker
              .Write([&](ByteSpan part) {
                file.insert(file.end(), part.begin(), part.end());
                return Status::Ok();
              })
              .message() == "");
  return file;
}

Bytes TilesOf(const std::vector<Bytes>& images, unsigned threads) {
  const SpoolSpace space = Space();
  TileMaker maker(&space, threads, [] { return Status::Ok(); });
  for (const Bytes& image : images) REQUIRE(maker.AddPage(image).message() == "");
  return Written(maker);
}

std::shared_ptr<const TextureTiles> Opened(const Bytes& file) {
  return TextureTiles::Open(
             "object x", file.size(),
             [file](uint64_t offset, uint64_t bytes) {
               const auto begin = file.begin() + static_cast<ptrdiff_t>(offset);
               return Result<Bytes>(Bytes(begin, begin + static_cast<ptrdiff_t>(bytes)));
             })
      .value();
}

TestImage Decoded(const Bytes& file) {
  const auto rows = ImageRows::Open(file, 0).value();
  TestImage image{rows->width(), rows->height(), rows->channels(), {}};
  const size_t bytes = size_t{image.width} * image.channels;
  image.pixels.resize(bytes * image.height);
  for (uint32_t y = 0; y < image.height; ++y) {
    REQUIRE(rows->ReadRow(&image.pixels[bytes * y]).ok());
  }
  return image;
}

double ToLight(double shade) {
  return shade <= 0.04045 ? shade / 12.92 : std::pow((shade + 0.055) / 1.055, 2.4);
}
double ToShade(double light) {
  return light <= 0.0031308 ? 12.92 * light : 1.055 * std::pow(light, 1 / 2.4) - 0.055;
}

TestImage HalvedByDefinition(const TestImage& from) {
  TestImage to{(from.width + 1) / 2, (from.height + 1) / 2, from.channels, {}};
  for (uint32_t y = 0; y < to.height; ++y) {
    for (uint32_t x = 0; x < to.width; ++x) {
      double light[3] = {}, alpha = 0, count = 0;
      for (uint32_t dy = 0; dy < 2 && 2 * y + dy < from.height; ++dy) {
        for (uint32_t dx = 0; dx < 2 && 2 * x + dx < from.width; ++dx) {
          const uint8_t* const p = from.At(2 * x + dx, 2 * y + dy);
          const double a = from.channels == 4 ? p[3] / 255.0 : 1;
          for (int c = 0; c < 3; ++c) light[c] += a * ToLight(p[c] / 255.0);
          alpha += a;
          ++count;
        }
      }
      for (const double l : light) {
        to.pixels.push_back(alpha > 0 ? static_cast<uint8_t>(std::lround(255 * ToShade(l / alpha)))
                                      : 0);
      }
      if (from.channels == 4) {
        to.pixels.push_back(static_cast<uint8_t>(std::lround(255 * alpha / count)));
      }
    }
  }
  return to;
}

struct Difference {
  int most = 0;
  double mean = 0;  // of what is light and dark, since JPEG halves colours
};

// Of a tile from the level, margins included. Where nothing is opaque, colours mean nothing.
Difference DifferenceOf(const TestImage& tile, const TestImage& level, const TilePlace& place) {
  Difference difference;
  const auto side = [](uint32_t all, uint32_t n) { return std::min(504U, all - 504 * n) + 8; };
  REQUIRE(tile.width == side(level.width, place.column));
  REQUIRE(tile.height == side(level.height, place.row));
  for (uint32_t y = 0; y < tile.height; ++y) {
    for (uint32_t x = 0; x < tile.width; ++x) {
      const auto at = [](uint32_t begin, uint32_t i, uint32_t all) {
        const int64_t place_of = int64_t{begin} * 504 + i - 4;
        return static_cast<uint32_t>(std::clamp<int64_t>(place_of, 0, all - 1));
      };
      const uint8_t* const p =
          level.At(at(place.column, x, level.width), at(place.row, y, level.height));
      const bool clear = tile.channels == 4 && p[3] == 0 && tile.At(x, y)[3] == 0;
      for (uint32_t c = clear ? 3 : 0; c < tile.channels; ++c) {
        const int d = std::abs(static_cast<int>(tile.At(x, y)[c]) - p[c]);
        difference.most = std::max(difference.most, d);
      }
      const auto grey = [](const uint8_t* q) { return 0.299 * q[0] + 0.587 * q[1] + 0.114 * q[2]; };
      if (clear) continue;
      difference.mean +=
          std::fabs(grey(tile.At(x, y)) - grey(p)) / (1.0 * tile.width * tile.height);
    }
  }
  return difference;
}

void CheckPage(const TextureTiles& tiles, uint32_t page, TestImage level) {
  const TiledPage& p = tiles.pages()[page];
  const bool lossless = level.channels == 4 || std::max(level.width, level.height) <= 256;
  REQUIRE(p == TiledPage::Of(level.width, level.height,
                             lossless ? TiledPage::Kind::kPng : TiledPage::Kind::kJpeg));
  for (uint32_t l = 0; l < p.levels; ++l) {
    for (uint32_t row = 0; row < p.rows_of(l); ++row) {
      for (uint32_t column = 0; column < p.columns_of(l); ++column) {
        const TilePlace place{page, l, column, row};
        CAPTURE(l, row, column);
        const TestImage tile = Decoded(tiles.Tile(place).value());
        REQUIRE(tile.channels == level.channels);
        const Difference difference = DifferenceOf(tile, level, place);
        if (lossless) {
          // Each halving rounds once; where little is opaque, alpha's rounding counts in colours.
          CHECK(difference.most <= (l < 2 ? static_cast<int>(l) : 24));
          CHECK(difference.mean <= 0.5 * l);
        } else {
          CHECK(difference.mean < 3);
        }
      }
    }
    level = HalvedByDefinition(level);
  }
}

}  // namespace

TEST_CASE("tiles are squares of the page and of its halves in linear light, with margins") {
  const std::vector<std::pair<uint32_t, uint32_t>> sizes{
      {1, 1}, {250, 256}, {505, 3}, {3, 1013}, {504, 504}, {1008, 506}, {1013, 999}};
  std::vector<Bytes> images;
  std::vector<TestImage> truth;
  for (const auto& [width, height] : sizes) {
    for (const uint32_t channels : {3U, 4U}) {
      truth.push_back(WavyImage(width, height, channels, images.size()));
      images.push_back(PngOf(truth.back()));
    }
  }
  const Bytes file = TilesOf(images, 1);
  CHECK(TilesOf(images, 3) == file);
  const auto tiles = Opened(file);
  for (uint32_t page = 0; page < truth.size(); ++page) {
    CAPTURE(truth[page].width, truth[page].height, truth[page].channels);
    CheckPage(*tiles, page, truth[page]);
  }
}

TEST_CASE("tiles of a photograph look like it") {
  const TestImage image = WavyImage(800, 600, 3, 1);
  const auto tiles = Opened(TilesOf({JpegOf(image, 95)}, 2));
  double sum = 0, count = 0;
  for (uint32_t row = 0; row < 2; ++row) {
    for (uint32_t column = 0; column < 2; ++column) {
      const TestImage tile = Decoded(tiles->Tile({0, 0, column, row}).value());
      for (uint32_t y = 4; y + 4 < tile.height; ++y) {
        for (uint32_t x = 4; x + 4 < tile.width; ++x) {
          for (uint32_t c = 0; c < 3; ++c) {
            const double d = static_cast<double>(tile.At(x, y)[c]) -
                             image.At(504 * column + x - 4, 504 * row + y - 4)[c];
            sum += d * d;
            ++count;
          }
        }
      }
    }
  }
  CHECK(count == 3.0 * 800 * 600);
  CHECK(std::sqrt(sum / count) < 4);
}

TEST_CASE("a page that cannot be read has no tiles, and the others have theirs") {
  const TestImage image = WavyImage(700, 520, 4, 2);
  const Bytes whole = PngOf(image);
  const Bytes half(whole.begin(), whole.begin() + static_cast<ptrdiff_t>(whole.size() / 2));
  const SpoolSpace space = Space();
  TileMaker maker(&space, 2, [] { return Status::Ok(); });
  CHECK(maker.AddPage(half).code() == StatusCode::kBadInput);
  CHECK(maker.AddPage(whole).ok());
  maker.AddEmptyPage();
  CHECK(maker.AddPage(Bytes(10)).code() == StatusCode::kBadInput);
  CHECK(maker.AddPage(half).code() == StatusCode::kBadInput);
  const auto tiles = Opened(Written(maker));
  REQUIRE(tiles->pages().size() == 5);
  for (const uint32_t page : {0U, 2U, 3U, 4U}) CHECK(tiles->pages()[page] == TiledPage{});
  CheckPage(*tiles, 1, image);
}

TEST_CASE("without a page that has tiles nothing is written, and whoever waits can end it") {
  const SpoolSpace space = Space();
  TileMaker empty(&space, 1, [] { return Status::Ok(); });
  empty.AddEmptyPage();
  CHECK(Written(empty).empty());
  int calls = 0;
  TileMaker ended(&space, 1, [&] {
    return ++calls == 2 ? Status(StatusCode::kCancelled, "enough") : Status::Ok();
  });
  CHECK(ended.AddPage(PngOf(WavyImage(1100, 1100, 3, 4))).message() == "enough");
  TileMaker full(&space, 1, [] { return Status::Ok(); });
  CHECK(full.AddPage(PngOf(WavyImage(30, 30, 3, 4))).ok());
  CHECK(full.Write([](ByteSpan) { return Status(StatusCode::kNoSpace, "full"); }).message() ==
        "full");
}

}  // namespace mtdb::testing
