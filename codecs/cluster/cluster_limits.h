// SPDX-License-Identifier: Apache-2.0
// What a cluster or a piece of the root may have at most, so that numbers inside it fit 16 bits
// (codecs/FORMAT.md, "Limits"). Builders keep below, readers refuse what is beyond.
#pragma once

#include <cstdint>

namespace mtdb {

inline constexpr uint32_t kMostSlots = 65535;  // likewise local vertices, and corners of all rings
inline constexpr uint32_t kMostNodes = 32767;
inline constexpr uint32_t kMostChildren = 32766;
// Of a node with several fans: how many, and the corners of all its rings.
inline constexpr uint32_t kMostFans = 15;
inline constexpr uint32_t kMostFanCorners = 64;
// Of a crumb: its triangles and its triggers. With both sides they are a star of 64 slots at most.
inline constexpr uint32_t kMostCrumbTriangles = 28;
inline constexpr uint32_t kMostCrumbTriggers = 4;
// Of tiles that keep below in any case.
inline constexpr uint32_t kMostTileTriangles = 16384;

}  // namespace mtdb
