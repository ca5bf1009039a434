// SPDX-License-Identifier: Apache-2.0
#include "codecs/stream/encode/batch_encoder.h"

#include <algorithm>
#include <utility>

#include "store/base/check.h"

namespace mtdb::internal {

uint32_t BatchEncoder::SplitEdge(const UpdateBatch& batch, const Node& node,
                                 const Patch::Hole& hole) const {
  const std::span<const VertexIndex> ring = batch.ring_of(node);
  const uint32_t last = s_.VertexOf(ring.back());
  const uint32_t first = s_.VertexOf(ring.front());
  for (uint32_t j = 0; j < hole.ring_count; ++j) {
    if (hole.ring[j] == last && hole.ring[j + 1 == hole.ring_count ? 0 : j + 1] == first) return j;
  }
  return kNone32;
}

void BatchEncoder::FindHoles(const UpdateBatch& batch, const Follows& follows) {
  constexpr size_t kAhead = 8;
  const size_t nodes = batch.nodes.size();
  const std::span<const UpdateBatch::HoleTriangle> holes = batch.holes;
  hole_slots_.resize(holes.size());
  for (size_t i = 0; i < holes.size(); ++i) {
    if (i + 2 * kAhead < holes.size()) s_.triangles.Prefetch(holes[i + 2 * kAhead].key);
    if (i + kAhead < holes.size()) s_.triangles.PrefetchPage(holes[i + kAhead].key);
    hole_slots_[i] = s_.triangles.Find(holes[i].key);
  }
  for (uint32_t n = 0; n < nodes; ++n) {
    if (n + kAhead < nodes) {
      for (const uint32_t slot : HoleSlots(batch.nodes[n + kAhead])) {
        if (slot != kNone32) s_.mesh.PrefetchTriangle(slot);
      }
    }
    if (batch.nodes[n].twin || (!follows.empty() && !follows[n])) continue;
    if (batch.EndOfUpdate(n) != n + 1) {
      unwalked_.push_back(n);
      continue;
    }
    uint32_t anchor = kNone32;
    uint64_t last_born = 0;
    for (const uint32_t slot : HoleSlots(batch.nodes[n])) {
      MTDB_CHECK(slot != kNone32, "an update names a triangle that the client does not have");
      const uint64_t born = s_.mesh.triangle(slot).born();
      anchor = born > last_born ? slot : anchor;
      last_born = std::max(last_born, born);
    }
    if (!CanWalkHole(batch, n, anchor)) {
      unwalked_.push_back(n);
      continue;
    }
    targets_.push_back({anchor, n});
  }
}

bool BatchEncoder::CanWalkHole(const UpdateBatch& batch, uint32_t n, uint32_t anchor) {
  const Node& node = batch.nodes[n];
  const std::span<const uint32_t> slots = HoleSlots(node);
  if (!node.boundary) {
    // The triangles of a disc with all its vertices on the ring form a tree.
    SmallSet set;
    for (const uint32_t slot : slots) set.Add(slot);
    size_t links = 0;
    for (const uint32_t slot : slots) {
      for (const uint32_t o : s_.mesh.triangle(slot).opposite) {
        links += o != kNone32 && set.MayHave(o >> 2) && Has(slots, o >> 2) ? 1 : 0;
      }
    }
    return links == 2 * (slots.size() - 1) && node.ring_count <= kMaxRing;
  }
  UpdateHole& update = update_;
  return WalkHole(s_.mesh, anchor, update,
                  [&](uint32_t, uint32_t slot, uint32_t) { return Has(slots, slot); }) &&
         update.hole.ring_count == node.ring_count && update.hole.slot_count == slots.size() &&
         SplitEdge(batch, node, update.hole) != kNone32;
}

void BatchEncoder::FindStars(const UpdateBatch& batch, const Follows& follows) {
  constexpr size_t kAhead = 8;
  const size_t nodes = batch.nodes.size();
  for (uint32_t n = 0; n < nodes; ++n) {
    if (n + 2 * kAhead < nodes) s_.vertices.Prefetch(batch.nodes[n + 2 * kAhead].vertex);
    if (n + kAhead < nodes) s_.vertices.PrefetchPage(batch.nodes[n + kAhead].vertex);
    if (batch.nodes[n].twin || (!follows.empty() && !follows[n])) continue;
    if (batch.EndOfUpdate(n) != n + 1) {
      unwalked_.push_back(n);
      continue;
    }
    targets_.push_back({s_.VertexOf(batch.nodes[n].vertex), n});
  }
  std::sort(targets_.begin(), targets_.end());
  slots_.clear();
  for (const Target target : targets_) slots_.push_back(target.at);
  size_t walked = 0;
  for (size_t i = 0; i < slots_.size(); ++i) {
    PrefetchStars(s_.mesh, slots_, i);
    const Target target = targets_[i];
    const Node& node = batch.nodes[target.node];
    UpdateHole& update = update_;
    if (WalkStar(s_.mesh, target.at, update) && update.hole.ring_count == node.ring_count &&
        update.boundary == node.boundary) {
      targets_[walked++] = target;
    } else {
      unwalked_.push_back(target.node);
    }
  }
  targets_.resize(walked);
}

uint32_t BatchEncoder::PutVertex(const UpdateBatch& batch, const Node& node, uint32_t remembered) {
  if (remembered != kNone32) {
    s_.RecallVertex(remembered);
    return remembered;
  }
  return s_.AddVertex(node.vertex, node.position, RowOf(batch, node));
}

void BatchEncoder::FinishInsertion(const UpdateBatch& batch, const Node& node,
                                   const UpdateHole& update, uint32_t vertex) {
  for (const uint32_t slot : update.hole.slot_span()) s_.EraseTriangle(slot);
  const size_t first = next_fresh_.size();
  InsertStar(s_.mesh, s_.models, update, vertex, &next_fresh_.slots());
  // The ring as it was walked is rotated.
  uint32_t place = PlaceInRing(batch, node, update.hole.ring[0]);
  for (size_t i = first; i < next_fresh_.size(); ++i) {
    s_.PutTriangle(node.first_star + place, next_fresh_.slot(i));
    place = place + 1 == node.ring_count ? 0 : place + 1;
  }
}

uint32_t BatchEncoder::PlaceInRing(const UpdateBatch& batch, const Node& node,
                                   uint32_t vertex) const {
  const std::span<const VertexIndex> ring = batch.ring_of(node);
  const auto at = std::find(ring.begin(), ring.end(), s_.vertices.key(vertex)) - ring.begin();
  MTDB_CHECK(static_cast<uint32_t>(at) < node.ring_count, "an update has another ring");
  return static_cast<uint32_t>(at);
}

void BatchEncoder::EncodeInsertion(const UpdateBatch& batch, Target target) {
  const Node& node = batch.nodes[target.node];
  const std::span<const uint32_t> slots = HoleSlots(node);
  UpdateHole& update = update_;
  uint32_t remembered = RememberedSlot(node);
  bool again = false;
  if (const uint32_t fills = s_.mesh.triangle(target.at).fills; s_.mesh.is_remembered(fills)) {
    again = fills == remembered && WalkAgain(s_.mesh, target.at, fills, update) &&
            update.hole.ring_count == node.ring_count && update.boundary == node.boundary;
    for (const uint32_t slot : update.hole.slot_span()) again &= Has(slots, slot);
    s_.coder.Bit(s_.models.again, again);
  }
  if (!again) {
    const UpdateShapes shapes(s_.mesh, s_.models);
    const uint64_t born = s_.mesh.triangle(target.at).born();
    const bool walked =
        WalkHole(s_.mesh, target.at, update, [&](uint32_t count, uint32_t slot, uint32_t h) {
          if (s_.mesh.triangle(slot).born() > born) return false;
          return s_.models.topology.CodeTake(s_.coder, count, shapes.Shape(h), Has(slots, slot));
        });
    MTDB_CHECK(walked && update.hole.ring_count == node.ring_count, "an update has no hole");
    const uint32_t split = node.boundary ? SplitEdge(batch, node, update.hole) : kNone32;
    CodeSplitEdge(s_.coder, s_.models.topology, update.hole, split);
    update.boundary = node.boundary;
    if (node.boundary) update.hole.Rotate(split);
    const std::span<const uint32_t> all = s_.mesh.remembered();
    if (!all.empty() && s_.coder.Bit(s_.models.known, remembered != kNone32)) {
      const auto place = std::find(all.begin(), all.end(), remembered) - all.begin();
      s_.coder.Raw(std::bit_width(all.size() - 1), static_cast<uint32_t>(place));
    } else {
      Vec3i p = node.position;
      CodePosition(s_.coder, s_.models, s_.mesh, update, p);
      if (s_.row_bytes != 0) {
        s_.models.attribute_coder.Encode(s_.coder, AttributeStar(s_.mesh, update, p, &ring_),
                                         s_.mesh.rows(), RowOf(batch, node));
      }
    }
  }
  FinishInsertion(batch, node, update, PutVertex(batch, node, remembered));
}

[[gnu::always_inline]] inline void BatchEncoder::PrefetchHole(const UpdateBatch& batch,
                                                              uint32_t n) const {
  const Node& node = batch.nodes[n];
  for (const uint32_t slot : HoleSlots(node)) {
    s_.mesh.PrefetchTriangle(slot);
    s_.triangles.PrefetchPlace(slot);
  }
  s_.triangles.Prefetch(node.first_star);
  s_.vertices.Prefetch(node.vertex);
}

[[gnu::always_inline]] inline void BatchEncoder::PrefetchAround(const UpdateBatch& batch,
                                                                uint32_t n) const {
  const Node& node = batch.nodes[n];
  __builtin_prefetch(&batch.ring[node.ring_begin]);
  for (const uint32_t slot : HoleSlots(node)) {
    s_.mesh.PrefetchBeyond(slot);
    s_.mesh.PrefetchCorners(slot);
    s_.triangles.PrefetchPlacePage(slot);
  }
  s_.triangles.PrefetchPage(node.first_star);
  s_.vertices.PrefetchPage(node.vertex);
}

// When all anchors of the batch are among the triangles that the last one made, at_fresh_ tells
// which ones; else it is empty.
void BatchEncoder::FindFresh() {
  at_fresh_.clear();
  if (fresh_.size() >= 32 * targets_.size() || targets_.size() > s_.max_updates) return;
  at_fresh_.assign(fresh_.size(), kNone32);
  for (const Target target : targets_) {
    const uint64_t i = fresh_.NumberOf(s_.mesh.triangle(target.at).born());
    if (i >= fresh_.size()) {
      at_fresh_.clear();
      return;
    }
    at_fresh_[i] = target.node;
  }
}

template <typename Visit>
void BatchEncoder::EncodeAscending(NumberModel& gap, std::span<const Target> targets,
                                   Visit&& visit) {
  std::array<uint32_t, kSlotGroup> slots{};
  uint64_t next = 0;
  for (; !targets.empty(); targets = targets.subspan(std::min(targets.size(), kSlotGroup))) {
    const auto group = targets.first(std::min(targets.size(), kSlotGroup));
    for (size_t i = 0; i < group.size(); ++i) slots[i] = group[i].at;
    CodeSlots(s_.coder, gap, next, std::span(slots).first(group.size()));
    for (size_t i = 0; i < group.size(); ++i) visit(group, i);
  }
}

void BatchEncoder::EncodeInsertions(const UpdateBatch& batch, std::span<const Target> targets) {
  const bool fresh = !at_fresh_.empty();
  next_fresh_.Clear(s_.mesh);
  s_.coder.Bit(s_.models.more, true);
  s_.coder.Bit(s_.models.other, false);
  s_.coder.Bit(s_.models.insert, true);
  s_.coder.Bit(s_.models.fresh, fresh);
  CodeNumber(s_.coder, s_.models.count, static_cast<uint32_t>(targets.size()));
  if (fresh) {
    constexpr size_t kAhead = FreshTriangles::kAhead;
    const auto soon = [&](size_t i, auto&& prefetch) {
      if (i < at_fresh_.size() && at_fresh_[i] != kNone32) prefetch(at_fresh_[i]);
    };
    // The first of the ring.
    const auto first_corner = [&](size_t i) { return s_.mesh.triangle(fresh_.slot(i)).corners[0]; };
    size_t left = targets.size();
    for (size_t i = 0; left > 0; ++i) {
      fresh_.Prefetch(s_.mesh, i);
      soon(i + 4 * kAhead, [&](uint32_t n) { __builtin_prefetch(&batch.nodes[n]); });
      soon(i + 3 * kAhead,
           [&](uint32_t n) { __builtin_prefetch(hole_slots_.data() + batch.nodes[n].hole_begin); });
      soon(i + 2 * kAhead, [&](uint32_t n) { PrefetchHole(batch, n); });
      soon(i + kAhead, [&](uint32_t n) {
        PrefetchAround(batch, n);
        s_.vertices.PrefetchPlace(first_corner(i + kAhead));
      });
      soon(i + kAhead / 2,
           [&](uint32_t) { s_.vertices.PrefetchPlacePage(first_corner(i + kAhead / 2)); });
      const uint32_t slot = fresh_.slot(i);
      if (!fresh_.IsThere(s_.mesh, i)) continue;
      const Patch::Triangle view = UpdateShapes(s_.mesh, s_.models).AnchorView(slot);
      if (!s_.models.topology.CodeAnchor(s_.coder, view, 1, at_fresh_[i] != kNone32)) continue;
      EncodeInsertion(batch, {slot, at_fresh_[i]});
      --left;
    }
  } else {
    constexpr size_t kAhead = 4;
    EncodeAscending(s_.models.anchor_gap, targets, [&](std::span<const Target> group, size_t i) {
      if (i + 2 * kAhead < group.size()) PrefetchHole(batch, group[i + 2 * kAhead].node);
      if (i + kAhead < group.size()) PrefetchAround(batch, group[i + kAhead].node);
      EncodeInsertion(batch, group[i]);
    });
  }
  std::swap(fresh_, next_fresh_);
}

void BatchEncoder::FinishRemoval(const UpdateBatch& batch, const Node& node,
                                 const UpdateHole& update, uint32_t vertex) {
  // Places in the ring as the client walks it -> the hole's triangles, by their outer corners.
  const std::span<const uint32_t> walked = update.hole.ring_span();
  std::array<uint32_t, kMaxRing> place;
  uint32_t i = PlaceInRing(batch, node, walked[0]);
  for (uint32_t j = 0; j < walked.size(); ++j) {
    place[i] = j;
    i = i + 1 == node.ring_count ? 0 : i + 1;
  }
  for (const auto& t : batch.hole_of(node)) {
    std::array<uint32_t, 3> c = {place[t.corners[0]], place[t.corners[1]], place[t.corners[2]]};
    std::sort(c.begin(), c.end());
    hole_at_[c[0]][c[2]] = {t.key, c[1]};
  }
  CodePolygon(
      s_.coder, s_.models, s_.mesh, walked,
      [&](uint32_t a, uint32_t b) { return hole_at_[a][b].apex; }, places_);
  for (const uint32_t slot : update.hole.slot_span()) s_.EraseTriangle(slot);
  slots_.clear();
  RemoveStar(s_.mesh, update, vertex, places_, &slots_);
  for (size_t t = 0; t < slots_.size(); ++t) {
    s_.PutTriangle(hole_at_[places_[t][0]][places_[t][2]].key, slots_[t]);
  }
}

void BatchEncoder::ForgetVertex(uint32_t vertex, uint32_t first_of_ring) {
  if (const uint32_t lost = s_.mesh.Forget(vertex, first_of_ring); lost != kNone32) {
    s_.vertices.Erase(lost);
  }
}

void BatchEncoder::EncodeRemoval(const UpdateBatch& batch, Target target) {
  UpdateHole& update = update_;
  WalkStar(s_.mesh, target.at, update);
  FinishRemoval(batch, batch.nodes[target.node], update, target.at);
  ForgetVertex(target.at, FirstOfRing(update));
}

void BatchEncoder::EncodeRemovals(const UpdateBatch& batch, std::span<const Target> targets) {
  s_.coder.Bit(s_.models.more, true);
  s_.coder.Bit(s_.models.other, false);
  s_.coder.Bit(s_.models.insert, false);
  CodeNumber(s_.coder, s_.models.count, static_cast<uint32_t>(targets.size()));
  EncodeAscending(s_.models.vertex_gap, targets,
                  [&](std::span<const Target> group, size_t i) { EncodeRemoval(batch, group[i]); });
}

void BatchEncoder::Encode(const UpdateBatch& batch, const Follows& follows, ByteWriter& out) {
  targets_.clear();
  unwalked_.clear();
  if (batch.insert) {
    FindHoles(batch, follows);
    FindFresh();
    if (at_fresh_.empty()) std::sort(targets_.begin(), targets_.end());
  } else {
    FindStars(batch, follows);
  }
  for (std::span<const Target> left = targets_; !left.empty();) {
    const auto targets = left.first(std::min<size_t>(left.size(), s_.max_updates));
    left = left.subspan(targets.size());
    s_.MakeRoom(targets.size(), out);
    s_.cost.AddUpdates(targets.size());
    if (batch.insert) {
      EncodeInsertions(batch, targets);
    } else {
      EncodeRemovals(batch, targets);
    }
  }
  for (const uint32_t node : unwalked_) {
    const uint64_t holes = batch.EndOfUpdate(node) - node;
    s_.MakeRoom(holes, out);
    s_.cost.AddUpdates(holes);
    EncodeListed(batch, node);
  }
  for (size_t i = 0; i < batch.crumbs.size(); ++i) {
    if (!follows.empty() && !follows[batch.nodes.size() + i]) continue;
    s_.MakeRoom(1, out);
    s_.cost.AddUpdates(1);
    EncodeCrumb(batch.insert, batch.crumbs[i]);
  }
}

// Sets update_ to the ring, and to the triangles that the node removes.
void BatchEncoder::ListTriangles(const UpdateBatch& batch, const Node& node) {
  UpdateHole& update = update_;
  Patch::Hole& hole = update.hole;
  hole.ring_count = hole.slot_count = 0;
  update.listed = true;
  update.boundary = node.boundary;
  for (const VertexIndex v : batch.ring_of(node)) hole.ring[hole.ring_count++] = s_.VertexOf(v);
  if (batch.insert) {
    for (const auto& t : batch.hole_of(node)) hole.slots[hole.slot_count++] = s_.TriangleOf(t.key);
  } else {
    for (uint32_t j = 0; j < UpdateBatch::StarCount(node); ++j) {
      hole.slots[hole.slot_count++] = s_.TriangleOf(node.first_star + j);
    }
  }
}

void BatchEncoder::EncodeLists(const UpdateBatch& batch, const Node& node) {
  ListTriangles(batch, node);
  const Patch::Hole& hole = update_.hole;
  s_.coder.Raw(6, hole.ring_count);
  for (const uint32_t v : hole.ring_span()) s_.coder.Raw(32, v);
  for (const uint32_t slot : hole.slot_span()) s_.coder.Raw(32, slot);
}

void BatchEncoder::BeginListed(bool insert) {
  ++listed_;
  s_.coder.Bit(s_.models.more, true);
  s_.coder.Bit(s_.models.other, true);
  s_.coder.Bit(s_.models.clip, false);
  if (s_.options.delaunay) s_.coder.Bit(s_.models.delaunay.ruled, false);
  s_.coder.Bit(s_.models.insert, insert);
}

uint32_t BatchEncoder::EncodeListedVertex(VertexIndex vertex, Vec3i position,
                                          const std::byte* row) {
  const uint32_t remembered = RememberedSlot(vertex);
  s_.coder.Raw(32, remembered);
  if (remembered != kNone32) {
    s_.RecallVertex(remembered);
    return remembered;
  }
  for (int i = 0; i < 3; ++i) s_.coder.Raw(32, static_cast<uint32_t>(position[i]));
  for (size_t i = 0; i < s_.row_bytes; ++i) s_.coder.Raw(8, static_cast<uint32_t>(row[i]));
  return s_.AddVertex(vertex, position, row);
}

// The client need not know of triangles that only get other keys.
void BatchEncoder::EncodeCrumb(bool insert, const UpdateBatch::Crumb& crumb) {
  BeginListed(insert);
  s_.coder.Raw(5, 0);
  if (insert) {
    InsertCrumb(crumb);
  } else {
    slots_.clear();
    s_.coder.Raw(6, static_cast<uint32_t>(crumb.keys.size()));
    for (const TriangleKey key : crumb.keys) {
      slots_.push_back(s_.TriangleOf(key));
      s_.coder.Raw(32, slots_.back());
      s_.EraseTriangle(slots_.back());
      s_.cost.AddAttached();
    }
    std::vector<uint32_t> left_over;
    s_.mesh.Drop(slots_, &left_over);
    for (const uint32_t vertex : left_over) ForgetVertex(vertex, kNone32);
  }
  for (const UpdateBatch::Crumb::Renamed& renamed : crumb.renamed) {
    const uint32_t slot = s_.TriangleOf(insert ? renamed.without : renamed.with);
    s_.EraseTriangle(slot);
    s_.PutTriangle(insert ? renamed.with : renamed.without, slot);
  }
}

void BatchEncoder::InsertCrumb(const UpdateBatch::Crumb& crumb) {
  s_.coder.Raw(7, static_cast<uint32_t>(crumb.vertices.size()));
  for (size_t v = 0; v < crumb.vertices.size(); ++v) {
    EncodeListedVertex(crumb.vertices[v], crumb.positions[v], crumb.rows.data() + v * s_.row_bytes);
  }
  s_.coder.Raw(6, static_cast<uint32_t>(crumb.triangles.size()));
  for (size_t t = 0; t < crumb.triangles.size(); ++t) {
    std::array<uint32_t, 3> corners;
    for (size_t c = 0; c < 3; ++c) {
      corners[c] = s_.VertexOf(crumb.triangles[t][c]);
      s_.coder.Raw(32, corners[c]);
    }
    s_.cost.AddAttached();
    s_.PutTriangle(crumb.keys[t], s_.mesh.Attach(corners));
  }
}

// An update whose triangles the client cannot find by walking: where edges are non-manifold.
void BatchEncoder::EncodeListed(const UpdateBatch& batch, uint32_t first) {
  BeginListed(batch.insert);
  const auto nodes = std::span(batch.nodes).subspan(first, batch.EndOfUpdate(first) - first);
  const Node& node = nodes.front();
  s_.coder.Raw(5, static_cast<uint32_t>(nodes.size()));
  s_.coder.Raw(1, node.boundary ? 1 : 0);
  for (const Node& n : nodes) EncodeLists(batch, n);
  if (!batch.insert) {
    const uint32_t vertex = s_.VertexOf(node.vertex);
    s_.coder.Raw(32, vertex);
    for (const Node& n : nodes) {
      if (nodes.size() > 1) ListTriangles(batch, n);
      FinishRemoval(batch, n, update_, vertex);
    }
    ForgetVertex(vertex, nodes.size() > 1 ? kNone32 : FirstOfRing(update_));
    return;
  }
  const uint32_t vertex = EncodeListedVertex(node.vertex, node.position, RowOf(batch, node));
  for (const Node& n : nodes) {
    if (nodes.size() > 1) ListTriangles(batch, n);
    FinishInsertion(batch, n, update_, vertex);
  }
  next_fresh_.Clear(s_.mesh);
}

void BatchEncoder::ForgetBatch() {
  targets_ = {};
  hole_slots_ = {};
  at_fresh_ = {};
}

}  // namespace mtdb::internal
