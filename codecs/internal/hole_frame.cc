#include "codecs/internal/hole_frame.h"

#include <algorithm>
#include <cmath>

namespace mtdb {

namespace {

int32_t RoundToGrid(double x) {
  const double clamped = std::min(std::max(x, -2147483647.0), 2147483646.0);
  const double up = clamped + 0.5;
  const auto truncated = static_cast<int32_t>(up);
  return truncated - (static_cast<double>(truncated) > up ? 1 : 0);
}

}  // namespace

HoleFrame::HoleFrame(const Patch& patch, bool boundary)
    : ring_count_(patch.ring().size()), hole_count_(patch.hole().size()) {
  const std::span<const uint32_t> ring = patch.ring();
  const std::span<const uint32_t> hole = patch.hole();
  Vec3d sum;
  for (size_t h = 0; h < hole_count_; ++h) {
    const auto& corners = patch.triangle(hole[h]).corners;
    for (size_t c = 0; c < 3; ++c) {
      const Vec3d p = patch.point(corners[c]);
      for (int i = 0; i < 3; ++i) hole_[h][c][i] = p[i];
      sum += p;
    }
  }
  if (boundary) {
    mean_ = (patch.point(ring[0]) + patch.point(ring[ring_count_ - 1])) * 0.5;
  } else {
    // Each ring vertex counts as often as hole triangles meet there.
    mean_ = sum * (1 / static_cast<double>(3 * hole_count_));
  }
  Vec3d before = patch.point(ring[ring_count_ - 1]) - mean_;
  Vec3d squares, products;  // xx yy zz, yz zx xy
  for (size_t j = 0; j < ring_count_; ++j) {
    const Vec3d d = patch.point(ring[j]) - mean_;
    for (int i = 0; i < 3; ++i) ring_[j][i] = d[i];
    normal_ += Cross(before, d);
    squares += Vec3d{d.x * d.x, d.y * d.y, d.z * d.z};
    products += Vec3d{d.y * d.z, d.z * d.x, d.x * d.y};
    before = d;
  }
  const Vec3d size{std::abs(normal_.x), std::abs(normal_.y), std::abs(normal_.z)};
  n_ = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
  u_ = n_ == 2 ? 0 : n_ + 1;
  v_ = u_ == 2 ? 0 : u_ + 1;
  const double inverse = 1 / static_cast<double>(ring_count_);
  uu_ = squares[u_] * inverse;
  const double uv = products[n_] * inverse;
  if (uu_ > 0) slope_ = uv / uu_;
  vv_ = std::max(squares[v_] * inverse - slope_ * uv, 0.0);
}

Expectation HoleFrame::ExpectU() const { return {RoundToGrid(mean_[u_]), uu_}; }

Expectation HoleFrame::ExpectV(int32_t u) const {
  return {RoundToGrid(mean_[v_] + slope_ * (u - mean_[u_])), vv_};
}

int32_t HoleFrame::ExpectN(int32_t u, int32_t v) const {
  // The hole triangle above (u, v), by the areas of the three triangles that (u, v) cuts it into.
  const double sign = normal_[n_] > 0 ? 1 : -1;
  for (size_t h = 0; h < hole_count_; ++h) {
    const auto& [a, b, c] = hole_[h];
    const double au = a[u_] - u, av = a[v_] - v;
    const double bu = b[u_] - u, bv = b[v_] - v;
    const double cu = c[u_] - u, cv = c[v_] - v;
    const double wa = bu * cv - bv * cu;
    const double wb = cu * av - cv * au;
    const double wc = au * bv - av * bu;
    const double area = wa + wb + wc;
    if (std::min(std::min(wa * sign, wb * sign), wc * sign) < 0 || area == 0) continue;
    return RoundToGrid((wa * a[n_] + wb * b[n_] + wc * c[n_]) / area);
  }
  if (normal_[n_] == 0) return RoundToGrid(mean_[n_]);
  const double drop = normal_[u_] * (u - mean_[u_]) + normal_[v_] * (v - mean_[v_]);
  return RoundToGrid(mean_[n_] - drop / normal_[n_]);
}

double HoleFrame::slant() const {
  return normal_[n_] == 0 ? 1 : std::sqrt(SquaredLength(normal_)) / std::abs(normal_[n_]);
}

double HoleFrame::unevenness() const {
  if (normal_[n_] == 0) return 0;
  const double a = normal_[u_] / normal_[n_];
  const double b = normal_[v_] / normal_[n_];
  double sum = 0;
  for (size_t j = 0; j < ring_count_; ++j) {
    const double height = ring_[j][n_] + a * ring_[j][u_] + b * ring_[j][v_];
    sum += height * height;
  }
  return sum / static_cast<double>(ring_count_);
}

}  // namespace mtdb
