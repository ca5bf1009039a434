// SPDX-License-Identifier: Apache-2.0
// Comparisons against CGAL's bounded Hausdorff distance, against dense samples of tiny meshes, and
// where the answer is known.
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/distance.h>
#include <CGAL/Surface_mesh.h>
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <random>
#include <thread>

#include "query/compare.h"
#include "query/query_control.h"
#include "tests/builder/fixture.h"
#include "tests/query/compare/compare_meshes.h"

namespace mtdb::testing {

namespace {

constexpr double kNone = std::numeric_limits<double>::infinity();

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using CgalMesh = CGAL::Surface_mesh<Kernel::Point_3>;

CgalMesh ToCgal(const TriangleMesh& mesh) {
  CgalMesh result;
  std::vector<CgalMesh::Vertex_index> vertices;
  for (const Vec3d& p : mesh.positions) vertices.push_back(result.add_vertex({p.x, p.y, p.z}));
  for (const TriangleVertices& t : mesh.triangles) {
    result.add_face(vertices[t[0]], vertices[t[1]], vertices[t[2]]);
  }
  return result;
}

double CgalDistance(const TriangleMesh& a, const TriangleMesh& b, double error) {
  return CGAL::Polygon_mesh_processing::bounded_error_Hausdorff_distance<CGAL::Sequential_tag>(
      ToCgal(a), ToCgal(b), error);
}

Triangle3d Corners(const TriangleMesh& mesh, const TriangleVertices& t) {
  return {mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]};
}

double Distance(const TriangleMesh& mesh, Vec3d p) {
  double best2 = kNone;
  for (const TriangleVertices& v : mesh.triangles) {
    const Triangle3d t = Corners(mesh, v);
    best2 = std::min(best2, SquaredDistancePointTriangle(p, t[0], t[1], t[2]));
  }
  return std::sqrt(best2);
}

// Calls f(point) for points of the mesh; no point of it is farther than the result from one.
template <typename F>
double ForEachSample(const TriangleMesh& mesh, int steps, F&& f) {
  double spacing = 0;
  for (const TriangleVertices& v : mesh.triangles) {
    const Triangle3d t = Corners(mesh, v);
    const Vec3d u = (t[1] - t[0]) * (1.0 / steps), w = (t[2] - t[0]) * (1.0 / steps);
    for (int i = 0; i <= steps; ++i) {
      for (int j = 0; i + j <= steps; ++j) f(t[0] + u * i + w * j);
    }
    spacing = std::max({spacing, Length(u), Length(w), Length(w - u)});
  }
  return spacing;
}

// The distance of the farthest point of `a` from `b` lies between these.
DistanceInterval Sampled(const TriangleMesh& a, const TriangleMesh& b, int steps) {
  DistanceInterval interval{0, 0};
  const double spacing = ForEachSample(
      a, steps, [&](Vec3d p) { interval.low = std::max(interval.low, Distance(b, p)); });
  interval.high = interval.low + spacing;
  return interval;
}

bool Overlap(const DistanceInterval& a, const DistanceInterval& b) {
  return a.low <= b.high && b.low <= a.high;
}

BuildOptions SmallTiles() {
  BuildOptions options;
  options.tile_triangles = 1000;
  return options;
}

Comparison CompareStored(const BuiltObject& a, const BuiltObject& b, CompareOptions options = {}) {
  options.as_stored = true;
  const Result<Comparison> result = Compare(*a.surface, *b.surface, options);
  if (!result) FAIL(result.status().message());
  return *result;
}

}  // namespace

TEST_CASE("Intervals hold CGAL's bounded Hausdorff distance", "[oracle]") {
  const TriangleMesh first = MakeSculpture(3000, 1);
  const double scale = GENERATE(0.0, 0.002, 0.03, 0.4);
  CAPTURE(scale);
  const BuiltObject a = Build(first, SmallTiles());
  const BuiltObject b = Build(
      Shaken(MakeSculpture(scale < 0.1 ? 3000 : 1500, scale < 0.1 ? 1 : 5), scale), SmallTiles());
  const TriangleMesh full_a = Extract(*a.surface, {}), full_b = Extract(*b.surface, {});
  CompareOptions options;
  options.width = 1e-3 * a.record.diagonal();
  const Comparison found = CompareStored(a, b, options);
  const double error = 1e-3 * a.record.diagonal();
  const double ab = CgalDistance(full_a, full_b, error), ba = CgalDistance(full_b, full_a, error);
  CHECK(Overlap(found.a_to_b->distance, {ab - error, ab + error}));
  CHECK(Overlap(found.b_to_a->distance, {ba - error, ba + error}));
  for (const OneSidedDistance* side : {&*found.a_to_b, &*found.b_to_a}) {
    CHECK(side->distance.high - side->distance.low <= *options.width);
  }
}

