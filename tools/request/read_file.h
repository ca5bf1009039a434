// SPDX-License-Identifier: Apache-2.0
// ReadFile: a small file as a whole.
#pragma once

#include <string>

#include "store/base/status.h"

namespace mtdb {

// "-" is standard input. Errors: kNotFound; kIo when it cannot be read to its end, as of a folder.
Result<std::string> ReadFile(const std::string& path);

}  // namespace mtdb
