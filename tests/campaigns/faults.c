/* SPDX-License-Identifier: Apache-2.0 */
// A library to be preloaded (LD_PRELOAD): counts a program's operations on files below a folder,
// and makes the n-th one fail.
//
//   MTDB_FAULT_UNDER   the folder; operations on other files are neither counted nor changed
//   MTDB_FAULT_AT      which operation, from 1; 0: none
//   MTDB_FAULT         eio (reads, writes, syncs), enospc (writes, names; from then on), eintr
//   (reads, writes, opens; once),
//                      short (reads, writes: half of it), kill (SIGKILL before it), torn (SIGKILL
//                      after half of a write)
//   MTDB_FAULT_COUNT   a file that gets the number of operations when the program ends
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

enum Kind { kRead, kWrite, kSync, kOpen, kName };
enum Fault { kNone, kEio, kEnospc, kEintr, kShort, kKill, kTorn };

static atomic_long operations;

static const char* Setting(const char* name) {
  const char* value = getenv(name);
  return value == NULL ? "" : value;
}

static enum Fault Wanted(void) {
  static const char* const kNames[] = {"", "eio", "enospc", "eintr", "short", "kill", "torn"};
  for (int i = 1; i < 7; ++i) {
    if (strcmp(Setting("MTDB_FAULT"), kNames[i]) == 0) return (enum Fault)i;
  }
  return kNone;
}

static int IsUnder(const char* path) {
  const char* folder = Setting("MTDB_FAULT_UNDER");
  return folder[0] != 0 && strncmp(path, folder, strlen(folder)) == 0;
}

static int IsFileUnder(int fd) {
  char name[64];
  char path[4096];
  snprintf(name, sizeof name, "/proc/self/fd/%d", fd);
  const ssize_t length = readlink(name, path, sizeof path - 1);
  if (length <= 0) return 0;
  path[length] = 0;
  struct stat info;
  return IsUnder(path) && fstat(fd, &info) == 0 && S_ISREG(info.st_mode);
}

static int IsPathUnder(int folder, const char* path) {
  char joined[8192];
  if (path[0] == '/') return IsUnder(path);
  char name[64];
  if (folder == AT_FDCWD) {
    if (getcwd(joined, 4096) == NULL) return 0;
  } else {
    snprintf(name, sizeof name, "/proc/self/fd/%d", folder);
    const ssize_t length = readlink(name, joined, 4095);
    if (length <= 0) return 0;
    joined[length] = 0;
  }
  strcat(joined, "/");
  strncat(joined, path, 4000);
  return IsUnder(joined);
}

// What is to happen to an operation that counts: nothing, an error (errno is set) or half of it.
enum Outcome { kAsIs, kFails, kHalf, kHalfThenDies };
static enum Outcome Next(enum Kind kind) {
  const long n = ++operations;
  const long at = atol(Setting("MTDB_FAULT_AT"));
  const enum Fault fault = Wanted();
  if (at == 0 || n < at || (n > at && fault != kEnospc)) return kAsIs;
  const int moves = kind == kRead || kind == kWrite;
  if (fault == kKill) raise(SIGKILL);
  if (fault == kTorn) {
    if (kind != kWrite) raise(SIGKILL);
    return kHalfThenDies;
  }
  if (fault == kShort && moves) return kHalf;
  if (fault == kEintr && (moves || kind == kOpen)) return errno = EINTR, kFails;
  if (fault == kEio && (moves || kind == kSync)) return errno = EIO, kFails;
  if (fault == kEnospc && (kind == kWrite || kind == kName)) return errno = ENOSPC, kFails;
  return kAsIs;
}

static size_t Part(enum Outcome outcome, size_t bytes) {
  return outcome == kAsIs || bytes < 2 ? bytes : bytes / 2;
}
static ssize_t Ended(enum Outcome outcome, ssize_t result) {
  if (outcome == kHalfThenDies) raise(SIGKILL);
  return result;
}

#define NEXT(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

#define MOVES(result, name, kind, parameters, bytes, ...) \
  result name parameters {                                \
    if (!IsFileUnder(fd)) {                               \
      const size_t part = bytes;                          \
      return NEXT(name)(__VA_ARGS__);                     \
    }                                                     \
    const enum Outcome outcome = Next(kind);              \
    if (outcome == kFails) return -1;                     \
    const size_t part = Part(outcome, bytes);             \
    return Ended(outcome, NEXT(name)(__VA_ARGS__));       \
  }

