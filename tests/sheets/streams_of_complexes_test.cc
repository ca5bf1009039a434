// SPDX-License-Identifier: Apache-2.0
// What a client of an update stream holds of a complex: the cut, or what of it meets a region,
// where sheets meet, have two sides, hang as flaps and float as crumbs.
#include <catch2/catch.hpp>
#include <random>

#include "codecs/stream/update_stream.h"
#include "query/session.h"
#include "tests/builder/fixture.h"
#include "tests/query/explicit_mesh.h"
#include "tests/sheets/mesh_of.h"
#include "tests/sheets/random_complex.h"
#include "tests/support/client_mesh_check.h"

namespace mtdb::sheets {
namespace {

using namespace mtdb::testing;
using sheets::Shape;

constexpr int kSteps = 10;

std::multiset<std::string> Expected(const ExplicitMesh& mesh, const Grid& grid,
                                    const MeetsRegion& region) {
  std::multiset<std::string> set;
  mesh.ForEach([&](TriangleKey, const std::array<Vec3i, 3>& t) {
    if (region && !region({grid.Position(t[0]), grid.Position(t[1]), grid.Position(t[2])})) return;
    set.insert(TriangleText(t, {}));
  });
  return set;
}

MeetsRegion RandomRegion(const Box3d& bounds, std::mt19937& random) {
  Box3d box;
  const auto somewhere = [&](int i) {
    const double part = static_cast<double>(random() % 1000) / 1000;
    return bounds.min[i] + part * (bounds.max[i] - bounds.min[i]);
  };
  for (int k = 0; k < 2; ++k) box.Add(Vec3d{somewhere(0), somewhere(1), somewhere(2)});
  return [box](const Triangle3d& t) {
    Box3d around;
    for (const Vec3d& p : t) around.Add(p);
    return around.min.x <= box.max.x && box.min.x <= around.max.x && around.min.y <= box.max.y &&
           box.min.y <= around.max.y && around.min.z <= box.max.z && box.min.z <= around.max.z;
  };
}

struct Tally {
  uint64_t crumbs_come = 0, crumbs_go = 0, recalled = 0, clipped = 0;
};

void Walk(const BuiltObject& built, uint32_t seed, Tally* tally) {
  const ObjectRecord& record = built.record;
  std::mt19937 random(seed);
  const auto session = *Session::Open(built.surface);
  ExplicitMesh mesh(*session->Base());
  const bool clips = seed % 2 == 1;
  const uint32_t remembered = seed % 3 == 0 ? 0 : 1000;
  MeetsRegion region;
  if (clips) region = RandomRegion(record.bounds, random);
  UpdateEncoder encoder({record.grid, record.attributes, remembered}, *session->Base(), region);
  UpdateDecoder decoder;
  REQUIRE(decoder.Feed(encoder.start()).ok());
  for (int step = 0; step < kSteps; ++step) {
    CAPTURE(step);
    Query query;
    const auto fineness = static_cast<double>(random() % 12);
    query.threshold = ConstantThreshold(record.diagonal() * std::exp2(-fineness));
    if (random() % 4 == 0) query.threshold = CoarsestThreshold();
    if (random() % 4 == 0) query.threshold = nullptr;
    if (clips && random() % 2 == 0) region = RandomRegion(record.bounds, random);
    std::vector<UpdateBatch> batches;
    REQUIRE(session->Update(query, &batches).ok());
    for (const UpdateBatch& batch : batches) {
      mesh.Apply(batch);
      (batch.insert ? tally->crumbs_come : tally->crumbs_go) += batch.crumbs.size();
    }
    const Status status = decoder.Feed(encoder.Encode(batches, region));
    INFO(status.message());
    REQUIRE(status.ok());
    REQUIRE(ClientTriangles(decoder.mesh()) == Expected(mesh, record.grid, region));
    REQUIRE(ClientTriangles(encoder.mesh()) == ClientTriangles(decoder.mesh()));
    REQUIRE(DrawnFault(decoder.mesh()).empty());
    REQUIRE(ClientMeshFault(decoder.mesh()).empty());
    tally->clipped += clips;
  }
  tally->recalled += encoder.recalled_vertices();
}

}  // namespace

TEST_CASE("A client of a stream holds the cut of a complex, or what of it meets its region") {
  Tally tally;
  for (uint32_t shape = 0; shape < kShapes; ++shape) {
    for (uint32_t seed = 0; seed < 6; ++seed) {
      INFO(NameOf(static_cast<Shape>(shape)) << ", seed " << seed);
      BuildOptions options;
      options.step = kLatticeStep;
      options.tile_triangles = seed % 2 == 0 ? 64 : 512;
      const RandomComplex made = MakeRandomComplex(static_cast<Shape>(shape), seed);
      Walk(Build(MeshOf(made.complex), options), seed, &tally);
    }
  }
  CHECK(tally.crumbs_come > 100);
  CHECK(tally.crumbs_go > 100);
  CHECK(tally.recalled > 0);
  CHECK(tally.clipped > 0);
}

}  // namespace mtdb::sheets
