// SPDX-License-Identifier: Apache-2.0
#include "query/compare/doubt.h"

#include <cmath>
#include <utility>

#include "query/compare/outward.h"
#include "query/fields/rounding.h"

namespace mtdb::internal {
namespace {

// The largest distance along an axis; 0 or less where the boxes meet.
inline double AxisDistance(const Box3d& a, const Box3d& b) {
  const double x = std::max(a.min.x - b.max.x, b.min.x - a.max.x);
  const double y = std::max(a.min.y - b.max.y, b.min.y - a.max.y);
  const double z = std::max(a.min.z - b.max.z, b.min.z - a.max.z);
  return std::max({x, y, z});
}

class AroundBoxesRegion final : public Region {
 public:
  AroundBoxesRegion(BoxSetPtr boxes, double by) : boxes_(std::move(boxes)), by_(by) {}

  bool Within(const Triangle3d& t, double distance) const override {
    return BoxWithin(Around(t), distance);
  }
  bool BoxWithin(const Box3d& box, double distance) const override {
    return boxes_->Meets(box, Up(by_ + distance));
  }
  bool Covers(const Triangle3d&, double) const override { return false; }
  bool BoxCovers(const Box3d&, double) const override { return false; }

 private:
  const BoxSetPtr boxes_;
  const double by_;
};

}  // namespace

BoxSet::BoxSet(std::vector<Box3d> boxes) : tree_(boxes) {
  boxes_.reserve(boxes.size());
  for (const uint32_t i : tree_.order()) boxes_.push_back(boxes[i]);
}

bool BoxSet::Meets(const Box3d& box, double distance) const {
  return tree_.Any([&](const Box3d& node) { return AxisDistance(node, box) <= distance; },
                   [&](uint32_t place) { return AxisDistance(boxes_[place], box) <= distance; });
}

RegionPtr AroundBoxes(BoxSetPtr boxes, double by) {
  return std::make_shared<AroundBoxesRegion>(std::move(boxes), by);
}

bool Asking::Meets(const Triangle3d& part) const {
  if (boxes != nullptr && !boxes->Meets(Around(part), bound)) return false;
  return region == nullptr || region->Within(part, bound);
}

bool Asking::Covers(Vec3d point) const {
  if (boxes != nullptr && !boxes->Meets({point, point}, bound)) return false;
  return region == nullptr || region->Covers({point, point, point}, bound);
}

}  // namespace mtdb::internal
