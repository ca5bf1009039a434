// SPDX-License-Identifier: Apache-2.0
#include "query/region.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "query/fields/convex.h"
#include "query/fields/rounding.h"
#include "query/fields/split.h"
#include "query/fields/work_meter.h"
#include "store/base/check.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Of a depth that was computed, or a shift: what rounding may have added or taken.
double Shallower(double depth, double slack) {
  return depth > 0 ? std::max(0.0, depth - slack) : std::min(0.0, depth + slack);
}

class Whole final : public Region {
 public:
  bool Within(const Triangle3d&, double) const override { return true; }
  bool Covers(const Triangle3d&, double) const override { return true; }
  bool BoxWithin(const Box3d&, double) const override { return true; }
  bool BoxCovers(const Box3d&, double) const override { return true; }
  bool whole() const override { return true; }
  double Depth(const Box3d&) const override { return kInfinity; }
};

class AxisBox final : public Region {
 public:
  explicit AxisBox(const Box3d& box) : box_(box) {}

  bool Within(const Triangle3d& t, double distance) const override {
    if (box_.empty()) return false;
    const double limit = distance * distance;
    if (SquaredDistanceBoxBox(Around(t), box_) > limit) return false;
    for (const Vec3d& p : t) {
      if (SquaredDistancePointBox(p, box_) <= limit) return true;
    }
    return SquaredDistanceTriangleBox(t, box_) <= limit;
  }

  bool Covers(const Triangle3d& t, double distance) const override {
    return Surrounds(Around(t), distance);
  }

  bool BoxWithin(const Box3d& box, double distance) const override {
    if (box_.empty() || box.empty()) return false;
    const double limit = distance + Rounding(box, distance, 0);
    return SquaredDistanceBoxBox(box, box_) <= limit * limit;
  }

  bool BoxCovers(const Box3d& box, double distance) const override {
    return !box.empty() && Surrounds(box, distance);
  }

  double Depth(const Box3d& box) const override {
    if (box_.empty() || box.empty()) return Region::Depth(box);
    const double slack = 4 * Rounding(box, 0, Scale());
    if (const double apart2 = SquaredDistanceBoxBox(box, box_); apart2 > 0) {
      return Shallower(-std::sqrt(apart2), slack);
    }
    double depth = kInfinity;
    for (int i = 0; i < 3; ++i) {
      depth = std::min({depth, box.min[i] - box_.min[i], box_.max[i] - box.max[i]});
    }
    return depth > 0 ? Shallower(depth, slack) : 0;
  }

  double Shift(const Region& to, const Box3d& within) const override {
    const auto* const other = dynamic_cast<const AxisBox*>(&to);
    if (other == nullptr || box_.empty() || other->box_.empty()) return Region::Shift(to, within);
    if (other->box_ == box_) return 0;
    const double slack = 8 * Rounding(within, 0, std::max(Scale(), other->Scale()));
    const double reach = DeepestIn(within) + slack;
    const double reach_into = other->DeepestIn(within) + slack;
    Vec3d step;  // of faces that are not too far away to matter
    for (int i = 0; i < 3; ++i) {
      if (!(box_.max[i] - within.max[i] > reach && other->box_.max[i] - within.max[i] > reach_into))
        step[i] = std::abs(other->box_.max[i] - box_.max[i]);
      if (!(within.min[i] - box_.min[i] > reach && within.min[i] - other->box_.min[i] > reach_into))
        step[i] = std::max(step[i], std::abs(other->box_.min[i] - box_.min[i]));
    }
    const double moved = Length(step);
    return moved > 0 ? moved + slack : 0;
  }

  const Box3d& box() const { return box_; }

