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
    members_.push_back({key, false});
    sets_.Add();
  }
  return number;
}

void SheetOrientation::Join(const SheetTurn& turn) {
  const ParitySets::Place a = sets_.Find(NumberOf(turn.a));
  const ParitySets::Place b = sets_.Find(NumberOf(turn.b));
  const bool turned = (a.turned != b.turned) != turn.turned;
  uint32_t first = a.first;
  uint32_t second = b.first;
  if (first == second) {
    members_[first].one_sided |= turned;
    return;
  }
  if (members_[second].key < members_[first].key) std::swap(first, second);
  sets_.Join(first, second, turned);
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

bool SheetOrientation::Turned(const std::array<uint32_t, 3>& vertices) {
  if (too_many_ || members_.empty()) return false;
  const uint64_t key = KeyOf(vertices[0], vertices[1], vertices[2]);
  const uint32_t number =
      numbers_.Find(HashOfNumber(key), [&](uint32_t n) { return members_[n].key == key; });
  if (number == kNone32) return false;
  const ParitySets::Place place = sets_.Find(number);
  return place.turned && !members_[place.first].one_sided;
}

}  // namespace mtdb::internal
