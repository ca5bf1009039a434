// SPDX-License-Identifier: Apache-2.0
#include "query/compare/places.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>

#include "query/compare/box_tree.h"
#include "query/compare/outward.h"

namespace mtdb::internal {
namespace {

bool Meet(const Box3d& a, const Box3d& b) {
  for (int i = 0; i < 3; ++i) {
    if (a.min[i] > b.max[i] || b.min[i] > a.max[i]) return false;
  }
  return true;
}

// Sets of numbers, each with its least member as its name.
class Groups {
 public:
  explicit Groups(size_t count) : parents_(count) {
    std::iota(parents_.begin(), parents_.end(), 0U);
  }
  uint32_t Of(uint32_t i) {
    while (parents_[i] != i) i = parents_[i] = parents_[parents_[i]];
    return i;
  }
  void Unite(uint32_t a, uint32_t b) {
    a = Of(a);
    b = Of(b);
    parents_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<uint32_t> parents_;
};

void Swallow(ComparePlace& place, const ComparePlace& other) {
  place.box.Add(other.box);
  if (other.verdict == CompareVerdict::kExceeds) place.verdict = other.verdict;
  if (other.distance.low > place.distance.low) {
    place.distance.low = other.distance.low;
    place.point = other.point;
  }
  place.distance.high = std::max(place.distance.high, other.distance.high);
  place.missing |= other.missing;
}

}  // namespace

void Places::Add(const ComparePlace& part) {
  places_.push_back(part);
  places_.back().missing = reach_ && part.distance.low > *reach_;
  if (places_.size() < kMost) return;
  Join(0);
  Box3d around;
  for (const ComparePlace& p : places_) around.Add(p.box);
  for (double within = Diagonal(around) * 0x1p-12; places_.size() > kMost / 2; within *= 2) {
    Join(within);
  }
}

void Places::Join(double within) {
  std::vector<Box3d> boxes;
  boxes.reserve(places_.size());
  for (const ComparePlace& p : places_) boxes.push_back(Grown(p.box, within));
  const BoxTree tree(boxes);
  Groups groups(boxes.size());
  for (uint32_t i = 0; i < boxes.size(); ++i) {
    tree.Any([&](const Box3d& node) { return Meet(node, boxes[i]); },
             [&](uint32_t place) {
               const uint32_t other = tree.order()[place];
               if (Meet(boxes[i], boxes[other])) groups.Unite(i, other);
               return false;
             });
  }
  for (uint32_t i = 0; i < boxes.size(); ++i) {
    if (groups.Of(i) != i) Swallow(places_[groups.Of(i)], places_[i]);
  }
  size_t kept = 0;
  for (uint32_t i = 0; i < boxes.size(); ++i) {
    if (groups.Of(i) == i) places_[kept++] = places_[i];
  }
  places_.resize(kept);
}

std::vector<ComparePlace> Places::Take() {
  Join(0);
  std::ranges::sort(places_, [](const ComparePlace& a, const ComparePlace& b) {
    if (a.distance.low != b.distance.low) return a.distance.low > b.distance.low;
    return a.distance.high > b.distance.high;
  });
  return std::move(places_);
}

}  // namespace mtdb::internal
