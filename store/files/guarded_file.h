// SPDX-License-Identifier: Apache-2.0
// What must not be lost by a wrong word of a command line: stores, packed files, and what belongs
// to them. Whoever writes a file that takes the place of another asks here first.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <memory>
#include <string>
#include <string_view>
#include <sys/stat.h>
#include <unistd.h>

#include "store/base/status.h"
#include "store/files/posix_file.h"

namespace mtdb {

enum class GuardedFile { kNone, kStore, kStoreLock, kPackedFile, kJournal };

namespace internal {

// LMDB's, of the meta pages of a data file and of the beginning of a lock file.
inline constexpr std::array<unsigned char, 4> kLmdbMagic{0xde, 0xc0, 0xef, 0xbe};
// The header of meta page 0: its number, padding, the flag of meta pages, no bounds.
inline constexpr std::array<unsigned char, 16> kFirstPageHeader{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 8};
inline constexpr size_t kLmdbHeaderBytes = kFirstPageHeader.size();
inline constexpr std::string_view kPackedWord = "mtdb packed";
inline constexpr std::string_view kJournalWord = "mtdb journal";

inline bool IsMetaPage(const unsigned char* bytes, size_t size, unsigned char number) {
  auto header = kFirstPageHeader;
  header[0] = number;
  return size >= kLmdbHeaderBytes + kLmdbMagic.size() &&
         std::memcmp(bytes, header.data(), header.size()) == 0 &&
         std::memcmp(bytes + header.size(), kLmdbMagic.data(), kLmdbMagic.size()) == 0;
}

// One of the two meta pages is enough, and of the first its magic or its header.
inline bool IsStoreStart(int file, const unsigned char* bytes, size_t size) {
  if (size >= kLmdbHeaderBytes && std::memcmp(bytes, kFirstPageHeader.data(), 16) == 0) return true;
  if (size >= kLmdbHeaderBytes + kLmdbMagic.size() &&
      std::memcmp(bytes + kLmdbHeaderBytes, kLmdbMagic.data(), kLmdbMagic.size()) == 0) {
    return true;
  }
  constexpr uint64_t kLeastPage = 512, kLargestPage = 65536;
  for (uint64_t page = kLeastPage; page <= kLargestPage; page *= 2) {
    std::array<unsigned char, 32> second;
    const ssize_t n = ReadFully(file, page, second.data(), second.size());
    if (n > 0 && IsMetaPage(second.data(), static_cast<size_t>(n), 1)) return true;
  }
  return false;
}

}  // namespace internal

// What an open file is, by its first bytes: also one that is damaged, cut short or of a later
// version. kNone for what cannot be read.
inline GuardedFile RecogniseFile(int file) {
  using namespace internal;
  std::array<unsigned char, 32> bytes;
  const ssize_t n = ReadFully(file, 0, bytes.data(), bytes.size());
  if (n <= 0) return GuardedFile::kNone;
  const std::string_view start(reinterpret_cast<const char*>(bytes.data()), static_cast<size_t>(n));
  if (start.starts_with(kPackedWord)) return GuardedFile::kPackedFile;
  if (start.starts_with(kJournalWord)) return GuardedFile::kJournal;
  if (start.size() >= kLmdbMagic.size() &&
      std::memcmp(start.data(), kLmdbMagic.data(), kLmdbMagic.size()) == 0) {
    return GuardedFile::kStoreLock;
  }
  return IsStoreStart(file, bytes.data(), static_cast<size_t>(n)) ? GuardedFile::kStore
                                                                  : GuardedFile::kNone;
}

// As RecogniseFile(), of what a path leads to. A file whose first bytes say nothing is a store too
// when a lock file lies beside it: somebody is making it, or its beginning was written over. Lock
// files are known by their names and never opened here: closing one would drop the locks that this
// process has on it.
inline GuardedFile RecogniseFileAt(const std::string& path) {
  constexpr std::string_view kLock = "-lock";
  constexpr off_t kLeastLockBytes = 4096;
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0 || !S_ISREG(info.st_mode) || info.st_size == 0) {
    return GuardedFile::kNone;
  }
  const std::unique_ptr<char, decltype(&std::free)> real(::realpath(path.c_str(), nullptr),
                                                         &std::free);
  const std::string name = real == nullptr ? path : std::string(real.get());
  if (name.ends_with(kLock)) {
    const std::string store = name.substr(0, name.size() - kLock.size());
    if (RecogniseFileAt(store) == GuardedFile::kStore) return GuardedFile::kStoreLock;
  }
  const int file = ::open(name.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
  const GuardedFile found = file < 0 ? GuardedFile::kNone : RecogniseFile(file);
  if (file >= 0) ::close(file);
  if (found != GuardedFile::kNone) return found;
  const bool has_lock = ::stat((name + std::string(kLock)).c_str(), &info) == 0 &&
                        S_ISREG(info.st_mode) && info.st_size >= kLeastLockBytes;
  return has_lock ? GuardedFile::kStore : GuardedFile::kNone;
}

// kAlreadyExists, which says what is there and what to do; Ok for kNone. `path` as it was given.
inline Status RefuseToReplace(GuardedFile found, const std::string& path) {
  const char* what = nullptr;
  switch (found) {
    case GuardedFile::kNone: return Status::Ok();
    case GuardedFile::kStore: what = "a store, whose objects would be lost"; break;
    case GuardedFile::kStoreLock: what = "the lock file of a store"; break;
    case GuardedFile::kPackedFile: what = "a packed file, whose objects would be lost"; break;
    case GuardedFile::kJournal: what = "the journal of an interrupted ingest"; break;
  }
  return {StatusCode::kAlreadyExists,
          path + ": what has this name is " + what +
              "; nothing was written: give another name, or remove that file first"};
}

// Whether something may take the place of what `path` leads to, through links too.
inline Status CheckReplaceable(const std::string& path) {
  return RefuseToReplace(RecogniseFileAt(path), path);
}

// Whether two paths lead to one file.
inline bool IsSameFile(const std::string& a, const std::string& b) {
  struct stat of_a {
  }, of_b{};
  return ::stat(a.c_str(), &of_a) == 0 && ::stat(b.c_str(), &of_b) == 0 &&
         of_a.st_dev == of_b.st_dev && of_a.st_ino == of_b.st_ino;
}

}  // namespace mtdb
