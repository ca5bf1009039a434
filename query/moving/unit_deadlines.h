// SPDX-License-Identifier: Apache-2.0
// UnitDeadlines: until when the decisions of a unit stand. docs/design.md, "What a new query can
// change".
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "query/cut/bits.h"
#include "query/cut/judge.h"
#include "query/threshold.h"

namespace mtdb::internal {

// A decision stands until a sum of changes has fallen, or risen, to this. A float, of which a unit
// has thousands.
class Deadline {
 public:
  constexpr explicit Deadline(float at) : at_(at) {}
  static constexpr Deadline NeverFallen() { return Deadline(-kInfinity); }
  static constexpr Deadline NeverRisen() { return Deadline(kInfinity); }
  // Of a sum that falls: to be decided at once.
  static constexpr Deadline Passed() { return Deadline(kInfinity); }
  // Two sums count: it never passes, and both are in a list.
  static constexpr Deadline Mixed() { return Deadline(std::numeric_limits<float>::quiet_NaN()); }
  // No later than at this sum.
  static Deadline Fallen(double sum) {
    const auto f = static_cast<float>(sum);
    return Deadline(f < sum ? std::nextafter(f, kInfinity) : f);
  }
  static Deadline Risen(double sum) {
    const auto f = static_cast<float>(sum);
    return Deadline(f > sum ? std::nextafter(f, -kInfinity) : f);
  }

  bool passed() const { return at_ == kInfinity; }
  bool mixed() const { return std::isnan(at_); }
  bool HasFallen(float sum) const { return sum <= at_; }
  bool HasRisen(float sum) const { return sum >= at_; }
  float at() const { return at_; }

 private:
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();
  float at_;
};

// On which side of the region's border a node's hole and star are, and until how much the border
// has shifted. A float, whose sign is the side.
class Side {
 public:
  constexpr Side() = default;  // not asked
  // kSome: the border is there.
  Side(Activity activity, float until)
      : until_(activity == Activity::kAll    ? until
               : activity == Activity::kNone ? -until
                                             : 0) {}

  bool asked() const { return !std::isnan(until_); }
  bool at_border() const { return until_ == 0; }
  // Of all triangles of the hole and the star; kSome when that has not been asked.
  Activity activity() const {
    return until_ > 0 ? Activity::kAll : until_ < 0 ? Activity::kNone : Activity::kSome;
  }
  // At the border, and not asked, it never passes.
  Deadline until() const { return Deadline(std::abs(until_)); }
  bool HasPassed(float shift) const { return (until_ != 0) & (shift >= std::abs(until_)); }

 private:
  float until_ = std::numeric_limits<float>::quiet_NaN();
};
static_assert(sizeof(Deadline) == sizeof(float) && sizeof(Side) == sizeof(float));

// How far a query may move before a decision can be otherwise: by how much the threshold has to
// fall or to rise, or borders of regions to shift.
struct Leeway {
  double fall = std::numeric_limits<double>::infinity();
  double rise = std::numeric_limits<double>::infinity();
  double shift = std::numeric_limits<double>::infinity();
};

// What the query says of all of a unit's box.
struct UnitBounds {
  Box3d box;
  double reach = 0;  // Judge::Reach
  Activity activity = Activity::kNone;
  ErrorRange range;  // of Min in the box, of the threshold that the unit's nodes are judged by
  ErrorRange child_range;  // likewise, by which children are wanted
  double margin = 0;       // of the threshold's borders from the box

  UnitBounds() = default;
  UnitBounds(const Judge& judge, UnitId unit);
  void FindRanges(const Judge& judge, UnitId unit);
};

// Bounds of the sum of all changes of Min in a unit's box since its deadlines began, where no
// border passed; and of how far borders shifted.
struct ChangeSum {
  double low = 0, high = 0, shift = 0;
  double shift_before = 0;                        // `shift`, without the last change
  bool fell = true, rose = true, shifted = true;  // by the last change

