// SPDX-License-Identifier: Apache-2.0
#include "store/base/mesh_sink.h"

#include <algorithm>

namespace mtdb {

Status TriangleMeshSink::Begin(const MeshHeader& header) {
  mesh_->header = header;
  mesh_->positions.clear();
  mesh_->triangles.clear();
  mesh_->rows.clear();
  constexpr uint64_t kTrusted = 1 << 20;  // counts from files may be false: the blocks then decide
  const uint64_t vertices = std::min(header.vertex_count.value_or(0), kTrusted);
  mesh_->positions.reserve(vertices);
  mesh_->rows.reserve(vertices * header.attributes.row_bytes());
  mesh_->triangles.reserve(std::min(header.triangle_count.value_or(0), 2 * kTrusted));
  return Status::Ok();
}

Status TriangleMeshSink::AddVertices(std::span<const Vec3d> positions, ByteSpan rows) {
  mesh_->positions.insert(mesh_->positions.end(), positions.begin(), positions.end());
  mesh_->rows.insert(mesh_->rows.end(), rows.begin(), rows.end());
  return Status::Ok();
}

Status TriangleMeshSink::AddTriangles(std::span<const TriangleVertices> triangles) {
  mesh_->triangles.insert(mesh_->triangles.end(), triangles.begin(), triangles.end());
  return Status::Ok();
}

Status TriangleMeshSink::End() {
  mesh_->header.vertex_count = mesh_->positions.size();
  mesh_->header.triangle_count = mesh_->triangles.size();
  return Status::Ok();
}

Status SendMesh(const TriangleMesh& mesh, MeshSink& sink) {
  constexpr size_t kBlock = 65536;
  MeshHeader header = mesh.header;
  header.vertex_count = mesh.positions.size();
  header.triangle_count = mesh.triangles.size();
  MTDB_RETURN_IF_ERROR(sink.Begin(header));
  const size_t row = header.attributes.row_bytes();
  for (size_t i = 0; i < mesh.positions.size(); i += kBlock) {
    const size_t n = std::min(kBlock, mesh.positions.size() - i);
    MTDB_RETURN_IF_ERROR(sink.AddVertices(std::span(mesh.positions).subspan(i, n),
                                          ByteSpan(mesh.rows).subspan(i * row, n * row)));
  }
  for (size_t i = 0; i < mesh.triangles.size(); i += kBlock) {
    const size_t n = std::min(kBlock, mesh.triangles.size() - i);
    MTDB_RETURN_IF_ERROR(sink.AddTriangles(std::span(mesh.triangles).subspan(i, n)));
  }
  return sink.End();
}

}  // namespace mtdb
