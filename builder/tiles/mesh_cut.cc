// SPDX-License-Identifier: Apache-2.0
#include "builder/tiles/mesh_cut.h"

#include <algorithm>

#include "builder/disk/number_table.h"
#include "builder/holes/tile_mesh.h"
#include "store/base/hash.h"

namespace mtdb::internal {

namespace {
// HasLongSeams looks at one vertex of so many.
constexpr uint64_t kSampled = 16;
}  // namespace

MeshCut::MeshCut(std::span<const TileTriangle> window)
    : corners_(window.size()), reached_(window.size(), 0) {
  NumberTable numbers(window.size());
  for (size_t t = 0; t < window.size(); ++t) {
    for (size_t c = 0; c < 3; ++c) {
      const auto [number, fresh] = numbers.Add(window[t].vertices[c], vertices_);
      vertices_ += fresh;
      corners_[t][c] = number;
    }
  }
  sides_.assign(vertices_, 0);
}

MeshCut::Seam MeshCut::SeamOf(std::span<const uint32_t> triangles, size_t middle) {
  // Of this call: marks_ + 1 the first side, + 2 both.
  const uint32_t first = marks_ + 1;
  const uint32_t second = marks_ + 2;
  const uint32_t both = marks_ + 3;
  marks_ += 3;
  std::array<uint32_t, 2> counts{};
  uint32_t shared = 0;
  for (const uint32_t t : triangles.first(middle)) {
    for (const uint32_t v : corners_[t]) {
      counts[0] += sides_[v] != first;
      sides_[v] = first;
    }
  }
  for (const uint32_t t : triangles.subspan(middle)) {
    for (const uint32_t v : corners_[t]) {
      if (sides_[v] == second || sides_[v] == both) continue;
      ++counts[1];
      shared += sides_[v] == first;
      sides_[v] = sides_[v] == first ? both : second;
    }
  }
  return {shared, std::min(counts[0], counts[1])};
}

std::vector<uint32_t> MeshCut::Walk(std::span<const uint32_t> triangles) {
  if (opposites_.empty()) PairHalfEdges(corners_, vertices_, opposites_);
  // Walks go over triangles that the walk before it has reached, which marks those of this call.
  const uint32_t mine = ++marks_;
  const uint32_t probed = ++marks_;
  const uint32_t done = ++marks_;
  for (const uint32_t t : triangles) reached_[t] = mine;
  std::vector<uint32_t> order;
  order.reserve(triangles.size());
  std::vector<uint32_t> probe;
  for (const uint32_t t : triangles) {
    if (reached_[t] != mine) continue;
    // What is reached last is at an end; the walk from there is as long as can be, and narrow.
    probe.clear();
    WalkFrom(t, probed, probe);
    WalkFrom(probe.back(), done, order);
  }
  return order;
}

void MeshCut::WalkFrom(uint32_t first, uint32_t walk, std::vector<uint32_t>& order) {
  size_t next = order.size();
  order.push_back(first);
  reached_[first] = walk;
  for (; next < order.size(); ++next) {
    const size_t t = order[next];
    for (size_t h = 3 * t; h < 3 * t + 3; ++h) {
      if (opposites_[h] == kNone32) continue;
      const uint32_t beyond = opposites_[h] / 3;
      if (reached_[beyond] != walk - 1) continue;
      reached_[beyond] = walk;
      order.push_back(beyond);
    }
  }
}

bool HasLongSeams(std::span<const TileTriangle> window, std::span<const uint32_t> tiles,
                  uint32_t tile_count) {
  constexpr uint32_t kSeveral = kNone32 - 1;
  const auto is_sampled = [](uint32_t v) { return Mix64(v) % kSampled == 0; };
  NumberTable numbers(window.size() / kSampled);
  std::vector<uint32_t> tile_of;                       // of the sampled vertices
  std::vector<std::pair<uint32_t, uint32_t>> corners;  // tile, sampled vertex
  for (size_t t = 0; t < window.size(); ++t) {
    for (const uint32_t v : window[t].vertices) {
      if (!is_sampled(v)) continue;
      const auto [number, fresh] = numbers.Add(v, static_cast<uint32_t>(tile_of.size()));
      if (fresh) tile_of.push_back(tiles[t]);
      if (tile_of[number] != tiles[t]) tile_of[number] = kSeveral;
      corners.push_back({tiles[t], number});
    }
  }
  std::vector<std::array<uint32_t, 2>> counts(tile_count);  // all, on seams
  for (const auto& [tile, vertex] : corners) {
    ++counts[tile][0];
    counts[tile][1] += tile_of[vertex] == kSeveral;
  }
  return std::ranges::any_of(counts, [](const auto& c) { return 3 * c[1] > c[0]; });
}

}  // namespace mtdb::internal
