// SPDX-License-Identifier: Apache-2.0
// Holes are followed from row to row by their runs of samples. A hole that may be closed ends
// within `largest` rows, and all of its border is then in the ring.
#include "codecs/raster_file/hole_filler.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace mtdb {

namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kStill = 1e-3;  // of a step, that a height moves by when it has come to rest

}  // namespace

HoleFiller::HoleFiller(const HoleFillOptions& options, ReadRow read)
    : options_(options),
      read_(std::move(read)),
      rows_((size_t{options.largest} + 2) * options.columns) {}

uint64_t HoleFiller::MemoryBytes(uint64_t columns, uint64_t largest) {
  // Each sample of a row at most one half of a run and a hole, twice, and all of a hole gathered.
  constexpr uint64_t kBesides = sizeof(Run) + sizeof(Hole);
  const uint64_t side = std::min(columns, largest);
  return (largest + 2) * columns * sizeof(double) + columns * kBesides +
         side * largest * sizeof(Sample);
}

Status HoleFiller::Next(std::span<double> heights) {
  while (read_rows_ < options_.rows && read_rows_ <= given_rows_ + options_.largest) {
    const uint32_t row = read_rows_++;
    MTDB_RETURN_IF_ERROR(read_(row, Row(row)));
    std::swap(runs_, runs_above_);
    std::swap(holes_, holes_above_);
    FindRuns(row);
    Join();
    for (uint32_t i = 0; i < holes_above_.size(); ++i) {
      const Hole& hole = holes_above_[i];
      if (hole.parent == i && !hole.goes_on) Close(hole, row - 1);
    }
  }
  const std::span<const double> row = Row(given_rows_++);
  std::copy(row.begin(), row.end(), heights.begin());
  return Status::Ok();
}

uint32_t HoleFiller::Root(std::vector<Hole>& holes, uint32_t hole) {
  while (holes[hole].parent != hole) {
    holes[hole].parent = holes[holes[hole].parent].parent;
    hole = holes[hole].parent;
  }
  return hole;
}

// Each run is a hole of its own at first.
void HoleFiller::FindRuns(uint32_t row) {
  runs_.clear();
  holes_.clear();
  const std::span<const double> heights = Row(row);
  const uint32_t columns = options_.columns;
  for (uint32_t c = 0; c < columns; ++c) {
    if (!std::isnan(heights[c])) continue;
    const uint32_t begin = c;
    while (c < columns && std::isnan(heights[c])) ++c;
    const auto number = static_cast<uint32_t>(holes_.size());
    runs_.push_back({begin, c, number});
    const bool outside = begin == 0 || c == columns || row == 0 || row + 1 == options_.rows;
    holes_.push_back({row, begin, c - 1, begin, number, outside, false});
  }
}

// Runs that touch are of one hole. What a hole above was is added to the first run below it, which
// the others below it join.
void HoleFiller::Join() {
  constexpr uint32_t kNobody = std::numeric_limits<uint32_t>::max();
  std::vector<uint32_t> below(holes_above_.size(), kNobody);
  const auto unite = [this](uint32_t a, uint32_t b) {
    a = Root(holes_, a);
    b = Root(holes_, b);
    if (a == b) return;
    Hole& to = holes_[a];
    const Hole& from = holes_[b];
    to.top = std::min(to.top, from.top);
    to.left = std::min(to.left, from.left);
    to.right = std::max(to.right, from.right);
    to.outside = to.outside || from.outside;
    holes_[b].parent = a;
  };
  size_t first = 0;
  for (const Run& run : runs_) {
    while (first < runs_above_.size() && runs_above_[first].end < run.begin) ++first;
    for (size_t i = first; i < runs_above_.size() && runs_above_[i].begin <= run.end; ++i) {
      const uint32_t above = Root(holes_above_, runs_above_[i].hole);
      if (below[above] != kNobody) {
        unite(below[above], run.hole);
        continue;
      }
      Hole& hole = holes_above_[above];
      hole.goes_on = true;
      below[above] = run.hole;
      Hole& to = holes_[Root(holes_, run.hole)];
      to.top = std::min(to.top, hole.top);
      to.left = std::min(to.left, hole.left);
      to.right = std::max(to.right, hole.right);
      to.outside = to.outside || hole.outside;
    }
  }
}

// `bottom`: its last row.
void HoleFiller::Close(const Hole& hole, uint32_t bottom) {
  if (hole.outside) return;
  const uint32_t width = hole.right - hole.left + 1;
  const uint32_t height = bottom - hole.top + 1;
  if (width > options_.largest || height > options_.largest) {
    ++report_.left;
    return;
  }
  Gather(hole, bottom);
  Relax(width, height);
  for (const Sample& s : samples_) {
    const double steps =
        std::floor((s.height - options_.height_origin) / options_.height_step + 0.5);
    At(s.row, s.column) = options_.height_origin + options_.height_step * steps;
  }
  ++report_.holes;
  report_.samples += samples_.size();
}

// Its samples, and their first heights: the mean of the border's.
void HoleFiller::Gather(const Hole& hole, uint32_t bottom) {
  samples_.clear();
  double sum = 0, count = 0;
  const auto visit = [&](uint32_t row, uint32_t column) {
    double& height = At(row, column);
    if (std::isnan(height)) {
      height = 0;  // is visited
      samples_.push_back({row, column, kNone});
    }
  };
  visit(bottom, hole.seed_column);
  // Heights of the border are told from visited samples when all are.
  for (size_t i = 0; i < samples_.size(); ++i) {
    const Sample s = samples_[i];
    for (uint32_t row = s.row - 1; row <= s.row + 1; ++row) {
      for (uint32_t column = s.column - 1; column <= s.column + 1; ++column) visit(row, column);
    }
  }
  for (const Sample& s : samples_) At(s.row, s.column) = kNone;
  for (const Sample& s : samples_) {
    for (const double beside : {At(s.row - 1, s.column), At(s.row + 1, s.column),
                                At(s.row, s.column - 1), At(s.row, s.column + 1)}) {
      if (std::isnan(beside)) continue;
      sum += beside;
      ++count;
    }
  }
  for (Sample& s : samples_) {
    s.height = sum / count;
    At(s.row, s.column) = s.height;
  }
}

// Successive over-relaxation (Young, 1954), with the best factor for a rectangle of the hole's
// size.
void HoleFiller::Relax(double width, double height) {
  std::sort(samples_.begin(), samples_.end(), [](const Sample& a, const Sample& b) {
    return std::pair(a.row, a.column) < std::pair(b.row, b.column);
  });
  const double radius =
      (std::cos(std::numbers::pi / (width + 1)) + std::cos(std::numbers::pi / (height + 1))) / 2;
  const double factor = 2 / (1 + std::sqrt(1 - radius * radius));
  const auto rounds = static_cast<int>(20 * (width + height) + 100);
  for (int i = 0; i < rounds; ++i) {
    double most = 0;
    for (Sample& s : samples_) {
      const double mean = (At(s.row - 1, s.column) + At(s.row + 1, s.column) +
                           At(s.row, s.column - 1) + At(s.row, s.column + 1)) /
                          4;
      const double change = factor * (mean - s.height);
      s.height += change;
      At(s.row, s.column) = s.height;
      most = std::max(most, std::abs(change));
    }
    if (most < kStill * options_.height_step) return;
  }
}

}  // namespace mtdb
