// SPDX-License-Identifier: Apache-2.0
#include "query/internal/vertical_reach.h"

#include <algorithm>
#include <utility>

#include "query/internal/rounding.h"

namespace mtdb::internal {
namespace {

Box3d Swept(Box3d box, double distance) {
  box.min.z -= distance;
  box.max.z += distance;
  return box;
}

class VerticalRegion final : public Region {
 public:
  explicit VerticalRegion(RegionPtr region) : region_(std::move(region)) {}

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

 private:
  const RegionPtr region_;
};

class VerticalThreshold final : public Threshold {
 public:
  explicit VerticalThreshold(ThresholdPtr threshold) : threshold_(std::move(threshold)) {}

  double Min(const Triangle3d& t, double distance) const override {
    return std::max(threshold_->Min(t, distance),
                    threshold_->Range(Swept(Around(t), distance), 0).low);
  }
  ErrorRange Range(const Box3d& box, double distance) const override {
    const ErrorRange in_space = threshold_->Range(box, distance);
    const ErrorRange swept = threshold_->Range(Swept(box, distance), 0);
    return {std::max(in_space.low, swept.low), std::max(in_space.high, swept.high)};
  }
  std::optional<double> constant() const override { return threshold_->constant(); }

 private:
  const ThresholdPtr threshold_;
};

}  // namespace

RegionPtr VerticalReach(RegionPtr region) {
  if (region == nullptr || region->whole()) return region;
  return std::make_shared<VerticalRegion>(std::move(region));
}

ThresholdPtr VerticalReach(ThresholdPtr threshold) {
  if (threshold == nullptr || threshold->constant()) return threshold;
  return std::make_shared<VerticalThreshold>(std::move(threshold));
}

}  // namespace mtdb::internal
