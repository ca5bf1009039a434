// SPDX-License-Identifier: Apache-2.0
#include "builder/measure/surface_edges.h"

#include <algorithm>
#include <utility>

namespace mtdb::internal {

void SurfaceEdges::Build(std::span<const std::array<uint32_t, 3>> triangles,
                         std::span<const uint32_t> opposites, std::span<const float> errors,
                         std::span<const uint32_t> numbers) {
  edges_.clear();
  begin_.assign(numbers.size() + 1, 0);
  for (uint32_t h = 0; h < opposites.size(); ++h) {
    const uint32_t o = opposites[h];
    if (o != kNone32 && o < h) continue;
    const auto& t = triangles[h / 3];
    const uint32_t a = t[h % 3];
    const uint32_t b = t[h % 3 == 2 ? 0 : h % 3 + 1];
    const float error = o == kNone32 ? errors[h / 3] : std::max(errors[h / 3], errors[o / 3]);
    const auto [from, to] = numbers[a] < numbers[b] ? std::pair(a, b) : std::pair(b, a);
    edges_.push_back({.from = from, .to = to, .error = error});
    for (const uint32_t v : {from, to}) ++begin_[v + 1];
  }
  for (size_t v = 0; v < numbers.size(); ++v) begin_[v + 1] += begin_[v];
  at_.resize(2 * edges_.size());
  std::vector<uint32_t> at(begin_.begin(), begin_.end() - 1);
  for (uint32_t e = 0; e < edges_.size(); ++e) {
    const auto [from, to] = std::pair(edges_[e].from, edges_[e].to);
    at_[at[from]++] = {1, e, to};
    at_[at[to]++] = {0, e, from};
  }
  pool_.clear();
  pool_unused_ = 0;
}

uint32_t SurfaceEdges::Add(uint32_t from, uint32_t to) {
  edges_.push_back({.from = from, .to = to});
  return size() - 1;
}

// Around the end that has fewer of them.
uint32_t SurfaceEdges::Find(uint32_t from, uint32_t to) const {
  const bool at_begin = At(from).size() <= At(to).size();
  const auto [here, there] = at_begin ? std::pair(from, to) : std::pair(to, from);
  for (const EdgeAt& at : At(here)) {
    if (at.other_end == there && at.begins_here == at_begin) return at.edge;
  }
  return kNone32;
}

void SurfaceEdges::SetPath(uint32_t e, std::span<const uint32_t> path) {
  Edge& edge = edges_[e];
  const bool was_long = edge.length > Edge::kShort;
  const uint32_t room = was_long ? edge.crossings[1] : 0;
  const auto length = static_cast<uint32_t>(path.size());
  edge.length = length;
  if (length <= Edge::kShort) {
    pool_unused_ += room;
    std::copy(path.begin(), path.end(), edge.crossings.begin());
    return;
  }
  if (length > room) {
    pool_unused_ += room;
    edge.crossings = {static_cast<uint32_t>(pool_.size()), length, 0};
    pool_.insert(pool_.end(), path.begin(), path.end());
    return;
  }
  std::copy(path.begin(), path.end(), pool_.begin() + edge.crossings[0]);
}

void SurfaceEdges::DropUnused() {
  constexpr size_t kSpare = 1 << 16;
  if (pool_unused_ * 4 < pool_.size() * 3 || pool_.size() < kSpare) return;
  std::vector<uint32_t> kept;
  for (Edge& edge : edges_) {
    if (edge.length <= Edge::kShort) continue;
    const std::span<const uint32_t> path = this->path(edge);
    edge.crossings = {static_cast<uint32_t>(kept.size()), edge.length, 0};
    kept.insert(kept.end(), path.begin(), path.end());
  }
  pool_ = std::move(kept);
  pool_unused_ = 0;
}

}  // namespace mtdb::internal
