// SPDX-License-Identifier: Apache-2.0
#include "tools/render/internal/draped_image.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

namespace mtdb::internal {

Status DrapedImage::Load(const MeshTexture& texture) {
  MTDB_ASSIGN_OR_RETURN(Pixels pixels, DecodeImage(std::as_bytes(std::span(texture.image))));
  place_ = texture.place;
  image_.Load(std::move(pixels));
  return Status::Ok();
}

Vec3f DrapedImage::Over(Vec3f under, double x, double y, double size) const {
  const double u = place_[0] + place_[1] * x + place_[2] * y;
  const double v = place_[3] + place_[4] * x + place_[5] * y;
  if (!(u >= 0 && u <= 1 && v >= 0 && v <= 1)) return under;
  const double pixels = size * std::max(std::hypot(place_[1], place_[2]) * image_.width(),
                                        std::hypot(place_[4], place_[5]) * image_.height());
  return image_.At(u, v, pixels).Over(under);
}

}  // namespace mtdb::internal
