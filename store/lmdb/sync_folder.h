// SPDX-License-Identifier: Apache-2.0
// What makes a new name of a file last.
#pragma once

#include <string>

#include "store/base/status.h"

namespace mtdb::internal {

// Writes the folder of `path` to the disk, so that a file that was just made or renamed is found
// again after a power failure.
Status SyncFolder(const std::string& path);

}  // namespace mtdb::internal
