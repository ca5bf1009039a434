// SPDX-License-Identifier: Apache-2.0
#include "query/threshold.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "query/fields/rounding.h"
#include "query/fields/work_meter.h"
#include "store/base/check.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// For sums of a few numbers of these sizes.
double Slack(double a, double b) {
  const double size = std::max(std::abs(a), std::abs(b));
  return std::isfinite(size) ? kBoxRounding * size : 0;
}
ErrorRange Widened(ErrorRange range, double slack) {
  return {range.low - slack, range.high + slack};
}
ErrorRange Hull(ErrorRange a, ErrorRange b) {
  return {std::min(a.low, b.low), std::max(a.high, b.high)};
}
FieldChange Either(const FieldChange& a, const FieldChange& b) {
  return {Hull(a, b), std::max(a.shift, b.shift)};
}
double Difference(double to, double from) { return to == from ? 0 : to - from; }

class Constant final : public Threshold {
 public:
  explicit Constant(double value) : value_(value) {}
  double Min(const Triangle3d&, double) const override { return value_; }
  std::optional<double> constant() const override { return value_; }
  ErrorRange Range(const Box3d&, double) const override { return {value_, value_}; }
  FieldChange Change(const Threshold& to, const Box3d&, double) const override {
    const std::optional<double> value = to.constant();
    if (!value) return {};
    const double change = Difference(*value, value_);
    return {Widened({change, change}, change == 0 ? 0 : Slack(*value, value_))};
  }

 private:
  double value_;
};

// The distances of the box's points from `p`.
ErrorRange Distances(const Box3d& box, Vec3d p) {
  double far2 = 0;
  for (int i = 0; i < 3; ++i) {
    const double far = std::max(std::abs(box.min[i] - p[i]), std::abs(box.max[i] - p[i]));
    far2 += far * far;
  }
  return {std::sqrt(SquaredDistancePointBox(p, box)), std::sqrt(far2)};
}

// How the distance from a point that moves from a to b changes, for the points q of the box:
// |q - b| - |q - a| = (a - b) (2q - a - b) / (|q - a| + |q - b|), whose numerator is linear in q.
ErrorRange DistanceChange(const Box3d& box, Vec3d a, Vec3d b) {
  if (a == b) return {0, 0};
  const ErrorRange from = Distances(box, a);
  const ErrorRange to = Distances(box, b);
  const double length = Length(b - a);
  ErrorRange top{0, 0};
  for (int i = 0; i < 3; ++i) {
    const double step = a[i] - b[i];
    const double at_min = step * (2 * box.min[i] - a[i] - b[i]);
    const double at_max = step * (2 * box.max[i] - a[i] - b[i]);
    top.low += std::min(at_min, at_max);
    top.high += std::max(at_min, at_max);
  }
  const double least = from.low + to.low;
  const double most = from.high + to.high;
  const double low = top.low < 0 ? (least > 0 ? top.low / least : -length) : top.low / most;
  const double high = top.high > 0 ? (least > 0 ? top.high / least : length) : top.high / most;
  const double slack = Rounding(box, length, std::max(LargestCoordinate(a), LargestCoordinate(b)));
  return Widened({std::max(low, -length), std::min(high, length)}, 4 * slack);
}

// base + factor * Shape::Of(r), with r the distance from a point: monotone in r. Shapes are convex
// or concave, and grow.
template <typename Shape>
class OfDistance final : public Threshold {
 public:
  OfDistance(Vec3d point, double base, double factor, Shape shape)
      : point_(point), base_(base), factor_(factor), grows_(factor >= 0), shape_(shape) {}

  // A growing field is smallest at the nearest point, a falling one at the farthest: the farthest
  // point of a triangle is a corner.
  double Min(const Triangle3d& t, double distance) const override {
    double d2 = 0;
    if (grows_) {
      d2 = SquaredDistancePointTriangle(point_, t[0], t[1], t[2]);
      return At(std::max(0.0, std::sqrt(d2) - distance));
    }
    for (const Vec3d& p : t) d2 = std::max(d2, SquaredLength(p - point_));
    return At(std::sqrt(d2) + distance);
  }

