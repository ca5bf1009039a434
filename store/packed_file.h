// SPDX-License-Identifier: Apache-2.0
// Packed files: objects of a store in one immutable file, for readers that have nothing but
// read(offset, length). Database opens them like stores. Layout in store/FORMAT.md, "The packed
// file".
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/cluster_source.h"
#include "store/object_record.h"
#include "store/range_reader.h"

namespace mtdb {

class Database;

namespace internal {
class PackedFile;
}

struct PackReport {
  uint64_t file_bytes = 0;
  uint64_t first_bytes = 0;  // of the file, for a first picture of the first object
  std::string content_hash;  // 32 hexadecimal digits
};

// Takes the bytes of a file from its beginning to its end.
using AppendBytes = std::function<Status(ByteSpan)>;

// Writes objects, in this order; their names differ, and all rows of their indexes are there. What
// is written depends on the objects' content, names and order only. Memory: some 16 bytes a unit,
// and some payloads. Errors: kInvalidArgument, those of the sources and of `append`.
Result<PackReport> PackObjects(std::span<const std::shared_ptr<ClusterSource>> sources,
                               const AppendBytes& append);

// The packed file of one object, byte for byte as PackObjects would write it, without writing it:
// what lies in a range is put together when it is asked for. Some 16 bytes of memory a unit and the
// source's index. Safe for many threads.
class PackedImage {
 public:
  // All rows of the source's index are there; reads them twice. Errors: as for PackObjects.
  static Result<std::shared_ptr<const PackedImage>> Open(std::shared_ptr<ClusterSource> source);
  ~PackedImage();

  const ObjectRecord& record() const;  // the source's
  uint64_t size() const;
  const std::string& content_hash() const;  // 32 hexadecimal digits
  // Reads the payloads that the range touches. Errors: kInvalidArgument (not in the file), those of
  // the source.
  Result<Bytes> Read(ByteRange range) const;

 private:
  struct Impl;
  explicit PackedImage(std::unique_ptr<const Impl> impl);
  const std::unique_ptr<const Impl> impl_;
};

// The objects of a packed file over a carrier that the caller has; Database::Open makes its own.
// Immutable; safe for many threads.
class PackedObjects {
 public:
  // Reads header and directory. Errors: kCorrupt, kUnsupported, those of the reader. Without
  // threads for readers that answer during the call: an error of theirs ends it, and it may be
  // called again when more is there.
  static Result<std::shared_ptr<PackedObjects>> Open(std::shared_ptr<RangeReader> ranges);

  std::vector<ObjectRecord> List() const;  // in the file's order
  // Rows of the index come as they are needed. Errors: likewise, and kNotFound.
  Result<std::shared_ptr<ClusterSource>> OpenObject(const std::string& name) const;
  // Where the files of an object's texture lie, in the order of TextureRecord::file; none of an
  // object without texture. Errors: kNotFound.
  Result<std::vector<ByteRange>> TextureFiles(const std::string& name) const;

 private:
  explicit PackedObjects(std::shared_ptr<internal::PackedFile> file) : file_(std::move(file)) {}
  const std::shared_ptr<internal::PackedFile> file_;
};

}  // namespace mtdb
