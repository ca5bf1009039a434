// SPDX-License-Identifier: Apache-2.0
// Changes of height against an overlay of all pairs of triangles in CGAL's exact numbers, and where
// the answer is known.
#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_exact_constructions_kernel.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>
#include <CGAL/intersections.h>
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "query/height_change.h"
#include "query/query_control.h"
#include "tests/builder/terrain_fixture.h"
#include "tests/query/compare/compare_meshes.h"

namespace mtdb::testing {

namespace {

using Exact = CGAL::Exact_predicates_exact_constructions_kernel;
using Number = Exact::FT;
using Place = Exact::Point_2;

// What there is to know of two terrains, in exact numbers until the end.
struct Truth {
  double rise = 0, fall = 0;  // 0: none
  double fill = 0, cut = 0, both = 0, a = 0, b = 0;
};

// A lazy number is known to 5 digits only before it is made exact.
double Value(const Number& n) { return CGAL::to_double(CGAL::exact(n)); }

Number Area(const std::vector<Place>& polygon) {
  Number twice = 0;
  for (size_t i = 2; i < polygon.size(); ++i) {
    twice += CGAL::determinant(polygon[i - 1] - polygon[0], polygon[i] - polygon[0]);
  }
  return CGAL::abs(twice) / 2;
}

// The height of a triangle's plane.
class Plane3 {
 public:
  explicit Plane3(const Triangle3d& t)
      : plane_({t[0].x, t[0].y, t[0].z}, {t[1].x, t[1].y, t[1].z}, {t[2].x, t[2].y, t[2].z}) {}
  Number At(const Place& p) const {
    return -(plane_.a() * p.x() + plane_.b() * p.y() + plane_.d()) / plane_.c();
  }

