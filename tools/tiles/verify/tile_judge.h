// SPDX-License-Identifier: Apache-2.0
// TileJudge: points of tiles against the object's full resolution, and what is wrong with them.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "query/surface.h"
#include "store/base/status.h"
#include "store/check_report.h"
#include "tools/tiles/places/tile_placement.h"

namespace mtdb {

inline constexpr size_t kPointsOfTile = 24;  // that are measured
inline constexpr double kJudgeSlack = 1e-9;  // of sizes, for rounding

// What all kinds of tiles are checked with. Failures go to the report; errors are the surface's.
class TileJudge {
 public:
  TileJudge(const Surface& surface, CheckReport* report);

  const ObjectRecord& record() const { return surface_.record(); }
  const TilePlacement& placement() const { return placement_; }
  size_t tiles() const { return tiles_; }

  void Fail(const std::string& file, const std::string& what);
  // So much is wrong that no more is looked for.
  bool HasEnough() const;
  void CountTile() { ++tiles_; }
  // Points are in the object's coordinates; `unit` is what its lengths are multiplied by to be in
  // units of the bound.
  Status MeasureDistances(const std::string& name, const std::vector<Vec3d>& points, double unit,
                          double bound);
  // Heights of a terrain, where there are any: a border may have moved. A tile's lattice puts its
  // vertices up to `near` beside where they were; so heights around count, too, where a cliff is.
  Status MeasureHeights(const std::string& name, const std::vector<Vec3d>& points, double bound,
                        std::array<double, 2> near);
  // Tells what was measured.
  void Conclude(const std::string& what);

 private:
  void Judge(const std::string& name, double distance, double slack, double bound);
  // Infinite where there is no height. 0 where the surface passes the point between the two places.
  Result<double> HeightDistance(Vec3d p, std::array<double, 2> beside);

  const Surface& surface_;
  CheckReport& report_;
  const TilePlacement placement_;
  size_t tiles_ = 0, points_ = 0;
  double largest_part_ = 0;
};

}  // namespace mtdb
