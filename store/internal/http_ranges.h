// SPDX-License-Identifier: Apache-2.0
// HttpRanges: the RangeReader of a file on a web server, by libcurl.
#pragma once

#include <memory>
#include <string>

#include "store/base/status.h"
#include "store/range_reader.h"

namespace mtdb::internal {

struct HttpOptions {
  int tries = 5;              // of a request; those after the first wait longer and longer
  double first_wait = 0.2;    // seconds before the second try; then twice as many
  double most_wait = 10;      // likewise; also what a server may ask for
  double stall_seconds = 15;  // without a byte: the try has failed
  double connect_seconds = 10;
  int parallel = 6;  // requests under way at once
};

// Asks for the first kPackedFirstRead bytes, which stay in memory, and so learns the file's size.
Result<std::unique_ptr<RangeReader>> OpenHttpRanges(const std::string& url,
                                                    const HttpOptions& options);

}  // namespace mtdb::internal
