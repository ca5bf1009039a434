// SPDX-License-Identifier: Apache-2.0
#include "codecs/stream/client_mesh.h"

#include "codecs/stream/internal/replayed_mesh.h"

namespace mtdb {

const ClientMeshOptions& ClientMesh::options() const { return mesh_->options(); }
uint32_t ClientMesh::triangle_count() const { return mesh_->triangle_count(); }
uint32_t ClientMesh::vertex_count() const { return mesh_->vertex_count(); }
uint32_t ClientMesh::triangle_slots() const { return mesh_->triangle_slots(); }
uint32_t ClientMesh::vertex_slots() const { return mesh_->vertex_slots(); }
bool ClientMesh::has_triangle(uint32_t slot) const { return mesh_->has_triangle(slot); }
bool ClientMesh::has_vertex(uint32_t slot) const { return mesh_->has_vertex(slot); }
ClientMesh::Triangle ClientMesh::triangle(uint32_t slot) const {
  const internal::ReplayedMesh::Triangle& t = mesh_->triangle(slot);
  return {t.corners, t.opposite, t.born()};
}
uint32_t ClientMesh::degree(uint32_t vertex) const { return mesh_->degree(vertex); }
std::span<const uint32_t> ClientMesh::remembered() const { return mesh_->remembered(); }
bool ClientMesh::is_remembered(uint32_t vertex) const { return mesh_->is_remembered(vertex); }
Vec3i ClientMesh::position(uint32_t vertex) const { return mesh_->position(vertex); }
ByteSpan ClientMesh::row(uint32_t vertex) const { return mesh_->row(vertex); }
std::span<const uint32_t> ClientMesh::indices() const { return mesh_->indices(); }
std::span<const float> ClientMesh::positions() const { return mesh_->positions(); }
Vec3d ClientMesh::origin() const { return mesh_->origin(); }
const Bytes& ClientMesh::rows() const { return mesh_->rows(); }
size_t ClientMesh::memory_bytes() const { return mesh_->memory_bytes(); }

}  // namespace mtdb
