// SPDX-License-Identifier: Apache-2.0
// StoredOrderPass: inserts the refused nodes of a cluster in one pass over its nodes.
#pragma once

#include <cstdint>
#include <vector>

#include "query/cut/cut_state.h"
#include "query/cut/judge.h"

namespace mtdb::internal {

// In stored order parents precede children, so that nearly every hole is complete when its node's
// turn comes. Presence is a byte for each slot meanwhile, so that a node is a few plain loads and
// stores. What CutState::Insert would do, node after node, at some ten times the speed.
class StoredOrderPass {
 public:
  StoredOrderPass(CutState& cut, const Judge& judge) : cut_(cut), judge_(judge) {}

  // Applies the nodes that remove present refused triangles, each after its missing ancestors in
  // the unit. Sets CutUnit::wanted for what is left to CutState::Insert: nodes with ancestors
  // missing elsewhere, and earlier nodes that are wanted since an ancestor was applied. Returns how
  // many applied nodes remove no refused triangle. The unit is pinned, its cut does not remember.
  uint64_t Run(CutUnit& u, const LoadedUnit& unit);

 private:
  // A parent's slots; null: none of them is present.
  struct Parent {
    Bits* present = nullptr;
    uint32_t first_own = 0;
  };

  void Load();
  void Store();
  bool Wanted(NodeIndex node) const;
  void Apply(NodeIndex node);
  void ApplyAfterAncestors(NodeIndex target);

  CutState& cut_;
  const Judge& judge_;
  CutUnit* u_ = nullptr;
  const LoadedUnit* unit_ = nullptr;
  Judge::Codes codes_;  // of the unit's box
  std::vector<Parent> parents_;
  std::vector<uint8_t> present_;       // per slot: 1 when present
  std::vector<NodeIndex> candidates_;  // nodes whose codes are not valid all over the box
  std::vector<NodeIndex> missing_;
  uint64_t forced_ = 0;
  uint64_t nodes_ = 0, vertices_ = 0, triangles_ = 0;  // inserted; triangles modulo 2^64
};

}  // namespace mtdb::internal
