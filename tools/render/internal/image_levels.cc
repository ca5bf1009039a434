// SPDX-License-Identifier: Apache-2.0
#include "tools/render/internal/image_levels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace mtdb::internal {

namespace {

constexpr size_t kFine = 4096;  // steps of linear light

// Bytes as displayed, and linear light.
struct Gamma {
  std::array<float, 256> linear{};
  std::array<uint8_t, kFine + 1> shown{};
  Gamma() {
    for (size_t i = 0; i < linear.size(); ++i) {
      linear[i] = std::pow(static_cast<float>(i) / 255, 2.2f);
    }
    for (size_t i = 0; i < shown.size(); ++i) {
      const float byte = 255 * std::pow(static_cast<float>(i) / kFine, 1 / 2.2f);
      shown[i] = static_cast<uint8_t>(std::lround(byte));
    }
  }
};

const Gamma& TheGamma() {
  static const Gamma kGamma;
  return kGamma;
}

// Means of two by two pixels, of their light.
Pixels Halved(const Pixels& from) {
  const Gamma& gamma = TheGamma();
  Pixels to;
  to.width = (from.width + 1) / 2;
  to.height = (from.height + 1) / 2;
  to.rgba.resize(4 * to.width * to.height);
  for (size_t y = 0; y < to.height; ++y) {
    for (size_t x = 0; x < to.width; ++x) {
      float sum[3] = {}, alpha = 0;
      for (size_t i = 0; i < 4; ++i) {
        const size_t column = std::min(2 * x + i % 2, from.width - 1);
        const size_t row = std::min(2 * y + i / 2, from.height - 1);
        const uint8_t* const pixel = &from.rgba[4 * (row * from.width + column)];
        alpha += pixel[3];
        for (size_t c = 0; c < 3; ++c) sum[c] += gamma.linear[pixel[c]] * pixel[3];
      }
      uint8_t* const pixel = &to.rgba[4 * (y * to.width + x)];
      pixel[3] = static_cast<uint8_t>(std::lround(alpha / 4));
      for (size_t c = 0; c < 3 && alpha > 0; ++c) {
        pixel[c] = gamma.shown[static_cast<size_t>(std::lround(sum[c] / alpha * kFine))];
      }
    }
  }
  return to;
}

}  // namespace

Texel TexelAt(const Pixels& image, double x, double y) {
  const Gamma& gamma = TheGamma();
  const double column = std::floor(x - 0.5), row = std::floor(y - 0.5);
  const auto right = static_cast<float>(x - 0.5 - column);
  const auto down = static_cast<float>(y - 0.5 - row);
  const auto inside = [](double at, size_t count) {
    return static_cast<size_t>(std::clamp(at, 0.0, static_cast<double>(count - 1)));
  };
  Texel sum;
  for (int i = 0; i < 4; ++i) {
    const size_t at =
        inside(row + i / 2, image.height) * image.width + inside(column + i % 2, image.width);
    const uint8_t* const pixel = &image.rgba[4 * at];
    const float weight = (i % 2 == 0 ? 1 - right : right) * (i / 2 == 0 ? 1 - down : down) *
                         (static_cast<float>(pixel[3]) / 255);
    sum.alpha += weight;
    sum.colour +=
        Vec3f{gamma.linear[pixel[0]], gamma.linear[pixel[1]], gamma.linear[pixel[2]]} * weight;
  }
  return sum;
}

void ImageLevels::Load(Pixels image) {
  levels_.clear();
  levels_.push_back(std::move(image));
  while (levels_.back().width > 1 || levels_.back().height > 1) {
    levels_.push_back(Halved(levels_.back()));
  }
}

Texel ImageLevels::At(double x, double y, double pixels) const {
  const double level = pixels > 1 ? std::floor(std::log2(pixels)) : 0;
  const double last = static_cast<double>(levels_.size() - 1);
  const Pixels& image = levels_[static_cast<size_t>(std::min(level, last))];
  return TexelAt(image, x * static_cast<double>(image.width),
                 y * static_cast<double>(image.height));
}

}  // namespace mtdb::internal
