// SPDX-License-Identifier: Apache-2.0
// Meshes that are height fields: which are, by every pair of triangles; and that no height of a cut
// is farther off than promised, by looking for the triangle above each place.
#include <catch2/catch.hpp>

#include "builder/mesh_survey.h"
#include "builder/surface/height_field.h"
#include "tests/builder/fixture.h"

namespace mtdb::testing {

namespace {

struct Pair {
  int64_t x, y;
};
int64_t Turn(Pair a, Pair b, Pair c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}
using Flat = std::array<Pair, 3>;

// No edge of one has all of the other on its outer side.
bool Overlap(const Flat& a, const Flat& b) {
  for (const auto& [t, u] : {std::pair{a, b}, std::pair{b, a}}) {
    for (size_t i = 0; i < 3; ++i) {
      bool apart = true;
      for (const Pair& p : u) apart = apart && Turn(t[i], t[(i + 1) % 3], p) <= 0;
      if (apart) return false;
    }
  }
  return true;
}

// By the sweep, of triangles without neighbours.
bool IsSingle(const std::vector<Flat>& triangles) {
  BorderSweep sweep(1 << 20);
  for (const Flat& f : triangles) {
    TileTriangle t{};
    for (size_t i = 0; i < 3; ++i) {
      t.positions[i] = {static_cast<int32_t>(f[i].x), static_cast<int32_t>(f[i].y), 0};
    }
    for (uint32_t i = 0; i < 3; ++i) t.set_order(i, 1);
    REQUIRE(sweep.Add(t).ok());
  }
  return sweep.Check(Grid{}).ok();
}

TEST_CASE("the sweep finds whether faces lie above each other, as all pairs tell") {
  std::mt19937 random(11);
  size_t single = 0, folded = 0;
  for (int run = 0; run < 20000; ++run) {
    const uint32_t side = run % 3 == 0 ? 5 : run % 3 == 1 ? 12 : 1 << 24;
    const auto point = [&] { return Pair{int64_t(random() % side), int64_t(random() % side)}; };
    std::vector<Flat> all;
    const size_t wanted = 1 + random() % 12;
    // Mostly such as touch in all ways and do not overlap, and sometimes any.
    for (size_t attempts = 0; all.size() < wanted && attempts < 60; ++attempts) {
      Flat f{point(), point(), point()};
      if (!all.empty() && random() % 2 == 0) {
        const Flat& other = all[random() % all.size()];
        f[0] = other[1];
        f[1] = other[0];
      }
      if (Turn(f[0], f[1], f[2]) <= 0) continue;
      const bool overlaps =
          std::any_of(all.begin(), all.end(), [&](const Flat& o) { return Overlap(f, o); });
      if (overlaps && random() % 60 != 0) continue;
      all.push_back(f);
    }
    bool expected = true;
    for (size_t i = 0; i < all.size(); ++i) {
      for (size_t j = 0; j < i; ++j) expected = expected && !Overlap(all[i], all[j]);
    }
    ++(expected ? single : folded);
    CAPTURE(run);
    REQUIRE(IsSingle(all) == expected);
  }
  CHECK(single > 5000);
  CHECK(folded > 1500);
}

// A mesh over a jittered lattice, with any diagonals, holes and a ragged outline.
TriangleMesh MakeScattered(uint32_t side, uint32_t seed, bool holes) {
  std::mt19937 random(seed);
  TriangleMesh mesh;
  mesh.header.double_positions = true;
  for (uint32_t r = 0; r < side; ++r) {
    for (uint32_t c = 0; c < side; ++c) {
      const double x = c + (random() % 50) / 100.0;
      const double y = r + (random() % 50) / 100.0;
      const double hills = 30 * std::sin(x / 9) * std::cos(y / 7);
      const double z = std::round(100 * hills + random() % 200) / 100;
      mesh.positions.push_back({500000 + x, 5e6 + y, z});
    }
  }
  for (uint32_t r = 0; r + 1 < side; ++r) {
    for (uint32_t c = 0; c + 1 < side; ++c) {
      const bool lake = std::hypot(r - 0.4 * side, c - 0.6 * side) < 0.12 * side;
      if (holes && (lake || 3 * r + c < side / 2)) continue;
      const uint64_t a = r * side + c, b = a + 1, d = a + side, e = d + 1;
      if (random() % 2 == 0) {
        mesh.triangles.push_back({a, b, d});
        mesh.triangles.push_back({b, e, d});
      } else {
        mesh.triangles.push_back({a, b, e});
        mesh.triangles.push_back({a, e, d});
      }
    }
  }
  return mesh;
}

// The height above a place; none outside.
std::optional<double> HeightOf(const TriangleMesh& mesh, double x, double y) {
  for (const TriangleVertices& t : mesh.triangles) {
    const Vec3d &a = mesh.positions[t[0]], &b = mesh.positions[t[1]], &c = mesh.positions[t[2]];
    const auto side = [&](const Vec3d& p, const Vec3d& q) {
      return (q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x);
    };
    const double wa = side(b, c), wb = side(c, a), wc = side(a, b);
    if (wa < 0 || wb < 0 || wc < 0) continue;
    return (wa * a.z + wb * b.z + wc * c.z) / (wa + wb + wc);
  }
  return std::nullopt;
}

BuildOptions HeightField() {
  BuildOptions options;
  options.height_field = true;
  options.tile_triangles = 500;
  options.threads = 2;
  return options;
}

TEST_CASE("no height of a cut of a mesh as terrain is farther off than promised") {
  for (const bool holes : {false, true}) {
    constexpr uint32_t kSide = 45;
    const TriangleMesh mesh = MakeScattered(kSide, 3, holes);
    const BuiltObject built = Build(mesh, HeightField());
    REQUIRE(built.record.error_measure == ErrorMeasure::kVertical);
    // Two decimals are kept.
    REQUIRE(built.record.rounding_error < 1e-6);
    REQUIRE(Extract(*built.surface, {}).triangles.size() == mesh.triangles.size());
    REQUIRE(built.record.rounds.size() > 1);
    double tightest = 0;
    for (const double threshold : {0.3, 1.0, 3.0, 10.0}) {
      Query query;
      query.threshold = ConstantThreshold(threshold);
      ExtractStats stats;
      const TriangleMesh cut = Extract(*built.surface, query, &stats);
      double worst = 0;
      int lost = 0;
      std::mt19937 random(17);
      for (int i = 0; i < 3000; ++i) {
        const double x = 500000 + (random() % (kSide * 100)) / 100.0 + 0.003;
        const double y = 5e6 + (random() % (kSide * 100)) / 100.0 + 0.001;
        const auto full = HeightOf(mesh, x, y);
        const auto coarse = HeightOf(cut, x, y);
        CAPTURE(x, y);
        // The border moves inwards only.
        if (coarse) REQUIRE(full.has_value());
        lost += full && !coarse;
        if (full && coarse) worst = std::max(worst, std::abs(*full - *coarse));
      }
      CAPTURE(holes, threshold, cut.triangles.size());
      REQUIRE(worst <= stats.error_bound + 1e-6);
      CHECK(lost < 300);
      tightest = std::max(tightest, worst / stats.error_bound);
    }
    CHECK(tightest > 0.5);  // by few places
  }
}

std::string Refusal(const TriangleMesh& mesh, BuildOptions options = HeightField()) {
  const TempStore store;
  const Result<ObjectRecord> record = BuildInto(store.database(), "x", mesh, options);
  REQUIRE(!record.ok());
  // A survey says the same before anything is built.
  const Result<MeshSurvey> survey =
      SurveyMesh([&](MeshSink& sink) { return SendMesh(mesh, sink); }, options);
  REQUIRE(!survey.ok());
  CHECK(survey.status().message() == record.status().message());
  return record.status().message();
}

TEST_CASE("a mesh that is no height field is refused with a place") {
  const TriangleMesh field = MakeScattered(20, 5, false);
  TriangleMesh upside_down = field;
  for (TriangleVertices& t : upside_down.triangles) std::swap(t[1], t[2]);
  const BuiltObject turned = Build(upside_down, HeightField());
  CHECK(
      SurveyMesh([&](MeshSink& sink) { return SendMesh(upside_down, sink); }, HeightField()).ok());
  CHECK(Triangles(Extract(*turned.surface, {})) ==
        Triangles(Extract(*Build(field, HeightField()).surface, {})));

  TriangleMesh folded = field;
  folded.positions[7 * 20 + 7].x += 3;
  CHECK_THAT(Refusal(folded), Catch::Contains("folded near 50000") && Catch::Contains("looks"));

  TriangleMesh wall = field;
  wall.positions[1] = wall.positions[0] + Vec3d{0, 0, 5};
  CHECK_THAT(Refusal(wall), Catch::Contains("upright near 50000"));

  // Another sheet above a part of it, with no triangle that looks down.
  TriangleMesh sheets = field;
  const uint64_t n = sheets.positions.size();
  for (const Vec3d& p : {Vec3d{500004.5, 5000004.5, 99}, Vec3d{500006.5, 5000004.5, 99},
                         Vec3d{500004.5, 5000006.5, 99}}) {
    sheets.positions.push_back(p);
  }
  sheets.triangles.push_back({n, n + 1, n + 2});
  CHECK_THAT(Refusal(sheets), Catch::Contains("two heights at places near 50000"));

  // A ramp that winds around twice.
  TriangleMesh ramp;
  for (uint64_t i = 0; i <= 60; ++i) {
    const double angle = 0.21 * static_cast<double>(i);
    for (const double radius : {5.0, 9.0}) {
      ramp.positions.push_back({radius * std::cos(angle), radius * std::sin(angle), angle});
    }
    if (i == 0) continue;
    ramp.triangles.push_back({2 * i - 2, 2 * i - 1, 2 * i});
    ramp.triangles.push_back({2 * i - 1, 2 * i + 1, 2 * i});
  }
  CHECK_THAT(Refusal(ramp), Catch::Contains("two heights"));
  ramp.triangles.resize(50);
  CHECK(Build(ramp, HeightField()).record.error_measure == ErrorMeasure::kVertical);

  BuildOptions coarse = HeightField();
  coarse.step = 0.7;
  CHECK_THAT(Refusal(field, coarse), Catch::Contains("--step"));
  BuildOptions lossless = HeightField();
  lossless.mode = PositionMode::kLossless;
  CHECK_THAT(Refusal(field, lossless), Catch::Contains("--lossless"));
}

}  // namespace

}  // namespace mtdb::testing
