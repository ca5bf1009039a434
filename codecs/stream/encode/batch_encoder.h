// SPDX-License-Identifier: Apache-2.0
// BatchEncoder: codes updates whose holes and stars the client finds by walking, or which list
// them.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "codecs/stream/encode/sent_stream.h"

namespace mtdb::internal {

class BatchEncoder {
 public:
  // Which nodes of a batch, then crumbs, the client follows; empty: all.
  using Follows = std::vector<bool>;

  explicit BatchEncoder(SentStream& stream) : s_(stream) {}

  void Encode(const UpdateBatch& batch, const Follows& follows, ByteWriter& out);
  // Gives back the memory that batches took.
  void ForgetBatch();
  uint64_t listed() const { return listed_; }
  size_t memory_bytes() const {
    return fresh_.memory_bytes() + next_fresh_.memory_bytes() + CapacityBytes(slots_);
  }

 private:
  using Node = UpdateBatch::Node;
  // A node of a batch whose hole (star) the client finds by walking.
  struct Target {
    uint32_t at;  // the anchor's slot, or the vertex's
    uint32_t node;
    friend auto operator<=>(const Target&, const Target&) = default;
  };

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
  // An update of several holes is listed by its first node.
  void EncodeListed(const UpdateBatch& batch, uint32_t first);
  void EncodeLists(const UpdateBatch& batch, const Node& node);
  void BeginListed(bool insert);
  void EncodeCrumb(bool insert, const UpdateBatch::Crumb& crumb);
  void InsertCrumb(const UpdateBatch::Crumb& crumb);
  // Of a vertex that a listed insertion brings: which one it is, and what travels with it.
  uint32_t EncodeListedVertex(VertexIndex vertex, Vec3i position, const std::byte* row);
  void ListTriangles(const UpdateBatch& batch, const Node& node);
  const std::byte* RowOf(const UpdateBatch& batch, const Node& node) const {
    return batch.rows.data() + static_cast<size_t>(&node - batch.nodes.data()) * s_.row_bytes;
  }
  // Which remembered vertex the node's is, or kNone32.
  uint32_t RememberedSlot(const Node& node) const { return RememberedSlot(node.vertex); }
  uint32_t RememberedSlot(VertexIndex vertex) const {
    return s_.mesh.remembered().empty() ? kNone32 : s_.vertices.Find(vertex);
  }
  std::span<const uint32_t> HoleSlots(const Node& node) const {
    return std::span(hole_slots_).subspan(node.hole_begin, node.ring_count - 2);
  }
  uint32_t PutVertex(const UpdateBatch& batch, const Node& node, uint32_t remembered);
  // Where the ring of a node has a vertex.
  uint32_t PlaceInRing(const UpdateBatch& batch, const Node& node, uint32_t vertex) const;
  void FinishInsertion(const UpdateBatch& batch, const Node& node, const UpdateHole& update,
                       uint32_t vertex);
  void FinishRemoval(const UpdateBatch& batch, const Node& node, const UpdateHole& update,
                     uint32_t vertex);
  void ForgetVertex(uint32_t vertex, uint32_t first_of_ring);

  SentStream& s_;
  std::vector<Vec3i> ring_;  // positions around the vertex at hand
  uint64_t listed_ = 0;
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
