// SPDX-License-Identifier: Apache-2.0
// Regions against their definitions, on densely sampled triangles.
#include "query/region.h"

#include <catch2/catch.hpp>
#include <map>
#include <random>

#include "query/fields/rounding.h"
#include "tests/query/random_regions.h"

namespace mtdb::testing {

using namespace internal;

namespace {

constexpr int kSteps = 24;

double Uniform(std::mt19937& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}
Vec3d Step(std::mt19937& random) {
  return {Uniform(random, -1, 1), Uniform(random, -1, 1), Uniform(random, -1, 1)};
}
Box3d Unit(Vec3d corner) { return {corner, corner + Vec3d{1, 1, 1}}; }

template <typename F>
void ForEachSample(const Triangle3d& t, F&& visit) {
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; i + j <= kSteps; ++j) {
      const double a = 1.0 * i / kSteps;
      const double b = 1.0 * j / kSteps;
      visit(t[0] * a + t[1] * b + t[2] * (1 - a - b));
    }
  }
}

// The smallest value of f at the samples; at most `spacing` too large for a function of slope one.
template <typename F>
double SampledMin(const Triangle3d& t, F&& f) {
  double best = std::numeric_limits<double>::infinity();
  ForEachSample(t, [&](Vec3d p) { best = std::min(best, f(p)); });
  return best;
}

// Every other one begins in the region, if that is easy to find.
Triangle3d RandomTriangle(const Box3d& where, const RegionCase& expected, std::mt19937& random) {
  const double size = std::pow(10, Uniform(random, -2.5, -0.2));
  Vec3d p = Step(random) * 0.7 + (where.min + where.max) * 0.5;
  const int tries = random() % 2 == 0 ? 20 : 0;
  for (int i = 0; i < tries && !expected.Contains(p); ++i) {
    p = Step(random) * 0.7 + (where.min + where.max) * 0.5;
  }
  Triangle3d t{p, p + Step(random) * size, p + Step(random) * size};
  if (random() % 4 == 0) t[2].z = t[1].z = t[0].z;
  if (random() % 8 == 0) t[2] = t[1] + (t[0] - t[1]) * Uniform(random, 0, 1);  // a needle
  return t;
}

double Spacing(const Triangle3d& t) {
  return std::max({Length(t[1] - t[0]), Length(t[2] - t[1]), Length(t[0] - t[2])}) / kSteps;
}

struct Counts {
  int within = 0, not_within = 0, covers = 0, decided = 0, box_not_within = 0, box_covers = 0;
};

// `slack` is what rounding may change.
void CheckRegion(const RegionCase& expected, const Triangle3d& t, double slack,
                 std::mt19937& random, Counts& counts) {
  INFO(expected.kind);
  const Region& region = *expected.region;
  const double spacing = Spacing(t);
  const double distance = SampledMin(t, expected.distance);
  const double depth = SampledMin(t, expected.depth);
  Box3d larger = Around(t);
  larger.Add(t[0] + Step(random) * Uniform(random, 0, 0.2));
  std::vector<double> at{0, 0.01, 0.1, 0.3, Uniform(random, 0, 1)};
  for (const double d : {distance, depth}) {
    for (const double more : {-1.01 * spacing, -2 * slack, 2 * slack}) {
      if (std::isfinite(d)) at.push_back(std::max(0.0, d + more));
    }
  }
  std::sort(at.begin(), at.end());
  bool was_within = false;
  bool was_covers = true;
  bool was_box_within = false;
  bool was_box_covers = true;
  for (const double d : at) {
    INFO(d << " with distance " << distance << ", depth " << depth << ", spacing " << spacing);
    const bool within = region.Within(t, d);
    const bool covers = region.Covers(t, d);
    if (distance <= 0 || (expected.within_is_exact && distance <= d - slack)) REQUIRE(within);
    if (expected.within_is_exact && distance - spacing > d + slack) REQUIRE(!within);
    if (expected.covers_is_exact && depth <= d - slack) REQUIRE(!covers);
    if (expected.covers_is_exact && depth - spacing > d + slack) REQUIRE(covers);
    counts.decided +=
        expected.within_is_exact && distance > 0 && std::abs(distance - d) < 2 * spacing;
    REQUIRE(within >= was_within);
    REQUIRE(covers <= was_covers);
    for (const Box3d& box : {Around(t), larger}) {
      if (within) REQUIRE(region.BoxWithin(box, d));
      if (region.BoxCovers(box, d)) REQUIRE(covers);
    }
    const bool box_within = region.BoxWithin(larger, d);
    const bool box_covers = region.BoxCovers(larger, d);
    REQUIRE(box_within >= was_box_within);
    REQUIRE(box_covers <= was_box_covers);
    // Points around the triangle.
    for (int i = 0; i < 20; ++i) {
      const double a = Uniform(random, 0, 1);
      const double b = Uniform(random, 0, 1 - a);
      Vec3d step = Step(random);
      step = step * (Uniform(random, 0, 1) * std::max(0.0, d - slack) / Length(step));
      const bool inside = expected.Contains(t[0] * a + t[1] * b + t[2] * (1 - a - b) + step);
      if (inside) REQUIRE(within);
      if (!inside) REQUIRE(!covers);
    }
    was_within = within;
    was_covers = covers;
    was_box_within = box_within;
    was_box_covers = box_covers;
    counts.within += within;
    counts.not_within += !within;
    counts.covers += covers;
    counts.box_not_within += !box_within;
    counts.box_covers += box_covers;
  }
}

}  // namespace

