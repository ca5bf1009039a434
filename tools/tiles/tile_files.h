// SPDX-License-Identifier: Apache-2.0
// TileFiles: a tree of tiles whose files are asked for one by one.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "query/query_control.h"
#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/range_reader.h"

namespace mtdb {

struct TileFilesOptions {
  std::string tmp_directory;        // of temporary files
  QueryControl* control = nullptr;  // stops what is being made; may be null
  // Larger tiles are refused, each of whose triangles takes some 200 bytes of memory.
  uint64_t most_triangles = 2'000'000;
};

// A file, which lives no longer than its tree.
class TileContent {
 public:
  virtual ~TileContent() = default;
  virtual uint64_t size() const = 0;
  // A range within the size.
  virtual Result<Bytes> Read(ByteRange range) const = 0;
};

// Any thread may ask.
class TileFiles {
 public:
  virtual ~TileFiles() = default;
  // Of temporary files.
  virtual uint64_t file_bytes() const = 0;
  // Null: the tree has no file of this path. kUnsupported: the tile is too large.
  virtual Result<std::unique_ptr<const TileContent>> Find(const std::string& path) const = 0;
};

// A file that is in memory.
class TileBytes final : public TileContent {
 public:
  explicit TileBytes(Bytes bytes) : bytes_(std::move(bytes)) {}
  uint64_t size() const override { return bytes_.size(); }
  Result<Bytes> Read(ByteRange range) const override {
    const auto begin = bytes_.begin() + static_cast<ptrdiff_t>(range.offset);
    return Bytes(begin, begin + static_cast<ptrdiff_t>(range.bytes));
  }

 private:
  Bytes bytes_;
};

}  // namespace mtdb
