// Thresholds against samples around triangles and boxes.
#include "query/threshold.h"

#include <catch2/catch.hpp>
#include <limits>
#include <random>

namespace mtdb::testing {

TEST_CASE("Min is below every sample, close to the smallest, and above MinOverBox") {
  std::mt19937 random(2);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const auto point = [&] { return Vec3d{uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)}; };
  for (int i = 0; i < 200; ++i) {
    const Vec3d from = point();
    const double base = uniform(-1, 1);
    const double slope = uniform(-2, 2);
    const ThresholdPtr linear = LinearThreshold(from, base, slope);
    const double cap = uniform(-1, 1);
    const ThresholdPtr capped = MinThreshold({linear, ConstantThreshold(cap)});
    const Triangle3d t{point(), point(), point()};
    const double d = uniform(0, 0.3);
    double smallest = std::numeric_limits<double>::infinity();
    for (int k = 0; k < 3000; ++k) {
      double a = uniform(0, 1);
      double b = uniform(0, 1);
      if (a + b > 1) {
        a = 1 - a;
        b = 1 - b;
      }
      if (k < 3) {
        a = k == 0;
        b = k == 1;
      }
      const Vec3d p = t[0] * a + t[1] * b + t[2] * (1 - a - b);
      const Vec3d step = slope >= 0 ? from - p : p - from;
      const double length = Length(step);
      const Vec3d q = length > 0 ? p + step * (std::min(slope >= 0 ? length : d, d) / length) : p;
      smallest = std::min(smallest, base + slope * Length(q - from));
    }
    const double min = linear->Min(t, d);
    REQUIRE(min <= smallest + 1e-9);
    REQUIRE(min >= smallest - 0.1 * std::abs(slope));
    REQUIRE(linear->Min(t, d + 0.1) <= min);
    REQUIRE(capped->Min(t, d) == std::min(min, cap));
    Box3d box;
    for (const Vec3d& p : t) box.Add(p);
    REQUIRE(linear->MinOverBox(box, d) <= min);
    REQUIRE(capped->MinOverBox(box, d) <= capped->Min(t, d));
  }
}

TEST_CASE("Constants know that they are constant") {
  REQUIRE(ConstantThreshold(0.5)->constant() == 0.5);
  REQUIRE(!ConstantThreshold(0)->full_resolution());
  REQUIRE(FullResolution()->full_resolution());
  REQUIRE(!CoarsestThreshold()->full_resolution());
  REQUIRE(!LinearThreshold({}, -1, 0)->constant().has_value());
  REQUIRE(MinThreshold({ConstantThreshold(2), FullResolution()})->full_resolution());
  REQUIRE(!MinThreshold({LinearThreshold({}, 1, 1), ConstantThreshold(1)})->constant());
}

}  // namespace mtdb::testing
