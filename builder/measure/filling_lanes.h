// SPDX-License-Identifier: Apache-2.0
// FillingLanes: how far points are from the triangles of a filling, four at once.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "builder/holes/hole.h"
#include "store/base/float4.h"

namespace mtdb::internal {

// Points in binary32 and the hole's frame, spread; the last one again until four are full.
struct SpreadPoints {
  double scale = 1;  // they are so many times as far from the frame's origin
  std::vector<float> x, y, z;

  void Set(std::span<const Vec3d> points, double new_scale);
  size_t size() const { return x.size(); }  // a multiple of four
};

// Rounding makes the distances a little too large or too small. Work of one thread.
class FillingLanes {
 public:
  // Reads the hole's points. `scale` makes all distances at most 1 or so, so that their squares are
  // numbers of binary32; those below are so many times as large.
  void Set(const Hole& hole, const Hole::Triangles& triangles, double scale);
  // Of a point of the hole's frame from the filling.
  float SquaredDistance(Vec3d point) const;
  // Of all points, which have the same scale, from the triangles that are nearest to them; which
  // those are.
  void FindNearest(const SpreadPoints& points, std::vector<float>& squared,
                   std::vector<uint32_t>& nearest) const;

 private:
  // What is known of a triangle.
  enum Number : uint8_t {
    kNormal,               // unit; 0 without area
    kLeast = kNormal + 3,  // what a point has inwards of all sides that lies over it
    kCorner,
    kAlong = kCorner + 9,        // the side from each corner on
    kInwards = kAlong + 9,       // at right angles to the sides and the normal
    kPerLength2 = kInwards + 9,  // over the sides' squared lengths
    kNumbers = kPerLength2 + 3
  };
  static constexpr Number After(int number, int steps) {
    return static_cast<Number>(number + steps);
  }
  template <typename Get>
  static Float4 SquaredDistance(const Get& get, Float4 x, Float4 y, Float4 z);

  uint32_t count_ = 0;
  double scale_ = 1;
  alignas(16) std::array<std::array<float, Hole::kMaxRing>, kNumbers> numbers_;
};

}  // namespace mtdb::internal
