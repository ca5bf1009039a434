// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cstdint>
#include <numeric>
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
    for (const auto& [seat, edge] : ends) seats_.SetFixed(seat);
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
    SeatIndex::FanGroups joined{};
    std::iota(joined.begin(), joined.end(), 0u);
    for (const auto& [at, edge] : edges) {
      const auto fan_in = [&](uint32_t t) {
        uint32_t c = 0;
        while (seats_.seat(t, c) != seat) ++c;
        return joined[tile_[t].fan(c)];
      };
      const auto [first, second] = std::minmax({fan_in(edges_[edge].t), fan_in(edges_[edge].u)});
      std::replace(joined.begin(), joined.end(), second, first);
    }
    seats_.NumberFans(seat, joined);
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
