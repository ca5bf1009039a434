// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "builder/decimate/crumbs.h"
#include "builder/decimate/seat_index.h"

namespace mtdb::internal {
namespace {

class SheetJoiner {
 public:
  explicit SheetJoiner(std::vector<TileTriangle>& tile) : tile_(tile), seats_(tile) {
    whole_.assign(seats_.seats(), Whole::kUnknown);
  }

  void Run() {
    FindEdges();
    if (edges_.empty()) return;
    std::vector<std::pair<uint32_t, uint32_t>> ends;  // seat, edge
    for (uint32_t i = 0; i < edges_.size(); ++i) {
      const Edge& e = edges_[i];
      tile_[e.t].set_order(e.side, 0);
      tile_[e.u].set_order(e.other_side, 0);
      ends.emplace_back(e.a, i);
      ends.emplace_back(e.b, i);
    }
    std::sort(ends.begin(), ends.end());
    for (size_t i = 0, end = 0; i < ends.size(); i = end) {
      while (end < ends.size() && ends[end].first == ends[i].first) ++end;
      JoinFans(ends[i].first, std::span(ends).subspan(i, end - i));
    }
    for (const auto& [seat, edge] : ends) {
      const bool fixed = !seats_.IsFree(seat);
      seats_.ForEachCorner(seat, [&](uint32_t t, uint32_t c) { tile_[t].set_fixed(c, fixed); });
    }
  }

 private:
  enum class Whole : uint8_t { kUnknown, kNo, kYes };
  struct Edge {
    uint32_t a, b;           // seats
    uint32_t t, side;        // a triangle at it, in which it runs from a to b
    uint32_t u, other_side;  // the other one
  };

  bool IsWhole(uint32_t seat) {
    Whole& known = whole_[seat];
    if (known == Whole::kUnknown) known = seats_.IsWhole(seat) ? Whole::kYes : Whole::kNo;
    return known == Whole::kYes;
  }

  void FindEdges() {
    for (uint32_t t = 0; t < tile_.size(); ++t) {
      for (uint32_t side = 0; side < 3; ++side) {
        if (tile_[t].order(side) != 2) continue;
        const uint32_t a = seats_.seat(t, side);
        const uint32_t b = seats_.seat(t, (side + 1) % 3);
        Edge edge{a, b, t, side, kNone32, 0};
        uint32_t triangles = 0;
        seats_.ForEachAtEdge(a, b, [&](uint32_t u, uint32_t other_side) {
          ++triangles;
          if (u != t) edge.u = u;
          if (u != t) edge.other_side = other_side;
        });
        if (triangles != 2 || edge.u < t || tile_[edge.u].two_sided() != tile_[t].two_sided() ||
            seats_.seat(edge.u, edge.other_side) != b || !IsWhole(a) || !IsWhole(b)) {
          continue;
        }
        edges_.push_back(edge);
      }
    }
  }

  // Fans that an edge of order 0 joins get one number; the first of all stays the first.
  void JoinFans(uint32_t seat, std::span<const std::pair<uint32_t, uint32_t>> edges) {
    std::array<uint32_t, kMostOrder> joined{};
    for (uint32_t f = 0; f < kMostOrder; ++f) joined[f] = f;
    const auto find = [&](uint32_t f) {
      while (joined[f] != f) f = joined[f];
      return f;
    };
    uint32_t fans = 0;
    seats_.ForEachCorner(seat, [&](uint32_t t, uint32_t c) { fans |= 1u << tile_[t].fan(c); });
    for (const auto& [at, edge] : edges) {
      const Edge& e = edges_[edge];
      const auto fan_in = [&](uint32_t t) {
        uint32_t c = 0;
        while (seats_.seat(t, c) != seat) ++c;
        return find(tile_[t].fan(c));
      };
      const auto [first, second] = std::minmax({fan_in(e.t), fan_in(e.u)});
      joined[second] = first;
    }
    std::array<uint32_t, kMostOrder> numbers{};
    uint32_t count = 0;
    for (uint32_t f = 0; f < kMostOrder; ++f) {
      if ((fans >> f & 1) == 0) continue;
      if (find(f) == f) numbers[f] = count++;
    }
    seats_.ForEachCorner(seat, [&](uint32_t t, uint32_t c) {
      const uint32_t first = tile_[t].seat(c);
      const uint32_t fan = numbers[find(tile_[t].fan(c))];
      tile_[t].vertices[c] = first + fan;
      tile_[t].set_fan(c, fan);
      tile_[t].set_more_fans(c, fan + 1 < count);
    });
  }

  std::vector<TileTriangle>& tile_;
  SeatIndex seats_;
  std::vector<Whole> whole_;
  std::vector<Edge> edges_;
};

}  // namespace

void JoinSheets(std::vector<TileTriangle>& tile) {
  const bool any = std::ranges::any_of(tile, [](const TileTriangle& t) {
    return t.order(0) == 2 || t.order(1) == 2 || t.order(2) == 2;
  });
  if (any) SheetJoiner(tile).Run();
}

}  // namespace mtdb::internal