 private:
  // No box inside `within` is deeper in this one, or 0.
  double DeepestIn(const Box3d& within) const {
    double deepest = kInfinity;
    for (int i = 0; i < 3; ++i) {
      deepest = std::min({deepest, box_.max[i] - within.min[i], within.max[i] - box_.min[i]});
    }
    return std::max(0.0, deepest);
  }
  bool Surrounds(const Box3d& box, double distance) const {
    for (int i = 0; i < 3; ++i) {
      if (!(box.min[i] - distance > box_.min[i] && box.max[i] + distance < box_.max[i])) {
        return false;
      }
    }
    return true;
  }
  double Scale() const {
    return std::max(LargestCoordinate(box_.min), LargestCoordinate(box_.max));
  }
  Box3d box_;
};

class Ball final : public Region {
 public:
  Ball(Vec3d centre, double radius) : centre_(centre), radius_(radius) {}

  bool Within(const Triangle3d& t, double distance) const override {
    const double limit = radius_ + distance;
    if (!(radius_ >= 0)) return false;
    if (SquaredDistancePointBox(centre_, Around(t)) > limit * limit) return false;
    return SquaredDistancePointTriangle(centre_, t[0], t[1], t[2]) <= limit * limit;
  }

  // The farthest point of a triangle is a corner.
  bool Covers(const Triangle3d& t, double distance) const override {
    const double limit = radius_ - distance - Rounding(t, distance, LargestCoordinate(centre_));
    return limit > 0 && std::all_of(t.begin(), t.end(), [&](Vec3d p) {
             return SquaredLength(p - centre_) < limit * limit;
           });
  }

  bool BoxWithin(const Box3d& box, double distance) const override {
    if (!(radius_ >= 0) || box.empty()) return false;
    const double limit = radius_ + distance + Rounding(box, radius_ + distance, 0);
    return SquaredDistancePointBox(centre_, box) <= limit * limit;
  }

  bool BoxCovers(const Box3d& box, double distance) const override {
    const double limit = radius_ - distance - Rounding(box, distance, LargestCoordinate(centre_));
    if (box.empty() || !(limit > 0)) return false;
    for (int i = 0; i < 8; ++i) {
      if (!(SquaredLength(Corner(box, i) - centre_) < limit * limit)) return false;
    }
    return true;
  }

  double Depth(const Box3d& box) const override {
    if (!(radius_ >= 0) || box.empty()) return Region::Depth(box);
    const double slack = 8 * Rounding(box, radius_, LargestCoordinate(centre_));
    const double nearest = std::sqrt(SquaredDistancePointBox(centre_, box));
    if (nearest > radius_) return Shallower(radius_ - nearest, slack);
    double farthest2 = 0;
    for (int i = 0; i < 8; ++i) {
      farthest2 = std::max(farthest2, SquaredLength(Corner(box, i) - centre_));
    }
    return Shallower(std::max(0.0, radius_ - std::sqrt(farthest2)), slack);
  }

  double Shift(const Region& to, const Box3d& within) const override {
    const auto* const other = dynamic_cast<const Ball*>(&to);
    if (other == nullptr || !(radius_ >= 0) || !(other->radius_ >= 0)) {
      return Region::Shift(to, within);
    }
    if (other->centre_ == centre_ && other->radius_ == radius_) return 0;
    const double scale = std::max(
        {LargestCoordinate(centre_), LargestCoordinate(other->centre_), radius_, other->radius_});
    return Length(other->centre_ - centre_) + std::abs(other->radius_ - radius_) +
           16 * Rounding(within, 0, scale);
  }

 private:
  Vec3d centre_;
  double radius_;
};

// Of regions that are put together one by one.
double LargestShift(const std::vector<RegionPtr>& from, const std::vector<RegionPtr>& to,
                    const Box3d& within) {
  if (from.size() != to.size()) return kInfinity;
  double shift = 0;
  for (size_t i = 0; i < from.size(); ++i) {
    if (!SpendSteps(1)) return kInfinity;
    shift = std::max(shift, from[i]->Shift(*to[i], within));
  }
  return shift;
}