 private:
  Exact::Plane_3 plane_;
};

// The volume below a linear function, over the part of a convex polygon where it is above 0.
Number Above(const std::vector<Place>& polygon, const std::vector<Number>& f) {
  std::vector<Place> kept;
  std::vector<Number> values;
  for (size_t i = 0; i < polygon.size(); ++i) {
    const size_t next = (i + 1) % polygon.size();
    if (f[i] >= 0) kept.push_back(polygon[i]), values.push_back(f[i]);
    if ((f[i] > 0 && f[next] < 0) || (f[i] < 0 && f[next] > 0)) {
      kept.push_back(polygon[i] + (polygon[next] - polygon[i]) * (f[i] / (f[i] - f[next])));
      values.push_back(0);
    }
  }
  Number volume = 0;
  for (size_t i = 2; i < kept.size(); ++i) {
    volume += Area({kept[0], kept[i - 1], kept[i]}) * (values[0] + values[i - 1] + values[i]) / 3;
  }
  return volume;
}

Exact::Triangle_2 Flat(const Triangle3d& t) {
  return {Place(t[0].x, t[0].y), Place(t[1].x, t[1].y), Place(t[2].x, t[2].y)};
}

std::vector<Triangle3d> TrianglesOf(const BuiltObject& object) {
  const TriangleMesh mesh = Extract(*object.surface, {});
  std::vector<Triangle3d> triangles;
  for (const TriangleVertices& t : mesh.triangles) {
    triangles.push_back({mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]});
  }
  return triangles;
}

// By all pairs.
Truth ExactChange(const BuiltObject& from, const BuiltObject& to) {
  const std::vector<Triangle3d> a = TrianglesOf(from), b = TrianglesOf(to);
  Number fill = 0, cut = 0, both = 0, area_a = 0, area_b = 0, rise = 0, fall = 0;
  std::vector<CGAL::Bbox_2> boxes;
  for (const Triangle3d& t : b) {
    boxes.push_back(Flat(t).bbox());
    area_b += CGAL::abs(Flat(t).area());
  }
  for (const Triangle3d& s : a) {
    const Exact::Triangle_2 flat = Flat(s);
    const CGAL::Bbox_2 box = flat.bbox();
    area_a += CGAL::abs(flat.area());
    for (size_t j = 0; j < b.size(); ++j) {
      if (!CGAL::do_overlap(box, boxes[j])) continue;
      const auto common = CGAL::intersection(flat, Flat(b[j]));
      if (!common) continue;
      std::vector<Place> polygon;
      if (const auto* const t = boost::get<Exact::Triangle_2>(&*common)) {
        for (int i = 0; i < 3; ++i) polygon.push_back(t->vertex(i));
      } else if (const auto* const many = boost::get<std::vector<Place>>(&*common)) {
        polygon = *many;
      }
      if (polygon.empty()) continue;
      const Plane3 lower(s), upper(b[j]);
      std::vector<Number> up, down;
      for (const Place& p : polygon) {
        up.push_back(upper.At(p) - lower.At(p));
        down.push_back(-up.back());
        rise = CGAL::max(rise, up.back());
        fall = CGAL::max(fall, down.back());
      }
      both += Area(polygon);
      fill += Above(polygon, up);
      cut += Above(polygon, down);
    }
  }
  return {Value(rise), Value(fall),          Value(fill),         Value(cut),
          Value(both), Value(area_a - both), Value(area_b - both)};
}

// Random places in a square, joined by Delaunay's rule.
TriangleMesh RandomTin(size_t vertices, double origin, double side, double height,
                       std::mt19937& random) {
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  using Vertex = CGAL::Triangulation_vertex_base_with_info_2<VertexIndex, Kernel>;
  using Delaunay =
      CGAL::Delaunay_triangulation_2<Kernel, CGAL::Triangulation_data_structure_2<Vertex>>;
  std::uniform_real_distribution<double> unit(0, 1);
  TriangleMesh mesh;
  Delaunay delaunay;
  for (size_t i = 0; i < vertices; ++i) {
    const Vec3d p{origin + side * unit(random), origin + side * unit(random),
                  height * unit(random)};
    delaunay.insert({p.x, p.y})->info() = static_cast<VertexIndex>(i);
    mesh.positions.push_back(p);
  }
  for (const auto& face : delaunay.finite_face_handles()) {
    mesh.triangles.push_back(
        {face->vertex(0)->info(), face->vertex(1)->info(), face->vertex(2)->info()});
  }
  return mesh;
}

BuildOptions AsTerrain() {
  BuildOptions options;
  options.height_field = true;
  options.tile_triangles = 400;
  return options;
}

void CheckHolds(const ValueInterval& interval, double value) {
  const double slack = 1e-9 * (1 + std::abs(value));
  CHECK(interval.low <= value + slack);
  CHECK(interval.high >= value - slack);
  CHECK(interval.low <= interval.high);
}

void CheckHolds(const HeightChange& found, const Truth& truth) {
  CheckHolds(found.rise.height, truth.rise);
  CheckHolds(found.fall.height, truth.fall);
  CheckHolds(found.fill_volume, truth.fill);
  CheckHolds(found.cut_volume, truth.cut);
  CheckHolds(found.net_volume, truth.fill - truth.cut);
  CheckHolds(found.area_both, truth.both);
  CheckHolds(found.area_a, truth.a);
  CheckHolds(found.area_b, truth.b);
}

double Width(const ValueInterval& interval) { return interval.high - interval.low; }

HeightChange ChangeOf(const BuiltObject& a, const BuiltObject& b, HeightChangeOptions options) {
  options.as_stored = true;
  const Result<HeightChange> found = CompareHeights(*a.surface, *b.surface, options);
  if (!found) FAIL(found.status().message());
  return *found;
}

void CheckAllWidths(const BuiltObject& a, const BuiltObject& b, double range) {
  const Truth truth = ExactChange(a, b);
  for (const double part : {0.3, 0.03, 1e-3, 0.0}) {
    CAPTURE(part);
    HeightChangeOptions options;
    options.width = part * range;
    options.threads = part == 0.03 ? 3 : 1;
    const HeightChange found = ChangeOf(a, b, options);
    CheckHolds(found, truth);
    const double slack = 1e-8 * range;
    CHECK(Width(found.rise.height) <= *options.width + slack);
    CHECK(Width(found.fall.height) <= *options.width + slack);
    CHECK(Width(found.fill_volume) <= (*options.width + slack) * (truth.both + 1e-9));
    CHECK(Width(found.cut_volume) <= (*options.width + slack) * (truth.both + 1e-9));
    CHECK_FALSE(found.out_of_time);
  }
}

}  // namespace