TEST_CASE("Intervals of tiny soups hold what dense samples measure", "[oracle]") {
  std::mt19937 random(7);
  for (int round = 0; round < 60; ++round) {
    CAPTURE(round);
    const BuiltObject a = Build(Soup(1 + round % 9, random)),
                      b = Build(Soup(1 + round % 7, random));
    const TriangleMesh full_a = Extract(*a.surface, {}), full_b = Extract(*b.surface, {});
    CompareOptions options;
    options.width = round % 2 == 0 ? 1e-2 : 1e-6;
    const Comparison found = CompareStored(a, b, options);
    CHECK(Overlap(found.a_to_b->distance, Sampled(full_a, full_b, 24)));
    CHECK(Overlap(found.b_to_a->distance, Sampled(full_b, full_a, 24)));
    CHECK(found.distance.high - found.distance.low <= *options.width);
    CHECK(Sampled(full_a, full_b, 24).low <= found.a_to_b->distance.high);
    CHECK(Sampled(full_b, full_a, 24).low <= found.b_to_a->distance.high);
    // The farthest point is where it was said to be.
    REQUIRE(found.a_to_b->point);
    CHECK(Distance(full_b, *found.a_to_b->point) >= found.a_to_b->distance.low * (1 - 1e-12));
    CHECK(Distance(full_a, *found.a_to_b->point) <= 1e-9);
  }
}

TEST_CASE("A tolerance is decided on either side of the distance", "[oracle]") {
  std::mt19937 random(11);
  for (int round = 0; round < 30; ++round) {
    CAPTURE(round);
    const BuiltObject a = Build(Soup(1 + round % 9, random)),
                      b = Build(Soup(1 + round % 7, random));
    const DistanceInterval distance = Sampled(Extract(*a.surface, {}), Extract(*b.surface, {}), 32);
    CompareOptions options;
    options.b_asks = false;
    options.tolerance = distance.high * 1.01;
    const Comparison within = CompareStored(a, b, options);
    CHECK(within.verdict == CompareVerdict::kWithin);
    CHECK(within.distance.high <= *options.tolerance);
    CHECK(within.a_to_b->places.empty());
    options.tolerance = distance.low * 0.99;
    const Comparison exceeds = CompareStored(a, b, options);
    CHECK(exceeds.verdict == CompareVerdict::kExceeds);
    REQUIRE(!exceeds.a_to_b->places.empty());
    CHECK(exceeds.a_to_b->places[0].distance.low > *options.tolerance);
  }
}

TEST_CASE("A translated copy is as far away as it was moved, and not at all when moved back") {
  const TriangleMesh mesh = Sphere(40, 1);
  const BuiltObject a = Build(mesh, SmallTiles());
  const BuiltObject b = Build(Moved(mesh, {0, 0, 0.25}), SmallTiles());
  CompareOptions options;
  options.width = 1e-4;
  const Comparison moved = CompareStored(a, b, options);
  CHECK(moved.distance.low <= 0.25);
  CHECK(moved.distance.high >= 0.25 - 1e-3);  // at the poles, but for the sphere's facets
  CHECK(moved.distance.high <= 0.25 + 1e-3);
  options.transform[11] = -0.25;
  const Comparison back = CompareStored(a, b, options);
  CHECK(back.distance.high <= 2e-4);
  options.tolerance = 1e-3;
  CHECK(CompareStored(a, b, options).verdict == CompareVerdict::kWithin);
}

TEST_CASE("A rotated copy is brought back by the inverse rotation") {
  const TriangleMesh mesh = MakeSculpture(2000);
  TriangleMesh turned = mesh;
  const double c = std::cos(0.7), s = std::sin(0.7);
  for (Vec3d& p : turned.positions) p = {c * p.x - s * p.y + 3, s * p.x + c * p.y, p.z};
  const BuiltObject a = Build(mesh, SmallTiles()), b = Build(turned, SmallTiles());
  CompareOptions options;
  options.transform = {c, s, 0, -3 * c, -s, c, 0, 3 * s, 0, 0, 1, 0, 0, 0, 0, 1};
  options.tolerance = 1e-3 * a.record.diagonal();
  const Result<Comparison> found = Compare(*a.surface, *b.surface, options);
  REQUIRE(found.ok());
  CHECK(found->verdict == CompareVerdict::kWithin);
  CHECK(CompareStored(b, a, {.tolerance = options.tolerance}).verdict == CompareVerdict::kExceeds);
}

