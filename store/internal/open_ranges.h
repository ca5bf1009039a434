// SPDX-License-Identifier: Apache-2.0
// What a path or URL leads to.
#pragma once

#include <memory>
#include <string>

#include "store/base/status.h"
#include "store/database.h"
#include "store/range_reader.h"

namespace mtdb::internal {

// "http://...", "https://..." or "s3://...".
bool IsUrl(const std::string& path);

// Null when `path` is no URL and its file does not begin as a packed one: it may be a store.
Result<std::unique_ptr<RangeReader>> OpenPackedRanges(const std::string& path,
                                                      const OpenOptions& options = {});

// A file on a web server, or in an object store by its HTTP interface. kUnsupported without
// libcurl.
Result<std::unique_ptr<RangeReader>> OpenHttpRanges(const std::string& url);

}  // namespace mtdb::internal