MOVES(ssize_t, read, kRead, (int fd, void* data, size_t n), n, fd, data, part)
MOVES(ssize_t, write, kWrite, (int fd, const void* data, size_t n), n, fd, data, part)
MOVES(ssize_t, pread, kRead, (int fd, void* data, size_t n, off_t at), n, fd, data, part, at)
MOVES(ssize_t, pread64, kRead, (int fd, void* data, size_t n, off64_t at), n, fd, data, part, at)
MOVES(ssize_t, pwrite, kWrite, (int fd, const void* data, size_t n, off_t at), n, fd, data, part,
      at)
MOVES(ssize_t, pwrite64, kWrite, (int fd, const void* data, size_t n, off64_t at), n, fd, data,
      part, at)

// Vectors are cut between their parts; one of a single part goes whole.
#define VECTORS(name, parameters, ...)              \
  ssize_t name parameters {                         \
    if (!IsFileUnder(fd)) {                         \
      const int part = n;                           \
      return NEXT(name)(__VA_ARGS__);               \
    }                                               \
    const enum Outcome outcome = Next(kWrite);      \
    if (outcome == kFails) return -1;               \
    const int part = (int)Part(outcome, (size_t)n); \
    return Ended(outcome, NEXT(name)(__VA_ARGS__)); \
  }
VECTORS(writev, (int fd, const struct iovec* parts, int n), fd, parts, part)
VECTORS(pwritev, (int fd, const struct iovec* parts, int n, off_t at), fd, parts, part, at)
VECTORS(pwritev64, (int fd, const struct iovec* parts, int n, off64_t at), fd, parts, part, at)

#define FILES(name, kind, parameters, ...)                 \
  int name parameters {                                    \
    if (IsFileUnder(fd) && Next(kind) != kAsIs) return -1; \
    return NEXT(name)(__VA_ARGS__);                        \
  }
FILES(fsync, kSync, (int fd), fd)
FILES(fdatasync, kSync, (int fd), fd)
FILES(ftruncate, kName, (int fd, off_t size), fd, size)
FILES(ftruncate64, kName, (int fd, off64_t size), fd, size)

#define OPENS(name, under, parameters, ...)                                        \
  int name parameters {                                                            \
    mode_t mode = 0;                                                               \
    if ((flags & O_CREAT) != 0 || (flags & O_TMPFILE) == O_TMPFILE) {              \
      va_list rest;                                                                \
      va_start(rest, flags);                                                       \
      mode = va_arg(rest, mode_t);                                                 \
      va_end(rest);                                                                \
    }                                                                              \
    if (under && Next((flags & O_CREAT) != 0 ? kName : kOpen) != kAsIs) return -1; \
    return NEXT(name)(__VA_ARGS__, flags, mode);                                   \
  }
OPENS(open, IsUnder(path), (const char* path, int flags, ...), path)
OPENS(open64, IsUnder(path), (const char* path, int flags, ...), path)
OPENS(openat, IsPathUnder(folder, path), (int folder, const char* path, int flags, ...), folder,
      path)
OPENS(openat64, IsPathUnder(folder, path), (int folder, const char* path, int flags, ...), folder,
      path)

int rename(const char* from, const char* to) {
  if (IsPathUnder(AT_FDCWD, to) && Next(kName) != kAsIs) return -1;
  return NEXT(rename)(from, to);
}
int renameat2(int from_folder, const char* from, int to_folder, const char* to, unsigned flags) {
  if (IsPathUnder(to_folder, to) && Next(kName) != kAsIs) return -1;
  return NEXT(renameat2)(from_folder, from, to_folder, to, flags);
}
int linkat(int from_folder, const char* from, int to_folder, const char* to, int flags) {
  if (IsPathUnder(to_folder, to) && Next(kName) != kAsIs) return -1;
  return NEXT(linkat)(from_folder, from, to_folder, to, flags);
}

__attribute__((destructor)) static void Report(void) {
  const char* path = Setting("MTDB_FAULT_COUNT");
  if (path[0] == 0) return;
  FILE* file = fopen(path, "w");
  if (file == NULL) return;
  fprintf(file, "%ld\n", (long)operations);
  fclose(file);
}
