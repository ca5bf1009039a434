// SPDX-License-Identifier: Apache-2.0
// zstd as a peer: what a general compressor makes of the plain mesh file.
#pragma once

#include <cstdint>
#include <vector>

#include "store/base/mesh_sink.h"

namespace mtdb {

struct ZstdResult {
  int level = 0;
  uint64_t bytes = 0;
  double encode_seconds = 0;  // of processor time; one thread
  double decode_seconds = 0;  // to the bytes of the file
};

// The mesh as a binary PLY file, and that file at each of `levels`.
struct ZstdPeer {
  uint64_t file_bytes = 0;
  std::vector<ZstdResult> results;
};
ZstdPeer MeasureZstd(const TriangleMesh& mesh, const std::vector<int>& levels);

}  // namespace mtdb
