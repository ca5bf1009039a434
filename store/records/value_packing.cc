// SPDX-License-Identifier: Apache-2.0
#include "store/records/value_packing.h"

namespace mtdb::internal {
namespace {

// Those of LMDB on common machines. Constants, so that a store's values do not depend on the
// machine that wrote them.
constexpr uint64_t kPageBytes = 4096;
constexpr uint64_t kHeaderBytes = 16;

}  // namespace

size_t PayloadsOfNextValue(std::span<const uint64_t> payload_bytes, bool last) {
  uint64_t total = 0;
  for (const uint64_t b : payload_bytes) total += b;
  if (total <= kMaxValueBytes) return last ? payload_bytes.size() : 0;

  // The cut that wastes the least part of its pages; without one, as many payloads as are allowed.
  size_t best = 0;
  uint64_t best_waste = 0;
  uint64_t best_pages = 1;
  size_t allowed = 0;
  uint64_t bytes = 0;
  for (size_t i = 0; i < payload_bytes.size(); ++i) {
    bytes += payload_bytes[i];
    if (bytes > kMaxValueBytes) break;
    allowed = i + 1;
    if (bytes < kMinValueBytes) continue;
    const uint64_t pages = (kHeaderBytes + bytes + kPageBytes - 1) / kPageBytes;
    const uint64_t waste = pages * kPageBytes - kHeaderBytes - bytes;
    if (best == 0 || waste * best_pages <= best_waste * pages) {
      best = i + 1;
      best_waste = waste;
      best_pages = pages;
    }
  }
  if (best > 0) return best;
  return allowed > 0 ? allowed : 1;
}

}  // namespace mtdb::internal
