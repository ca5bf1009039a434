#include "query/threshold.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "query/internal/rounding.h"
#include "store/base/check.h"

namespace mtdb {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

class Constant final : public Threshold {
 public:
  explicit Constant(double value) : value_(value) {}
  double Min(const Triangle3d&, double) const override { return value_; }
  std::optional<double> constant() const override { return value_; }

 private:
  double value_;
};

// A monotone function of the distance from a point.
template <typename Function>
class OfDistance final : public Threshold {
 public:
  OfDistance(Vec3d point, bool grows, Function function)
      : point_(point), grows_(grows), function_(function) {}

  // A growing field is smallest at the nearest point, a falling one at the farthest: the farthest
  // point of a triangle is a corner.
  double Min(const Triangle3d& t, double distance) const override {
    double d2 = 0;
    if (grows_) {
      d2 = SquaredDistancePointTriangle(point_, t[0], t[1], t[2]);
      return function_(std::max(0.0, std::sqrt(d2) - distance));
    }
    for (const Vec3d& p : t) d2 = std::max(d2, SquaredLength(p - point_));
    return function_(std::sqrt(d2) + distance);
  }

 private:
  Vec3d point_;
  bool grows_;
  Function function_;
};

template <typename Function>
ThresholdPtr MakeOfDistance(Vec3d point, bool grows, Function function) {
  return std::make_shared<OfDistance<Function>>(point, grows, function);
}

class Screen final : public Threshold {
 public:
  Screen(const Camera& camera, double pixels)
      : eye_(camera.eye),
        forward_(camera.axes().forward),
        near_(camera.near),
        corner_(std::hypot(camera.tangent_x(), camera.tangent_y())),
        factor_(pixels * camera.pixel()) {}

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
    // z^2 / r grows with z and falls with the distance from the axis, which in sight is at most z
    // times the tangent to the picture's corner.
    const double z = std::max({low - distance, near_, 0.0});
    const double aside = std::min(std::sqrt(aside2) + distance, z * corner_);
    return z > 0 ? factor_ * z * (z / std::hypot(z, aside)) : 0;
  }

 private:
  Vec3d eye_;
  Vec3d forward_;
  double near_;
  double corner_;  // tangent of the angle between the axis of view and the picture's corner
  double factor_;
};

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
    for (const ThresholdPtr& p : thresholds_) value = choose_(value, p->Min(t, distance));
    return value;
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
  return MakeOfDistance(point, slope >= 0, [=](double r) { return base + slope * r; });
}

ThresholdPtr QuadraticThreshold(Vec3d point, double base, double factor) {
  return MakeOfDistance(point, factor >= 0, [=](double r) { return base + factor * r * r; });
}

ThresholdPtr SquareRootThreshold(Vec3d point, double base, double factor) {
  return MakeOfDistance(point, factor >= 0, [=](double r) { return base + factor * std::sqrt(r); });
}

ThresholdPtr ExponentialThreshold(Vec3d point, double base, double rate) {
  return MakeOfDistance(point, base * rate >= 0,
                        [=](double r) { return base == 0 ? 0.0 : base * std::exp(rate * r); });
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
