// SPDX-License-Identifier: Apache-2.0
// Probes against brute force over the triangles of the whole mesh, and of the cut that the answer
// says it comes from.
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>

#include "query/ask/probe_geometry.h"
#include "query/probe.h"
#include "tests/builder/fixture.h"
#include "tests/query/late_source.h"
#include "tests/query/mt_fixture.h"

namespace mtdb::testing {

using namespace internal;

namespace {

constexpr double kNone = std::numeric_limits<double>::infinity();

struct Probed {
  std::string name;
  BuiltObject object;
  TriangleMesh full;
  bool closed;
  const Surface& surface() const { return *object.surface; }
  const ObjectRecord& record() const { return object.record; }
};

Probed MakeProbed(const std::string& name, const TriangleMesh& mesh, bool closed) {
  BuildOptions options;
  options.tile_triangles = 1000;
  Probed probed{name, Build(mesh, options), {}, closed};
  probed.full = Extract(probed.surface(), {});
  return probed;
}

// A tessellated cube: flat faces, so that probes along its axes lie in triangles.
TriangleMesh Cube(size_t side) {
  TriangleMesh mesh;
  for (int face = 0; face < 6; ++face) {
    for (size_t y = 0; y <= side; ++y) {
      for (size_t x = 0; x <= side; ++x) {
        const double u = static_cast<double>(x) / static_cast<double>(side);
        const double v = static_cast<double>(y) / static_cast<double>(side);
        const int axis = face % 3;
        Vec3d p;
        p[axis] = face < 3 ? 1 : 0;
        p[(axis + 1) % 3] = face < 3 ? u : v;
        p[(axis + 2) % 3] = face < 3 ? v : u;
        mesh.positions.push_back(p);
      }
    }
    const VertexIndex first = static_cast<size_t>(face) * (side + 1) * (side + 1);
    for (size_t y = 0; y < side; ++y) {
      for (size_t x = 0; x < side; ++x) {
        const VertexIndex a = first + y * (side + 1) + x;
        mesh.triangles.push_back({a, a + 1, a + side + 2});
        mesh.triangles.push_back({a, a + side + 2, a + side + 1});
      }
    }
  }
  return mesh;
}

const std::vector<Probed>& Objects() {
  static const std::vector<Probed> kObjects = [] {
    std::vector<Probed> objects;
    objects.push_back(MakeProbed("sculpture", MakeSculpture(16000), true));
    objects.push_back(MakeProbed("terrain", MakeTerrain(8000), false));
    objects.push_back(MakeProbed("cube", Cube(16), true));
    return objects;
  }();
  return kObjects;
}

Triangle3d Corners(const TriangleMesh& mesh, const TriangleVertices& t) {
  return {mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]};
}

double ClosestDistance(const TriangleMesh& mesh, Vec3d p) {
  double best2 = kNone;
  for (const TriangleVertices& v : mesh.triangles) {
    const Triangle3d t = Corners(mesh, v);
    best2 = std::min(best2, SquaredDistancePointTriangle(p, t[0], t[1], t[2]));
  }
  return std::sqrt(best2);
}

// First hits by Cramer's rule in long double. `sure` counts hits that are inside by a margin,
// `possible` also those that are outside by less than it.
struct FirstHits {
  double sure = kNone;
  double possible = kNone;
};

FirstHits BruteForceRay(const TriangleMesh& mesh, Vec3d origin, Vec3d direction) {
  using Wide = Vec3<long double>;
  const auto wide = [](Vec3d v) { return Wide{v.x, v.y, v.z}; };
  constexpr long double kMargin = 1e-9L;
  FirstHits hits;
  const Wide d = wide(direction);
  for (const TriangleVertices& v : mesh.triangles) {
    const Triangle3d t = Corners(mesh, v);
    const Wide e1 = wide(t[1]) - wide(t[0]);
    const Wide e2 = wide(t[2]) - wide(t[0]);
    const Wide s = wide(origin) - wide(t[0]);
    const Wide n = Cross(e1, e2);
    const long double determinant = -Dot(d, n);
    const long double scale = std::sqrt(SquaredLength(d) * SquaredLength(n));
    if (std::abs(determinant) < 1e-12L * scale || scale == 0) continue;
    const long double hit = Dot(s, n) / determinant;
    const long double u = Dot(Cross(s, d), e2) / determinant;
    const long double w = -Dot(Cross(s, d), e1) / determinant;
    const long double inside = std::min({u, w, 1.0L - u - w});
    if (hit < -kMargin || inside < -kMargin) continue;
    hits.possible = std::min(hits.possible, static_cast<double>(hit));
    if (hit > kMargin && inside > kMargin) hits.sure = std::min(hits.sure, double(hit));
  }
  return hits;
}

class Randomness {
 public:
  explicit Randomness(uint32_t seed) : random_(seed) {}
  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  Vec3d InBox(const Box3d& box, double by) {
    const Vec3d margin = (box.max - box.min) * by;
    Vec3d p;
    for (int i = 0; i < 3; ++i) p[i] = Uniform(box.min[i] - margin[i], box.max[i] + margin[i]);
    return p;
  }
  Vec3d Direction() {
    for (;;) {
      const Vec3d d{Uniform(-1, 1), Uniform(-1, 1), Uniform(-1, 1)};
      if (SquaredLength(d) > 0.01) return d;
    }
  }
  const TriangleVertices& Triangle(const TriangleMesh& mesh) {
    return mesh.triangles[random_() % mesh.triangles.size()];
  }
  uint32_t Below(uint32_t n) { return static_cast<uint32_t>(random_() % n); }

