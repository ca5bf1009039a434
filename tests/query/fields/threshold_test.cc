// SPDX-License-Identifier: Apache-2.0
// Thresholds against samples around triangles.
#include "query/threshold.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include "query/fields/rounding.h"
#include "query/fields/vertical_reach.h"
#include "tests/query/random_regions.h"

namespace mtdb::testing {

using namespace internal;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr Box3d kUnit{{-0.5, -0.5, -0.5}, {0.5, 0.5, 0.5}};

double Uniform(std::mt19937& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}
Vec3d Point(std::mt19937& random) {
  return {Uniform(random, -1, 1), Uniform(random, -1, 1), Uniform(random, -1, 1)};
}
Vec3d PointOn(const Triangle3d& t, std::mt19937& random) {
  const double a = Uniform(random, 0, 1);
  const double b = Uniform(random, 0, 1 - a);
  return t[0] * a + t[1] * b + t[2] * (1 - a - b);
}
Triangle3d RandomTriangle(std::mt19937& random) {
  const double size = std::pow(10, Uniform(random, -2, 0));
  const Vec3d p = Point(random);
  return {p, p + Point(random) * size, p + Point(random) * size};
}
// At most `distance` long.
Vec3d Step(double distance, std::mt19937& random) {
  const Vec3d v = Point(random);
  return v * (std::min(distance, distance * Uniform(random, 0, 1.3)) / Length(v));
}

// A threshold, and what it is point by point.
struct Field {
  ThresholdPtr threshold;
  std::function<double(Vec3d)> at;
};

Field OfDistance(int kind, std::mt19937& random, Vec3d* point) {
  const Vec3d from = *point = Point(random);
  const double base = Uniform(random, -1, 1);
  const double f = Uniform(random, -2, 2);
  switch (kind) {
    case 0:
      return {LinearThreshold(from, base, f), [=](Vec3d p) { return base + f * Length(p - from); }};
    case 1:
      return {QuadraticThreshold(from, base, f),
              [=](Vec3d p) { return base + f * SquaredLength(p - from); }};
    case 2:
      return {SquareRootThreshold(from, base, f),
              [=](Vec3d p) { return base + f * std::sqrt(Length(p - from)); }};
    default:
      return {ExponentialThreshold(from, base, f),
              [=](Vec3d p) { return base * std::exp(f * Length(p - from)); }};
  }
}

// The image of a point in pixels; nothing when it is not in sight.
std::optional<std::array<double, 2>> Image(const Camera& c, Vec3d p) {
  const Camera::Axes a = c.axes();
  const double depth = Dot(p - c.eye, a.forward);
  const double x = Dot(p - c.eye, a.right);
  const double y = Dot(p - c.eye, a.up);
  if (depth < c.near || depth <= 0 || std::abs(y) > depth * std::tan(c.vertical_fov_rad / 2)) {
    return std::nullopt;
  }
  const double focal = c.height_px / 2.0 / std::tan(c.vertical_fov_rad / 2);
  if (std::abs(x / depth * focal) > c.width_px / 2.0) return std::nullopt;
  return std::array<double, 2>{x / depth * focal, y / depth * focal};
}

}  // namespace

TEST_CASE("A threshold by distance is the smallest value around the triangle") {
  std::mt19937 random(2);
  for (int i = 0; i < 400; ++i) {
    Vec3d from;
    const Field field = OfDistance(i % 4, random, &from);
    const double cap = Uniform(random, -1, 1);
    const ThresholdPtr least = MinThreshold({field.threshold, ConstantThreshold(cap)});
    const ThresholdPtr most = MaxThreshold({field.threshold, ConstantThreshold(cap)});
    const Triangle3d t = RandomTriangle(random);
    const double d = Uniform(random, 0, 0.3);
    double smallest = kInfinity;
    const auto sample = [&](Vec3d p) { smallest = std::min(smallest, field.at(p)); };
    for (int k = 0; k < 3000; ++k) {
      const Vec3d p = k < 3 ? t[static_cast<size_t>(k)] : PointOn(t, random);
      const double length = Length(p - from);
      if (length == 0) continue;
      sample(p + (p - from) * (d / length));
      sample(p - (p - from) * (std::min(d, length) / length));
    }
    const double min = field.threshold->Min(t, d);
    REQUIRE(min <= smallest + 1e-9);
    REQUIRE(min >= smallest - 0.3);
    if (Length(t[1] - t[0]) < 0.02 && i % 4 != 2) REQUIRE(min >= smallest - 0.02);
    REQUIRE(field.threshold->Min(t, d + 0.1) <= min);
    REQUIRE(least->Min(t, d) == std::min(min, cap));
    REQUIRE(most->Min(t, d) == std::max(min, cap));
  }
}

