// SPDX-License-Identifier: Apache-2.0
// Survey: the active triangles of a cut's mesh.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "query/internal/cut_state.h"
#include "query/internal/judge.h"
#include "query/internal/moving_units.h"
#include "query/internal/unit_pins.h"

namespace mtdb::internal {

// Bounds as in ExtractStats: where the cluster of a triangle's remover has not been looked at, its
// largest error stands for the triangle's.
struct ActiveTriangles {
  bool all = false;  // so CutUnit::active is not filled
  uint64_t count = 0;
  uint8_t largest_code = 0;
  Shortfall shortfall;
};

// Goes once over the units that may have some. One use.
class Survey {
 public:
  // CutUnit::active tells which triangles these are.
  Survey(CutState& cut, const Judge& judge, UnitPins& pins)
      : cut_(cut), judge_(judge), pins_(pins), marks_(true), moving_(false) {}
  // Of a moving cut, whose units keep what is known of their stars.
  Survey(MovingUnits& cut, UnitPins& pins)
      : cut_(cut), judge_(cut.judge()), pins_(pins), marks_(false), moving_(true) {}

  // `complete`: every active triangle is valid. `bounds` of the whole surface.
  Result<ActiveTriangles> Run(bool complete, const Box3d& bounds);

 private:
  // What is known of the triangles in a box.
  struct In {
    Activity activity;
    double least;                    // of what is asked for
    double most = 0;                 // likewise
    bool drains_fall_short = false;  // they may, of what is asked for
  };
  void FindLargestCode(const CutUnit& u, const LoadedUnit& unit);
  void CountShort(CutUnit& u, const LoadedUnit& unit, const In& in);
  void SurveyUnit(CutUnit& u, const LoadedUnit& unit, const In& in);
  void SurveyStars(CutUnit& u, const LoadedUnit& unit, const In& in_unit);
  void LookAround(const LoadedUnit& unit, NodeIndex node, uint8_t largest, In* in) const;
  Activity ActivityOf(const LoadedUnit& unit, uint32_t slot) const;
  Activity ActivityOf(const MovingUnit& u, NodeIndex creator) const;
  Result<ActiveTriangles> RunMoving();
  int LargestBelow(uint8_t code) const;
  uint8_t LargestOfChildren(UnitId unit) const;
  void CountStars(MovingUnit& u, const LoadedUnit& unit);
  void CountNear(const LoadedUnit& unit, uint32_t slot, NodeIndex creator, uint8_t code,
                 bool active);
  bool IsActive(const MovingUnit& u, const LoadedUnit& unit, uint32_t slot) const;
  void FindLargestOfNodes(const MovingUnit& u, const LoadedUnit& unit);
  void FindLargestOfChildren(const MovingUnit& u, const LoadedUnit& unit);
  // Counts the slot if it is active, and says so.
  bool Count(const LoadedUnit& unit, uint32_t slot, NodeIndex creator, uint8_t code, const In& in);
  // Of a present own slot; -1 when a child looks at it.
  int CodeOf(const LoadedUnit& unit, uint32_t slot) const;

  CutState& cut_;
  const Judge& judge_;
  UnitPins& pins_;
  const bool marks_;
  const bool moving_;
  bool falls_short_ = false;  // some triangle may
  ActiveTriangles active_;
  std::vector<std::pair<uint32_t, uint8_t>> star_;  // own slots and codes
  std::vector<std::pair<UnitId, Arc>> near_;        // by the child that removes it
};

}  // namespace mtdb::internal
