// SPDX-License-Identifier: Apache-2.0
#include "store/packed/range_cache.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <fcntl.h>
#include <filesystem>
#include <optional>
#include <span>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>
#include <utility>

#include "store/base/hash.h"
#include "store/base/out_of_memory.h"
#include "store/files/posix_file.h"

namespace mtdb::internal {

namespace {

constexpr uint64_t kBlocks = RangeCache::kSegmentBytes / RangeCache::kBlockBytes;
constexpr uint64_t kHeaderBytes = kBlocks * sizeof(uint64_t);
constexpr const char* kEnding = ".mtdbc";
// The folder may be shared: nobody is waited for, and no link is followed.
constexpr int kEntryFlags = O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK;
// So much may be put between two looks at the folder; a part of the limit where that is small.
constexpr uint64_t kMostBetweenTrims = 16 << 20;

class Descriptor {
 public:
  explicit Descriptor(int file) : file_(file) {}
  ~Descriptor() {
    if (file_ >= 0) ::close(file_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  bool is_open() const { return file_ >= 0; }
  int get() const { return file_; }

 private:
  const int file_;
};

// Never 0.
uint64_t ChecksumOf(ByteSpan bytes, uint64_t block) {
  return std::max<uint64_t>(1, Hash64(bytes, Mix64(block)));
}

uint64_t Room(uint64_t limit) { return std::min(kMostBetweenTrims, limit / 8); }

}  // namespace

Result<std::shared_ptr<RangeCache>> RangeCache::Open(const std::string& folder,
                                                     uint64_t limit_bytes) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error || ::access(folder.c_str(), R_OK | W_OK | X_OK) != 0) {
    const int code = error ? error.value() : errno;
    return Status(FileErrorCode(code),
                  folder + ": cannot keep ranges of files here: " + std::strerror(code));
  }
  std::shared_ptr<RangeCache> cache(new RangeCache(folder, limit_bytes));
  cache->Trim();
  return cache;
}

std::string RangeCache::PathOf(const std::string& hash, uint64_t segment) const {
  return folder_ + "/" + hash + "-" + std::to_string(segment) + kEnding;
}

bool RangeCache::Get(const std::string& hash, uint64_t block, std::span<std::byte> bytes) {
  const Descriptor file(::open(PathOf(hash, block / kBlocks).c_str(), O_RDONLY | kEntryFlags));
  if (!file.is_open()) return false;
  const uint64_t at = block % kBlocks;
  uint64_t checksum = 0;
  if (ReadFully(file.get(), at * sizeof(checksum), &checksum, sizeof(checksum)) !=
          sizeof(checksum) ||
      checksum == 0) {
    return false;
  }
  if (ReadFully(file.get(), kHeaderBytes + at * kBlockBytes, bytes.data(), bytes.size()) !=
      static_cast<ssize_t>(bytes.size())) {
    return false;
  }
  if (ChecksumOf(bytes, block) != checksum) return false;
  // What was used last stays.
  constexpr time_t kFresh = 60;
  struct stat s {};
  if (::fstat(file.get(), &s) == 0 && s.st_mtime + kFresh < std::time(nullptr)) {
    ::futimens(file.get(), nullptr);
  }
  return true;
}

void RangeCache::Put(const std::string& hash, uint64_t first_block, ByteSpan bytes) {
  if (put_bytes_ + bytes.size() > Room(limit_)) Trim();
  if (bytes.size() > Room(limit_)) return;
  put_bytes_ += bytes.size();
  for (uint64_t done = 0; done < bytes.size();) {
    const uint64_t block = first_block + done / kBlockBytes, at = block % kBlocks;
    const uint64_t size = std::min<uint64_t>(bytes.size() - done, (kBlocks - at) * kBlockBytes);
    const ByteSpan part = bytes.subspan(done, size);
    done += size;
    std::vector<uint64_t> checksums;
    for (uint64_t i = 0; i < part.size(); i += kBlockBytes) {
      const ByteSpan one = part.subspan(i, std::min<uint64_t>(kBlockBytes, part.size() - i));
      checksums.push_back(ChecksumOf(one, block + i / kBlockBytes));
    }
    const Descriptor file(
        ::open(PathOf(hash, block / kBlocks).c_str(), O_RDWR | O_CREAT | kEntryFlags, 0600));
    if (!file.is_open()) return;
    // The checksums follow what they prove.
    if (!WriteFully(file.get(), kHeaderBytes + at * kBlockBytes, part.data(), part.size()) ||
        !WriteFully(file.get(), at * sizeof(uint64_t), checksums.data(),
                    checksums.size() * sizeof(uint64_t))) {
      return;
    }
  }
}

bool RangeCache::Forget(const std::string& hash, ByteRange range) {
  bool any = false;
  for (uint64_t s = range.offset / kSegmentBytes; s * kSegmentBytes < range.offset + range.bytes;
       ++s) {
    any |= ::unlink(PathOf(hash, s).c_str()) == 0;
  }
  return any;
}

void RangeCache::Trim() {
  const std::lock_guard lock(trimming_);
  put_bytes_ = 0;
  struct Entry {
    timespec used;
    uint64_t bytes;
    std::string path;
  };
  std::vector<Entry> entries;
  uint64_t total = 0;
  std::error_code error;
  for (std::filesystem::directory_iterator at(folder_, error), end; !error && at != end;
       at.increment(error)) {
    std::string path = at->path().string();
    struct stat s {};
    if (!path.ends_with(kEnding) || ::lstat(path.c_str(), &s) != 0 || !S_ISREG(s.st_mode)) continue;
    constexpr uint64_t kStatBlock = 512;
    const uint64_t bytes = static_cast<uint64_t>(s.st_blocks) * kStatBlock;
    total += bytes;
    entries.push_back({s.st_mtim, bytes, std::move(path)});
  }
  std::ranges::sort(entries, {},
                    [](const Entry& e) { return std::pair(e.used.tv_sec, e.used.tv_nsec); });
  for (const Entry& entry : entries) {
    if (total + Room(limit_) <= limit_) break;
    if (::unlink(entry.path.c_str()) == 0 || errno == ENOENT) total -= entry.bytes;
  }
}

// ---- the reader ---------------------------------------------------------------------------------

namespace {

class KeptRanges final : public RangeReader {
 public:
  KeptRanges(std::unique_ptr<RangeReader> inner, std::shared_ptr<RangeCache> cache,
             std::string hash)
      : kept_(std::make_shared<Kept>(Kept{std::move(cache), std::move(hash)})),
        inner_(std::move(inner)) {}