TEST_CASE("Changes of height of random triangulations hold the exact overlay's", "[oracle]") {
  std::mt19937 random(3);
  for (int round = 0; round < 8; ++round) {
    CAPTURE(round);
    // They lie over each other, or in part, or not at all; and far away from the origin.
    const double far = round % 2 == 0 ? 0 : 4.5e6, side = round % 2 == 0 ? 1 : 1000;
    const double aside = std::array{0.0, 0.4, -0.7, 2.0}[static_cast<size_t>(round) % 4];
    const BuiltObject a =
        Build(RandomTin(20 + 60 * round, far, side, 0.3 * side, random), AsTerrain());
    const BuiltObject b =
        Build(RandomTin(300 - 30 * round, far + aside * side, 1.2 * side, 0.2 * side, random),
              AsTerrain());
    CheckAllWidths(a, b, 0.3 * side);
  }
}

TEST_CASE(
    "Changes of height of rasters, with holes and borders that move, hold the exact overlay's",
    "[oracle]") {
  std::mt19937 random(5);
  for (const bool holes : {false, true}) {
    CAPTURE(holes);
    const auto heights = [&](double phase) {
      std::vector<double> h;
      for (int r = 0; r < 33; ++r) {
        for (int c = 0; c < 35; ++c) {
          h.push_back(std::round(40 * std::sin(0.2 * c + phase) * std::cos(0.15 * r) +
                                 static_cast<double>(random() % 5)));
        }
      }
      return h;
    };
    const auto build = [&](double phase) {
      const std::vector<double> all = heights(phase);
      return BuildTerrain(35, 33, holes ? WithHoles(all, 35, 33) : all, Triangulation::kDelaunay,
                          holes);
    };
    const Terrain a = build(0), b = build(0.4);
    REQUIRE(a.built.record.border_moves == holes);
    CheckAllWidths(a.built, b.built, 80);
    // Holes of one of them alone.
    const Terrain whole = BuildTerrain(35, 33, heights(0.1), Triangulation::kDelaunay, false);
    if (!holes) CheckAllWidths(a.built, whole.built, 80);
  }
}

TEST_CASE("Holes of one terrain are what the other one covers alone", "[oracle]") {
  std::vector<double> flat(40 * 40, 7), high(40 * 40, 9);
  const Terrain a = BuildTerrain(40, 40, flat, Triangulation::kDelaunay, true);
  const Terrain b = BuildTerrain(40, 40, WithHoles(high, 40, 40), Triangulation::kDelaunay, true);
  const Truth truth = ExactChange(a.built, b.built);
  const HeightChange found = ChangeOf(a.built, b.built, {.width = 0.0});
  CheckHolds(found, truth);
  CHECK(truth.a > 0);
  CHECK(Width(found.area_a) <= 1e-6 * truth.a);
  CHECK(found.rise.height.low > 2 - 1e-9);
  CHECK(found.rise.height.high < 2 + 1e-9);
  CHECK(found.fall.height == ValueInterval{0, 0});
  CHECK(found.cut_volume.high <= 1e-9 * truth.fill);
}

TEST_CASE("Coarse cuts whose borders have moved inwards tell that there may be more", "[oracle]") {
  std::vector<double> low(90 * 90, 7), high(90 * 90, 1007);
  const Terrain a = BuildTerrain(90, 90, WithHoles(low, 90, 90), Triangulation::kDelaunay, true);
  const Terrain b = BuildTerrain(90, 90, WithHoles(high, 90, 90), Triangulation::kDelaunay, true);
  const Truth truth = ExactChange(a.built, b.built);
  bool coarse = false;
  for (double width = 4000; width > 1e-3; width /= 2) {
    CAPTURE(width);
    const HeightChange found = ChangeOf(a.built, b.built, {.width = width});
    CheckHolds(found, truth);
    coarse |= Width(found.area_both) > 0.01 * truth.both;
  }
  CHECK(coarse);
}

