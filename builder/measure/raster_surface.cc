// SPDX-License-Identifier: Apache-2.0
#include "builder/measure/raster_surface.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <optional>

#include "builder/measure/round_mesh.h"

namespace mtdb::internal {

namespace {

// The table has at most so many places for each triangle, and some more.
constexpr int64_t kMostPlaces = 16;
constexpr int64_t kSpare = 256;

struct Corner {
  int32_t x = 0, y = 0;
};

// Of half a cell: whether the cell is cut from the upper left to the lower right. Nothing of other
// triangles.
std::optional<bool> Falls(const std::array<Corner, 3>& c) {
  const auto [left, right] = std::minmax({c[0].x, c[1].x, c[2].x});
  const auto [bottom, top] = std::minmax({c[0].y, c[1].y, c[2].y});
  if (right - left != 1 || top - bottom != 1) return {};
  // The fourth corner of the cell.
  const int32_t x = 2 * (left + right) - c[0].x - c[1].x - c[2].x;
  const int32_t y = 2 * (bottom + top) - c[0].y - c[1].y - c[2].y;
  for (const Corner& corner : c) {
    if (corner.x == x && corner.y == y) return {};
  }
  return (x == left) == (y == bottom);
}

}  // namespace

bool RasterSurface::Build(std::span<const std::array<uint32_t, 3>> triangles,
                          std::span<const Vec3d> positions, std::span<const float> errors) {
  Clear();
  if (triangles.empty() || std::ranges::any_of(errors, [](float e) { return e != 0; })) {
    return false;
  }
  constexpr double kMost = 1 << 29;  // differences of such numbers fit
  Box3d box;
  for (const Vec3d p : positions) {
    if (!(std::abs(p.x) < kMost && std::abs(p.y) < kMost && std::abs(p.z) < kMost)) return false;
    box.Add(p);
  }
  // No sample all around, which may be looked at.
  left_ = static_cast<int32_t>(box.min.x) - 1;
  bottom_ = static_cast<int32_t>(box.min.y) - 1;
  width_ = static_cast<int32_t>(box.max.x) - left_ + 2;
  const int64_t places = int64_t{width_} * (static_cast<int32_t>(box.max.y) - bottom_ + 2);
  if (places > kMostPlaces * static_cast<int64_t>(triangles.size()) + kSpare) return false;
  const auto corner_of = [&](uint32_t v) {
    return Corner{static_cast<int32_t>(positions[v].x) - left_,
                  static_cast<int32_t>(positions[v].y) - bottom_};
  };
  for (size_t t = 0; t < triangles.size(); ++t) {
    const auto [a, b, c] = triangles[t];
    const std::optional<bool> falls = Falls({corner_of(a), corner_of(b), corner_of(c)});
    if (!falls || (t > 0 && *falls != falls_)) return false;
    falls_ = *falls;
  }
  heights_.assign(static_cast<size_t>(places), kNone);
  for (const auto& t : triangles) {
    for (const uint32_t v : t) {
      const Corner c = corner_of(v);
      int32_t& height = heights_[static_cast<size_t>(c.y * width_ + c.x)];
      const auto z = static_cast<int32_t>(positions[v].z);
      if (height != kNone && height != z) {
        Clear();
        return false;
      }
      height = z;
    }
  }
  return true;
}

// On each line the edge runs between two neighbours, p on its right and q on its left; a sample on
// the edge counts as left. With w, what |df| is, the distance of p from the crossing is side_p / w.
double RasterSurface::CrossFamily(const Edge& edge, const Family& family) const {
  const int32_t w = std::abs(family.df);
  if (w < 2) return 0;
  const int32_t f_stride = family.df < 0 ? -family.f_stride : family.f_stride;
  int32_t whole = family.dg / w;
  int32_t part = family.dg % w;
  if (part < 0) {
    part += w;
    --whole;
  }
  int32_t line = edge.at;
  int32_t remainder = 0;
  double most = 0;
  for (int32_t s = 1; s < w; ++s) {
    line += f_stride + whole * family.g_stride;
    remainder += part;
    if (remainder >= w) {
      remainder -= w;
      line += family.g_stride;
    }
    int32_t left = line;  // the place of q
    int32_t right = line;
    int32_t side_p = w - remainder;
    if (family.right_is_up) {
      right += family.g_stride;
    } else if (remainder > 0) {
      left += family.g_stride;
      side_p = remainder;
    } else {
      right -= family.g_stride;
    }
    const int32_t p = heights_[static_cast<size_t>(right)];
    const int32_t q = heights_[static_cast<size_t>(left)];
    if (p == kNone || q == kNone) return -1;
    const double at_surface = (p - edge.z) * w + (q - p) * static_cast<double>(side_p);
    const double at_edge = edge.dz * ((s * edge.flat2) * edge.inverse_flat2);
    most = std::max(most, std::abs(at_surface - at_edge));
  }
  return most / w;
}

double RasterSurface::CurveError(Vec3d a, Vec3d b) const {
  const Corner from{static_cast<int32_t>(a.x) - left_, static_cast<int32_t>(a.y) - bottom_};
  const auto dx = static_cast<int32_t>(b.x - a.x);
  const auto dy = static_cast<int32_t>(b.y - a.y);
  const int32_t df = falls_ ? dx + dy : dx - dy;
  const auto crossings = [](int32_t d) { return std::max(std::abs(d) - 1, 0); };
  if (crossings(dx) + crossings(dy) + crossings(df) > RoundMesh::kMaxSteps) return -1;
  const double flat2 = (b.x - a.x) * (b.x - a.x) + (b.y - a.y) * (b.y - a.y);
  const Edge edge{from.y * width_ + from.x, a.z, b.z - a.z, flat2, 1 / flat2};
  const double columns = CrossFamily(edge, {dx, dy, 1, width_, dx < 0});
  const double rows = CrossFamily(edge, {dy, dx, width_, 1, dy > 0});
  const double diagonals = CrossFamily(edge, falls_ ? Family{df, dx, width_, 1 - width_, df > 0}
                                                    : Family{df, dx, -width_, width_ + 1, df < 0});
  if (columns < 0 || rows < 0 || diagonals < 0) return -1;
  return std::max({columns, rows, diagonals});
}

}  // namespace mtdb::internal
