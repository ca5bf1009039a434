// SPDX-License-Identifier: Apache-2.0
// RasterSurface: a tile's input surface where that is a raster at full resolution. It is a
// RoundMesh of which nothing need be kept but heights.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "store/base/geometry.h"

namespace mtdb::internal {

class RasterSurface {
 public:
  // `positions` are integers, of which x and y are columns and rows. False, and the surface is
  // empty, when `triangles` are not halves of cells that are all cut by the same diagonal, when one
  // has an error, when they are too far apart for a table of heights, or when a place has two
  // heights, as at the foot and the edge of a cliff.
  bool Build(std::span<const std::array<uint32_t, 3>> triangles, std::span<const Vec3d> positions,
             std::span<const float> errors);
  void Clear() { heights_.clear(); }
  bool empty() const { return heights_.empty(); }

  // Of an edge between two samples that runs above the surface: what RoundMesh::CurveOf says, bit
  // for bit, seen along z. That is the largest difference in height between the two, which is at a
  // crossing with an edge of the surface; these lie on three families of parallel lines, so that
  // the crossings follow from the ends. Negative when the edge is too long. Of an edge that leaves
  // the surface it is negative or means nothing.
  double CurveError(Vec3d a, Vec3d b) const;

 private:
  static constexpr int32_t kNone = std::numeric_limits<int32_t>::min();
  // The lines f = constant, on each of which samples are numbered by g. A sample's place in the
  // table goes up by f_stride and g_stride with f and g.
  struct Family {
    int32_t df, dg;  // of the edge, from its begin to its end
    int32_t f_stride, g_stride;
    bool right_is_up;  // g grows from the left of the edge to its right
  };
  struct Edge {
    int32_t at;  // the begin's place in the table
    double z, dz;
    double flat2, inverse_flat2;  // the squared length seen along z
  };
  double CrossFamily(const Edge& edge, const Family& family) const;

  std::vector<int32_t> heights_;  // row by row; kNone: no sample
  int32_t left_ = 0, bottom_ = 0, width_ = 0;
  bool falls_ = false;  // cells are cut from the upper left to the lower right
};

}  // namespace mtdb::internal
