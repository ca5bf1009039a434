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
inline void WriteHgt(const std::string& path, const std::vector<double>& heights) {
  std::string bytes;
  for (const double h : heights) {
    const auto value = static_cast<int16_t>(std::isnan(h) ? -32768 : h);
    bytes += static_cast<char>(static_cast<uint16_t>(value) >> 8);
    bytes += static_cast<char>(value & 255);
  }
  WriteText(path, bytes);
}

inline void WriteGrid(const std::string& path, const std::string& header, uint32_t columns,
                      const std::vector<double>& heights) {
  std::ofstream out(path);
  out << header;
  for (size_t i = 0; i < heights.size(); ++i) {
    out << (std::isnan(heights[i]) ? -9999.0 : heights[i])
        << (i % columns + 1 == columns ? '\n' : ' ');
  }
}

inline std::map<std::pair<double, double>, double> HeightsOf(const std::string& ply) {
  std::map<std::pair<double, double>, double> heights;
  for (const Vec3d& p : ReadMesh(ply).positions) heights[{p.x, p.y}] = p.z;
  return heights;
}

// A terrain of one tile with a hole, at 9..10 degrees north, 7..8 east.
struct Tile {
  static constexpr uint32_t kSide = 51;
  Folder folder;
  std::vector<double> heights = MakeHeights(kSide, kSide, 8);
  std::string hgt = folder.File("N09E007.hgt");
  std::string store = folder.File("s.mtdb");

  Tile() {
    for (uint32_t r = 20; r < 26; ++r) {
      for (uint32_t c = 30; c < 40; ++c) heights[r * kSide + c] = kHole;
    }
    WriteHgt(hgt, heights);
    RunOk({"ingest", hgt, store});
  }
  double At(uint32_t column, uint32_t row) const { return heights[row * kSide + column]; }
  static std::string X(double column) { return std::to_string(7 + column / (kSide - 1)); }
  static std::string Y(double row) { return std::to_string(10 - row / (kSide - 1)); }
};

}  // namespace mtdb::test
