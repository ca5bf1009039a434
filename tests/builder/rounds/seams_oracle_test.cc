// SPDX-License-Identifier: Apache-2.0
// Another error measure and another filling rule through the builder's seams: heights and Delaunay
// triangulations, held against brute force and CGAL.
#include <catch2/catch.hpp>
#include <map>
#include <numbers>
#include <random>
#include <set>

#include "builder/rounds/build_with.h"
#include "tests/builder/cgal_plane.h"
#include "tests/builder/fixture.h"
#include "tests/builder/terrain_seams.h"

namespace mtdb::testing {

using namespace internal;

namespace {

using Corners = std::array<uint32_t, 3>;

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

// A hole of integer points around the origin; a large `jitter` makes it not convex.
Hole RandomHole(double jitter, std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(0, 1);
  Hole hole;
  hole.k = 3 + random() % (Hole::kMaxRing - 2);
  const double turn = 2 * std::numbers::pi / hole.k;
  for (uint32_t i = 0; i < hole.k; ++i) {
    const double angle = turn * (i + 0.9 * uniform(random));
    const double radius = 1e6 * (1 - jitter * uniform(random));
    hole.positions[i] = {std::round(radius * std::cos(angle)), std::round(radius * std::sin(angle)),
                         0};
    for (uint32_t j = 0; j < hole.k; ++j) hole.forbidden[i][j] = 0;
  }
  hole.LookAlong({0, 0, 1}, 1);
  return hole;
}

bool IsConvex(const Hole& hole) {
  for (uint32_t i = 0; i < hole.k; ++i) {
    const uint32_t j = (i + 1) % hole.k;
    if (Hole::Side(hole.points[i], hole.points[j], hole.points[(i + 2) % hole.k]) <= 0)
      return false;
  }
  return true;
}
bool IsSimple(const Hole& hole) {  // star-shaped around the origin
  for (uint32_t i = 0; i < hole.k; ++i) {
    if (Hole::Side(hole.positions[i], hole.positions[(i + 1) % hole.k], {0, 0, 0}) <= 0)
      return false;
  }
  return true;
}

// Points of integers whose heights are waves and some roughness, triangulated by CGAL.
TriangleMesh MakeDelaunayTerrain(uint32_t points, uint32_t seed) {
  std::mt19937 random(seed);
  TriangleMesh mesh;
  CgalDelaunay triangulation;
  std::set<std::pair<int, int>> used;
  while (mesh.positions.size() < points) {
    const int x = static_cast<int>(random() % 4096);
    const int y = static_cast<int>(random() % 4096);
    if (!used.insert({x, y}).second) continue;
    const double z = 200 * std::sin(x / 300.0) * std::cos(y / 410.0) + 1.5 * (random() % 16);
    const auto vertex = static_cast<uint32_t>(mesh.positions.size());
    mesh.positions.push_back({double(x), double(y), std::round(z)});
    triangulation.insert(Point2(x, y))->info() = vertex;
  }
  for (const auto& face : triangulation.finite_face_handles()) {
    mesh.triangles.push_back(
        {face->vertex(0)->info(), face->vertex(1)->info(), face->vertex(2)->info()});
  }
  return mesh;
}

Point2 Flat(Vec3d p) { return {p.x, p.y}; }

// Every triangle counter-clockwise, and no vertex in the circle of a triangle beside its own.
void RequireDelaunay(const TriangleMesh& mesh) {
  std::map<std::pair<VertexIndex, VertexIndex>, VertexIndex> apex;  // of directed edges
  for (const TriangleVertices& t : mesh.triangles) {
    for (size_t c = 0; c < 3; ++c) {
      REQUIRE(apex.emplace(std::pair(t[c], t[(c + 1) % 3]), t[(c + 2) % 3]).second);
    }
  }
  size_t interior = 0;
  for (const TriangleVertices& t : mesh.triangles) {
    const Point2 a = Flat(mesh.positions[t[0]]);
    const Point2 b = Flat(mesh.positions[t[1]]);
    const Point2 c = Flat(mesh.positions[t[2]]);
    REQUIRE(CGAL::orientation(a, b, c) == CGAL::LEFT_TURN);
    for (size_t i = 0; i < 3; ++i) {
      const auto across = apex.find({t[(i + 1) % 3], t[i]});
      if (across == apex.end()) continue;
      ++interior;
      REQUIRE(CGAL::side_of_oriented_circle(a, b, c, Flat(mesh.positions[across->second])) !=
              CGAL::ON_POSITIVE_SIDE);
    }
  }
  REQUIRE(interior > mesh.triangles.size());
}

// The largest difference in height between two height fields, triangle by triangle.
double LargestDifference(const TriangleMesh& a, const TriangleMesh& b) {
  const auto corners = [](const TriangleMesh& mesh, const TriangleVertices& t) {
    return std::array<Vec3d, 3>{mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]};
  };
  double largest = 0;
  for (const TriangleVertices& s : a.triangles) {
    for (const TriangleVertices& t : b.triangles) {
      largest = std::max(largest, HeightDifference(corners(a, s), corners(b, t)));
    }
  }
  return largest;
}

BuildOptions OnIntegers() {
  BuildOptions options;
  options.step = 1;
  options.tile_triangles = 600;
  options.threads = 1;
  return options;
}

// Cuts of all densities, and some that are dense in a box only: each a height field over the same
// area, within what it promises.
template <typename Check>
void CheckCuts(const TriangleMesh& input, const BuiltObject& built, const Check& check) {
  REQUIRE(built.record.error_measure == ErrorMeasure::kVertical);
  REQUIRE(built.record.rounds.size() > 2);
  REQUIRE(built.record.rounding_error == 0);
  const double largest = built.record.grid.Error(built.record.error_code_max);
  std::set<size_t> sizes;
  double tightest = 0;
  for (const bool in_box : {false, true}) {
    for (double threshold = 2 * largest; threshold > 0.5; threshold /= 2) {
      Query query;
      query.threshold = ConstantThreshold(threshold);
      if (in_box) query.region = BoxRegion(Box3d{{500, 700, -1e4}, {2000, 1500, 1e4}});
      ExtractStats stats;
      const TriangleMesh cut = Extract(*built.surface, query, &stats);
      sizes.insert(cut.triangles.size());
      check(cut);
      if (in_box) continue;  // what lies outside promises nothing
      const double measured = LargestDifference(cut, input);
      CAPTURE(threshold, cut.triangles.size(), measured, stats.error_bound);
      REQUIRE(measured <= stats.error_bound);
      if (stats.error_bound > 4) tightest = std::max(tightest, measured / stats.error_bound);
    }
  }
  REQUIRE(sizes.size() > 6);
  REQUIRE(tightest > 0.8);
}

BuiltObject BuildWith(const DecimatorFactory& make_decimator, const TriangleMesh& mesh,
                      const BuildOptions& options) {
  auto store = std::make_unique<TempStore>();
  const std::unique_ptr<ObjectWriter> writer = store->database().Create("object", false).value();
  const Result<ObjectRecord> record = BuildObjectWith(
      make_decimator, [&](MeshSink& sink) { return SendMesh(mesh, sink); }, options, *writer);
  return Open(std::move(store), record);
}

}  // namespace

