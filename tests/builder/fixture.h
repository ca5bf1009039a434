// SPDX-License-Identifier: Apache-2.0
// Shared by the builder's tests: stores that go away, meshes built into them, what comes back.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "builder/build.h"
#include "query/surface.h"
#include "store/base/mesh_sink.h"
#include "store/database.h"
#include "tests/support/attribute_kinds.h"
#include "tests/support/mesh_changes.h"

namespace mtdb::testing {

using namespace internal;

// A writable store in a file of its own, removed with the object.
class TempStore {
 public:
  TempStore();
  ~TempStore();
  TempStore(const TempStore&) = delete;
  TempStore& operator=(const TempStore&) = delete;

  const std::string& path() const { return path_; }
  Database& database() const { return *database_; }

 private:
  std::string path_;
  std::shared_ptr<Database> database_;
};

// An object in a store of its own, open for queries.
struct BuiltObject {
  std::unique_ptr<TempStore> store;
  ObjectRecord record;
  std::shared_ptr<Surface> surface;
};

// Creates the object `name`, builds `mesh` into it.
Result<ObjectRecord> BuildInto(Database& database, const std::string& name,
                               const TriangleMesh& mesh, const BuildOptions& options,
                               const ProgressCallback& progress = {});
// The same with a new store; requires success, and that VerifyStore and VerifyObject agree.
BuiltObject Build(const TriangleMesh& mesh, const BuildOptions& options = {});
BuiltObject Build(const AttributeKind& kind);
// Opens and verifies the object of a store that was built likewise.
BuiltObject Open(std::unique_ptr<TempStore> store, const Result<ObjectRecord>& record);
TriangleMesh Extract(const Surface& surface, const Query& query, ExtractStats* stats = nullptr);

TriangleMesh MakeSculpture(uint64_t triangles, uint64_t seed = 1);
TriangleMesh MakeTerrain(uint64_t triangles, uint64_t seed = 1);
// A mesh of the directory of test data beside the repository; nothing, and a warning, without it.
std::optional<TriangleMesh> LoadSharedMesh(const std::string& file);

// What a store must give back for `input`: its triangles less degenerate and duplicate ones, as
// positions of `grid` with the bytes of their attributes, rotated and sorted. Two meshes of the
// same list are the same surface; with numbered vertices, also the same connectivity.
std::vector<std::string> ExpectedTriangles(const TriangleMesh& input, const Grid& grid);
// The same list of a mesh as it is.
std::vector<std::string> Triangles(const TriangleMesh& mesh);

// Random region and random constant or linear threshold, from the root's errors to none at all.
Query RandomCutQuery(const ObjectRecord& record, std::mt19937& random);

}  // namespace mtdb::testing
