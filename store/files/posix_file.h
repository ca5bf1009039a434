// SPDX-License-Identifier: Apache-2.0
// What all layers that have files do with descriptors: go on until all is read or written, make
// files that have no names, tell which errors mean that there is no room.
#pragma once

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <fcntl.h>
#include <string>
#include <unistd.h>

#include "store/base/status.h"

namespace mtdb {

// kNoSpace for a full disk, an exceeded quota or the largest size of a file; else kIoError.
inline StatusCode FileErrorCode(int error) {
  const bool full = error == ENOSPC || error == EDQUOT || error == EFBIG;
  return full ? StatusCode::kNoSpace : StatusCode::kIoError;
}

// Reads `size` bytes from `offset` on, fewer only at the end of the file; -1: see errno.
inline ssize_t ReadFully(int file, uint64_t offset, void* data, size_t size) {
  size_t done = 0;
  while (done < size) {
    const ssize_t n = ::pread(file, static_cast<std::byte*>(data) + done, size - done,
                              static_cast<off_t>(offset + done));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return n;
    if (n == 0) break;
    done += static_cast<size_t>(n);
  }
  return static_cast<ssize_t>(done);
}

// Writes all of it at `offset`; false: see errno.
inline bool WriteFully(int file, uint64_t offset, const void* data, size_t size) {
  for (size_t done = 0; done < size;) {
    const ssize_t n = ::pwrite(file, static_cast<const std::byte*>(data) + done, size - done,
                               static_cast<off_t>(offset + done));
    if (n < 0 && errno == EINTR) continue;
    if (n == 0) errno = EIO;
    if (n <= 0) return false;
    done += static_cast<size_t>(n);
  }
  return true;
}

// Gives the room of these bytes back, which read as zeros then; false where there is no way.
inline bool PunchHole([[maybe_unused]] int file, [[maybe_unused]] uint64_t offset,
                      [[maybe_unused]] uint64_t size) {
#ifdef FALLOC_FL_PUNCH_HOLE
  return ::fallocate(file, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, static_cast<off_t>(offset),
                     static_cast<off_t>(size)) == 0;
#else
  return false;
#endif
}

// A file to read and write that is gone with its last descriptor, whatever becomes of the process;
// -1: see errno. `prefix` is of the name that it has for a moment where the file system wants one.
inline int OpenNamelessFile(const std::string& folder, const char* prefix) {
#ifdef O_TMPFILE
  int file = -1;
  do {
    file = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  } while (file < 0 && errno == EINTR);
  if (file >= 0) return file;
#endif
  std::string name = folder + "/" + prefix + std::string(6, 'X');  // which mkostemp replaces
  const int named = ::mkostemp(name.data(), O_CLOEXEC);
  if (named >= 0) ::unlink(name.c_str());
  return named;
}

}  // namespace mtdb
