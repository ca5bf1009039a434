// SPDX-License-Identifier: Apache-2.0
#include "tests/tools/terrain_testing.h"

namespace mtdb::test {

void WriteHgt(const std::string& path, const std::vector<double>& heights) {
  std::string bytes;
  for (const double h : heights) {
    const auto value = static_cast<int16_t>(std::isnan(h) ? -32768 : h);
    bytes += static_cast<char>(static_cast<uint16_t>(value) >> 8);
    bytes += static_cast<char>(value & 255);
  }
  WriteText(path, bytes);
}

void WriteGrid(const std::string& path, const std::string& header, uint32_t columns,
               const std::vector<double>& heights) {
  std::ofstream out(path);
  out << header;
  for (size_t i = 0; i < heights.size(); ++i) {
    out << (std::isnan(heights[i]) ? -9999.0 : heights[i])
        << (i % columns + 1 == columns ? '\n' : ' ');
  }
}

std::map<std::pair<double, double>, double> HeightsOf(const std::string& ply) {
  std::map<std::pair<double, double>, double> heights;
  for (const Vec3d& p : ReadMesh(ply).positions) heights[{p.x, p.y}] = p.z;
  return heights;
}

Tile::Tile() {
  for (uint32_t r = 20; r < 26; ++r) {
    for (uint32_t c = 30; c < 40; ++c) heights[r * kSide + c] = kHole;
  }
  WriteHgt(hgt, heights);
  RunOk({"ingest", hgt, store});
}

}  // namespace mtdb::test
