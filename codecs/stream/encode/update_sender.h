// SPDX-License-Identifier: Apache-2.0
// UpdateSender: the sender's state. update_encoder.cc codes updates, clip_encoder.cc what a moving
// region asks for.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "codecs/stream/encode/delaunay_encoder.h"
#include "codecs/stream/encode/key_table.h"
#include "codecs/stream/encode/whole_cut.h"
#include "codecs/stream/internal/clip_coder.h"
#include "codecs/stream/internal/update_coder.h"
#include "codecs/stream/update_stream.h"

namespace mtdb::internal {

// The sender; see UpdateEncoder.
class UpdateSender {
 public:
  UpdateSender(const ClientMeshOptions& options, const BaseMesh& base, const MeetsRegion& region);
  Bytes Encode(std::span<const UpdateBatch> batches, const MeetsRegion& region);
  size_t memory_bytes() const;

  const ClientMeshOptions options_;
  const size_t row_bytes_;
  // So many updates of a record stay well below kMaxRecordBytes.
  const uint64_t max_updates_;
  ReplayedMesh mesh_;
  UpdateModels models_;
  std::vector<Vec3i> ring_;  // positions around the vertex at hand
  Bytes start_;
  uint64_t listed_ = 0;
  uint64_t sent_ = 0;
  uint64_t recalled_ = 0;

 private:
  class AttachedSide;
  using Node = UpdateBatch::Node;
  using Follows = std::vector<bool>;  // which nodes of a batch the client follows; empty: all
  // A node of a batch whose hole (star) the client finds by walking.
  struct Target {
    uint32_t at;  // the anchor's slot, or the vertex's
    uint32_t node;
    friend auto operator<=>(const Target&, const Target&) = default;
  };

  void WriteStart(const BaseMesh& base, Vec3d origin);
  void StartWholeCut();
  void PutRecord(ByteWriter& out);
  // Puts the record that is begun, if one is.
  void EndRecord(ByteWriter& out);
  void PutTriangle(TriangleKey key, uint32_t slot) {
    triangles_.Put(key, slot);
    if (whole_) whole_->Link(key, slot);
  }
  void EraseTriangle(uint32_t slot) {
    if (whole_) whole_->Unlink(slot);
    triangles_.Erase(slot);
  }
  void EncodeClip(ByteWriter& out);
  std::vector<uint32_t> Coming() const;
  void EncodeDrops(const std::vector<uint32_t>& leaving, std::vector<uint32_t>* left_over);
  uint32_t TriangleOf(TriangleKey key) const;
  uint32_t VertexOf(VertexIndex key) const;
  void EncodeBatch(const UpdateBatch& batch, const Follows& follows, ByteWriter& out);
  // Ends the record if there is no room in it for so many more.
  void MakeRoom(uint64_t updates, ByteWriter& out);
  // Fill targets_ and unwalked_; stars in the order of their vertices.
  void FindHoles(const UpdateBatch& batch, const Follows& follows);
  void FindStars(const UpdateBatch& batch, const Follows& follows);
  // Whether the client can find the node's hole by walking.
  bool CanWalkHole(const UpdateBatch& batch, uint32_t node, uint32_t anchor);
  uint32_t SplitEdge(const UpdateBatch& batch, const Node& node, const Patch::Hole& hole) const;
  // Ask for the memory that the insertion of a node will need.
  void PrefetchHole(const UpdateBatch& batch, uint32_t node) const;
  void PrefetchAround(const UpdateBatch& batch, uint32_t node) const;

  void FindFresh();
  // The slots of targets, and visit(group of them, i) for each.
  template <typename Visit>
  void EncodeAscending(NumberModel& gap, std::span<const Target> targets, Visit&& visit);
  void EncodeInsertions(const UpdateBatch& batch, std::span<const Target> targets);
  void EncodeRemovals(const UpdateBatch& batch, std::span<const Target> targets);
  void EncodeInsertion(const UpdateBatch& batch, Target target);
  void EncodeRemoval(const UpdateBatch& batch, Target target);
  void EncodeListed(const UpdateBatch& batch, const Node& node);
  const std::byte* RowOf(const UpdateBatch& batch, const Node& node) const {
    return batch.rows.data() + static_cast<size_t>(&node - batch.nodes.data()) * row_bytes_;
  }
  // Which remembered vertex the node's is, or kNone32.
  uint32_t RememberedSlot(const Node& node) const {
    return mesh_.remembered().empty() ? kNone32 : vertices_.Find(node.vertex);
  }
  std::span<const uint32_t> HoleSlots(const Node& node) const {
    return std::span(hole_slots_).subspan(node.hole_begin, node.ring_count - 2);
  }
  uint32_t PutVertex(const UpdateBatch& batch, const Node& node, uint32_t remembered);
  uint32_t AddVertex(VertexIndex key, Vec3i position, const std::byte* row);
  // Where the ring of a node has a vertex.
  uint32_t PlaceInRing(const UpdateBatch& batch, const Node& node, uint32_t vertex) const;
  void FinishInsertion(const UpdateBatch& batch, const Node& node, const UpdateHole& update,
                       uint32_t vertex);
  void FinishRemoval(const UpdateBatch& batch, const Node& node, const UpdateHole& update,
                     uint32_t vertex);

  // By the Delaunay rule, when all is there that it takes.
  bool EncodeByRule(std::span<const UpdateBatch> batches);

  DelaunayEncoder rule_;
  bool lawful_ = false;  // the client holds the whole cut, and the rule tells its triangles
  std::optional<WholeCut> whole_;  // while the client is clipped
  KeyTable triangles_;
  KeyTable vertices_;  // remembered ones included
  RansEncoder coder_;
  uint64_t record_updates_ = 0;  // in the record that is begun
  RecordCost cost_;              // likewise
  DropScratch drop_scratch_;
  UpdateHole update_;  // the one at hand
  FreshTriangles fresh_;
  FreshTriangles next_fresh_;
  // Of the batch at hand: its targets, those whose triangles have to be listed, the slots of its
  // holes.
  std::vector<Target> targets_;
  std::vector<uint32_t> unwalked_;
  std::vector<uint32_t> hole_slots_;
  std::vector<uint32_t> at_fresh_;  // by number in fresh_: the node whose anchor it is, or kNone32
  std::vector<uint32_t> slots_;
  std::vector<std::array<uint32_t, 3>> places_;
  // Of the removal at hand: the hole's triangle on the side of the least and the greatest corner.
  struct HoleAt {
    TriangleKey key = 0;
    uint32_t apex = 0;
  };
  std::array<std::array<HoleAt, kMaxRing>, kMaxRing> hole_at_;
};

}  // namespace mtdb::internal
