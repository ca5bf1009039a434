// SPDX-License-Identifier: Apache-2.0
// Closing holes: which ones, by a flood of the whole raster; with what, by what a membrane is.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "codecs/raster_file/raster_mosaic.h"
#include "tests/support/memory_raster.h"

namespace mtdb {
namespace {

using testing::kHole;
using testing::MakeHeights;

struct Raster {
  uint32_t columns = 0, rows = 0;
  std::vector<double> heights;
  double& At(uint32_t row, uint32_t column) { return heights[row * columns + column]; }
};

HoleFillReport Fill(Raster* raster, uint32_t largest, double step = 1, double origin = 0) {
  HoleFiller filler({raster->columns, raster->rows, largest, step, origin},
                    [in = *raster](uint32_t row, std::span<double> heights) {
                      std::copy_n(in.heights.begin() + row * in.columns, in.columns,
                                  heights.begin());
                      return Status::Ok();
                    });
  for (uint32_t row = 0; row < raster->rows; ++row) {
    REQUIRE(filler.Next({&raster->At(row, 0), raster->columns}).ok());
  }
  return filler.report();
}

// Where samples lie whose hole is closed, by the whole raster.
std::vector<bool> ToBeFilled(Raster r, uint32_t largest, HoleFillReport* report) {
  std::vector<bool> filled(r.heights.size());
  std::vector<bool> seen(r.heights.size());
  for (uint32_t begin = 0; begin < r.heights.size(); ++begin) {
    if (seen[begin] || !std::isnan(r.heights[begin])) continue;
    std::vector<uint32_t> hole{begin};
    seen[begin] = true;
    int64_t least[2] = {r.rows, r.columns}, most[2] = {0, 0};
    for (size_t i = 0; i < hole.size(); ++i) {
      const int64_t row = hole[i] / r.columns, column = hole[i] % r.columns;
      least[0] = std::min(least[0], row), most[0] = std::max(most[0], row);
      least[1] = std::min(least[1], column), most[1] = std::max(most[1], column);
      for (int64_t y = row - 1; y <= row + 1; ++y) {
        for (int64_t x = column - 1; x <= column + 1; ++x) {
          if (y < 0 || x < 0 || y >= r.rows || x >= r.columns) continue;
          const auto at = static_cast<uint32_t>(y * r.columns + x);
          if (seen[at] || !std::isnan(r.heights[at])) continue;
          seen[at] = true;
          hole.push_back(at);
        }
      }
    }
    if (least[0] == 0 || least[1] == 0 || most[0] + 1 == r.rows || most[1] + 1 == r.columns) {
      continue;
    }
    if (most[0] - least[0] >= largest || most[1] - least[1] >= largest) {
      ++report->left;
      continue;
    }
    ++report->holes;
    report->samples += hole.size();
    for (const uint32_t at : hole) filled[at] = true;
  }
  return filled;
}

TEST_CASE("holes are closed up to their size, as a flood of the whole raster tells", "[raster]") {
  std::mt19937 random(5);
  uint64_t closed = 0, left = 0;
  for (uint32_t trial = 0; trial < 300; ++trial) {
    Raster r;
    r.columns = 1 + random() % 40;
    r.rows = 1 + random() % 40;
    r.heights = MakeHeights(r.columns, r.rows, trial);
    const uint32_t holes_in_ten = 1 + random() % 6;
    for (double& h : r.heights) {
      if (random() % 10 < holes_in_ten) h = kHole;
    }
    const uint32_t largest = 1 + random() % 12;
    Raster filled = r;
    const HoleFillReport report = Fill(&filled, largest);
    HoleFillReport expected;
    const std::vector<bool> which = ToBeFilled(r, largest, &expected);
    CHECK(report.holes == expected.holes);
    CHECK(report.samples == expected.samples);
    CHECK(report.left == expected.left);
    closed += report.holes;
    left += report.left;
    for (size_t i = 0; i < r.heights.size(); ++i) {
      CAPTURE(trial, i);
      if (which[i]) {
        REQUIRE(filled.heights[i] == std::round(filled.heights[i]));
      } else if (std::isnan(r.heights[i])) {
        REQUIRE(std::isnan(filled.heights[i]));
      } else {
        REQUIRE(filled.heights[i] == r.heights[i]);
      }
    }
  }
  CHECK(closed > 2000);
  CHECK(left > 50);
}

TEST_CASE("a closed hole is a membrane: each height is the mean of those beside it", "[raster]") {
  Raster r{60, 50, MakeHeights(60, 50, 3)};
  // A blob with a bay and an island.
  for (uint32_t row = 8; row < 40; ++row) {
    for (uint32_t column = 10; column < 48; ++column) {
      const double distance = std::hypot(row - 24.0, (column - 29.0) * 0.8);
      if (distance < 15 && !(row > 22 && column < 20)) r.At(row, column) = kHole;
    }
  }
  r.At(24, 30) = 2000;
  const Raster before = r;
  constexpr double kStep = 0.001;
  CHECK(Fill(&r, 38, kStep).holes == 1);
  double least = 1e9, most = -1e9;
  for (const double h : before.heights) {
    if (!std::isnan(h)) least = std::min(least, h), most = std::max(most, h);
  }
  for (uint32_t row = 1; row < 49; ++row) {
    for (uint32_t column = 1; column < 59; ++column) {
      const size_t at = row * 60 + column;
      if (!std::isnan(before.heights[at])) continue;
      const double mean =
          (r.heights[at - 1] + r.heights[at + 1] + r.heights[at - 60] + r.heights[at + 60]) / 4;
      REQUIRE(std::abs(r.heights[at] - mean) < 4 * kStep);
      REQUIRE(r.heights[at] >= least);
      REQUIRE(r.heights[at] <= most);
    }
  }
}

TEST_CASE("heights that close a hole are multiples of the step from its origin", "[raster]") {
  Raster r{5, 5, std::vector<double>(25, 10.3)};
  r.At(2, 2) = kHole;
  r.At(1, 2) = 11.3;
  Fill(&r, 1, 0.25, 0.05);
  CHECK(r.At(2, 2) == Approx(0.05 + 0.25 * 42));  // of 10.55
}

TEST_CASE("collars, voids without heights, one sample and one row are never filled", "[raster]") {
  // A turned sheet: all around it is the outside.
  Raster turned{41, 41, MakeHeights(41, 41, 1)};
  for (uint32_t row = 0; row < 41; ++row) {
    for (uint32_t column = 0; column < 41; ++column) {
      const bool inside = std::abs(int(row) - 20) + std::abs(int(column) - 20) <= 19;
      if (!inside || (row == 20 && column == 20)) turned.At(row, column) = kHole;
    }
  }
  HoleFillReport report = Fill(&turned, 100);
  CHECK(report.holes == 1);
  CHECK(report.samples == 1);
  CHECK(report.left == 0);
  CHECK(std::isnan(turned.At(0, 0)));
  CHECK(std::isnan(turned.At(5, 4)));
  for (const auto& [columns, rows] : {std::pair{1u, 1u}, {7u, 1u}, {1u, 7u}, {9u, 9u}}) {
    Raster none{columns, rows, std::vector<double>(columns * rows, kHole)};
    CHECK(Fill(&none, 5).samples == 0);
    CHECK(std::isnan(none.At(rows / 2, columns / 2)));
    Raster row{columns, rows, std::vector<double>(columns * rows, 3)};
    row.At(0, columns / 2) = kHole;
    CHECK(Fill(&row, 5).samples == 0);
  }
}

TEST_CASE("a filled raster counts filled samples apart, and rounds none of them", "[raster]") {
  std::vector<double> heights = MakeHeights(30, 20, 4);
  heights[10 * 30 + 10] = heights[10 * 30 + 11] = kHole;
  heights[0] = kHole;
  RasterMosaic mosaic = testing::MosaicOf(std::make_unique<testing::MemoryRaster>(30, 20, heights));
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  RasterMeshReport report;
  RasterMeshOptions options;
  options.fill = 3;
  REQUIRE(SendRaster(mosaic, options, sink, &report).ok());
  CHECK(report.samples == 597);
  CHECK(report.holes == 1);
  CHECK(report.filled.samples == 2);
  CHECK(report.rounding == 0);
  CHECK(mesh.positions.size() == 599);
  CHECK(mesh.triangles.size() == 29 * 19 * 2 - 1);
}

}  // namespace
}  // namespace mtdb
