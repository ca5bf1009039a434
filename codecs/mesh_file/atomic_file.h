// SPDX-License-Identifier: Apache-2.0
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

struct AtomicFileOptions {
  bool replaces_packed_file = false;
  std::string source;  // the path of what is read meanwhile, which is not replaced either
};

// Writes a file that has no name until Commit() gives it `path`, so that nothing is left of a
// process that dies. On systems without such files, and for the moment in which `path` is replaced,
// the file has a temporary name beside `path`, "PATH.PID-N.tmp". It is locked while its process
// lives; Create() removes the temporary files of `path` that nobody has locked.
//
// Where `path` is a symbolic link, the file that it leads to is written, and the link stays. A file
// that is replaced hands on its permissions. Into a pipe or a device the bytes are written as they
// come; nothing of what is below holds there, and Overwrite() cannot be used once more than a
// buffer of 1 MiB was appended (kUnsupported).
//
// What is a store, a packed file or one that belongs to them is never replaced (kAlreadyExists),
// but a packed file by another where the options say so.
//
// After a power failure there is a whole file of that name, or none. A file that was just committed
// may be missing, since the folder is not synced: meshes can be made again.
class AtomicFile {
 public:
  // kAlreadyExists, kIoError, kNoSpace.
  static Result<std::unique_ptr<AtomicFile>> Create(const std::string& path,
                                                    const AtomicFileOptions& options = {});
  // Writes into the open file `descriptor`. Commit() then gives it no name, and does not wait for
  // the disk. `path` is for messages. Errors: as above.
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
  static Result<std::unique_ptr<AtomicFile>> Make(const std::string& path);
  Status Flush();
  // Gives a file without a name its temporary one.
  Status Link();
  // From where the file ends; from `offset` when it is given.
  Status WriteAll(ByteSpan bytes, std::optional<uint64_t> offset = std::nullopt);

  std::string path_;
  std::string temporary_;  // empty: no name
  bool is_named_ = true;   // Commit() gives it its name
  bool seekable_ = true;
  AtomicFileOptions options_;
  int descriptor_;
  std::vector<std::byte> buffer_;
  size_t buffered_ = 0;
  uint64_t bytes_written_ = 0;
};

}  // namespace mtdb