  ErrorRange Range(const Box3d& box, double distance) const override {
    const ErrorRange r = Reach(box, distance);
    const double a = At(r.low);
    const double b = At(r.high);
    return Known(Widened({std::min(a, b), std::max(a, b)}, Slack(a, b)));
  }

  // In two steps: the distance changes, then the function. What either does to the value is largest
  // and smallest at an end of the range of distances, or where the distance becomes 0.
  FieldChange Change(const Threshold& to, const Box3d& box, double distance) const override {
    const auto* const other = dynamic_cast<const OfDistance*>(&to);
    if (other == nullptr || other->grows_ != grows_ || !(other->shape_ == shape_)) return {};
    const bool same = base_ == other->base_ && factor_ == other->factor_;
    if (same && point_ == other->point_) return {{0, 0}};
    const ErrorRange from = Reach(box, distance);
    const ErrorRange into = other->Reach(box, distance);
    ErrorRange moved = DistanceChange(box, point_, other->point_);
    // Where the neighbourhood of a triangle can hold the point, the distance from it stays 0.
    if (grows_ && (from.low <= 0 || into.low <= 0)) moved = Hull(moved, {0, 0});
    ErrorRange change{kInfinity, -kInfinity};
    double size = 0;
    for (const double step : {moved.low, moved.high}) {
      for (const double r : {from.low, from.high, std::clamp(-step, from.low, from.high)}) {
        const double value = other->At(r);
        const double next = other->At(std::max(0.0, r + step));
        change = Hull(change, {next - value, next - value});
        size = std::max({size, std::abs(value), std::abs(next)});
      }
    }
    if (!same) {
      const double a = other->At(from.low) - At(from.low);
      const double b = other->At(from.high) - At(from.high);
      size = std::max({size, std::abs(At(from.low)), std::abs(At(from.high))});
      change.low += std::min(a, b);
      change.high += std::max(a, b);
    }
    // Between two infinite values nothing is known of what lies nearer.
    if (!std::isfinite(size)) return {};
    return {Known(Widened(change, 4 * Slack(size, size)))};
  }

 private:
  double At(double r) const { return shape_.Value(base_, factor_, r); }
  // The distances at which Min may take the function.
  ErrorRange Reach(const Box3d& box, double distance) const {
    const ErrorRange r = Distances(box, point_);
    const double slack = Rounding(box, distance, LargestCoordinate(point_));
    if (grows_) return {std::max(0.0, r.low - distance - slack), r.high + slack};
    return {std::max(0.0, r.low - slack), r.high + distance + slack};
  }
  static ErrorRange Known(ErrorRange range) {
    return std::isfinite(range.low) && std::isfinite(range.high) ? range : ErrorRange{};
  }

  Vec3d point_;
  double base_;
  double factor_;
  bool grows_;
  Shape shape_;
};

struct Line {
  static double Value(double base, double factor, double r) { return base + factor * r; }
  friend bool operator==(Line, Line) = default;
};
struct Square {
  static double Value(double base, double factor, double r) { return base + factor * r * r; }
  friend bool operator==(Square, Square) = default;
};
struct Root {
  static double Value(double base, double factor, double r) { return base + factor * std::sqrt(r); }
  friend bool operator==(Root, Root) = default;
};
// The factor only says whether the field grows.
struct Exponential {
  double start;
  double rate;
  double Value(double, double, double r) const {
    return start == 0 ? 0.0 : start * std::exp(rate * r);
  }
  friend bool operator==(Exponential, Exponential) = default;
};

template <typename Shape>
ThresholdPtr MakeOfDistance(Vec3d point, double base, double factor, Shape shape) {
  return std::make_shared<OfDistance<Shape>>(point, base, factor, shape);
}

class Screen final : public Threshold {
 public:
  Screen(const Camera& camera, double pixels)
      : eye_(camera.eye),
        forward_(camera.axes().forward),
        near_(camera.near),
        corner_(std::hypot(camera.tangent_x(), camera.tangent_y())),
        pixel_(camera.pixel()),
        pixels_(pixels) {}

