// What the encoder and the decoder of a cluster share beside the models.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "codecs/internal/cluster_model.h"
#include "codecs/internal/patch.h"
#include "store/base/ids.h"

namespace mtdb {

inline constexpr uint8_t kFlagBoundary = 1;       // some node is a boundary node
inline constexpr uint8_t kFlagScaledByError = 2;  // errors bound the residuals along n
inline constexpr uint8_t kKnownFlags = kFlagBoundary | kFlagScaledByError;

// The error of a code in grid cells, as Grid has it for error_unit = step / 16.
inline constexpr auto kErrorInCells = [] {
  constexpr float kEighths[8] = {1.0f,        1.09050773f, 1.18920712f, 1.29683955f,
                                 1.41421356f, 1.54221083f, 1.68179283f, 1.83400809f};
  std::array<float, 256> cells{};
  float octave = 1.0f / 16;
  for (size_t c = 1; c < cells.size(); ++c) {
    cells[c] = octave * kEighths[(c - 1) % 8];
    if (c % 8 == 0) octave *= 2;
  }
  return cells;
}();

struct PredictedError {
  uint8_t code;
  bool fallback;  // no node of this cluster made a triangle of the hole: the code before
};

// The least error code among the nodes of this cluster that made the hole's triangles.
inline PredictedError PredictError(const Patch& patch, uint32_t in_triangles,
                                   const std::vector<uint8_t>& codes) {
  uint32_t best = 256;
  for (const uint32_t slot : patch.hole()) {
    if (slot >= in_triangles) best = std::min<uint32_t>(best, patch.triangle(slot).error_code);
  }
  if (best < 256) return {static_cast<uint8_t>(best), false};
  return {codes.empty() ? uint8_t{0} : codes.back(), true};
}

// Codes which ring edge a node splits; kNone32: none, the node is interior. A result beyond the
// ring is an error of the bytes. Edges with nothing beyond them come first.
template <typename Coder>
[[gnu::always_inline]] inline uint32_t CodeSplitEdge(Coder& coder, TopologyModel& model,
                                                     const Patch& patch, uint32_t edge) {
  const auto k = static_cast<uint32_t>(patch.ring().size());
  const uint32_t open = patch.open_edges();
  uint32_t rank = kNone32;
  if (edge != kNone32) {
    rank = patch.open_edge(edge) ? 0 : open;
    for (uint32_t j = 0; j < edge; ++j) rank += patch.open_edge(j) == patch.open_edge(edge);
  }
  rank = model.CodeSplit(coder, open, k - open, rank);
  if (rank >= k) return rank;
  const bool wants_open = rank < open;
  uint32_t left = wants_open ? rank : rank - open;
  for (uint32_t j = 0; j < k; ++j) {
    if (patch.open_edge(j) == wants_open && left-- == 0) return j;
  }
  return k;
}

}  // namespace mtdb
