// SPDX-License-Identifier: Apache-2.0
// Textured meshes are built and cut: full resolution is the input corner by corner, and coarse cuts
// are as near in space and image as they promise.
#include <catch2/catch.hpp>
#include <cstdlib>

#include "tests/builder/fixture.h"
#include "tests/textures/charted_mesh.h"
#include "tests/textures/corner_list.h"
#include "tests/textures/texture_distance.h"

namespace mtdb::testing {
namespace {

BuildOptions Options(uint32_t tile_triangles) {
  BuildOptions options;
  options.mode = PositionMode::kLossless;
  options.tile_triangles = tile_triangles;
  options.texture_step = std::exp2(-13);
  return options;
}

}  // namespace

TEST_CASE("Full resolution has each corner of the input") {
  for (uint32_t charting = 0; charting < kChartings; ++charting) {
    for (const uint32_t tile : {64u, 512u, 8192u}) {
      CAPTURE(NameOf(static_cast<Charting>(charting)), tile);
      const TriangleMesh mesh =
          MakeCharted(static_cast<Charting>(charting), 48, 24, 0.5, charting + 1);
      const BuiltObject built = Build(mesh, Options(tile));
      REQUIRE(built.record.texture);
      CHECK(built.record.texture->pages.size() == 2);
      const TriangleMesh back = Extract(*built.surface, {});
      CHECK(back.header.textured);
      CHECK(CornersOf(back, 0) == CornersOf(mesh, built.record.texture->step));
    }
  }
}

TEST_CASE("Cuts are as near in space and image as they promise") {
  for (uint32_t charting = 0; charting < kChartings; ++charting) {
    for (const double stretch : {0.0, 1.0}) {
      const TriangleMesh mesh =
          MakeCharted(static_cast<Charting>(charting), 96, 48, stretch, charting + 1);
      const BuiltObject built = Build(mesh, Options(stretch > 0 ? 512 : 8192));
      const double scale = built.record.texture->scale;
      const double size = built.record.diagonal();
      std::mt19937 random(charting);
      for (int cut = 1; cut < 7; ++cut) {
        Query query;
        query.threshold =
            cut == 1 ? CoarsestThreshold() : ConstantThreshold(size * std::exp2(-cut - 2));
        ExtractStats stats;
        const TriangleMesh coarse = Extract(*built.surface, query, &stats);
        CAPTURE(NameOf(static_cast<Charting>(charting)), stretch, cut, stats.triangles,
                stats.error_bound);
        REQUIRE(coarse.corners.size() == 3 * coarse.triangles.size());
        const double far = stats.error_bound * 2 + 1e-6;
        const double there = LargestTextureDistance(mesh, coarse, scale, far, 600, random);
        const double back = LargestTextureDistance(coarse, mesh, scale, far, 600, random);
        CHECK(std::max(there, back) <= stats.error_bound * (1 + 1e-6) + 1e-9 * size);
        if (std::getenv("MTDB_PRINT_TEXTURES") != nullptr) {
          WARN(NameOf(static_cast<Charting>(charting))
               << ", stretch " << stretch << ": " << stats.triangles << " of "
               << mesh.triangles.size() << " triangles, promised " << stats.error_bound / size
               << ", measured / promised " << std::max(there, back) / stats.error_bound);
        }
      }
    }
  }
}

}  // namespace mtdb::testing
