// SPDX-License-Identifier: Apache-2.0
// JudgedQuery: a query as triangles of an object are judged by it.
#pragma once

#include <algorithm>
#include <array>
#include <optional>

#include "query/cut/levels.h"
#include "query/query.h"
#include "store/cluster_source.h"

namespace mtdb::internal {

// Its region, and its thresholds, attainable ones. Of a terrain, what is near a triangle is above
// or below it (vertical_reach.h).
class JudgedQuery {
 public:
  // `rounding`: what is added to each error.
  JudgedQuery(const ObjectRecord& record, double rounding);

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

 protected:
  const std::array<double, 256>& bounds() const { return bounds_; }  // by code
  // Of a pixel; null: the levels are not in pixels.
  const ThresholdPtr& pixel() const { return pixel_; }
  const std::optional<double>& pixels() const { return pixels_; }  // the threshold is so many

 private:
  ThresholdPtr AttainableAt(const Levels& levels, int level) const;
  Fields FieldsOf(const Levels& levels, const Cutoff& cutoff) const;
  bool SameRegion(const Query& query) const;
  bool SameThreshold(const Query& query) const;
  // As this object is asked.
  RegionPtr RegionOf(const Query& query) const;
  ThresholdPtr ThresholdOf(const Query& query) const;

  const bool vertical_;                // the object's errors are heights
  const std::array<double, 2> aside_;  // units of x and y for each unit of error
  const double rounding_;
  const Box3d box_;  // of the object
  const std::array<double, 256> bounds_;
  RegionPtr query_region_;  // as the query has it
  RegionPtr region_;
  ThresholdPtr asked_;
  ThresholdPtr pixel_;
  std::optional<double> pixels_;
  Levels levels_;
  Cutoff cutoff_;
  Fields fields_;
  std::optional<double> constant_;
  int valid_code_ = -1;
};

}  // namespace mtdb::internal
