// SPDX-License-Identifier: Apache-2.0
#include "codecs/raster_file/height_step.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

namespace mtdb {

namespace {

constexpr int kMostDecimals = 9;
constexpr double kOfRange = 1e-3, kOfDifference = 1e-2;  // that rounding may come to
constexpr double kMostSteps = 1 << 29;                   // half of what SendRaster takes

// The least number of decimals that all heights need; kMostDecimals + 1: no number suffices.
struct Decimals {
  int count = 0;
  double power = 1;  // 10^count

  void Add(double height, bool single) {
    while (count <= kMostDecimals && !IsMultiple(height, single)) {
      ++count;
      power *= 10;
    }
  }
  // A whole number below 2^53 divided by a power of ten is rounded as a reader rounds its text.
  bool IsMultiple(double height, bool single) const {
    const double whole = std::nearbyint(height * power);
    if (!(std::abs(whole) < 0x1p53)) return false;
    const double nearest = whole / power;
    return nearest == height || (single && static_cast<float>(nearest) == height);
  }
};

class Survey {
 public:
  void AddRow(const std::vector<double>& above, const std::vector<double>& row) {
    for (size_t c = 0; c < row.size(); ++c) {
      if (std::isnan(row[c])) continue;
      AddHeight(row[c]);
      if (c > 0) AddDifference(row[c - 1], row[c]);
      if (!above.empty()) AddDifference(above[c], row[c]);
    }
  }
  bool empty() const { return !(least_ <= most_); }

  HeightStep Choose() const {
    const double largest = std::max(std::abs(least_), std::abs(most_));
    const Decimals& decimals = singles_ ? single_ : double_;
    // What any number would do says nothing: its last digit lies below what the type can tell.
    const double told = singles_ ? std::nextafterf(static_cast<float>(largest),
                                                   std::numeric_limits<float>::infinity()) -
                                       static_cast<float>(largest)
                                 : 0;
    const double last_digit = 1 / decimals.power;
    if (decimals.count <= kMostDecimals && last_digit >= 2 * told &&
        largest / last_digit < kMostSteps) {
      return {last_digit, 0, true};
    }
    HeightStep chosen;
    double most = 2 * kOfRange * (most_ - least_);
    if (differences_ > 0) most = std::min(most, 2 * kOfDifference * UsualDifference());
    if (!(most > 0)) most = 1e-6 * largest;  // one height everywhere
    chosen.step = RoundedDown(std::max(most, told / 2));
    if (largest / chosen.step >= kMostSteps && (most_ - least_) / chosen.step < kMostSteps) {
      chosen.origin = least_;
    }
    return chosen;
  }

 private:
  static constexpr int kOctaves = 2200, kLeastOctave = -1100;

  void AddHeight(double height) {
    if (!std::isfinite(height)) return;
    least_ = std::min(least_, height);
    most_ = std::max(most_, height);
    singles_ = singles_ && static_cast<float>(height) == height;
    if (singles_) single_.Add(height, true);
    double_.Add(height, false);
  }
  void AddDifference(double before, double height) {
    const double difference = std::abs(before - height);
    if (!(difference > 0) || !std::isfinite(difference)) return;
    sum_ += difference;
    ++differences_;
    ++octaves_[static_cast<size_t>(std::ilogb(difference) - kLeastOctave)];
  }
  // One number that is far too large, such as a hole that the file does not mark, moves the mean,
  // but not the median.
  double UsualDifference() const {
    uint64_t below = 0;
    size_t octave = 0;
    while (octave + 1 < octaves_.size() && 2 * (below += octaves_[octave]) < differences_) ++octave;
    const double median = std::ldexp(1.5, static_cast<int>(octave) + kLeastOctave);
    return std::min(sum_ / static_cast<double>(differences_), median);
  }
  static double RoundedDown(double most) {
    const double power = std::pow(10.0, std::floor(std::log10(most)));
    for (const double digit : {5.0, 2.0}) {
      if (digit * power <= most) return digit * power;
    }
    return power;
  }

  double least_ = std::numeric_limits<double>::infinity();
  double most_ = -std::numeric_limits<double>::infinity();
  bool singles_ = true;  // all are binary32
  Decimals single_, double_;
  double sum_ = 0;
  uint64_t differences_ = 0;  // that are not 0
  std::array<uint64_t, kOctaves> octaves_{};
};

}  // namespace

Result<HeightStep> ChooseHeightStep(RasterMosaic& raster) {
  const RasterFrame& f = raster.info().frame;
  std::vector<double> above, row(f.columns);
  Survey survey;
  for (uint32_t r = 0; r < f.rows; ++r) {
    MTDB_RETURN_IF_ERROR(raster.ReadRow(r, row));
    survey.AddRow(above, row);
    above.resize(f.columns);
    std::swap(above, row);
  }
  if (survey.empty()) return BadInput("the raster has no height at all: every sample is a hole");
  return survey.Choose();
}

}  // namespace mtdb
