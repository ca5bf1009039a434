// SPDX-License-Identifier: Apache-2.0
#include "builder/internal/round_mesh.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace mtdb::internal {

namespace {
constexpr uint32_t Next(uint32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }
}  // namespace

void RoundMesh::Build(std::span<const std::array<uint32_t, 3>> triangles,
                      std::span<const uint32_t> opposites, std::span<const Vec3d> positions,
                      std::span<const float> errors) {
  const auto n = static_cast<uint32_t>(triangles.size());
  const auto vertex_count = static_cast<uint32_t>(positions.size());
  vertices_.resize(vertex_count);
  for (uint32_t v = 0; v < vertex_count; ++v) vertices_[v] = {positions[v], 0};
  triangles_.resize(n);
  spokes_begin_.assign(vertex_count + 1, 0);
  for (uint32_t t = 0; t < n; ++t) {
    const std::span<const uint32_t> across = opposites.subspan(3 * t, 3);
    triangles_[t] = {triangles[t], {across[0], across[1], across[2]}, errors[t]};
    for (const uint32_t v : triangles[t]) ++spokes_begin_[v + 1];
  }
  for (uint32_t v = 0; v < vertex_count; ++v) spokes_begin_[v + 1] += spokes_begin_[v];
  spokes_.resize(3 * n);
  std::vector<uint32_t> at(spokes_begin_.begin(), spokes_begin_.end() - 1);
  for (uint32_t h = 0; h < 3 * n; ++h) {
    spokes_[at[origin(h)]++] = {h, origin(Next(h)), origin(Next(Next(h)))};
  }
  SortFans();
  MeasureVertices();
}

// Not normalised.
Vec3d RoundMesh::Normal(uint32_t t) const {
  const auto [a, b, c] = triangles_[t].corners;
  const Vec3d first = vertices_[a].position;
  return Cross(vertices_[b].position - first, vertices_[c].position - first);
}

// Puts each vertex's spokes in counter-clockwise order, fan after fan, so that a neighbour that two
// triangles share is looked at once.
void RoundMesh::SortFans() {
  std::vector<Spoke> fan;
  for (uint32_t v = 0; v < vertices_.size(); ++v) {
    const std::span<Spoke> all =
        std::span(spokes_).subspan(spokes_begin_[v], spokes_begin_[v + 1] - spokes_begin_[v]);
    fan.clear();
    const auto follow = [&](uint32_t first) {
      uint32_t h = first;
      do {
        const uint32_t back = Next(Next(h));
        fan.push_back({h, origin(Next(h)), origin(back)});
        h = opposite(back);
      } while (h != kNone32 && h != first);
    };
    for (const Spoke& spoke : all) {
      if (opposite(spoke.half_edge) == kNone32) follow(spoke.half_edge);
    }
    if (fan.empty()) follow(all[0].half_edge);
    // Closed fans beside others, at non-manifold vertices, keep their order.
    if (fan.size() == all.size()) std::copy(fan.begin(), fan.end(), all.begin());
  }
}

void RoundMesh::MeasureVertices() {
  cones_.assign(vertices_.size(), Cone{});
  std::vector<Vec3d> units(triangles_.size());  // normals; zero of triangles without area
  for (uint32_t t = 0; t < units.size(); ++t) {
    const Vec3d normal = Normal(t);
    const double length = Length(normal);
    if (length > 0) units[t] = normal * (1 / length);
  }
  for (uint32_t v = 0; v < vertices_.size(); ++v) {
    Vec3d sum{};
    for (const Spoke& spoke : spokes(v)) {
      const uint32_t t = spoke.half_edge / 3;
      vertices_[v].error = std::max(vertices_[v].error, static_cast<double>(triangles_[t].error));
      sum += units[t];
    }
    const double length = Length(sum);
    if (length <= 0) continue;
    Cone& cone = cones_[v];
    cone.axis = sum * (1 / length);
    double least = 1;
    for (const Spoke& spoke : spokes(v)) {
      const Vec3d unit = units[spoke.half_edge / 3];
      // A triangle of no area faces nowhere: no cone holds it.
      least = SquaredLength(unit) > 0 ? std::min(least, Dot(unit, cone.axis)) : -1;
    }
    if (least > 0) {
      cone.sine = std::sqrt(std::max(0.0, 1 - least * least)) + 1e-9;
      cone.once = GoesAroundOnce(v);
    }
  }
}

// Of a vertex whose triangles all face its axis. Seen along that, and along whatever else all of
// them face, they turn one way around the vertex: as often as they cross a line from left to right.
bool RoundMesh::GoesAroundOnce(uint32_t vertex) const {
  const std::span<const Spoke> around = spokes(vertex);
  const auto back = [](const Spoke& spoke) { return Next(Next(spoke.half_edge)); };
  const Vec3d at = vertices_[vertex].position;
  const Vec3d right = Cross(vertices_[around[0].right].position - at, cones_[vertex].axis);
  int crossings = 0;
  for (size_t i = 0; i < around.size(); ++i) {
    // A single closed fan, in order.
    if (opposite(back(around[i])) != around[i + 1 == around.size() ? 0 : i + 1].half_edge)
      return false;
    crossings += Dot(right, vertices_[around[i].right].position - at) > 0 &&
                 !(Dot(right, vertices_[around[i].left].position - at) > 0);
  }
  return crossings == 1;
}

double RoundMesh::Height(uint32_t vertex) const {
  const Vec3d axis = cones_[vertex].axis;
  double sum = 0;
  for (const Spoke& spoke : spokes(vertex)) {
    sum += Dot(vertices_[spoke.right].position - vertices_[vertex].position, axis);
  }
  return std::abs(sum) / static_cast<double>(spokes(vertex).size());
}

