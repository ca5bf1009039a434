// Queries beside a build in the same store: clusters are read while pages change.
#include <atomic>
#include <catch2/catch.hpp>
#include <thread>

#include "tests/builder/fixture.h"
#include "tests/support/mesh_check.h"

namespace mtdb::testing {
namespace {

bool SameMesh(const TriangleMesh& a, const TriangleMesh& b) {
  return a.positions == b.positions && a.triangles == b.triangles;
}

}  // namespace

TEST_CASE("Queries read while others are built and removed, and see objects whole") {
  TempStore store;
  BuildOptions options;
  options.tile_triangles = 512;
  REQUIRE(BuildInto(store.database(), "kept", MakeSculpture(8000), options).ok());
  Query query;
  query.threshold = ConstantThreshold(0.01);
  std::vector<TriangleMesh> expected;
  {
    const auto surface = Surface::Open(store.database().OpenObject("kept").value()).value();
    for (const Query& q : {Query{}, query}) expected.push_back(Extract(*surface, q));
  }
  const TriangleMesh other = MakeTerrain(6000);
  std::atomic<bool> built{false};
  std::atomic<bool> build_failed{false};
  std::thread builder([&] {
    for (int i = 0; i < 6; ++i) {
      if (!BuildInto(store.database(), "other", other, options).ok()) build_failed = true;
      if (!store.database().Remove("other").ok()) build_failed = true;
    }
    built = true;
  });
  int queries = 0;
  while (!built || queries < 3) {
    // A new handle and a small cache, so that clusters are read again and again.
    SurfaceOptions surface_options;
    surface_options.cache_bytes = 4 << 20;
    const auto kept =
        Surface::Open(store.database().OpenObject("kept").value(), surface_options).value();
    const bool same = SameMesh(Extract(*kept, Query{}), expected[0]) &&
                      SameMesh(Extract(*kept, query), expected[1]);
    REQUIRE(same);
    ++queries;
    const Result<std::shared_ptr<ClusterSource>> source = store.database().OpenObject("other");
    if (!source.ok()) {
      REQUIRE(source.status().code() == StatusCode::kNotFound);
      continue;
    }
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    const Result<ExtractStats> stats = Surface::Open(*source).value()->Extract(Query{}, sink);
    if (stats.ok()) {
      REQUIRE(mesh.triangles.size() == (*source)->record().triangles);
      REQUIRE(CheckMesh(mesh).ok());
    } else {
      REQUIRE(stats.status().code() == StatusCode::kNotFound);  // removed meanwhile
    }
  }
  builder.join();
  REQUIRE_FALSE(build_failed);
}

}  // namespace mtdb::testing
