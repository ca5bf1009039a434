// SPDX-License-Identifier: Apache-2.0
// Opens a store, asks for a ball of its surface at an accuracy, and counts what comes back.
#include <cstdio>

#include "query/surface.h"
#include "store/database.h"

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  auto database = mtdb::Database::Open(argv[1]);
  if (!database) return std::fprintf(stderr, "%s\n", database.error().message().c_str()), 1;
  auto source = (*database)->OpenObject("");  // the store's only object
  if (!source) return std::fprintf(stderr, "%s\n", source.error().message().c_str()), 1;
  auto surface = mtdb::Surface::Open(*source);
  if (!surface) return std::fprintf(stderr, "%s\n", surface.error().message().c_str()), 1;

  const mtdb::ObjectRecord& record = (*surface)->record();
  mtdb::Query query;
  query.region = mtdb::SphereRegion(record.bounds.max, record.diagonal() / 4);
  query.threshold = mtdb::ConstantThreshold(record.diagonal() * 1e-4);
  mtdb::TriangleMesh mesh;
  mtdb::TriangleMeshSink sink(&mesh);
  auto stats = (*surface)->Extract(query, sink);
  if (!stats) return std::fprintf(stderr, "%s\n", stats.error().message().c_str()), 1;
  std::printf("%zu triangles, error at most %g\n", mesh.triangles.size(), stats->error_bound);
  return 0;
}
