// SPDX-License-Identifier: Apache-2.0
#include "query/fields/promise.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "query/fields/rounding.h"

namespace mtdb::internal {
namespace {

// A continuous function of what is asked for, so that a field that moves changes by little.
class AttainableThreshold final : public Threshold {
 public:
  AttainableThreshold(ThresholdPtr asked, double rounding)
      : asked_(std::move(asked)), rounding_(rounding) {}

  double Min(const Triangle3d& t, double distance) const override {
    return Of(asked_->Min(t, distance));
  }
  ErrorRange Range(const Box3d& box, double distance) const override {
    const ErrorRange range = asked_->Range(box, distance);
    return {Of(range.low), Of(range.high)};
  }
  FieldChange Change(const Threshold& to, const Box3d& box, double distance) const override {
    if (const std::optional<double> from = constant(), into = to.constant(); from && into) {
      return ConstantThreshold(*from)->Change(to, box, distance);
    }
    const auto* const other = dynamic_cast<const AttainableThreshold*>(&to);
    if (other == nullptr || other->rounding_ != rounding_) return {};
    const FieldChange change = asked_->Change(*other->asked_, box, distance);
    if ((change.low == 0 && change.high == 0) ||
        (IsAsked(box, distance) && other->IsAsked(box, distance))) {
      return change;
    }
    // Where it does not follow, it stays.
    const double slack = kBoxRounding * rounding_;
    return {{std::min(change.low, 0.0) - slack, std::max(change.high, 0.0) + slack}, change.shift};
  }
  double Margin(const Box3d& box, double distance) const override {
    return asked_->Margin(box, distance);
  }
  std::optional<double> constant() const override {
    const std::optional<double> value = asked_->constant();
    return value ? std::optional<double>(Of(*value)) : std::nullopt;
  }

 private:
  // Everywhere in the box.
  bool IsAsked(const Box3d& box, double distance) const {
    return asked_->Range(box, distance).low >= rounding_;
  }
  double Of(double asked) const {
    if (!(asked < 0)) return std::max(asked, rounding_);
    return std::min(asked + rounding_, std::nextafter(rounding_, -1.0));
  }

  const ThresholdPtr asked_;
  const double rounding_;
};

}  // namespace

std::array<double, 256> BoundsByCode(const Grid& grid, double rounding) {
  std::array<double, 256> bounds;
  for (size_t code = 0; code < 256; ++code) {
    bounds[code] = BoundOf(grid, static_cast<uint8_t>(code), rounding);
  }
  return bounds;
}

ThresholdPtr Attainable(const ThresholdPtr& asked, double rounding) {
  if (asked == nullptr) return FullResolution();
  if (rounding == 0 || asked->full_resolution()) return asked;
  return std::make_shared<AttainableThreshold>(asked, rounding);
}

bool MayFallShort(const ThresholdPtr& asked, const Box3d& box, double rounding) {
  if (asked == nullptr || rounding == 0) return false;
  const ErrorRange range = asked->Range(box, rounding);
  return range.low < rounding && range.high >= 0;
}

void AddShortfall(const Threshold& asked, const Triangle3d& t, double bound, bool removable,
                  Shortfall* shortfall) {
  const double least = asked.Min(t, bound);
  if (bound <= least || (least < 0 && !removable)) return;
  ++shortfall->triangles;
  shortfall->excess = std::max(shortfall->excess, bound - std::max(least, 0.0));
  for (const Vec3d& p : t) shortfall->bounds.Add(p);
}

}  // namespace mtdb::internal
