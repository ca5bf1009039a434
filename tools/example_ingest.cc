// SPDX-License-Identifier: Apache-2.0
// Stores a mesh that is in memory, block after block, as an ingest of any size does: nothing here
// holds the whole. example_ingest STORE
#include <cmath>
#include <cstdio>
#include <vector>

#include "builder/build.h"
#include "store/database.h"

namespace {

constexpr uint64_t kSide = 500;

// A hilly square with a scalar at each vertex.
mtdb::Status Produce(mtdb::MeshSink& sink) {
  mtdb::MeshHeader header;
  header.attributes.attributes.push_back({.name = "slope", .type = mtdb::ScalarType::kFloat32});
  header.double_positions = true;  // sines are no float32 values
  MTDB_RETURN_IF_ERROR(sink.Begin(header));
  for (uint64_t y = 0; y < kSide; ++y) {
    std::vector<mtdb::Vec3d> positions;
    std::vector<float> slopes;
    std::vector<mtdb::TriangleVertices> triangles;
    for (uint64_t x = 0; x < kSide; ++x) {
      const auto u = static_cast<double>(x);
      const auto v = static_cast<double>(y);
      positions.push_back({u, v, 15 * std::sin(0.03 * u) * std::cos(0.04 * v)});
      slopes.push_back(static_cast<float>(std::abs(0.45 * std::cos(0.03 * u))));
      if (x + 1 == kSide || y + 1 == kSide) continue;
      const uint64_t a = y * kSide + x;  // a triangle may name vertices that come later
      triangles.push_back({a, a + 1, a + kSide + 1});
      triangles.push_back({a, a + kSide + 1, a + kSide});
    }
    MTDB_RETURN_IF_ERROR(sink.AddVertices(positions, std::as_bytes(std::span(slopes))));
    MTDB_RETURN_IF_ERROR(sink.AddTriangles(triangles));
  }
  return sink.End();
}

mtdb::Result<mtdb::ObjectRecord> Run(const char* path) {
  MTDB_ASSIGN_OR_RETURN(const auto database, mtdb::Database::Open(path, {.writable = true}));
  MTDB_ASSIGN_OR_RETURN(const auto writer, database->Create("hills", /*replace=*/true));
  mtdb::BuildOptions options;
  options.memory_bytes = uint64_t{512} << 20;
  return mtdb::BuildObject(Produce, options, *writer, [](const mtdb::BuildProgress& p) {
    std::printf("\r%-8s %3.0f %%", p.stage, 100 * p.overall);
    return mtdb::Status::Ok();  // an error would cancel
  });
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const mtdb::Result<mtdb::ObjectRecord> record = Run(argv[1]);
  if (!record) return std::fprintf(stderr, "%s\n", record.error().message().c_str()), 1;
  std::printf("\n%llu triangles in %u clusters\n",
              static_cast<unsigned long long>(record->triangles), record->clusters);
  return 0;
}
