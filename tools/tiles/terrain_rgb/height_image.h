// SPDX-License-Identifier: Apache-2.0
// Heights as colours of a PNG, as Terrarium and Mapbox have them.
#pragma once

#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

// Red, green and blue are a whole number of 24 bits: a height's steps above the least one.
struct HeightCoding {
  const char* name;    // "terrarium", "mapbox"
  double least, step;  // metres

  double most() const { return least + step * ((1 << 24) - 1); }
  double HeightOf(uint32_t code) const { return least + step * code; }
  // To the nearest code that `multiple` divides.
  uint32_t CodeOf(double height, uint32_t multiple) const {
    const double code = std::round((height - least) / step / multiple) * multiple;
    return static_cast<uint32_t>(std::fmin(std::fmax(code, 0), (1 << 24) - 1));
  }
};
inline constexpr HeightCoding kTerrarium{"terrarium", -32768, 1.0 / 256};
inline constexpr HeightCoding kMapbox{"mapbox", -10000, 0.1};

// A square of codes, from its north-west corner, row by row. Errors: kNoSpace.
Result<Bytes> EncodeHeightImage(std::span<const uint32_t> codes, uint32_t side);
// kCorrupt: no PNG of this size.
Result<std::vector<uint32_t>> DecodeHeightImage(ByteSpan bytes, uint32_t side);

}  // namespace mtdb
