// SPDX-License-Identifier: Apache-2.0
// Checksums and mixing. XXH3-64 is the checksum of every value in a store.
#pragma once

#include <cstdint>

#include "store/base/bytes.h"

namespace mtdb {

// XXH3, 64 bits.
uint64_t Hash64(ByteSpan bytes, uint64_t seed = 0);

// A bijective mix of 64 bits (splitmix64's finaliser).
constexpr uint64_t Mix64(uint64_t x) {
  x += 0x9e3779b97f4a7c15ull;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
  return x ^ (x >> 31);
}

}  // namespace mtdb
