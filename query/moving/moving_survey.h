// SPDX-License-Identifier: Apache-2.0
// MovingSurvey: the active triangles of a moving cut.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "query/cut/survey.h"
#include "query/moving/moving_units.h"

namespace mtdb::internal {

// As Survey, with what the units of a moving cut keep of their stars; marks no triangles. One use.
class MovingSurvey final : private Survey {
 public:
  MovingSurvey(MovingUnits& cut, UnitPins& pins) : Survey(cut, cut.judge(), pins, false) {}

  Result<ActiveTriangles> Run(bool complete, const Box3d& bounds);

 private:
  Activity KnownOfInTriangle(const LoadedUnit& unit, uint32_t slot) const override;
  Activity KnownOfStar(CutUnit& u, const LoadedUnit& unit, NodeIndex node) const override;
  bool StarsTellMore(const CutUnit& u) const override;
  Activity ActivityOf(const MovingUnit& u, NodeIndex creator) const;
  Result<ActiveTriangles> RunMoving();
  int LargestBelow(uint8_t code) const;
  void CountStars(MovingUnit& u, const LoadedUnit& unit);
  void CountNear(const LoadedUnit& unit, uint32_t slot, NodeIndex creator, uint8_t code,
                 bool active);
  bool IsActive(const MovingUnit& u, const LoadedUnit& unit, uint32_t slot) const;
  void FindLargestOfNodes(const MovingUnit& u, const LoadedUnit& unit);
  void FindLargestOfChildren(const MovingUnit& u, const LoadedUnit& unit);

  std::vector<std::pair<UnitId, Arc>> near_;  // by the child that removes it
};

}  // namespace mtdb::internal
