// SPDX-License-Identifier: Apache-2.0
// Which carrier brings the bytes behind a URL: a row a scheme.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "store/base/status.h"
#include "store/range_reader.h"

namespace mtdb::internal {

// A carrier gets so many bytes of the file as it opens it, for it must ask for something to learn
// the size. Whoever reads the file asks for as many first.
inline constexpr uint64_t kFirstReadBytes = 64 << 10;

struct UrlCarrier {
  std::string_view scheme;  // with "://"
  Result<std::unique_ptr<RangeReader>> (*open)(const std::string& url);
};

// The carrier of a URL; null for a path.
const UrlCarrier* CarrierOf(const std::string& path_or_url);

}  // namespace mtdb::internal
