// SPDX-License-Identifier: Apache-2.0
// Regions and thresholds in coordinates that are scaled.
#include <utility>

#include "query/region.h"
#include "query/threshold.h"

namespace mtdb {
namespace {

Triangle3d ScaledCorners(const Triangle3d& t, Vec3d scale) {
  return {Scaled(t[0], scale), Scaled(t[1], scale), Scaled(t[2], scale)};
}

Box3d ScaledBox(const Box3d& box, Vec3d scale) {
  if (box.empty()) return box;
  return {Scaled(box.min, scale), Scaled(box.max, scale)};
}

// Rounding keeps the order of coordinates, so that what touches a place still does.
class RegionOfScaled final : public Region {
 public:
  RegionOfScaled(RegionPtr region, Vec3d scale) : region_(std::move(region)), scale_(scale) {}
  bool Within(const Triangle3d& t, double distance) const override {
    return region_->Within(ScaledCorners(t, scale_), distance);
  }
  bool Covers(const Triangle3d& t, double distance) const override {
    return region_->Covers(ScaledCorners(t, scale_), distance);
  }
  bool BoxWithin(const Box3d& box, double distance) const override {
    return region_->BoxWithin(ScaledBox(box, scale_), distance);
  }
  bool BoxCovers(const Box3d& box, double distance) const override {
    return region_->BoxCovers(ScaledBox(box, scale_), distance);
  }
  bool whole() const override { return region_->whole(); }
  double Depth(const Box3d& box) const override { return region_->Depth(ScaledBox(box, scale_)); }
  double Shift(const Region& to, const Box3d& within) const override {
    const auto* const other = dynamic_cast<const RegionOfScaled*>(&to);
    if (other == nullptr || other->scale_ != scale_) return Region::Shift(to, within);
    return region_->Shift(*other->region_, ScaledBox(within, scale_));
  }

 private:
  const RegionPtr region_;
  const Vec3d scale_;
};

class ThresholdOfScaled final : public Threshold {
 public:
  ThresholdOfScaled(ThresholdPtr threshold, Vec3d scale)
      : threshold_(std::move(threshold)), scale_(scale) {}
  double Min(const Triangle3d& t, double distance) const override {
    return threshold_->Min(ScaledCorners(t, scale_), distance);
  }
  ErrorRange Range(const Box3d& box, double distance) const override {
    return threshold_->Range(ScaledBox(box, scale_), distance);
  }
  FieldChange Change(const Threshold& to, const Box3d& box, double distance) const override {
    const auto* const other = dynamic_cast<const ThresholdOfScaled*>(&to);
    if (other == nullptr || other->scale_ != scale_) return Threshold::Change(to, box, distance);
    return threshold_->Change(*other->threshold_, ScaledBox(box, scale_), distance);
  }
  double Margin(const Box3d& box, double distance) const override {
    return threshold_->Margin(ScaledBox(box, scale_), distance);
  }
  std::optional<double> constant() const override { return threshold_->constant(); }
  ThresholdPtr AtPixels(double pixels) const override {
    return ScaledThreshold(threshold_->AtPixels(pixels), scale_);
  }
  std::optional<double> pixels() const override { return threshold_->pixels(); }

 private:
  const ThresholdPtr threshold_;
  const Vec3d scale_;
};

constexpr Vec3d kNoScale{1, 1, 1};

}  // namespace

RegionPtr ScaledRegion(RegionPtr region, Vec3d scale) {
  if (region == nullptr || region->whole() || scale == kNoScale) return region;
  return std::make_shared<RegionOfScaled>(std::move(region), scale);
}

ThresholdPtr ScaledThreshold(ThresholdPtr threshold, Vec3d scale) {
  if (threshold == nullptr || threshold->constant() || scale == kNoScale) return threshold;
  return std::make_shared<ThresholdOfScaled>(std::move(threshold), scale);
}

}  // namespace mtdb
