// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/places/terrain_clip.h"

#include <utility>

namespace mtdb {

namespace {

ClipVertex Crossing(const ClipVertex& from, const ClipVertex& to, int axis, double line) {
  const bool in_order = from.position <= to.position;
  const ClipVertex& a = in_order ? from : to;
  const ClipVertex& b = in_order ? to : from;
  const double t = (line - a.position[axis]) / (b.position[axis] - a.position[axis]);
  ClipVertex v{a.position + t * (b.position - a.position), a.normal + t * (b.normal - a.normal)};
  v.position[axis] = line;
  return v;
}

}  // namespace

ClipPolygon ClipBetween(const ClipPolygon& polygon, int axis, double low, double high) {
  ClipPolygon clipped;
  for (size_t i = 0; i < polygon.count; ++i) {
    const ClipVertex& from = polygon.corners[i];
    const ClipVertex& to = polygon.corners[(i + 1) % polygon.count];
    const double a = from.position[axis], b = to.position[axis];
    if (a >= low && a <= high) clipped.Add(from);
    // The lines that lie strictly between the ends, in the order in which the edge meets them.
    const bool up = a < b;
    const double first = up ? low : high, second = up ? high : low;
    for (const double line : {first, second}) {
      const bool crosses = up ? a < line && line < b : b < line && line < a;
      if (crosses) clipped.Add(Crossing(from, to, axis, line));
    }
  }
  return clipped;
}

}  // namespace mtdb
