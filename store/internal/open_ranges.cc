// SPDX-License-Identifier: Apache-2.0
#include "store/internal/open_ranges.h"

#include "store/internal/packed_format.h"

namespace mtdb::internal {

bool IsUrl(const std::string& path) {
  return path.starts_with("http://") || path.starts_with("https://") || path.starts_with("s3://");
}

Result<std::unique_ptr<RangeReader>> OpenPackedRanges(const std::string& path) {
  if (IsUrl(path)) return OpenHttpRanges(path);
  auto ranges = OpenFileRanges(path);
  // The store's own messages tell what is wrong.
  if (!ranges.ok() || (*ranges)->size() < kPackedHeaderBytes) return std::unique_ptr<RangeReader>();
  const auto magic = ReadRange(**ranges, {0, kPackedHeaderBytes});
  if (!magic.ok() || !IsPackedMagic(*magic)) return std::unique_ptr<RangeReader>();
  return ranges;
}

#if !MTDB_HTTP
Result<std::unique_ptr<RangeReader>> OpenHttpRanges(const std::string& url) {
  return Unsupported(url + ": this mtdb was built without libcurl, which reads URLs; install " +
                     "libcurl4-openssl-dev and build it again, or download the file");
}
#endif

}  // namespace mtdb::internal
