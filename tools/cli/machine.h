// SPDX-License-Identifier: Apache-2.0
// What the machine has.
#pragma once

#include <cstdint>

namespace mtdb {

// Bytes of memory that this process may hope for: the machine's, or what its container or its
// limits leave it.
uint64_t MachineMemory();

}  // namespace mtdb
