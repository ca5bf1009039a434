// Packed files: objects of a store in one immutable file, for readers that have nothing but
// read(offset, length). Database opens them like stores. Layout in store/FORMAT.md, "The packed
// file".
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/cluster_source.h"
#include "store/object_record.h"

namespace mtdb {

class Database;

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

}  // namespace mtdb
