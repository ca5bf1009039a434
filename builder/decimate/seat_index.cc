// SPDX-License-Identifier: Apache-2.0
#include "builder/decimate/seat_index.h"

#include <algorithm>

#include "builder/disk/number_table.h"

namespace mtdb::internal {
namespace {

// Of a vertex with more triangles it is not asked.
constexpr uint32_t kMostCorners = 256;

}  // namespace

SeatIndex::SeatIndex(std::span<TileTriangle> tile)
    : tile_(tile), corner_seats_(3 * tile.size()), gone_(tile.size()) {
  NumberTable numbers(tile.size());
  uint32_t seats = 0;
  for (uint32_t t = 0; t < tile.size(); ++t) {
    for (uint32_t c = 0; c < 3; ++c) {
      const auto [number, fresh] = numbers.Add(tile[t].seat(c), seats);
      seats += fresh;
      corner_seats_[3 * t + c] = number;
    }
  }
  begin_.assign(seats + 1, 0);
  for (const uint32_t seat : corner_seats_) ++begin_[seat + 1];
  for (uint32_t s = 0; s < seats; ++s) begin_[s + 1] += begin_[s];
  corners_.resize(corner_seats_.size());
  std::vector<uint32_t> at(begin_.begin(), begin_.end() - 1);
  for (uint32_t i = 0; i < corners_.size(); ++i) corners_[at[corner_seats_[i]]++] = i;
}

// Whether exactly one triangle continues the fan beyond the edge that leaves (`out`) or enters the
// corner.
bool SeatIndex::IsPaired(uint32_t seat, uint32_t t, uint32_t c, bool out) const {
  const uint32_t vertex = tile_[t].vertices[c];
  const uint32_t far = tile_[t].vertices[(c + (out ? 1 : 2)) % 3];
  uint32_t found = 0;
  ForEachCorner(seat, [&](uint32_t other, uint32_t d) {
    if (other == t || tile_[other].vertices[d] != vertex) return;
    const uint32_t back = out ? (d + 2) % 3 : d;  // the edge of `other` that this would be
    const uint32_t end = out ? back : (d + 1) % 3;
    found += tile_[other].vertices[end] == far && tile_[other].order(back) == 0;
  });
  return found == 1;
}

bool SeatIndex::IsWhole(uint32_t seat) const {
  if (begin_[seat + 1] - begin_[seat] > kMostCorners) return false;
  uint32_t fans = 0, last_fans = 0;  // a bit each
  bool paired = true;
  ForEachCorner(seat, [&](uint32_t t, uint32_t c) {
    const uint32_t fan = 1u << tile_[t].fan(c);
    fans |= fan;
    if (!tile_[t].more_fans(c)) last_fans |= fan;
    paired = paired && (tile_[t].order(c) != 0 || IsPaired(seat, t, c, true)) &&
             (tile_[t].order((c + 2) % 3) != 0 || IsPaired(seat, t, c, false));
  });
  // The last fan is there, and all before it.
  return paired && last_fans != 0 && fans == 2 * last_fans - 1 &&
         (last_fans & (last_fans - 1)) == 0;
}

bool SeatIndex::IsFree(uint32_t seat) const {
  constexpr uint32_t kMost = 2;
  std::array<uint32_t, kMost> creases{};  // far ends
  uint32_t count = 0;
  bool known = true;
  std::array<std::array<uint32_t, kMost>, kMostOrder> ends{};  // of fans: edges at either crease
  uint32_t fans = 0;
  ForEachCorner(seat, [&](uint32_t t, uint32_t c) {
    const uint32_t fan = tile_[t].fan(c);
    fans |= 1u << fan;
    for (const bool out : {true, false}) {
      const uint32_t order = tile_[t].order(out ? c : (c + 2) % 3);
      if (order == 0) continue;
      const uint32_t far = this->seat(t, (c + (out ? 1 : 2)) % 3);
      const uint32_t place = static_cast<uint32_t>(
          std::find(creases.begin(), creases.begin() + count, far) - creases.begin());
      known = known && order < kMostOrder && place < kMost;
      if (!known) return;
      if (place == count) creases[count++] = far;
      ++ends[fan][place];
    }
  });
  if (!known || fans == 0) return false;
  if (count == 0) return fans == 1;
  if (count != kMost) return false;
  for (uint32_t fan = 0; fan < kMostOrder; ++fan) {
    if ((fans >> fan & 1) != 0 && ends[fan] != std::array<uint32_t, kMost>{1, 1}) return false;
  }
  return true;
}

void SeatIndex::NumberFans(uint32_t seat, const FanGroups& groups) {
  uint32_t used = 0;  // a bit a group
  ForEachCorner(seat, [&](uint32_t t, uint32_t c) { used |= 1u << groups[tile_[t].fan(c)]; });
  FanGroups numbers{};
  uint32_t count = 0;
  for (uint32_t group = 0; group < kMostOrder; ++group) {
    if ((used >> group & 1) != 0) numbers[group] = count++;
  }
  ForEachCorner(seat, [&](uint32_t t, uint32_t c) {
    const uint32_t first = tile_[t].seat(c);
    const uint32_t fan = numbers[groups[tile_[t].fan(c)]];
    tile_[t].vertices[c] = first + fan;
    tile_[t].set_fan(c, fan);
    tile_[t].set_more_fans(c, fan + 1 < count);
  });
}

void SeatIndex::SetFixed(uint32_t seat) {
  const bool fixed = !IsFree(seat);
  ForEachCorner(seat, [&](uint32_t t, uint32_t c) { tile_[t].set_fixed(c, fixed); });
}

}  // namespace mtdb::internal
