// SPDX-License-Identifier: Apache-2.0
// RangeCache: ranges of immutable files in a folder, shared by processes, within a limit of bytes.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/range_reader.h"

namespace mtdb::internal {

// A file is known by the hash of its content, and has an entry for each 8 MiB of it that something
// was read of: FOLDER/HASH-SEGMENT.mtdbc, the checksums of its blocks of 4 KiB (0: not there), then
// the blocks, each where it lies in the segment, with holes between. A block is there when its
// checksum says so, whoever wrote it and however far he came: what is damaged or half written
// is not there, and is read again. What was damaged when it came looks whole here; who finds that
// it is not says so to Forget. Nothing is locked, and the entries that were used last stay. Safe
// for many threads and processes.
class RangeCache {
 public:
  static constexpr uint64_t kBlockBytes = 4 << 10;
  static constexpr uint64_t kSegmentBytes = 8 << 20;

  // Makes the folder. Errors: kIoError, kNoSpace.
  static Result<std::shared_ptr<RangeCache>> Open(const std::string& folder, uint64_t limit_bytes);

  // The block of that number, if it is there. The last block of a file is shorter.
  bool Get(const std::string& hash, uint64_t block, std::span<std::byte> bytes);
  // Keeps whole blocks that follow each other, the last of which may be the file's last. What
  // cannot be kept (a full disk, no permission) is not.
  void Put(const std::string& hash, uint64_t first_block, ByteSpan bytes);
  // Nothing of the segments of these bytes is there any more. False when nothing was.
  bool Forget(const std::string& hash, ByteRange range);

 private:
  RangeCache(std::string folder, uint64_t limit_bytes)
      : folder_(std::move(folder)), limit_(limit_bytes) {}
  std::string PathOf(const std::string& hash, uint64_t segment) const;
  // Takes entries away until what is left leaves some room below the limit.
  void Trim();

  const std::string folder_;
  const uint64_t limit_;
  std::atomic<uint64_t> put_bytes_{0};  // since the last Trim
  std::mutex trimming_;
};

// `inner`, with its ranges kept in the cache. `hash`: of its content.
std::unique_ptr<RangeReader> KeepRanges(std::unique_ptr<RangeReader> inner,
                                        std::shared_ptr<RangeCache> cache, std::string hash);

}  // namespace mtdb::internal