  double Min(const Triangle3d& t, double distance) const override {
    double low = kInfinity;
    double high = -kInfinity;
    double aside2 = 0;  // squared distance from the axis of view
    for (const Vec3d& p : t) {
      const Vec3d from_eye = p - eye_;
      const double depth = Dot(from_eye, forward_);
      low = std::min(low, depth);
      high = std::max(high, depth);
      aside2 = std::max(aside2, SquaredLength(from_eye - forward_ * depth));
    }
    if (high + distance < near_) return kInfinity;
    return At(low - distance, std::sqrt(aside2) + distance);
  }

  ErrorRange Range(const Box3d& box, double distance) const override {
    const Vec3d half = (box.max - box.min) * 0.5;
    const Vec3d centre = box.min + half - eye_;
    const double slack = 4 * Rounding(box, distance, LargestCoordinate(eye_));
    const double depth = Dot(centre, forward_);
    const double deep = std::abs(half.x * forward_.x) + std::abs(half.y * forward_.y) +
                        std::abs(half.z * forward_.z) + slack;
    if (depth + deep + distance < near_) return {kInfinity, kInfinity};
    const Vec3d from_axis = centre - forward_ * depth;
    const double aside = std::sqrt(SquaredLength(from_axis));
    const double wide = std::sqrt(SquaredLength(half)) + slack;
    const double low =
        About(depth - deep - distance, FarthestCorner(half, from_axis) + slack + distance);
    const double high = About(depth + deep, std::max(0.0, aside - wide));
    const ErrorRange of_one =
        Widened({low, depth - deep >= near_ ? high : kInfinity}, Slack(low, high));
    return {pixels_ * of_one.low, pixels_ * of_one.high};
  }

  // The field's slope along the axis of view is from 0 to kDepthSlope, and at least `least` in
  // sight; away from the axis it is from -kAsideSlope to 0.
  FieldChange Change(const Threshold& to, const Box3d& box, double distance) const override {
    const auto* const other = dynamic_cast<const Screen*>(&to);
    if (other == nullptr || other->near_ != near_ || other->corner_ != corner_) return {};
    const bool same = other->factor() == factor();
    if (same && other->eye_ == eye_ && other->forward_ == forward_) return {{0, 0}};
    const Place a = PlaceOf(box);
    const Place b = other->PlaceOf(box);
    const double slack =
        8 *
        Rounding(box, distance, std::max(LargestCoordinate(eye_), LargestCoordinate(other->eye_)));
    if (std::max(a.high, b.high) + distance + slack < near_) return {{0, 0}};
    if (std::min(a.low, b.low) - slack < near_) return {};
    ErrorRange depth{kInfinity, -kInfinity};
    ErrorRange aside{0, 0};
    for (int i = 0; i < 8; ++i) {
      const Vec3d p = Corner(box, i) - eye_;
      const Vec3d q = Corner(box, i) - other->eye_;
      const double from = Dot(p, forward_);
      const double into = Dot(q, other->forward_);
      depth = Hull(depth, {into - from, into - from});
      // A length of what is linear in the point: largest at a corner.
      const double step = Length((q - other->forward_ * into) - (p - forward_ * from));
      aside.high = std::max(aside.high, step);
    }
    aside.low = -aside.high;
    depth = Widened(depth, slack);
    aside = Widened(aside, slack);
    // Within `distance` of the near plane the depth stays there.
    if (std::min(a.low, b.low) - distance - slack <= near_) depth = Hull(depth, {0, 0});
    const double least = 1 / std::hypot(1.0, corner_);
    const auto product = [&](double step, double small, double large) {
      return step * (step > 0 ? large : small);
    };
    ErrorRange change{depth.low < 0 ? depth.low * kDepthSlope : depth.low * least,
                      product(depth.high, least, kDepthSlope)};
    change.low = change.low * other->factor() - kAsideSlope * aside.high * other->factor();
    change.high = change.high * other->factor() - kAsideSlope * aside.low * other->factor();
    const double most = std::max(a.high, b.high) * std::max(factor(), other->factor());
    if (!same) {
      const double grown = (other->factor() - factor()) * (a.high + slack);
      change.low += std::min(0.0, grown);
      change.high += std::max(0.0, grown);
    }
    return {Widened(change, 8 * Slack(most, most))};
  }

