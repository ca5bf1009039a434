// SPDX-License-Identifier: Apache-2.0
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

// The numbers from `low` to `high`. The default is all numbers: nothing is known.
struct ErrorRange {
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
};

// How a field's Min changes, up to rounding. `shift`: where borders of regions move, that is known
// of triangles farther from these than they moved, see Threshold::Margin.
struct FieldChange : ErrorRange {
  double shift = 0;
};

// A field over space: at each point the largest error that is permitted there. Points and errors
// are in model units; a negative error means that only the full resolution will do. Immutable; safe
// for many threads.
//
// Contract of an implementation: Min does not grow as `distance` grows, and is never above the
// field, so that no triangle that is invalid passes for a valid one.
class Threshold {
 public:
  virtual ~Threshold() = default;
  // A lower bound of the field over all points within `distance` (>= 0) of the triangle. It is the
  // smallest value there, up to rounding, unless the comment of a kind of threshold says otherwise.
  // The same arguments always give the same answer.
  virtual double Min(const Triangle3d& t, double distance) const = 0;
  // A range that contains Min(t, d) for all triangles t inside the box and all d from 0 to
  // `distance`. Of a box inside the box `low` is no smaller, up to rounding.
  virtual ErrorRange Range(const Box3d& box, double distance) const;
  // A range that contains to.Min(t, d) - Min(t, d) for the same t and d, where two infinite values
  // of one sign differ by 0; of those t for which Margin(Around(t), d) is at least `shift`. It
  // contains the change of Range(b, d).low likewise, for boxes b inside the box. A
  // session asks for it when the threshold moves, as a camera's does. Known for constants, for
  // functions of a distance whose point moves, for thresholds in pixels whose camera moves or
  // turns, for regions that move (Region::Shift), and for combinations of these. Otherwise it is
  // all numbers.
  virtual FieldChange Change(const Threshold& to, const Box3d& box, double distance) const;
  // How far the borders between parts of the field are from what is within `distance` of the box,
  // at least: 0 when one may be there, infinite without any.
  virtual double Margin(const Box3d& box, double distance) const;
  // The threshold at so many pixels (> 0) of the camera that this one is made of, of several the
  // smallest place by place; null when it is made of none. Its Min and Range are
  // `pixels` times those for 1, without another rounding.
  virtual std::shared_ptr<const Threshold> AtPixels(double) const { return nullptr; }
  // The error in pixels when it is AtPixels of that.
  virtual std::optional<double> pixels() const { return std::nullopt; }
  // The field's value when it is the same everywhere, so that nobody need ask about triangles.
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

// What the camera sees of the surface is drawn at most `pixels` (> 0) pixels from where it belongs.
// In full: let a triangle with bound b satisfy this threshold. Take a point on the triangle and
// another point at most b away, both in sight: they are drawn at most `pixels` apart.
//
// Moving a point at depth z and at distance r from the eye by a length s moves its image by at most
// s * r / z^2 / camera.pixel(). So the field is pixels * camera.pixel() * z^2 / r, with z at least
// `near`. Beyond the sides of the picture it goes on with the z / r of the picture's corners. It is
// infinite where z < near. The camera's `far` does not matter. Min takes z from the nearest corner
// of the triangle, and r from the corner that is farthest from the axis of view.
ThresholdPtr ScreenThreshold(const Camera& camera, double pixels);

// `inside` in the region, `outside` elsewhere. Min is as exact as the region's answers. Where a
// triangle is near the region's border, Min is the smaller of both thresholds' Min.
ThresholdPtr RegionThreshold(RegionPtr region, ThresholdPtr inside, ThresholdPtr outside);

// One error for each cell of a regular grid: the field's value in all of the cell. On a face
// between two cells the smaller error holds. Cells at the border of the grid go on to infinity.
struct GridField {
  Vec3d origin;                      // the smallest corner
  Vec3d cell_size;                   // above 0
  std::array<uint32_t, 3> counts{};  // cells along x, y, z; each at least 1
  std::vector<double> errors;        // x changes fastest, then y; not NaN
};
// Memory: about 8/7 of the field's. Cost: about logarithmic in the number of cells that are near
// the triangle.
ThresholdPtr GridThreshold(GridField field);

// Any other field, given by a function that takes a box and returns a lower bound of the field over
// it. For a box that contains another one the function must not return more than for the other. It
// must be safe for many threads. Min passes the smallest box around the triangle, grown by
// `distance` on all sides.
ThresholdPtr FunctionThreshold(std::function<double(const Box3d&)> min_over_box);

// The smallest of `thresholds`, place by place; without any, infinite.
ThresholdPtr MinThreshold(std::vector<ThresholdPtr> thresholds);
// The largest of `thresholds`, place by place. Min is the largest of their Mins; this is below the
// smallest value around the triangle when not the same threshold is the largest everywhere there.
ThresholdPtr MaxThreshold(std::vector<ThresholdPtr> thresholds);

// At p what `threshold` is at Scaled(p, scale); as ScaledRegion.
ThresholdPtr ScaledThreshold(ThresholdPtr threshold, Vec3d scale);

}  // namespace mtdb