TEST_CASE("Every kind of region agrees with its definition, near and far from the origin") {
  std::mt19937 random(1);
  for (const Vec3d corner : {Vec3d{-0.5, -0.5, -0.5}, Vec3d{456789.125, 5412345.5, 312.25}}) {
    const Box3d where = Unit(corner);
    const double slack = 1e-9 + 1e-12 * LargestCoordinate(where.max);
    for (int kind = 0; kind < kRegionKinds; ++kind) {
      Counts counts;
      const char* name = "";
      for (int i = 0; i < 80; ++i) {
        const RegionCase expected = RandomRegion(kind, where, random);
        name = expected.kind;
        for (int k = 0; k < 4; ++k) {
          CheckRegion(expected, RandomTriangle(where, expected, random), slack, random, counts);
        }
      }
      INFO(name);
      CHECK(counts.within > 100);
      CHECK(counts.not_within > 50);
      CHECK(counts.decided > 50);
      CHECK(counts.box_not_within > 40);
      const bool thin = kind == 10 || kind == 11;
      CHECK((thin || counts.covers > 5));
      CHECK((thin || counts.box_covers > 2));
    }
  }
}

TEST_CASE("Unions, intersections and complements err to the safe side only") {
  std::mt19937 random(2);
  std::map<std::string, Counts> counts;
  for (const Vec3d corner : {Vec3d{-0.5, -0.5, -0.5}, Vec3d{456789.125, 5412345.5, 312.25}}) {
    const Box3d where = Unit(corner);
    const double slack = 1e-9 + 1e-12 * LargestCoordinate(where.max);
    for (int i = 0; i < 1000; ++i) {
      const RegionCase expected = RandomCombination(where, random);
      CheckRegion(expected, RandomTriangle(where, expected, random), slack, random,
                  counts[expected.kind]);
    }
  }
  REQUIRE(counts.size() == 4);
  for (const auto& [kind, c] : counts) {
    INFO(kind);
    CHECK(c.within > 100);
    CHECK(c.not_within > 100);
    CHECK(c.covers > 20);
    CHECK(c.box_not_within > 50);
    CHECK(c.box_covers > 10);
  }
}

