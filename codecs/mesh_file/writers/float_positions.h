// SPDX-License-Identifier: Apache-2.0
// FloatPositions: positions as float32 offsets from an origin, and what that rounds.
#pragma once

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

#include "store/base/geometry.h"
#include "store/base/mesh_sink.h"

namespace mtdb::internal {

// Which origins a format has room for.
enum class FloatOrigin {
  kNone,
  kFloat32,   // of float32 values, as some readers of glTF take what places a node
  kDecimals,  // doubles that 9 significant digits name, which are short to write and exact to read
};

// The origin is 0 but for meshes that lie so far away, for their size, that float32 would move
// their vertices by a millionth of their diagonal. Then it is near their middle.
class FloatPositions {
 public:
  FloatPositions() = default;
  FloatPositions(const MeshHeader& header, FloatOrigin kind) {
    if (header.bounds.empty() || !header.double_positions || kind == FloatOrigin::kNone) return;
    constexpr double kShare = 1e-6;
    if (!(Largest(header.bounds) > kShare * Diagonal(header.bounds))) return;
    for (int i = 0; i < 3; ++i) {
      const double middle = header.bounds.min[i] / 2 + header.bounds.max[i] / 2;
      origin_[i] = kind == FloatOrigin::kFloat32 ? static_cast<double>(static_cast<float>(middle))
                                                 : ShortDecimal(middle);
    }
    if (!std::isfinite(origin_.x + origin_.y + origin_.z)) origin_ = {};
  }

  bool has_origin() const { return origin_ != Vec3d{}; }
  Vec3d origin() const { return origin_; }
  void set_origin(Vec3d origin) { origin_ = origin; }

  // How far Round moves a position of this mesh at most.
  double LargestRounding(const MeshHeader& header) const {
    return header.double_positions || has_origin() ? Largest(header.bounds) : 0;
  }
  // False when it is too large for float32.
  bool Round(Vec3d p, Vec3f* rounded) {
    const Vec3d d = p - origin_;
    *rounded = {static_cast<float>(d.x), static_cast<float>(d.y), static_cast<float>(d.z)};
    Note(p, *rounded);
    return std::isfinite(rounded->x) && std::isfinite(rounded->y) && std::isfinite(rounded->z);
  }
  // What becomes of p is origin + written.
  void Note(Vec3d p, Vec3f written) {
    const Vec3d back = origin_ + Vec3d{written.x, written.y, written.z};
    rounding2_ = std::max(rounding2_, SquaredLength(back - p));
  }
  // The farthest that Round has moved a position.
  double rounding() const { return std::sqrt(rounding2_) * (1 + 1e-12); }

 private:
  // Half a unit in the last place of the largest offset; of doubles' differences and sums likewise.
  double Largest(const Box3d& bounds) const {
    if (bounds.empty()) return 0;
    Vec3d most;
    for (int i = 0; i < 3; ++i) {
      const double offset =
          std::max(std::abs(bounds.min[i] - origin_[i]), std::abs(bounds.max[i] - origin_[i]));
      const double size = std::max(std::abs(bounds.min[i]), std::abs(bounds.max[i]));
      most[i] = std::max(offset * 0x1p-24, 0x1p-150) +
                2 * std::numeric_limits<double>::epsilon() * (size + offset);
    }
    return Length(most) * (1 + 1e-12);
  }

  static double ShortDecimal(double value) {
    constexpr int kDigits = 9;
    char text[32];
    const auto end =
        std::to_chars(text, text + sizeof(text), value, std::chars_format::scientific, kDigits - 1);
    std::from_chars(text, end.ptr, value);
    return value;
  }

  Vec3d origin_;
  double rounding2_ = 0;
};

}  // namespace mtdb::internal
