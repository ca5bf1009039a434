// SPDX-License-Identifier: Apache-2.0
#include "query/moving/update_batches.h"

#include <algorithm>
#include <array>
#include <span>
#include <utility>

#include "query/cut/fetch_nodes.h"

namespace mtdb::internal {

void UpdateBatches::AddUnit(UnitId unit, const Bits& from, const Bits& to) {
  const uint32_t count = from.empty() ? to.Count() : to.CountWithout(from.words());
  if (count == 0) return;
  Bits changes = to;
  if (!from.empty()) changes.RemoveAll(from.words());
  Unit& u = units_.emplace_back();
  u.unit = unit;
  u.before = changes.Ranks();
  u.changes = std::move(changes);
  u.levels.resize(count);
  count_ += count;
}

Status UpdateBatches::Collect(const GetUnit& get, std::vector<UpdateBatch>* batches) {
  const size_t first = batches->size();
  // Parents have the larger numbers.
  std::sort(units_.begin(), units_.end(), [&](const Unit& a, const Unit& b) {
    return insert_ ? a.unit > b.unit : a.unit < b.unit;
  });
  for (Unit& u : units_) {
    MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, get(u.unit));
    nodes_.clear();
    u.changes.ForEach([&](NodeIndex node) { nodes_.push_back(node); });
    if (!insert_) std::reverse(nodes_.begin(), nodes_.end());
    FindLevels(u, *unit);
    PrefetchShapes(*unit);
    std::span<const NodeIndex> creators = creators_;
    for (size_t n = 0; n < nodes_.size(); ++n) {
      // A further number of a node that brings a crumb.
      if (unit->cluster.hole(nodes_[n]).empty()) continue;
      const size_t batch = first + u.levels[LevelPlace(n)];
      while (batches->size() <= batch) {
        batches->emplace_back().insert = insert_;
        if (batches->size() == first + 1) Reserve(batches->back());
      }
      const size_t holes = unit->cluster.hole(nodes_[n]).size();
      AddNode(*unit, nodes_[n], creators.first(holes), (*batches)[batch]);
      creators = creators.subspan(holes);
    }
  }
  return Status::Ok();
}

// On the way it asks for what AddNode will read.
void UpdateBatches::FindLevels(Unit& u, const LoadedUnit& unit) {
  parents_.clear();
  for (const UnitId p : unit.parents) {
    const auto at = std::lower_bound(
        units_.begin(), units_.end(), p,
        [&](const Unit& a, UnitId id) { return insert_ ? a.unit > id : a.unit < id; });
    parents_.push_back(at != units_.end() && at->unit == p ? &*at : nullptr);
  }
  const CompactCluster& cluster = unit.cluster;
  const uint32_t first_own = unit.first_own_slot();
  size_t n = 0;
  creators_.clear();
  ForEachFetched(unit, nodes_, Fetch::kStars, [&](NodeIndex node) {
    uint32_t& level = u.levels[LevelPlace(n++)];
    __builtin_prefetch(&cluster.ring_begin[node]);
    for (const uint32_t slot : cluster.hole(node)) {
      uint32_t* parent = nullptr;
      creators_.push_back(slot >= first_own ? unit.creator(slot) : 0);
      if (slot >= first_own) {
        __builtin_prefetch(&cluster.ring_begin[creators_.back()]);
        parent = Level(&u, creators_.back());
      } else {
        __builtin_prefetch(&cluster.triangles[slot]);
        if (const SlotOrigin& origin = unit.origins[slot]; origin.creator() != kNone32) {
          parent = Level(parents_[origin.parent], origin.creator());
        }
      }
      if (parent == nullptr) continue;
      uint32_t& later = insert_ ? level : *parent;
      later = std::max(later, (insert_ ? *parent : level) + 1);
    }
  });
}

void UpdateBatches::PrefetchShapes(const LoadedUnit& unit) const {
  const CompactCluster& cluster = unit.cluster;
  for (const NodeIndex node : nodes_) {
    __builtin_prefetch(cluster.ring_vertices.data() + cluster.ring_begin[node]);
    cluster.positions.Prefetch(cluster.external_vertices() + node);
  }
  for (const NodeIndex creator : creators_) {
    __builtin_prefetch(cluster.ring_vertices.data() + cluster.ring_begin[creator]);
  }
  for (const NodeIndex node : nodes_) {
    for (const uint32_t v : cluster.ring(node)) {
      if (v < cluster.external_vertices()) __builtin_prefetch(&cluster.vertices[v]);
    }
  }
}

void UpdateBatches::Reserve(UpdateBatch& batch) const {
  constexpr uint64_t kRing = 6;
  batch.nodes.reserve(count_);
  batch.ring.reserve(count_ * kRing);
  batch.holes.reserve(count_ * (kRing - 2));
  batch.rows.reserve(count_ * row_bytes_);
}

