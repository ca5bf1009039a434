// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/file_piece.h"

#include <cerrno>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "store/files/posix_file.h"

namespace mtdb {

Result<Bytes> ReadPiece(const std::string& path, uint64_t offset, uint64_t bytes) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return errno == ENOENT ? NotFound("is not there") : IoError("cannot be opened");
  struct stat about {};
  const bool is_file = ::fstat(file, &about) == 0 && S_ISREG(about.st_mode);
  const auto size = static_cast<uint64_t>(about.st_size);
  Bytes piece;
  const bool fits = is_file && offset <= size && bytes <= size - offset;
  if (fits) piece.resize(bytes);
  const bool read =
      fits && ReadFully(file, offset, piece.data(), bytes) == static_cast<ssize_t>(bytes);
  ::close(file);
  if (!fits) return Corrupt("is shorter than it says, or no file");
  if (!read) return IoError("cannot be read");
  return piece;
}

Result<uint64_t> FileBytes(const std::string& path) {
  struct stat about {};
  if (::stat(path.c_str(), &about) != 0) return NotFound(path + ": is not there");
  return S_ISREG(about.st_mode) ? Result<uint64_t>(static_cast<uint64_t>(about.st_size))
                                : IoError(path + ": is no file");
}

}  // namespace mtdb
