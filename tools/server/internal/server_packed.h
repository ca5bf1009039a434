// SPDX-License-Identifier: Apache-2.0
// /objects/NAME/packed: an object as the packed file that `mtdb pack` would write, by ranges.
#pragma once

#include <cstddef>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "store/base/status.h"
#include "store/database.h"
#include "store/packed_file.h"
#include "store/range_reader.h"
#include "tools/server/internal/named_locks.h"

namespace mtdb::internal {

// The images that were asked for last. Safe for many threads.
class PackedImages {
 public:
  explicit PackedImages(size_t most) : most_(most) {}
  // Of the object of that name as it is now. Errors: those of opening it, kNotFound.
  Result<std::shared_ptr<const PackedImage>> Open(const Database& database,
                                                  const std::string& name);
  // Forgets those that were made; who has one keeps it.
  void Clear();

 private:
  std::shared_ptr<const PackedImage> Find(const ObjectRecord& record);

  const size_t most_;
  NamedLocks opening_;  // held while an image is made
  std::mutex mutex_;
  std::vector<std::shared_ptr<const PackedImage>> images_;  // the last used last
};

struct PackedRequest {
  std::string range;     // the header Range; empty: all of the file
  std::string if_range;  // the header If-Range
  std::string hash;      // the parameter; empty: whatever the file is now
};

// What the answer is.
struct RangedPart {
  unsigned status = 200;  // 206: of a range; 412: of another file; 416: the range is none of it
  ByteRange range;        // of the file
};
// `range`: the header Range.
RangedPart FindPart(const std::string& range, uint64_t size);
// One range with one bound or two; several are answered as RFC 9110 has it for who does not
// understand them: with all of the file.
RangedPart FindPackedPart(const PackedImage& image, const PackedRequest& request);

}  // namespace mtdb::internal
