// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/internal/open_input.h"

#include <array>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <poll.h>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>
#include <utility>
#include <vector>
#include <zlib.h>

#include "store/base/bytes.h"
#include "store/files/posix_file.h"

namespace mtdb::internal {

namespace {

constexpr size_t kBlock = size_t{1} << 18;

// A descriptor that is closed unless it is released.
class Descriptor {
 public:
  explicit Descriptor(int descriptor) : descriptor_(descriptor) {}
  ~Descriptor() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int get() const { return descriptor_; }
  int release() { return std::exchange(descriptor_, -1); }

 private:
  int descriptor_;
};

Status TemporaryFileError(const std::string& folder, int error) {
  const StatusCode code = FileErrorCode(error);
  const bool full = code == StatusCode::kNoSpace;
  return {code, folder + ": temporary file: " + std::generic_category().message(error) +
                    (full ? "; free some space, or name another folder for temporary files"
                          : "; name another folder for temporary files")};
}

// Reads on from where a descriptor stands.
class Source {
 public:
  Source(int descriptor, const std::string& path, const InputRules& rules)
      : descriptor_(descriptor), path_(path), rules_(rules) {}
  // Makes the next bytes the current ones; none at the end.
  Status Next() {
    constexpr int kWaitMilliseconds = 50;
    for (;;) {
      if (rules_.look) MTDB_RETURN_IF_ERROR(rules_.look());
      // What never comes must not keep anybody from stopping.
      pollfd ready{descriptor_, POLLIN, 0};
      if (rules_.look && ::poll(&ready, 1, kWaitMilliseconds) <= 0) continue;
      const ssize_t n = ::read(descriptor_, buffer_.data(), kBlock);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0 && errno == EAGAIN) {  // somebody has made it so
        (void)::poll(&ready, 1, kWaitMilliseconds);
        continue;
      }
      if (n < 0) {
        return IoError(path_ + ": cannot be read: " + std::generic_category().message(errno));
      }
      bytes_ = ByteSpan(buffer_).first(static_cast<size_t>(n));
      return Status::Ok();
    }
  }
  ByteSpan bytes() const { return bytes_; }
  // Until there are `size` bytes, which is little, or the end.
  Status Begin(size_t size) {
    Bytes start;
    do {
      MTDB_RETURN_IF_ERROR(Next());
      start.insert(start.end(), bytes_.begin(), bytes_.end());
    } while (!bytes_.empty() && start.size() < size);
    std::copy(start.begin(), start.end(), buffer_.begin());
    bytes_ = ByteSpan(buffer_).first(start.size());
    return Status::Ok();
  }

 private:
  int descriptor_;
  const std::string& path_;
  const InputRules& rules_;
  std::vector<std::byte> buffer_ = std::vector<std::byte>(2 * kBlock);  // see Begin()
  ByteSpan bytes_;
};

// Writes into a nameless file.
class Target {
 public:
  Target(int descriptor, const std::string& folder, const std::string& path,
         const InputRules& rules)
      : descriptor_(descriptor), folder_(folder), path_(path), rules_(rules) {}
  Status Write(ByteSpan bytes) {
    MTDB_RETURN_IF_ERROR(CheckNext(bytes));
    while (!bytes.empty()) {
      const ssize_t n = ::write(descriptor_, bytes.data(), bytes.size());
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return TemporaryFileError(folder_, errno);
      bytes = bytes.subspan(static_cast<size_t>(n));
      written_ += static_cast<uint64_t>(n);
    }
    if (checked_ || written_ < kStreamStartBytes || !rules_.check_start) return Status::Ok();
    checked_ = true;
    constexpr uint64_t kAnySize = uint64_t{1} << 62;
    MTDB_ASSIGN_OR_RETURN(const auto start, InputFile::Growing(descriptor_, path_, kAnySize));
    MTDB_ASSIGN_OR_RETURN(facts_, rules_.check_start(*start));
    return Status::Ok();
  }
  uint64_t written() const { return written_; }

 private:
  Status CheckNext(ByteSpan bytes) const {
    const uint64_t after = written_ + bytes.size();
    if (after > rules_.max_tmp_bytes) {
      return {StatusCode::kBudgetExceeded,
              path_ + ": its temporary copy has reached " + std::to_string(written_ >> 20) +
                  " MiB, and temporary files may take no more than " +
                  std::to_string(rules_.max_tmp_bytes >> 20) +
                  " MiB beside what they have; allow more (--max-tmp)"};
    }
    // Readers leave out a little that lies behind a mesh.
    constexpr uint64_t kTail = uint64_t{1} << 20;
    if (facts_.most_bytes < after && after - facts_.most_bytes > kTail) {
      return BadInput(path_ + ": the mesh ends at byte " + std::to_string(facts_.most_bytes) +
                      " at most, as its header says, but more than 1 MiB follows");
    }
    if (facts_.is_text && !bytes.empty()) {
      const void* const zero = std::memchr(bytes.data(), 0, bytes.size());
      if (zero != nullptr) {
        const auto at = static_cast<size_t>(static_cast<const std::byte*>(zero) - bytes.data());
        return BadInput(path_ + ": byte " + std::to_string(written_ + at) +
                        " is 0, expected text, as at the beginning");
      }
    }
    return Status::Ok();
  }

