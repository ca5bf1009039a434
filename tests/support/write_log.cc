// SPDX-License-Identifier: Apache-2.0
// A library to preload (LD_PRELOAD): notes what a program does to the files of one folder, so that
// a test can make the disks that a power failure at any moment may have left
// (tests/support/power_loss.h).
//
//   MTDB_WRITE_LOG=FILE            the log; appended to
//   MTDB_WRITE_LOG_FOLDER=FOLDER   the folder, without symbolic links
//
// Sees open, write, writev, pwrite, pwritev, ftruncate, fsync, fdatasync, rename, renameat2 (of
// whole paths), linkat, unlink.
// Not seen: what is written through maps (LMDB's lock file) and by stdio. One note at a time: the
// order of the log is an order that happened.
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <dlfcn.h>
#include <fcntl.h>
#include <mutex>
#include <string>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

namespace {

template <typename Function>
Function Real(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}

std::recursive_mutex& Mutex() {
  static auto* const kMutex = new std::recursive_mutex;
  return *kMutex;
}

std::string Absolute(const char* path) {
  if (path[0] == '/') return path;
  char folder[4096];
  return ::getcwd(folder, sizeof(folder)) == nullptr ? std::string(path)
                                                     : std::string(folder) + "/" + path;
}

bool Concerns(const std::string& path) {
  const char* folder = std::getenv("MTDB_WRITE_LOG_FOLDER");
  return folder != nullptr && path.rfind(folder, 0) == 0;
}

// kind, then: u64 inode, u64 offset or size, u64 flag, u32 + first path, u32 + second path, u64 +
// data
void Note(char kind, uint64_t inode, uint64_t at, uint64_t flag, const std::string& path,
          const std::string& other, const void* data, uint64_t bytes) {
  static const int kLog = Real<int (*)(const char*, int, ...)>("open")(
      std::getenv("MTDB_WRITE_LOG"), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  std::string note(1, kind);
  const auto put = [&](const auto& value) {
    note.append(reinterpret_cast<const char*>(&value), sizeof(value));
  };
  put(inode);
  put(at);
  put(flag);
  for (const std::string* text : {&path, &other}) {
    put(static_cast<uint32_t>(text->size()));
    note += *text;
  }
  put(bytes);
  note.append(static_cast<const char*>(data), bytes);
  const auto write = Real<ssize_t (*)(int, const void*, size_t)>("write");
  if (write(kLog, note.data(), note.size()) != static_cast<ssize_t>(note.size())) std::abort();
}

struct File {
  bool concerned = false;
  bool folder = false;
  bool synchronous = false;
  bool append = false;
  uint64_t inode = 0;
  uint64_t size = 0;
  std::string path;
};

File Look(int descriptor) {
  File file;
  char path[4096];
  const std::string link = "/proc/self/fd/" + std::to_string(descriptor);
  const ssize_t n = ::readlink(link.c_str(), path, sizeof(path));
  if (n <= 0) return file;
  file.path.assign(path, static_cast<size_t>(n));
  file.concerned = Concerns(file.path);
  struct stat info {};
  if (!file.concerned || ::fstat(descriptor, &info) != 0) return file;
  file.folder = S_ISDIR(info.st_mode);
  file.inode = info.st_ino;
  file.size = static_cast<uint64_t>(info.st_size);
  const int flags = ::fcntl(descriptor, F_GETFL);
  file.synchronous = (flags & O_DSYNC) != 0;
  file.append = (flags & O_APPEND) != 0;
  return file;
}

void NoteWrite(const File& file, uint64_t at, const void* data, ssize_t bytes) {
  if (file.concerned && bytes > 0) {
    Note('W', file.inode, at, file.synchronous ? 1 : 0, "", "", data, static_cast<uint64_t>(bytes));
  }
}

uint64_t Position(int descriptor, const File& file) {
  return file.append ? file.size : static_cast<uint64_t>(::lseek(descriptor, 0, SEEK_CUR));
}

std::string Gathered(const struct iovec* parts, int count) {
  std::string all;
  for (int i = 0; i < count; ++i) {
    all.append(static_cast<const char*>(parts[i].iov_base), parts[i].iov_len);
  }
  return all;
}

int Open(const char* name, int folder, const char* path, int flags, mode_t mode) {
  const std::lock_guard lock(Mutex());
  const bool was_there = ::access(path, F_OK) == 0;
  const int descriptor =
      folder == AT_FDCWD
          ? Real<int (*)(const char*, int, ...)>(name)(path, flags, mode)
          : Real<int (*)(int, const char*, int, ...)>(name)(folder, path, flags, mode);
  const bool makes = (flags & (O_CREAT | O_TRUNC)) != 0 || (flags & O_TMPFILE) == O_TMPFILE;
  if (descriptor < 0 || !makes) return descriptor;
  const File file = Look(descriptor);
  if (!file.concerned) return descriptor;
  if ((flags & O_TMPFILE) == O_TMPFILE) {
    Note('N', file.inode, 0, 0, "", "", "", 0);
    return descriptor;
  }
  if (!was_there) Note('C', file.inode, 0, 0, file.path, "", "", 0);
  if (was_there && (flags & O_TRUNC) != 0) Note('T', file.inode, 0, 0, "", "", "", 0);
  return descriptor;
}

int Sync(const char* name, int descriptor) {
  const std::lock_guard lock(Mutex());
  const int result = Real<int (*)(int)>(name)(descriptor);
  const File file = Look(descriptor);
  if (result == 0 && file.concerned) {
    Note(file.folder ? 'D' : 'S', file.inode, 0, 0, file.path, "", "", 0);
  }
  return result;
}

}  // namespace

extern "C" {

#define MTDB_OPEN(name)                              \
  int name(const char* path, int flags, ...) {       \
    va_list more;                                    \
    va_start(more, flags);                           \
    const auto mode = va_arg(more, mode_t);          \
    va_end(more);                                    \
    return Open(#name, AT_FDCWD, path, flags, mode); \
  }
MTDB_OPEN(open)
MTDB_OPEN(open64)

ssize_t write(int descriptor, const void* data, size_t bytes) {
  const std::lock_guard lock(Mutex());
  const File file = Look(descriptor);
  const uint64_t at = file.concerned ? Position(descriptor, file) : 0;
  const ssize_t n = Real<ssize_t (*)(int, const void*, size_t)>("write")(descriptor, data, bytes);
  NoteWrite(file, at, data, n);
  return n;
}

ssize_t writev(int descriptor, const struct iovec* parts, int count) {
  const std::lock_guard lock(Mutex());
  const File file = Look(descriptor);
  const uint64_t at = file.concerned ? Position(descriptor, file) : 0;
  const ssize_t n =
      Real<ssize_t (*)(int, const struct iovec*, int)>("writev")(descriptor, parts, count);
  NoteWrite(file, at, Gathered(parts, count).data(), n);
  return n;
}

#define MTDB_PWRITE(name)                                                                       \
  ssize_t name(int descriptor, const void* data, size_t bytes, off_t at) {                      \
    const std::lock_guard lock(Mutex());                                                        \
    const File file = Look(descriptor);                                                         \
    const ssize_t n =                                                                           \
        Real<ssize_t (*)(int, const void*, size_t, off_t)>(#name)(descriptor, data, bytes, at); \
    NoteWrite(file, static_cast<uint64_t>(at), data, n);                                        \
    return n;                                                                                   \
  }
MTDB_PWRITE(pwrite)
MTDB_PWRITE(pwrite64)

#define MTDB_PWRITEV(name)                                                            \
  ssize_t name(int descriptor, const struct iovec* parts, int count, off_t at) {      \
    const std::lock_guard lock(Mutex());                                              \
    const File file = Look(descriptor);                                               \
    const ssize_t n = Real<ssize_t (*)(int, const struct iovec*, int, off_t)>(#name)( \
        descriptor, parts, count, at);                                                \
    NoteWrite(file, static_cast<uint64_t>(at), Gathered(parts, count).data(), n);     \
    return n;                                                                         \
  }
MTDB_PWRITEV(pwritev)
MTDB_PWRITEV(pwritev64)

#define MTDB_FTRUNCATE(name)                                                \
  int name(int descriptor, off_t size) {                                    \
    const std::lock_guard lock(Mutex());                                    \
    const File file = Look(descriptor);                                     \
    const int result = Real<int (*)(int, off_t)>(#name)(descriptor, size);  \
    if (result == 0 && file.concerned) {                                    \
      Note('T', file.inode, static_cast<uint64_t>(size), 0, "", "", "", 0); \
    }                                                                       \
    return result;                                                          \
  }
MTDB_FTRUNCATE(ftruncate)
MTDB_FTRUNCATE(ftruncate64)

int fsync(int descriptor) { return Sync("fsync", descriptor); }
int fdatasync(int descriptor) { return Sync("fdatasync", descriptor); }

int rename(const char* from, const char* to) {
  const std::lock_guard lock(Mutex());
  const int result = Real<int (*)(const char*, const char*)>("rename")(from, to);
  if (result == 0 && Concerns(Absolute(to))) {
    Note('R', 0, 0, 0, Absolute(from), Absolute(to), "", 0);
  }
  return result;
}

int renameat2(int from_folder, const char* from, int folder, const char* to, unsigned flags) {
  const std::lock_guard lock(Mutex());
  const int result = Real<int (*)(int, const char*, int, const char*, unsigned)>("renameat2")(
      from_folder, from, folder, to, flags);
  if (result == 0 && Concerns(Absolute(to))) {
    Note('R', 0, 0, 0, Absolute(from), Absolute(to), "", 0);
  }
  return result;
}

int linkat(int from_folder, const char* from, int folder, const char* to, int flags) {
  const std::lock_guard lock(Mutex());
  const int result = Real<int (*)(int, const char*, int, const char*, int)>("linkat")(
      from_folder, from, folder, to, flags);
  struct stat info {};
  if (result == 0 && Concerns(Absolute(to)) && ::stat(to, &info) == 0) {
    Note('L', info.st_ino, 0, 0, Absolute(to), "", "", 0);
  }
  return result;
}

int unlink(const char* path) {
  const std::lock_guard lock(Mutex());
  const int result = Real<int (*)(const char*)>("unlink")(path);
  if (result == 0 && Concerns(Absolute(path))) Note('U', 0, 0, 0, Absolute(path), "", "", 0);
  return result;
}

}  // extern "C"
