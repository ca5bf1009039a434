// SPDX-License-Identifier: Apache-2.0
// How far two parts of textured surfaces are apart, in space and in the image: points that one is
// mapped to the other by are as near as can be in the larger of both.
#pragma once

#include <array>

#include "store/base/geometry.h"

namespace mtdb::internal {

// A vertex. Its texture coordinates are (x, y), scaled to the length that they count as.
struct TexturedPoint {
  Vec3d place, texture;
};

// Each is the larger of the distance of two points and of the difference of their texture
// coordinates: of a point and one of a segment or triangle, of two of two segments. The points are
// those that are nearest in space, or in the image, whichever is less.
double PointSegmentSlip(const TexturedPoint& p, const TexturedPoint& a, const TexturedPoint& b);
double PointTriangleSlip(const TexturedPoint& p, const std::array<TexturedPoint, 3>& triangle);
double SegmentSegmentSlip(const TexturedPoint& a, const TexturedPoint& b, const TexturedPoint& c,
                          const TexturedPoint& d);

}  // namespace mtdb::internal
