// SPDX-License-Identifier: Apache-2.0
#include "query/compare/placement.h"

#include <algorithm>
#include <cmath>

#include "query/compare/outward.h"
#include "query/fields/rounding.h"
#include "store/base/coordinate_limit.h"

namespace mtdb::internal {
namespace {

Vec3d Column(const Transform& m, size_t i) { return {m[i], m[4 + i], m[8 + i]}; }

// The largest singular value is at most the root of the largest sum of a row of the product of the
// matrix with its transpose: 1 for rotations.
double Stretch(const Transform& m) {
  double largest = 0;
  for (size_t i = 0; i < 3; ++i) {
    double sum = 0;
    for (size_t j = 0; j < 3; ++j) sum += std::abs(Dot(Column(m, i), Column(m, j)));
    largest = std::max(largest, sum);
  }
  return Up(std::sqrt(largest));
}

void SetRow(Transform& m, size_t row, Vec3d v, double last) {
  m[4 * row] = v.x;
  m[4 * row + 1] = v.y;
  m[4 * row + 2] = v.z;
  m[4 * row + 3] = last;
}

}  // namespace

Vec3d Placement::Map(const Transform& m, Vec3d p) {
  return {m[0] * p.x + m[1] * p.y + m[2] * p.z + m[3], m[4] * p.x + m[5] * p.y + m[6] * p.z + m[7],
          m[8] * p.x + m[9] * p.y + m[10] * p.z + m[11]};
}

Box3d Placement::Around(const Transform& m, const Box3d& box) {
  Box3d around;
  double largest = 0;
  for (int i = 0; i < 8; ++i) {
    const Vec3d corner = Corner(box, i);
    around.Add(Map(m, corner));
    for (size_t k = 0; k < 12; ++k) {
      largest =
          std::max(largest, std::abs(m[k] * (k % 4 == 3 ? 1 : corner[static_cast<int>(k % 4)])));
    }
  }
  return Grown(around, largest * 0x1p-40);
}

Box3d Placement::Around(const Box3d& box) const {
  return identity_ || box.empty() ? box : Around(forward_, box);
}

Box3d Placement::AroundBack(const Box3d& box) const {
  return identity_ || box.empty() ? box : Around(back_, box);
}

Result<Placement> Placement::Of(const Transform& transform) {
  Placement placement;
  if (transform == kIdentity) return placement;
  for (const double value : transform) {
    if (!IsCoordinate(value)) return InvalidArgument("transform: expected numbers up to 1e30");
  }
  if (transform[12] != 0 || transform[13] != 0 || transform[14] != 0 || transform[15] != 1) {
    return InvalidArgument("transform: expected a last row of 0, 0, 0, 1");
  }
  const Vec3d a = Column(transform, 0), b = Column(transform, 1), c = Column(transform, 2);
  const double volume = Dot(a, Cross(b, c));
  // A map that is flatter would enlarge boxes that are mapped back beyond use.
  if (!(std::abs(volume) > 1e-9 * Length(a) * Length(b) * Length(c))) {
    return InvalidArgument("transform: its matrix has no inverse; it maps space onto a plane");
  }
  placement.identity_ = false;
  placement.forward_ = transform;
  const Vec3d shift = Column(transform, 3);
  const std::array<Vec3d, 3> rows{Cross(b, c) * (1 / volume), Cross(c, a) * (1 / volume),
                                  Cross(a, b) * (1 / volume)};
  for (size_t i = 0; i < 3; ++i) SetRow(placement.back_, i, rows[i], -Dot(rows[i], shift));
  placement.stretch_ = Stretch(transform);
  return placement;
}

}  // namespace mtdb::internal
