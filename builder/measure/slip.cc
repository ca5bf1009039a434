// SPDX-License-Identifier: Apache-2.0
#include "builder/measure/slip.h"

#include <algorithm>
#include <cmath>

#include "store/base/nearest_places.h"

namespace mtdb::internal {
namespace {

using Weights = std::array<double, 3>;

// Of the corners, for the nearest point of a triangle.
Weights NearestInTriangle(Vec3d p, const std::array<Vec3d, 3>& t) {
  const Vec3d ab = t[1] - t[0], ac = t[2] - t[0], ap = p - t[0];
  const double bb = Dot(ab, ab), bc = Dot(ab, ac), cc = Dot(ac, ac);
  const double pb = Dot(ap, ab), pc = Dot(ap, ac);
  const double sum = bb * cc - bc * bc;
  if (sum > 0) {
    const double v = (cc * pb - bc * pc) / sum;
    const double w = (bb * pc - bc * pb) / sum;
    if (v >= 0 && w >= 0 && v + w <= 1) return {1 - v - w, v, w};
  }
  Weights best{1, 0, 0};
  double least = SquaredLength(ap);
  for (size_t e = 0; e < 3; ++e) {
    const size_t f = (e + 1) % 3;
    const double s = NearestOnSegment(p, t[e], t[f]);
    const double squared = SquaredLength(t[e] + (t[f] - t[e]) * s - p);
    if (squared > least) continue;
    least = squared;
    best = {0, 0, 0};
    best[e] = 1 - s;
    best[f] = s;
  }
  return best;
}

TexturedPoint Between(const TexturedPoint& a, const TexturedPoint& b, double s) {
  return {a.place + (b.place - a.place) * s, a.texture + (b.texture - a.texture) * s};
}

double Apart(const TexturedPoint& p, const TexturedPoint& q) {
  return std::sqrt(
      std::max(SquaredLength(p.place - q.place), SquaredLength(p.texture - q.texture)));
}

}  // namespace

double PointSegmentSlip(const TexturedPoint& p, const TexturedPoint& a, const TexturedPoint& b) {
  return std::min(Apart(p, Between(a, b, NearestOnSegment(p.place, a.place, b.place))),
                  Apart(p, Between(a, b, NearestOnSegment(p.texture, a.texture, b.texture))));
}

double PointTriangleSlip(const TexturedPoint& p, const std::array<TexturedPoint, 3>& t) {
  const auto apart = [&](const Weights& w) {
    return Apart(p, {t[0].place * w[0] + t[1].place * w[1] + t[2].place * w[2],
                     t[0].texture * w[0] + t[1].texture * w[1] + t[2].texture * w[2]});
  };
  return std::min(apart(NearestInTriangle(p.place, {t[0].place, t[1].place, t[2].place})),
                  apart(NearestInTriangle(p.texture, {t[0].texture, t[1].texture, t[2].texture})));
}

double SegmentSegmentSlip(const TexturedPoint& a, const TexturedPoint& b, const TexturedPoint& c,
                          const TexturedPoint& d) {
  const auto apart = [&](const std::array<double, 2>& at) {
    return Apart(Between(a, b, at[0]), Between(c, d, at[1]));
  };
  return std::min(apart(NearestOnSegments(a.place, b.place, c.place, d.place)),
                  apart(NearestOnSegments(a.texture, b.texture, c.texture, d.texture)));
}

}  // namespace mtdb::internal
