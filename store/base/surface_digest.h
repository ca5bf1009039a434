// SPDX-License-Identifier: Apache-2.0
// SurfaceDigest: two numbers that tell a mesh from others, whatever the order and numbering of its
// triangles and vertices. The builder computes them of the input, and `verify` of the mesh that the
// store gives back.
#pragma once

#include <array>
#include <cstdint>

#include "store/base/geometry.h"
#include "store/base/hash.h"

namespace mtdb {

// Order-free sums mod 2^64 over triangles on the object's grid:
// - surface_digest: a hash of each triangle's three positions, rotated to the smallest rotation
//   (orientation counts, the first corner does not);
// - border_digest: sign * hash of each directed edge's two positions, sign +1 when the edge runs
//   from the smaller position to the larger, -1 otherwise, 0 when both are equal. Edges that two
//   triangles share in opposite directions cancel: what remains is the oriented border.
// Sums of parts may be merged. Not safe for several threads.
class SurfaceDigest {
 public:
  void AddTriangle(const std::array<Vec3i, 3>& p) {
    int first = 0;
    for (int i = 1; i < 3; ++i) {
      const auto rotated = [&](int at) {
        return std::array<Vec3i, 3>{p[at], p[(at + 1) % 3], p[(at + 2) % 3]};
      };
      if (rotated(i) < rotated(first)) first = i;
    }
    uint64_t h = 0;
    for (int i = 0; i < 3; ++i) h = Chain(h, p[(first + i) % 3]);
    surface_ += h;
    for (int i = 0; i < 3; ++i) {
      const Vec3i& a = p[i];
      const Vec3i& b = p[i == 2 ? 0 : i + 1];
      if (a < b) {
        border_ += Chain(Chain(kEdgeSeed, a), b);
      } else if (b < a) {
        border_ -= Chain(Chain(kEdgeSeed, b), a);
      }
    }
    ++triangles_;
  }

  void Merge(const SurfaceDigest& other) {
    surface_ += other.surface_;
    border_ += other.border_;
    triangles_ += other.triangles_;
  }

  uint64_t surface_digest() const { return surface_; }
  uint64_t border_digest() const { return border_; }
  uint64_t triangles() const { return triangles_; }

 private:
  static constexpr uint64_t kEdgeSeed = 0x65646765;  // "edge"

  static uint64_t Chain(uint64_t h, const Vec3i& p) {
    const uint64_t xy =
        (static_cast<uint64_t>(static_cast<uint32_t>(p.x)) << 32) | static_cast<uint32_t>(p.y);
    return Mix64(Mix64(h ^ xy) ^ static_cast<uint32_t>(p.z));
  }

  uint64_t surface_ = 0;
  uint64_t border_ = 0;
  uint64_t triangles_ = 0;
};

}  // namespace mtdb