bool RoundMesh::Faces(uint32_t vertex, Vec3d n) const {
  const Cone& cone = cones_[vertex];
  if (Dot(cone.axis, n) > cone.sine) return true;
  for (const Spoke& spoke : spokes(vertex)) {
    if (!(Dot(Normal(spoke.half_edge / 3), n) > 0)) return false;
  }
  return true;
}

// Finds the input triangle at `a` through which a path leaves along a line, seen along n; points
// right of the line have a positive product with `right`. Where there are several, or some that
// are turned away, only one with a corner that is_near will do. False when that leaves none, or
// several.
bool RoundMesh::FindStart(uint32_t a, Vec3d right, Vec3d n, const VertexMarks& is_near,
                          Start* start) const {
  const Vec3d pa = vertices_[a].position;
  const bool once = IsOnce(a, n);
  start->across = kNone32;
  uint32_t sheets = 0;
  uint32_t near = 0;
  uint32_t last = kNone32;
  Vec3d last_position{};
  double last_side = 0;
  for (const Spoke& spoke : spokes(a)) {
    const bool shared = spoke.right == last;
    const Vec3d first = shared ? last_position : vertices_[spoke.right].position;
    const double first_side = shared ? last_side : Dot(right, first - pa);
    last = spoke.left;
    last_position = vertices_[last].position;
    last_side = Dot(right, last_position - pa);
    if ((first_side > 0) == (last_side > 0)) continue;
    const bool faces = Dot(Cross(first - pa, last_position - pa), n) > 0;
    // A convex angle is below 180 degrees, so that the other two kinds lie behind a.
    if (faces != (first_side > 0)) continue;
    ++sheets;
    if (!faces) continue;
    const bool is_meant = is_near(spoke.right) || is_near(spoke.left);
    near += is_meant;
    if (is_meant || near == 0) {
      *start = {Next(spoke.half_edge), first, last_position, first_side, last_side, once};
      if (once) return true;
    }
  }
  start->only = sheets == 1 && start->across != kNone32;
  return start->only || near == 1;
}

template <ErrorMeasure kKind>
RoundMesh::Curve RoundMesh::CurveOf(uint32_t a, uint32_t b, Vec3d n,
                                    const VertexMarks& is_near) const {
  const std::span<const Spoke> around = spokes(a);
  for (const Spoke& spoke : around) {
    if (spoke.right != b && spoke.left != b) continue;
    // ab is an input edge: it is its own curve.
    const uint32_t edge = spoke.right == b ? spoke.half_edge : Next(Next(spoke.half_edge));
    const uint32_t across = opposite(edge);
    const float error = triangles_[edge / 3].error;
    return {across == kNone32 ? error : std::max(error, triangles_[across / 3].error), 0};
  }
  const Vec3d pa = vertices_[a].position;
  const Vec3d pb = vertices_[b].position;
  const Vec3d ab = pb - pa;
  const Vec3d right = Cross(ab, n);  // points right of ab have a positive side
  const double ab2 = SquaredLength(ab);
  Start start;
  if (!FindStart(a, right, n, is_near, &start)) return {};
  auto [h, pp, pq, side_p, side_q, only] = start;
  double error = 0;
  const double inverse_ab2 = 1 / ab2;
  double least = std::numeric_limits<double>::infinity();
  double before = triangles_[h / 3].error;  // of the triangle that the path leaves
  const double inverse_flat2 = 1 / (ab.x * ab.x + ab.y * ab.y);
  for (int step = 0; step < kMaxSteps; ++step) {
    const uint32_t o = opposite(h);
    if (o == kNone32) return {};
    const Triangle& next = triangles_[o / 3];  // (q, p, x), from corner o % 3 on
    const uint32_t x = next.corners[Next(Next(o)) % 3];
    const Vec3d px = vertices_[x].position;
    if (!(Dot(Cross(pp - pq, px - pq), n) > 0)) return {};
    // The path crosses h, from p (right) to q (left), at c; w * (c - a) needs no division.
    const double w = side_p - side_q;
    const Vec3d wac = (pp - pa) * w + (pq - pp) * side_p;
    const double after = next.error;
    const double accumulated = std::max(before, after);
    before = after;
    least = std::min(least, accumulated);
    if constexpr (kKind == ErrorMeasure::kVertical) {
      const double at_edge = ab.z * ((wac.x * ab.x + wac.y * ab.y) * inverse_flat2);
      error = std::max(error, std::abs(wac.z - at_edge) / w + accumulated);
    } else {
      const double t = Dot(wac, ab);
      const Vec3d offset = t <= 0         ? wac
                           : t >= ab2 * w ? wac - ab * w
                                          : wac - ab * (t * inverse_ab2);
      const double d2 = SquaredLength(offset);
      const double known = (error - accumulated) * w;
      if (known < 0 || d2 > known * known) error = std::sqrt(d2) / w + accumulated;
    }
    if (x == b) {
      // Seen from b, a vertex on the line is passed on its other side.
      const bool meant =
          kKind == ErrorMeasure::kVertical || IsOnce(b, n) ||
          (FindStart(b, right * -1, n, is_near, &start) && (start.only || start.across == o));
      if (!meant) return {};
      return {error, error - least};
    }
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
  return {};
}

template RoundMesh::Curve RoundMesh::CurveOf<ErrorMeasure::kTwoSidedDistance>(
    uint32_t, uint32_t, Vec3d, const VertexMarks&) const;
template RoundMesh::Curve RoundMesh::CurveOf<ErrorMeasure::kVertical>(uint32_t, uint32_t, Vec3d,
                                                                      const VertexMarks&) const;

}  // namespace mtdb::internal