TEST_CASE("A plane with bumps has the volume of its bumps") {
  // Each is a pyramid over the six triangles of a vertex, whose area is 3 cells.
  const std::vector<Vec3d> none;
  TriangleMesh mesh = Plane(40, none, 0);
  for (Vec3d& p : mesh.positions) p = {40 * p.x, 40 * p.y, 10};
  const BuiltObject a = Build(mesh, AsTerrain());
  const auto at = [&](int x, int y) -> Vec3d& {
    return mesh.positions[static_cast<size_t>(y * 41 + x)];
  };
  at(10, 12).z += 2;
  at(30, 7).z += 1;
  at(20, 33).z -= 3;
  const BuiltObject b = Build(mesh, AsTerrain());
  const HeightChange found = ChangeOf(a, b, {.width = 0.0});
  CheckHolds(found, {2, 3, 3, 3, 1600, 0, 0});
  for (const ValueInterval* const v : {&found.rise.height, &found.fall.height, &found.fill_volume,
                                       &found.cut_volume, &found.net_volume, &found.area_both}) {
    CHECK(Width(*v) < 1e-6);
  }
  REQUIRE(found.rise.point);
  CHECK(Length(*found.rise.point - Vec3d{10, 12, 12}) < 1e-9);
  REQUIRE(found.fall.point);
  CHECK(Length(*found.fall.point - Vec3d{20, 33, 7}) < 1e-9);
  // The other way round.
  const HeightChange back = ChangeOf(b, a, {.width = 0.0});
  CheckHolds(back, {3, 2, 3, 3, 1600, 0, 0});
  // A part of the plane, which cuts the second bump in two.
  HeightChangeOptions part{.width = 0.0};
  part.window = std::array<double, 4>{25, -5, 30, 100};
  const HeightChange half = ChangeOf(a, b, part);
  CheckHolds(half.rise.height, 1);
  CheckHolds(half.fill_volume, 0.5);
  CHECK(Width(half.fill_volume) < 1e-6);
  CheckHolds(half.area_both, 200);
  CHECK(half.cut_volume.high < 1e-6);
  part.window = std::array<double, 4>{50, 50, 60, 60};
  CHECK(ChangeOf(a, b, part).area_both == ValueInterval{0, 0});
}

TEST_CASE("A tolerance of heights is decided on either side of the largest change") {
  std::mt19937 random(9);
  const BuiltObject a = Build(RandomTin(400, 0, 1, 0.3, random), AsTerrain());
  const BuiltObject b = Build(RandomTin(300, 0, 1, 0.3, random), AsTerrain());
  const Truth truth = ExactChange(a, b);
  const double largest = std::max(truth.rise, truth.fall);
  CHECK(ChangeOf(a, b, {.tolerance = 1.01 * largest}).verdict == CompareVerdict::kWithin);
  CHECK(ChangeOf(a, b, {.tolerance = 0.99 * largest}).verdict == CompareVerdict::kExceeds);
  const HeightChange found = ChangeOf(a, b, {.tolerance = 0.5 * largest});
  CHECK(found.verdict == CompareVerdict::kExceeds);
  CheckHolds(found, truth);
}

TEST_CASE("Little is read where little is asked, and without time the catalog answers") {
  std::vector<double> hills;
  for (int r = 0; r < 300; ++r) {
    for (int c = 0; c < 300; ++c) {
      hills.push_back(std::round(200 * std::sin(0.03 * c) * std::cos(0.02 * r)));
    }
  }
  const Terrain a = BuildTerrain(300, 300, hills, Triangulation::kDelaunay);
  for (double& h : hills) h += 5;
  hills[150 * 300 + 80] += 30;
  const Terrain b = BuildTerrain(300, 300, hills, Triangulation::kDelaunay);
  const double area = 299 * 0.25 * 299 * 0.5;
  const double fill = 5 * area + 30 * 0.25 * 0.5;
  const HeightChange coarse = ChangeOf(a.built, b.built, {.width = 20.0});
  CheckHolds(coarse.fill_volume, fill);
  CheckHolds(coarse.rise.height, 35);
  CHECK(coarse.clusters_read < coarse.clusters_total / 2);
  HeightChangeOptions none{.width = 0.0};
  none.max_milliseconds = 0;
  const HeightChange unasked = ChangeOf(a.built, b.built, none);
  CHECK(unasked.out_of_time);
  CheckHolds(unasked.fill_volume, fill);
  CheckHolds(unasked.rise.height, 35);
  CheckHolds(unasked.area_both, area);
  CHECK(unasked.clusters_read == 0);
  const HeightChange fine = ChangeOf(a.built, b.built, {.width = 0.0});
  CheckHolds(fine.fill_volume, fill);
  CHECK(Width(fine.fill_volume) < 1e-6 * fill);
  CheckHolds(fine.rise.height, 35);
  CHECK(Width(fine.rise.height) < 1e-9);
  CHECK(fine.fall.height == ValueInterval{0, 0});
}

