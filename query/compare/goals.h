// SPDX-License-Identifier: Apache-2.0
// Goals: when a part of a surface need not be looked at again; what all threads know.
#pragma once

#include <atomic>
#include <optional>

#include "query/compare.h"
#include "store/base/threading.h"

namespace mtdb::internal {

// Safe for many threads.
class Goals {
 public:
  Goals(std::optional<double> tolerance, std::optional<double> width, std::optional<double> reach)
      : tolerance_(tolerance), width_(width), reach_(reach) {}

  // Whether more need not be known of points with distances of at most `high`, one of which has a
  // distance of at least `low`.
  bool Met(double low, double high) const {
    if (reach_ && low > *reach_) return true;
    if (tolerance_ && high > *tolerance_ && low <= *tolerance_) return false;
    return !width_ || high <= lowest() + *width_;
  }
  bool Exceeds(double low) const { return tolerance_ && low > *tolerance_; }
  const std::optional<double>& tolerance() const { return tolerance_; }
  const std::optional<double>& width() const { return width_; }
  const std::optional<double>& reach() const { return reach_; }

  // The largest distance is at least this.
  double lowest() const { return lowest_.load(std::memory_order_relaxed); }
  // The point has a distance of at least `low`.
  void Raise(double low, Vec3d point) {
    if (low <= lowest()) return;
    const MutexLock lock(mutex_);
    if (low <= lowest()) return;
    lowest_.store(low, std::memory_order_relaxed);
    point_ = point;
  }
  // Where it was found. For one thread.
  const std::optional<Vec3d>& point() const { return point_; }

 private:
  const std::optional<double> tolerance_, width_, reach_;
  Mutex mutex_;
  std::atomic<double> lowest_{0};
  std::optional<Vec3d> point_;
};

}  // namespace mtdb::internal
