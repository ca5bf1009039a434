// SPDX-License-Identifier: Apache-2.0
#include "builder/tiles/tiling.h"

#include <algorithm>
#include <cmath>

#include "store/base/hash.h"
#include "store/base/hilbert.h"

namespace mtdb::internal {

RoundCurve::RoundCurve(const Box3d& bounds, uint32_t round, uint32_t owner_levels)
    : min_(bounds.min), owner_levels_(owner_levels), ranks_(Mix64(~uint64_t{round})) {
  const Vec3d size = bounds.max - bounds.min;
  const double longest = std::max({size.x, size.y, size.z});
  // The mesh takes half of the cube's side; the shift takes up to the other half.
  constexpr double kCells = 1 << (kHilbertBits - 1);
  uint64_t random = Mix64(round);
  for (int i = 0; i < 3; ++i) {
    scale_[i] = size[i] > 0 ? (kCells - 1) / longest : 0;
    random = Mix64(random);
    shift_[i] = static_cast<uint32_t>(random) & ((1u << (kHilbertBits - 1)) - 1);
    mirror_[i] = (random >> 40) & 1 ? (1u << kHilbertBits) - 1 : 0;
    axis_[i] = i;
  }
  random = Mix64(random);
  std::swap(axis_[0], axis_[random % 3]);
  std::swap(axis_[1], axis_[1 + (random >> 8) % 2]);
}

uint64_t RoundCurve::Code(const TileTriangle& t, const Grid& grid) const {
  if (owner_levels_ != 0) return OwnerCode(t, grid);
  const Vec3d sum =
      grid.Position(t.positions[0]) + grid.Position(t.positions[1]) + grid.Position(t.positions[2]);
  return CodeAt({sum.x / 3, sum.y / 3, sum.z / 3});
}

uint64_t RoundCurve::CodeAt(Vec3d place) const {
  std::array<uint32_t, 3> cell;
  for (int i = 0; i < 3; ++i) {
    const double x = std::max(0.0, (place[i] - min_[i]) * scale_[i]);
    cell[static_cast<size_t>(axis_[i])] = (static_cast<uint32_t>(x) + shift_[i]) ^ mirror_[i];
  }
  return HilbertCode(cell);
}

uint64_t RoundCurve::OwnerCode(const TileTriangle& t, const Grid& grid) const {
  std::array<Vec3d, 3> corners;
  for (size_t c = 0; c < 3; ++c) corners[c] = grid.Position(t.positions[c]);
  const uint32_t inside = 3 * (kHilbertBits - owner_levels_);  // bits of a code within a cell
  uint64_t owner = 0;
  uint64_t first = ~uint64_t{0};
  for (const Vec3d corner : corners) {
    const uint64_t cell = CodeAt(corner) >> inside;
    const uint64_t rank = Mix64(cell ^ ranks_);
    if (rank > first) continue;
    first = rank;
    owner = cell;
  }
  const uint64_t centre = CodeAt((corners[0] + corners[1] + corners[2]) * (1.0 / 3));
  return owner << inside | centre >> (3 * owner_levels_);
}

std::vector<uint64_t> RoundCurve::Codes(std::span<const TileTriangle> triangles,
                                        const Grid& grid) const {
  std::vector<uint64_t> codes(triangles.size());
  for (size_t i = 0; i < codes.size(); ++i) codes[i] = Code(triangles[i], grid);
  return codes;
}

}  // namespace mtdb::internal
