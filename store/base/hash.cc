// SPDX-License-Identifier: Apache-2.0
#include "store/base/hash.h"

#include <xxhash.h>

namespace mtdb {

uint64_t Hash64(ByteSpan bytes, uint64_t seed) {
  return XXH3_64bits_withSeed(bytes.data(), bytes.size(), seed);
}

}  // namespace mtdb
