// SPDX-License-Identifier: Apache-2.0
// The file system's RangeReader.
#include <atomic>
#include <cerrno>
#include <cstring>
#include <sys/stat.h>

#include "store/base/out_of_memory.h"
#include "store/carriers/store_file.h"
#include "store/range_reader.h"

namespace mtdb {

using namespace internal;
namespace {

class FileRanges final : public RangeReader {
 public:
  FileRanges(std::unique_ptr<StoreFile> file, const struct stat& opened)
      : file_(std::move(file)), opened_(opened) {}

  const std::string& name() const override { return file_->path(); }
  uint64_t size() const override { return static_cast<uint64_t>(opened_.st_size); }
  // Also when it was written over, which nobody should do: what is there now may be whole.
  bool IsOutdated() const override {
    struct stat now {};
    return ::stat(file_->path().c_str(), &now) != 0 || now.st_dev != opened_.st_dev ||
           now.st_ino != opened_.st_ino || now.st_size != opened_.st_size ||
           now.st_mtim.tv_sec != opened_.st_mtim.tv_sec ||
           now.st_mtim.tv_nsec != opened_.st_mtim.tv_nsec;
  }
  Ticket Read(ByteRange range, Answer answer) override {
    ++requests_;
    answer(CatchOutOfMemory([&]() -> Result<Bytes> {
      Bytes bytes(range.bytes);
      MTDB_RETURN_IF_ERROR(file_->ReadAt(range.offset, bytes));
      return bytes;
    }));
    return 0;
  }
  bool answers_at_once() const override { return true; }
  uint64_t bytes_read() const override { return file_->bytes_read(); }
  uint64_t requests() const override { return requests_; }

 private:
  const std::unique_ptr<StoreFile> file_;
  const struct stat opened_;
  std::atomic<uint64_t> requests_{0};
};

}  // namespace

Result<std::unique_ptr<RangeReader>> OpenFileRanges(const std::string& path) {
  MTDB_ASSIGN_OR_RETURN(auto file, StoreFile::Open(path, StoreFile::Access::kRead));
  struct stat opened {};
  if (::fstat(file->descriptor(), &opened) != 0) {
    return IoError(path + ": cannot stat: " + std::strerror(errno));
  }
  return std::unique_ptr<RangeReader>(new FileRanges(std::move(file), opened));
}

}  // namespace mtdb