TEST_CASE("A sphere and its offset are apart by the offset") {
  const BuiltObject a = Build(Sphere(60, 1), SmallTiles()),
                    b = Build(Sphere(60, 1.1), SmallTiles());
  CompareOptions options;
  options.width = 1e-4;
  const Comparison found = CompareStored(a, b, options);
  // Facets of the same directions: vertices are 0.1 apart, facets a little less.
  CHECK(found.b_to_a->distance.low <= 0.1 + 1e-4);
  CHECK(found.b_to_a->distance.high >= 0.1 - 1e-4);
  CHECK(found.a_to_b->distance.high <= 0.1 + 1e-3);
  CHECK(found.a_to_b->distance.low >= 0.1 - 3e-3);
}

TEST_CASE("Each dent of a plane is a place, and nothing else is") {
  std::vector<Vec3d> dents;
  for (int i = 0; i < 9; ++i) dents.push_back({0.17 + 0.33 * (i % 3), 0.17 + 0.33 * (i / 3), 0});
  const BuiltObject a = Build(Plane(120, {}, 0), SmallTiles());
  const BuiltObject b = Build(Plane(120, dents, 0.02), SmallTiles());
  CompareOptions options;
  options.tolerance = 0.01;
  const Comparison found = CompareStored(a, b, options);
  CHECK(found.verdict == CompareVerdict::kExceeds);
  for (const OneSidedDistance* side : {&*found.a_to_b, &*found.b_to_a}) {
    REQUIRE(side->places.size() == dents.size());
    for (const ComparePlace& place : side->places) {
      CHECK(place.verdict == CompareVerdict::kExceeds);
      CHECK(place.distance.low > 0.01);
      CHECK(place.distance.high >= 0.018);
      CHECK(std::ranges::any_of(dents, [&](Vec3d p) {
        return p.x > place.box.min.x && p.x < place.box.max.x && p.y > place.box.min.y &&
               p.y < place.box.max.y;
      }));
      CHECK(Diagonal(place.box) < 0.2);
    }
  }
  // A region says who asks: one dent's surroundings.
  options.region = BoxRegion({{0.02, 0.02, -1}, {0.3, 0.3, 1}});
  const Comparison one = CompareStored(a, b, options);
  CHECK(one.a_to_b->places.size() == 1);
  CHECK(one.b_to_a->places.size() == 1);
  options.region = BoxRegion({{0.3, 0.02, -1}, {0.36, 1, 1}});
  CHECK(CompareStored(a, b, options).verdict == CompareVerdict::kWithin);
}

TEST_CASE("Spikes that no coarse cut shows are found", "[oracle]") {
  std::mt19937 random(5);
  const BuiltObject flat = Build(Plane(40, {}, 0), SmallTiles());
  for (int round = 0; round < 12; ++round) {
    CAPTURE(round);
    double highest = 0;
    TriangleMesh spiky = Plane(40, {}, 0);
    // Rough everywhere, or flat but for a few spikes.
    std::uniform_real_distribution<double> height(-0.02, 0.02);
    for (Vec3d& p : spiky.positions) p.z = round % 2 == 0 ? height(random) : 0;
    for (int i = 0; i < 5; ++i)
      spiky.positions[random() % spiky.positions.size()].z = 0.1 + 0.02 * i;
    for (const Vec3d& p : spiky.positions) highest = std::max(highest, std::abs(p.z));
    const BuiltObject rough = Build(spiky, SmallTiles());
    for (const double width : {0.03, 0.01, 1e-4}) {
      CAPTURE(width);
      CompareOptions options;
      options.width = width;
      const Result<Comparison> found = Compare(*rough.surface, *flat.surface, options);
      REQUIRE(found.ok());
      CHECK(found->a_to_b->distance.low <= highest);
      CHECK(found->a_to_b->distance.high >= highest);
      CHECK(found->a_to_b->distance.high - found->a_to_b->distance.low < width + 4e-4);
    }
  }
}

