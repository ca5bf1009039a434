// SPDX-License-Identifier: Apache-2.0
// CornerTable: texture coordinates by their numbers, as faces name them in any order.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "codecs/mesh_file/polygons/vertex_positions.h"
#include "store/base/status.h"

namespace mtdb::internal {

struct TexturePlace {
  float u = 0, v = 0;
};

// In memory while they are few, else in a nameless temporary file, of which the blocks that were
// read last are kept. Memory: at most 32 MiB and a little.
class CornerTable {
 public:
  explicit CornerTable(ReaderSpace space)
      : folder_(std::move(space.directory)), max_bytes_(space.max_bytes) {}
  ~CornerTable();
  CornerTable(const CornerTable&) = delete;
  CornerTable& operator=(const CornerTable&) = delete;

  // kNoSpace, kIoError: naming the folder; kBudgetExceeded.
  Status Append(TexturePlace place) {
    places_.push_back(place);
    ++size_;
    return places_.size() < kInMemory ? Status::Ok() : Flush();
  }
  uint64_t size() const { return size_; }
  // Of the temporary file.
  uint64_t temporary_bytes() const { return written_ * sizeof(TexturePlace); }
  // Forgets all; keeps the file.
  void Clear();
  // `index` is below size(). Nothing is appended behind the first Get(), until Clear().
  Status Get(uint64_t index, TexturePlace* place) {
    if (file_ >= 0 && written_ > 0) return GetFromFile(index, place);
    *place = places_[index];
    return Status::Ok();
  }

 private:
  static constexpr size_t kInMemory = size_t{1} << 22;  // places
  static constexpr size_t kBlock = 512;                 // places
  static constexpr size_t kSlots = kInMemory / kBlock;
  Status Flush();
  Status FileError() const;
  Status GetFromFile(uint64_t index, TexturePlace* place);

  std::string folder_;
  uint64_t max_bytes_;
  std::vector<TexturePlace> places_;  // all, or those not written yet; then the blocks of the slots
  std::vector<uint64_t> blocks_;      // by slot: which block it has; empty: not read yet
  uint64_t size_ = 0;
  uint64_t written_ = 0;
  int file_ = -1;
};

}  // namespace mtdb::internal
