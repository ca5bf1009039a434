// SPDX-License-Identifier: Apache-2.0
// The height field behind GenerateTerrain.
#pragma once

#include <cstdint>

#include "store/base/mesh_sink.h"
#include "store/base/status.h"

namespace mtdb::internal {

// The height at (x, y) with features down to `finest_wavelength`. Damped fractal noise: an octave
// counts less where the octaves before are steep, so that slopes are smooth and ridges rough, as
// erosion leaves them.
double TerrainHeight(uint64_t seed, double x, double y, double finest_wavelength);

// Sends Begin, the grid row by row, End.
Status SendTerrain(uint64_t triangles, uint64_t seed, MeshSink& sink);

}  // namespace mtdb::internal