  ThresholdPtr AtPixels(double pixels) const override {
    auto at = std::make_shared<Screen>(*this);
    at->pixels_ = pixels;
    return at;
  }
  std::optional<double> pixels() const override { return pixels_; }

 private:
  // Bounds of sqrt(1 + u^2)^-3 (1 + 2 u^2) and of sqrt(1 + u^2)^-3 u, with u the tangent of the
  // angle with the axis.
  static constexpr double kDepthSlope = 1.0887;
  static constexpr double kAsideSlope = 0.38491;

  struct Place {
    double low, high;  // depths
    double aside;      // the largest distance from the axis
  };
  Place PlaceOf(const Box3d& box) const {
    Place place{kInfinity, -kInfinity, 0};
    for (int i = 0; i < 8; ++i) {
      const Vec3d p = Corner(box, i) - eye_;
      const double depth = Dot(p, forward_);
      place.low = std::min(place.low, depth);
      place.high = std::max(place.high, depth);
      place.aside = std::max(place.aside, SquaredLength(p - forward_ * depth));
    }
    place.aside = std::sqrt(place.aside);
    return place;
  }
  // The distance from the axis of the corner that is farthest from it, of a box whose centre is
  // `from_axis` away. Not below that of a box inside.
  double FarthestCorner(Vec3d half, Vec3d from_axis) const {
    double most = 0;
    for (int i = 0; i < 4; ++i) {  // and the corner opposite
      const Vec3d to{half.x, (i & 1) != 0 ? -half.y : half.y, (i & 2) != 0 ? -half.z : half.z};
      const Vec3d aside = to - forward_ * Dot(to, forward_);
      most = std::max(most, SquaredLength(aside) + 2 * std::abs(Dot(aside, from_axis)));
    }
    return std::sqrt(SquaredLength(from_axis) + most);
  }
  double factor() const { return pixels_ * pixel_; }
  // z^2 / r grows with z and falls with the distance from the axis, which in sight is at most z
  // times the tangent to the picture's corner.
  double At(double depth, double from_axis) const {
    const double z = std::max({depth, near_, 0.0});
    const double aside = std::min(from_axis, z * corner_);
    const double squares = z * z + aside * aside;
    const bool usual = squares > 1e-280 && squares < 1e280;
    const double r = usual ? std::sqrt(squares) : std::hypot(z, aside);
    return z > 0 ? pixels_ * (pixel_ * z * (z / r)) : 0;
  }

  // Likewise for one pixel, up to rounding, and faster.
  double About(double depth, double from_axis) const {
    const double z = std::max({depth, near_, 0.0});
    const double aside = std::min(from_axis, z * corner_);
    return z > 0 ? pixel_ * z * (z / std::sqrt(z * z + aside * aside)) : 0;
  }

  Vec3d eye_;
  Vec3d forward_;
  double near_;
  double corner_;  // tangent of the angle between the axis of view and the picture's corner
  double pixel_;   // at depth 1
  double pixels_;
};

// Of what is made of several.
ThresholdPtr SmallestAtPixels(std::span<const ThresholdPtr> parts, double pixels) {
  std::vector<ThresholdPtr> cameras;
  for (const ThresholdPtr& part : parts) {
    if (ThresholdPtr at = part->AtPixels(pixels); at != nullptr) cameras.push_back(std::move(at));
  }
  if (cameras.size() <= 1) return cameras.empty() ? nullptr : cameras[0];
  return MinThreshold(std::move(cameras));
}

