// SPDX-License-Identifier: Apache-2.0
// Judge: what a query says of triangles, and of all triangles in a box.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <optional>

#include "query/cache/loaded_unit.h"
#include "query/cut/levels.h"
#include "query/fields/promise.h"
#include "query/fields/work_meter.h"
#include "query/query.h"
#include "store/cluster_source.h"

namespace mtdb::internal {

// Which triangles of a box are active.
enum class Activity : uint8_t { kNone, kSome, kAll };

// The definitions of query.h, with bounds b(t) = e(t) + `rounding` in model units. A triangle is
// refused when it is active and invalid. Of a terrain, what is near a triangle is above or below it
// (vertical_reach.h). Questions are counted on the meter; once that says that
// the query is to end, answers are void. One thread.
class Judge {
 public:
  Judge(const ClusterSource& source, double rounding);

  // The thresholds of a query, attainable ones, with a cutoff: `strict` for units from `from` on,
  // `loose` for those before.
  struct Fields {
    ThresholdPtr strict, loose;
    UnitId from = 0;
    const Threshold& Of(UnitId unit) const { return unit < from ? *loose : *strict; }
    friend bool operator==(const Fields&, const Fields&) = default;
  };

  // From now on it judges for this query. Its region and threshold stay alive with it. With a
  // cutoff all questions but FieldOf and RangeOf are of the level below, by which more is refused.
  void SetQuery(const Query& query, const Cutoff& cutoff = {});
  // True when it judges for this region and threshold, as objects or by value: no triangle of the
  // object is judged otherwise.
  bool Same(const Query& query) const;
  const Cutoff& cutoff() const { return cutoff_; }
  // Not null while questions are asked.
  void SetMeter(WorkMeter* meter) { meter_ = meter; }
  WorkMeter& meter() const { return *meter_; }

  const ClusterIndex& index() const { return index_; }
  const Grid& grid() const { return grid_; }
  double rounding() const { return rounding_; }
  bool whole() const { return region_ == nullptr; }
  const RegionPtr& region() const { return region_; }               // null: all of space
  const ThresholdPtr& asked() const { return asked_; }              // the query's; may be null
  const ThresholdPtr& threshold() const { return fields_.strict; }  // the attainable one
  const Fields& fields() const { return fields_; }
  // What nodes of the unit are judged by.
  const Threshold& FieldOf(UnitId unit) const { return fields_.Of(unit); }
  const Levels& levels() const { return levels_; }
  const std::optional<double>& constant() const { return constant_; }
  // No region and one threshold: the geometry need not be looked at.
  bool by_code() const { return whole() && constant_.has_value(); }
  double Bound(uint8_t code) const { return bounds_[code]; }
  // Triangles whose errors have at most this code are valid everywhere; -1: not even those of 0.
  int valid_code() const { return valid_code_; }

  bool Active(const Triangle3d& t, double bound) const {
    return whole() || (meter_->Spend(1) && region_->Within(t, bound));
  }
  bool Valid(const Triangle3d& t, double bound) const {
    if (constant_) return bound <= *constant_;
    return !meter_->Spend(1) || bound <= fields_.strict->Min(t, bound);
  }
  // A slot of the unit whose remover has an error of this code; `creator` as LoadedUnit::creator.
  bool Refused(const LoadedUnit& unit, uint32_t slot, NodeIndex creator, uint8_t code) const {
    if (code <= valid_code_) return false;
    if (by_code()) return true;
    const Triangle3d t = Corners(unit, slot, creator);
    return Active(t, bounds_[code]) && !Valid(t, bounds_[code]);
  }
  // The least level of the query at which it would not be; Levels::kNone when it is not.
  int LevelOf(const LoadedUnit& unit, uint32_t slot, NodeIndex creator, uint8_t code) const;
  // Whether some triangle of the node's hole is, present or not.
  bool RefusesAny(const LoadedUnit& unit, NodeIndex node) const;

  // Of triangles inside the box with bounds up to `bound`.
  Activity ActivityIn(const Box3d& box, double bound) const;
  // Likewise, and how far borders of the region may shift before that can be otherwise.
  struct Where {
    Activity activity = Activity::kSome;
    double shift = std::numeric_limits<double>::infinity();
  };
  Where WhereIs(const Box3d& box, double bound) const;
  // Of triangles inside the box with codes up to `largest`: none up to `valid` is refused, and of
  // those above `undecided` all that are active.
  struct Codes {
    int valid = -1;
    int undecided = 255;
  };
  Codes CodesIn(const Box3d& box, uint8_t largest) const;
  // False only when none inside the box with a code up to `largest` is refused.
  bool MayRefuse(const Box3i& bounds, uint8_t largest) const {
    if (largest <= valid_code_) return false;
    const Box3d box = ModelBox(bounds);
    return ActivityIn(box, bounds_[largest]) != Activity::kNone &&
           largest > CodesIn(box, largest).valid;
  }
  // Where the threshold's Min lies, likewise.
  ErrorRange RangeIn(const Box3d& box, double bound) const {
    meter_->Spend(1);
    return fields_.strict->Range(box, bound);
  }
  // Likewise, by the unit's field.
  ErrorRange RangeOf(UnitId unit, const Box3d& box, double bound) const {
    meter_->Spend(1);
    return fields_.Of(unit).Range(box, bound);
  }

  // How far the threshold's own borders are, likewise.
  double MarginIn(const Box3d& box, double bound) const {
    return meter_->Spend(kDepthSteps) ? fields_.strict->Margin(box, bound) : 0;
  }

  Box3d ModelBox(const Box3i& box) const { return grid_.Bounds(box); }
  Triangle3d Corners(const LoadedUnit& unit, uint32_t slot, NodeIndex creator) const;
  // The largest bound of a triangle that the unit creates or removes.
  double Reach(UnitId unit) const;

 private:
  static constexpr uint64_t kDepthSteps = 8;  // questions that a depth may take

  static int StrictLevel(const Cutoff& c) { return std::max(c.level - 1, Levels::kNone); }
  ThresholdPtr AttainableAt(const Levels& levels, int level) const;
  Fields FieldsOf(const Levels& levels, const Cutoff& cutoff) const;
  bool SameRegion(const Query& query) const;
  bool SameThreshold(const Query& query) const;
  // As this object is asked.
  RegionPtr RegionOf(const Query& query) const;
  ThresholdPtr ThresholdOf(const Query& query) const;

  const bool vertical_;                // the object's errors are heights
  const std::array<double, 2> aside_;  // units of x and y for each unit of error
  const ClusterIndex& index_;
  const Grid& grid_;
  const double rounding_;
  const Box3d box_;  // of the object
  const std::array<double, 256> bounds_;
  WorkMeter* meter_ = nullptr;
  RegionPtr query_region_;  // as the query has it
  RegionPtr region_;
  ThresholdPtr asked_;
  ThresholdPtr pixel_;            // null: the levels are not in pixels
  std::optional<double> pixels_;  // the query's threshold is these pixels
  Levels levels_;
  Cutoff cutoff_;
  Fields fields_;
  std::optional<double> constant_;
  int valid_code_ = -1;
};

}  // namespace mtdb::internal
