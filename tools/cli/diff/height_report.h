// SPDX-License-Identifier: Apache-2.0
// What `mtdb diff --heights` tells: changes of height, and volumes.
#pragma once

#include "store/base/status.h"
#include "tools/cli/diff/comparison.h"

namespace mtdb {

// The options --heights and --window.
void AddHeights(VerbOptions* verb, DiffArguments* arguments);
// That what is asked for goes with --heights, or without.
Status CheckHeights(const DiffArguments& arguments);
// Compares, tells, and sets the exit status.
Status DiffHeights(const DiffArguments& arguments, Invocation& invocation);

}  // namespace mtdb
