// SPDX-License-Identifier: Apache-2.0
// DelaunayEncoder: the sender's side of updates by the Delaunay rule. A cut by the rule follows
// from its vertices alone. So what travels is which vertices go and which come, in any order, and
// no connectivity.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "codecs/stream/encode/flat_map.h"
#include "codecs/stream/encode/sent_stream.h"
#include "codecs/stream/internal/delaunay_coder.h"
#include "codecs/stream/mesh_update.h"

namespace mtdb::internal {

class DelaunayEncoder {
 public:
  using Corners = std::array<VertexIndex, 3>;
  explicit DelaunayEncoder(SentStream& stream) : s_(stream) {}

  // Whether the client's mesh, which is the whole cut, is what the rule says.
  bool IsMeshLawful() const;
  // Notes what the batches change in all. Returns whether the cut after them is what the rule says,
  // as far as they change it; *keeps_border: and whether no border moves, so that Encode may do
  // it.
  bool Note(std::span<const UpdateBatch> batches, bool* keeps_border);
  // Sends what was noted; the mesh before and after it is lawful.
  void Encode(ByteWriter& out);
  // Forgets what was noted.
  void Clear();

 private:
  struct Coming {
    VertexIndex vertex = 0;
    Vec3i position;
    const std::byte* row = nullptr;
    std::array<VertexIndex, 2> near{};  // vertices of its ring
    uint32_t next = kNone32;            // in the same triangle
  };
  struct CornersHash {
    uint64_t operator()(const Corners& c) const {
      uint64_t h = 0;
      for (const VertexIndex v : c) h = NumberHash{}(h ^ h >> 32 ^ v);
      return h;
    }
  };
  // So many updates are coded in one piece.
  uint64_t section() const { return std::min<uint64_t>(1024, s_.max_updates); }
  static Corners Rotated(Corners c);
  Corners CornersOf(uint32_t slot) const;
  LatticePoint PlaceOf(VertexIndex vertex) const;
  void NoteNode(const UpdateBatch& batch, const UpdateBatch::Node& node);
  bool AreCreatedLawful() const;
  void Erase(uint32_t slot);
  void EncodeRemovals(ByteWriter& out);
  void EncodeRemoval(uint32_t vertex);
  void Locate();
  uint32_t TriangleAt(LatticePoint p, uint32_t start, std::array<VertexIndex, 2> near);
  uint32_t FirstOf(uint32_t slot) const { return slot < first_.size() ? first_[slot] : kNone32; }
  void Put(uint32_t slot, uint32_t coming);
  void EncodeInsertions(ByteWriter& out);
  uint32_t Nearest(uint32_t slot, const LatticeTriangle& t) const;
  void EncodeInsertion(uint32_t slot);
  void BeginSection(bool insert, size_t left, ByteWriter& out);
  void EncodeNamed(ByteWriter& out);
  void EncodeAsked(ByteWriter& out);

  SentStream& s_;
  DelaunaySweep sweep_;
  DelaunayWalk walk_;
  NearPlaces near_places_;
  DelaunayHole hole_;
  std::vector<std::array<uint32_t, 3>> filling_;
  std::vector<uint32_t> slots_;
  std::vector<Vec3i> ring_;
  std::vector<LatticePoint> spokes_;

  // What was noted.
  FlatMap<VertexIndex, Coming> coming_;
  FlatSet<VertexIndex> going_;
  FlatMap<VertexIndex, LatticePoint> seen_;  // vertices of all insertions
  FlatMap<TriangleKey, Corners> created_;
  FlatSet<TriangleKey> gone_;

  // Of the sending at hand.
  std::vector<Coming> list_;
  std::vector<uint32_t> first_;  // per triangle slot: in list_, or kNone32
  size_t left_ = 0;
  uint64_t first_born_ = 0;
  FlatMap<Corners, TriangleKey, CornersHash> keys_;
  std::vector<std::pair<uint32_t, uint64_t>> made_;  // slots, and when they were born
};

}  // namespace mtdb::internal
