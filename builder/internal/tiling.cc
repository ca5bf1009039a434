// SPDX-License-Identifier: Apache-2.0
#include "builder/internal/tiling.h"

#include <algorithm>
#include <cmath>

#include "store/base/hash.h"
#include "store/base/hilbert.h"

namespace mtdb::internal {

RoundCurve::RoundCurve(const Box3d& bounds, uint32_t round) : min_(bounds.min) {
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
  const Vec3d sum =
      grid.Position(t.positions[0]) + grid.Position(t.positions[1]) + grid.Position(t.positions[2]);
  std::array<uint32_t, 3> cell;
  for (int i = 0; i < 3; ++i) {
    const double x = std::max(0.0, (sum[i] / 3 - min_[i]) * scale_[i]);
    cell[static_cast<size_t>(axis_[i])] = (static_cast<uint32_t>(x) + shift_[i]) ^ mirror_[i];
  }
  return HilbertCode(cell);
}

std::vector<uint64_t> RoundCurve::Codes(std::span<const TileTriangle> triangles,
                                        const Grid& grid) const {
  std::vector<uint64_t> codes(triangles.size());
  for (size_t i = 0; i < codes.size(); ++i) codes[i] = Code(triangles[i], grid);
  return codes;
}

}  // namespace mtdb::internal
