// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/textures/corner_table.h"

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <system_error>
#include <unistd.h>

#include "store/files/posix_file.h"

namespace mtdb::internal {

CornerTable::~CornerTable() {
  if (file_ >= 0) ::close(file_);
}

Status CornerTable::FileError() const {
  const int error = errno;
  return {FileErrorCode(error),
          folder_ + ": temporary file: " + std::generic_category().message(error) +
              "; free some space, or name another folder for temporary files"};
}

void CornerTable::Clear() {
  places_.clear();
  blocks_.clear();
  size_ = 0;
  written_ = 0;
}

Status CornerTable::Flush() {
  if ((written_ + places_.size()) * sizeof(TexturePlace) > max_bytes_) {
    return {StatusCode::kBudgetExceeded,
            "the texture coordinates take more than the " + std::to_string(max_bytes_ >> 20) +
                " MiB that temporary files may still take; allow more (--max-tmp)"};
  }
  if (file_ < 0) {
    std::error_code error;
    if (folder_.empty()) folder_ = std::filesystem::temp_directory_path(error).string();
    if (folder_.empty()) folder_ = "/tmp";
    file_ = OpenNamelessFile(folder_, "mtdb-corners-");
    if (file_ < 0) return FileError();
  }
  if (!WriteFully(file_, written_ * sizeof(TexturePlace), places_.data(),
                  places_.size() * sizeof(TexturePlace))) {
    return FileError();
  }
  written_ += places_.size();
  places_.clear();
  return Status::Ok();
}

Status CornerTable::GetFromFile(uint64_t index, TexturePlace* place) {
  if (blocks_.empty()) {
    MTDB_RETURN_IF_ERROR(Flush());
    blocks_.assign(kSlots, ~uint64_t{0});
    places_.resize(kSlots * kBlock);
  }
  const uint64_t block = index / kBlock;
  const size_t slot = static_cast<size_t>(block % kSlots);
  TexturePlace* const own = places_.data() + slot * kBlock;
  if (blocks_[slot] != block) {
    const uint64_t first = block * kBlock;
    const size_t bytes =
        static_cast<size_t>(std::min<uint64_t>(kBlock, size_ - first)) * sizeof(TexturePlace);
    const ssize_t n = ReadFully(file_, first * sizeof(TexturePlace), own, bytes);
    if (n != static_cast<ssize_t>(bytes)) {
      if (n >= 0) errno = EIO;
      return FileError();
    }
    blocks_[slot] = block;
  }
  *place = own[index % kBlock];
  return Status::Ok();
}

}  // namespace mtdb::internal