TEST_CASE("What a coarse cut hides of a part in doubt is found", "[oracle]") {
  // A mesa on a plateau: coarse cuts have the plateau only, just within the tolerance. Elsewhere it
  // is rough, so that most of the cut is not in doubt.
  TriangleMesh mesh = Plane(100, {}, 0);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> noise(-0.01, 0.01);
  const double mesa = GENERATE(0.0, 0.0022, 0.003, 0.0038);
  for (Vec3d& p : mesh.positions) {
    const double r = std::hypot(p.x - 0.7, p.y - 0.7);
    p.z = r > 0.15 ? noise(random) : 0.0185 + mesa * std::clamp((0.08 - r) / 0.04, 0.0, 1.0);
  }
  const BuiltObject a = Build(mesh, SmallTiles()), b = Build(Plane(40, {}, 0), SmallTiles());
  CompareOptions options;
  options.tolerance = 0.02;
  options.b_asks = false;
  const Comparison found = CompareStored(a, b, options);
  CHECK(found.verdict == (mesa == 0 ? CompareVerdict::kWithin : CompareVerdict::kExceeds));
  CHECK(found.distance.high >= 0.0185 + mesa - 1e-4);
  CHECK(found.a_to_b->places.size() == (mesa == 0 ? 0 : 1));
}

TEST_CASE("What has no counterpart within the reach is missing") {
  const BuiltObject whole = Build(Plane(100, {}, 0), SmallTiles());
  const BuiltObject part = Build(Clipped(Plane(100, {{0.2, 0.2, 0}}, 0.03), 0.6), SmallTiles());
  CompareOptions options;
  options.tolerance = 0.01;
  options.reach = 0.1;
  const Comparison found = CompareStored(whole, part, options);
  REQUIRE(found.a_to_b->places.size() == 2);
  CHECK(found.a_to_b->places[0].missing);
  CHECK(found.a_to_b->places[0].box.min.x > 0.55);
  CHECK_FALSE(found.a_to_b->places[1].missing);
  REQUIRE(found.b_to_a->places.size() == 1);
  CHECK_FALSE(found.b_to_a->places[0].missing);
}

TEST_CASE("Equal objects are told by their digests, and nothing is read") {
  const TriangleMesh mesh = MakeSculpture(3000);
  const BuiltObject a = Build(mesh, SmallTiles()), b = Build(mesh, SmallTiles());
  const uint64_t before = a.surface->cache_use().decoded;
  const Result<Comparison> same = Compare(*a.surface, *b.surface, {.tolerance = 0.0});
  REQUIRE(same.ok());
  CHECK(same->identical);
  CHECK(same->verdict == CompareVerdict::kWithin);
  CHECK(same->distance == DistanceInterval{0, 0});
  CHECK(same->clusters_read == 0);
  CHECK(a.surface->cache_use().decoded == before);
}

TEST_CASE("A surface moved to itself is within every tolerance above rounding") {
  const BuiltObject a = Build(MakeSculpture(6000), SmallTiles());
  CompareOptions options;
  options.transform[3] = 1e-300;  // so that digests do not tell
  for (const double tolerance : {1e-2, 1e-4, 1e-7}) {
    options.tolerance = tolerance * a.record.diagonal();
    CHECK(CompareStored(a, a, options).verdict == CompareVerdict::kWithin);
  }
  // The inputs were rounded when they were stored: nothing finer is proved of them.
  options.tolerance = a.record.rounding_error;
  const Result<Comparison> inputs = Compare(*a.surface, *a.surface, options);
  REQUIRE(inputs.ok());
  CHECK(inputs->verdict == CompareVerdict::kUndecided);
  CHECK_FALSE(inputs->out_of_time);
  CHECK(inputs->distance.high <= 2.1 * a.record.rounding_error);
}

TEST_CASE("Intervals are of the inputs, however coarsely they were stored") {
  const TriangleMesh first = MakeSculpture(2000, 1), second = Shaken(first, 0.01);
  BuildOptions coarse = SmallTiles();
  coarse.bits = 9;
  const BuiltObject a = Build(first, coarse), b = Build(second, coarse);
  const Result<Comparison> found = Compare(*a.surface, *b.surface, {.width = 0.0});
  REQUIRE(found.ok());
  const double error = 1e-4;
  const double ab = CgalDistance(first, second, error), ba = CgalDistance(second, first, error);
  CHECK(Overlap(found->a_to_b->distance, {ab - error, ab + error}));
  CHECK(Overlap(found->b_to_a->distance, {ba - error, ba + error}));
  const double rounding = a.record.rounding_error + b.record.rounding_error;
  CHECK(found->distance.high - found->distance.low < 2.5 * rounding + 0.01);
}

