// SPDX-License-Identifier: Apache-2.0
// The error of a cut is a promise about the distance between surfaces, and not a loose one.
#include <catch2/catch.hpp>

#include "bench/internal/hausdorff.h"
#include "tests/builder/fixture.h"
#include "tests/builder/nasty_meshes.h"

namespace mtdb::testing {
namespace {

// Measures uniform cuts at `count` thresholds, from below two grid steps upwards by factors.
void RequireBounds(const TriangleMesh& mesh, const BuiltObject& built, int count,
                   uint64_t samples) {
  const double step = built.record.grid.step;
  double threshold = 1.5 * step;
  const double largest = built.record.grid.Error(built.record.error_code_max);
  const double factor = std::pow(0.5 * largest / threshold, 1.0 / (count - 1));
  for (int i = 0; i < count; ++i, threshold *= factor) {
    Query query;
    query.threshold = ConstantThreshold(threshold);
    ExtractStats stats;
    const TriangleMesh cut = Extract(*built.surface, query, &stats);
    const double measured = SymmetricHausdorff(mesh, cut, samples);
    CAPTURE(threshold / step, stats.triangles, stats.error_bound / step, measured / step);
    CHECK((stats.error_bound <= threshold) == !stats.shortfall.any());
    CHECK((stats.error_bound <= std::max(threshold, built.record.rounding_error)));
    CHECK(measured <= stats.error_bound);
    if (threshold > 8 * step) CHECK(measured >= 0.5 * stats.error_bound);
  }
}

}  // namespace

TEST_CASE("Measured distances stay below the bound and above half of it: a sculpture") {
  const TriangleMesh mesh = MakeSculpture(50000);
  RequireBounds(mesh, Build(mesh), 8, 30000);
}

TEST_CASE("Measured distances stay below the bound and above half of it: a terrain") {
  const TriangleMesh mesh = MakeTerrain(50000);
  RequireBounds(mesh, Build(mesh), 8, 30000);
}

TEST_CASE("Measured distances stay below the bound and above half of it: a scan") {
  if (const std::optional<TriangleMesh> mesh = LoadSharedMesh("bunny.ply")) {
    RequireBounds(*mesh, Build(*mesh), 8, 30000);
  }
}

TEST_CASE("The bound holds for folded, rough and coarsely quantised surfaces") {
  const auto check = [](const TriangleMesh& mesh, const BuildOptions& options) {
    const BuiltObject built = Build(mesh, options);
    for (const double share : {0.001, 0.01, 0.05, 0.2, 1.0}) {
      Query query;
      query.threshold = ConstantThreshold(share * built.record.diagonal() / 16);
      ExtractStats stats;
      const TriangleMesh cut = Extract(*built.surface, query, &stats);
      CAPTURE(share, stats.triangles);
      CHECK(SymmetricHausdorff(mesh, cut, 10000) <= stats.error_bound);
    }
  };
  BuildOptions options;
  options.tile_triangles = 512;
  check(MakeSheet(40, 0.3), options);  // slopes far beyond 60 degrees: projections fold
  check(MakeSheet(40, 2), options);
  std::mt19937 random(8);
  TriangleMesh crumpled = MakeSheet(40, 0);
  std::uniform_real_distribution<double> shift(-0.04, 0.04);
  for (Vec3d& p : crumpled.positions) p += Vec3d{shift(random), shift(random), shift(random)};
  check(crumpled, options);
  options.bits = 5;
  check(MakeSculpture(6000), options);
}

// Squares of such lengths are 0 in binary32.
TEST_CASE("The bound holds where a model unit is far larger than the model") {
  TriangleMesh mesh = MakeSheet(40, 0.3);
  for (Vec3d& p : mesh.positions) {
    for (int i = 0; i < 3; ++i) p[i] = static_cast<float>(p[i] * 1e-21);
  }
  BuildOptions options;
  options.mode = PositionMode::kLossless;
  const BuiltObject built = Build(mesh, options);
  for (const double share : {0.1, 0.25, 0.5, 1.0}) {
    Query query;
    query.threshold = ConstantThreshold(share * built.record.diagonal() / 16);
    ExtractStats stats;
    const TriangleMesh cut = Extract(*built.surface, query, &stats);
    CAPTURE(share, stats.triangles);
    CHECK(SymmetricHausdorff(mesh, cut, 10000) * 1e21 <= stats.error_bound * 1e21);
  }
}

TEST_CASE("Surfaces without curvature cost no error") {
  BuildOptions options;
  options.step = 1.0 / 128;  // so that the grid keeps the border straight
  const BuiltObject built = Build(MakeSheet(64, 0), options);
  Query query;
  query.threshold = ConstantThreshold(built.record.grid.error_unit);
  ExtractStats stats;
  Extract(*built.surface, query, &stats);
  REQUIRE(stats.triangles < 100);
}

TEST_CASE("A mesh that is tiny or huge is built like others, when it keeps its bits") {
  TriangleMesh mesh = MakeSculpture(8000);
  for (Vec3d& p : mesh.positions) {
    for (int i = 0; i < 3; ++i) p[i] = static_cast<float>(p[i]);
  }
  BuildOptions options;
  options.mode = PositionMode::kLossless;
  options.tile_triangles = 16384;  // one tile: several are cut by the positions' bits
  const BuiltObject usual = Build(mesh, options);
  // Squares of these are no numbers of binary32.
  for (const double scale : {0x1p-70, 0x1p70}) {
    TriangleMesh scaled = mesh;
    for (Vec3d& p : scaled.positions) p = p * scale;
    const BuiltObject built = Build(scaled, options);
    CAPTURE(scale);
    CHECK(built.record.nodes == usual.record.nodes);
    for (const double share : {0.5, 0.1, 0.01}) {
      Query query;
      query.threshold = ConstantThreshold(share * usual.record.diagonal() / 16);
      ExtractStats expected;
      Extract(*usual.surface, query, &expected);
      query.threshold = ConstantThreshold(share * built.record.diagonal() / 16);
      ExtractStats stats;
      const TriangleMesh cut = Extract(*built.surface, query, &stats);
      CHECK(stats.triangles == expected.triangles);
      CHECK(SymmetricHausdorff(scaled, cut, 10000) <= stats.error_bound);
    }
  }
}

namespace {

// n x n squares; heights by place.
TriangleMesh Squares(int n, const std::function<double(int, int)>& height) {
  TriangleMesh mesh;
  mesh.header.double_positions = true;
  const auto across = static_cast<VertexIndex>(n + 1);
  for (int y = 0; y <= n; ++y) {
    for (int x = 0; x <= n; ++x) mesh.positions.push_back({1.0 * x, 1.0 * y, height(x, y)});
  }
  for (VertexIndex y = 0; y + 1 < across; ++y) {
    for (VertexIndex x = 0; x + 1 < across; ++x) {
      const VertexIndex v = y * across + x;
      mesh.triangles.push_back({v, v + 1, v + across + 1});
      mesh.triangles.push_back({v, v + across + 1, v + across});
    }
  }
  return mesh;
}

uint64_t TrianglesAt(const Surface& surface, double error) {
  Query query;
  query.threshold = ConstantThreshold(error);
  ExtractStats stats;
  Extract(surface, query, &stats);
  CHECK(stats.error_bound <= error);
  return stats.triangles;
}

}  // namespace

TEST_CASE("What lies in one plane of whole coordinates is removed without an error") {
  const auto flat = [](int, int) { return 7.0; };
  const auto slope = [](int x, int y) { return 2.0 * x - 3.0 * y; };
  for (const int n : {59, 200}) {
    for (const std::function<double(int, int)>& height :
         {std::function<double(int, int)>(flat), std::function<double(int, int)>(slope)}) {
      for (const Vec3d origin : {Vec3d{}, Vec3d{431234, 4812345, 300}}) {
        TriangleMesh mesh = Squares(n, height);
        for (Vec3d& p : mesh.positions) p += origin;
        const BuiltObject built = Build(mesh);
        CAPTURE(n, height(1, 1), origin.x);
        CHECK(built.record.grid.step == 1);
        CHECK(built.record.rounding_error == 0);
        for (const double error : {0.05, 1e-3, 1e-9})
          CHECK(TrianglesAt(*built.surface, error) <= 4);
      }
    }
  }
  // Roofs of 20 x 20, and walls between them: two triangles each, and what their borders need.
  const auto roofs = [](int x, int y) { return 10.0 * ((x / 20 * 7 + y / 20 * 3) % 4); };
  const BuiltObject town = Build(Squares(99, roofs));
  CHECK(TrianglesAt(*town.surface, 1e-3) < 1200);
}

TEST_CASE("On a coarse grid of whole numbers errors are finer than a sixteenth of a step") {
  const BuiltObject built = Build(Squares(60, [](int x, int) { return x == 30 ? 1.0 : 0.0; }));
  CHECK(built.record.bits < 16);
  CHECK(built.record.grid.error_unit < built.record.grid.step / 16);
  CHECK(built.record.grid.Error(1) == built.record.grid.step / 256);
  CHECK(built.record.grid.Error(254) > built.record.diagonal());
}

}  // namespace mtdb::testing
