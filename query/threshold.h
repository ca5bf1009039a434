// Threshold: how accurate a query wants the surface to be, place by place. Small immutable
// objects, shared and composed freely.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "query/camera.h"
#include "query/region.h"
#include "store/base/geometry.h"

namespace mtdb {

// All numbers from `low` to `high`; by default nothing is known of one.
struct ErrorRange {
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
};

// A field of largest permitted errors over space, both in model units. Negative: only the full
// resolution will do. Immutable; safe for many threads.
//
// Contract of an implementation: Min does not grow as `distance` grows, and is never above the
// field, so that no triangle passes for valid that is not.
class Threshold {
 public:
  virtual ~Threshold() = default;
  // A lower bound of the field over all points within `distance` (>= 0) of the triangle; their
  // smallest value, up to rounding, where a kind of threshold does not say otherwise. The same
  // arguments always give the same answer.
  virtual double Min(const Triangle3d& t, double distance) const = 0;
  // Where Min(t, d) lies for all triangles t inside the box and all d from 0 to `distance`.
  virtual ErrorRange Range(const Box3d& box, double distance) const;
  // Where to.Min(t, d) - Min(t, d) lies for all these t and d; two infinite values of one sign
  // differ by 0. For those who follow a field that moves, as a camera's does. Known for constants,
  // fields of a distance and of the screen when only the place moves, and what consists of them.
  virtual ErrorRange Change(const Threshold& to, const Box3d& box, double distance) const;
  // The field's value when it is the same everywhere, so that the geometry need not be looked at.
  virtual std::optional<double> constant() const { return std::nullopt; }
  // True when no error is permitted anywhere, not even 0.
  bool full_resolution() const {
    const std::optional<double> value = constant();
    return value.has_value() && *value < 0;
  }
};

using ThresholdPtr = std::shared_ptr<const Threshold>;

// Numbers given to the functions below must be finite.

// The same error everywhere.
ThresholdPtr ConstantThreshold(double error_model);
// Only triangles of the input are good enough. A null ThresholdPtr in a Query means the same.
ThresholdPtr FullResolution();
// Any error is permitted: the root mesh.
ThresholdPtr CoarsestThreshold();

// With r the distance from `point`; factors may be negative.
// base + slope * r.
ThresholdPtr LinearThreshold(Vec3d point, double base, double slope);
// base + factor * r^2.
ThresholdPtr QuadraticThreshold(Vec3d point, double base, double factor);
// base + factor * sqrt(r).
ThresholdPtr SquareRootThreshold(Vec3d point, double base, double factor);
// base * exp(rate * r).
ThresholdPtr ExponentialThreshold(Vec3d point, double base, double rate);

// What the camera sees is off by at most `pixels` (> 0) pixels. In full: where a triangle with
// bound e satisfies this threshold, any two points in sight that are at most e apart, one of them
// on the triangle, are drawn at most `pixels` apart. So is every point in sight of the surface from
// its counterpart.
//
// A step of length s from a point at depth z and at distance r from the eye moves its image by at
// most s * r / z^2 / camera.pixel(). So the field is pixels * camera.pixel() * z^2 / r, with z at
// least `near`; beyond the sides of the picture it goes on with the z / r of its corners, and it is
// infinite where z < near. The `far` does not matter. Min takes z from the nearest corner of the
// triangle and r from the one farthest from the axis of view.
ThresholdPtr ScreenThreshold(const Camera& camera, double pixels);

// `inside` in the region, `outside` elsewhere. Min is as exact as the region's answers; on its
// border it is the smaller of both thresholds' Min.
ThresholdPtr RegionThreshold(RegionPtr region, ThresholdPtr inside, ThresholdPtr outside);

// One error for each cell of a regular grid, which is the field's value in all of the (closed)
// cell; on a face between cells the smaller one. Cells at the border of the grid go on to infinity.
struct GridField {
  Vec3d origin;                      // the smallest corner
  Vec3d cell_size;                   // above 0
  std::array<uint32_t, 3> counts{};  // cells along x, y, z; each at least 1
  std::vector<double> errors;        // x changes fastest, then y; not NaN
};
// Memory: about 8/7 of the field's. Cost: about logarithmic in the number of cells that are near
// the triangle.
ThresholdPtr GridThreshold(GridField field);

// Any other field, told by a function that takes a box and returns a lower bound of the field over
// it. It must never be larger for a box that contains another than for that other, and be safe for
// many threads. Min passes the smallest box around the triangle, grown by `distance` on all sides.
ThresholdPtr FunctionThreshold(std::function<double(const Box3d&)> min_over_box);

// The smallest of `thresholds`, place by place; without any, infinite.
ThresholdPtr MinThreshold(std::vector<ThresholdPtr> thresholds);
// The largest of `thresholds`, place by place. Min is the largest of theirs, and so lower where
// the largest is not the same one all around.
ThresholdPtr MaxThreshold(std::vector<ThresholdPtr> thresholds);

}  // namespace mtdb
