// SPDX-License-Identifier: Apache-2.0
// Judge: what a query says of triangles, and of all triangles in a box.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>

#include "query/cache/loaded_unit.h"
#include "query/cut/judged_query.h"
#include "query/fields/promise.h"
#include "query/fields/work_meter.h"
#include "store/cluster_source.h"

namespace mtdb::internal {

// Which triangles of a box are active.
enum class Activity : uint8_t { kNone, kSome, kAll };

// The definitions of query.h, with bounds b(t) = e(t) + `rounding` in model units. A triangle is
// refused when it is active and invalid. Questions are counted on the meter; once that says that
// the query is to end, answers are void. One thread.
class Judge : public JudgedQuery {
 public:
  Judge(const ClusterSource& source, double rounding)
      : JudgedQuery(source.record(), rounding),
        index_(source.index()),
        grid_(source.record().grid) {}

  // Not null while questions are asked.
  void SetMeter(WorkMeter* meter) { meter_ = meter; }
  WorkMeter& meter() const { return *meter_; }

  const ClusterIndex& index() const { return index_; }
  const Grid& grid() const { return grid_; }

  bool Active(const Triangle3d& t, double bound) const {
    return whole() || (meter_->Spend(1) && region()->Within(t, bound));
  }
  bool Valid(const Triangle3d& t, double bound) const {
    if (constant()) return bound <= *constant();
    return !meter_->Spend(1) || bound <= threshold()->Min(t, bound);
  }
  // A slot of the unit whose remover has an error of this code; `creator` as LoadedUnit::creator.
  bool Refused(const LoadedUnit& unit, uint32_t slot, NodeIndex creator, uint8_t code) const {
    if (code <= valid_code()) return false;
    if (by_code()) return true;
    const Triangle3d t = Corners(unit, slot, creator);
    return Active(t, Bound(code)) && !Valid(t, Bound(code));
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
    if (largest <= valid_code()) return false;
    const Box3d box = ModelBox(bounds);
    return ActivityIn(box, Bound(largest)) != Activity::kNone &&
           largest > CodesIn(box, largest).valid;
  }
  // Where the threshold's Min lies, likewise.
  ErrorRange RangeIn(const Box3d& box, double bound) const {
    meter_->Spend(1);
    return threshold()->Range(box, bound);
  }
  // Likewise, by the unit's field.
  ErrorRange RangeOf(UnitId unit, const Box3d& box, double bound) const {
    meter_->Spend(1);
    return FieldOf(unit).Range(box, bound);
  }

  // How far the threshold's own borders are, likewise.
  double MarginIn(const Box3d& box, double bound) const {
    return meter_->Spend(kDepthSteps) ? threshold()->Margin(box, bound) : 0;
  }

  Box3d ModelBox(const Box3i& box) const { return grid_.Bounds(box); }
  Triangle3d Corners(const LoadedUnit& unit, uint32_t slot, NodeIndex creator) const;
  // The largest bound of a triangle that the unit creates or removes.
  double Reach(UnitId unit) const;

 private:
  static constexpr uint64_t kDepthSteps = 8;  // questions that a depth may take

  const ClusterIndex& index_;
  const Grid& grid_;
  WorkMeter* meter_ = nullptr;
};

}  // namespace mtdb::internal
