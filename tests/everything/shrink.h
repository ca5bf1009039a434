// SPDX-License-Identifier: Apache-2.0
// Shrink: a walk that fails, made as short as it goes.
#pragma once

#include <functional>

#include "tests/everything/step.h"

namespace mtdb::everything {

// Whether a walk still shows the same fault.
using StillFails = std::function<bool(const Walk&)>;

// Leaves out steps (halves, quarters, ..., single ones), then parameters, then makes the numbers of
// "size" and "files" smaller, again and again, as long as `fails` says so of what is left and
// `attempts` last. `walk` is taken to fail.
Walk Shrink(const Walk& walk, const StillFails& fails, int attempts);

}  // namespace mtdb::everything
