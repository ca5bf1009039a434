// SPDX-License-Identifier: Apache-2.0
// VertexDistances: how far points of one surface are from another one, each between two bounds.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "query/compare.h"
#include "query/compare/goals.h"
#include "query/compare/side.h"
#include "query/compare/triangle_tree.h"

namespace mtdb::internal {

// From coarse to fine, as OneSided does it: what a cut of the other surface leaves open is asked
// again around the points in question. One thread.
class VertexDistances {
 public:
  // An interval is narrow enough at `width`, and when it has met the goals of a tolerance and a
  // reach. `point_bound`: what the points stand for is so near to them.
  VertexDistances(const Side& answering, double point_bound, double width, const Goals& goals,
                  const Box3d& around);

  // Fills in an interval for each point.
  Status Find(std::span<const Vec3d> points, std::vector<DistanceInterval>* intervals);
  const Side::Reading& reading() const { return reading_; }

 private:
  // Numbers of points.
  using Numbers = std::vector<uint32_t>;

  bool IsEnough(const DistanceInterval& interval) const;
  // Asks the first cut, which is of all of the other surface.
  Status Begin();
  // Asks the cuts from a level on around some of the points.
  Status Refine(Numbers numbers, size_t level);
  // Keeps the points that want more.
  void Ask(const Patch& patch, const TriangleTree& tree, double known, Numbers* numbers);

  const Side& answering_;
  const double point_bound_, width_, outward_;
  const Goals& goals_;
  std::vector<double> thresholds_;
  std::optional<Patch> first_;
  std::optional<TriangleTree> first_tree_;
  std::span<const Vec3d> points_;
  std::vector<DistanceInterval>* intervals_ = nullptr;
  Side::Reading reading_;
};

}  // namespace mtdb::internal