TEST_CASE("Heights of inputs that were rounded are between those that were stored", "[oracle]") {
  std::mt19937 random(4);
  const TriangleMesh first = RandomTin(200, 0, 1, 0.3, random);
  TriangleMesh second = first;
  for (Vec3d& p : second.positions) p.z += 0.1;
  BuildOptions coarse = AsTerrain();
  coarse.bits = 12;
  const BuiltObject a = Build(first, coarse), b = Build(second, coarse);
  const Result<HeightChange> found = CompareHeights(*a.surface, *b.surface, {.width = 0.0});
  REQUIRE(found.ok());
  CheckHolds(found->rise.height, 0.1);
  CHECK(found->fill_volume.low <= 0.1 * found->area_both.high);
  CHECK(found->fill_volume.high >= 0.1 * found->area_both.low);
  CHECK(Width(found->rise.height) <=
        2.1 * (a.record.rounding_error + b.record.rounding_error) + 1e-9);
}

TEST_CASE("Copies of a terrain are told by their digests") {
  const Terrain a =
      BuildTerrain(60, 60, std::vector<double>(3600, 3), Triangulation::kDelaunay, false);
  const HeightChange same = ChangeOf(a.built, a.built, {.tolerance = 0.0});
  CHECK(same.identical);
  CHECK(same.verdict == CompareVerdict::kWithin);
  CheckHolds(same.area_both, 59 * 0.25 * 59 * 0.5);
  CHECK(Width(same.area_both) < 1e-6);
}

TEST_CASE("Comparisons of heights that mean nothing are refused, and cancelled ones say so") {
  std::mt19937 random(2);
  const BuiltObject a = Build(RandomTin(50, 0, 1, 1, random), AsTerrain());
  const BuiltObject b = Build(RandomTin(50, 0, 1, 1, random), AsTerrain());
  const BuiltObject mesh = Build(MakeSculpture(500));
  const auto refused = [&](const BuiltObject& x, const BuiltObject& y,
                           const HeightChangeOptions& options, const std::string& words) {
    const Result<HeightChange> found = CompareHeights(*x.surface, *y.surface, options);
    REQUIRE(!found.ok());
    CHECK(found.status().code() == StatusCode::kInvalidArgument);
    CHECK_THAT(found.status().message(), Catch::Contains(words));
  };
  refused(a, b, {.tolerance = -1.0}, "tolerance: ");
  refused(a, b, {.width = std::nan("")}, "width: ");
  refused(a, b, {.max_milliseconds = -1.0}, "max_milliseconds: ");
  refused(a, b, {.window = std::array<double, 4>{1, 1, 0, 2}}, "window: ");
  refused(a, b, {.window = std::array<double, 4>{0, 0, std::nan(""), 2}}, "window: ");
  refused(a, mesh, {}, "is no terrain");
  refused(mesh, b, {}, "is no terrain");
  QueryControl control;
  control.Cancel();
  HeightChangeOptions cancelled;
  cancelled.control = &control;
  const Result<HeightChange> found = CompareHeights(*a.surface, *b.surface, cancelled);
  REQUIRE(!found.ok());
  CHECK(found.status().code() == StatusCode::kCancelled);
}

}  // namespace mtdb::testing
