// SPDX-License-Identifier: Apache-2.0
// What the encoder and the decoder of a cluster share beside the models.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "codecs/cluster/cluster_codec.h"
#include "codecs/coding/cluster_model.h"
#include "codecs/coding/patch.h"
#include "store/base/ids.h"

namespace mtdb::internal {

inline constexpr uint8_t kFlagBoundary = 1;       // some node is a boundary node
inline constexpr uint8_t kFlagScaledByError = 2;  // errors bound the residuals along n
inline constexpr uint8_t kFlagFlat = 4;           // a height field: seen along z
inline constexpr uint8_t kFlagLattice = 8;  // holes and places of vertices by the Delaunay rule
inline constexpr uint8_t kFlagFans = 16;    // some node has several fans
inline constexpr uint8_t kKnownFlags =
    kFlagBoundary | kFlagScaledByError | kFlagFlat | kFlagLattice | kFlagFans;

// EncodeCluster with models that the caller owns, and an observer (or nullptr) that sees what is
// coded with them.
EncodedCluster EncodeCluster(const ClusterUpdates& updates, const AttributeLayout& attributes,
                             ClusterModels& models, ModelObserver* observer);

// DecodeCluster, but for corners of texture, whose streams are not looked at.
Result<Cluster> DecodeWithoutCorners(ByteSpan payload, InPatch in,
                                     const AttributeLayout& attributes, uint32_t node_limit);

// A payload has at least so many bytes, padding included: a bound on the memory that hostile bytes
// can ask for.
constexpr uint64_t LeastPayloadBytes(uint64_t nodes, size_t row_bytes) {
  return nodes * (256 + row_bytes) / 1024;
}

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

}  // namespace mtdb::internal
