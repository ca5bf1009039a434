// SPDX-License-Identifier: Apache-2.0
// Terrains against CGAL and brute force: every cut is the Delaunay triangulation of its vertices,
// and no height is farther off than promised.
#include <catch2/catch.hpp>
#include <map>
#include <random>
#include <set>

#include "builder/holes/delaunay_filling.h"
#include "tests/builder/cgal_plane.h"
#include "tests/builder/fixture.h"
#include "tests/builder/terrain_fixture.h"
#include "tests/support/memory_raster.h"

namespace mtdb::testing {

using namespace internal;

namespace {

using Corners = std::array<uint32_t, 3>;

std::vector<Vec3i> Lattice(const Terrain& t, const TriangleMesh& cut) {
  std::vector<Vec3i> points;
  for (const Vec3d& p : cut.positions) points.push_back(t.built.record.grid.Quantize(p));
  return points;
}

template <typename Triangulation>
std::set<Corners> FacesOf(const Triangulation& triangulation) {
  std::set<Corners> faces;
  for (const auto& face : triangulation.finite_face_handles()) {
    Corners c = {face->vertex(0)->info(), face->vertex(1)->info(), face->vertex(2)->info()};
    std::sort(c.begin(), c.end());
    faces.insert(c);
  }
  return faces;
}

std::set<Corners> FacesOf(const std::vector<TriangleVertices>& triangles) {
  std::set<Corners> faces;
  for (const TriangleVertices& t : triangles) {
    Corners c{};
    for (size_t i = 0; i < 3; ++i) c[i] = static_cast<uint32_t>(t[i]);
    std::sort(c.begin(), c.end());
    faces.insert(c);
  }
  return faces;
}

// Face for face, what CGAL's perturbation gives for the cut's vertices, in an order of its own.
void RequireDelaunay(const Terrain& t, const TriangleMesh& cut, bool whole) {
  const std::vector<Vec3i> points = Lattice(t, cut);
  const std::set<Corners> faces = FacesOf(cut.triangles);
  if (whole) {
    CgalDelaunay cgal;
    for (uint32_t v = 0; v < points.size(); ++v) {
      cgal.insert(Point2(points[v].x, points[v].y))->info() = v;
    }
    REQUIRE(faces == FacesOf(cgal));
    return;
  }
  CgalConstrained cgal;
  std::vector<CgalConstrained::Vertex_handle> handles;
  for (uint32_t v = 0; v < points.size(); ++v) {
    handles.push_back(cgal.insert(Point2(points[v].x, points[v].y)));
    handles.back()->info() = v;
  }
  std::set<std::pair<uint32_t, uint32_t>> edges;
  for (const TriangleVertices& c : cut.triangles) {
    for (size_t i = 0; i < 3; ++i) {
      edges.emplace(static_cast<uint32_t>(c[i]), static_cast<uint32_t>(c[(i + 1) % 3]));
    }
  }
  for (const auto& [a, b] : edges) {
    if (!edges.contains({b, a})) cgal.insert_constraint(handles[a], handles[b]);
  }
  const std::set<Corners> expected = FacesOf(cgal);
  for (const Corners& face : faces) REQUIRE(expected.contains(face));
}

// The height of the full surface at (x, y) in columns and lattice rows; NaN in a hole.
double FullHeight(const Terrain& t, double x, double y) {
  const auto c = std::min(static_cast<uint32_t>(x), t.columns - 2);
  const auto j = std::min(static_cast<uint32_t>(y), t.rows - 2);
  const auto at = [&](uint32_t i, uint32_t k) {
    return t.heights[size_t{t.frame.Row(static_cast<int32_t>(k))} * t.columns + i];
  };
  const double u = x - c;
  const double v = y - j;
  if (u + v <= 1) {
    const double a = at(c, j);
    return a + u * (at(c + 1, j) - a) + v * (at(c, j + 1) - a);
  }
  const double e = at(c + 1, j + 1);
  return e + (1 - u) * (at(c, j + 1) - e) + (1 - v) * (at(c + 1, j) - e);
}

// The largest difference in height, by points a fifth of a cell apart.
double Measure(const Terrain& t, const TriangleMesh& cut) {
  const std::vector<Vec3i> p = Lattice(t, cut);
  double largest = 0;
  constexpr int kPart = 5;
  for (const TriangleVertices& c : cut.triangles) {
    const Vec3d a = ToDouble(p[c[0]]), b = ToDouble(p[c[1]]), d = ToDouble(p[c[2]]);
    const double area = Hole::Side(a, b, d);
    REQUIRE(area > 0);
    const auto [least_x, most_x] = std::minmax({a.x, b.x, d.x});
    const auto [least_y, most_y] = std::minmax({a.y, b.y, d.y});
    for (double y = least_y; y <= most_y; y += 1.0 / kPart) {
      for (double x = least_x; x <= most_x; x += 1.0 / kPart) {
        const Vec3d at{x, y, 0};
        const double wa = Hole::Side(b, d, at), wb = Hole::Side(d, a, at),
                     wd = Hole::Side(a, b, at);
        if (wa < 0 || wb < 0 || wd < 0) continue;
        const double height = (wa * a.z + wb * b.z + wd * d.z) / area;
        const double off = std::abs(height - FullHeight(t, x, y));
        if (off > largest) largest = off;  // not for NaN
      }
    }
  }
  return largest;
}

}  // namespace

TEST_CASE("the perturbed circle test is CGAL's") {
  std::mt19937 random(3);
  const CgalDelaunay cgal;
  int ties = 0;
  for (int run = 0; run < 20000; ++run) {
    const int side = run % 2 == 0 ? 4 : 1 << 29;
    const auto point = [&] {
      return LatticePoint{static_cast<int64_t>(random() % side),
                          static_cast<int64_t>(random() % side)};
    };
    const LatticePoint a = point(), b = point(), c = point(), d = point();
    const std::set<LatticePoint> all{a, b, c, d};
    const Point2 p(a.x, a.y), q(b.x, b.y), r(c.x, c.y), s(d.x, d.y);
    if (all.size() < 4 || CGAL::orientation(p, q, r) != CGAL::LEFT_TURN) continue;
    ties += CGAL::side_of_oriented_circle(p, q, r, s) == CGAL::ON_ORIENTED_BOUNDARY;
    REQUIRE(IsInCircle(a, b, c, d) ==
            (cgal.side_of_oriented_circle(p, q, r, s, true) == CGAL::ON_POSITIVE_SIDE));
  }
  REQUIRE(ties > 100);
}

TEST_CASE("every cut of a terrain is the Delaunay triangulation of its vertices") {
  for (const auto& [holes, border_moves] : {std::pair{false, false}, {true, false}, {true, true}}) {
    constexpr uint32_t kColumns = 73, kRows = 61;
    std::vector<double> heights = MakeHeights(kColumns, kRows, 7);
    if (holes) heights = WithHoles(std::move(heights), kColumns, kRows);
    const Terrain t =
        BuildTerrain(kColumns, kRows, heights, Triangulation::kDelaunay, border_moves);
    REQUIRE(t.built.record.border_moves == border_moves);
    REQUIRE(t.built.record.rounds.size() > 2);
    std::mt19937 random(holes);
    std::set<size_t> sizes;
    for (int cut = 0; cut < 60; ++cut) {
      Query query = RandomCutQuery(t.built.record, random);
      if (cut == 0) query = {};
      if (cut == 1) {
        query = {};
        query.threshold = CoarsestThreshold();
      }
      const TriangleMesh mesh = Extract(*t.built.surface, query);
      sizes.insert(mesh.triangles.size());
      RequireDelaunay(t, mesh, !holes);
    }
    REQUIRE(sizes.size() > 20);
  }
}

TEST_CASE("no height of a terrain's cut is farther off than promised, and hardly nearer") {
  for (const Triangulation rule : {Triangulation::kDelaunay, Triangulation::kFree}) {
    for (const bool holes : {false, true}) {
      constexpr uint32_t kColumns = 73, kRows = 61;
      std::vector<double> heights = MakeHeights(kColumns, kRows, 9);
      if (holes) heights = WithHoles(std::move(heights), kColumns, kRows);
      const Terrain t = BuildTerrain(kColumns, kRows, heights, rule);
      REQUIRE(Measure(t, Extract(*t.built.surface, {})) < 1e-9);
      double tightest = 0;
      const double largest = t.built.record.grid.Error(t.built.record.error_code_max);
      for (double threshold = 2 * largest; threshold > 1; threshold /= 2) {
        Query query;
        query.threshold = ConstantThreshold(threshold);
        ExtractStats stats;
        const TriangleMesh cut = Extract(*t.built.surface, query, &stats);
        const double measured = Measure(t, cut);
        CAPTURE(holes, threshold, cut.triangles.size(), measured, stats.error_bound);
        REQUIRE(measured <= stats.error_bound + 1e-9);
        tightest = std::max(tightest, measured / stats.error_bound);
      }
      REQUIRE(tightest > 0.85);
      // A rectangle's straight sides go: few triangles are left of it.
      if (!holes) REQUIRE(t.built.record.root_triangles < 100);
    }
  }
}

// From a place to a mesh in space.
double DistanceTo(const TriangleMesh& mesh, Vec3d p) {
  double least = 1e300;
  for (const TriangleVertices& t : mesh.triangles) {
    least =
        std::min(least, SquaredDistancePointTriangle(p, mesh.positions[t[0]], mesh.positions[t[1]],
                                                     mesh.positions[t[2]]));
  }
  return std::sqrt(least);
}

TEST_CASE("a border that moves is no farther from where it was than promised") {
  for (const Triangulation rule : {Triangulation::kDelaunay, Triangulation::kFree}) {
    constexpr uint32_t kColumns = 73, kRows = 61;
    const Terrain t = BuildTerrain(
        kColumns, kRows, WithHoles(MakeHeights(kColumns, kRows, 9), kColumns, kRows), rule, true);
    const TriangleMesh full = Extract(*t.built.surface, {});
    REQUIRE(Measure(t, full) < 1e-9);
    double tightest = 0;
    for (double threshold = 400; threshold > 1; threshold /= 2) {
      Query query;
      query.threshold = ConstantThreshold(threshold);
      ExtractStats stats;
      const TriangleMesh cut = Extract(*t.built.surface, query, &stats);
      CAPTURE(threshold, cut.triangles.size(), stats.error_bound);
      REQUIRE(Measure(t, cut) <= stats.error_bound + 1e-9);
      double away = 0;
      for (const Vec3d& p : full.positions) away = std::max(away, DistanceTo(cut, p));
      REQUIRE(away <= stats.error_bound + 1e-9);
      tightest = std::max(tightest, away / stats.error_bound);
      // Inwards only.
      for (const TriangleVertices& c : cut.triangles) {
        Vec3d middle{};
        for (const size_t v : c) middle += cut.positions[v] * (1.0 / 3);
        const auto above = std::any_of(
            full.triangles.begin(), full.triangles.end(), [&](const TriangleVertices& f) {
              const auto side = [&](size_t i) {
                return Hole::Side(full.positions[f[i]], full.positions[f[(i + 1) % 3]], middle);
              };
              return side(0) >= -1e-6 && side(1) >= -1e-6 && side(2) >= -1e-6;
            });
        REQUIRE(above);
      }
    }
    CHECK(tightest > 0.4);
    // Most of the border is gone, of the collars and of the lake.
    CHECK(t.built.record.root_triangles < 150);
  }
}

TEST_CASE("a terrain's samples come back as they were, where they were") {
  const Terrain t =
      BuildTerrain(33, 29, WithHoles(MakeHeights(33, 29, 5), 33, 29), Triangulation::kDelaunay);
  const TriangleMesh full = Extract(*t.built.surface, {});
  std::map<std::pair<double, double>, double> found;
  for (const Vec3d& p : full.positions) found[{p.x, p.y}] = p.z;
  size_t samples = 0;
  for (uint32_t r = 0; r < t.rows; ++r) {
    for (uint32_t c = 0; c < t.columns; ++c) {
      const double height = t.heights[size_t{r} * t.columns + c];
      const auto at = found.find({100 + 0.25 * c, 50 - 0.5 * r});
      if (std::isnan(height)) {
        REQUIRE(at == found.end());
      } else if (at != found.end()) {
        ++samples;
        REQUIRE(at->second == height);
      }
    }
  }
  REQUIRE(samples == full.positions.size());
  REQUIRE(samples > 400);
}

TEST_CASE("a terrain's region reaches up and down, and not aside") {
  const Terrain t = BuildTerrain(73, 61, MakeHeights(73, 61, 2), Triangulation::kDelaunay);
  // Errors are hundreds of metres where the whole object is 18 units wide.
  Query query;
  query.region = BoxRegion(Box3d{{104, 30, -1e4}, {106, 34, 1e4}});
  query.threshold = FullResolution();
  const TriangleMesh part = Extract(*t.built.surface, query);
  const TriangleMesh full = Extract(*t.built.surface, {});
  CHECK(part.triangles.size() < full.triangles.size() / 3);
  // Everything inside is there.
  const auto inside = [](const TriangleMesh& mesh) {
    std::set<std::array<double, 3>> points;
    for (const Vec3d& p : mesh.positions) {
      if (p.x >= 104 && p.x <= 106 && p.y >= 30 && p.y <= 34) points.insert({p.x, p.y, p.z});
    }
    return points;
  };
  CHECK(inside(part) == inside(full));
}

}  // namespace mtdb::testing
