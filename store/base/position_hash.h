// SPDX-License-Identifier: Apache-2.0
// A hash of positions that does not depend on the machine.
#pragma once

#include <bit>
#include <cstdint>

#include "store/base/geometry.h"
#include "store/base/hash.h"

namespace mtdb {

// -0 and +0 have different hashes.
constexpr uint64_t HashOfPosition(Vec3f p) {
  const uint64_t xy = uint64_t{std::bit_cast<uint32_t>(p.x)} << 32 | std::bit_cast<uint32_t>(p.y);
  return Mix64(Mix64(xy) ^ std::bit_cast<uint32_t>(p.z));
}
constexpr uint64_t HashOfPosition(Vec3d p) {
  const uint64_t xy = Mix64(std::bit_cast<uint64_t>(p.x)) ^ std::bit_cast<uint64_t>(p.y);
  return Mix64(Mix64(xy) ^ std::bit_cast<uint64_t>(p.z));
}

}  // namespace mtdb
