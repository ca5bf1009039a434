// SPDX-License-Identifier: Apache-2.0
// The file system's RangeReader.
#include <atomic>

#include "store/base/out_of_memory.h"
#include "store/internal/store_file.h"
#include "store/range_reader.h"

namespace mtdb {

using namespace internal;
namespace {

class FileRanges final : public RangeReader {
 public:
  FileRanges(std::unique_ptr<StoreFile> file, uint64_t size)
      : file_(std::move(file)), size_(size) {}

  const std::string& name() const override { return file_->path(); }
  uint64_t size() const override { return size_; }
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
  const uint64_t size_;
  std::atomic<uint64_t> requests_{0};
};

}  // namespace

Result<std::unique_ptr<RangeReader>> OpenFileRanges(const std::string& path) {
  MTDB_ASSIGN_OR_RETURN(auto file, StoreFile::Open(path, StoreFile::Access::kRead));
  MTDB_ASSIGN_OR_RETURN(const uint64_t size, file->Size());
  return std::unique_ptr<RangeReader>(new FileRanges(std::move(file), size));
}

}  // namespace mtdb
