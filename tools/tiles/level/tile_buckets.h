// SPDX-License-Identifier: Apache-2.0
// TileBuckets: which triangles of a level each tile has, in a temporary file.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "store/base/status.h"
#include "tools/tiles/level/level_mesh.h"

namespace mtdb {

// First Add() by one thread, then Finish(), then Read() by any. Memory: some `buffered_triangles`
// times 32 bytes while triangles are added, and 24 bytes for each stretch in the file afterwards.
class TileBuckets {
 public:
  TileBuckets(std::string tmp_directory, size_t buffered_triangles);
  ~TileBuckets();
  TileBuckets(const TileBuckets&) = delete;
  TileBuckets& operator=(const TileBuckets&) = delete;

  Status Add(uint32_t tile, const LevelTriangle& triangle);
  Status Finish();
  // A tile's triangles in the order in which they were added.
  Status Read(uint32_t tile, std::vector<LevelTriangle>* triangles) const;
  uint64_t Count(uint32_t tile) const;
  uint64_t file_bytes() const { return written_ * sizeof(LevelTriangle); }

 private:
  struct Item {
    uint32_t tile = 0;
    LevelTriangle triangle{};
  };
  struct Stretch {
    uint32_t tile = 0;
    uint64_t begin = 0, count = 0;  // triangles of the file
  };
  Status Flush();
  std::vector<Stretch>::const_iterator First(uint32_t tile) const;

  std::string tmp_directory_;
  size_t most_;
  std::vector<Item> buffer_;
  std::vector<Stretch> stretches_;  // sorted by tile once all are there
  int file_ = -1;
  uint64_t written_ = 0;
};

}  // namespace mtdb
