// SPDX-License-Identifier: Apache-2.0
// SlotMesh: the mesh of a session for a graphics card: triangles and vertices in slots that are
// used again.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "codecs/stream/mesh_update.h"
#include "store/base/bytes.h"
#include "store/object_record.h"
#include "tools/viewer/wasm/slot_ranges.h"
#include "tools/web/wasm/slot_corners.h"

namespace mtdb {

// A triangle slot without a triangle has the indices 0, 0, 0, which draw nothing. Takes the batches
// of a session in their order. One thread.
class SlotMesh {
 public:
  SlotMesh(const ObjectRecord& record, const BaseMesh& base)
      : grid_(record.grid), row_bytes_(record.attributes.row_bytes()) {
    const Vec3d centre = (record.bounds.min + record.bounds.max) * 0.5;
    origin_ = {centre.x, centre.y, centre.z};
    if (record.texture) corners_.emplace();
    for (size_t v = 0; v < base.vertices.size(); ++v) {
      AddVertex(base.vertices[v], base.positions[v],
                ByteSpan(base.rows).subspan(v * row_bytes_, row_bytes_));
    }
    for (size_t t = 0; t < base.triangles.size(); ++t) {
      const auto& c = base.triangles[t];
      AddTriangle(base.triangle_keys[t],
                  {base.vertices[c[0]], base.vertices[c[1]], base.vertices[c[2]]});
    }
  }

  // Three a triangle slot. `indices`: of the whole mesh; `shown`: of what the clip leaves.
  std::span<const uint32_t> indices() const { return indices_; }
  std::span<const uint32_t> shown() const { return clip_ ? shown_ : indices_; }
  size_t shown_triangles() const { return clip_ ? shown_triangles_ : triangles_.size(); }
  std::span<const float> positions() const { return positions_; }  // likewise a vertex slot
  const Bytes& rows() const { return rows_; }
  const std::array<double, 3>& origin() const { return origin_; }  // of the positions
  // Vertices whose triangles have become others since ClearTouched(); some may be free now.
  const SlotMarks& touched() const { return touched_; }
  void ClearTouched() { touched_.Clear(); }
  // Calls f(slot, key) for each triangle, those that the clip takes away included.
  template <typename F>
  void ForEachTriangle(F&& f) const {
    for (const auto& [key, slot] : triangles_) f(slot, key);
  }

  void Apply(const UpdateBatch& batch) {
    for (size_t i = 0; i < batch.nodes.size(); ++i) {
      const UpdateBatch::Node& node = batch.nodes[i];
      const std::span<const VertexIndex> ring = batch.ring_of(node);
      const uint32_t star = UpdateBatch::StarCount(node);
      if (batch.insert) {
        if (!node.twin) {
          AddVertex(node.vertex, node.position,
                    ByteSpan(batch.rows).subspan(i * row_bytes_, row_bytes_));
        }
        for (const auto& t : batch.hole_of(node)) RemoveTriangle(t.key);
        for (uint32_t j = 0; j < star; ++j) {
          AddTriangle(node.first_star + j, {node.vertex, ring[j], ring[(j + 1) % ring.size()]});
        }
      } else {
        for (uint32_t j = 0; j < star; ++j) RemoveTriangle(node.first_star + j);
        for (const auto& t : batch.hole_of(node)) {
          AddTriangle(t.key, {ring[t.corners[0]], ring[t.corners[1]], ring[t.corners[2]]});
        }
        if (batch.EndOfUpdate(i) != i + 1) continue;
        const auto at = vertices_.find(node.vertex);
        free_vertices_.push_back(at->second);
        vertices_.erase(at);
      }
    }
  }

  // From now on only triangles that meet the region are shown; null: all.
  void Clip(MeetsRegion meets) {
    if (!clip_ && !meets) return;
    clip_ = std::move(meets);
    shown_.clear();
    shown_triangles_ = 0;
    written_triangles_.MarkBelow(static_cast<uint32_t>(indices_.size() / 3));
  }
  // Of textured objects: where the triangles lie in the pages; as they were at the last Fill.
  // Others have none.
  std::optional<SlotCorners>& corners() { return corners_; }

