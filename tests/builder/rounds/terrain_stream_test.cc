// SPDX-License-Identifier: Apache-2.0
// Clients that follow sessions over terrains: by the Delaunay rule, of which only vertices travel,
// and with coded holes.
#include <catch2/catch.hpp>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "codecs/stream/update_stream.h"
#include "query/session.h"
#include "tests/builder/terrain_fixture.h"
#include "tests/support/client_mesh_check.h"
#include "tests/support/mesh_check.h"

namespace mtdb::testing {
namespace {

// Those that meet the region.
std::multiset<std::string> CutTriangles(const Surface& surface, const Query& query,
                                        const MeetsRegion& region) {
  const TriangleMesh mesh = Extract(surface, query);
  std::multiset<std::string> set;
  for (const TriangleVertices& t : mesh.triangles) {
    std::array<Vec3i, 3> positions;
    Triangle3d corners;
    for (size_t c = 0; c < 3; ++c) {
      positions[c] = surface.record().grid.Quantize(mesh.positions[t[c]]);
      corners[c] = surface.record().grid.Position(positions[c]);
    }
    if (!region || region(corners)) set.insert(TriangleText(positions, {}));
  }
  return set;
}

struct Options {
  uint32_t remembered = 0;
  bool delaunay = true;
  bool clipped = false;  // now and then
  bool in_rounds = false;
  int steps = 40;
};

MeetsRegion SomeRegion(const Box3d& bounds, std::mt19937& random) {
  std::uniform_real_distribution<double> part(0, 1);
  const Vec3d size = bounds.max - bounds.min;
  Box3d box;
  const double x = part(random);
  const Vec3d centre = bounds.min + Vec3d{x * size.x, part(random) * size.y, 0.5 * size.z};
  box.Add(centre - Vec3d{0.2 * size.x, 0.2 * size.y, size.z});
  box.Add(centre + Vec3d{0.2 * size.x, 0.2 * size.y, size.z});
  return [region = BoxRegion(box)](const Triangle3d& t) { return region->Within(t, 0); };
}

// Returns the bytes of all updates.
uint64_t Walk(const Terrain& terrain, const Options& options) {
  const Surface& surface = *terrain.built.surface;
  const ObjectRecord& record = surface.record();
  const auto session = *Session::Open(terrain.built.surface);
  UpdateEncoder encoder({record.grid, record.attributes, options.remembered, options.delaunay},
                        *session->Base());
  UpdateDecoder decoder;
  REQUIRE(decoder.Feed(encoder.start()).ok());
  std::mt19937 random(7);
  uint64_t bytes = 0;
  for (int step = 0; step < options.steps; ++step) {
    Query query = RandomCutQuery(record, random);
    if (random() % 3 == 0) query.max_triangles = random() % record.triangles;
    if (step % 10 == 0) query = {};
    if (step % 10 == 5) query.threshold = CoarsestThreshold();
    MeetsRegion region;
    if (options.clipped && random() % 3 != 0) region = SomeRegion(record.bounds, random);
    const auto send = [&](std::span<const UpdateBatch> batches) {
      const Bytes sent = encoder.Encode(batches, region);
      bytes += sent.size();
      const Status status = decoder.Feed(sent);
      INFO(status.message());
      REQUIRE(status.ok());
      REQUIRE(ClientMeshFault(decoder.mesh()).empty());
      return status;
    };
    if (options.in_rounds) {
      REQUIRE(session->Update(query, send).ok());
      REQUIRE(send({}).ok());
    } else {
      std::vector<UpdateBatch> batches;
      REQUIRE(session->Update(query, &batches).ok());
      REQUIRE(send(batches).ok());
    }
    INFO("step " << step);
    REQUIRE(ClientTriangles(decoder.mesh()) == CutTriangles(surface, query, region));
  }
  CHECK(encoder.listed_updates() == 0);
  return bytes;
}

Terrain MakeOne(bool holes, bool border_moves = false) {
  constexpr uint32_t kColumns = 73, kRows = 61;
  std::vector<double> heights = MakeHeights(kColumns, kRows, 7);
  if (holes) heights = WithHoles(std::move(heights), kColumns, kRows);
  return BuildTerrain(kColumns, kRows, heights, Triangulation::kDelaunay, border_moves);
}

}  // namespace

TEST_CASE("a client that computes a terrain's triangles holds the mesh of each cut") {
  for (const bool holes : {false, true}) {
    const Terrain terrain = MakeOne(holes);
    for (const uint32_t remembered : {0u, 100u, 1u << 20}) {
      INFO("holes " << holes << ", remembered " << remembered);
      const uint64_t ruled = Walk(terrain, {.remembered = remembered});
      const uint64_t coded = Walk(terrain, {.remembered = remembered, .delaunay = false});
      CHECK(ruled < coded * 7 / 10);
      Walk(terrain, {.remembered = remembered, .in_rounds = true});
    }
  }
}

TEST_CASE("a client of a terrain is clipped now and then") {
  for (const bool holes : {false, true}) {
    const Terrain terrain = MakeOne(holes);
    Walk(terrain, {.remembered = 50, .clipped = true});
    Walk(terrain, {.remembered = 0, .clipped = true, .in_rounds = true});
  }
}

TEST_CASE("a client of a terrain whose border moves") {
  const Terrain terrain = MakeOne(true, true);
  Walk(terrain, {.remembered = 1000});
  Walk(terrain, {.remembered = 0, .clipped = true, .in_rounds = true});
}

// From the root to full resolution, in one step: with no connectivity, and with coded holes.
TEST_CASE("bits on the wire of a terrain") {
  const Terrain terrain = MakeOne(false);
  const auto session = *Session::Open(terrain.built.surface);
  const ObjectRecord& record = terrain.built.record;
  std::vector<UpdateBatch> batches;
  const BaseMesh base = *session->Base();
  REQUIRE(session->Update({}, &batches).ok());
  uint64_t bytes[2];
  for (const bool delaunay : {false, true}) {
    UpdateEncoder encoder({record.grid, record.attributes, 0, delaunay}, base);
    bytes[delaunay] = encoder.Encode(batches).size();
  }
  INFO(8.0 * bytes[0] / record.vertices << " : " << 8.0 * bytes[1] / record.vertices);
  CHECK(bytes[1] * 2 < bytes[0]);
}

}  // namespace mtdb::testing
