// SPDX-License-Identifier: Apache-2.0
// ReplayedMesh: a client's mesh as the two ends of a stream work on it.
#pragma once

#include <unordered_map>

#include "codecs/stream/client_mesh.h"
#include "store/base/in_circle.h"

namespace mtdb::internal {

class ReplayedMesh : public ClientMesh {
 public:
  using ClientMesh::AddVertex;
  using ClientMesh::Attach;
  using ClientMesh::Draw;
  using ClientMesh::Drop;
  using ClientMesh::ExpectMore;
  using ClientMesh::first_of_ring;
  using ClientMesh::half_edge_of;
  using ClientMesh::is_known;
  using ClientMesh::kPrefetches;
  using ClientMesh::next_born;
  using ClientMesh::OpenHalfEdge;
  using ClientMesh::points;
  using ClientMesh::PrefetchBeyond;
  using ClientMesh::PrefetchCorners;
  using ClientMesh::PrefetchTriangle;
  using ClientMesh::PrefetchVertex;
  using ClientMesh::Replace;
  using ClientMesh::ReplaceByStar;
  using ClientMesh::ReplaceStar;
  using ClientMesh::Start;

  ReplayedMesh() = default;
  ReplayedMesh(const ClientMeshOptions& options, bool drawn) : ClientMesh(options, drawn) {}

  LatticePoint place(uint32_t vertex) const {
    const Vec3i p = position(vertex);
    return {p.x, p.y};
  }
  // Where the Delaunay rule holds: the remembered vertex at a place, or kNone32.
  uint32_t RememberedAt(LatticePoint p) const {
    const auto at = remembered_at_.find(Key(p));
    return at == remembered_at_.end() ? kNone32 : at->second;
  }
  void Recall(uint32_t vertex) {
    Unlist(vertex);
    ClientMesh::Recall(vertex);
  }
  uint32_t Forget(uint32_t vertex, uint32_t first_of_ring) {
    const uint32_t lost = ClientMesh::Forget(vertex, first_of_ring);
    if (lost == vertex) return lost;
    if (lost != kNone32) Unlist(lost);
    if (options().delaunay) remembered_at_[Key(place(vertex))] = vertex;
    return lost;
  }
  size_t memory_bytes() const {
    constexpr size_t kPlaceBytes = 48;
    return ClientMesh::memory_bytes() + remembered_at_.size() * kPlaceBytes;
  }

 private:
  static uint64_t Key(LatticePoint p) {
    return static_cast<uint64_t>(p.x) << 32 | static_cast<uint32_t>(p.y);
  }
  void Unlist(uint32_t vertex) {
    const auto at = remembered_at_.find(Key(place(vertex)));
    if (at != remembered_at_.end() && at->second == vertex) remembered_at_.erase(at);
  }

  std::unordered_map<uint64_t, uint32_t> remembered_at_;
};

}  // namespace mtdb::internal