  void Add(const FieldChange& change);
  // As deadlines are compared with.
  float fallen() const { return Deadline::Risen(low).at(); }
  float risen() const { return Deadline::Fallen(high).at(); }
  float shifts() const { return Deadline::Fallen(shift).at(); }
};

// What has to be decided again, in one unit.
struct Expired {
  bool all = false;
  std::vector<NodeIndex> nodes;
  std::vector<NodeIndex> sides;    // the region's border may have come to these
  std::vector<uint32_t> children;  // ordinals; their deadlines have passed
};

// The deadlines of a unit's known nodes, and of its children that are not open. Those of nodes that
// refuse nothing are of sums that fall, of those that refuse of sums that rise; of children of sums
// that fall.
class UnitDeadlines {
 public:
  bool stale = true;  // all have passed
  UnitBounds bounds;
  ChangeSum sum;

  // Nothing is known.
  void Begin(const UnitBounds& of_unit, const Bits& nodes, size_t children);
  // The sum begins anew, and what borders do is not counted any more.
  void BeginSum();
  // Finds what has passed, or takes all if `expired->all`. Deadlines of such children are gone.
  void TakeExpired(const Bits& known, const Bits& refusing, Expired* expired);

  Deadline node(NodeIndex node) const { return nodes_[node]; }
  bool NodeHasPassed(NodeIndex node, bool refuses) const {
    return refuses ? sum.rose && nodes_[node].HasRisen(sum.risen())
                   : sum.fell && nodes_[node].HasFallen(sum.fallen());
  }
  void SetPassed(NodeIndex node) { nodes_[node] = Deadline::Passed(); }
  void SetNode(NodeIndex node, bool refuses, Deadline deadline);
  void SetLeeway(NodeIndex node, bool refuses, const Leeway& leeway);
  // Of a node that refuses some of its triangles, and not all: both sums count.
  void SetMixed(NodeIndex node, const Leeway& leeway);
  // Leaves no mixed node in the list whose deadline has passed.
  void DropPassedMixed();

  // Until the threshold's borders, or those of the region that are at the node, have shifted.
  Deadline shift(NodeIndex node) const {
    return node_shifts_.empty() ? Deadline::NeverRisen() : node_shifts_[node];
  }
  void SetShift(NodeIndex node, Deadline shift);
  Side side(NodeIndex node) const { return sides_.empty() ? Side() : sides_[node]; }
  // Per known node; empty while none is asked about.
  std::span<const Side> sides() const { return sides_; }
  void SetSide(NodeIndex node, Side side);
  // Of what the judge says.
  Side SideFrom(const Judge::Where& where) const;
  // The hole and the star lie in the cube of so many steps around the node's first vertex; 0: not
  // known.
  uint16_t reach(NodeIndex node) const { return reaches_[node]; }
  void SetReach(const LoadedUnit& unit, NodeIndex node, const Box3i& box);
  void Prefetch(NodeIndex node) const { __builtin_prefetch(&reaches_[node]); }

  // The child waits to be asked about.
  bool ChildWaits(uint32_t ordinal) const { return children_[ordinal].passed(); }
  void SetChildWaits(uint32_t ordinal) { children_[ordinal] = Deadline::Passed(); }
  // The child is needed no sooner than this (a negative fall: not known); than both.
  void SetChild(uint32_t ordinal, const Leeway& leeway);
  void AddChild(uint32_t ordinal, const Leeway& leeway);

 private:
  struct Mixed {
    NodeIndex node;
    Deadline low, high;
  };
  // Per word of nodes: no deadline of its nodes passes before these.
  struct Soonest {
    Deadline low = Deadline::NeverFallen(), high = Deadline::NeverRisen();
    Deadline shift = Deadline::NeverRisen(), side = Deadline::NeverRisen();
  };
  void TakeExpiredNodes(const Bits& known, const Bits& refusing, Expired* expired);
  void TakeExpiredMixed(Expired* expired);

  std::vector<Deadline> nodes_;  // whole words of them; those of mixed_ are Mixed()
  std::vector<Mixed> mixed_;
  std::vector<Deadline> children_;
  // Empty while no border of the threshold matters, or none at all.
  std::vector<Deadline> node_shifts_, child_shifts_;
  std::vector<Side> sides_;
  std::vector<uint16_t> reaches_;
  std::vector<Soonest> soonest_;
};

}  // namespace mtdb::internal
