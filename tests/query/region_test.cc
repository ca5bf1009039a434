// Regions against dense sampling of triangles.
#include "query/region.h"

#include <catch2/catch.hpp>
#include <random>

namespace mtdb::testing {
namespace {

double Uniform(std::mt19937& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}
Vec3d Point(std::mt19937& random) {
  return {Uniform(random, -1, 1), Uniform(random, -1, 1), Uniform(random, -1, 1)};
}

// The smallest value of f over a fine sampling of the triangle; at most `coarse` too large for a
// function of slope one.
template <typename F>
double SampledMin(const Triangle3d& t, F&& f) {
  constexpr int kSteps = 60;
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; i + j <= kSteps; ++j) {
      const double a = 1.0 * i / kSteps;
      const double b = 1.0 * j / kSteps;
      best = std::min(best, f(t[0] * a + t[1] * b + t[2] * (1 - a - b)));
    }
  }
  return best;
}

}  // namespace

TEST_CASE("Within agrees with the sampled distance, and boxes are conservative") {
  std::mt19937 random(1);
  int inside = 0;
  for (int i = 0; i < 300; ++i) {
    Box3d box;
    box.Add(Point(random));
    box.Add(Point(random));
    const Vec3d centre = Point(random);
    const double radius = Uniform(random, 0, 0.5);
    const double size = Uniform(random, 0.02, 0.5);
    const Vec3d p = Point(random);
    const Triangle3d t{p, p + Point(random) * size, p + Point(random) * size};
    const double to_box =
        SampledMin(t, [&](Vec3d q) { return std::sqrt(SquaredDistancePointBox(q, box)); });
    const double to_ball =
        SampledMin(t, [&](Vec3d q) { return std::max(0.0, Length(q - centre) - radius); });
    const double spacing = 2 * size * std::sqrt(3.0) / 60;
    Box3d around;
    for (const Vec3d& c : t) around.Add(c);
    const RegionPtr regions[] = {BoxRegion(box), SphereRegion(centre, radius)};
    const double distances[] = {to_box, to_ball};
    for (int r = 0; r < 2; ++r) {
      const RegionPtr both = UnionRegion({regions[r], SphereRegion({9, 9, 9}, 1)});
      for (const double d : {0.0, 0.05, 0.3, distances[r], distances[r] - spacing}) {
        if (d < 0) continue;
        const bool within = regions[r]->Within(t, d);
        REQUIRE(both->Within(t, d) == within);
        if (distances[r] <= d - 1e-9) REQUIRE(within);
        if (distances[r] - spacing > d + 1e-9) REQUIRE(!within);
        if (within) REQUIRE(regions[r]->BoxWithin(around, d));
        if (within) REQUIRE(regions[r]->Within(t, d * 1.5 + 1e-6));
        if (!both->BoxWithin(around, d)) REQUIRE(!within);
        inside += within;
      }
    }
  }
  REQUIRE(inside > 200);
}

TEST_CASE("A triangle that only touches a region is within distance 0") {
  Box3d box;
  box.Add(Vec3d{0, 0, 0});
  box.Add(Vec3d{1, 1, 1});
  const Triangle3d touching{Vec3d{1, 0.5, 0.5}, Vec3d{2, 0, 0}, Vec3d{2, 1, 0}};
  REQUIRE(BoxRegion(box)->Within(touching, 0));
  REQUIRE(SphereRegion({0, 0.5, 0.5}, 1)->Within(touching, 0));
  // No corner inside, but the middle passes through.
  const Triangle3d through{Vec3d{-5, 0.5, -5}, Vec3d{5, 0.5, -5}, Vec3d{0, 0.5, 9}};
  REQUIRE(BoxRegion(box)->Within(through, 0));
  REQUIRE(SphereRegion({0, 1.5, 0}, 1)->Within(through, 0));
  REQUIRE(!SphereRegion({0, 1.6, 0}, 1)->Within(through, 0.05));
}

TEST_CASE("Empty and negative regions meet nothing, the whole meets everything") {
  const Triangle3d t{Vec3d{0, 0, 0}, Vec3d{1, 0, 0}, Vec3d{0, 1, 0}};
  REQUIRE(!BoxRegion(Box3d{})->Within(t, 100));
  REQUIRE(!SphereRegion({0, 0, 0}, -1)->Within(t, 100));
  REQUIRE(!UnionRegion({})->Within(t, 100));
  REQUIRE(WholeRegion()->Within(t, 0));
  REQUIRE(WholeRegion()->whole());
  REQUIRE(!BoxRegion(Box3d{})->whole());
  REQUIRE(UnionRegion({BoxRegion(Box3d{}), WholeRegion()})->whole());
}

}  // namespace mtdb::testing
