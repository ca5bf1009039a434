#include "codecs/stream/internal/whole_cut.h"

#include <algorithm>

#include "codecs/stream/internal/memory_bytes.h"
#include "store/base/check.h"

namespace mtdb::internal {

void SetChange(UpdateChange& change, const UpdateBatch& batch, const UpdateBatch::Node& node) {
  std::vector<TriangleKey>& star = batch.insert ? change.created : change.removed;
  std::vector<TriangleKey>& hole = batch.insert ? change.removed : change.created;
  star.clear();
  hole.clear();
  change.corners.clear();
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

WholeCut::WholeCut(const ClientMeshOptions& options, const BaseMesh& base)
    : mesh_({options.grid, options.attributes, 0}),
      triangle_keys_(base.triangle_keys),
      vertex_keys_(base.vertices),
      client_(base.triangles.size(), kNone32) {
  mesh_.Start({}, base.positions, base.rows, base.triangles);
  for (uint32_t t = 0; t < triangle_keys_.size(); ++t) triangle_of_[triangle_keys_[t]] = t;
  for (uint32_t v = 0; v < vertex_keys_.size(); ++v) vertex_of_[vertex_keys_[v]] = v;
}

uint32_t WholeCut::SlotOf(TriangleKey key) const {
  const auto at = triangle_of_.find(key);
  return at == triangle_of_.end() ? kNone32 : at->second;
}

void WholeCut::Link(TriangleKey key, uint32_t client_slot) {
  const uint32_t slot = SlotOf(key);
  if (client_slot >= held_.size()) held_.resize(client_slot + size_t{1});
  held_[client_slot] = {key, slot};
  if (slot != kNone32) client_[slot] = client_slot;
}

void WholeCut::Unlink(uint32_t client_slot) {
  Held& held = held_[client_slot];
  if (held.whole != kNone32) client_[held.whole] = kNone32;
  held.whole = kNone32;
}

void WholeCut::Apply(const UpdateBatch& batch) {
  UpdateChange change;
  std::vector<uint32_t> removed;
  std::vector<uint32_t> slots;
  std::vector<std::array<uint32_t, 3>> created;
  const size_t row_bytes = mesh_.options().attributes.row_bytes();
  for (size_t i = 0; i < batch.nodes.size(); ++i) {
    const UpdateBatch::Node& node = batch.nodes[i];
    SetChange(change, batch, node);
    if (batch.insert) {
      const uint32_t vertex = mesh_.AddVertex(node.position, batch.rows.data() + i * row_bytes);
      vertex_keys_.resize(mesh_.vertex_slots());
      vertex_keys_[vertex] = node.vertex;
      vertex_of_[node.vertex] = vertex;
    }
    removed.clear();
    for (const TriangleKey key : change.removed) {
      const uint32_t slot = SlotOf(key);
      MTDB_CHECK(slot != kNone32, "an update names a triangle that the cut does not have");
      if (client_[slot] != kNone32) held_[client_[slot]].whole = kNone32;
      client_[slot] = kNone32;
      triangle_of_.erase(key);
      removed.push_back(slot);
    }
    created.clear();
    for (const auto& corners : change.corners) {
      auto& c = created.emplace_back();
      for (size_t k = 0; k < 3; ++k) {
        const auto at = vertex_of_.find(corners[k]);
        MTDB_CHECK(at != vertex_of_.end(), "an update names a vertex that the cut does not have");
        c[k] = at->second;
      }
    }
    slots.clear();
    mesh_.Replace(removed, created, kNone32, &slots);
    triangle_keys_.resize(mesh_.triangle_slots());
    client_.resize(mesh_.triangle_slots(), kNone32);
    for (size_t k = 0; k < slots.size(); ++k) {
      triangle_keys_[slots[k]] = change.created[k];
      triangle_of_[change.created[k]] = slots[k];
    }
    if (!batch.insert) {
      const auto at = vertex_of_.find(node.vertex);
      mesh_.Forget(at->second, kNone32);
      vertex_of_.erase(at);
    }
  }
  mesh_.TakeChanges();
}

void WholeCut::Choose(const MeetsRegion& region) {
  const Grid& grid = mesh_.options().grid;
  chosen_.assign(mesh_.triangle_slots(), false);
  for (uint32_t slot = 0; slot < mesh_.triangle_slots(); ++slot) {
    if (!mesh_.has_triangle(slot)) continue;
    const auto& c = mesh_.triangle(slot).corners;
    chosen_[slot] =
        !region || region({grid.Position(mesh_.position(c[0])), grid.Position(mesh_.position(c[1])),
                           grid.Position(mesh_.position(c[2]))});
  }
}

std::vector<std::vector<bool>> WholeCut::Plan(
    std::span<const UpdateBatch> batches,
    const std::unordered_map<TriangleKey, uint32_t>& held) const {
  UpdateChange change;
  std::unordered_map<TriangleKey, bool> changed;  // of what the client would hold
  const auto holds = [&](TriangleKey key) {
    const auto at = changed.find(key);
    return at == changed.end() ? held.contains(key) : at->second;
  };
  std::vector<std::vector<bool>> plan;
  for (const UpdateBatch& batch : batches) {
    std::vector<bool>& follows = plan.emplace_back(batch.nodes.size());
    for (size_t i = 0; i < batch.nodes.size(); ++i) {
      SetChange(change, batch, batch.nodes[i]);
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
    const uint32_t slot = SlotOf(key);
    return slot != kNone32 && chosen_[slot];
  };
  for (size_t b = batches.size(); b-- > 0;) {
    for (size_t i = batches[b].nodes.size(); i-- > 0;) {
      if (!plan[b][i]) continue;
      SetChange(change, batches[b], batches[b].nodes[i]);
      plan[b][i] = std::any_of(change.created.begin(), change.created.end(), is_needed);
      if (!plan[b][i]) continue;
      for (const TriangleKey key : change.created) needed[key] = false;
      for (const TriangleKey key : change.removed) needed[key] = true;
    }
  }
  return plan;
}

size_t WholeCut::memory_bytes() const {
  return mesh_.memory_bytes() + MapBytes(triangle_of_) + MapBytes(vertex_of_) +
         CapacityBytes(triangle_keys_) + CapacityBytes(vertex_keys_) + CapacityBytes(client_) +
         chosen_.capacity() / 8 + CapacityBytes(held_);
}

}  // namespace mtdb::internal
