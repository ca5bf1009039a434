// SPDX-License-Identifier: Apache-2.0
// Draco as a peer: how small it makes a mesh, and how fast it gives it back.
#pragma once

#include <cstdint>

#include "store/base/mesh_sink.h"

namespace mtdb {

struct DracoResult {
  uint64_t bytes = 0;
  double decode_seconds = 0;  // of processor time
};

// The mesh by the edgebreaker, with positions of `bits` bits, at `level` (0 fast .. 10 small).
DracoResult MeasureDraco(const TriangleMesh& mesh, int bits, int level);

}  // namespace mtdb
