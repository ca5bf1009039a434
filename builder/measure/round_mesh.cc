// SPDX-License-Identifier: Apache-2.0
#include "builder/measure/round_mesh.h"

#include <algorithm>
#include <cmath>

#include "builder/holes/tile_mesh.h"

namespace mtdb::internal {

void RoundMesh::Build(std::span<const std::array<uint32_t, 3>> triangles,
                      std::span<const uint32_t> opposites, std::span<const Vec3d> positions,
                      std::span<const float> errors) {
  const auto n = static_cast<uint32_t>(triangles.size());
  positions_.assign(positions.begin(), positions.end());
  triangles_.resize(n);
  spokes_begin_.assign(positions.size() + 1, 0);
  for (uint32_t t = 0; t < n; ++t) {
    const std::span<const uint32_t> across = opposites.subspan(3 * t, 3);
    triangles_[t] = {triangles[t], {across[0], across[1], across[2]}, errors[t]};
    for (const uint32_t v : triangles[t]) ++spokes_begin_[v + 1];
  }
  for (size_t v = 0; v < positions.size(); ++v) spokes_begin_[v + 1] += spokes_begin_[v];
  spokes_.resize(3 * n);
  std::vector<uint32_t> at(spokes_begin_.begin(), spokes_begin_.end() - 1);
  for (uint32_t h = 0; h < 3 * n; ++h) {
    spokes_[at[origin(h)]++] = {h, origin(Next(h)), origin(Next(Next(h)))};
  }
}

// Finds the triangle at `a` through which a path leaves along a line; points right of the line have
// a positive product with `right`. All triangles face up, so that there is one at most.
bool RoundMesh::FindStart(uint32_t a, Vec3d right, Start* start) const {
  const Vec3d pa = positions_[a];
  for (const Spoke& spoke : spokes(a)) {
    const Vec3d p = positions_[spoke.right];
    const Vec3d q = positions_[spoke.left];
    const double side_p = Dot(right, p - pa);
    const double side_q = Dot(right, q - pa);
    // A convex angle is below 180 degrees, so that the other kinds lie behind a.
    if (!(side_p > 0) || side_q > 0) continue;
    *start = {Next(spoke.half_edge), p, q, side_p, side_q};
    return true;
  }
  return false;
}

double RoundMesh::CurveError(uint32_t a, uint32_t b) const {
  for (const Spoke& spoke : spokes(a)) {
    if (spoke.right != b && spoke.left != b) continue;
    // ab is an edge of the surface: it is its own curve.
    const uint32_t edge = spoke.right == b ? spoke.half_edge : Next(Next(spoke.half_edge));
    const uint32_t across = opposite(edge);
    const float error = triangles_[edge / 3].error;
    return across == kNone32 ? error : std::max(error, triangles_[across / 3].error);
  }
  const Vec3d pa = positions_[a];
  const Vec3d ab = positions_[b] - pa;
  const Vec3d right = {ab.y, -ab.x, 0};  // points right of ab have a positive side
  const double inverse_flat2 = 1 / (ab.x * ab.x + ab.y * ab.y);
  Start start;
  if (!FindStart(a, right, &start)) return -1;
  auto [h, pp, pq, side_p, side_q] = start;
  double error = 0;
  double before = triangles_[h / 3].error;  // of the triangle that the path leaves
  for (int step = 0; step < kMaxSteps; ++step) {
    const uint32_t o = opposite(h);
    if (o == kNone32) return -1;
    const Triangle& next = triangles_[o / 3];  // (q, p, x), from corner o % 3 on
    const uint32_t x = next.corners[Next(Next(o)) % 3];
    const Vec3d px = positions_[x];
    if (!(Cross(pp - pq, px - pq).z > 0)) return -1;
    // The path crosses h, from p (right) to q (left), at c; w * (c - a) needs no division.
    const double w = side_p - side_q;
    const Vec3d wac = (pp - pa) * w + (pq - pp) * side_p;
    const double after = next.error;
    const double accumulated = std::max(before, after);
    before = after;
    const double at_edge = ab.z * ((wac.x * ab.x + wac.y * ab.y) * inverse_flat2);
    error = std::max(error, std::abs(wac.z - at_edge) / w + accumulated);
    if (x == b) return error;
    const double side = Dot(right, px - pa);
    if (side > 0) {
      h = Next(Next(o));  // x -> q: x is on the right
      pp = px;
      side_p = side;
    } else {
      h = Next(o);  // p -> x
      pq = px;
      side_q = side;
    }
  }
  return -1;
}

}  // namespace mtdb::internal