TEST_CASE("Where a screen-space threshold is met, nothing in sight moves by more pixels") {
  std::mt19937 random(3);
  int near_the_limit = 0;
  int in_sight = 0;
  for (int i = 0; i < 500; ++i) {
    const Camera camera = RandomCamera(kUnit, random);
    const double pixels = Uniform(random, 0.1, 20);
    const ThresholdPtr screen = ScreenThreshold(camera, pixels);
    const Triangle3d t = RandomTriangle(random);
    REQUIRE(screen->Min(t, 0.1) >= screen->Min(t, 0.2));
    // The largest error that meets it.
    double e = 0;
    for (double step = 1; step > 1e-9; step /= 2) {
      if (e + step <= screen->Min(t, e + step)) e += step;
    }
    REQUIRE(e <= std::max(0.0, screen->Min(t, e)));
    double moved = 0;
    for (int k = 0; k < 400; ++k) {
      const Vec3d p = PointOn(t, random);
      const Vec3d q = p + Step(e, random);
      const auto a = Image(camera, p);
      const auto b = Image(camera, q);
      if (!a || !b) continue;
      ++in_sight;
      moved = std::max(moved, std::hypot((*a)[0] - (*b)[0], (*a)[1] - (*b)[1]));
    }
    REQUIRE(moved <= pixels * (1 + 1e-9));
    near_the_limit += moved > 0.8 * pixels;
  }
  REQUIRE(in_sight > 20000);
  REQUIRE(near_the_limit > 50);
  // Twice as far, twice the error; behind the camera, any.
  Camera camera;
  camera.direction = {1, 0, 0};
  const ThresholdPtr screen = ScreenThreshold(camera, 2);
  const auto at = [](Vec3d p) { return Triangle3d{p, p, p}; };
  REQUIRE(screen->Min(at({10, 0, 0}), 0) == Approx(2 * camera.pixel() * 10));
  REQUIRE(screen->Min(at({20, 0, 0}), 0) == Approx(2 * camera.pixel() * 20));
  REQUIRE(screen->Min(at({10, 0, 0}), 4) < screen->Min(at({6, 0, 0}), 0));
  REQUIRE(screen->Min(at({10, 0, 0}), 10) == 0);
  REQUIRE(screen->Min(at({-10, 0, 0}), 9) == kInfinity);
}

TEST_CASE("A threshold by region is never above the field, and exact away from the border") {
  std::mt19937 random(4);
  int mixed = 0;
  int fine = 0;
  for (int i = 0; i < 600; ++i) {
    const RegionCase expected = AnyRegion(kUnit, random);
    Vec3d from;
    const Field inside = OfDistance(0, random, &from);
    const ThresholdPtr threshold =
        RegionThreshold(expected.region, inside.threshold, ConstantThreshold(5));
    const Triangle3d t = RandomTriangle(random);
    const double d = Uniform(random, 0, 0.3);
    const double min = threshold->Min(t, d);
    double smallest = kInfinity;
    for (int k = 0; k < 300; ++k) {
      const Vec3d p = PointOn(t, random) + Step(d, random);
      smallest = std::min(smallest, expected.Contains(p) ? inside.at(p) : 5.0);
    }
    REQUIRE(min <= smallest + 1e-9);
    REQUIRE(threshold->Min(t, d * 1.5) <= min);
    if (!expected.region->Within(t, d)) REQUIRE(min == 5);
    fine += min < 5;
    mixed += min < smallest - 1e-9;
  }
  REQUIRE(fine > 100);
  REQUIRE(mixed > 20);
  const ThresholdPtr step =
      RegionThreshold(SphereRegion({0, 0, 0}, 1), ConstantThreshold(9), ConstantThreshold(1));
  const Triangle3d centre{Vec3d{}, Vec3d{}, Vec3d{}};
  REQUIRE(step->Min(centre, 0.9) == 9);
  REQUIRE(step->Min(centre, 1.1) == 1);
}

