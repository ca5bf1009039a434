// Threshold: how accurate a query wants the surface to be, place by place. Small immutable
// objects, shared and composed freely.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "store/base/geometry.h"

namespace mtdb {

// A field of largest permitted errors over space, both in model units. Negative: only the full
// resolution will do. Immutable; safe for many threads.
//
// Contract of an implementation: Min and MinOverBox do not grow as `distance` grows, and
// MinOverBox(b, d) <= Min(t, d) for a triangle t inside b.
class Threshold {
 public:
  virtual ~Threshold() = default;
  // A lower bound, exact where it can be, of the field over all points within `distance` (>= 0)
  // of the triangle. The same arguments always give the same answer.
  virtual double Min(const Triangle3d& t, double distance) const = 0;
  // Likewise over all points within `distance` of the box.
  virtual double MinOverBox(const Box3d& box, double distance) const = 0;
  // The field's value when it is the same everywhere, so that the geometry need not be looked at.
  virtual std::optional<double> constant() const { return std::nullopt; }
  // True when no error is permitted anywhere, not even 0.
  bool full_resolution() const {
    const std::optional<double> value = constant();
    return value.has_value() && *value < 0;
  }
};

using ThresholdPtr = std::shared_ptr<const Threshold>;

// The same error everywhere.
ThresholdPtr ConstantThreshold(double error_model);
// Only triangles of the input are good enough. A null ThresholdPtr in a Query means the same.
ThresholdPtr FullResolution();
// Any error is permitted: the root mesh.
ThresholdPtr CoarsestThreshold();
// base + slope * (distance from `point`).
ThresholdPtr LinearThreshold(Vec3d point, double base, double slope);
// The smallest of `thresholds`, place by place.
ThresholdPtr MinThreshold(std::vector<ThresholdPtr> thresholds);

}  // namespace mtdb
