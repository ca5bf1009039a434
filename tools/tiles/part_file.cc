// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/part_file.h"

#include <cerrno>
#include <system_error>
#include <unistd.h>

#include "store/files/posix_file.h"

namespace mtdb {

namespace {

Status Failed(const std::string& folder, int error) {
  return {FileErrorCode(error), folder + ": a temporary file cannot be written: " +
                                    std::generic_category().message(error)};
}

}  // namespace

Result<std::unique_ptr<PartFile>> PartFile::Create(const std::string& folder) {
  const int file = OpenNamelessFile(folder, "mtdb-tiles-");
  if (file < 0) return Failed(folder, errno);
  return std::unique_ptr<PartFile>(new PartFile(folder, file));
}

PartFile::~PartFile() { ::close(file_); }

Status PartFile::Append(ByteSpan bytes) {
  if (!WriteFully(file_, size_bytes_, bytes.data(), bytes.size())) return Failed(folder_, errno);
  size_bytes_ += bytes.size();
  return Status::Ok();
}

Status PartFile::Read(uint64_t offset, std::span<std::byte> to) const {
  if (ReadFully(file_, offset, to.data(), to.size()) == static_cast<ssize_t>(to.size())) {
    return Status::Ok();
  }
  return IoError(folder_ + ": a temporary file cannot be read");
}

}  // namespace mtdb
