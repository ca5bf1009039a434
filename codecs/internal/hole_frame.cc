#include "codecs/internal/hole_frame.h"

#include <algorithm>
#include <cmath>

namespace mtdb {

namespace {

int32_t RoundToGrid(double x) {
  return static_cast<int32_t>(std::floor(std::clamp(x + 0.5, -2147483648.0, 2147483647.0)));
}

}  // namespace

HoleFrame::HoleFrame(const Patch& patch, const std::vector<Vec3d>& points, bool boundary)
    : patch_(patch), points_(points) {
  const std::vector<uint32_t>& ring = patch.ring();
  const size_t k = ring.size();
  Vec3d sum;
  if (boundary) {
    sum = points[ring[0]] + points[ring[k - 1]];
    mean_ = {sum.x / 2, sum.y / 2, sum.z / 2};
  } else {
    // Each ring vertex counts as often as hole triangles meet there.
    for (const uint32_t slot : patch.hole()) {
      for (const uint32_t v : patch.triangle(slot).corners) sum += points[v];
    }
    const auto count = static_cast<double>(3 * patch.hole().size());
    mean_ = {sum.x / count, sum.y / count, sum.z / count};
  }
  Vec3d before = points[ring[k - 1]] - mean_;
  Vec3d squares, products;  // xx yy zz, yz zx xy
  for (size_t j = 0; j < k; ++j) {
    const Vec3d d = points[ring[j]] - mean_;
    normal_ += Cross(before, d);
    squares += Vec3d{d.x * d.x, d.y * d.y, d.z * d.z};
    products += Vec3d{d.y * d.z, d.z * d.x, d.x * d.y};
    before = d;
  }
  const Vec3d size{std::abs(normal_.x), std::abs(normal_.y), std::abs(normal_.z)};
  n_ = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
  u_ = n_ == 2 ? 0 : n_ + 1;
  v_ = u_ == 2 ? 0 : u_ + 1;
  const double inverse = 1 / static_cast<double>(k);
  uu_ = squares[u_] * inverse;
  const double uv = products[n_] * inverse;
  if (uu_ > 0) slope_ = uv / uu_;
  vv_ = std::max(squares[v_] * inverse - slope_ * uv, 0.0);
  if (size[n_] > 0) {
    slant_ = std::sqrt(SquaredLength(normal_)) / size[n_];
    double nn = 0;
    const double a = normal_[u_] / normal_[n_];
    const double b = normal_[v_] / normal_[n_];
    for (size_t j = 0; j < k; ++j) {
      const Vec3d d = points[ring[j]] - mean_;
      const double height = d[n_] + a * d[u_] + b * d[v_];
      nn += height * height;
    }
    nn_ = nn * inverse;
  }
}

Expectation HoleFrame::ExpectU() const { return {RoundToGrid(mean_[u_]), uu_}; }

Expectation HoleFrame::ExpectV(int32_t u) const {
  return {RoundToGrid(mean_[v_] + slope_ * (u - mean_[u_])), vv_};
}

Expectation HoleFrame::ExpectN(int32_t u, int32_t v) const {
  // The hole triangle above (u, v), by the areas of the three triangles that (u, v) cuts it into.
  for (const uint32_t slot : patch_.hole()) {
    const auto& corners = patch_.triangle(slot).corners;
    const Vec3d& a = points_[corners[0]];
    const Vec3d& b = points_[corners[1]];
    const Vec3d& c = points_[corners[2]];
    const double au = a[u_] - u, av = a[v_] - v;
    const double bu = b[u_] - u, bv = b[v_] - v;
    const double cu = c[u_] - u, cv = c[v_] - v;
    const double wa = bu * cv - bv * cu;
    const double wb = cu * av - cv * au;
    const double wc = au * bv - av * bu;
    const bool inside = normal_[n_] > 0 ? (wa >= 0 && wb >= 0 && wc >= 0)
                                        : (wa <= 0 && wb <= 0 && wc <= 0);
    const double area = wa + wb + wc;
    if (!inside || area == 0) continue;
    return {RoundToGrid((wa * a[n_] + wb * b[n_] + wc * c[n_]) / area), nn_};
  }
  if (normal_[n_] == 0) return {RoundToGrid(mean_[n_]), nn_};
  const double drop = normal_[u_] * (u - mean_[u_]) + normal_[v_] * (v - mean_[v_]);
  return {RoundToGrid(mean_[n_] - drop / normal_[n_]), nn_};
}

}  // namespace mtdb