TEST_CASE("A grid of errors is searched exactly, and goes on beyond its border") {
  std::mt19937 random(5);
  for (int i = 0; i < 200; ++i) {
    GridField field;
    field.origin = Point(random) * 0.5;
    for (int k = 0; k < 3; ++k) {
      field.counts[static_cast<size_t>(k)] = 1 + random() % 9;
      field.cell_size[k] = Uniform(random, 0.02, 0.4);
    }
    const auto [nx, ny, nz] = field.counts;
    for (uint32_t k = 0; k < nx * ny * nz; ++k) field.errors.push_back(Uniform(random, -1, 1));
    const ThresholdPtr threshold = GridThreshold(field);
    for (int k = 0; k < 5; ++k) {
      const Triangle3d t = RandomTriangle(random);
      const double d = random() % 4 == 0 ? 0 : Uniform(random, 0, 0.3);
      double least = kInfinity;
      for (uint32_t cell = 0; cell < field.errors.size(); ++cell) {
        const uint32_t at[3] = {cell % nx, cell / nx % ny, cell / nx / ny};
        Box3d box;
        for (int a = 0; a < 3; ++a) {
          const double low = field.origin[a] + at[a] * field.cell_size[a];
          box.min[a] = at[a] == 0 ? -1e3 : low;
          const bool last = at[a] + 1 == field.counts[static_cast<size_t>(a)];
          box.max[a] = last ? 1e3 : low + field.cell_size[a];
        }
        if (BoxRegion(box)->Within(t, d)) least = std::min(least, field.errors[cell]);
      }
      REQUIRE(threshold->Min(t, d) == least);
      REQUIRE(threshold->Min(t, d + 0.1) <= least);
    }
  }
}

TEST_CASE("A caller's function is asked for a box around the triangle") {
  const ThresholdPtr threshold = FunctionThreshold([](const Box3d& box) { return box.min.x; });
  const Triangle3d t{Vec3d{1, 0, 0}, Vec3d{2, 0, 0}, Vec3d{2, 1, 0}};
  REQUIRE(threshold->Min(t, 0) == 1);
  REQUIRE(threshold->Min(t, 0.25) == 0.75);
  REQUIRE(!threshold->constant());
}

TEST_CASE("Constants know that they are constant") {
  REQUIRE(ConstantThreshold(0.5)->constant() == 0.5);
  REQUIRE(!ConstantThreshold(0)->full_resolution());
  REQUIRE(FullResolution()->full_resolution());
  REQUIRE(!CoarsestThreshold()->full_resolution());
  REQUIRE(!LinearThreshold({}, -1, 0)->constant().has_value());
  REQUIRE(MinThreshold({ConstantThreshold(2), FullResolution()})->full_resolution());
  REQUIRE(!MaxThreshold({ConstantThreshold(2), FullResolution()})->full_resolution());
  REQUIRE(MaxThreshold({ConstantThreshold(2), ConstantThreshold(3)})->constant() == 3);
  REQUIRE(!MinThreshold({LinearThreshold({}, 1, 1), ConstantThreshold(1)})->constant());
}