  // Brings `shown` up to date.
  void ShowWritten() {
    if (!clip_) return;
    shown_.resize(indices_.size());
    written_triangles_.ForEach([&](uint32_t slot) {
      const uint32_t* const corners = &indices_[3 * size_t{slot}];
      uint32_t* const out = &shown_[3 * size_t{slot}];
      if (out[0] != out[1]) --shown_triangles_;
      const bool some = corners[0] != corners[1];
      const bool is_shown =
          some && clip_({PositionOf(corners[0]), PositionOf(corners[1]), PositionOf(corners[2])});
      if (is_shown) ++shown_triangles_;
      for (int i = 0; i < 3; ++i) out[i] = is_shown ? corners[i] : 0;
    });
  }

  // Appends the slots that were written since the last call, as ranges; returns how many.
  uint32_t TakeTriangles(std::vector<uint32_t>* ranges) {
    return TakeSlots(&written_triangles_, ranges);
  }
  uint32_t TakeVertices(std::vector<uint32_t>* ranges) {
    return TakeSlots(&written_vertices_, ranges);
  }

 private:
  Vec3d PositionOf(uint32_t slot) const { return grid_.Position(places_[slot]); }
  static uint32_t TakeSlots(SlotMarks* slots, std::vector<uint32_t>* ranges) {
    const size_t first = ranges->size();
    slots->ForEach([&](uint32_t slot) { AddSlot(slot, first, ranges); });
    slots->Clear();
    return static_cast<uint32_t>((ranges->size() - first) / 2);
  }
  static uint32_t TakeSlot(std::vector<uint32_t>* free, size_t next) {
    if (free->empty()) return static_cast<uint32_t>(next);
    const uint32_t slot = free->back();
    free->pop_back();
    return slot;
  }
  void AddVertex(VertexIndex vertex, Vec3i position, ByteSpan row) {
    const uint32_t slot = TakeSlot(&free_vertices_, positions_.size() / 3);
    if (3 * size_t{slot} == positions_.size()) {
      positions_.resize(positions_.size() + 3);
      places_.resize(places_.size() + 1);
      rows_.resize(rows_.size() + row_bytes_);
    }
    const Vec3d p = grid_.Position(position);
    places_[slot] = position;
    for (int i = 0; i < 3; ++i) {
      positions_[3 * size_t{slot} + static_cast<size_t>(i)] =
          static_cast<float>(p[i] - origin_[static_cast<size_t>(i)]);
    }
    std::ranges::copy(row, rows_.begin() + static_cast<std::ptrdiff_t>(slot * row_bytes_));
    vertices_[vertex] = slot;
    written_vertices_.Mark(slot);
    touched_.Mark(slot);
  }
  void AddTriangle(TriangleKey key, const std::array<VertexIndex, 3>& corners) {
    const uint32_t slot = TakeSlot(&free_triangles_, indices_.size() / 3);
    if (3 * size_t{slot} == indices_.size()) indices_.resize(indices_.size() + 3);
    for (size_t i = 0; i < 3; ++i) {
      const uint32_t vertex = vertices_.at(corners[i]);
      indices_[3 * size_t{slot} + i] = vertex;
      touched_.Mark(vertex);
    }
    triangles_[key] = slot;
    written_triangles_.Mark(slot);
    if (corners_) corners_->Add(slot, key, corners);
  }
  void RemoveTriangle(TriangleKey key) {
    const auto at = triangles_.find(key);
    for (size_t i = 0; i < 3; ++i) {
      touched_.Mark(std::exchange(indices_[3 * size_t{at->second} + i], 0U));
    }
    written_triangles_.Mark(at->second);
    if (corners_) corners_->Remove(at->second);
    free_triangles_.push_back(at->second);
    triangles_.erase(at);
  }

  const Grid grid_;
  const size_t row_bytes_;
  std::array<double, 3> origin_{};
  std::vector<uint32_t> indices_;
  std::vector<float> positions_;
  std::vector<Vec3i> places_;  // of the vertices, on the grid
  MeetsRegion clip_;
  std::vector<uint32_t> shown_;
  size_t shown_triangles_ = 0;
  std::optional<SlotCorners> corners_;
  Bytes rows_;
  std::unordered_map<TriangleKey, uint32_t> triangles_;
  std::unordered_map<VertexIndex, uint32_t> vertices_;
  std::vector<uint32_t> free_triangles_, free_vertices_;
  SlotMarks written_triangles_, written_vertices_, touched_;
};

}  // namespace mtdb
