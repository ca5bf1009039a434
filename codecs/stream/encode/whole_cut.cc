// SPDX-License-Identifier: Apache-2.0
#include "codecs/stream/encode/whole_cut.h"

#include <algorithm>
#include <unordered_map>

#include "codecs/stream/internal/memory_bytes.h"
#include "store/base/check.h"

namespace mtdb::internal {

void SetChange(UpdateChange& change, const UpdateBatch& batch, size_t first) {
  std::vector<TriangleKey>& star = batch.insert ? change.created : change.removed;
  std::vector<TriangleKey>& hole = batch.insert ? change.removed : change.created;
  star.clear();
  hole.clear();
  change.corners.clear();
  for (size_t i = first; i < batch.EndOfUpdate(first); ++i) {
    const UpdateBatch::Node& node = batch.nodes[i];
    const std::span<const VertexIndex> ring = batch.ring_of(node);
    for (uint32_t j = 0; j < UpdateBatch::StarCount(node); ++j) {
      star.push_back(node.first_star + j);
      if (batch.insert) {
        change.corners.push_back({node.vertex, ring[j], ring[j + 1 == ring.size() ? 0 : j + 1]});
      }
    }
    for (const UpdateBatch::HoleTriangle& t : batch.hole_of(node)) {
      hole.push_back(t.key);
      if (batch.insert) continue;
      change.corners.push_back({ring[t.corners[0]], ring[t.corners[1]], ring[t.corners[2]]});
    }
  }
}

void SetCrumbChange(UpdateChange& change, bool insert, const UpdateBatch::Crumb& crumb) {
  std::vector<TriangleKey>& with = insert ? change.created : change.removed;
  std::vector<TriangleKey>& without = insert ? change.removed : change.created;
  with = crumb.keys;
  without.clear();
  for (const UpdateBatch::Crumb::Renamed& renamed : crumb.renamed) {
    without.push_back(renamed.without);
    with.push_back(renamed.with);
  }
  change.corners.clear();
}

WholeCut::WholeCut(const ClientMeshOptions& options, const BaseMesh& base)
    : mesh_({options.grid, options.attributes, 0}, false), client_(base.triangles.size(), kNone32) {
  mesh_.Start({}, base.positions, base.rows, base.triangles);
  for (uint32_t t = 0; t < base.triangle_keys.size(); ++t) triangles_.Put(base.triangle_keys[t], t);
  for (uint32_t v = 0; v < base.vertices.size(); ++v) vertices_.Put(base.vertices[v], v);
}

void WholeCut::Link(TriangleKey key, uint32_t client_slot) {
  const uint32_t slot = triangles_.Find(key);
  if (client_slot >= held_.size()) held_.resize(client_slot + size_t{1});
  held_[client_slot] = {key, slot};
  if (slot != kNone32) client_[slot] = client_slot;
}

void WholeCut::Unlink(uint32_t client_slot) {
  Held& held = held_[client_slot];
  if (held.whole != kNone32) client_[held.whole] = kNone32;
  held.whole = kNone32;
}

uint32_t WholeCut::Take(TriangleKey key) {
  const uint32_t slot = triangles_.Find(key);
  MTDB_CHECK(slot != kNone32, "an update names a triangle that the cut does not have");
  if (client_[slot] != kNone32) held_[client_[slot]].whole = kNone32;
  client_[slot] = kNone32;
  triangles_.Erase(slot);
  return slot;
}

void WholeCut::Apply(bool insert, const UpdateBatch::Crumb& crumb) {
  const size_t row_bytes = mesh_.options().attributes.row_bytes();
  for (const UpdateBatch::Crumb::Renamed& renamed : crumb.renamed) {
    const uint32_t slot = Take(insert ? renamed.without : renamed.with);
    triangles_.Put(insert ? renamed.with : renamed.without, slot);
  }
  if (!insert) {
    std::vector<uint32_t> slots, left_over;
    for (const TriangleKey key : crumb.keys) slots.push_back(Take(key));
    mesh_.Drop(slots, &left_over);
    for (const uint32_t vertex : left_over) {
      mesh_.Forget(vertex, kNone32);
      vertices_.Erase(vertex);
    }
    return;
  }
  for (size_t v = 0; v < crumb.vertices.size(); ++v) {
    vertices_.Put(crumb.vertices[v],
                  mesh_.AddVertex(crumb.positions[v], crumb.rows.data() + v * row_bytes));
  }
  for (size_t t = 0; t < crumb.triangles.size(); ++t) {
    std::array<uint32_t, 3> corners;
    for (size_t c = 0; c < 3; ++c) corners[c] = vertices_.Find(crumb.triangles[t][c]);
    const uint32_t slot = mesh_.Attach(corners);
    client_.resize(mesh_.triangle_slots(), kNone32);
    triangles_.Put(crumb.keys[t], slot);
  }
}

void WholeCut::Apply(const UpdateBatch& batch) {
  for (const UpdateBatch::Crumb& crumb : batch.crumbs) Apply(batch.insert, crumb);
  UpdateChange change;
  std::vector<uint32_t> removed;
  std::vector<uint32_t> slots;
  std::vector<std::array<uint32_t, 3>> created;
  const size_t row_bytes = mesh_.options().attributes.row_bytes();
  for (size_t i = 0; i < batch.nodes.size(); i = batch.EndOfUpdate(i)) {
    const UpdateBatch::Node& node = batch.nodes[i];
    SetChange(change, batch, i);
    if (batch.insert) {
      const uint32_t vertex = mesh_.AddVertex(node.position, batch.rows.data() + i * row_bytes);
      vertices_.Put(node.vertex, vertex);
    }
    removed.clear();
    for (const TriangleKey key : change.removed) removed.push_back(Take(key));
    created.clear();
    for (const auto& corners : change.corners) {
      auto& c = created.emplace_back();
      for (size_t k = 0; k < 3; ++k) {
        c[k] = vertices_.Find(corners[k]);
        MTDB_CHECK(c[k] != kNone32, "an update names a vertex that the cut does not have");
      }
    }
    slots.clear();
    mesh_.Replace(removed, created, kNone32, &slots);
    client_.resize(mesh_.triangle_slots(), kNone32);
    for (size_t k = 0; k < slots.size(); ++k) triangles_.Put(change.created[k], slots[k]);
    if (!batch.insert) {
      const uint32_t vertex = vertices_.Find(node.vertex);
      mesh_.Forget(vertex, kNone32);
      vertices_.Erase(vertex);
    }
  }
}

void WholeCut::Choose(const MeetsRegion& region) {
  const Grid& grid = mesh_.options().grid;
  chosen_.assign(mesh_.triangle_slots(), false);
  constexpr uint32_t kAhead = 16;
  for (uint32_t slot = 0; slot < mesh_.triangle_slots(); ++slot) {
    if (slot + kAhead < mesh_.triangle_slots()) mesh_.PrefetchCorners(slot + kAhead);
    if (!mesh_.has_triangle(slot)) continue;
    const auto& c = mesh_.triangle(slot).corners;
    chosen_[slot] =
        !region || region({grid.Position(mesh_.position(c[0])), grid.Position(mesh_.position(c[1])),
                           grid.Position(mesh_.position(c[2]))});
  }
}

std::vector<std::vector<bool>> WholeCut::Plan(std::span<const UpdateBatch> batches,
                                              const KeyTable& held) const {
  UpdateChange change;
  std::unordered_map<TriangleKey, bool> changed;  // of what the client would hold
  const auto holds = [&](TriangleKey key) {
    const auto at = changed.find(key);
    return at == changed.end() ? held.Find(key) != kNone32 : at->second;
  };
  // Of update i of a batch: of its nodes, then of its crumbs.
  const auto set = [&](const UpdateBatch& batch, size_t i) {
    const size_t nodes = batch.nodes.size();
    if (i < nodes) return SetChange(change, batch, i);
    SetCrumbChange(change, batch.insert, batch.crumbs[i - nodes]);
  };
  std::vector<std::vector<bool>> plan;
  for (const UpdateBatch& batch : batches) {
    const size_t count = batch.nodes.size() + batch.crumbs.size();
    std::vector<bool>& follows = plan.emplace_back(count);
    for (size_t i = 0; i < count; i = i < batch.nodes.size() ? batch.EndOfUpdate(i) : i + 1) {
      set(batch, i);
      follows[i] = std::all_of(change.removed.begin(), change.removed.end(), holds);
      if (!follows[i]) continue;
      for (const TriangleKey key : change.removed) changed[key] = false;
      for (const TriangleKey key : change.created) changed[key] = true;
    }
  }
  // Backwards: what is created is chosen in the end, or what another update starts from.
  std::unordered_map<TriangleKey, bool> needed;
  const auto is_needed = [&](TriangleKey key) {
    if (const auto at = needed.find(key); at != needed.end()) return at->second;
    const uint32_t slot = triangles_.Find(key);
    return slot != kNone32 && chosen_[slot];
  };
  for (size_t b = batches.size(); b-- > 0;) {
    for (size_t i = plan[b].size(); i-- > 0;) {
      if (!plan[b][i]) continue;
      set(batches[b], i);
      plan[b][i] = std::any_of(change.created.begin(), change.created.end(), is_needed);
      if (!plan[b][i]) continue;
      for (const TriangleKey key : change.created) needed[key] = false;
      for (const TriangleKey key : change.removed) needed[key] = true;
    }
  }
  return plan;
}

size_t WholeCut::memory_bytes() const {
  return mesh_.memory_bytes() + triangles_.memory_bytes() + vertices_.memory_bytes() +
         CapacityBytes(client_) + chosen_.capacity() / 8 + CapacityBytes(held_);
}

}  // namespace mtdb::internal
