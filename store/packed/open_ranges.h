// SPDX-License-Identifier: Apache-2.0
// What a path or URL leads to.
#pragma once

#include <memory>
#include <string>

#include "store/base/status.h"
#include "store/open_options.h"
#include "store/range_reader.h"

namespace mtdb::internal {

// Null when `path` is no URL and its file does not begin as a packed one: it may be a store.
Result<std::unique_ptr<RangeReader>> OpenPackedRanges(const std::string& path,
                                                      const OpenOptions& options = {});

}  // namespace mtdb::internal
