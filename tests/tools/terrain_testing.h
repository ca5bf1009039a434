// SPDX-License-Identifier: Apache-2.0
// Rasters that tests of the command line write, and a terrain of one.
#pragma once

#include <cmath>
#include <map>

#include "tests/support/memory_raster.h"
#include "tests/tools/cli_testing.h"

namespace mtdb::test {

using mtdb::testing::kHole;
using mtdb::testing::MakeHeights;

// A .hgt file; NaN is its nodata value.
void WriteHgt(const std::string& path, const std::vector<double>& heights);

void WriteGrid(const std::string& path, const std::string& header, uint32_t columns,
               const std::vector<double>& heights);

std::map<std::pair<double, double>, double> HeightsOf(const std::string& ply);

// A terrain of one tile with a hole, at 9..10 degrees north, 7..8 east.
struct Tile {
  static constexpr uint32_t kSide = 51;
  Folder folder;
  std::vector<double> heights = MakeHeights(kSide, kSide, 8);
  std::string hgt = folder.File("N09E007.hgt");
  std::string store = folder.File("s.mtdb");

  Tile();
  double At(uint32_t column, uint32_t row) const { return heights[row * kSide + column]; }
  static std::string X(double column) { return std::to_string(7 + column / (kSide - 1)); }
  static std::string Y(double row) { return std::to_string(10 - row / (kSide - 1)); }
};

}  // namespace mtdb::test
