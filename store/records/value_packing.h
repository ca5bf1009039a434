// SPDX-License-Identifier: Apache-2.0
// Where a value of clusters or root pieces ends. See store/FORMAT.md, "Where a value ends".
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace mtdb::internal {

inline constexpr uint64_t kMinValueBytes = 32 << 10;
inline constexpr uint64_t kMaxValueBytes = 96 << 10;

// Given the sizes of the payloads that wait, in order: how many of them make the next value; 0 =
// wait for more. `last`: no more will come.
size_t PayloadsOfNextValue(std::span<const uint64_t> payload_bytes, bool last);

}  // namespace mtdb::internal
