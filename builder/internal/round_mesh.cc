#include "builder/internal/round_mesh.h"

#include <algorithm>
#include <cmath>

namespace mtdb::internal {

namespace {
constexpr int kMaxSteps = 256;  // of a path; longer ones are not worth their error
constexpr uint32_t Next(uint32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }
}  // namespace

void RoundMesh::Build(std::span<const std::array<uint32_t, 3>> triangles,
                      std::span<const uint32_t> opposites, std::span<const Vec3d> positions,
                      std::span<const float> errors) {
  const auto n = static_cast<uint32_t>(triangles.size());
  const auto vertex_count = static_cast<uint32_t>(positions.size());
  positions_.assign(positions.begin(), positions.end());
  errors_.assign(errors.begin(), errors.end());
  opposite_.assign(opposites.begin(), opposites.end());
  origin_.resize(3 * n);
  normals_.resize(n);
  outgoing_begin_.assign(vertex_count + 1, 0);
  for (uint32_t t = 0; t < n; ++t) {
    const auto& v = triangles[t];
    for (uint32_t c = 0; c < 3; ++c) {
      origin_[3 * t + c] = v[c];
      ++outgoing_begin_[v[c] + 1];
    }
    normals_[t] = Cross(positions[v[1]] - positions[v[0]], positions[v[2]] - positions[v[0]]);
  }
  for (uint32_t v = 0; v < vertex_count; ++v) outgoing_begin_[v + 1] += outgoing_begin_[v];
  outgoing_.resize(3 * n);
  std::vector<uint32_t> at(outgoing_begin_.begin(), outgoing_begin_.end() - 1);
  for (uint32_t h = 0; h < 3 * n; ++h) outgoing_[at[origin_[h]]++] = h;
  SortFans();
  MeasureVertices();
}

// Puts each vertex's half-edges in counter-clockwise order, fan after fan, so that a neighbour that
// two triangles share is looked at once.
void RoundMesh::SortFans() {
  std::vector<uint32_t> fan;
  for (uint32_t v = 0; v < positions_.size(); ++v) {
    const std::span<uint32_t> out = std::span(outgoing_).subspan(
        outgoing_begin_[v], outgoing_begin_[v + 1] - outgoing_begin_[v]);
    fan.clear();
    const auto follow = [&](uint32_t first) {
      uint32_t h = first;
      do {
        fan.push_back(h);
        h = opposite_[Next(Next(h))];
      } while (h != kNone32 && h != first);
    };
    for (const uint32_t h : out) {
      if (opposite_[h] == kNone32) follow(h);
    }
    if (fan.empty()) follow(out[0]);
    // Closed fans beside others, at non-manifold vertices, keep their order.
    if (fan.size() == out.size()) std::copy(fan.begin(), fan.end(), out.begin());
  }
}

void RoundMesh::MeasureVertices() {
  vertex_errors_.assign(positions_.size(), 0);
  cones_.assign(positions_.size(), Cone{});
  for (uint32_t v = 0; v < positions_.size(); ++v) {
    Vec3d sum{};
    for (const uint32_t h : half_edges_from(v)) {
      vertex_errors_[v] = std::max(vertex_errors_[v], static_cast<double>(errors_[h / 3]));
      const double length = Length(normals_[h / 3]);
      if (length > 0) sum += normals_[h / 3] * (1 / length);
    }
    const double length = Length(sum);
    if (length <= 0) continue;
    Cone& cone = cones_[v];
    cone.axis = sum * (1 / length);
    double least = 1;
    for (const uint32_t h : half_edges_from(v)) {
      const Vec3d normal = normals_[h / 3];
      const double l = Length(normal);
      // A triangle of no area faces nowhere: no cone holds it.
      least = l > 0 ? std::min(least, Dot(normal, cone.axis) / l) : -1;
    }
    if (least > 0) cone.sine = std::sqrt(std::max(0.0, 1 - least * least)) + 1e-9;
  }
}

double RoundMesh::Height(uint32_t vertex) const {
  const std::span<const uint32_t> out = half_edges_from(vertex);
  const Vec3d axis = cones_[vertex].axis;
  double sum = 0;
  for (const uint32_t h : out) {
    sum += Dot(positions_[origin_[Next(h)]] - positions_[vertex], axis);
  }
  return std::abs(sum) / static_cast<double>(out.size());
}

bool RoundMesh::Faces(uint32_t vertex, Vec3d n) const {
  const Cone& cone = cones_[vertex];
  if (Dot(cone.axis, n) > cone.sine) return true;
  for (const uint32_t h : half_edges_from(vertex)) {
    if (!(Dot(normals_[h / 3], n) > 0)) return false;
  }
  return true;
}

// Long, since the search for the path's first triangle and the walk along it share six variables.
double RoundMesh::CurveError(uint32_t a, uint32_t b, Vec3d n) const {
  const Vec3d pa = positions_[a];
  const Vec3d pb = positions_[b];
  const Vec3d ab = pb - pa;
  const Vec3d right = Cross(ab, n);  // points right of ab have a positive side
  const double ab2 = SquaredLength(ab);
  // The input triangle at a through which the path leaves, between q (left) and p (right).
  uint32_t h = kNone32;
  double side_p = 0;
  double side_q = 0;
  uint32_t last_q = kNone32;
  double last_side = 0;
  for (const uint32_t out : half_edges_from(a)) {
    const uint32_t p = origin_[Next(out)];
    const uint32_t q = origin_[Next(Next(out))];
    if (p == b || q == b) {
      // ab is an input edge: it is its own curve.
      const uint32_t edge = p == b ? out : Next(Next(out));
      double error = errors_[edge / 3];
      if (opposite_[edge] != kNone32) {
        error = std::max(error, static_cast<double>(errors_[opposite_[edge] / 3]));
      }
      return error;
    }
    const double sp = p == last_q ? last_side : Dot(right, positions_[p] - pa);
    const double sq = Dot(right, positions_[q] - pa);
    last_q = q;
    last_side = sq;
    if (sp > 0 && sq <= 0 && Dot(normals_[out / 3], n) > 0) {
      // Between p and q; forwards, since the triangle faces n and a convex angle is below 180.
      h = Next(out);
      side_p = sp;
      side_q = sq;
    }
  }
  if (h == kNone32) return -1;
  double error = 0;
  const double inverse_ab2 = 1 / ab2;
  for (int step = 0; step < kMaxSteps; ++step) {
    // The path crosses h, from p (right) to q (left), at c; w * (c - a) needs no division.
    const Vec3d pp = positions_[origin_[h]];
    const Vec3d pq = positions_[origin_[Next(h)]];
    const uint32_t o = opposite_[h];
    if (o == kNone32) return -1;
    if (!(Dot(normals_[o / 3], n) > 0)) return -1;
    const double w = side_p - side_q;
    const Vec3d wac = (pp - pa) * w + (pq - pp) * side_p;
    const double t = Dot(wac, ab);
    const Vec3d offset = t <= 0 ? wac : t >= ab2 * w ? wac - ab * w : wac - ab * (t * inverse_ab2);
    const double accumulated =
        std::max(static_cast<double>(errors_[h / 3]), static_cast<double>(errors_[o / 3]));
    const double d2 = SquaredLength(offset);
    const double known = (error - accumulated) * w;
    if (known < 0 || d2 > known * known) error = std::sqrt(d2) / w + accumulated;
    const uint32_t x = origin_[Next(Next(o))];
    if (x == b) return error;
    const double side = Dot(right, positions_[x] - pa);
    // Triangle o is (q, p, x): the path leaves through (p, x) or (x, q).
    if (side > 0) {
      h = Next(Next(o));  // x -> q: x is on the right
      side_p = side;
    } else {
      h = Next(o);  // p -> x
      side_q = side;
    }
  }
  return -1;
}

}  // namespace mtdb::internal
