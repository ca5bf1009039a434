// SPDX-License-Identifier: Apache-2.0
#include "query/cut/levels.h"

#include <algorithm>
#include <cmath>

namespace mtdb::internal {

// 2^(i / 8), as the codes of errors have it.
std::array<double, Levels::kPixelLevels> Levels::PixelSteps() {
  Grid eighths;
  eighths.error_unit = 1;
  std::array<double, kPixelLevels> steps;
  for (int l = 0; l < kPixelLevels; ++l) {
    const double eighth = eighths.Error(static_cast<uint8_t>(1 + l % kOctave));
    steps[static_cast<size_t>(l)] = std::ldexp(eighth, l / kOctave - kPixelLevels / kOctave / 2);
  }
  return steps;
}

Levels::Levels(const std::array<double, 256>& bounds) : bounds_(&bounds) {
  static const std::array<double, kPixelLevels> kSteps = PixelSteps();
  pixel_steps_ = &kSteps;
  for (size_t code = 0; code < 256; ++code) {
    const bool same = code > 0 && bounds[code] <= bounds[code - 1];
    by_code_[code] = same ? by_code_[code - 1] : static_cast<uint8_t>(code);
  }
}

void Levels::SetThreshold(const ThresholdPtr& threshold) {
  threshold_ = threshold;
  in_pixels_ = InPixels(threshold);
}

ThresholdPtr Levels::At(int level) const {
  if (level == kNone) return threshold_ == nullptr ? FullResolution() : threshold_;
  if (level == top()) return CoarsestThreshold();
  const double step = Step(level);
  if (threshold_ == nullptr) return ConstantThreshold(step);
  if (const std::optional<double> value = threshold_->constant()) {
    return ConstantThreshold(std::max(*value, step));
  }
  if (const std::optional<double> pixels = threshold_->pixels()) {
    return threshold_->AtPixels(std::max(*pixels, step));
  }
  return MaxThreshold(
      {threshold_, in_pixels_ ? threshold_->AtPixels(step) : ConstantThreshold(step)});
}

int Levels::LevelOf(double bound, double pixel) const {
  const double estimate = std::log2(bound / pixel) * kOctave + kPixelLevels / 2;
  int level = estimate > 0 ? static_cast<int>(std::min<double>(estimate, top())) : 0;
  while (level > 0 && bound <= Step(level - 1) * pixel) --level;
  while (level < top() && !(bound <= Step(level) * pixel)) ++level;
  return level;
}

}  // namespace mtdb::internal
