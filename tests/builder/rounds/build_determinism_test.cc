// SPDX-License-Identifier: Apache-2.0
// The same mesh and options give the same keys and values, whatever else differs.
#include <catch2/catch.hpp>

#include "tests/builder/fixture.h"

namespace mtdb::testing {

TEST_CASE("The number of threads changes nothing that is stored") {
  // Enough triangles for a sort in several parts and for more than one group of tiles.
  const TriangleMesh mesh = MakeTerrain(140000);
  std::optional<ObjectRecord> first;
  TempStore store;
  for (const unsigned threads : {1u, 2u, 4u}) {
    BuildOptions options;
    options.threads = threads;
    options.tile_triangles = 1024;
    const Result<ObjectRecord> record =
        BuildInto(store.database(), "threads " + std::to_string(threads), mesh, options);
    REQUIRE(record.ok());
    REQUIRE(record->clusters > 100);
    if (!first) first = *record;
    REQUIRE(record->digest_hex() == first->digest_hex());
    REQUIRE(record->rounds == first->rounds);
  }
}

TEST_CASE("Object id, name, other objects, progress and a memory limit change nothing") {
  TriangleMesh mesh = MakeSculpture(8000);
  NumberVertices(&mesh);
  const std::string expected = Build(mesh).record.digest_hex();
  TempStore store;
  REQUIRE(BuildInto(store.database(), "other", MakeTerrain(500), {}).ok());
  REQUIRE(BuildInto(store.database(), "a", mesh, {}).value().digest_hex() == expected);
  BuildOptions options;
  options.memory_bytes = uint64_t{256} << 20;
  const Result<ObjectRecord> again =
      BuildInto(store.database(), "a much longer name", mesh, options,
                [](const BuildProgress&) { return Status::Ok(); });
  REQUIRE(again->digest_hex() == expected);
  REQUIRE(again->id != ObjectId{0});
}

TEST_CASE("Different meshes and different options give different digests") {
  const TriangleMesh mesh = MakeSculpture(8000);
  const std::string digest = Build(mesh).record.digest_hex();
  TriangleMesh moved = mesh;
  moved.positions[100].x += 0.1;
  REQUIRE(Build(moved).record.digest_hex() != digest);
  BuildOptions options;
  options.tile_triangles = 4096;
  REQUIRE(Build(mesh, options).record.digest_hex() != digest);
}

}  // namespace mtdb::testing
