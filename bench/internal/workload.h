// SPDX-License-Identifier: Apache-2.0
// What the benchmarks share: temporary stores, generated meshes, what the process has used.
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "builder/build.h"
#include "query/surface.h"
#include "store/base/mesh_sink.h"
#include "store/database.h"

namespace mtdb {

// A store in a temporary file that goes away. Programs of this folder stop at the first error.
class BenchStore {
 public:
  BenchStore();
  ~BenchStore();
  BenchStore(const BenchStore&) = delete;
  BenchStore& operator=(const BenchStore&) = delete;

  ObjectRecord Build(const std::string& name, const TriangleMesh& mesh,
                     const BuildOptions& options);
  // Reads what Build wrote: a new handle, an empty cache.
  std::shared_ptr<Surface> OpenSurface(const std::string& name,
                                       const SurfaceOptions& options = {}) const;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  std::shared_ptr<Database> database_;
};

// Takes the mesh and lets it go.
class NullSink final : public MeshSink {
 public:
  Status Begin(const MeshHeader&) override { return Status::Ok(); }
  Status AddVertices(std::span<const Vec3d>, ByteSpan) override { return Status::Ok(); }
  Status AddTriangles(std::span<const TriangleVertices>) override { return Status::Ok(); }
  Status End() override { return Status::Ok(); }
};

// Made once per size and kept.
const TriangleMesh& Sculpture(uint64_t triangles);

// The mesh of a query.
TriangleMesh ExtractMesh(const Surface& surface, const Query& query, ExtractStats* stats);

// Bytes of the mesh as a Draco file, with positions of `bits` and Draco's slowest level.
uint64_t DracoBytes(const TriangleMesh& mesh, int bits);

// What programs write with --json: an array of flat rows, by key. False, with a line on standard
// error, when the file cannot be written.
using Json = nlohmann::ordered_json;
bool WriteRows(const std::string& path, const Json& rows);

// Seconds of all threads of the process so far.
double ProcessCpuSeconds();
// Largest resident set since ResetPeakMemory(), in bytes; 0 where the system does not tell.
uint64_t PeakMemoryBytes();
void ResetPeakMemory();

}  // namespace mtdb
