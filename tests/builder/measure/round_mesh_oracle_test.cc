// SPDX-License-Identifier: Apache-2.0
// RoundMesh's curves against dense sampling of the surface that they lie on.
#include <catch2/catch.hpp>
#include <random>

#include "builder/holes/tile_mesh.h"
#include "builder/measure/round_mesh.h"

namespace mtdb::testing {

using namespace internal;

namespace {

struct Surface3 {
  std::vector<Vec3d> positions;
  std::vector<std::array<uint32_t, 3>> triangles;
  std::vector<float> errors;
};

// Returns the half-edges' opposites.
std::vector<uint32_t> Build(RoundMesh& mesh, const Surface3& s) {
  std::vector<uint32_t> opposites;
  PairHalfEdges(s.triangles, static_cast<uint32_t>(s.positions.size()), opposites);
  mesh.Build(s.triangles, opposites, s.positions, s.errors);
  return opposites;
}

// A height field of n x n jittered cells, then turned so that "up" is `up`.
Surface3 RandomHeightField(int n, double height, Vec3d up, std::mt19937& random) {
  std::uniform_real_distribution<double> jitter(-0.3, 0.3);
  const Vec3d e = std::abs(up.x) < 0.7 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0};
  Vec3d u = Cross(e, up);
  u = u * (1 / Length(u));
  const Vec3d w = Cross(up, u);
  Surface3 s;
  for (int j = 0; j <= n; ++j) {
    for (int i = 0; i <= n; ++i) {
      s.positions.push_back(u * (i + jitter(random)) + w * (j + jitter(random)) +
                            up * (height * jitter(random)));
    }
  }
  const auto at = [n](int i, int j) { return static_cast<uint32_t>(j * (n + 1) + i); };
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      if (random() % 2 == 0) {
        s.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
        s.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
      } else {
        s.triangles.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
        s.triangles.push_back({at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)});
      }
    }
  }
  s.errors.assign(s.triangles.size(), 0);
  return s;
}

// Largest height over the segment ab, plus error, of points of the surface above or below it.
// Negative when a point of ab has no surface there.
double SampledCurveError(const Surface3& s, uint32_t a, uint32_t b, int samples) {
  const Vec3d up{0, 0, 1};
  const Vec3d pa = s.positions[a], pb = s.positions[b];
  double largest = 0;
  for (int i = 0; i <= samples; ++i) {
    const Vec3d p = pa + (pb - pa) * (static_cast<double>(i) / samples);
    bool found = false;
    for (size_t t = 0; t < s.triangles.size(); ++t) {
      const Vec3d q0 = s.positions[s.triangles[t][0]];
      const Vec3d q1 = s.positions[s.triangles[t][1]];
      const Vec3d q2 = s.positions[s.triangles[t][2]];
      const double w0 = Dot(Cross(q1 - p, q2 - p), up);
      const double w1 = Dot(Cross(q2 - p, q0 - p), up);
      const double w2 = Dot(Cross(q0 - p, q1 - p), up);
      const double least = std::min({w0, w1, w2});
      if (least < -1e-9 || w0 + w1 + w2 <= 0) continue;
      found = true;
      const Vec3d q = (q0 * w0 + q1 * w1 + q2 * w2) * (1 / (w0 + w1 + w2));
      // A triangle that is only touched does not bring its error along.
      const double error = least > 1e-6 ? static_cast<double>(s.errors[t]) : 0;
      largest = std::max(largest, std::abs(q.z - p.z) + error);
    }
    if (!found) return -1;
  }
  return largest;
}

}  // namespace

TEST_CASE("The curve error of an edge is the largest difference in height along its curve") {
  std::mt19937 random(1);
  constexpr int kCells = 9;
  int measured = 0;
  for (int field = 0; field < 12; ++field) {
    Surface3 s = RandomHeightField(kCells, field < 6 ? 1.0 : 6.0, {0, 0, 1}, random);
    const bool with_errors = field % 3 == 2;
    if (with_errors) {
      for (float& e : s.errors) e = static_cast<float>(random() % 100) * 0.01f;
    }
    RoundMesh mesh;
    Build(mesh, s);
    for (int i = 0; i < 60; ++i) {
      const auto a = static_cast<uint32_t>(random() % s.positions.size());
      const auto b = static_cast<uint32_t>(random() % s.positions.size());
      if (a == b) continue;
      const double bound = mesh.CurveError(a, b);
      const double sampled = SampledCurveError(s, a, b, 400);
      if (bound < 0) continue;  // the outline is not convex: no path, or one that leaves it
      REQUIRE(sampled >= 0);
      REQUIRE(bound >= sampled - 1e-7);
      // Where errors jump, a crossing takes the larger side; without them the bound is tight.
      if (!with_errors) REQUIRE(bound <= sampled * 1.05 + 0.05);
      ++measured;
    }
  }
  REQUIRE(measured > 500);
}

TEST_CASE("An edge of the input has no distance to itself, but its triangles' errors") {
  std::mt19937 random(2);
  Surface3 s = RandomHeightField(6, 1, {0, 0, 1}, random);
  for (size_t t = 0; t < s.errors.size(); ++t) s.errors[t] = static_cast<float>(t % 7);
  RoundMesh mesh;
  const std::vector<uint32_t> opposites = Build(mesh, s);
  for (uint32_t h = 0; h < 3 * s.triangles.size(); ++h) {
    const uint32_t a = s.triangles[h / 3][h % 3];
    const uint32_t b = s.triangles[h / 3][(h + 1) % 3];
    double expected = s.errors[h / 3];
    if (const uint32_t o = opposites[h]; o != kNone32) {
      expected = std::max(expected, static_cast<double>(s.errors[o / 3]));
    }
    REQUIRE(mesh.CurveError(a, b) == expected);
    REQUIRE(mesh.CurveError(b, a) == expected);
  }
}

TEST_CASE("There is no curve across a hole, out of the tile, or through a turned triangle") {
  std::mt19937 random(3);
  Surface3 s = RandomHeightField(8, 0.5, {0, 0, 1}, random);
  const auto at = [](uint32_t i, uint32_t j) { return j * 9 + i; };
  RoundMesh mesh;
  Build(mesh, s);
  REQUIRE(mesh.CurveError(at(0, 4), at(8, 4)) >= 0);
  Surface3 fold = s;
  fold.positions[at(4, 4)] += Vec3d{3, 0, 2};  // hangs over
  Build(mesh, fold);
  REQUIRE(mesh.CurveError(at(0, 4), at(8, 4)) < 0);
  Surface3 hole = s;
  std::erase_if(hole.triangles, [&](const std::array<uint32_t, 3>& t) {
    return t[0] == at(4, 4) || t[1] == at(4, 4) || t[2] == at(4, 4);
  });
  hole.errors.resize(hole.triangles.size());
  Build(mesh, hole);
  REQUIRE(mesh.CurveError(at(0, 4), at(8, 4)) < 0);
  Surface3 bay = s;
  for (uint32_t i = 0; i <= 8; ++i) bay.positions[at(i, 0)].y = i == 0 || i == 8 ? -0.3 : 0.3;
  Build(mesh, bay);
  REQUIRE(mesh.CurveError(at(0, 0), at(8, 0)) < 0);  // leaves at once
}

}  // namespace mtdb::testing
