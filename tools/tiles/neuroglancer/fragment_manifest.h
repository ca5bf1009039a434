// SPDX-License-Identifier: Apache-2.0
// FragmentManifest: which fragments of which level an object's mesh has, for neuroglancer.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "store/base/status.h"

namespace mtdb {

// A cell of a level's grid.
using FragmentCell = std::array<uint32_t, 3>;

struct ManifestFragment {
  FragmentCell cell{};
  uint32_t bytes = 0;  // 0: nothing of the level is there, so that clients draw nothing
};

struct ManifestLevel {
  float scale = 0;  // the level's bound; clients multiply it by lod_scale_multiplier
  std::vector<ManifestFragment> fragments;  // in the order of the Z-curve
};

// Levels are from fine to coarse. A fragment's cell of level l begins at
// origin + cell * chunk * 2^l, and all of its sides are chunk * 2^l.
struct FragmentManifest {
  std::array<float, 3> chunk{};
  std::array<float, 3> origin{};
  std::vector<ManifestLevel> levels;
};

// Whether a comes before b on the Z-curve.
bool IsBeforeOnCurve(const FragmentCell& a, const FragmentCell& b);

// What clients need beside the fragments with something in them: parents of all, and of each part
// of a fragment that the next finer level draws anew a fragment there, though it may be empty.
// Sorts all levels. `parts[l]` are cells of level l in which the next coarser level has something.
void CompleteManifest(FragmentManifest* manifest,
                      const std::vector<std::vector<FragmentCell>>& parts);

Bytes EncodeManifest(const FragmentManifest& manifest);
// kCorrupt: other sizes than it says, or fragments that are not in order.
Result<FragmentManifest> DecodeManifest(ByteSpan bytes);

}  // namespace mtdb
