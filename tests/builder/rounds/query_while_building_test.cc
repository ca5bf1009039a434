// SPDX-License-Identifier: Apache-2.0
// Queries beside a build in the same store: clusters are read while pages change.
#include <atomic>
#include <catch2/catch.hpp>
#include <string>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include "tests/builder/fixture.h"
#include "tests/support/mesh_check.h"
#include "tests/support/temporary_folder.h"

namespace mtdb::testing {
namespace {

bool SameMesh(const TriangleMesh& a, const TriangleMesh& b) {
  return a.positions == b.positions && a.triangles == b.triangles;
}

// Takes all of an object that is complete, unless it has been removed. True when there was one.
bool ReadWhole(const Database& database, const std::string& name) {
  const Result<std::shared_ptr<ClusterSource>> source = database.OpenObject(name);
  if (!source.ok()) {
    REQUIRE(source.status().code() == StatusCode::kNotFound);
    return false;
  }
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  const Result<ExtractStats> stats = Surface::Open(*source).value()->Extract(Query{}, sink);
  if (!stats.ok()) {
    REQUIRE(stats.status().code() == StatusCode::kNotFound);  // removed meanwhile
    return false;
  }
  REQUIRE(mesh.triangles.size() == (*source)->record().triangles);
  REQUIRE(CheckMesh(mesh).ok());
  return true;
}

constexpr int kObjects = 8;

// Builds objects "0", "1", ... into a new store, and removes each after the next but one.
bool BuildAndRemove(const std::string& path, const TriangleMesh& mesh) {
  BuildOptions options;
  options.tile_triangles = 512;
  const auto database = Database::Open(path, {.writable = true, .create = true});
  if (!database.ok()) return false;
  for (int i = 0; i < kObjects; ++i) {
    if (!BuildInto(**database, std::to_string(i), mesh, options).ok()) return false;
    if (i >= 2 && !(*database)->Remove(std::to_string(i - 2)).ok()) return false;
  }
  return true;
}

}  // namespace

TEST_CASE("A process sees the objects that another one writes whole, or not at all") {
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/store.mtdb";
  const TriangleMesh mesh = MakeTerrain(4000);
  const pid_t writer = ::fork();
  REQUIRE(writer >= 0);
  if (writer == 0) ::_exit(BuildAndRemove(path, mesh) ? 0 : 1);
  std::shared_ptr<Database> database;  // open all the time, as long as the writer lives
  int status = 0;
  int seen = 0;
  bool over = false;
  while (!over) {
    over = ::waitpid(writer, &status, WNOHANG) != 0;
    if (database == nullptr) {
      const auto opened = Database::Open(path);
      if (opened.ok()) database = *opened;
      if (database == nullptr) continue;  // not created yet
    }
    const auto records = database->List();
    REQUIRE(records.ok());
    for (const ObjectRecord& r : *records) {
      REQUIRE(r.triangles == mesh.triangles.size());
      seen += ReadWhole(*database, r.name) ? 1 : 0;
    }
  }
  REQUIRE(status == 0);
  REQUIRE(seen >= 2);  // the last two stay
  REQUIRE(database->List()->size() == 2);
}

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
    ReadWhole(store.database(), "other");
  }
  builder.join();
  REQUIRE_FALSE(build_failed);
}

}  // namespace mtdb::testing
