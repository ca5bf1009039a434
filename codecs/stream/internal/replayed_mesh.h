// SPDX-License-Identifier: Apache-2.0
// ReplayedMesh: a client's mesh as the two ends of a stream work on it.
#pragma once

#include "codecs/stream/client_mesh.h"

namespace mtdb::internal {

class ReplayedMesh : public ClientMesh {
 public:
  using ClientMesh::AddVertex;
  using ClientMesh::Attach;
  using ClientMesh::Drop;
  using ClientMesh::first_of_ring;
  using ClientMesh::Forget;
  using ClientMesh::half_edge_of;
  using ClientMesh::is_known;
  using ClientMesh::OpenHalfEdge;
  using ClientMesh::points;
  using ClientMesh::Recall;
  using ClientMesh::Replace;
  using ClientMesh::ReplaceByStar;
  using ClientMesh::Start;

  ReplayedMesh() = default;
  ReplayedMesh(const ClientMeshOptions& options, bool drawn) : ClientMesh(options, drawn) {}
};

}  // namespace mtdb::internal
