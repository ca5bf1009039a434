// SPDX-License-Identifier: Apache-2.0
// HoleFrame: where a vertex is expected, given the hole that it fills, and how far off it may be.
//
// A vertex's coordinates are coded one after the other: u and v, the two axes that the hole is
// seen along best, then n, the axis nearest to its normal. Each is predicted with those before it
// known (v by the ring's regression line, n by the hole's own surface above (u, v)), which makes
// the three residuals as independent as those in a rotated frame, by shears alone.
//
// A mesh is a Patch or a ClientMesh (hole_frame.inc): points()[vertex], triangle(slot).corners.
//
// Numbers are IEEE binary32, relative to the ring's first vertex; each operation is rounded
// correctly and done in the order of codecs/FORMAT.md, so that every machine predicts the same bits
// (no contraction, no reassociation).
#pragma once

#include <cstdint>
#include <span>

#include "codecs/coding/patch.h"
#include "store/base/float4.h"
#include "store/base/geometry.h"

namespace mtdb {

// floor(x + 1/2), for x that is clamped to +-2^30; not a number counts as the least.
inline int32_t RoundCoordinate(float x) {
  constexpr float kLimit = 1073741824.0f;
  const float above = x > -kLimit ? x : -kLimit;
  const float up = (above < kLimit ? above : kLimit) + 0.5f;
  const auto truncated = static_cast<int32_t>(up);
  return truncated - (static_cast<float>(truncated) > up ? 1 : 0);
}
// Modulo 2^32.
inline int32_t Shift(int32_t base, int32_t offset) {
  return static_cast<int32_t>(static_cast<uint32_t>(base) + static_cast<uint32_t>(offset));
}

class HoleFrame {
 public:
  // `slots` and `ring`: of a hole of the patch; a boundary node's ring is rotated. `flat`: of a
  // height field: n is z, and errors are heights.
  template <typename Mesh>
  void Set(const Mesh& patch, std::span<const uint32_t> slots, std::span<const uint32_t> ring,
           bool boundary, bool flat = false);

  int axis_u() const { return u_; }
  int axis_v() const { return v_; }
  int axis_n() const { return n_; }
  int32_t ExpectU() const;
  int32_t ExpectV(int32_t u) const;
  // `slots`: those of Set().
  template <typename Mesh>
  int32_t ExpectN(const Mesh& patch, std::span<const uint32_t> slots, int32_t u, int32_t v) const;
  // The squares of the deviations to expect of u and v.
  float variance_u() const { return variance_u_; }
  float variance_v() const { return variance_v_; }
  // How much longer a step along n is than its part along the hole's normal; 1 .. sqrt(3).
  float slant() const { return slant_; }
  // The square of the ring's deviation from the hole's plane, along n.
  template <typename Mesh>
  float unevenness(const Mesh& patch, std::span<const uint32_t> ring) const;

 private:
  // The corners of four of the hole's triangles, relative to the base: by corner, axis, triangle.
  // Behind the last triangle come such with three corners in the base.
  struct Corners {
    float at[3][3][4];
  };
  template <typename Mesh>
  static Float4 Gather(const Mesh& patch, std::span<const uint32_t> slots, uint32_t base_vertex,
                       Corners& corners);

  float mean_[4];     // the predicted point
  float slope_n_[4];  // of the ring's plane: the normal over its part along n
  int32_t base_[4];   // the ring's first vertex
  float variance_u_, variance_v_, slope_v_, slant_;
  float side_;  // 1 or -1, with the sign of the normal's part along n
  int u_, v_, n_;
  uint32_t base_vertex_;
  Corners first_corners_;  // of the first four triangles
};

}  // namespace mtdb