  int descriptor_;
  const std::string& folder_;
  const std::string& path_;
  const InputRules& rules_;
  uint64_t written_ = 0;
  bool checked_ = false;
  StreamFacts facts_;
};

Status Copy(Source& source, Target& target) {
  while (!source.bytes().empty()) {
    MTDB_RETURN_IF_ERROR(target.Write(source.bytes()));
    MTDB_RETURN_IF_ERROR(source.Next());
  }
  return Status::Ok();
}

// One member of a gzip file after the other.
class Inflater {
 public:
  explicit Inflater(const std::string& path) : path_(path) {
    // 15: windows of any size; 16: gzip, with its checksum.
    ok_ = ::inflateInit2(&stream_, 15 + 16) == Z_OK;
  }
  ~Inflater() {
    if (ok_) ::inflateEnd(&stream_);
  }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;

  Status Copy(Source& source, Target& target) {
    if (!ok_) return {StatusCode::kNoSpace, path_ + ": no memory to decompress it"};
    while (!source.bytes().empty()) {
      MTDB_RETURN_IF_ERROR(Inflate(source.bytes(), target));
      MTDB_RETURN_IF_ERROR(source.Next());
    }
    if (ended_) return Status::Ok();
    return BadInput(path_ + ": gzip: cut short after " + std::to_string(read_) +
                    " bytes; get the file again");
  }

 private:
  Status Inflate(ByteSpan bytes, Target& target) {
    stream_.next_in = reinterpret_cast<Bytef*>(const_cast<std::byte*>(bytes.data()));
    stream_.avail_in = static_cast<uInt>(bytes.size());
    do {
      if (ended_ && ::inflateReset(&stream_) != Z_OK) return Damaged(bytes);
      ended_ = false;
      stream_.next_out = reinterpret_cast<Bytef*>(out_.data());
      stream_.avail_out = static_cast<uInt>(out_.size());
      const int code = ::inflate(&stream_, Z_NO_FLUSH);
      if (code == Z_MEM_ERROR) {
        return {StatusCode::kNoSpace, path_ + ": no memory to decompress it"};
      }
      if (code != Z_OK && code != Z_STREAM_END && code != Z_BUF_ERROR) return Damaged(bytes);
      MTDB_RETURN_IF_ERROR(target.Write(ByteSpan(out_).first(out_.size() - stream_.avail_out)));
      ended_ = code == Z_STREAM_END;
      // Padding of zeros after the last member is usual on tapes.
      while (ended_ && stream_.avail_in > 0 && *stream_.next_in == 0) {
        ++stream_.next_in;
        --stream_.avail_in;
      }
    } while (stream_.avail_in > 0 || (stream_.avail_out == 0 && !ended_));
    read_ += bytes.size();
    return Status::Ok();
  }
  Status Damaged(ByteSpan bytes) const {
    return BadInput(path_ + ": gzip: damaged near byte " +
                    std::to_string(read_ + bytes.size() - stream_.avail_in) +
                    (stream_.msg != nullptr ? std::string(" (") + stream_.msg + ")" : "") +
                    "; get the file again");
  }

  const std::string& path_;
  z_stream stream_{};
  bool ok_ = false;
  bool ended_ = false;  // a member has ended
  uint64_t read_ = 0;   // compressed bytes of earlier blocks
  std::vector<std::byte> out_ = std::vector<std::byte>(kBlock);
};

// What `descriptor` has from where it stands.
Result<std::unique_ptr<InputFile>> CopyOf(int descriptor, const std::string& path,
                                          const InputRules& rules, uint64_t* copied_bytes) {
  std::error_code error;
  const std::string folder = rules.tmp_directory.empty()
                                 ? std::filesystem::temp_directory_path(error).string()
                                 : rules.tmp_directory;
  Descriptor copy(OpenNamelessFile(folder.empty() ? "/tmp" : folder, "mtdb-input-"));
  if (copy.get() < 0) return TemporaryFileError(folder, errno);
  Source source(descriptor, path, rules);
  Target target(copy.get(), folder, path, rules);
  MTDB_RETURN_IF_ERROR(source.Begin(2));
  MTDB_RETURN_IF_ERROR(IsGzip(AsString(source.bytes())) ? Inflater(path).Copy(source, target)
                                                        : Copy(source, target));
  *copied_bytes = target.written();
  return InputFile::Take(copy.release(), path);
}

Result<std::unique_ptr<InputFile>> Open(const std::string& path, int descriptor,
                                        const InputRules& rules, uint64_t* copied_bytes) {
  if (descriptor >= 0) {
    struct stat info {};
    if (::fstat(descriptor, &info) == 0 && S_ISDIR(info.st_mode)) {
      return IoError(path + ": is a directory, expected a mesh file");
    }
    return CopyOf(descriptor, path, rules, copied_bytes);
  }
  MTDB_ASSIGN_OR_RETURN(std::unique_ptr<InputFile> file, InputFile::Open(path));
  std::array<std::byte, 2> start;
  MTDB_ASSIGN_OR_RETURN(const size_t size, file->ReadAt(0, start));
  if (!IsGzip(AsString(ByteSpan(start).first(size)))) return file;
  const Descriptor compressed(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (compressed.get() < 0) {
    return IoError(path + ": cannot be opened: " + std::generic_category().message(errno));
  }
  return CopyOf(compressed.get(), path, rules, copied_bytes);
}

}  // namespace

bool IsGzip(std::string_view start) { return start.starts_with("\x1f\x8b"); }

Result<std::unique_ptr<InputFile>> OpenInputFile(const std::string& path, int descriptor,
                                                 const InputRules& rules, uint64_t* copied_bytes) {
  *copied_bytes = 0;
  MTDB_ASSIGN_OR_RETURN(std::unique_ptr<InputFile> file,
                        Open(path, descriptor, rules, copied_bytes));
  file->SetLook(rules.look);
  return file;
}

}  // namespace mtdb::internal
