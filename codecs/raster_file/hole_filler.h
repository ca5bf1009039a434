// SPDX-License-Identifier: Apache-2.0
// HoleFiller: gives heights to the samples of small holes, row by row.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "store/base/status.h"

namespace mtdb {

struct HoleFillOptions {
  uint32_t columns = 0, rows = 0;
  uint32_t largest = 0;  // closes holes of up to so many columns and rows; at least 1
  double height_step = 1;
  double height_origin = 0;
};
struct HoleFillReport {
  uint64_t holes = 0;    // that were closed
  uint64_t samples = 0;  // that they had
  uint64_t left = 0;     // holes that are larger, and not the outside
};

// A hole is a set of samples without heights that touch each other by sides or corners. One that
// reaches the first or last row or column is the outside, and stays. What is closed becomes a
// membrane over its border: each height is the mean of the four beside it (Laplace), rounded to a
// multiple of the step, so none is above or below all of the border. Memory: `largest` + 2 rows.
// Single thread.
class HoleFiller {
 public:
  // Gives row after row; NaN is no height.
  using ReadRow = std::function<Status(uint32_t row, std::span<double> heights)>;
  HoleFiller(const HoleFillOptions& options, ReadRow read);
  // What the rows take.
  static uint64_t MemoryBytes(uint64_t columns, uint64_t largest);

  // Rows from the first to the last.
  Status Next(std::span<double> heights);
  const HoleFillReport& report() const { return report_; }

 private:
  // A hole as far as it is known.
  struct Hole {
    uint32_t top = 0, left = 0, right = 0;  // its first row; its least and largest column
    uint32_t seed_column = 0;               // of one of its samples, in its last row
    uint32_t parent = 0;                    // in its row's list; itself: none
    bool outside = false;
    bool goes_on = false;  // in the next row
  };
  // Samples without heights beside each other: columns [begin, end).
  struct Run {
    uint32_t begin = 0, end = 0;
    uint32_t hole = 0;
  };
  // A sample of a hole that is closed.
  struct Sample {
    uint32_t row = 0, column = 0;
    double height = 0;
  };

  double& At(uint32_t row, uint32_t column) {
    return rows_[size_t{row % (options_.largest + 2)} * options_.columns + column];
  }
  std::span<double> Row(uint32_t row) { return {&At(row, 0), options_.columns}; }
  static uint32_t Root(std::vector<Hole>& holes, uint32_t hole);
  void FindRuns(uint32_t row);
  void Join();
  void Close(const Hole& hole, uint32_t bottom);
  void Gather(const Hole& hole, uint32_t bottom);
  void Relax(double width, double height);

  const HoleFillOptions options_;
  const ReadRow read_;
  std::vector<double> rows_;  // a ring
  uint32_t read_rows_ = 0, given_rows_ = 0;
  std::vector<Run> runs_, runs_above_;
  std::vector<Hole> holes_, holes_above_;  // of the last row, and of the one above
  std::vector<Sample> samples_;
  HoleFillReport report_;
};

}  // namespace mtdb
