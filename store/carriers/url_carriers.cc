// SPDX-License-Identifier: Apache-2.0
#include "store/carriers/url_carriers.h"

#include <algorithm>
#include <array>

#include "store/carriers/http_ranges.h"

namespace mtdb::internal {

const UrlCarrier* CarrierOf(const std::string& path_or_url) {
  static constexpr std::array<UrlCarrier, 3> kCarriers{{
      {"http://", &OpenHttpRanges},
      {"https://", &OpenHttpRanges},
      {"s3://", &OpenHttpRanges},
  }};
  const auto carrier =
      std::find_if(kCarriers.begin(), kCarriers.end(),
                   [&](const UrlCarrier& known) { return path_or_url.starts_with(known.scheme); });
  return carrier == kCarriers.end() ? nullptr : &*carrier;
}

}  // namespace mtdb::internal