  const std::string& name() const override { return inner_->name(); }
  uint64_t size() const override { return inner_->size(); }
  bool answers_at_once() const override { return false; }
  uint64_t bytes_read() const override { return inner_->bytes_read(); }
  uint64_t requests() const override { return inner_->requests(); }
  void Cancel(Ticket ticket) override { inner_->Cancel(ticket); }
  bool IsOutdated() const override { return inner_->IsOutdated(); }
  bool Forget(ByteRange range) override { return kept_->cache->Forget(kept_->hash, range); }

  // What is there at the beginning and at the end of the range is taken from the cache; the rest is
  // asked for as one range, in whole blocks.
  Ticket Read(ByteRange range, Answer answer) override {
    constexpr uint64_t kBlock = RangeCache::kBlockBytes;
    if (range.offset > size() || range.bytes > size() - range.offset || range.bytes == 0) {
      return inner_->Read(range, std::move(answer));
    }
    const uint64_t begin = range.offset / kBlock * kBlock;
    const uint64_t end =
        std::min(size(), (range.offset + range.bytes + kBlock - 1) / kBlock * kBlock);
    std::shared_ptr<Bytes> bytes;
    uint64_t from = 0, to = end - begin;
    const bool memory = TryAllocate([&] { bytes = std::make_shared<Bytes>(end - begin); });
    if (!memory) {
      answer(OutOfMemory());
      return 0;
    }
    const auto has = [&](uint64_t at) {
      const uint64_t size_here = std::min<uint64_t>(kBlock, bytes->size() - at);
      return kept_->cache->Get(kept_->hash, (begin + at) / kBlock,
                               std::span(*bytes).subspan(at, size_here));
    };
    while (from < to && has(from)) from = std::min(to, from + kBlock);
    while (from < to && has((to - 1) / kBlock * kBlock)) to = (to - 1) / kBlock * kBlock;
    const auto take = [bytes, skip = range.offset - begin, size = range.bytes]() -> Result<Bytes> {
      bytes->erase(bytes->begin(), bytes->begin() + static_cast<ptrdiff_t>(skip));
      bytes->resize(size);
      return std::move(*bytes);
    };
    if (from >= to) {
      answer(take());
      return 0;
    }
    return inner_->Read(
        {begin + from, to - from},
        [kept = kept_, bytes, take, begin, from, answer = std::move(answer)](Result<Bytes> rest) {
          if (!rest.ok()) return answer(std::move(rest));
          std::ranges::copy(*rest, bytes->begin() + static_cast<ptrdiff_t>(from));
          static_cast<void>(
              TryAllocate([&] { kept->cache->Put(kept->hash, (begin + from) / kBlock, *rest); }));
          answer(take());
        });
  }

 private:
  struct Kept {
    std::shared_ptr<RangeCache> cache;
    std::string hash;
  };
  const std::shared_ptr<Kept> kept_;
  const std::unique_ptr<RangeReader> inner_;
};

}  // namespace

std::unique_ptr<RangeReader> KeepRanges(std::unique_ptr<RangeReader> inner,
                                        std::shared_ptr<RangeCache> cache, std::string hash) {
  return std::make_unique<KeptRanges>(std::move(inner), std::move(cache), std::move(hash));
}

}  // namespace mtdb::internal
