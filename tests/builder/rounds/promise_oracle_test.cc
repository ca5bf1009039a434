// SPDX-License-Identifier: Apache-2.0
// What a query promises against the input as it came, before it was rounded: measured naively.
#include <catch2/catch.hpp>
#include <functional>
#include <limits>

#include "bench/internal/hausdorff.h"
#include "query/session.h"
#include "tests/builder/fixture.h"
#include "tests/builder/nasty_meshes.h"
#include "tests/support/mesh_distance.h"

namespace mtdb::testing {
namespace {

struct Place {
  const char* name;
  Vec3d at;
  double size;
};
constexpr Place kPlaces[] = {
    {"at the origin", {0, 0, 0}, 1},      {"tiny", {0, 0, 0}, 1e-12},
    {"huge", {-3e11, 2e11, 0}, 4e11},     {"UTM", {418322.37, 4181100.61, 213.2}, 830},
    {"negative", {-17, -5000, -0.25}, 3}, {"far away", {1e9, -1e9, 1e9}, 1}};

// Doubles: neither on a grid nor float32.
TriangleMesh InputAt(const Place& place, int shape, uint32_t seed) {
  TriangleMesh mesh = shape == 0   ? MakeSculpture(2400, seed)
                      : shape == 1 ? MakeTerrain(2400, seed)
                                   : MakeSheet(34, 0.1, seed);
  Box3d box;
  for (const Vec3d& p : mesh.positions) box.Add(p);
  const double scale = place.size / Diagonal(box);
  for (Vec3d& p : mesh.positions) p = place.at + (p - box.min) * scale;
  mesh.header.double_positions = true;
  return mesh;
}

double FieldAt(const Threshold& threshold, Vec3d p) { return threshold.Min({p, p, p}, 0); }

}  // namespace

TEST_CASE("What comes back is within the bound of the unrounded input, and the bound is kept") {
  std::mt19937 random(5);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  uint64_t met = 0, unmet = 0, near = 0;
  for (const Place& place : kPlaces) {
    for (int object = 0; object < 4; ++object) {
      const TriangleMesh input = InputAt(place, object % 3, static_cast<uint32_t>(object + 1));
      BuildOptions options;
      options.tile_triangles = 512;
      options.bits = std::array{5, 8, 12, 16}[static_cast<size_t>(object)];
      const BuiltObject built = Build(input, options);
      const ObjectRecord& record = built.record;
      const double h = record.rounding_error;
      INFO(place.name << ", " << *options.bits << " bits");
      REQUIRE(h > 0);
      const auto session = Session::Open(built.surface).value();
      // Of the measuring itself, in double.
      const double slack = 1e-15 * (Length(record.bounds.min) + Length(record.bounds.max));
      for (int i = 0; i < 12; ++i) {
        const Vec3d point = input.positions[random() % input.positions.size()];
        const double base = h * std::exp2(uniform(-3, 8));
        const double slope = base / place.size * uniform(0, 8);
        Query query;
        switch (i % 4) {
          case 0: query.threshold = ConstantThreshold(base); break;
          case 1: query.threshold = LinearThreshold(point, base, slope); break;
          case 2:
            query.threshold =
                RegionThreshold(SphereRegion(point, place.size * uniform(0.05, 0.4)),
                                ConstantThreshold(base), ConstantThreshold(base * 16));
            break;
          default: {
            GridField field;
            field.origin = record.bounds.min;
            field.cell_size = Vec3d{1, 1, 1} * (place.size / 3);
            field.counts = {3, 3, 3};
            for (int c = 0; c < 27; ++c) field.errors.push_back(base * uniform(0.2, 20));
            query.threshold = GridThreshold(std::move(field));
          }
        }
        if (i % 3 != 0) query.region = SphereRegion(point, place.size * uniform(0, 0.4));
        if (i == 11) query.max_triangles = 500;
        ExtractStats stats;
        const TriangleMesh mesh = Extract(*built.surface, query, &stats);
        std::vector<UpdateBatch> batches;
        const SessionUpdate update = session->Update(query, &batches).value();
        CAPTURE(i, h, base, stats.error_bound, stats.triangles, stats.shortfall.excess);
        // Said or kept.
        double largest = -1;
        for (const Vec3d& p : input.positions) {
          largest = std::max(largest, FieldAt(*query.threshold, p));
        }
        if (!stats.shortfall.any()) CHECK(stats.error_bound <= largest + slack);
        if (i % 4 == 0) CHECK((stats.error_bound <= base) == !stats.shortfall.any());
        CHECK(update.stats.shortfall.any() == stats.shortfall.any());
        if (stats.limit == QueryLimit::kThreshold) {
          CHECK(update.stats.shortfall.excess == stats.shortfall.excess);
          CHECK(update.stats.error_bound <= stats.error_bound);
        }
        (stats.shortfall.any() ? unmet : met) += 1;
        // Of the whole surface, both ways.
        if (query.region == nullptr) {
          CHECK(SymmetricHausdorff(input, mesh, 3000) <= stats.error_bound + slack);
        }
        // Place by place.
        for (int k = 0; k < 100; ++k) {
          const Vec3d p = input.positions[random() % input.positions.size()];
          if (query.region != nullptr && !query.region->Within({p, p, p}, 0)) continue;
          const double distance = DistanceTo(mesh, p);
          CHECK(distance <= stats.error_bound + slack);
          const double asked = FieldAt(*query.threshold, p);
          CHECK(distance <= std::max(asked, 0.0) + stats.shortfall.excess + slack);
          near += distance > 0.5 * asked ? 1 : 0;
        }
      }
    }
  }
  CHECK(met > 100);
  CHECK(unmet > 50);
  CHECK(near > 100);
}

TEST_CASE("Input that lies on the grid is not rounded, whatever the other options") {
  TriangleMesh mesh = MakeSculpture(3000);
  mesh.header.double_positions = true;
  for (Vec3d& p : mesh.positions) {
    for (int i = 0; i < 3; ++i) p[i] = std::round(p[i] * 512) / 512;
  }
  mesh.positions.push_back({1e-3, 1e-3, 1e-3});  // no triangle uses it
  BuildOptions options;
  options.step = 1.0 / 512;
  CHECK(Build(mesh, options).record.rounding_error == 0);
  options.step = 1.0 / 64;
  const ObjectRecord coarse = Build(mesh, options).record;
  CHECK(coarse.rounding_error > 0);
  CHECK(coarse.rounding_error <= coarse.grid.cell_error());
  options.step.reset();
  options.mode = PositionMode::kLossless;
  RoundToFloat32(&mesh);
  CHECK(Build(mesh, options).record.rounding_error == 0);
  Query query;
  query.threshold = ConstantThreshold(0);
  ExtractStats stats;
  Extract(*Build(mesh, options).surface, query, &stats);
  CHECK(stats.error_bound == 0);
  CHECK_FALSE(stats.shortfall.any());
}

}  // namespace mtdb::testing
