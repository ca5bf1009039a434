// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/atomic_file.h"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <dirent.h>
#include <fcntl.h>
#include <string_view>
#include <sys/file.h>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>

#include "store/files/guarded_file.h"
#include "store/files/posix_file.h"

namespace mtdb {
namespace {

// As strerror, which is not safe for threads.
std::string ErrorText(int error) { return std::generic_category().message(error); }

Status WriteError(const std::string& path, int error) {
  std::string message = path + ": cannot be written: " + ErrorText(error);
  // Whoever reads the pipe has had enough.
  if (error == EPIPE) return {StatusCode::kCancelled, message};
  if (FileErrorCode(error) == StatusCode::kNoSpace) {
    return {StatusCode::kNoSpace, message + "; make room or choose another place"};
  }
  return IoError(std::move(message));
}

std::string FolderOf(const std::string& path) {
  const size_t slash = path.rfind('/');
  return slash == std::string::npos ? "." : path.substr(0, slash + 1);
}

std::string TemporaryName(const std::string& path) {
  static std::atomic<uint64_t> next{0};
  return path + "." + std::to_string(::getpid()) + "-" + std::to_string(next++) + ".tmp";
}

// True for what TemporaryName() makes of `name`.
bool IsTemporaryOf(std::string_view file, std::string_view name) {
  if (!file.starts_with(name) || !file.ends_with(".tmp")) return false;
  file.remove_prefix(name.size());
  file.remove_suffix(std::min<size_t>(file.size(), 4));
  if (!file.starts_with('.')) return false;
  const size_t dash = file.find('-');
  const auto digits = [](std::string_view text) {
    return !text.empty() && text.find_first_not_of("0123456789") == text.npos;
  };
  return dash != file.npos && digits(file.substr(1, dash - 1)) && digits(file.substr(dash + 1));
}

// Removes temporary files of `path` whose processes are dead: nobody has locked them.
void SweepDead(const std::string& path) {
  const std::string folder = FolderOf(path);
  const std::string name = path.substr(path.rfind('/') + 1);
  DIR* const files = ::opendir(folder.c_str());
  if (files == nullptr) return;
  while (const dirent* const entry = ::readdir(files)) {
    if (!IsTemporaryOf(entry->d_name, name)) continue;
    const int file =
        ::openat(::dirfd(files), entry->d_name, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (file < 0) continue;
    struct stat info {};
    if (::fstat(file, &info) == 0 && S_ISREG(info.st_mode) &&
        ::flock(file, LOCK_EX | LOCK_NB) == 0) {
      (void)::unlinkat(::dirfd(files), entry->d_name, 0);
    }
    ::close(file);
  }
  ::closedir(files);
}

// What a symbolic link at `path` leads to, which need not exist; `path` itself when it is none.
std::string BehindLinks(std::string path) {
  constexpr int kMostLinks = 40;  // as the system's
  for (int i = 0; i < kMostLinks; ++i) {
    char target[4096];
    const ssize_t n = ::readlink(path.c_str(), target, sizeof(target));
    if (n <= 0 || n == sizeof(target)) return path;
    const std::string to(target, static_cast<size_t>(n));
    path = to[0] == '/' ? to : FolderOf(path) + (path.find('/') == path.npos ? "/" : "") + to;
  }
  return path;
}

// Permissions of the file that is replaced, and its owner and group where that is permitted.
void HandOn(const struct stat& from, int descriptor) {
  (void)!::fchown(descriptor, from.st_uid, from.st_gid);
  (void)::fchmod(descriptor, from.st_mode & 07777);
}

// Whether what has the path now may be replaced.
Status CheckReplaced(const std::string& path, const AtomicFileOptions& options) {
  const GuardedFile found = RecogniseFileAt(path);
  const bool is_allowed = found == GuardedFile::kPackedFile && options.replaces_packed_file;
  if (!is_allowed) MTDB_RETURN_IF_ERROR(RefuseToReplace(found, path));
  if (options.source.empty() || !IsSameFile(path, options.source)) return Status::Ok();
  return {StatusCode::kAlreadyExists, path + ": is the file that is read (" + options.source +
                                          "); nothing was written: give another name"};
}

}  // namespace

Result<std::unique_ptr<AtomicFile>> AtomicFile::Create(const std::string& name,
                                                       const AtomicFileOptions& options) {
  MTDB_RETURN_IF_ERROR(CheckReplaced(name, options));
  MTDB_ASSIGN_OR_RETURN(std::unique_ptr<AtomicFile> file, Make(name));
  file->options_ = options;
  return file;
}

Result<std::unique_ptr<AtomicFile>> AtomicFile::Make(const std::string& name) {
  struct stat info {};
  // A stream need not have the name that its link says: /dev/stdout leads to "pipe:[123]".
  const bool is_stream =
      ::stat(name.c_str(), &info) == 0 && !S_ISREG(info.st_mode) && !S_ISDIR(info.st_mode);
  const std::string path = is_stream ? name : BehindLinks(name);
  const bool there = ::stat(path.c_str(), &info) == 0;
  const bool replaces = there && S_ISREG(info.st_mode);
  const struct stat replaced = info;
  if (there && !S_ISREG(info.st_mode) && !S_ISDIR(info.st_mode)) {
    const int stream = TEMP_FAILURE_RETRY(::open(path.c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC));
    if (stream < 0) return WriteError(path, errno);
    std::unique_ptr<AtomicFile> file(new AtomicFile(path, "", stream));
    file->is_named_ = false;
    file->seekable_ = ::lseek(stream, 0, SEEK_CUR) >= 0;
    return file;
  }
  if (::stat(path.c_str(), &info) == 0 && S_ISDIR(info.st_mode)) {
    return IoError(path + ": is a directory, expected the name of a file");
  }
  SweepDead(path);
#ifdef O_TMPFILE
  if (::access("/proc/self/fd", X_OK) == 0) {  // else it could never have a name
    const int nameless =
        TEMP_FAILURE_RETRY(::open(FolderOf(path).c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, 0666));
    if (nameless >= 0) {
      (void)::flock(nameless, LOCK_EX | LOCK_NB);
      if (replaces) HandOn(replaced, nameless);
      return std::unique_ptr<AtomicFile>(new AtomicFile(path, "", nameless));
    }
  }
#endif
  for (int attempt = 0;; ++attempt) {
    std::string temporary = TemporaryName(path);
    const int descriptor = TEMP_FAILURE_RETRY(
        ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
    if (descriptor < 0) {
      if (errno == EEXIST && attempt < 1000) continue;  // left behind by a process of the same id
      return WriteError(path, errno);
    }
    // Waits for a process that took it for a dead one's before it was locked, and removes it.
    (void)::flock(descriptor, LOCK_EX);
    if (::fstat(descriptor, &info) == 0 && info.st_nlink == 0 && attempt < 1000) {
      ::close(descriptor);
      continue;
    }
    if (replaces) HandOn(replaced, descriptor);
    return std::unique_ptr<AtomicFile>(new AtomicFile(path, std::move(temporary), descriptor));
  }
}

Result<std::unique_ptr<AtomicFile>> AtomicFile::Into(int descriptor, const std::string& path) {
  // By its name, since it need not be open for reading.
  const std::string open_file = "/proc/self/fd/" + std::to_string(descriptor);
  MTDB_RETURN_IF_ERROR(RefuseToReplace(RecogniseFileAt(open_file), path));
  const int own = ::fcntl(descriptor, F_DUPFD_CLOEXEC, 0);
  if (own < 0) return WriteError(path, errno);
  std::unique_ptr<AtomicFile> file(new AtomicFile(path, "", own));
  file->is_named_ = false;
  file->seekable_ = ::lseek(own, 0, SEEK_CUR) >= 0;
  return file;
}

AtomicFile::AtomicFile(std::string path, std::string temporary, int descriptor)
    : path_(std::move(path)),
      temporary_(std::move(temporary)),
      descriptor_(descriptor),
      buffer_(size_t{1} << 20) {}

AtomicFile::~AtomicFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
}

Status AtomicFile::Append(ByteSpan bytes) {
  bytes_written_ += bytes.size();
  if (bytes.size() > buffer_.size() - buffered_) {
    MTDB_RETURN_IF_ERROR(Flush());
    if (bytes.size() >= buffer_.size()) return WriteAll(bytes);
  }
  if (!bytes.empty()) std::memcpy(buffer_.data() + buffered_, bytes.data(), bytes.size());
  buffered_ += bytes.size();
  return Status::Ok();
}

Status AtomicFile::Flush() {
  const ByteSpan bytes = ByteSpan(buffer_).first(buffered_);
  buffered_ = 0;
  return WriteAll(bytes);
}

Status AtomicFile::Overwrite(uint64_t offset, ByteSpan bytes) {
  MTDB_CHECK(offset + bytes.size() <= bytes_written_, "only what was appended is overwritten");
  if (!seekable_) {
    // Nothing was sent as long as all of it fits the buffer.
    if (bytes_written_ > buffered_) {
      return Unsupported(path_ +
                         ": this format goes back to its beginning, which a pipe cannot; "
                         "write it to a file");
    }
    std::memcpy(buffer_.data() + offset, bytes.data(), bytes.size());
    return Status::Ok();
  }
  MTDB_RETURN_IF_ERROR(Flush());
  return WriteAll(bytes, offset);
}

Status AtomicFile::WriteAll(ByteSpan bytes, std::optional<uint64_t> offset) {
  while (!bytes.empty()) {
    const ssize_t n =
        offset ? ::pwrite(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(*offset))
               : ::write(descriptor_, bytes.data(), bytes.size());
    if (n < 0) {
      if (errno == EINTR) continue;
      return WriteError(path_, errno);
    }
    bytes = bytes.subspan(static_cast<size_t>(n));
    if (offset) *offset += static_cast<uint64_t>(n);
  }
  return Status::Ok();
}

#ifdef O_TMPFILE
Status AtomicFile::Link() {
  const std::string open_file = "/proc/self/fd/" + std::to_string(descriptor_);
  const auto link_as = [&](const std::string& name) {
    return ::linkat(AT_FDCWD, open_file.c_str(), AT_FDCWD, name.c_str(), AT_SYMLINK_FOLLOW) == 0;
  };
  if (link_as(path_)) return Status::Ok();
  for (int attempt = 0; errno == EEXIST && attempt < 1000; ++attempt) {
    std::string temporary = TemporaryName(path_);
    if (link_as(temporary)) {
      temporary_ = std::move(temporary);
      return Status::Ok();
    }
  }
  return WriteError(path_, errno);
}
#else
Status AtomicFile::Link() { return Status::Ok(); }
#endif

Status AtomicFile::Commit() {
  MTDB_RETURN_IF_ERROR(Flush());
  if (is_named_ && ::fdatasync(descriptor_) != 0) return WriteError(path_, errno);
  // Some file systems tell of a full disk when a descriptor is closed. The file stays open, and
  // locked, until it has its name, so that nobody takes it for a dead one's.
  const int copy = ::dup(descriptor_);
  if (copy < 0 || ::close(copy) != 0) return WriteError(path_, errno);
  if (is_named_ && temporary_.empty()) MTDB_RETURN_IF_ERROR(Link());
  if (!temporary_.empty()) {
    // Somebody may have made a store there meanwhile.
    MTDB_RETURN_IF_ERROR(CheckReplaced(path_, options_));
    if (std::rename(temporary_.c_str(), path_.c_str()) != 0) return WriteError(path_, errno);
    temporary_.clear();
  }
  ::close(std::exchange(descriptor_, -1));
  return Status::Ok();
}

}  // namespace mtdb
