// SPDX-License-Identifier: Apache-2.0
#include "query/compare/places.h"

#include <algorithm>
#include <cstdint>

#include "query/compare/outward.h"
#include "query/compare/touching.h"

namespace mtdb::internal {
namespace {

constexpr size_t kLeastToJoin = 4096;  // parts at a time

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
  if (places_.size() >= std::max(2 * most_, kLeastToJoin)) JoinUntilFew();
}

void Places::JoinUntilFew() {
  Join(0);
  Box3d around;
  for (const ComparePlace& p : places_) around.Add(p.box);
  for (double within = Diagonal(around) * 0x1p-12; places_.size() > std::max<size_t>(most_, 1);
       within *= 2) {
    Join(within);
  }
}

void Places::Join(double within) {
  std::vector<Box3d> boxes;
  boxes.reserve(places_.size());
  for (const ComparePlace& p : places_) boxes.push_back(Grown(p.box, within));
  const std::vector<uint32_t> groups = TouchingGroups(boxes);
  for (uint32_t i = 0; i < boxes.size(); ++i) {
    if (groups[i] != i) Swallow(places_[groups[i]], places_[i]);
  }
  size_t kept = 0;
  for (uint32_t i = 0; i < boxes.size(); ++i) {
    if (groups[i] == i) places_[kept++] = places_[i];
  }
  places_.resize(kept);
}

std::vector<ComparePlace> Places::Take() {
  JoinUntilFew();
  std::ranges::sort(places_, [](const ComparePlace& a, const ComparePlace& b) {
    if (a.distance.low != b.distance.low) return a.distance.low > b.distance.low;
    return a.distance.high > b.distance.high;
  });
  return std::move(places_);
}

}  // namespace mtdb::internal
