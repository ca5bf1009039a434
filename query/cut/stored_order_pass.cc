// SPDX-License-Identifier: Apache-2.0
#include "query/cut/stored_order_pass.h"

#include <algorithm>
#include <span>

namespace mtdb::internal {

uint64_t StoredOrderPass::Run(CutUnit& u, const LoadedUnit& unit) {
  u_ = &u;
  unit_ = &unit;
  forced_ = nodes_ = vertices_ = triangles_ = 0;
  const CompactCluster& cluster = unit.cluster;
  const Box3d box = judge_.ModelBox(cut_.index().unit(u.id).bounds);
  const uint8_t largest = cut_.LargestCode(u.id);
  codes_ = judge_.CodesIn(box, largest);
  if (largest <= codes_.valid) return 0;
  if (judge_.ActivityIn(box, judge_.Bound(largest)) == Activity::kNone) return 0;
  const bool all_active = judge_.ActivityIn(box, 0) == Activity::kAll;
  Load();
  // First a list, since codes are hard to predict.
  candidates_.resize(cluster.nodes());
  size_t count = 0;
  for (NodeIndex node = 0; node < cluster.nodes(); ++node) {
    candidates_[count] = node;
    count += cluster.error_codes[node] > codes_.valid ? 1 : 0;
  }
  for (size_t i = 0; i < count; ++i) {
    const NodeIndex node = candidates_[i];
    const std::span<const LocalNumber> hole = cluster.hole(node);
    uint32_t present = 0;
    for (const uint32_t slot : hole) present += present_[slot];
    if (present == 0) continue;
    const bool sure = all_active && cluster.error_codes[node] > codes_.undecided;
    if (!sure && !Wanted(node)) continue;
    if (present == hole.size()) {
      Apply(node);
    } else {
      ApplyAfterAncestors(node);
    }
  }
  Store();
  cut_.CountInserted(nodes_, vertices_, triangles_);
  return forced_;
}

void StoredOrderPass::Load() {
  parents_.clear();
  for (const UnitId id : unit_->parents) {
    CutUnit* const parent = cut_.Find(id);
    const bool none = parent == nullptr || parent->present.empty();
    parents_.push_back(none ? Parent{} : Parent{&parent->present, parent->first_own});
  }
  const uint32_t first_own = u_->first_own;
  present_.assign(size_t{first_own} + u_->present.size() + kLongStar, 0);
  for (uint32_t slot = 0; slot < first_own; ++slot) {
    const SlotOrigin& origin = unit_->origins[slot];
    const Parent& parent = parents_[origin.parent];
    present_[slot] =
        parent.present != nullptr && parent.present->Test(origin.slot - parent.first_own);
  }
  if (u_->applied_count == 0) return;
  u_->present.ForEach([&](uint32_t own) { present_[first_own + own] = 1; });
}

void StoredOrderPass::Store() {
  for (uint32_t slot = 0; slot < u_->first_own; ++slot) {
    const SlotOrigin& origin = unit_->origins[slot];
    const Parent& parent = parents_[origin.parent];
    if (parent.present != nullptr) {
      parent.present->Keep(origin.slot - parent.first_own, present_[slot] != 0);
    }
  }
  u_->present.Pack(present_.data() + u_->first_own);
}

// The bounds of the hole decide most cases.
bool StoredOrderPass::Wanted(NodeIndex node) const {
  const CompactCluster& cluster = unit_->cluster;
  const uint8_t code = cluster.error_codes[node];
  if (!judge_.whole()) {
    const Box3d box = judge_.ModelBox(unit_->hole_bounds(node));
    const Region& region = *judge_.region();
    if (!judge_.meter().Spend(1) || !region.BoxWithin(box, judge_.Bound(code))) return false;
    if (code > codes_.undecided && region.BoxCovers(box, 0)) return true;
  }
  for (const uint32_t slot : cluster.hole(node)) {
    if (present_[slot] != 0 && judge_.Refused(*unit_, slot, unit_->creator(slot), code))
      return true;
  }
  return false;
}

// The hole is present.
void StoredOrderPass::Apply(NodeIndex node) {
  const CompactCluster& cluster = unit_->cluster;
  const std::span<const LocalNumber> hole = cluster.hole(node);
  for (const uint32_t slot : hole) present_[slot] = 0;
  const uint32_t begin = cluster.star_begin[node];
  const uint32_t size = cluster.star_begin[node + 1] - begin;
  uint8_t* const star = present_.data() + begin;
  if (size <= kLongStar) {
    // Of no varying length, which would be hard to predict.
    for (uint32_t j = 0; j < kLongStar; ++j) star[j] |= j < size ? 1 : 0;
  } else {
    std::fill_n(star, size, uint8_t{1});
  }
  const IndexRange numbers = cluster.numbers_of(node);
  for (const NodeIndex number : numbers) u_->applied.Set(number);
  if (cluster.crumb(node)) [[unlikely]]
    CutState::NoteCrumb(*u_, cluster, node);
  u_->applied_count += numbers.size();
  nodes_ += numbers.size();
  vertices_ += unit_->cluster.created_vertices(node).size();
  triangles_ += size - hole.size();
}

void StoredOrderPass::ApplyAfterAncestors(NodeIndex target) {
  const CompactCluster& cluster = unit_->cluster;
  missing_.assign(1, target);
  while (!missing_.empty()) {
    const NodeIndex node = missing_.back();
    if (u_->applied.Test(node)) {
      missing_.pop_back();
      continue;
    }
    const size_t depth = missing_.size();
    for (const uint32_t slot : cluster.hole(node)) {
      if (present_[slot] != 0) continue;
      if (slot < u_->first_own || u_->applied.Test(unit_->creator(slot))) {
        u_->wanted.Set(target);
        return;
      }
      missing_.push_back(unit_->creator(slot));
    }
    if (missing_.size() > depth) continue;
    Apply(node);
    forced_ += node == target || judge_.RefusesAny(*unit_, node) ? 0 : 1;
    for (uint32_t slot = cluster.star_begin[node]; slot < cluster.star_begin[node + 1]; ++slot) {
      const uint32_t remover = cluster.removers[slot];
      // Later nodes have their turn.
      if (remover >= target) continue;
      if (judge_.Refused(*unit_, slot, node, cluster.error_codes[remover])) u_->wanted.Set(remover);
    }
  }
}

}  // namespace mtdb::internal
