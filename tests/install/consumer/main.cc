// SPDX-License-Identifier: Apache-2.0
// consumer STORE: prints the triangles that the catalog and a query count, which must agree.
#include <cstdio>

#include "codecs/mesh_file/mesh_file.h"
#include "query/probe.h"
#include "query/query_json.h"
#include "query/surface.h"
#include "store/database.h"

namespace {

mtdb::Result<int> Run(const char* path) {
  MTDB_ASSIGN_OR_RETURN(const auto database, mtdb::Database::Open(path));
  MTDB_ASSIGN_OR_RETURN(const auto source, database->OpenObject(""));
  MTDB_ASSIGN_OR_RETURN(const auto surface, mtdb::Surface::Open(source));
  mtdb::TriangleMesh mesh;
  mtdb::TriangleMeshSink sink(&mesh);
  MTDB_ASSIGN_OR_RETURN(const mtdb::Query query, mtdb::ParseQuery(R"({"threshold": "full"})", 1));
  MTDB_ASSIGN_OR_RETURN(const mtdb::ExtractStats stats, surface->Extract(query, sink));
  MTDB_ASSIGN_OR_RETURN(const mtdb::ProbeAnswer closest,
                        mtdb::FindClosestPoint(*surface, surface->record().bounds.max));
  // Draco is linked too.
  MTDB_ASSIGN_OR_RETURN(const auto writer, mtdb::CreateMeshFileWriter(std::string(path) + ".drc"));
  MTDB_RETURN_IF_ERROR(mtdb::SendMesh(mesh, *writer));
  std::printf("%zu triangles\n", mesh.triangles.size());
  const bool good = mesh.triangles.size() == surface->record().triangles &&
                    stats.triangles == mesh.triangles.size() && closest.hit.has_value();
  return good ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const mtdb::Result<int> result = Run(argv[1]);
  if (!result) return std::fprintf(stderr, "%s\n", result.error().message().c_str()), 1;
  return *result;
}
