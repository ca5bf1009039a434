#include "query/threshold.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace mtdb {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

class Constant final : public Threshold {
 public:
  explicit Constant(double value) : value_(value) {}
  double Min(const Triangle3d&, double) const override { return value_; }
  double MinOverBox(const Box3d&, double) const override { return value_; }
  std::optional<double> constant() const override { return value_; }

 private:
  double value_;
};

class Linear final : public Threshold {
 public:
  Linear(Vec3d point, double base, double slope) : point_(point), base_(base), slope_(slope) {}

  // A growing field is smallest at the nearest point, a falling one at the farthest: the farthest
  // point of a triangle is a corner.
  double Min(const Triangle3d& t, double distance) const override {
    double d2 = 0;
    if (slope_ >= 0) {
      d2 = SquaredDistancePointTriangle(point_, t[0], t[1], t[2]);
    } else {
      for (const Vec3d& p : t) d2 = std::max(d2, SquaredLength(p - point_));
    }
    return At(std::sqrt(d2), distance);
  }

  double MinOverBox(const Box3d& box, double distance) const override {
    double d2 = 0;
    if (slope_ >= 0) {
      d2 = SquaredDistancePointBox(point_, box) * (1 - 1e-12);
    } else {
      for (int i = 0; i < 3; ++i) {
        const double d =
            std::max(std::abs(box.min[i] - point_[i]), std::abs(box.max[i] - point_[i]));
        d2 += d * d;
      }
      d2 *= 1 + 1e-12;
    }
    return At(std::sqrt(d2), distance);
  }

 private:
  double At(double d, double distance) const {
    return base_ + slope_ * (slope_ >= 0 ? std::max(0.0, d - distance) : d + distance);
  }
  Vec3d point_;
  double base_;
  double slope_;
};

class Smallest final : public Threshold {
 public:
  explicit Smallest(std::vector<ThresholdPtr> thresholds) : thresholds_(std::move(thresholds)) {}

  double Min(const Triangle3d& t, double distance) const override {
    double value = kInfinity;
    for (const ThresholdPtr& p : thresholds_) value = std::min(value, p->Min(t, distance));
    return value;
  }
  double MinOverBox(const Box3d& box, double distance) const override {
    double value = kInfinity;
    for (const ThresholdPtr& p : thresholds_) value = std::min(value, p->MinOverBox(box, distance));
    return value;
  }
  std::optional<double> constant() const override {
    double value = kInfinity;
    for (const ThresholdPtr& p : thresholds_) {
      const std::optional<double> one = p->constant();
      if (!one) return std::nullopt;
      value = std::min(value, *one);
    }
    return value;
  }

 private:
  std::vector<ThresholdPtr> thresholds_;
};

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
  return std::make_shared<Linear>(point, base, slope);
}

ThresholdPtr MinThreshold(std::vector<ThresholdPtr> thresholds) {
  return std::make_shared<Smallest>(std::move(thresholds));
}

}  // namespace mtdb