TEST_CASE("An intersection of convex regions is exact where its parts are not") {
  // A wedge of 0.2 radians: the planes' neighbourhoods meet far before the wedge's tip.
  const RegionPtr upper = HalfSpaceRegion({{0, 0, 0}, {-0.1, 1, 0}});
  const RegionPtr lower = HalfSpaceRegion({{0, 0, 0}, {-0.1, -1, 0}});
  const RegionPtr wedge = IntersectionRegion({upper, IntersectionRegion({WholeRegion(), lower})});
  const Triangle3d left{Vec3d{-3, 0, 0}, Vec3d{-3, 0, 1}, Vec3d{-4, 0, 0}};
  REQUIRE(upper->Within(left, 0.5));
  REQUIRE(lower->Within(left, 0.5));
  REQUIRE(!wedge->Within(left, 2.999));
  REQUIRE(wedge->Within(left, 3.001));
  const RegionPtr box = BoxRegion({{-1, -1, -1}, {2, 1, 1}});
  REQUIRE(!IntersectionRegion({wedge, box})->Within({Vec3d{3, 0, 0}, {3, 1, 0}, {3, 0, 1}}, 0.999));
  REQUIRE(IntersectionRegion({wedge, box})->Within({Vec3d{3, 0, 0}, {3, 1, 0}, {3, 0, 1}}, 1.001));
  REQUIRE(!IntersectionRegion({box, BoxRegion(Box3d{})})->Within(left, 100));
  REQUIRE(IntersectionRegion({})->whole());
  // Two balls that both meet the triangle, far from each other.
  const RegionPtr balls =
      IntersectionRegion({SphereRegion({-3, 0, 0}, 0.5), SphereRegion({3, 0, 0}, 0.5)});
  REQUIRE(!balls->Within({Vec3d{-4, 0, 0}, Vec3d{4, 0, 0}, Vec3d{0, 1, 0}}, 0.1));
}

TEST_CASE("A union covers what only its parts together cover") {
  const RegionPtr boxes =
      UnionRegion({BoxRegion({{-2, -1, -1}, {0.5, 1, 1}}), BoxRegion({{-0.5, -1, -1}, {2, 1, 1}})});
  const Triangle3d t{Vec3d{-1, 0, 0}, Vec3d{1, 0, 0}, Vec3d{0, 0.5, 0}};
  REQUIRE(boxes->Covers(t, 0.1));
  REQUIRE(!boxes->Covers(t, 0.6));
  REQUIRE(!ComplementRegion(boxes)->Within(t, 0.1));
  const RegionPtr tube = TubeRegion({{-2, 0, 0}, {0, 0, 0}, {2, 0, 0}}, 1);
  REQUIRE(tube->Covers(t, 0.2));
  REQUIRE(!tube->Covers(t, 0.51));
}

TEST_CASE("A triangle that only touches a region is within distance 0") {
  const Box3d box{{0, 0, 0}, {1, 1, 1}};
  const Triangle3d touching{Vec3d{1, 0.5, 0.5}, Vec3d{2, 0, 0}, Vec3d{2, 1, 0}};
  REQUIRE(BoxRegion(box)->Within(touching, 0));
  REQUIRE(SphereRegion({0, 0.5, 0.5}, 1)->Within(touching, 0));
  REQUIRE(HalfSpaceRegion({{1, 0, 0}, {1, 0, 0}})->Within(touching, 0));
  REQUIRE(!HalfSpaceRegion({{1, 0, 0}, {1, 0, 0}})->Covers(touching, 0));
  REQUIRE(ComplementRegion(HalfSpaceRegion({{1, 0, 0}, {-1, 0, 0}}))->Within(touching, 0));
  REQUIRE(PrismRegion({{{0, 0}, {1, 0}, {1, 1}, {0, 1}}})->Within(touching, 0));
  REQUIRE(PointRegion({1, 0.5, 0.5})->Within(touching, 0));
  REQUIRE(SegmentRegion({1.5, 0.5, -7}, {1.5, 0.5, 9})->Within(touching, 0));
  // No corner inside, but the middle passes through.
  const Triangle3d through{Vec3d{-5, 0.5, -5}, Vec3d{5, 0.5, -5}, Vec3d{0, 0.5, 9}};
  REQUIRE(BoxRegion(box)->Within(through, 0));
  REQUIRE(IntersectionRegion({BoxRegion(box), BoxRegion(box)})->Within(through, 0));
  REQUIRE(PrismRegion({{{0, 0}, {1, 0}, {1, 1}, {0, 1}}}, 0, 1)->Within(through, 0));
  REQUIRE(SegmentRegion({0, 0, 0}, {0, 1, 0})->Within(through, 0));
  REQUIRE(SphereRegion({0, 1.5, 0}, 1)->Within(through, 0));
  REQUIRE(!SphereRegion({0, 1.6, 0}, 1)->Within(through, 0.05));
}

