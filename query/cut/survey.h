// SPDX-License-Identifier: Apache-2.0
// Survey: the active triangles of a cut's mesh.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "query/cut/cut_state.h"
#include "query/cut/judge.h"
#include "query/cut/unit_pins.h"

namespace mtdb::internal {

// Bounds as in ExtractStats: where the cluster of a triangle's remover has not been looked at, its
// largest error stands for the triangle's.
struct ActiveTriangles {
  bool all = false;  // so CutUnit::active is not filled
  uint64_t count = 0;
  uint8_t largest_code = 0;
  Shortfall shortfall;
};

// Goes once over the units that may have some. One use. A moving cut, whose units keep what is
// known of their stars, has a survey of its own (moving/moving_survey.h).
class Survey {
 public:
  // CutUnit::active tells which triangles these are.
  Survey(CutState& cut, const Judge& judge, UnitPins& pins) : Survey(cut, judge, pins, true) {}
  virtual ~Survey() = default;

  // `complete`: every active triangle is valid. `bounds` of the whole surface.
  Result<ActiveTriangles> Run(bool complete, const Box3d& bounds);

 protected:
  // `marks`: CutUnit::active is filled.
  Survey(CutState& cut, const Judge& judge, UnitPins& pins, bool marks)
      : cut_(cut), judge_(judge), pins_(pins), marks_(marks) {}

  // What is known beforehand, where only some triangles of a unit are active.
  virtual Activity KnownOfInTriangle(const LoadedUnit&, uint32_t /*slot*/) const {
    return Activity::kSome;
  }
  virtual Activity KnownOfStar(CutUnit&, const LoadedUnit&, NodeIndex) const {
    return Activity::kSome;
  }
  // Of the unit's triangles that fall short, more than their codes do.
  virtual bool StarsTellMore(const CutUnit&) const { return false; }

  // True when all is known at once.
  bool Begin(bool complete, const Box3d& bounds);
  Status SurveyUnits(bool complete);
  uint8_t LargestOfChildren(UnitId unit) const;
  // Of a present own slot; -1 when a child looks at it.
  int CodeOf(const LoadedUnit& unit, uint32_t slot) const;

  CutState& cut_;
  const Judge& judge_;
  UnitPins& pins_;
  bool falls_short_ = false;  // some triangle may
  ActiveTriangles active_;

 private:
  // What is known of the triangles in a box.
  struct In {
    Activity activity;
    double least;                    // of what is asked for
    double most = 0;                 // likewise
    bool drains_fall_short = false;  // they may, of what is asked for
  };
  bool CodesOnly() const { return active_.all && !falls_short_; }
  void FindLargestCode(const CutUnit& u, const LoadedUnit& unit);
  void CountShort(CutUnit& u, const LoadedUnit& unit, const In& in);
  void SurveyUnit(CutUnit& u, const LoadedUnit& unit, const In& in);
  void SurveyStars(CutUnit& u, const LoadedUnit& unit, const In& in_unit);
  void LookAround(const LoadedUnit& unit, NodeIndex node, uint8_t largest, In* in) const;
  // Counts the slot if it is active, and says so.
  bool Count(const LoadedUnit& unit, uint32_t slot, NodeIndex creator, uint8_t code, const In& in);

  const bool marks_;
  std::vector<std::pair<uint32_t, uint8_t>> star_;  // own slots and codes
};

}  // namespace mtdb::internal