TEST_CASE("a threshold knows where Min lies in a box, and how it changes as the threshold moves") {
  std::mt19937 random(11);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const auto point = [&](double size) {
    return Vec3d{uniform(-size, size), uniform(-size, size), uniform(-size, size)};
  };
  // Makes two thresholds of a kind; `step` says how far they are apart.
  const auto pair = [&](int kind, double step) -> std::array<ThresholdPtr, 2> {
    const Vec3d at = point(3);
    const Vec3d to = at + point(step);
    const double base = uniform(0, 1);
    const double factor = uniform(-0.5, 0.5);
    const double next = random() % 2 == 0 ? factor : factor * uniform(1, 1 + step);
    Camera camera{.eye = at, .direction = point(1), .up = point(1)};
    camera.near = random() % 2 == 0 ? 0.1 : 0;
    Camera moved = camera;
    moved.eye = to;
    if (random() % 2 == 0) moved.direction = camera.direction + point(0.2 * step);
    const double pixels = uniform(1, 100);
    const double more = random() % 2 == 0 ? pixels : pixels * uniform(1, 1 + step);
    const auto screens = [&]() -> std::array<ThresholdPtr, 2> {
      return {ScreenThreshold(camera, pixels), ScreenThreshold(moved, more)};
    };
    switch (kind) {
      case 0: return {ConstantThreshold(base), ConstantThreshold(base + uniform(-step, step))};
      case 1: return {LinearThreshold(at, base, factor), LinearThreshold(to, base, next)};
      case 2: return {QuadraticThreshold(at, base, factor), QuadraticThreshold(to, base, next)};
      case 3: return {SquareRootThreshold(at, base, factor), SquareRootThreshold(to, base, next)};
      case 4:
        return {ExponentialThreshold(at, base, factor), ExponentialThreshold(to, base, factor)};
      case 5: return screens();
      case 6: {
        const double radius = uniform(0.1, 3);
        const RegionPtr ball = SphereRegion(at, radius);
        const RegionPtr other = random() % 3 == 0   ? ball
                                : random() % 2 == 0 ? SphereRegion(to, radius)
                                                    : SphereRegion(to, uniform(0.1, 3));
        return {RegionThreshold(ball, ConstantThreshold(base), LinearThreshold(at, 0, 1)),
                RegionThreshold(other, ConstantThreshold(base + step), LinearThreshold(to, 0, 1))};
      }
      case 7: {
        const auto [a, b] = screens();
        return {MaxThreshold({a, ConstantThreshold(0.01), LinearThreshold(at, 0, 0.1)}),
                MaxThreshold({b, ConstantThreshold(0.02), LinearThreshold(to, 0, 0.1)})};
      }
      default: {
        const auto [a, b] = screens();
        return {MinThreshold({a, LinearThreshold(at, 1, -0.1)}),
                MinThreshold({b, LinearThreshold(to, 1, -0.1)})};
      }
    }
  };
  constexpr int kKinds = 9;  // and likewise as terrains ask them
  for (int kind = 0; kind < 2 * kKinds; ++kind) {
    int told = 0;
    int held = 0;
    for (int i = 0; i < 3000; ++i) {
      const double step = std::pow(10, uniform(-4, 0));
      std::array<ThresholdPtr, 2> both = pair(kind % kKinds, step);
      if (kind >= kKinds) {
        const std::array<double, 2> aside{random() % 2 == 0 ? 0.0 : uniform(0, 1), uniform(0, 0.1)};
        for (ThresholdPtr& one : both) one = VerticalReach(one, aside);
      }
      const auto [from, to] = both;
      Box3d box;
      box.Add(point(3));
      box.Add(box.min + point(random() % 2 == 0 ? 0.2 : 2));
      const double distance = random() % 4 == 0 ? 0 : uniform(0, 0.3);
      const ErrorRange range = from->Range(box, distance);
      const FieldChange change = from->Change(*to, box, distance);
      const bool clear = from->Margin(box, distance) > 0 && to->Margin(box, distance) > 0;
      told += std::isfinite(change.low) && std::isfinite(change.high) ? 1 : 0;
      for (int j = 0; j < 20; ++j) {
        Triangle3d t;
        for (Vec3d& p : t) {
          for (int c = 0; c < 3; ++c) {
            const double x = uniform(0, 1);
            p[c] = j < 10 ? (x < 0.5 ? box.min[c] : box.max[c])
                          : box.min[c] + x * (box.max[c] - box.min[c]);
          }
        }
        const double d = j % 2 == 0 ? distance : uniform(0, distance);
        const double a = from->Min(t, d);
        const double b = to->Min(t, d);
        INFO("kind " << kind << " from " << a << " to " << b);
        REQUIRE((range.low <= a && a <= range.high));
        Box3d around;
        for (const Vec3d& p : t) around.Add(p);
        if (!clear && from->Margin(around, d) < change.shift) continue;  // a border may have passed
        ++held;
        const double difference = a == b ? 0 : b - a;
        REQUIRE((change.low <= difference && difference <= change.high));
        const double low = from->Range(around, d).low;
        const double next = to->Range(around, d).low;
        const double of_box = low == next ? 0 : next - low;
        REQUIRE((change.low <= of_box && of_box <= change.high));
      }
    }
    INFO("kind " << kind);
    CHECK(told > 300);
    CHECK(held > 20000);
  }
  // Not only true, but of use: who comes nearer by 0.1 sees what is ahead at up to as much more.
  const Box3d ahead{{5, -1, -1}, {6, 1, 1}};
  const ErrorRange nearer =
      LinearThreshold({0, 0, 0}, 0, 0.5)->Change(*LinearThreshold({0.1, 0, 0}, 0, 0.5), ahead, 0.1);
  CHECK(nearer.low > -0.0501);
  CHECK(nearer.high < -0.04);
  Camera camera{.eye = {0, 0, 0}, .direction = {1, 0, 0}};
  const ThresholdPtr before = ScreenThreshold(camera, 1);
  camera.eye.x = 0.1;
  const ErrorRange seen = before->Change(*ScreenThreshold(camera, 1), ahead, 0.1);
  CHECK(seen.low > -0.12 * camera.pixel());
  CHECK(seen.high < -0.07 * camera.pixel());
  const ThresholdPtr field = FunctionThreshold([](const Box3d& box) { return box.min.x; });
  CHECK(field->Change(*field, {}, 0).high == 0);
  CHECK(field->Change(*ConstantThreshold(1), {}, 0).high == kInfinity);
  // Infinite at the far end of the box, before and after, and much changed on the way there.
  const ThresholdPtr steep = ExponentialThreshold({0, 0, 0}, 1, 1000);
  const ThresholdPtr moved = ExponentialThreshold({0.01, 0, 0}, 1, 1000);
  const Vec3d half{0.5, 0, 0};
  const ErrorRange fall = steep->Change(*moved, {{0.1, -1, -1}, {2, 1, 1}}, 0);
  CHECK(fall.low <= moved->Min({half, half, half}, 0) - steep->Min({half, half, half}, 0));
}

}  // namespace mtdb::testing
