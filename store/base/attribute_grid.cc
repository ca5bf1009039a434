// SPDX-License-Identifier: Apache-2.0
#include "store/base/attribute_grid.h"

#include <cmath>
#include <cstdlib>
#include <limits>

namespace mtdb {

bool IsValidLayout(const AttributeLayout& layout) {
  size_t normal_left = 0;  // attributes of the normal that have to follow
  for (const VertexAttribute& a : layout.attributes) {
    if (normal_left > 0 || a.normal_bits > 0) {
      if (a.type != ScalarType::kFloat32 || a.step != 0) return false;
      if (normal_left > 0 && a.normal_bits > 0) return false;
      if (normal_left == 0 && (a.normal_bits < kMinNormalBits || a.normal_bits > kMaxNormalBits)) {
        return false;
      }
      normal_left = normal_left == 0 ? 2 : normal_left - 1;
    } else if (a.step != 0) {
      if (!(a.step > 0) || !std::isfinite(a.step) || a.type < ScalarType::kFloat32) return false;
    }
  }
  return normal_left == 0;
}

int64_t ScalarCode(double value, double step) {
  constexpr double kLimit = 0x1p52;
  const double code = std::floor(value / step + 0.5);
  return std::abs(code) <= kLimit ? static_cast<int64_t>(code) : 0;
}

float Float32OfCode(int64_t code, double step) {
  const double value = Float64OfCode(code, step);
  return std::abs(value) <= std::numeric_limits<float>::max() ? static_cast<float>(value) : 0;
}

double Float64OfCode(int64_t code, double step) {
  const double value = static_cast<double>(code) * step;
  return std::isfinite(value) ? value : 0;
}

OctahedralCode EncodeOctahedral(const Vec3d& normal, int bits) {
  const double sum = std::abs(normal.x) + std::abs(normal.y) + std::abs(normal.z);
  if (!(sum > 0) || !std::isfinite(sum)) return {};
  double s = normal.x / sum;
  double t = normal.y / sum;
  if (normal.z < 0) {
    const double outer_s = 1 - std::abs(t);
    const double outer_t = 1 - std::abs(s);
    s = s < 0 ? -outer_s : outer_s;
    t = t < 0 ? -outer_t : outer_t;
  }
  const int32_t centre = OctahedralCentre(bits);
  OctahedralCode code{static_cast<int32_t>(std::floor(s * centre + 0.5)),
                      static_cast<int32_t>(std::floor(t * centre + 0.5))};
  if (std::abs(code.t) == centre) code.s = std::abs(code.s);
  if (std::abs(code.s) == centre) code.t = std::abs(code.t);
  return code;
}

Vec3d DecodeOctahedral(OctahedralCode code, int bits) {
  const int32_t centre = OctahedralCentre(bits);
  int32_t x = code.s;
  int32_t y = code.t;
  const int32_t z = centre - std::abs(x) - std::abs(y);
  if (z < 0) {
    const int32_t inner_x = centre - std::abs(code.t);
    const int32_t inner_y = centre - std::abs(code.s);
    x = code.s < 0 ? -inner_x : inner_x;
    y = code.t < 0 ? -inner_y : inner_y;
  }
  const Vec3d v{static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)};
  const double length = std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z);
  const auto unit = [length](double c) {
    return static_cast<double>(static_cast<float>(c / length));
  };
  return {unit(v.x), unit(v.y), unit(v.z)};
}

}  // namespace mtdb
