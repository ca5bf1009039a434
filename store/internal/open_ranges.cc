// SPDX-License-Identifier: Apache-2.0
#include "store/internal/open_ranges.h"

#include <array>
#include <cstdio>
#include <utility>

#include "store/base/redact.h"
#include "store/internal/packed_format.h"
#include "store/internal/range_cache.h"

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

bool IsUrl(const std::string& path) {
  return path.starts_with("http://") || path.starts_with("https://") || path.starts_with("s3://");
}

Result<std::unique_ptr<RangeReader>> OpenPackedRanges(const std::string& path,
                                                      const OpenOptions& options) {
  if (IsUrl(path)) {
    // The folder first: whoever names one that cannot be used should hear so at once.
    std::shared_ptr<RangeCache> cache;
    if (!options.cache_directory.empty()) {
      MTDB_ASSIGN_OR_RETURN(
          cache, RangeCache::Open(options.cache_directory, options.cache_directory_bytes));
    }
    auto remote = OpenHttpRanges(path);
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

#if !MTDB_HTTP
Result<std::unique_ptr<RangeReader>> OpenHttpRanges(const std::string& url) {
  return Unsupported(WithoutSecrets(url) +
                     ": this mtdb was built without libcurl, which reads URLs; install " +
                     "libcurl4-openssl-dev and build it again, or download the file");
}
#endif

}  // namespace mtdb::internal