TEST_CASE("Without time the boxes of the catalog answer") {
  const TriangleMesh mesh = MakeSculpture(3000);
  const BuiltObject a = Build(mesh, SmallTiles());
  const BuiltObject b = Build(Moved(mesh, {10, 0, 0}), SmallTiles());
  CompareOptions options;
  options.tolerance = 1;
  options.max_milliseconds = 0;
  const uint64_t before = a.surface->cache_use().decoded;
  const Comparison none = CompareStored(a, b, options);
  CHECK(none.out_of_time);
  CHECK(none.verdict == CompareVerdict::kUndecided);
  CHECK(none.distance.low <= 10);
  CHECK(none.distance.high >= 10);
  CHECK(none.distance.high <= 10 + 2 * a.record.diagonal());
  CHECK(a.surface->cache_use().decoded == before);
  options.max_milliseconds = std::nullopt;
  const Comparison all = CompareStored(a, b, options);
  CHECK_FALSE(all.out_of_time);
  CHECK(all.verdict == CompareVerdict::kExceeds);
}

TEST_CASE("A comparison that is cancelled says so") {
  const BuiltObject a = Build(MakeSculpture(3000, 1), SmallTiles());
  const BuiltObject b = Build(MakeSculpture(3000, 2), SmallTiles());
  QueryControl control;
  control.Cancel();
  CompareOptions options;
  options.control = &control;
  const Result<Comparison> found = Compare(*a.surface, *b.surface, options);
  REQUIRE(!found.ok());
  CHECK(found.status().code() == StatusCode::kCancelled);
}

TEST_CASE("The map holds the distance of each vertex", "[oracle]") {
  const BuiltObject a = Build(MakeSculpture(4000, 1), SmallTiles());
  const BuiltObject b = Build(Shaken(MakeSculpture(3000, 1), 0.01), SmallTiles());
  const TriangleMesh full = Extract(*b.surface, {});
  CompareOptions options;
  options.as_stored = true;
  options.width = GENERATE(1e-1, 1e-2, 1e-4);
  options.reach = GENERATE(std::optional<double>(), std::optional<double>(5e-3));
  TriangleMesh map;
  TriangleMeshSink sink(&map);
  REQUIRE(MapDistances(*a.surface, *b.surface, options, sink).ok());
  REQUIRE(map.positions.size() == a.record.vertices);
  REQUIRE(map.header.attributes.attributes.back().name == kHighDistance);
  size_t beyond = 0;
  for (size_t i = 0; i < map.positions.size(); ++i) {
    std::array<float, 2> interval{};
    std::memcpy(interval.data(), map.rows.data() + 8 * i, 8);
    const double distance = Distance(full, map.positions[i]);
    CHECK(interval[0] <= distance * (1 + 1e-9));
    CHECK(interval[1] >= distance * (1 - 1e-9));
    if (options.reach && interval[0] > *options.reach) {
      ++beyond;
    } else {
      CHECK(interval[1] - interval[0] <= *options.width * (1 + 1e-6));
    }
  }
  if (options.reach) CHECK(beyond > 0);
}

TEST_CASE("A map of one surface onto itself is made with a cache for one") {
  const BuiltObject a = Build(MakeSculpture(4000, 1), SmallTiles());
  TriangleMesh map;
  TriangleMeshSink sink(&map);
  CompareOptions options;
  options.tolerance = 1e-3;
  REQUIRE(MapDistances(*a.surface, *a.surface, options, sink).ok());
  CHECK(map.triangles.size() == a.record.triangles);
  TriangleMesh again;
  TriangleMeshSink into(&again);
  const BuiltObject mapped = Build(map, SmallTiles());
  const Status refused = MapDistances(*mapped.surface, *a.surface, options, into);
  CHECK(refused.code() == StatusCode::kInvalidArgument);
}

TEST_CASE("Options that mean nothing are refused") {
  const BuiltObject a = Build(MakeSculpture(500)), b = Build(MakeSculpture(500, 2));
  const auto refused = [&](const CompareOptions& options, const std::string& begin) {
    const Result<Comparison> found = Compare(*a.surface, *b.surface, options);
    REQUIRE(!found.ok());
    CHECK(found.status().code() == StatusCode::kInvalidArgument);
    CHECK(found.status().message().substr(0, begin.size()) == begin);
  };
  refused({.tolerance = -1.0}, "tolerance: ");
  refused({.width = std::nan("")}, "width: ");
  refused({.reach = 1e31}, "reach: ");
  refused({.max_milliseconds = -1.0}, "max_milliseconds: ");
  refused({.a_asks = false, .b_asks = false}, "compare: ");
  CompareOptions flat;
  flat.transform[0] = 0;
  refused(flat, "transform: ");
  CompareOptions perspective;
  perspective.transform[12] = 1;
  refused(perspective, "transform: ");
}

}  // namespace mtdb::testing