class ByRegion final : public Threshold {
 public:
  ByRegion(RegionPtr region, ThresholdPtr inside, ThresholdPtr outside)
      : region_(std::move(region)), inside_(std::move(inside)), outside_(std::move(outside)) {}

  double Min(const Triangle3d& t, double distance) const override {
    if (!region_->Within(t, distance)) return outside_->Min(t, distance);
    const double inside = inside_->Min(t, distance);
    if (region_->Covers(t, distance)) return inside;
    return std::min(inside, outside_->Min(t, distance));
  }
  ErrorRange Range(const Box3d& box, double distance) const override {
    if (!region_->BoxWithin(box, distance)) return outside_->Range(box, distance);
    const ErrorRange inside = inside_->Range(box, distance);
    if (region_->BoxCovers(box, distance)) return inside;
    return Hull(inside, outside_->Range(box, distance));
  }
  FieldChange Change(const Threshold& to, const Box3d& box, double distance) const override {
    const auto* const other = dynamic_cast<const ByRegion*>(&to);
    if (other == nullptr) return {};
    const auto inside = [&] { return inside_->Change(*other->inside_, box, distance); };
    const auto outside = [&] { return outside_->Change(*other->outside_, box, distance); };
    const double from = region_->Depth(box);
    const double into = other->region_->Depth(box);
    const double shift = region_->Shift(*other->region_, box);
    const bool stays_in = std::min(from, into) > distance;
    const bool stays_out = std::max(from, into) < -distance;
    // Unless a border was near before and after, what goes over to the other part does so at once.
    if (!stays_in && !stays_out && (shift == kInfinity || from * into < 0)) return {};
    FieldChange change = stays_in ? inside() : stays_out ? outside() : Either(inside(), outside());
    change.shift = std::max(change.shift, shift);
    return change;
  }
  double Margin(const Box3d& box, double distance) const override {
    const double depth = region_->Depth(box);
    if (std::abs(depth) <= distance) return 0;
    const ThresholdPtr& part = depth > 0 ? inside_ : outside_;
    return std::min(std::abs(depth) - distance, part->Margin(box, distance));
  }
  ThresholdPtr AtPixels(double pixels) const override {
    return SmallestAtPixels(std::array{inside_, outside_}, pixels);
  }

 private:
  RegionPtr region_;
  ThresholdPtr inside_;
  ThresholdPtr outside_;
};

class Function final : public Threshold {
 public:
  explicit Function(std::function<double(const Box3d&)> min_over_box)
      : min_over_box_(std::move(min_over_box)) {}

  double Min(const Triangle3d& t, double distance) const override {
    Box3d box = Around(t);
    for (int i = 0; i < 3; ++i) {
      box.min[i] -= distance;
      box.max[i] += distance;
    }
    return min_over_box_(box);
  }

 private:
  std::function<double(const Box3d&)> min_over_box_;
};

// The smallest or the largest of several.
template <typename Choose>
class Chosen final : public Threshold {
 public:
  Chosen(std::vector<ThresholdPtr> thresholds, double none, Choose choose)
      : thresholds_(std::move(thresholds)), none_(none), choose_(choose) {}

  double Min(const Triangle3d& t, double distance) const override {
    double value = none_;
    for (const ThresholdPtr& p : thresholds_) {
      if (!SpendSteps(1)) break;
      value = choose_(value, p->Min(t, distance));
    }
    return value;
  }
  ErrorRange Range(const Box3d& box, double distance) const override {
    ErrorRange range{none_, none_};
    for (const ThresholdPtr& p : thresholds_) {
      if (!SpendSteps(1)) break;
      const ErrorRange one = p->Range(box, distance);
      range = {choose_(range.low, one.low), choose_(range.high, one.high)};
    }
    return range;
  }
  FieldChange Change(const Threshold& to, const Box3d& box, double distance) const override {
    const auto* const other = dynamic_cast<const Chosen*>(&to);
    if (other == nullptr || other->thresholds_.size() != thresholds_.size()) return {};
    FieldChange change{{0, 0}};
    for (size_t i = 0; i < thresholds_.size(); ++i) {
      if (!SpendSteps(1)) break;
      const FieldChange one = thresholds_[i]->Change(*other->thresholds_[i], box, distance);
      change = i == 0 ? one : Either(change, one);
    }
    return change;
  }
  double Margin(const Box3d& box, double distance) const override {
    double margin = kInfinity;
    for (const ThresholdPtr& p : thresholds_) {
      if (!SpendSteps(1)) return 0;
      margin = std::min(margin, p->Margin(box, distance));
    }
    return margin;
  }
  ThresholdPtr AtPixels(double pixels) const override {
    return SmallestAtPixels(thresholds_, pixels);
  }
  std::optional<double> constant() const override {
    double value = none_;
    for (const ThresholdPtr& p : thresholds_) {
      const std::optional<double> one = p->constant();
      if (!one) return std::nullopt;
      value = choose_(value, *one);
    }
    return value;
  }

