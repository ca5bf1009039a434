// HoleFrame: where a vertex is expected, given the hole that it fills, and how far off it may be.
//
// A vertex's coordinates are coded one after the other: u and v, the two axes that the hole is
// seen along best, then n, the axis nearest to its normal. Each is predicted with those before it
// known (v by the ring's regression line, n by the hole's own surface above (u, v)), which makes
// the three residuals as independent as those in a rotated frame, by shears alone.
//
// All numbers are IEEE binary64 and each operation is correctly rounded and in the order written
// here, so that every machine predicts the same bits (no contraction, no reassociation).
#pragma once

#include <array>
#include <cstdint>

#include "codecs/internal/patch.h"
#include "store/base/geometry.h"

namespace mtdb {

// Of one coordinate: where it is expected, and the square of the deviation to expect.
struct Expectation {
  int32_t value = 0;
  double variance = 0;
};

class HoleFrame {
 public:
  HoleFrame(const Patch& patch, bool boundary);

  int axis_u() const { return u_; }
  int axis_v() const { return v_; }
  int axis_n() const { return n_; }
  Expectation ExpectU() const;
  Expectation ExpectV(int32_t u) const;
  int32_t ExpectN(int32_t u, int32_t v) const;
  // How much longer a step along n is than its part along the hole's normal; 1 .. sqrt(3).
  double slant() const;
  // The square of the ring's deviation from the hole's plane, along n.
  double unevenness() const;

 private:
  // Coordinates of the ring, relative to mean_, and of the corners of the hole's triangles. Plain
  // arrays, since those of Vec3d would be cleared for each node.
  double ring_[kMaxRing][3];
  double hole_[kMaxRing][3][3];
  size_t ring_count_, hole_count_;
  Vec3d mean_;    // the predicted point
  Vec3d normal_;  // of the ring, not of unit length
  int u_ = 0, v_ = 1, n_ = 2;
  double uu_ = 0, vv_ = 0, slope_ = 0;
};

}  // namespace mtdb
