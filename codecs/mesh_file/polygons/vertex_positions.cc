// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/polygons/vertex_positions.h"

#include <cerrno>
#include <filesystem>
#include <system_error>
#include <unistd.h>

#include "store/files/posix_file.h"

namespace mtdb::internal {

PositionSpool::~PositionSpool() {
  if (file_ >= 0) ::close(file_);
}

Status PositionSpool::FileError() const {
  const int error = errno;
  return {FileErrorCode(error),
          folder_ + ": temporary file: " + std::generic_category().message(error) +
              "; free some space, or name another folder for temporary files"};
}

Status PositionSpool::Flush() {
  if ((written_ + positions_.size()) * sizeof(Vec3d) > max_bytes_) {
    return {StatusCode::kBudgetExceeded,
            "the positions that faces of more than three corners need take more than the " +
                std::to_string(max_bytes_ >> 20) +
                " MiB that temporary files may still take; allow more (--max-tmp)"};
  }
  if (file_ < 0) {
    std::error_code error;
    if (folder_.empty()) folder_ = std::filesystem::temp_directory_path(error).string();
    if (folder_.empty()) folder_ = "/tmp";
    file_ = OpenNamelessFile(folder_, "mtdb-positions-");
    if (file_ < 0) return FileError();
  }
  if (!WriteFully(file_, written_ * sizeof(Vec3d), positions_.data(),
                  positions_.size() * sizeof(Vec3d))) {
    return FileError();
  }
  written_ += positions_.size();
  positions_.clear();
  return Status::Ok();
}

Status PositionSpool::Read(uint64_t first, std::span<Vec3d> out) {
  const ssize_t n = ReadFully(file_, first * sizeof(Vec3d), out.data(), out.size_bytes());
  if (n == static_cast<ssize_t>(out.size_bytes())) return Status::Ok();
  if (n >= 0) errno = EIO;
  return FileError();
}

}  // namespace mtdb::internal