// The depth that `choose` takes of each two.
template <typename Choose>
double ChosenDepth(const std::vector<RegionPtr>& regions, const Box3d& box, double none,
                   const Choose& choose) {
  double depth = none;
  for (const RegionPtr& r : regions) {
    if (!SpendSteps(1)) return 0;
    depth = choose(depth, r->Depth(box));
  }
  return depth;
}

class Union final : public SplittingRegion {
 public:
  explicit Union(std::vector<RegionPtr> regions)
      : regions_(std::move(regions)), splits_(SplitsAround(regions_)) {}

  bool Within(const Triangle3d& t, double distance) const override {
    return AnyOf([&](const RegionPtr& r) { return r->Within(t, distance); });
  }
  bool Covers(const Triangle3d& t, double distance) const override {
    const auto covers = [&](const Triangle3d& part) {
      return AnyOf([&](const RegionPtr& r) { return r->Covers(part, distance); });
    };
    return HoldsForAll(t, covers, splits_);
  }
  bool BoxWithin(const Box3d& box, double distance) const override {
    return AnyOf([&](const RegionPtr& r) { return r->BoxWithin(box, distance); });
  }
  bool BoxCovers(const Box3d& box, double distance) const override {
    return AnyOf([&](const RegionPtr& r) { return r->BoxCovers(box, distance); });
  }
  bool whole() const override {
    return AnyOf([](const RegionPtr& r) { return r->whole(); });
  }
  double Depth(const Box3d& box) const override {
    return ChosenDepth(regions_, box, -kInfinity,
                       [](double a, double b) { return std::max(a, b); });
  }
  double Shift(const Region& to, const Box3d& within) const override {
    const auto* const other = dynamic_cast<const Union*>(&to);
    return other == nullptr ? Region::Shift(to, within)
                            : LargestShift(regions_, other->regions_, within);
  }

 private:
  template <typename F>
  bool AnyOf(F&& holds) const {
    return std::ranges::any_of(regions_,
                               [&](const RegionPtr& r) { return SpendSteps(1) && holds(r); });
  }
  std::vector<RegionPtr> regions_;
  int splits_;
};

class Intersection final : public SplittingRegion {
 public:
  explicit Intersection(std::vector<RegionPtr> regions)
      : regions_(std::move(regions)), splits_(SplitsAround(regions_)) {}

  bool Within(const Triangle3d& t, double distance) const override {
    const auto within = [&](const Triangle3d& part) {
      return AllOf([&](const RegionPtr& r) { return r->Within(part, distance); });
    };
    return HoldsForSome(t, within, splits_);
  }
  bool Covers(const Triangle3d& t, double distance) const override {
    return AllOf([&](const RegionPtr& r) { return r->Covers(t, distance); });
  }
  bool BoxWithin(const Box3d& box, double distance) const override {
    return AllOf([&](const RegionPtr& r) { return r->BoxWithin(box, distance); });
  }
  bool BoxCovers(const Box3d& box, double distance) const override {
    return AllOf([&](const RegionPtr& r) { return r->BoxCovers(box, distance); });
  }

  double Depth(const Box3d& box) const override {
    return ChosenDepth(regions_, box, kInfinity, [](double a, double b) { return std::min(a, b); });
  }
  double Shift(const Region& to, const Box3d& within) const override {
    const auto* const other = dynamic_cast<const Intersection*>(&to);
    return other == nullptr ? Region::Shift(to, within)
                            : LargestShift(regions_, other->regions_, within);
  }

  const std::vector<RegionPtr>& regions() const { return regions_; }

 private:
  template <typename F>
  bool AllOf(F&& holds) const {
    return std::ranges::all_of(regions_,
                               [&](const RegionPtr& r) { return SpendSteps(1) && holds(r); });
  }
  std::vector<RegionPtr> regions_;
  int splits_;
};

class Complement final : public SplittingRegion {
 public:
  explicit Complement(RegionPtr region) : region_(std::move(region)) {}

