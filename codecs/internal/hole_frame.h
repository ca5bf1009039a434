// HoleFrame: where a vertex is expected, given the hole that it fills, and how far off it may be.
//
// A vertex's coordinates are coded one after the other: u and v, the two axes that the hole is
// seen along best, then n, the axis nearest to its normal. Each is predicted with those before it
// known (v by the ring's regression line, n by the hole's own surface above (u, v)), which makes
// the three residuals as independent as those in a rotated frame, by shears alone.
//
// Numbers are IEEE binary32, relative to the ring's first vertex; each operation is rounded
// correctly and done in the order of codecs/FORMAT.md, so that every machine predicts the same bits
// (no contraction, no reassociation).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "codecs/cluster_codec.h"
#include "codecs/internal/patch.h"
#include "store/base/geometry.h"

namespace mtdb {

// Of one coordinate: where it is expected, and the square of the deviation to expect.
struct Expectation {
  int32_t value = 0;
  float variance = 0;
};

class HoleFrame {
 public:
  // `patch` has walked a hole; a boundary node's ring is rotated.
  HoleFrame(const Patch& patch, const std::vector<Vec3i>& positions, bool boundary);

  int axis_u() const { return u_; }
  int axis_v() const { return v_; }
  int axis_n() const { return n_; }
  Expectation ExpectU() const;
  Expectation ExpectV(int32_t u) const;
  int32_t ExpectN(int32_t u, int32_t v) const;
  // How much longer a step along n is than its part along the hole's normal; 1 .. sqrt(3).
  float slant() const;
  // The square of the ring's deviation from the hole's plane, along n.
  float unevenness() const;
  const RingPoints& ring() const { return ring_; }

 private:
  RingPoints ring_;
  // Of the hole's triangles: by axis, corner, triangle; padded with zeros to a multiple of four.
  int32_t hole_[3][3][kMaxRing + 4];
  uint32_t hole_count_;
  float mean_[3];    // the predicted point
  float normal_[3];  // of the ring, not of unit length
  float uu_, vv_, slope_;
  int u_, v_, n_;
};

}  // namespace mtdb
