// SPDX-License-Identifier: Apache-2.0
#include "builder/measure/mesh_crossings.h"

#include <utility>

namespace mtdb::internal {

void MeshCrossings::Build(const TileMesh& mesh) {
  const std::span<const uint32_t> opposites = mesh.input_opposites();
  edges_.clear();
  crossers_.clear();
  free_crossers_ = kNone32;
  of_.assign(opposites.size(), 0);
  for (uint32_t h = 0; h < opposites.size(); ++h) {
    const uint32_t o = opposites[h];
    of_[h] = o != kNone32 && o < h ? Twin(of_[o]) : 2 * NewEdge();
  }
  first_made_ = static_cast<uint32_t>(edges_.size());
}

std::array<uint32_t, Hole::kMaxRing> MeshCrossings::NumberFilling(const Hole& hole,
                                                                  const Hole::Triangles& triangles,
                                                                  std::span<const uint32_t> leaving,
                                                                  uint32_t first) {
  const uint32_t count = hole.k - 2;
  std::array<uint32_t, Hole::kMaxRing> diagonals{};
  for (uint32_t t = 1; t < count; ++t) diagonals[t] = 2 * NewEdge();
  of_.resize(3 * (first + count));
  for (uint32_t t = 0; t < count; ++t) {
    for (uint32_t c = 0; c < 3; ++c) {
      const auto [a, b] = Hole::Edge(triangles[t], c);
      uint32_t& crossing = of_[3 * (first + t) + c];
      if (hole.OnRing(a, b)) {
        crossing = leaving[a];
      } else if (hole.IsNewBorder(a, b)) {
        crossing = 2 * NewEdge();
      } else if (a > b) {  // the diagonal that t hangs on
        crossing = diagonals[t];
      } else {
        uint32_t s = t + 1;
        while (triangles[s][0] != a || triangles[s][2] != b) ++s;
        crossing = Twin(diagonals[s]);
      }
    }
  }
  return diagonals;
}

void MeshCrossings::AddCrosser(uint32_t crossing, uint32_t edge_of_s) {
  uint32_t& head = edges_[crossing / 2].head;
  if (head != kNone32 && crossers_[head].edge == edge_of_s) return;
  if (free_crossers_ == kNone32) {
    crossers_.push_back({edge_of_s, head});
    head = static_cast<uint32_t>(crossers_.size() - 1);
    return;
  }
  const uint32_t c = free_crossers_;
  free_crossers_ = crossers_[c].next;
  crossers_[c] = {edge_of_s, head};
  head = c;
}

void MeshCrossings::FreeCrossers(uint32_t edge) {
  uint32_t c = std::exchange(edges_[edge].head, kNone32);
  while (c != kNone32) {
    const uint32_t next = std::exchange(crossers_[c].next, free_crossers_);
    free_crossers_ = std::exchange(c, next);
  }
}

}  // namespace mtdb::internal
