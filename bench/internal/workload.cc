// SPDX-License-Identifier: Apache-2.0
#include "bench/internal/workload.h"

#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <map>
#include <sys/resource.h>
#include <unistd.h>

#include "codecs/mesh_file/mesh_file.h"
#include "tools/generate/generate.h"

namespace mtdb {

namespace {
std::string TemporaryPath(const std::string& suffix) {
  static int counter = 0;
  return (std::filesystem::temp_directory_path() /
          ("mtdb_bench_" + std::to_string(::getpid()) + "_" + std::to_string(counter++) + suffix))
      .string();
}
}  // namespace

BenchStore::BenchStore() : path_(TemporaryPath("")) {
  database_ = Database::Open(path_, {.writable = true, .create = true}).value();
}

BenchStore::~BenchStore() {
  database_.reset();
  std::error_code error;
  for (const char* suffix : {"", "-lock"}) std::filesystem::remove(path_ + suffix, error);
}

ObjectRecord BenchStore::Build(const std::string& name, const TriangleMesh& mesh,
                               const BuildOptions& options) {
  BuildOptions here = options;
  // As Draco's files and the published figures, whatever the mesh would ask for.
  if (!here.step && !here.bits && !here.terrain) here.bits = 16;
  here.tmp_directory = std::filesystem::temp_directory_path().string();
  const std::unique_ptr<ObjectWriter> writer = database_->Create(name, true).value();
  return BuildObject(mesh, here, *writer).value();
}

std::shared_ptr<Surface> BenchStore::OpenSurface(const std::string& name,
                                                 const SurfaceOptions& options) const {
  return Surface::Open(database_->OpenObject(name).value(), options).value();
}

const TriangleMesh& Sculpture(uint64_t triangles) {
  static std::map<uint64_t, TriangleMesh> meshes;
  const auto [at, fresh] = meshes.try_emplace(triangles);
  if (fresh) {
    TriangleMeshSink sink(&at->second);
    const Status status = GenerateSculpture({.triangles = triangles, .seed = 1}, sink);
    MTDB_CHECK(status.ok(), status.message().c_str());
  }
  return at->second;
}

TriangleMesh ExtractMesh(const Surface& surface, const Query& query, ExtractStats* stats) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  *stats = surface.Extract(query, sink).value();
  return mesh;
}

uint64_t DracoBytes(const TriangleMesh& mesh, int bits) {
  const std::string path = TemporaryPath(".drc");
  MeshWriteOptions options;
  options.draco_position_bits = bits;
  options.draco_level = 10;
  const std::unique_ptr<MeshFileWriter> writer = CreateMeshFileWriter(path, options).value();
  const Status status = SendMesh(mesh, *writer);
  MTDB_CHECK(status.ok(), status.message().c_str());
  std::filesystem::remove(path);
  return writer->bytes_written();
}

bool WriteRows(const std::string& path, const Json& rows) {
  std::ofstream out(path);
  out << rows.dump(2) << "\n";
  out.flush();
  if (!out.good()) std::fprintf(stderr, "%s: cannot be written\n", path.c_str());
  return out.good();
}

double ProcessCpuSeconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

uint64_t PeakMemoryBytes() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with("VmHWM:")) return std::stoull(line.substr(6)) * 1024;
  }
  return 0;
}

void ResetPeakMemory() { std::ofstream("/proc/self/clear_refs") << "5"; }

}  // namespace mtdb
