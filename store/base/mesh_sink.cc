// SPDX-License-Identifier: Apache-2.0
#include "store/base/mesh_sink.h"

#include <algorithm>

namespace mtdb {
namespace {

// Room for `count` more elements, at once for as many as were announced, so that a large list is
// not copied again and again. Counts from files may be false: they are believed up to so many times
// what has come.
template <typename T>
void MakeRoom(std::vector<T>& list, size_t count, uint64_t announced) {
  constexpr uint64_t kTrusted = 1 << 20;
  constexpr uint64_t kTrustedTimes = 256;
  const size_t needed = list.size() + count;
  if (needed <= list.capacity()) return;
  const uint64_t trusted = std::max<uint64_t>(kTrusted, kTrustedTimes * needed);
  const size_t grown = announced > needed ? 0 : 2 * list.capacity();
  list.reserve(std::max({needed, static_cast<size_t>(std::min(announced, trusted)), grown}));
}

}  // namespace

Status TriangleMeshSink::Begin(const MeshHeader& header) {
  mesh_->header = header;
  mesh_->positions.clear();
  mesh_->triangles.clear();
  mesh_->rows.clear();
  mesh_->corners.clear();
  return Status::Ok();
}

Status TriangleMeshSink::AddVertices(std::span<const Vec3d> positions, ByteSpan rows) {
  MakeRoom(mesh_->positions, positions.size(), mesh_->header.vertex_count.value_or(0));
  mesh_->rows.reserve(mesh_->positions.capacity() * mesh_->header.attributes.row_bytes());
  mesh_->positions.insert(mesh_->positions.end(), positions.begin(), positions.end());
  mesh_->rows.insert(mesh_->rows.end(), rows.begin(), rows.end());
  return Status::Ok();
}

Status TriangleMeshSink::AddTriangles(std::span<const TriangleVertices> triangles) {
  MakeRoom(mesh_->triangles, triangles.size(), mesh_->header.triangle_count.value_or(0));
  mesh_->triangles.insert(mesh_->triangles.end(), triangles.begin(), triangles.end());
  return Status::Ok();
}

Status TriangleMeshSink::AddCorners(std::span<const TextureCorner> corners) {
  MakeRoom(mesh_->corners, corners.size(), 3 * mesh_->header.triangle_count.value_or(0));
  mesh_->corners.insert(mesh_->corners.end(), corners.begin(), corners.end());
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
    if (!header.textured) continue;
    MTDB_RETURN_IF_ERROR(sink.AddCorners(std::span(mesh.corners).subspan(3 * i, 3 * n)));
  }
  return sink.End();
}

}  // namespace mtdb