 private:
  std::vector<ThresholdPtr> thresholds_;
  double none_;
  Choose choose_;
};

template <typename Choose>
ThresholdPtr MakeChosen(std::vector<ThresholdPtr> thresholds, double none, Choose choose) {
  return std::make_shared<Chosen<Choose>>(std::move(thresholds), none, choose);
}

}  // namespace

ErrorRange Threshold::Range(const Box3d&, double) const { return {}; }

FieldChange Threshold::Change(const Threshold& to, const Box3d&, double) const {
  return this == &to ? FieldChange{{0, 0}} : FieldChange{};
}

double Threshold::Margin(const Box3d&, double) const { return kInfinity; }

ThresholdPtr ConstantThreshold(double error_model) {
  return std::make_shared<Constant>(error_model);
}

ThresholdPtr FullResolution() {
  static const ThresholdPtr kFull = std::make_shared<Constant>(-1.0);
  return kFull;
}

ThresholdPtr CoarsestThreshold() {
  static const ThresholdPtr kCoarsest = std::make_shared<Constant>(kInfinity);
  return kCoarsest;
}

ThresholdPtr LinearThreshold(Vec3d point, double base, double slope) {
  return MakeOfDistance(point, base, slope, Line{});
}

ThresholdPtr QuadraticThreshold(Vec3d point, double base, double factor) {
  return MakeOfDistance(point, base, factor, Square{});
}

ThresholdPtr SquareRootThreshold(Vec3d point, double base, double factor) {
  return MakeOfDistance(point, base, factor, Root{});
}

ThresholdPtr ExponentialThreshold(Vec3d point, double base, double rate) {
  return MakeOfDistance(point, 0, base * rate, Exponential{base, rate});
}

ThresholdPtr ScreenThreshold(const Camera& camera, double pixels) {
  const Status status = camera.Validate();
  MTDB_CHECK(status.ok(), status.message().c_str());
  MTDB_CHECK(pixels > 0, "the permitted error must be above 0 pixels");
  return std::make_shared<Screen>(camera, pixels);
}

ThresholdPtr RegionThreshold(RegionPtr region, ThresholdPtr inside, ThresholdPtr outside) {
  MTDB_CHECK(region != nullptr && inside != nullptr && outside != nullptr,
             "a threshold by region needs the region and both thresholds");
  return std::make_shared<ByRegion>(std::move(region), std::move(inside), std::move(outside));
}

ThresholdPtr FunctionThreshold(std::function<double(const Box3d&)> min_over_box) {
  MTDB_CHECK(min_over_box != nullptr, "a threshold needs its function");
  return std::make_shared<Function>(std::move(min_over_box));
}

ThresholdPtr MinThreshold(std::vector<ThresholdPtr> thresholds) {
  return MakeChosen(std::move(thresholds), kInfinity,
                    [](double a, double b) { return std::min(a, b); });
}

ThresholdPtr MaxThreshold(std::vector<ThresholdPtr> thresholds) {
  return MakeChosen(std::move(thresholds), -kInfinity,
                    [](double a, double b) { return std::max(a, b); });
}

}  // namespace mtdb