  bool Within(const Triangle3d& t, double distance) const override {
    return !region_->Covers(t, distance);
  }
  bool Covers(const Triangle3d& t, double distance) const override {
    return !region_->Within(t, distance);
  }
  bool BoxWithin(const Box3d& box, double distance) const override {
    return !box.empty() && !region_->BoxCovers(box, distance);
  }
  bool BoxCovers(const Box3d& box, double distance) const override {
    return !box.empty() && !region_->BoxWithin(box, distance);
  }
  bool splits() const override { return Splits(region_); }
  double Depth(const Box3d& box) const override { return -region_->Depth(box); }
  double Shift(const Region& to, const Box3d& within) const override {
    const auto* const other = dynamic_cast<const Complement*>(&to);
    return other == nullptr ? Region::Shift(to, within) : region_->Shift(*other->region_, within);
  }

 private:
  RegionPtr region_;
};

}  // namespace

// By distances like the size of the box.
double Region::Depth(const Box3d& box) const {
  constexpr double kSteps[] = {64, 8, 1, 0.25};
  if (box.empty()) return 0;
  const double size = Length(box.max - box.min);
  const bool outside = !BoxWithin(box, 0);
  if (!outside && !BoxCovers(box, 0)) return 0;
  for (const double step : kSteps) {
    const double distance = step * size;
    if (outside ? !BoxWithin(box, distance) : BoxCovers(box, distance)) {
      return outside ? -distance : distance;
    }
  }
  return 0;
}

double Region::Shift(const Region& to, const Box3d&) const { return this == &to ? 0 : kInfinity; }

RegionPtr WholeRegion() {
  static const RegionPtr kWhole = std::make_shared<Whole>();
  return kWhole;
}

RegionPtr BoxRegion(const Box3d& box) { return std::make_shared<AxisBox>(box); }

RegionPtr SphereRegion(Vec3d centre, double radius) {
  return std::make_shared<Ball>(centre, radius);
}

RegionPtr UnionRegion(std::vector<RegionPtr> regions) {
  return std::make_shared<Union>(std::move(regions));
}

RegionPtr IntersectionRegion(std::vector<RegionPtr> regions) {
  std::vector<HalfSpace> half_spaces;
  std::vector<RegionPtr> merged;
  std::vector<RegionPtr> others;
  // Grows as intersections among them give up their parts.
  for (size_t i = 0; i < regions.size(); ++i) {
    const RegionPtr region = regions[i];
    MTDB_CHECK(region != nullptr, "an intersection needs its regions");
    std::vector<HalfSpace> more;
    if (const auto* parts = dynamic_cast<const Intersection*>(region.get())) {
      regions.insert(regions.end(), parts->regions().begin(), parts->regions().end());
      continue;
    }
    if (const auto* convex = dynamic_cast<const Convex*>(region.get())) {
      more = convex->HalfSpaces();
    } else if (const auto* box = dynamic_cast<const AxisBox*>(region.get());
               box != nullptr && !box->box().empty()) {
      more = BoxHalfSpaces(box->box());
    }
    if (more.empty() || half_spaces.size() + more.size() > kMaxHalfSpaces) {
      if (!region->whole()) others.push_back(region);
      continue;
    }
    half_spaces.insert(half_spaces.end(), more.begin(), more.end());
    merged.push_back(region);
  }
  if (merged.size() > 1) merged = {ConvexRegion(half_spaces)};
  others.insert(others.end(), merged.begin(), merged.end());
  if (others.empty()) return WholeRegion();
  return others.size() == 1 ? others[0] : std::make_shared<Intersection>(std::move(others));
}

RegionPtr ComplementRegion(RegionPtr region) {
  MTDB_CHECK(region != nullptr, "a complement needs a region");
  return std::make_shared<Complement>(std::move(region));
}

}  // namespace mtdb
