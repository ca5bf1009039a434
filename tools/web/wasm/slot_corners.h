// SPDX-License-Identifier: Apache-2.0
// SlotCorners: where the triangles of a SlotMesh lie in the pages of a texture.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "codecs/stream/mesh_update.h"
#include "query/session.h"

namespace mtdb {

// Triangles come and go within an update; only those that stay are asked for, once it is over.
class SlotCorners {
 public:
  // A triangle slot that was filled; the corners of its mesh, in their order.
  void Add(uint32_t slot, TriangleKey key, const std::array<VertexIndex, 3>& vertices) {
    if (slot >= pages_.size()) {
      pages_.resize(slot + 1, TextureCorner::kNoPage);
      coordinates_.resize(6 * pages_.size());
      asked_.resize(pages_.size(), kNone);
    }
    asked_[slot] = static_cast<uint32_t>(asks_.size());
    asks_.push_back({slot, key, vertices});
  }
  void Remove(uint32_t slot) {
    asked_[slot] = kNone;
    pages_[slot] = TextureCorner::kNoPage;
  }
  // After an update, whose session this is.
  void Fill(const Session& session) {
    for (uint32_t i = 0; i < asks_.size(); ++i) {
      if (asked_[asks_[i].slot] == i) FillSlot(asks_[i], session.CornersOf(asks_[i].key));
    }
    asks_.clear();
  }

  // Per triangle slot: u and v of its three corners, and their page, or kNoPage.
  std::span<const float> coordinates() const { return coordinates_; }
  std::span<const uint32_t> pages() const { return pages_; }

 private:
  struct Ask {
    uint32_t slot;
    TriangleKey key;
    std::array<VertexIndex, 3> vertices;
  };
  static constexpr uint32_t kNone = 0xffffffff;

  void FillSlot(const Ask& ask, const TriangleCorners& told) {
    asked_[ask.slot] = kNone;
    pages_[ask.slot] = told.corners[0].page;
    float* out = &coordinates_[6 * size_t{ask.slot}];
    for (const VertexIndex vertex : ask.vertices) {
      const size_t i = vertex == told.vertices[0] ? 0 : vertex == told.vertices[1] ? 1 : 2;
      *out++ = told.corners[i].u;
      *out++ = told.corners[i].v;
    }
  }

  std::vector<float> coordinates_;
  std::vector<uint32_t> pages_;
  std::vector<uint32_t> asked_;  // per slot: its place in asks_, or kNone
  std::vector<Ask> asks_;
};

}  // namespace mtdb