 private:
  std::mt19937 random_;
};

// Near the surface, around it, far away.
Vec3d ProbePoint(const Probed& probed, Randomness& random) {
  switch (random.Below(4)) {
    case 0: return random.InBox(probed.record().bounds, 20);
    case 1: return random.InBox(probed.record().bounds, 0.2);
    default: {
      const Triangle3d t = Corners(probed.full, random.Triangle(probed.full));
      const Vec3d centre = (t[0] + t[1] + t[2]) * (1.0 / 3);
      return centre + random.Direction() * (probed.record().diagonal() * random.Uniform(0, 0.02));
    }
  }
}

double RandomError(const Probed& probed, Randomness& random) {
  return probed.record().diagonal() * std::pow(10, random.Uniform(-4.5, -1));
}

TriangleMesh CutOf(const Surface& surface, RegionPtr region, double error) {
  Query query;
  query.region = std::move(region);
  query.threshold = ConstantThreshold(error);
  return Extract(surface, query);
}

}  // namespace

TEST_CASE("The closest point at full resolution is that of the whole mesh") {
  Randomness random(21);
  for (const Probed& probed : Objects()) {
    INFO(probed.name);
    const double tiny = 1e-12 * probed.record().diagonal();
    for (int i = 0; i < 300; ++i) {
      const Vec3d p = ProbePoint(probed, random);
      const ProbeAnswer answer = FindClosestPoint(probed.surface(), p).value();
      const double expected = ClosestDistance(probed.full, p);
      REQUIRE(answer.hit.has_value());
      const ProbeHit& hit = *answer.hit;
      REQUIRE(std::abs(hit.distance - expected) <= tiny + 1e-12 * expected);
      REQUIRE(Length(hit.point - p) == hit.distance);
      REQUIRE(answer.reach >= hit.distance);
      REQUIRE(SquaredDistancePointTriangle(hit.point, hit.triangle[0], hit.triangle[1],
                                           hit.triangle[2]) <= tiny * tiny * 100);
      REQUIRE(answer.error_bound == probed.record().rounding_error);
      REQUIRE(answer.excess == 0);
      // A limit just short of it, and one just beyond.
      const double limit = expected * (1 + 1e-6) + 10 * tiny;
      REQUIRE(FindClosestPoint(probed.surface(), p, {.limit = limit})->hit.has_value());
      if (expected < 100 * tiny) continue;
      REQUIRE_FALSE(FindClosestPoint(probed.surface(), p, {.limit = expected * (1 - 1e-6)})->hit);
    }
  }
}

TEST_CASE("The closest point at an accuracy is that of the cut, and keeps the bound") {
  Randomness random(22);
  uint64_t coarse = 0;
  for (const Probed& probed : Objects()) {
    INFO(probed.name);
    for (int i = 0; i < 200; ++i) {
      const Vec3d p = ProbePoint(probed, random);
      const double error = RandomError(probed, random);
      const ProbeAnswer answer =
          FindClosestPoint(probed.surface(), p, {.error_model = error}).value();
      REQUIRE(answer.hit.has_value());
      const double cut =
          ClosestDistance(CutOf(probed.surface(), SphereRegion(p, answer.reach), error), p);
      REQUIRE(std::abs(answer.hit->distance - cut) <= 1e-12 * (probed.record().diagonal() + cut));
      const double input = ClosestDistance(probed.full, p);
      REQUIRE(std::abs(answer.hit->distance - input) <= answer.error_bound + 1e-12 * input);
      REQUIRE(answer.error_bound <= std::max(error, probed.record().rounding_error));
      REQUIRE(answer.excess == std::max(0.0, answer.error_bound - error));
      coarse += answer.hit->distance != Approx(input).epsilon(1e-9);
    }
  }
  REQUIRE(coarse > 150);
}

