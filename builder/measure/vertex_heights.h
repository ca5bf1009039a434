// SPDX-License-Identifier: Apache-2.0
// VertexHeights: how far vertices stand off their neighbours, by which their errors are guessed.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "store/base/geometry.h"

namespace mtdb::internal {

// How far they stand off the mean of their neighbours: along z when `vertical`; else along the mean
// normal or, of vertices whose other neighbours are far away, off the line between the two nearest.
std::vector<double> VertexHeights(std::span<const std::array<uint32_t, 3>> triangles,
                                  std::span<const Vec3d> positions, bool vertical);

}  // namespace mtdb::internal