TEST_CASE("Empty and negative regions meet nothing, the whole meets everything") {
  const Triangle3d t{Vec3d{0, 0, 0}, Vec3d{1, 0, 0}, Vec3d{0, 1, 0}};
  const Box3d box = Around(t);
  for (const RegionPtr& nothing :
       {BoxRegion(Box3d{}), SphereRegion({0, 0, 0}, -1), UnionRegion({}),
        TubeRegion({{0, 0, 0}}, -1), ComplementRegion(WholeRegion()),
        PrismRegion({{{0, 0}, {1, 0}, {0, 1}}}, 1, -1),
        ConvexRegion({{{0, 0, 0}, {1, 0, 0}}, {{1, 0, 0}, {-1, 0, 0}}})}) {
    REQUIRE(!nothing->Within(t, 100));
    REQUIRE(!nothing->Covers(t, 0));
    REQUIRE(!nothing->BoxCovers(box, 0));
    REQUIRE(ComplementRegion(nothing)->Within(t, 0));
    REQUIRE(ComplementRegion(nothing)->Covers(t, 100));
  }
  REQUIRE(WholeRegion()->Within(t, 0));
  REQUIRE(WholeRegion()->Covers(t, 1e9));
  REQUIRE(WholeRegion()->whole());
  REQUIRE(ConvexRegion({})->whole());
  REQUIRE(!BoxRegion(Box3d{})->whole());
  REQUIRE(UnionRegion({BoxRegion(Box3d{}), WholeRegion()})->whole());
}

TEST_CASE("A long line and a polygon of many corners are as exact as short ones") {
  std::mt19937 random(3);
  std::vector<Vec3d> line;
  std::vector<std::array<double, 2>> polygon;
  for (int i = 0; i < 3000; ++i) {
    const double angle = i * 2 * 3.14159265358979323846 / 3000;
    const double radius = 0.6 + 0.3 * std::sin(40 * angle);
    polygon.push_back({radius * std::cos(angle), radius * std::sin(angle)});
    line.push_back({polygon.back()[0], polygon.back()[1], 0.2 * std::sin(3 * angle)});
  }
  const RegionPtr tube = TubeRegion(line, 0.05);
  const RegionPtr prism = PrismRegion(polygon);
  for (int i = 0; i < 300; ++i) {
    const Vec3d p{Uniform(random, -1, 1), Uniform(random, -1, 1), Uniform(random, -0.2, 0.2)};
    const Triangle3d t{p, p, p};
    double to_line = 9;
    for (size_t k = 0; k + 1 < line.size(); ++k) {
      to_line = std::min(to_line, SquaredDistancePointSegment(p, line[k], line[k + 1]));
    }
    to_line = std::sqrt(to_line);
    for (const double d : {0.0, 0.03, 0.2}) {
      if (std::abs(to_line - 0.05 - d) > 1e-9) {
        REQUIRE(tube->Within(t, d) == (to_line < 0.05 + d));
      }
    }
    const double radius = 0.6 + 0.3 * std::sin(40 * std::atan2(p.y, p.x));
    if (std::abs(std::hypot(p.x, p.y) - radius) < 1e-3) continue;
    REQUIRE(prism->Within(t, 0) == (std::hypot(p.x, p.y) < radius));
    REQUIRE(prism->Covers(t, 0) == prism->Within(t, 0));
  }
}

// A region of the kind, and one that is a little off: the same numbers in a box that has moved.
std::array<RegionPtr, 2> MovedRegions(int kind, double step, std::mt19937& random) {
  const Box3d where{{-1, -1, -1}, {1, 1, 1}};
  Box3d moved = where;
  for (int i = 0; i < 3; ++i) {
    moved.min[i] += Uniform(random, -step, step);
    moved.max[i] += Uniform(random, -step, step);
  }
  const auto one = [&](const Box3d& box, std::mt19937 same) {
    return kind < kRegionKinds ? RandomRegion(kind, box, same).region
                               : RandomCombination(box, same).region;
  };
  const std::array<RegionPtr, 2> both{one(where, random), one(moved, random)};
  random.discard(64);
  return both;
}

