// SPDX-License-Identifier: Apache-2.0
// Samples of images, which are kept in levels of half the size.
#pragma once

#include <vector>

#include "codecs/image_file/decode_image.h"
#include "store/base/geometry.h"

namespace mtdb::internal {

struct Texel {
  Vec3f colour;  // linear, times alpha
  float alpha = 0;
  Vec3f Over(Vec3f under) const { return colour + under * (1 - alpha); }
};

// Of the four pixels around a place, by their nearness: the middle of the first pixel is at
// (0.5, 0.5). Pixels at the edge go on beyond it.
Texel TexelAt(const Pixels& image, double x, double y);

// The image, and halves of the one before, so that samples that are far apart do not flicker. Load
// first; then safe for many threads. Memory: six bytes a pixel.
class ImageLevels {
 public:
  void Load(Pixels image);
  double width() const { return static_cast<double>(levels_[0].width); }
  double height() const { return static_cast<double>(levels_[0].height); }

  // At (x, y) in parts of the image, from the upper left corner; `pixels` of it are from one sample
  // to the next.
  Texel At(double x, double y, double pixels) const;

 private:
  std::vector<Pixels> levels_;
};

}  // namespace mtdb::internal
