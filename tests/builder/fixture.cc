// SPDX-License-Identifier: Apache-2.0
#include "tests/builder/fixture.h"

#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>
#include <set>
#include <unistd.h>

#include "codecs/mesh_file/mesh_file.h"
#include "query/verify_object.h"
#include "tools/generate/generate.h"

namespace mtdb::testing {

namespace {

void AppendCorner(const TriangleMesh& mesh, Vec3d position, VertexIndex v, std::string* out) {
  const size_t row = mesh.header.attributes.row_bytes();
  out->append(reinterpret_cast<const char*>(&position), sizeof(position));
  out->append(reinterpret_cast<const char*>(mesh.rows.data() + v * row), row);
}

std::string Rotated(const std::array<std::string, 3>& corners) {
  std::string least;
  for (size_t first = 0; first < 3; ++first) {
    const std::string s = corners[first] + corners[(first + 1) % 3] + corners[(first + 2) % 3];
    if (first == 0 || s < least) least = s;
  }
  return least;
}

TriangleMesh Generated(Status (*generate)(const GenerateOptions&, MeshSink&), uint64_t triangles,
                       uint64_t seed) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  const Status status = generate({.triangles = triangles, .seed = seed}, sink);
  INFO(status.message());
  REQUIRE(status.ok());
  return mesh;
}

}  // namespace

namespace {

void RemoveStore(const std::string& path) {
  std::error_code error;
  for (const char* suffix : {"", "-lock", ".lock"}) std::filesystem::remove(path + suffix, error);
}

}  // namespace

TempStore::TempStore() {
  static std::atomic<int> counter{0};
  path_ = (std::filesystem::temp_directory_path() /
           ("mtdb_builder_test_" + std::to_string(::getpid()) + "_" + std::to_string(counter++)))
              .string();
  RemoveStore(path_);  // of a process of this number that was killed
  database_ = Database::Open(path_, {.writable = true, .create = true}).value();
}

TempStore::~TempStore() {
  database_.reset();
  RemoveStore(path_);
}

Result<ObjectRecord> BuildInto(Database& database, const std::string& name,
                               const TriangleMesh& mesh, const BuildOptions& options,
                               const ProgressCallback& progress) {
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<ObjectWriter> writer, database.Create(name, false));
  BuildOptions here = options;
  here.tmp_directory = std::filesystem::temp_directory_path().string();
  return BuildObject(mesh, here, *writer, progress);
}

BuiltObject Open(std::unique_ptr<TempStore> store, const Result<ObjectRecord>& record) {
  BuiltObject built;
  built.store = std::move(store);
  INFO(record.status().message());
  REQUIRE(record.ok());
  built.record = *record;
  CheckReport report;
  REQUIRE(VerifyStore(built.store->path(), "", &report).ok());
  built.surface = Surface::Open(built.store->database().OpenObject("object").value()).value();
  for (const VerifyLevel level : {VerifyLevel::kFull, VerifyLevel::kGlobal}) {
    REQUIRE(VerifyObject(*built.surface, level, &report).ok());
  }
  INFO((report.ok() ? std::string() : report.failures.front()));
  REQUIRE(report.ok());
  return built;
}

BuiltObject Build(const TriangleMesh& mesh, const BuildOptions& options) {
  auto store = std::make_unique<TempStore>();
  BuildOptions any = options;  // on any grid, however coarse
  any.max_collapsed = 1;
  const Result<ObjectRecord> record = BuildInto(store->database(), "object", mesh, any);
  return Open(std::move(store), record);
}

BuiltObject Build(const AttributeKind& kind) {
  BuildOptions options;
  if (kind.lossless_positions) options.mode = PositionMode::kLossless;
  options.normal_bits = kind.normal_bits;
  for (const auto& [name, step] : kind.steps) options.attribute_steps.push_back({name, step});
  return Build(kind.mesh, options);
}

TriangleMesh Extract(const Surface& surface, const Query& query, ExtractStats* stats) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  const Result<ExtractStats> result = surface.Extract(query, sink);
  INFO(result.status().message());
  REQUIRE(result.ok());
  if (stats != nullptr) *stats = *result;
  return mesh;
}

