// SPDX-License-Identifier: Apache-2.0
// Levels: the steps in which a budget makes a query coarser.
#pragma once

#include <array>
#include <cstdint>

#include "query/cache/loaded_unit.h"
#include "query/threshold.h"
#include "store/base/grid.h"

namespace mtdb::internal {

// At level L >= 0 the query's threshold is max(threshold, s(L) w), which grows with L; w is 1, or a
// pixel of the threshold's camera (Threshold::AtPixels). At kNone it is the query's own; at top()
// every error is permitted. Steps are those of error codes: of an object where w = 1, else of 2^-64
// to 2^64 pixels.
class Levels {
 public:
  static constexpr int kNone = -1;
  static constexpr int kOctave = kErrorStepsPerOctave;

  static bool InPixels(const ThresholdPtr& threshold) {
    return threshold != nullptr && threshold->AtPixels(1) != nullptr;
  }

  // `bounds` by code, of the object; they outlive this.
  explicit Levels(const std::array<double, 256>& bounds);
  void SetThreshold(const ThresholdPtr& threshold);
  const ThresholdPtr& threshold() const { return threshold_; }  // the query's; may be null

  bool in_pixels() const { return in_pixels_; }
  static constexpr int TopOf(bool in_pixels) { return in_pixels ? kPixelLevels - 1 : 255; }
  int top() const { return TopOf(in_pixels_); }
  // s(L), in pixels or in model units; of 0 <= level < top().
  double Step(int level) const {
    const auto l = static_cast<size_t>(level);
    return in_pixels_ ? (*pixel_steps_)[l] : (*bounds_)[l];
  }
  // The query's threshold at a level; not null.
  ThresholdPtr At(int level) const;
  // The least level at which an error of this code is valid; or where w is `pixel`.
  int LevelOf(uint8_t code) const { return by_code_[code]; }
  int LevelOf(double bound, double pixel) const;

 private:
  static constexpr int kPixelLevels = 128 * kOctave;
  static std::array<double, kPixelLevels> PixelSteps();

  const std::array<double, 256>* bounds_;
  const std::array<double, kPixelLevels>* pixel_steps_;
  std::array<uint8_t, 256> by_code_;
  ThresholdPtr threshold_;
  bool in_pixels_ = false;
};

// How far a budget goes from level to level: triangles that nodes of clusters from `from` on remove
// are judged at the level below, all others at `level`.
struct Cutoff {
  int level = Levels::kNone;
  UnitId from = 0;
  friend bool operator==(const Cutoff&, const Cutoff&) = default;
};

}  // namespace mtdb::internal
