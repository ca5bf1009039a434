// SPDX-License-Identifier: Apache-2.0
// WholeCut: what the sender of a clipped client keeps beside the client's mesh: the mesh of the
// whole cut, which of its triangles the client holds, and which updates the client can follow.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "codecs/stream/encode/key_table.h"
#include "codecs/stream/internal/replayed_mesh.h"
#include "codecs/stream/mesh_update.h"
#include "store/base/ids.h"

namespace mtdb::internal {

// The triangles that an update takes away and puts there.
struct UpdateChange {
  std::vector<TriangleKey> removed;
  std::vector<TriangleKey> created;
  std::vector<std::array<VertexIndex, 3>> corners;  // of `created`
};
void SetChange(UpdateChange& change, const UpdateBatch& batch, size_t first);
// Likewise of a crumb, without the corners.
void SetCrumbChange(UpdateChange& change, bool insert, const UpdateBatch::Crumb& crumb);

class WholeCut {
 public:
  // A triangle of the client: its key, and its slot here, or kNone32 when the cut has it no more.
  struct Held {
    TriangleKey key = 0;
    uint32_t whole = kNone32;
  };

  WholeCut(const ClientMeshOptions& options, const BaseMesh& base);

  const ReplayedMesh& mesh() const { return mesh_; }
  size_t memory_bytes() const;
  TriangleKey key(uint32_t slot) const { return triangles_.key(slot); }
  VertexIndex vertex_key(uint32_t vertex) const { return vertices_.key(vertex); }
  // Of a triangle here, the client's slot, or kNone32.
  uint32_t client_slot(uint32_t slot) const { return client_[slot]; }
  const Held& held(uint32_t client_slot) const { return held_[client_slot]; }

  // The client has got (lost) a triangle.
  void Link(TriangleKey key, uint32_t client_slot);
  void Unlink(uint32_t client_slot);

  void Apply(const UpdateBatch& batch);
  // True for the slots of triangles that meet the region. Asks for every triangle.
  void Choose(const MeetsRegion& region);
  bool chosen(uint32_t slot) const { return chosen_[slot]; }
  // After that: per batch and node, then crumb, whether the client is to follow the update. It can
  // when it holds what is removed, and should when something of what is created is chosen in the
  // end. `held`: what the client holds before the batches.
  std::vector<std::vector<bool>> Plan(std::span<const UpdateBatch> batches,
                                      const KeyTable& held) const;

 private:
  void Apply(bool insert, const UpdateBatch::Crumb& crumb);
  // The slot of a triangle that goes, or gets another key.
  uint32_t Take(TriangleKey key);

  ReplayedMesh mesh_;  // remembers nothing
  KeyTable triangles_;
  KeyTable vertices_;
  std::vector<uint32_t> client_;
  std::vector<bool> chosen_;
  std::vector<Held> held_;  // of the client's slots
};

}  // namespace mtdb::internal