TEST_CASE("Depths in a region are kept where its border has shifted by less") {
  std::mt19937 random(3);
  int known = 0;
  int kept = 0;
  for (int i = 0; i < 40 * (kRegionKinds + 6); ++i) {
    const double step = std::pow(10, Uniform(random, -4, -0.5));
    const auto [from, to] = MovedRegions(i / 40, step, random);
    Box3d within;
    for (int c = 0; c < 2; ++c) {
      within.Add(Vec3d{Uniform(random, -2, 2), Uniform(random, -2, 2), Uniform(random, -2, 2)});
    }
    const double shift = from->Shift(*to, within);
    REQUIRE(shift >= 0);
    REQUIRE(from->Shift(*from, within) <= 1e-10);
    known += std::isfinite(shift) ? 1 : 0;
    for (int j = 0; j < 50; ++j) {
      Box3d box;
      for (int c = 0; c < 2; ++c) {
        Vec3d p;
        const double size = j % 2 == 0 ? 1 : 0.1;
        for (int k = 0; k < 3; ++k) {
          const double t = c == 0 || j % 2 == 0 ? Uniform(random, 0, 1) : 0;
          p[k] = c == 0 ? within.min[k] + t * (within.max[k] - within.min[k])
                        : std::clamp(box.min[k] + size * Uniform(random, -1, 1), within.min[k],
                                     within.max[k]);
        }
        box.Add(p);
      }
      const double depth = from->Depth(box);
      const auto holds = [&](const Region& region, double size) {
        const double d = std::min(size * (1 - 1e-9), 1e6);
        return depth > 0 ? region.BoxCovers(box, d) : !region.BoxWithin(box, d);
      };
      INFO("kind " << i / 40 << " depth " << depth << " shift " << shift);
      if (depth != 0) REQUIRE(holds(*from, std::abs(depth)));
      if (!(std::abs(depth) > shift)) continue;
      ++kept;
      REQUIRE(holds(*to, std::abs(depth) - shift));
    }
  }
  CHECK(known > 400);
  CHECK(kept > 5000);
}

TEST_CASE("A box has not shifted where the faces that moved do not matter") {
  const auto box = [](Vec3d max) {
    Box3d b;
    b.Add(Vec3d{0, 0, 0});
    b.Add(max);
    return BoxRegion(b);
  };
  const auto around = [](Vec3d p) {
    Box3d b;
    b.Add(p - Vec3d{0.1, 0.1, 0.1});
    b.Add(p + Vec3d{0.1, 0.1, 0.1});
    return b;
  };
  const RegionPtr from = box({1, 1, 1});
  const RegionPtr to = box({1.25, 1, 1});
  for (const Vec3d p : {Vec3d{0, 0.5, 0.5}, Vec3d{0.5, 1, 0.5}, Vec3d{-3, 0.5, 0.5}}) {
    REQUIRE(from->Shift(*to, around(p)) == 0);
  }
  for (const Vec3d p : {Vec3d{1, 0.5, 0.5}, Vec3d{2, 0.5, 0.5}, Vec3d{0.8, 0.5, 0.5}}) {
    REQUIRE(from->Shift(*to, around(p)) >= 0.25);
  }
}

TEST_CASE("A camera that cannot see says why") {
  const auto message = [](auto&& change) {
    Camera camera;
    change(camera);
    const Status status = camera.Validate();
    REQUIRE(status.code() == StatusCode::kInvalidArgument);
    return status.message();
  };
  REQUIRE(Camera().Validate().ok());
  CHECK_THAT(message([](Camera& c) { c.direction = {}; }), Catch::Contains("direction"));
  CHECK_THAT(message([](Camera& c) { c.up = {0, -2, 0}; }), Catch::Contains("up"));
  CHECK_THAT(message([](Camera& c) { c.eye.x = NAN; }), Catch::Contains("eye"));
  CHECK_THAT(message([](Camera& c) { c.vertical_fov_rad = 3.2; }), Catch::Contains("180"));
  CHECK_THAT(message([](Camera& c) { c.width_px = 0; }), Catch::Contains("viewport"));
  CHECK_THAT(message([](Camera& c) { c.far = c.near; }), Catch::Contains("far"));
  CHECK_THAT(message([](Camera& c) { c.near = -1; }), Catch::Contains("near"));
}

}  // namespace mtdb::testing
