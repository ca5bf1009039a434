// SPDX-License-Identifier: Apache-2.0
#include "builder/tiles/tiling_choice.h"

#include <algorithm>

#include "store/base/hilbert.h"

namespace mtdb::internal {

namespace {
constexpr double kLeastProgress = 0.95;  // a round that leaves more than this made none
constexpr uint32_t kMostStalls = 5;
constexpr uint64_t kCellTriangles = 1000;  // of an owner's cell, about
constexpr uint32_t kFiner = 3;             // levels, where cells did not help

// The mesh takes half of the curve's cube, and a cell of level l, 2^-l of its side, some 4^-l of a
// surface: tiles have several of them.
uint32_t LevelsFor(uint64_t triangles) {
  uint32_t levels = 2;
  while (levels < kHilbertBits && triangles >> (2 * levels) > kCellTriangles) ++levels;
  return levels;
}
}  // namespace

bool TilingChoice::Next(const Round& round) {
  const bool by_owners = owner_levels_ != 0;
  const bool stalled = static_cast<double>(round.triangles_out) >
                       kLeastProgress * static_cast<double>(round.triangles_in);
  // A vertex on a seam is in two tiles at least.
  hindered_ = round.seam_vertices > round.vertices;
  stalls_ = stalled ? stalls_ + 1 : 0;
  if (stalled && (2 * round.seam_vertices <= round.vertices || stalls_ > kMostStalls)) return false;
  if (!by_owners) centres_in_ = round.triangles_in;
  if (!hindered_ && !stalled) {
    owner_levels_ = finer_ = 0;
    return true;
  }
  const bool fits = round.triangles_out <= window_triangles_;
  if (by_owners && !stalled && (fits || round.triangles_out < centres_in_ / 4)) {
    owner_levels_ = 0;
    return true;
  }
  if (by_owners && stalled) finer_ += kFiner;
  owner_levels_ = std::min<uint32_t>(LevelsFor(round.triangles_out) + finer_, kHilbertBits - 1);
  return true;
}

}  // namespace mtdb::internal
