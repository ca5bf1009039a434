// SPDX-License-Identifier: Apache-2.0
#include "query/compare/vertex_distances.h"

#include <algorithm>
#include <limits>
#include <memory>
#include <numeric>
#include <utility>

#include "query/compare/curve.h"
#include "query/compare/outward.h"

namespace mtdb::internal {
namespace {

constexpr double kFall = 4;
constexpr size_t kPointsTogether = 8192;
constexpr uint64_t kMostTriangles = 600'000;
constexpr uint64_t kNoLimit = std::numeric_limits<uint64_t>::max();

}  // namespace

VertexDistances::VertexDistances(const Side& answering, double point_bound, double width,
                                 const Goals& goals, const Box3d& around)
    : answering_(answering),
      point_bound_(point_bound),
      width_(width),
      outward_(kOutward * std::max(LargestMagnitude(around), LargestMagnitude(answering.bounds()))),
      goals_(goals) {
  thresholds_.push_back(answering.largest_bound() / kFall);
  double threshold = std::min(thresholds_[0] / kFall, width / 4);
  const double finest = std::max(2 * answering.least_bound(), thresholds_[0] * 0x1p-22);
  for (; threshold > finest; threshold /= kFall) thresholds_.push_back(threshold);
  thresholds_.push_back(-1);
}

bool VertexDistances::IsEnough(const DistanceInterval& interval) const {
  if (goals_.reach() && interval.low > *goals_.reach()) return true;
  return interval.high - interval.low <= width_ && goals_.Met(interval.low, interval.high);
}

Status VertexDistances::Begin() {
  MTDB_ASSIGN_OR_RETURN(first_, answering_.Take(nullptr, 0, thresholds_[0], kNoLimit, &reading_));
  first_tree_.emplace(first_->triangles, outward_);
  return Status::Ok();
}

Status VertexDistances::Find(std::span<const Vec3d> points,
                             std::vector<DistanceInterval>* intervals) {
  points_ = points;
  intervals_ = intervals;
  intervals->assign(points.size(), {});
  if (answering_.empty()) return Status::Ok();
  if (!first_) MTDB_RETURN_IF_ERROR(Begin());
  Numbers numbers(points.size());
  std::iota(numbers.begin(), numbers.end(), 0U);
  Ask(*first_, *first_tree_, std::numeric_limits<double>::infinity(), &numbers);
  Box3d around;
  for (const Vec3d& p : points) around.Add(p);
  SortAlongCurve(numbers, around, [&](uint32_t i) { return points[i]; });
  for (size_t first = 0; first < numbers.size(); first += kPointsTogether) {
    const size_t last = std::min(first + kPointsTogether, numbers.size());
    MTDB_RETURN_IF_ERROR(Refine({numbers.begin() + static_cast<ptrdiff_t>(first),
                                 numbers.begin() + static_cast<ptrdiff_t>(last)},
                                1));
  }
  return Status::Ok();
}

Status VertexDistances::Refine(Numbers numbers, size_t level) {
  for (; level < thresholds_.size() && !numbers.empty(); ++level) {
    std::vector<Box3d> boxes;
    double known = 0;
    for (const uint32_t i : numbers) {
      boxes.push_back({points_[i], points_[i]});
      known = std::max(known, (*intervals_)[i].high);
    }
    if (goals_.reach()) known = std::min(known, 2 * *goals_.reach() + 4 * point_bound_);
    const uint64_t most = numbers.size() > 1 ? kMostTriangles : kNoLimit;
    MTDB_ASSIGN_OR_RETURN(
        const std::optional<Patch> patch,
        answering_.Take(std::make_shared<BoxSet>(std::move(boxes)), Up(known + outward_),
                        thresholds_[level], most, &reading_));
    if (!patch) {
      const auto middle = numbers.begin() + static_cast<ptrdiff_t>(numbers.size() / 2);
      MTDB_RETURN_IF_ERROR(Refine({numbers.begin(), middle}, level));
      return Refine({middle, numbers.end()}, level);
    }
    Ask(*patch, TriangleTree(patch->triangles, outward_), known, &numbers);
  }
  return Status::Ok();
}

void VertexDistances::Ask(const Patch& patch, const TriangleTree& tree, double known,
                          Numbers* numbers) {
  uint32_t hint = 0;
  std::erase_if(*numbers, [&](uint32_t i) {
    DistanceInterval& interval = (*intervals_)[i];
    const TriangleTree::Near near = tree.Nearest(points_[i], hint);
    hint = near.triangle;
    const double low = std::min(near.low - patch.bound, known) - point_bound_;
    if (low > 0) interval.low = std::max(interval.low, low * (1 - 0x1p-48));
    interval.high = std::min(interval.high, Up(near.high + patch.bound + point_bound_));
    return IsEnough(interval);
  });
}

}  // namespace mtdb::internal
