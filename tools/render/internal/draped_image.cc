// SPDX-License-Identifier: Apache-2.0
#include "tools/render/internal/draped_image.h"

#include <algorithm>
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

Status DrapedImage::Load(const MeshTexture& texture) {
  MTDB_ASSIGN_OR_RETURN(Pixels pixels, DecodeImage(texture.image));
  place_ = texture.place;
  levels_.clear();
  levels_.push_back(std::move(pixels));
  while (levels_.back().width > 1 || levels_.back().height > 1) {
    levels_.push_back(Halved(levels_.back()));
  }
  return Status::Ok();
}

// Of the four pixels around a place, by their nearness.
DrapedImage::Texel DrapedImage::At(const Pixels& level, double u, double v) {
  const Gamma& gamma = TheGamma();
  const double x = u * static_cast<double>(level.width) - 0.5;
  const double y = v * static_cast<double>(level.height) - 0.5;
  const double column = std::floor(x), row = std::floor(y);
  const auto right = static_cast<float>(x - column), down = static_cast<float>(y - row);
  const auto inside = [](double at, size_t count) {
    return static_cast<size_t>(std::clamp(at, 0.0, static_cast<double>(count - 1)));
  };
  Texel sum;
  for (int i = 0; i < 4; ++i) {
    const size_t at =
        inside(row + i / 2, level.height) * level.width + inside(column + i % 2, level.width);
    const uint8_t* const pixel = &level.rgba[4 * at];
    const float weight = (i % 2 == 0 ? 1 - right : right) * (i / 2 == 0 ? 1 - down : down) *
                         (static_cast<float>(pixel[3]) / 255);
    sum.alpha += weight;
    sum.colour +=
        Vec3f{gamma.linear[pixel[0]], gamma.linear[pixel[1]], gamma.linear[pixel[2]]} * weight;
  }
  return sum;
}

Vec3f DrapedImage::Over(Vec3f under, double x, double y, double size) const {
  const double u = place_[0] + place_[1] * x + place_[2] * y;
  const double v = place_[3] + place_[4] * x + place_[5] * y;
  if (!(u >= 0 && u <= 1 && v >= 0 && v <= 1)) return under;
  // Pixels of the image from one sample to the next.
  const double pixels =
      size * std::max(std::hypot(place_[1], place_[2]) * static_cast<double>(levels_[0].width),
                      std::hypot(place_[4], place_[5]) * static_cast<double>(levels_[0].height));
  const double level = pixels > 1 ? std::floor(std::log2(pixels)) : 0;
  const double last = static_cast<double>(levels_.size() - 1);
  const Texel texel = At(levels_[static_cast<size_t>(std::min(level, last))], u, v);
  return texel.colour + under * (1 - texel.alpha);
}

}  // namespace mtdb::internal
