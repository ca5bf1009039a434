// What the encoder and the decoder of a cluster share beside the models.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "codecs/cluster_codec.h"
#include "codecs/internal/cluster_model.h"
#include "codecs/internal/patch.h"
#include "store/base/grid.h"
#include "store/base/ids.h"

namespace mtdb {

inline constexpr uint8_t kFlagBoundary = 1;       // some node is a boundary node
inline constexpr uint8_t kFlagScaledByError = 2;  // errors bound the residuals along n
inline constexpr uint8_t kKnownFlags = kFlagBoundary | kFlagScaledByError;

// The error of a code in grid cells, as Grid has it (error_unit = step / 16).
inline double ErrorInCells(uint8_t code) {
  static const std::vector<double> table = [] {
    Grid grid;
    grid.error_unit = 1.0 / 16;
    std::vector<double> t(256);
    for (size_t c = 0; c < t.size(); ++c) t[c] = grid.Error(static_cast<uint8_t>(c));
    return t;
  }();
  return table[code];
}

struct PredictedError {
  uint8_t code;
  bool fallback;  // no node of this cluster made a triangle of the hole: the code before
};

// The least error code among the nodes of this cluster that made the hole's triangles.
inline PredictedError PredictError(const std::vector<uint32_t>& hole,
                                   const std::vector<uint32_t>& creators,
                                   const std::vector<uint8_t>& codes) {
  uint32_t best = 256;
  for (const uint32_t slot : hole) {
    if (creators[slot] != kNone32) best = std::min<uint32_t>(best, codes[creators[slot]]);
  }
  if (best < 256) return {static_cast<uint8_t>(best), false};
  return {codes.empty() ? uint8_t{0} : codes.back(), true};
}

// Codes which ring edge a node splits; kNone32: none, the node is interior. A result beyond the
// ring is an error of the bytes.
template <typename Coder>
uint32_t CodeSplitEdge(Coder& coder, TopologyModel& model, const Patch& patch, uint32_t edge) {
  const auto k = static_cast<uint32_t>(patch.ring().size());
  std::array<uint32_t, kMaxRing> ranked{};
  uint32_t open = 0;
  for (uint32_t j = 0; j < k; ++j) {
    if (patch.open_edge(j)) ranked[open++] = j;
  }
  uint32_t next = open;
  for (uint32_t j = 0; j < k; ++j) {
    if (!patch.open_edge(j)) ranked[next++] = j;
  }
  const auto at = std::find(ranked.begin(), ranked.begin() + k, edge);
  const auto rank = edge == kNone32 ? kNone32 : static_cast<uint32_t>(at - ranked.begin());
  const uint32_t result = model.CodeSplit(coder, open, k - open, rank);
  return result < k ? ranked[result] : result;
}

}  // namespace mtdb
