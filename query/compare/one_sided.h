// SPDX-License-Identifier: Apache-2.0
// OneSided: the distance of one surface's points from another one, from coarse to fine.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <queue>
#include <vector>

#include "query/compare.h"
#include "query/compare/goals.h"
#include "query/compare/places.h"
#include "query/compare/side.h"
#include "query/compare/triangle_gap.h"

namespace mtdb::internal {

struct OneSidedLimits {
  std::optional<double> tolerance, width, reach;
  RegionPtr region;
  unsigned threads = 1;
  size_t most_places = 0;
  // As that of CompareOptions; may be null.
  std::function<bool(uint64_t bytes)> may_hold;
  // Asked now and then, by any thread: true ends the work.
  std::function<bool()> stop;
};

// Branch and bound over *items*: parts of the asking surface, with what is proved of their
// distances. The one that may be farthest is looked at next: by cuts of both surfaces around it, at
// the next of the falling thresholds. What that leaves in doubt becomes new items. One thread
// drives it, and has others at hand for the triangles of an item.
class OneSided {
 public:
  OneSided(const Side& asking, const Side& answering, const OneSidedLimits& limits);

  Status Run();
  OneSidedDistance Take();

  uint64_t triangles() const { return triangles_; }
  const Side::Reading& reading() const { return reading_; }
  bool stopped() const { return stopped_; }
  bool out_of_memory() const { return out_of_memory_; }

 private:
  // Points of the asking surface in a box, none of them farther from the other surface than `high`;
  // one of a cut is known to be at `low`.
  struct Doubt {
    Box3d box;
    DistanceInterval distance;
  };
  struct Item {
    std::vector<Doubt> doubts;  // none: the whole surface
    bool most = false;    // there is doubt about most of the surface, so that all may be asked
    double high = 0;      // the largest of the doubts'
    size_t level = 0;     // of `thresholds_`
    uint64_t number = 0;  // as it was made
    bool operator<(const Item& other) const;
  };

  void MakeThresholds();
  void Push(Item item);
  void Pop();
  // Beside the items. False: it ends here.
  bool MayHold(uint64_t bytes);
  Status Look(Item item);
  Status Compare(const Item& item, const Patch& asking, const BoxSetPtr& boxes);
  // The other surface within a distance of an item; nothing where that is too much and the item was
  // cut.
  Result<std::optional<Patch>> Answering(const Item& item, const BoxSetPtr& boxes, double within);
  // False when an item of one small box is left.
  bool PushHalves(const Item& item);
  // Asks all triangles, with all threads. False: it was stopped.
  bool Ask(const std::vector<Triangle3d>& triangles, const GapQuestion& question,
           uint64_t held_bytes, std::vector<GapAnswer>* answers);
  void Gather(const Item& item, const std::vector<GapAnswer>& answers);
  void LeaveRims(const std::vector<GapAnswer>& answers, std::vector<Doubt>* doubts);
  void AddDoubts(const std::vector<GapPart>& parts, std::vector<Doubt>* doubts) const;
  bool IsKnownPlace(const Doubt& group) const;
  void LeaveUndecided(const std::vector<Doubt>& doubts);
  void PushGroups(std::vector<Doubt> doubts, size_t level, bool most);

  const Side& asking_;
  const Side& answering_;
  const OneSidedLimits limits_;
  Goals goals_;
  Places places_;
  std::vector<double> thresholds_;  // falling; the last is negative, for full resolution
  std::priority_queue<Item> items_;
  double proved_high_ = 0;  // of all that is in no item
  double outward_ = 0;
  uint64_t numbers_ = 0, triangles_ = 0;
  uint64_t item_bytes_ = 0;
  bool stopped_ = false;
  std::atomic<bool> out_of_memory_{false};
  Side::Reading reading_;
};

}  // namespace mtdb::internal
