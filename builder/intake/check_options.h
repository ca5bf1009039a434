// SPDX-License-Identifier: Apache-2.0
// CheckBuildOptions: what no build accepts, whatever its input.
#pragma once

#include "builder/build_options.h"
#include "store/base/status.h"

namespace mtdb::internal {

// kInvalidArgument, saying which option, and what it must be.
Status CheckBuildOptions(const BuildOptions& options);

}  // namespace mtdb::internal
