// SPDX-License-Identifier: Apache-2.0
// TouchingGroups: which boxes hang together.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "store/base/geometry.h"

namespace mtdb::internal {

// Of each box the least number of those that it hangs together with, directly or through others.
std::vector<uint32_t> TouchingGroups(std::span<const Box3d> boxes);

}  // namespace mtdb::internal
