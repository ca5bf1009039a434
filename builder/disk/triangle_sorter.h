// SPDX-License-Identifier: Apache-2.0
// TriangleSorter: an external sort of a round's triangles along its curve.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "builder/disk/packed_triangle.h"
#include "builder/disk/spool.h"
#include "builder/disk/tile.h"

namespace mtdb::internal {

// Collects triangles with the rows of their corners, then gives them back along the curve (ties by
// vertices), whatever the memory. Sorted runs go to spools when they do not fit; they give their
// room on the disk back as they are read.
class TriangleSorter {
 public:
  struct Options {
    const SpoolSpace* space = nullptr;
    size_t memory_bytes = 0;
    size_t row_bytes = 0;  // of one vertex
    unsigned threads = 1;
  };
  explicit TriangleSorter(const Options& options);

  // `code` is the triangle's on the round's curve; `rows` those of its corners.
  Status Add(const TileTriangle& triangle, const std::byte* rows, uint64_t code);
  Status Add(const TriangleBlock& block, std::span<const uint64_t> codes);
  uint64_t count() const { return count_; }
  // After the last Add.
  Status Finish();
  // Appends the next `count` triangles to `block`, or skips them when it is null. `code` is the
  // first one's.
  Status Next(size_t count, TriangleBlock* block, uint64_t* code);

 private:
  struct Key {
    uint64_t code;
    uint32_t index;
  };
  struct KeyBefore {
    const TriangleSorter* sorter;
    bool operator()(const Key& a, const Key& b) const;
  };
  struct Run {
    uint32_t level = 0;  // merges that made it
    std::unique_ptr<Spool> spool;
    std::unique_ptr<SpoolReader> reader;
    std::unique_ptr<TriangleUnpacker> unpacker;
    TileTriangle triangle;  // the next one, with its code and rows
    uint64_t code = 0;
    Bytes rows;
    uint64_t left = 0;  // with the next one
  };
  // A run that is being written.
  class RunWriter;
  size_t record_bytes() const { return sizeof(TileTriangle) + 3 * options_.row_bytes; }
  std::byte* Record(uint32_t i) const {
    return chunks_[i / chunk_records_].get() + (i % chunk_records_) * record_bytes();
  }
  // Sorts parts of the keys, on several threads; returns the parts' bounds.
  std::vector<size_t> SortParts();
  Status SpillRun();
  // Merges the newest runs into one where there are too many of a level, so that neither the
  // readers' memory nor the number of files grows with the triangles.
  Status MergeRuns();
  // Opens the runs from `first` on for reading; their first triangles are in heap_.
  Status OpenRuns(size_t first, size_t block_bytes);
  // Takes the first triangle away that the heap has; no run is left when it was the last.
  Status Pop();
  // Reads the run's next triangle.
  Status Read(Run& run);
  bool Before(const Run& a, const Run& b) const;

  Options options_;
  size_t run_capacity_ = 0;  // records in memory at most
  size_t chunk_records_ = 0;
  size_t merge_width_ = 0;                            // runs of a level that are merged into one
  std::vector<std::unique_ptr<std::byte[]>> chunks_;  // of records: the run in memory
  std::vector<Key> keys_;
  size_t next_key_ = 0;
  std::vector<Run> runs_;
  std::vector<uint32_t> heap_;  // of runs, the first record on top
  uint64_t count_ = 0;
};

}  // namespace mtdb::internal
