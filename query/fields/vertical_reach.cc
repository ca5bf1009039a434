// SPDX-License-Identifier: Apache-2.0
#include "query/fields/vertical_reach.h"

#include <algorithm>
#include <utility>

#include "query/fields/rounding.h"

namespace mtdb::internal {
namespace {

// By so much for each unit of distance.
Box3d SweptBy(Box3d box, double distance, std::array<double, 2> aside) {
  const Vec3d by{aside[0] * distance, aside[1] * distance, distance};
  return {box.min - by, box.max + by};
}

class VerticalRegion final : public Region {
 public:
  VerticalRegion(RegionPtr region, std::array<double, 2> aside)
      : region_(std::move(region)), aside_(aside) {}

  bool Within(const Triangle3d& t, double distance) const override {
    return region_->BoxWithin(Swept(Around(t), distance), 0) && region_->Within(t, distance);
  }
  bool Covers(const Triangle3d& t, double distance) const override {
    return region_->Covers(t, distance) || region_->BoxCovers(Swept(Around(t), distance), 0);
  }
  bool BoxWithin(const Box3d& box, double distance) const override {
    if (box.empty()) return region_->BoxWithin(box, distance);
    return region_->BoxWithin(Swept(box, distance), 0) && region_->BoxWithin(box, distance);
  }
  bool BoxCovers(const Box3d& box, double distance) const override {
    if (box.empty()) return region_->BoxCovers(box, distance);
    return region_->BoxCovers(box, distance) || region_->BoxCovers(Swept(box, distance), 0);
  }
  bool whole() const override { return region_->whole(); }
  double Depth(const Box3d& box) const override { return region_->Depth(box); }
  double Shift(const Region& to, const Box3d& within) const override {
    const auto* const other = dynamic_cast<const VerticalRegion*>(&to);
    return other == nullptr ? Region::Shift(to, within) : region_->Shift(*other->region_, within);
  }

 private:
  Box3d Swept(const Box3d& box, double distance) const { return SweptBy(box, distance, aside_); }

  const RegionPtr region_;
  const std::array<double, 2> aside_;
};

class VerticalThreshold final : public Threshold {
 public:
  VerticalThreshold(ThresholdPtr threshold, std::array<double, 2> aside)
      : threshold_(std::move(threshold)), aside_(aside) {}

  double Min(const Triangle3d& t, double distance) const override {
    return std::max(threshold_->Min(t, distance),
                    threshold_->Range(Swept(Around(t), distance), 0).low);
  }
  ErrorRange Range(const Box3d& box, double distance) const override {
    const ErrorRange in_space = threshold_->Range(box, distance);
    const ErrorRange swept = threshold_->Range(AroundSwept(box, distance), 0);
    return {std::max(in_space.low, swept.low), std::max(in_space.high, swept.high)};
  }
  // The larger of two numbers changes by no more than one of them.
  FieldChange Change(const Threshold& to, const Box3d& box, double distance) const override {
    const auto* const other = dynamic_cast<const VerticalThreshold*>(&to);
    if (other == nullptr || other->aside_ != aside_) return Threshold::Change(to, box, distance);
    const FieldChange in_space = threshold_->Change(*other->threshold_, box, distance);
    const FieldChange swept = threshold_->Change(*other->threshold_, AroundSwept(box, distance), 0);
    return {{std::min(in_space.low, swept.low), std::max(in_space.high, swept.high)},
            std::max(in_space.shift, swept.shift)};
  }
  double Margin(const Box3d& box, double distance) const override {
    return std::min(threshold_->Margin(box, distance),
                    threshold_->Margin(AroundSwept(box, distance), 0));
  }
  std::optional<double> constant() const override { return threshold_->constant(); }

 private:
  Box3d Swept(const Box3d& box, double distance) const { return SweptBy(box, distance, aside_); }
  // Larger by what rounding may do, so that it also bounds what is said of boxes inside.
  Box3d AroundSwept(const Box3d& box, double distance) const {
    const Box3d swept = Swept(box, distance);
    const double slack = Rounding(swept, distance, 0);
    const Vec3d by{slack, slack, slack};
    return {swept.min - by, swept.max + by};
  }

  const ThresholdPtr threshold_;
  const std::array<double, 2> aside_;
};

}  // namespace

RegionPtr VerticalReach(RegionPtr region, std::array<double, 2> aside) {
  if (region == nullptr || region->whole()) return region;
  return std::make_shared<VerticalRegion>(std::move(region), aside);
}

ThresholdPtr VerticalReach(ThresholdPtr threshold, std::array<double, 2> aside) {
  if (threshold == nullptr || threshold->constant()) return threshold;
  return std::make_shared<VerticalThreshold>(std::move(threshold), aside);
}

}  // namespace mtdb::internal
