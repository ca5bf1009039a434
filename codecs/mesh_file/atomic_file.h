// Files that appear whole or not at all: meshes, pictures.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

// Writes a file that has no name until Commit() gives it `path`, so that nothing is left of a
// process that dies. Where the system has no such files, it has a temporary name beside `path`
// until then, "PATH.PID-N.tmp", and so it has for a moment when `path` is replaced; it is locked
// while its process lives, and Create() removes those of `path` that nobody has locked. After a
// power failure too there is a whole file or none of that name; which of both is not promised for
// one that was just committed: the folder is not synced, as meshes can be made again.
class AtomicFile {
 public:
  // kIoError, kNoSpace.
  static Result<std::unique_ptr<AtomicFile>> Create(const std::string& path);
  // Writes into an open file, which has no name to be given: Commit() leaves it whole and does not
  // wait for the disk. `path` is for messages.
  static Result<std::unique_ptr<AtomicFile>> Into(int descriptor, const std::string& path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  Status Append(ByteSpan bytes);
  Status Append(std::string_view text) { return Append(AsBytes(text)); }
  // Replaces bytes that were appended before. bytes_written() does not count them again.
  Status Overwrite(uint64_t offset, ByteSpan bytes);
  Status Commit();
  uint64_t bytes_written() const { return bytes_written_; }

 private:
  AtomicFile(std::string path, std::string temporary, int descriptor);
  Status Flush();
  // Gives a file without a name its temporary one.
  Status Link();
  // From where the file ends; from `offset` when it is given.
  Status WriteAll(ByteSpan bytes, std::optional<uint64_t> offset = std::nullopt);

  std::string path_;
  std::string temporary_;  // empty: no name
  bool is_named_ = true;   // Commit() gives it its name
  int descriptor_;
  std::vector<std::byte> buffer_;
  size_t buffered_ = 0;
  uint64_t bytes_written_ = 0;
};

}  // namespace mtdb
