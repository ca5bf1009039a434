#include "query/region.h"

#include <utility>

namespace mtdb {
namespace {

// Rounding slack that keeps BoxWithin conservative: relative to the largest coordinate.
double Slack(const Box3d& box, double distance) {
  double largest = distance;
  for (int i = 0; i < 3; ++i) {
    largest = std::max({largest, std::abs(box.min[i]), std::abs(box.max[i])});
  }
  return largest * 1e-12;
}

class Whole final : public Region {
 public:
  bool Within(const Triangle3d&, double) const override { return true; }
  bool BoxWithin(const Box3d&, double) const override { return true; }
  bool whole() const override { return true; }
};

class AxisBox final : public Region {
 public:
  explicit AxisBox(const Box3d& box) : box_(box) {}

  bool Within(const Triangle3d& t, double distance) const override {
    if (box_.empty()) return false;
    const double limit = distance * distance;
    Box3d around;
    for (const Vec3d& p : t) around.Add(p);
    if (SquaredDistanceBoxBox(around, box_) > limit) return false;
    for (const Vec3d& p : t) {
      if (SquaredDistancePointBox(p, box_) <= limit) return true;
    }
    return SquaredDistanceTriangleBox(t, box_) <= limit;
  }

  bool BoxWithin(const Box3d& box, double distance) const override {
    if (box_.empty() || box.empty()) return false;
    const double limit = distance + Slack(box, distance);
    return SquaredDistanceBoxBox(box, box_) <= limit * limit;
  }

 private:
  Box3d box_;
};

class Ball final : public Region {
 public:
  Ball(Vec3d centre, double radius) : centre_(centre), radius_(radius) {}

  bool Within(const Triangle3d& t, double distance) const override {
    const double limit = radius_ + distance;
    if (!(radius_ >= 0)) return false;
    Box3d around;
    for (const Vec3d& p : t) around.Add(p);
    if (SquaredDistancePointBox(centre_, around) > limit * limit) return false;
    return SquaredDistancePointTriangle(centre_, t[0], t[1], t[2]) <= limit * limit;
  }

  bool BoxWithin(const Box3d& box, double distance) const override {
    if (!(radius_ >= 0) || box.empty()) return false;
    const double limit = radius_ + distance + Slack(box, radius_ + distance);
    return SquaredDistancePointBox(centre_, box) <= limit * limit;
  }

 private:
  Vec3d centre_;
  double radius_;
};

class Union final : public Region {
 public:
  explicit Union(std::vector<RegionPtr> regions) : regions_(std::move(regions)) {}

  bool Within(const Triangle3d& t, double distance) const override {
    for (const RegionPtr& r : regions_) {
      if (r->Within(t, distance)) return true;
    }
    return false;
  }
  bool BoxWithin(const Box3d& box, double distance) const override {
    for (const RegionPtr& r : regions_) {
      if (r->BoxWithin(box, distance)) return true;
    }
    return false;
  }
  bool whole() const override {
    for (const RegionPtr& r : regions_) {
      if (r->whole()) return true;
    }
    return false;
  }

 private:
  std::vector<RegionPtr> regions_;
};

}  // namespace

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

}  // namespace mtdb
