// SPDX-License-Identifier: Apache-2.0
// ReadFile: a small file as a whole.
#pragma once

#include <cstdint>
#include <string>

#include "store/base/status.h"

namespace mtdb {

// "-" is standard input, which may never end. Errors: kNotFound; kBadInput when there are more than
// `most_bytes`; kIoError when it cannot be read to its end, as of a folder.
Result<std::string> ReadFile(const std::string& path, uint64_t most_bytes = uint64_t{1} << 30);

}  // namespace mtdb
