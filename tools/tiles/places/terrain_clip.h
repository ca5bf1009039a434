// SPDX-License-Identifier: Apache-2.0
// Pieces of triangles between meridians and parallels, cut so that both sides of a line agree.
#pragma once

#include <array>
#include <cstddef>

#include "store/base/geometry.h"

namespace mtdb {

struct ClipVertex {
  Vec3d position;
  Vec3d normal;
};

// A convex polygon; of a triangle between three pairs of planes it has at most nine corners.
struct ClipPolygon {
  static constexpr size_t kMost = 10;
  std::array<ClipVertex, kMost> corners{};
  size_t count = 0;
  void Add(const ClipVertex& v) {
    if (count < corners.size()) corners[count++] = v;
  }
};

// The part of the polygon where low <= position[axis] <= high. A corner on a line lies there
// exactly, and follows from the edge's ends alone, whichever side is asked for: so what is cut at x
// first and then at y fits what lies beside it, bit for bit.
ClipPolygon ClipBetween(const ClipPolygon& polygon, int axis, double low, double high);

}  // namespace mtdb