void UpdateBatches::AddNode(const LoadedUnit& unit, NodeIndex node,
                            std::span<const NodeIndex> creators, UpdateBatch& batch) const {
  const CompactCluster& c = unit.cluster;
  if (c.crumb(node)) return AddCrumb(unit, node, batch);
  if (!c.has_later_fans(node)) {
    AddHole(unit, node, {c.star_begin[node], c.star_begin[node + 1]}, c.ring(node), c.hole(node),
            creators, batch);
    return;
  }
  const size_t first = batch.nodes.size();
  size_t done = 0;  // of the hole's triangles
  std::vector<LocalNumber> ring;
  c.ForEachFan(node, [&](IndexRange star) {
    ring.clear();
    for (const uint32_t slot : star) {
      const std::array<uint32_t, 3> corners = c.created_triangle(node, slot);
      if (ring.empty()) ring.push_back(static_cast<LocalNumber>(corners[1]));
      ring.push_back(static_cast<LocalNumber>(corners[2]));
    }
    if (ring.front() == ring.back()) ring.pop_back();  // it is closed
    const size_t count = ring.size() - 2;
    const bool twin = batch.nodes.size() > first;
    AddHole(unit, node, star, ring, c.hole(node).subspan(done, count),
            creators.subspan(done, count), batch);
    batch.nodes.back().twin = twin;
    done += count;
  });
}

// The first triangles of its star are those of its hole.
void UpdateBatches::AddCrumb(const LoadedUnit& unit, NodeIndex node, UpdateBatch& batch) const {
  const CompactCluster& c = unit.cluster;
  const uint32_t external = c.external_vertices();
  const VertexIndex first_vertex = index_.first_vertex(unit.id);
  UpdateBatch::Crumb& crumb = batch.crumbs.emplace_back();
  for (const uint32_t v : c.created_vertices(node)) {
    crumb.vertices.push_back(first_vertex + (v - external));
    crumb.positions.push_back(c.position(v));
    const auto row = c.rows.begin() + static_cast<std::ptrdiff_t>(v * row_bytes_);
    crumb.rows.insert(crumb.rows.end(), row, row + static_cast<std::ptrdiff_t>(row_bytes_));
  }
  uint32_t slot = c.star_begin[node];
  for (const uint32_t trigger : c.hole(node)) {
    TriangleKey key = TriangleKeyOf(unit.id, trigger);
    if (trigger < unit.first_own_slot()) {
      const SlotOrigin& origin = unit.origins[trigger];
      key = TriangleKeyOf(unit.parents[origin.parent], origin.slot);
    }
    crumb.renamed.push_back({key, TriangleKeyOf(unit.id, slot++)});
  }
  for (; slot < c.star_begin[node + 1]; ++slot) {
    crumb.keys.push_back(TriangleKeyOf(unit.id, slot));
    std::array<VertexIndex, 3>& corners = crumb.triangles.emplace_back();
    const std::array<uint32_t, 3> local = c.created_triangle(node, slot);
    for (size_t i = 0; i < 3; ++i) {
      corners[i] =
          local[i] < external ? c.vertices[local[i]] : first_vertex + (local[i] - external);
    }
  }
}

// `star`: the slots of one fan of the node, around the hole of these slots.
void UpdateBatches::AddHole(const LoadedUnit& unit, NodeIndex node, IndexRange star,
                            std::span<const LocalNumber> ring, std::span<const LocalNumber> hole,
                            std::span<const NodeIndex> creators, UpdateBatch& batch) const {
  const CompactCluster& c = unit.cluster;
  const uint32_t external = c.external_vertices();
  const VertexIndex first_vertex = index_.first_vertex(unit.id);
  const uint32_t local = external + node;
  UpdateBatch::Node& out = batch.nodes.emplace_back();
  out.vertex = first_vertex + node;
  out.position = c.position(local);
  out.boundary = star.size() < ring.size();
  out.first_star = TriangleKeyOf(unit.id, star.front());
  out.ring_begin = static_cast<uint32_t>(batch.ring.size());
  out.ring_count = static_cast<uint32_t>(ring.size());
  batch.ring.resize(batch.ring.size() + ring.size());
  std::transform(ring.begin(), ring.end(), batch.ring.begin() + out.ring_begin, [&](uint32_t v) {
    return v < external ? c.vertices[v] : first_vertex + (v - external);
  });
  out.hole_begin = static_cast<uint32_t>(batch.holes.size());
  batch.holes.resize(batch.holes.size() + hole.size());
  for (size_t h = 0; h < hole.size(); ++h) {
    const uint32_t slot = hole[h];
    UpdateBatch::HoleTriangle& t = batch.holes[out.hole_begin + h];
    const bool own = slot >= unit.first_own_slot();
    if (own) {
      t.key = TriangleKeyOf(unit.id, slot);
    } else {
      t.key = TriangleKeyOf(unit.parents[unit.origins[slot].parent], unit.origins[slot].slot);
    }
    const std::array<uint32_t, 3> corners = unit.corners(slot, creators[h]);
    // All of the ring each time: no branch to guess.
    for (uint8_t at = 0; at < ring.size(); ++at) {
      for (size_t i = 0; i < 3; ++i) {
        if (ring[at] == corners[i]) t.corners[i] = at;
      }
    }
  }
  if (row_bytes_ == 0) return;
  const auto row = c.rows.begin() + static_cast<std::ptrdiff_t>(local * row_bytes_);
  batch.rows.insert(batch.rows.end(), row, row + static_cast<std::ptrdiff_t>(row_bytes_));
}

}  // namespace mtdb::internal
