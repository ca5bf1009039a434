// SPDX-License-Identifier: Apache-2.0
// A fragment of a neuroglancer mesh: triangles with whole numbers as positions, coded by Draco.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

struct DracoFragment {
  std::vector<std::array<int32_t, 3>> positions;
  std::vector<std::array<uint32_t, 3>> triangles;  // none twice the same vertex
};

// Draco's integers, without its quantisation, as neuroglancer wants them. Vertices get another
// order, and one at which several sheets meet becomes several. Errors: kNoSpace (memory).
Result<Bytes> EncodeDracoFragment(const DracoFragment& fragment);
// kCorrupt: no such fragment.
Result<DracoFragment> DecodeDracoFragment(ByteSpan bytes);

}  // namespace mtdb