TEST_CASE("The Delaunay rule fills holes as CGAL triangulates them") {
  std::mt19937 random(5);
  int convex = 0;
  int others = 0;
  for (int run = 0; run < 4000; ++run) {
    const Hole hole = RandomHole(run % 2 == 0 ? 0 : 0.9, random);
    if (!IsSimple(hole)) continue;
    Hole::Triangles filling;
    REQUIRE(DelaunayFilling().Fill(hole, filling));
    std::set<Corners> found;
    for (uint32_t t = 0; t < hole.k - 2; ++t) {
      found.insert({filling[t][0], filling[t][1], filling[t][2]});
    }
    if (IsConvex(hole)) {
      CgalDelaunay cgal;
      for (uint32_t i = 0; i < hole.k; ++i) cgal.insert(Flat(hole.points[i]))->info() = i;
      REQUIRE(found == FacesOf(cgal));
      ++convex;
    } else {
      CgalConstrained cgal;
      std::vector<CgalConstrained::Vertex_handle> at;
      for (uint32_t i = 0; i < hole.k; ++i) {
        at.push_back(cgal.insert(Flat(hole.points[i])));
        at.back()->info() = i;
      }
      for (uint32_t i = 0; i < hole.k; ++i) cgal.insert_constraint(at[i], at[(i + 1) % hole.k]);
      const std::set<Corners> all = FacesOf(cgal);  // those between the ring and its hull as well
      for (const Corners& t : found) REQUIRE(all.contains(t));
      ++others;
    }
  }
  REQUIRE(convex > 500);
  REQUIRE(others > 500);
}

TEST_CASE(
    "A terrain built by heights and Delaunay has Delaunay cuts within their errors of height") {
  const TriangleMesh input = MakeDelaunayTerrain(1800, 6);
  const BuiltObject built = BuildWith(std::make_unique<TerrainDecimator>, input, OnIntegers());
  CheckCuts(input, built, RequireDelaunay);
}

TEST_CASE("Measure and rule are free to be combined") {
  const TriangleMesh input = MakeDelaunayTerrain(1200, 7);
  const BuiltObject built =
      BuildWith(std::make_unique<Decimator<VerticalMeasure, FreeFilling>>, input, OnIntegers());
  CheckCuts(input, built, [](const TriangleMesh&) {});
  // The other way round the cuts are Delaunay, and within their two-sided distance.
  const BuiltObject other =
      BuildWith(std::make_unique<Decimator<SurfaceDistance, DelaunayFilling>>, input, OnIntegers());
  REQUIRE(other.record.error_measure == ErrorMeasure::kTwoSidedDistance);
  REQUIRE(other.record.nodes > 500);
}

}  // namespace mtdb::testing
