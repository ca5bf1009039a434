// SPDX-License-Identifier: Apache-2.0
#include "builder/surface/sheet_orientation.h"

#include <algorithm>
#include <utility>

#include "store/base/hash.h"

namespace mtdb::internal {

uint64_t SheetOrientation::KeyOf(uint32_t a, uint32_t b, uint32_t c) {
  std::array<uint32_t, 3> v = {a, b, c};
  std::sort(v.begin(), v.end());
  return Mix64(Mix64(uint64_t{v[0]} << 32 | v[1]) ^ v[2]);
}

uint32_t SheetOrientation::NumberOf(uint64_t key) {
  if (2 * (members_.size() + 1) > numbers_.size()) {
    numbers_.Resize(2 * numbers_.size(), [&](uint32_t n) { return HashOfNumber(members_[n].key); });
  }
  uint32_t& number =
      numbers_.Find(HashOfNumber(key), [&](uint32_t n) { return members_[n].key == key; });
  if (number == kNone32) {
    number = static_cast<uint32_t>(members_.size());
    members_.push_back({key, number, false, false});
  }
  return number;
}

SheetOrientation::Place SheetOrientation::Find(uint32_t member) const {
  Place place{member, false};
  while (members_[place.first].parent != place.first) {
    place.turned ^= members_[place.first].turned;
    place.first = members_[place.first].parent;
  }
  return place;
}

void SheetOrientation::Join(const SheetTurn& turn) {
  const uint32_t numbers[2] = {NumberOf(turn.a), NumberOf(turn.b)};
  const Place places[2] = {Find(numbers[0]), Find(numbers[1])};
  for (size_t i = 0; i < 2; ++i) {  // later ones find them at once
    Member& member = members_[numbers[i]];
    if (numbers[i] == places[i].first) continue;
    member.parent = places[i].first;
    member.turned = places[i].turned;
  }
  const bool turned = places[0].turned != places[1].turned;
  uint32_t first = places[0].first;
  uint32_t second = places[1].first;
  if (first == second) {
    members_[first].one_sided |= turned != turn.turned;
    return;
  }
  if (members_[second].key < members_[first].key) std::swap(first, second);
  members_[second].parent = first;
  members_[second].turned = turned != turn.turned;
  members_[first].one_sided |= members_[second].one_sided;
}

void SheetOrientation::Add(std::span<const SheetTurn> turns) {
  if (turns.empty()) return;
  const std::lock_guard lock(mutex_);
  for (const SheetTurn& turn : turns) {
    if (too_many_ || members_.size() + 2 > most_) {
      too_many_ = true;
      return;
    }
    Join(turn);
  }
}

bool SheetOrientation::Turned(const std::array<uint32_t, 3>& vertices) const {
  if (too_many_ || members_.empty()) return false;
  const uint64_t key = KeyOf(vertices[0], vertices[1], vertices[2]);
  const uint32_t number =
      numbers_.Find(HashOfNumber(key), [&](uint32_t n) { return members_[n].key == key; });
  if (number == kNone32) return false;
  const Place place = Find(number);
  return place.turned && !members_[place.first].one_sided;
}

}  // namespace mtdb::internal
