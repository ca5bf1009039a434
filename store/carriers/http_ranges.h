// SPDX-License-Identifier: Apache-2.0
// HttpRanges: the RangeReader of a file on a web server, by libcurl.
#pragma once

#include <memory>
#include <string>

#include "store/base/status.h"
#include "store/range_reader.h"

namespace mtdb::internal {

struct HttpOptions {
  int tries = 5;               // of a request; those after the first wait longer and longer
  double first_wait = 0.2;     // seconds before the second try; then twice as many
  double most_wait = 10;       // likewise; also what a server may ask for
  double stall_seconds = 15;   // at less than least_rate: the try has failed
  uint64_t least_rate = 1024;  // bytes of the file a second
  // All tries of a request together, whatever comes meanwhile, and beside them the time that its
  // bytes take at least_rate.
  double request_seconds = 60;
  double connect_seconds = 10;
  int parallel = 6;  // requests under way at once
};

// The defaults, but for what the environment says: MTDB_URL_TIMEOUT (seconds) is request_seconds,
// and MTDB_URL_LEAST_RATE (bytes a second) least_rate. kInvalidArgument when it is no number.
Result<HttpOptions> HttpOptionsOfEnvironment();

// Asks for the first kFirstReadBytes, which stay in memory, and so learns the file's size.
Result<std::unique_ptr<RangeReader>> OpenHttpRanges(const std::string& url,
                                                    const HttpOptions& options);
// With the environment's options. kUnsupported without libcurl.
Result<std::unique_ptr<RangeReader>> OpenHttpRanges(const std::string& url);

}  // namespace mtdb::internal