TriangleMesh MakeSculpture(uint64_t triangles, uint64_t seed) {
  return Generated(GenerateSculpture, triangles, seed);
}

TriangleMesh MakeTerrain(uint64_t triangles, uint64_t seed) {
  return Generated(GenerateTerrain, triangles, seed);
}

std::optional<TriangleMesh> LoadSharedMesh(const std::string& file) {
  const std::string path = std::string(MTDB_SOURCE_DIR) + "/../shared/data/" + file;
  if (!std::filesystem::exists(path)) {
    WARN("skipped: no " << path);
    return std::nullopt;
  }
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  MeshReadReport report;
  const Status status = ReadMeshFile(path, sink, &report);
  INFO(status.message());
  REQUIRE(status.ok());
  return mesh;
}

std::vector<std::string> ExpectedTriangles(const TriangleMesh& input, const Grid& grid) {
  std::set<TriangleVertices> seen;
  std::vector<std::string> list;
  for (TriangleVertices t : input.triangles) {
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) continue;
    while (t[0] > t[1] || t[0] > t[2]) t = {t[1], t[2], t[0]};
    if (!seen.insert(t).second) continue;
    std::array<std::string, 3> corners;
    for (size_t c = 0; c < 3; ++c) {
      const Vec3d p = grid.Position(grid.Quantize(input.positions[t[c]]));
      AppendCorner(input, p, t[c], &corners[c]);
    }
    list.push_back(Rotated(corners));
  }
  std::sort(list.begin(), list.end());
  return list;
}

std::vector<std::string> Triangles(const TriangleMesh& mesh) {
  std::vector<std::string> list;
  list.reserve(mesh.triangles.size());
  for (const TriangleVertices& t : mesh.triangles) {
    std::array<std::string, 3> corners;
    for (size_t c = 0; c < 3; ++c) AppendCorner(mesh, mesh.positions[t[c]], t[c], &corners[c]);
    list.push_back(Rotated(corners));
  }
  std::sort(list.begin(), list.end());
  return list;
}

Query RandomCutQuery(const ObjectRecord& record, std::mt19937& random) {
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const double size = record.diagonal();
  const auto point = [&] {
    Vec3d p;
    for (int i = 0; i < 3; ++i) p[i] = uniform(record.bounds.min[i], record.bounds.max[i]);
    return p;
  };
  const auto error = [&] {
    // Finer than a sixteenth of a step all cuts are one.
    const double least = record.grid.ErrorCode(record.grid.step / 16) - 1.0;
    const double from = record.grid.is_linear() && least < record.error_code_max ? least : 0;
    return record.grid.Error(static_cast<uint8_t>(uniform(from, record.error_code_max + 1.0)));
  };
  Query query;
  switch (random() % 4) {
    case 0: break;
    case 1: query.region = SphereRegion(point(), size * uniform(0, 0.3)); break;
    case 2:
      query.region = UnionRegion({SphereRegion(point(), size * uniform(0, 0.1)),
                                  SphereRegion(point(), size * uniform(0, 0.1))});
      break;
    default: {
      Box3d box;
      const Vec3d p = point();
      box.Add(p);
      box.Add(p + Vec3d{uniform(0, 0.4), uniform(0, 0.4), uniform(0, 0.4)} * size);
      query.region = BoxRegion(box);
    }
  }
  switch (random() % 5) {
    case 0: break;  // full resolution
    case 1: query.threshold = LinearThreshold(point(), error() * 0.1, uniform(0, 0.1)); break;
    case 2: query.threshold = LinearThreshold(point(), error(), -uniform(0, 0.1)); break;
    default: query.threshold = ConstantThreshold(error());
  }
  if (query.region == nullptr && query.threshold == nullptr) {
    query.max_triangles =
        record.root_triangles + random() % (record.triangles - record.root_triangles + 1);
  }
  return query;
}

}  // namespace mtdb::testing