TEST_CASE("The first hit of a ray at full resolution is that of the whole mesh") {
  Randomness random(23);
  uint64_t hits = 0;
  uint64_t misses = 0;
  for (const Probed& probed : Objects()) {
    INFO(probed.name);
    for (int i = 0; i < 200; ++i) {
      const Vec3d origin = random.InBox(probed.record().bounds, i % 2 == 0 ? 3 : 0);
      // Most of them towards the object.
      Vec3d direction = random.InBox(probed.record().bounds, 0.1) - origin;
      if (i % 5 == 0) direction = random.Direction() * std::pow(10, random.Uniform(-6, 6));
      const ProbeAnswer answer = CastRay(probed.surface(), origin, direction).value();
      const FirstHits expected = BruteForceRay(probed.full, origin, direction);
      const double found = answer.hit ? answer.hit->parameter : kNone;
      REQUIRE(found <= expected.sure * (1 + 1e-9));
      REQUIRE(found >= expected.possible * (1 - 1e-9) - 1e-9);
      hits += answer.hit ? 1 : 0;
      misses += answer.hit ? 0 : 1;
      if (!answer.hit) continue;
      REQUIRE(answer.reach >= found);
      REQUIRE(answer.hit->distance == Approx(Length(answer.hit->point - origin)).margin(1e-9));
      REQUIRE(Length(origin + direction * found - answer.hit->point) == 0);
      const Triangle3d& t = answer.hit->triangle;
      REQUIRE(answer.hit->front == (Dot(Cross(t[1] - t[0], t[2] - t[0]), direction) < 0));
      REQUIRE(CastRay(probed.surface(), origin, direction, {.limit = found * (1 + 1e-9)})->hit);
      REQUIRE_FALSE(CastRay(probed.surface(), origin, direction, {.limit = found * 0.999})->hit);
    }
  }
  REQUIRE(hits > 200);
  REQUIRE(misses > 100);
}

TEST_CASE("The first hit at an accuracy is that of the cut, and near the input") {
  Randomness random(24);
  uint64_t hits = 0;
  for (const Probed& probed : Objects()) {
    INFO(probed.name);
    for (int i = 0; i < 200; ++i) {
      const Vec3d origin = random.InBox(probed.record().bounds, 0);
      const Vec3d direction = random.Direction();
      const double error = RandomError(probed, random);
      const ProbeAnswer answer =
          CastRay(probed.surface(), origin, direction, {.error_model = error}).value();
      const RayCaster ray(origin, direction);
      const FirstHits expected = BruteForceRay(
          CutOf(probed.surface(), RayRegion(ray, 0, std::min(answer.reach, 1e3)), error), origin,
          direction);
      const double found = answer.hit ? answer.hit->parameter : kNone;
      REQUIRE(found >= expected.possible * (1 - 1e-9) - 1e-9);
      if (expected.sure <= answer.reach) REQUIRE(found <= expected.sure * (1 + 1e-9));
      if (!answer.hit) continue;
      ++hits;
      // The bound of a plane is 0; the hit lies in it but for the last digits.
      REQUIRE(ClosestDistance(probed.full, answer.hit->point) <=
              answer.error_bound * (1 + 1e-9) + 1e-12 * probed.record().diagonal());
    }
  }
  REQUIRE(hits > 200);
}

TEST_CASE("No ray from inside of a closed surface slips through a vertex or an edge") {
  Randomness random(25);
  for (const Probed& probed : Objects()) {
    if (!probed.closed) continue;
    INFO(probed.name);
    for (int i = 0; i < 300; ++i) {
      const Triangle3d from = Corners(probed.full, random.Triangle(probed.full));
      const Vec3d normal = Cross(from[1] - from[0], from[2] - from[0]);
      const Vec3d origin = (from[0] + from[1] + from[2]) * (1.0 / 3) -
                           normal * (1e-6 * probed.record().diagonal() / Length(normal));
      const Triangle3d to = Corners(probed.full, random.Triangle(probed.full));
      const Vec3d target = i % 2 == 0 ? to[0] : (to[0] + to[1]) * 0.5;
      if (target == from[0] || target == from[1] || target == from[2]) continue;
      const ProbeAnswer answer = CastRay(probed.surface(), origin, target - origin).value();
      REQUIRE(answer.hit.has_value());
    }
  }
}

