// SPDX-License-Identifier: Apache-2.0
// RandomWalk: what to do, from a seed.
#pragma once

#include "tests/everything/step.h"

namespace mtdb::everything {

// Depends on the seed alone. What is likely is said in random_walk.cc.
Walk RandomWalk(uint64_t seed);

}  // namespace mtdb::everything
