// SPDX-License-Identifier: Apache-2.0
#include "store/packed/open_ranges.h"

#include <array>
#include <cstdio>
#include <utility>

#include "store/carriers/url_carriers.h"
#include "store/packed/packed_format.h"
#include "store/packed/range_cache.h"

namespace mtdb::internal {

namespace {

// What the header says is proved by the directory's hash; a false one finds nothing of use.
Result<std::unique_ptr<RangeReader>> WithCache(std::unique_ptr<RangeReader> ranges,
                                               std::shared_ptr<RangeCache> cache) {
  if (ranges->size() < kPackedHeaderBytes) return ranges;
  MTDB_ASSIGN_OR_RETURN(const Bytes bytes, ReadRange(*ranges, {0, kPackedHeaderBytes}));
  const auto header = DecodePackedHeader(bytes, ranges->size(), ranges->name());
  if (!header.ok()) return ranges;
  std::array<char, 40> hash;
  std::snprintf(hash.data(), hash.size(), "%016llx%016llx",
                static_cast<unsigned long long>(header->hash_high),
                static_cast<unsigned long long>(header->hash_low));
  return KeepRanges(std::move(ranges), std::move(cache), hash.data());
}

}  // namespace

Result<std::unique_ptr<RangeReader>> OpenPackedRanges(const std::string& path,
                                                      const OpenOptions& options) {
  if (const UrlCarrier* const carrier = CarrierOf(path)) {
    // The folder first: whoever names one that cannot be used should hear so at once.
    std::shared_ptr<RangeCache> cache;
    if (!options.cache_directory.empty()) {
      MTDB_ASSIGN_OR_RETURN(
          cache, RangeCache::Open(options.cache_directory, options.cache_directory_bytes));
    }
    auto remote = carrier->open(path);
    if (!remote.ok() || cache == nullptr) return remote;
    return WithCache(*std::move(remote), std::move(cache));
  }
  auto ranges = OpenFileRanges(path);
  // The store's own messages tell what is wrong.
  if (!ranges.ok() || (*ranges)->size() < kPackedHeaderBytes) return std::unique_ptr<RangeReader>();
  const auto magic = ReadRange(**ranges, {0, kPackedHeaderBytes});
  if (!magic.ok() || !IsPackedMagic(*magic)) return std::unique_ptr<RangeReader>();
  return ranges;
}

}  // namespace mtdb::internal