TEST_CASE("Rays along axes, in the planes of faces and edges, hit a cube") {
  Randomness random(26);
  const Probed& cube = Objects()[2];
  for (int i = 0; i < 100; ++i) {
    Vec3d direction = random.Direction();
    if (i < 6) direction = {};  // along an axis, through vertices and in the planes of edges
    if (i < 6) direction[i % 3] = i < 3 ? 1 : -1;
    const ProbeAnswer answer = CastRay(cube.surface(), {0.5, 0.5, 0.5}, direction).value();
    REQUIRE(answer.hit.has_value());
    REQUIRE_FALSE(answer.hit->front);
    const Vec3d& p = answer.hit->point;
    const double wall = std::max({p.x, p.y, p.z, 1 - p.x, 1 - p.y, 1 - p.z});
    REQUIRE(wall == Approx(1).margin(1e-4));
  }
  // In the plane of a side: its triangles are not hit, the side across the ray is.
  const ProbeAnswer along = CastRay(cube.surface(), {-1, 0.5, 0}, {1, 0, 0}).value();
  REQUIRE(along.hit.has_value());
  REQUIRE(along.hit->parameter == Approx(1).margin(1e-4));
}

TEST_CASE("On a damaged object, whose errors lie, answers are still those of the cut") {
  Randomness random(27);
  for (uint32_t seed = 1; seed <= 8; ++seed) {
    MtOptions o;
    o.shape = static_cast<Shape>(seed % 4);
    o.resolution = 10;
    o.seed = seed;
    const MtFixture f = MakeMt(o);
    const auto surface = Surface::Open(AsTested(f.source)).value();
    for (int i = 0; i < 20; ++i) {
      const Vec3d p = random.InBox(surface->record().bounds, 1);
      const double error = surface->record().grid.Error(static_cast<uint8_t>(random.Below(100)));
      const ProbeAnswer closest = FindClosestPoint(*surface, p, {.error_model = error}).value();
      REQUIRE(closest.hit.has_value());
      const TriangleMesh cut = CutOf(*surface, SphereRegion(p, closest.reach), error);
      REQUIRE(closest.hit->distance == Approx(ClosestDistance(cut, p)).epsilon(1e-9));
      REQUIRE(CastRay(*surface, p, random.Direction(), {.error_model = error}).ok());
    }
  }
}

TEST_CASE("A probe reads the clusters near its answer only") {
  Randomness random(28);
  const Probed& probed = Objects()[0];
  uint64_t clusters = 0;
  constexpr int kProbes = 20;
  for (int i = 0; i < kProbes; ++i) {
    const Triangle3d t = Corners(probed.full, random.Triangle(probed.full));
    const auto cold = Surface::Open(probed.surface().source()).value();
    const ProbeAnswer answer = FindClosestPoint(*cold, t[0]).value();
    REQUIRE(answer.hit->distance == 0);
    REQUIRE(answer.bytes_read > 0);
    clusters += answer.clusters_read;
  }
  const uint64_t total = probed.surface().index().cluster_count();
  INFO(clusters << " of " << kProbes << " * " << total);
  REQUIRE(clusters * 2 < kProbes * total);
  // Nothing is read for a ray that misses the bounds.
  const Vec3d outside = probed.record().bounds.max + Vec3d{1, 1, 1};
  REQUIRE(CastRay(probed.surface(), outside, {1, 0, 0})->queries == 0);
}

TEST_CASE("Probes refuse what is no probe") {
  const Surface& surface = Objects()[2].surface();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [](const Result<ProbeAnswer>& answer, const char* part) {
    REQUIRE(answer.status().code() == StatusCode::kInvalidArgument);
    REQUIRE(answer.status().message().find(part) != std::string::npos);
  };
  refused(FindClosestPoint(surface, {nan, 0, 0}), "point");
  refused(FindClosestPoint(surface, {0, 1e200, 0}), "point");  // no distance to it is finite
  refused(CastRay(surface, {0, 0, -1e200}, {0, 0, 1}), "origin");
  refused(FindClosestPoint(surface, {0, 0, 0}, {.limit = -1}), "limit");
  refused(FindClosestPoint(surface, {0, 0, 0}, {.limit = nan}), "limit");
  refused(FindClosestPoint(surface, {0, 0, 0}, {.error_model = nan}), "error");
  refused(CastRay(surface, {0, kNone, 0}, {1, 0, 0}), "origin");
  refused(CastRay(surface, {0, 0, 0}, {1, nan, 0}), "direction");
  refused(CastRay(surface, {0, 0, 0}, {0, 0, 0}), "direction");
  refused(CastRay(surface, {0, 0, 0}, {1e-310, 0, 0}), "direction");
  refused(CastRay(surface, {0, 0, 0}, {1, 0, 0}, {.limit = nan}), "limit");
}

}  // namespace mtdb::testing
