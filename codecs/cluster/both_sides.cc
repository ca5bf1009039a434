// SPDX-License-Identifier: Apache-2.0
#include "codecs/cluster/both_sides.h"

#include <algorithm>
#include <array>
#include <span>
#include <utility>

#include "store/base/ids.h"

namespace mtdb {
namespace {

class SideShower {
 public:
  explicit SideShower(const Cluster& cluster)
      : told_(cluster), slots_(cluster.slots()), other_slots_(cluster.slots(), kNone32) {}

  // Puts what has other slots into `cluster`, which is the one that was told.
  std::vector<uint32_t> ShowIn(Cluster& cluster) {
    ShowListed();
    ShowStars();
    ShowHoles();
    std::vector<uint32_t> mirrors(next_, kNone32);
    shown_.removers.resize(next_);
    for (uint32_t slot = 0; slot < slots_.size(); ++slot) {
      shown_.removers[slots_[slot]] = told_.removers[slot];
      if (other_slots_[slot] == kNone32) continue;
      shown_.removers[other_slots_[slot]] = told_.removers[slot];
      mirrors[slots_[slot]] = other_slots_[slot];
      mirrors[other_slots_[slot]] = slots_[slot];
    }
    for (ExplicitArc& arc : cluster.explicit_arcs) arc.slot = slots_[arc.slot];
    cluster.in.triangles = std::move(shown_.in.triangles);
    cluster.in.two_sided.clear();
    if (!cluster.in.corner_places.empty()) ShowPlaces(cluster.in.corner_places);
    cluster.first_own_slot = shown_.first_own_slot;
    cluster.star_begin = std::move(shown_.star_begin);
    cluster.hole_begin = std::move(shown_.hole_begin);
    cluster.hole_slots = std::move(shown_.hole_slots);
    cluster.removers = std::move(shown_.removers);
    cluster.created_corners = std::move(shown_.created_corners);
    cluster.fans = std::move(shown_.fans);
    cluster.later_fans = std::move(shown_.later_fans);
    return mirrors;
  }

 private:
  // Calls f(star, place in the hole, triangles in the hole) for each fan of a node. For nodes in
  // ascending order; `later`: how many of later_fans were passed, 0 before the first.
  template <typename F>
  void ForEachFan(NodeIndex node, size_t& later, const F& f) const {
    const uint32_t end = told_.star_begin[node + 1];
    uint32_t hole = 0;
    for (uint32_t begin = told_.star_begin[node]; begin < end;) {
      const bool more = later < told_.later_fans.size() && told_.later_fans[later] < end;
      const uint32_t fan_end = more ? told_.later_fans[later++] : end;
      const bool several = more || hole > 0;
      const auto count =
          several ? fan_end - begin - 1 : static_cast<uint32_t>(told_.hole(node).size());
      f(IndexRange{begin, fan_end}, hole, count);
      hole += count;
      begin = fan_end;
    }
  }

  // The other side of a triangle has its last two corners exchanged.
  void ShowPlaces(std::vector<std::array<uint32_t, 3>>& places) const {
    std::vector<std::array<uint32_t, 3>> shown(next_);
    for (uint32_t slot = 0; slot < slots_.size(); ++slot) {
      const std::array<uint32_t, 3>& t = places[slot];
      shown[slots_[slot]] = t;
      if (other_slots_[slot] != kNone32) shown[other_slots_[slot]] = {t[0], t[2], t[1]};
    }
    places = std::move(shown);
  }

  void ShowListed() {
    for (uint32_t slot = 0; slot < told_.listed(); ++slot) {
      const auto [a, b, c] = told_.in.triangles[slot];
      slots_[slot] = next_++;
      shown_.in.triangles.push_back({a, b, c});
      if (!told_.in.two_sided[slot]) continue;
      other_slots_[slot] = next_++;
      shown_.in.triangles.push_back({a, c, b});
    }
    shown_.first_own_slot = told_.first_own_slot == 0 ? 0 : next_;
  }

  void ShowStars() {
    shown_.star_begin.push_back(next_);
    size_t later = 0;
    for (NodeIndex node = 0; node < told_.nodes(); ++node) {
      if (told_.crumb(node)) {
        ShowCrumb(node);
        continue;
      }
      const bool open = told_.boundary(node);
      shown_.fans.push_back(!open ? 0 : told_.fans.empty() ? 1 : told_.fans[node]);
      ForEachFan(node, later, [&](IndexRange star, uint32_t, uint32_t) {
        if (next_ != shown_.star_begin.back()) shown_.later_fans.push_back(next_);
        for (const uint32_t slot : star)
          slots_[slot] = ShowStar(told_.created_triangle(node, slot));
        if (told_.in.two_sided[star.front()]) ShowOtherSide(node, star, open);
      });
      shown_.star_begin.push_back(next_);
    }
  }
  // Each triangle with its other side behind it.
  void ShowCrumb(NodeIndex node) {
    for (const uint32_t slot : told_.shape(node).created) {
      const auto [a, b, c] = told_.created_triangle(node, slot);
      slots_[slot] = ShowStar({a, b, c});
      if (told_.in.two_sided[slot]) other_slots_[slot] = ShowStar({a, c, b});
    }
    shown_.fans.push_back(told_.fans[node]);
    shown_.star_begin.push_back(next_);
  }
  // The ring the other way round. Where it is closed, the triangle that closes it stays the last.
  void ShowOtherSide(NodeIndex node, IndexRange star, bool open) {
    shown_.later_fans.push_back(next_);
    const auto show = [&](uint32_t slot) {
      const auto [apex, a, b] = told_.created_triangle(node, slot);
      other_slots_[slot] = ShowStar({apex, b, a});
    };
    for (uint32_t slot = open ? star.last : star.last - 1; slot-- > star.first;) show(slot);
    if (!open) show(star.last - 1);
  }
  uint32_t ShowStar(const std::array<uint32_t, 3>& corners) {
    shown_.created_corners.push_back(corners);
    return next_++;
  }

  void ShowHoles() {
    shown_.hole_begin.push_back(0);
    std::vector<uint32_t>& slots = shown_.hole_slots;
    size_t later = 0;
    for (NodeIndex node = 0; node < told_.nodes(); ++node) {
      if (told_.crumb(node)) {
        for (const uint32_t slot : told_.hole(node)) {
          slots.push_back(slots_[slot]);
          if (told_.in.two_sided[slot]) slots.push_back(other_slots_[slot]);
        }
        shown_.hole_begin.push_back(static_cast<uint32_t>(slots.size()));
        continue;
      }
      ForEachFan(node, later, [&](IndexRange, uint32_t first, uint32_t count) {
        const std::span<const uint32_t> hole = told_.hole(node).subspan(first, count);
        for (const uint32_t slot : hole) slots.push_back(slots_[slot]);
        if (!told_.in.two_sided[hole.front()]) return;
        for (const uint32_t slot : hole) slots.push_back(other_slots_[slot]);
      });
      shown_.hole_begin.push_back(static_cast<uint32_t>(slots.size()));
    }
  }

  const Cluster& told_;
  std::vector<uint32_t> slots_, other_slots_;  // of the told slots: where either side is shown
  Cluster shown_;                              // what ShowIn hands on
  uint32_t next_ = 0;                          // slot
};

}  // namespace

std::vector<uint32_t> ShowBothSides(Cluster& cluster) {
  return SideShower(cluster).ShowIn(cluster);
}

}  // namespace mtdb
