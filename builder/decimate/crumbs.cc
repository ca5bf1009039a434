// SPDX-License-Identifier: Apache-2.0
#include "builder/decimate/crumbs.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <numeric>
#include <span>
#include <tuple>
#include <utility>

#include "builder/decimate/near_triangles.h"
#include "builder/decimate/seat_index.h"
#include "builder/disk/disjoint_sets.h"
#include "builder/disk/number_table.h"
#include "codecs/cluster/cluster_limits.h"
#include "store/base/geometry.h"

namespace mtdb::internal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Parts of a tile between creases: triangles that share vertices' numbers.
struct Parts {
  std::vector<uint32_t> part_of;                 // of triangles; kNone32: of no small one
  std::vector<std::vector<uint32_t>> triangles;  // of small ones
};

// Whether each edge inside of a sheet has both of its triangles in the part.
bool IsClosedByCreases(std::span<const TileTriangle> tile, std::span<const uint32_t> part) {
  const auto runs_back = [&](uint32_t from, uint32_t to) {
    return std::ranges::any_of(part, [&](uint32_t t) {
      const std::array<uint32_t, 3>& v = tile[t].vertices;
      return (v[0] == to && v[1] == from) || (v[1] == to && v[2] == from) ||
             (v[2] == to && v[0] == from);
    });
  };
  return std::ranges::all_of(part, [&](uint32_t t) {
    for (uint32_t c = 0; c < 3; ++c) {
      if (tile[t].order(c) != 0) continue;
      if (!runs_back(tile[t].vertices[c], tile[t].vertices[(c + 1) % 3])) return false;
    }
    return true;
  });
}

Parts FindSmallParts(std::span<const TileTriangle> tile) {
  const auto n = static_cast<uint32_t>(tile.size());
  NumberTable numbers(n);
  DisjointSets sets(n);
  for (uint32_t t = 0; t < n; ++t) {
    for (const uint32_t v : tile[t].vertices) {
      const auto [first, fresh] = numbers.Add(v, t);
      if (!fresh) sets.Join(first, t);
    }
  }
  std::vector<uint32_t> sizes(n);
  for (uint32_t t = 0; t < n; ++t) ++sizes[sets.Find(t)];
  Parts parts;
  parts.part_of.assign(n, kNone32);
  std::vector<uint32_t>& part_of = parts.part_of;
  for (uint32_t t = 0; t < n; ++t) {
    const uint32_t first = sets.Find(t);
    if (sizes[first] > kMostCrumbTriangles) continue;
    if (first == t) {
      part_of[t] = static_cast<uint32_t>(parts.triangles.size());
      parts.triangles.emplace_back();
    }
    part_of[t] = part_of[first];
    parts.triangles[part_of[t]].push_back(t);
  }
  // What the tile's seam cuts off is none.
  uint32_t left = 0;
  for (std::vector<uint32_t>& part : parts.triangles) {
    const bool whole = IsClosedByCreases(tile, part);
    for (const uint32_t t : part) part_of[t] = whole ? left : kNone32;
    if (whole) std::swap(parts.triangles[left++], part);
  }
  parts.triangles.resize(left);
  return parts;
}

class CrumbRemover {
 public:
  CrumbRemover(const Grid& grid, const CrumbLimits& limits, TriangleBlock& block, Parts parts,
               CrumbCounts* counts)
      : grid_(grid),
        limits_(limits),
        block_(block),
        tile_(block.triangles),
        parts_(std::move(parts)),
        counts_(counts),
        seats_(tile_),
        near_(limits.error),
        uses_(tile_.size()),
        stays_(parts_.triangles.size()) {}

  std::vector<Crumb> Run() {
    for (uint32_t part = 0; part < parts_.triangles.size(); ++part) {
      if (stays_[part] == 0 && Look(parts_.triangles[part])) Remove();
    }
    if (!crumbs_.empty()) LeaveGone();
    return std::move(crumbs_);
  }

 private:
  struct Edge {
    uint32_t a, b;  // seats
    friend auto operator<=>(const Edge&, const Edge&) = default;
  };

  bool InPart(uint32_t t) const {
    return std::ranges::find(part_.triangles, t) != part_.triangles.end();
  }
  Vec3d Place(Vec3i p) const { return grid_.is_linear() ? ToDouble(p) : grid_.Position(p); }

  // True when the part may vanish, by part_.triggers and part_.error.
  bool Look(std::span<const uint32_t> part) {
    part_.triangles = part;
    if (!FindVertices() || !LeavesNoGap()) return false;
    if (!FindEdges() || !KeepsClosed()) return false;
    part_.triggers.clear();
    if (!(part_.hung.empty() ? FindNearTrigger() : FindTriggers())) return false;
    part_.error = kInfinity;
    for (const uint32_t t : part_.triggers) part_.error = std::min(part_.error, FarthestFrom(t));
    double accumulated = 0;
    for (const uint32_t t : part_.triangles)
      accumulated = std::max<double>(accumulated, tile_[t].error);
    part_.error += accumulated;
    return part_.error <= limits_.error;
  }

  // Sets part_.corners and part_.hung. False when one is not whole.
  bool FindVertices() {
    part_.corners.clear();
    for (const uint32_t t : part_.triangles) {
      for (uint32_t c = 0; c < 3; ++c) part_.corners.push_back(seats_.seat(t, c));
    }
    std::sort(part_.corners.begin(), part_.corners.end());
    part_.corners.erase(std::unique(part_.corners.begin(), part_.corners.end()),
                        part_.corners.end());
    part_.hung.clear();
    for (const uint32_t seat : part_.corners) {
      if (!seats_.IsWhole(seat)) return false;
      bool shared = false;
      seats_.ForEachCorner(seat, [&](uint32_t t, uint32_t) { shared |= !InPart(t); });
      if (shared) part_.hung.push_back(seat);
    }
    return true;
  }

  // Where fans keep their numbers, those that go have to be the last ones.
  bool LeavesNoGap() const {
    if (limits_.fresh()) return true;
    return std::ranges::all_of(part_.hung, [&](uint32_t seat) {
      uint32_t last_left = 0, first_gone = kMostOrder;
      seats_.ForEachCorner(seat, [&](uint32_t t, uint32_t c) {
        const uint32_t fan = tile_[t].fan(c);
        if (InPart(t)) first_gone = std::min(first_gone, fan);
        if (!InPart(t)) last_left = std::max(last_left, fan);
      });
      return last_left < first_gone;
    });
  }

  // The edges by which the part hangs on others. False when it goes on beyond one of them, since
  // what lay between has vanished.
  bool FindEdges() {
    part_.edges.clear();
    for (const uint32_t t : part_.triangles) {
      for (uint32_t side = 0; side < 3; ++side) {
        if (tile_[t].order(side) < 2) continue;
        const auto [a, b] = std::minmax({seats_.seat(t, side), seats_.seat(t, (side + 1) % 3)});
        uint32_t triangles = 0;
        uint32_t other = kNone32, other_side = 0;
        seats_.ForEachAtEdge(a, b, [&](uint32_t u, uint32_t u_side) {
          ++triangles;
          if (InPart(u)) return;
          other = u;
          other_side = u_side;
        });
        if (other == kNone32) continue;
        const bool alike = tile_[other].two_sided() == tile_[t].two_sided();
        const bool against = seats_.seat(other, other_side) != seats_.seat(t, side);
        if (triangles == 2 && alike && (against || tile_[t].two_sided())) return false;
        part_.edges.push_back({a, b});
      }
    }
    std::sort(part_.edges.begin(), part_.edges.end());
    part_.edges.erase(std::unique(part_.edges.begin(), part_.edges.end()), part_.edges.end());
    return true;
  }

  // A surface that is closed there, with as many one-sided triangles one way as the other, does not
  // get a hole.
  bool KeepsClosed() const {
    return std::ranges::all_of(part_.edges, [&](const Edge& e) {
      int before = 0, after = 0;
      seats_.ForEachAtEdge(e.a, e.b, [&](uint32_t t, uint32_t side) {
        if (tile_[t].two_sided()) return;
        const int way = seats_.seat(t, side) == e.a ? 1 : -1;
        before += way;
        if (!InPart(t)) after += way;
      });
      return std::abs(after) <= std::abs(before);
    });
  }

  bool Has(uint32_t t, uint32_t seat) const {
    return seats_.seat(t, 0) == seat || seats_.seat(t, 1) == seat || seats_.seat(t, 2) == seat;
  }
  // What it stands for may only be raised where it is itself a part of the surface.
  bool MayTrigger(uint32_t t) const {
    return !InPart(t) && (limits_.fresh() || limits_.own[t] != 0);
  }
  // Which of two to take for a trigger: one that may not vanish itself, and serves few.
  bool IsBetter(uint32_t t, uint32_t than) const {
    if (than == kNone32) return true;
    const auto rank = [&](uint32_t u) {
      return std::tuple(parts_.part_of[u] != kNone32, uses_[u], u);
    };
    return rank(t) < rank(than);
  }

  // Triangles that have all edges and points by which the part hangs.
  bool FindTriggers() {
    const auto add = [&](uint32_t best) {
      if (best == kNone32 || part_.triggers.size() == kMostCrumbTriggers) return false;
      part_.triggers.push_back(best);
      return true;
    };
    for (const Edge& e : part_.edges) {
      const bool known = std::ranges::any_of(
          part_.triggers, [&](uint32_t t) { return Has(t, e.a) && Has(t, e.b); });
      if (known) continue;
      uint32_t best = kNone32;
      seats_.ForEachAtEdge(e.a, e.b, [&](uint32_t t, uint32_t) {
        if (MayTrigger(t) && IsBetter(t, best)) best = t;
      });
      if (!add(best)) return false;
    }
    for (const uint32_t seat : part_.hung) {
      if (std::ranges::any_of(part_.triggers, [&](uint32_t t) { return Has(t, seat); })) continue;
      uint32_t best = kNone32;
      seats_.ForEachCorner(seat, [&](uint32_t t, uint32_t) {
        if (MayTrigger(t) && IsBetter(t, best)) best = t;
      });
      if (!add(best)) return false;
    }
    return true;
  }

  Triangle3d CornersOf(uint32_t t) const {
    return {Place(tile_[t].positions[0]), Place(tile_[t].positions[1]),
            Place(tile_[t].positions[2])};
  }
  // How far the part's farthest point is from a triangle.
  double FarthestFrom(uint32_t t) const {
    const Triangle3d triangle = CornersOf(t);
    double squared = 0;
    for (const uint32_t u : part_.triangles) {
      for (const Vec3d& p : CornersOf(u)) {
        squared = std::max(squared,
                           SquaredDistancePointTriangle(p, triangle[0], triangle[1], triangle[2]));
      }
    }
    return std::sqrt(squared);
  }

  bool FindNearTrigger() {
    if (near_.empty()) {
      for (uint32_t t = 0; t < tile_.size(); ++t) near_.Add(t, CornersOf(t));
      near_.End();
    }
    Box3d box;
    for (const uint32_t t : part_.triangles) {
      for (const Vec3d& p : CornersOf(t)) box.Add(p);
    }
    uint32_t best = kNone32;
    double least = limits_.error;
    near_.ForEachNear(box, [&](uint32_t t) {
      if (seats_.gone(t) || !MayTrigger(t)) return;
      const double distance = FarthestFrom(t);
      if (distance > least || (distance == least && best < t)) return;
      least = distance;
      best = t;
    });
    if (best == kNone32) return false;
    part_.triggers.push_back(best);
    return true;
  }

  void Remove() {
    Crumb& crumb = crumbs_.emplace_back();
    crumb.triggers = part_.triggers;
    const size_t row = block_.rows.size() / (3 * tile_.size());
    for (const uint32_t t : part_.triangles) {
      crumb.triangles.push_back(tile_[t]);
      crumb.height = std::max(crumb.height, tile_[t].height);
      const auto begin = block_.rows.begin() + static_cast<std::ptrdiff_t>(3 * t * row);
      crumb.rows.insert(crumb.rows.end(), begin, begin + static_cast<std::ptrdiff_t>(3 * row));
      seats_.Remove(t);
    }
    for (const uint32_t t : part_.triggers) {
      part_.error = std::max<double>(part_.error, tile_[t].error);
      crumb.height = std::max(crumb.height, tile_[t].height);
      ++uses_[t];
      if (parts_.part_of[t] != kNone32) stays_[parts_.part_of[t]] = 1;
    }
    ++crumb.height;
    crumb.error = part_.error;
    for (const uint32_t t : part_.triggers) {
      // Not below the bound.
      tile_[t].error =
          std::nextafter(static_cast<float>(part_.error), std::numeric_limits<float>::max());
      tile_[t].height = crumb.height;
    }
    Count();
    for (const auto& [a, b] : part_.edges) SetOrder(a, b);
    SeatIndex::FanGroups each{};  // a group
    std::iota(each.begin(), each.end(), 0u);
    for (const uint32_t seat : part_.hung) seats_.NumberFans(seat, each);
    for (const uint32_t seat : part_.hung) seats_.SetFixed(seat);
  }

  void SetOrder(uint32_t a, uint32_t b) {
    uint32_t order = 0;
    seats_.ForEachAtEdge(a, b, [&](uint32_t, uint32_t) { ++order; });
    seats_.ForEachAtEdge(a, b, [&](uint32_t t, uint32_t side) {
      tile_[t].set_order(side, std::min(order, kMostOrder));
    });
  }

  // The border's loops of the part that no edge of what is left goes on.
  void Count() {
    counts_->components += part_.hung.empty();
    const auto place_of = [&](uint32_t seat) {
      return static_cast<uint32_t>(
          std::lower_bound(part_.corners.begin(), part_.corners.end(), seat) -
          part_.corners.begin());
    };
    DisjointSets loops(part_.corners.size());
    std::vector<uint8_t> at_border(part_.corners.size()), goes_on(part_.corners.size());
    for (const uint32_t t : part_.triangles) {
      for (uint32_t side = 0; side < 3; ++side) {
        if (tile_[t].order(side) != 1 || tile_[t].two_sided()) continue;
        const uint32_t a = place_of(seats_.seat(t, side));
        const uint32_t b = place_of(seats_.seat(t, (side + 1) % 3));
        loops.Join(a, b);
        at_border[a] = at_border[b] = 1;
      }
    }
    const auto is_border = [&](uint32_t t, uint32_t side) {
      return tile_[t].order(side) == 1 && !tile_[t].two_sided();
    };
    for (const uint32_t seat : part_.hung) {
      if (at_border[place_of(seat)] == 0) continue;
      seats_.ForEachCorner(seat, [&](uint32_t t, uint32_t c) {
        if (is_border(t, c) || is_border(t, (c + 2) % 3)) {
          goes_on[loops.Find(place_of(seat))] = 1;
        }
      });
    }
    for (uint32_t v = 0; v < part_.corners.size(); ++v) {
      counts_->border_loops += at_border[v] != 0 && loops.Find(v) == v && goes_on[v] == 0;
    }
  }

  // Takes what is gone out of the tile.
  void LeaveGone() {
    const size_t row = block_.rows.size() / (3 * tile_.size());
    std::vector<uint32_t> places(tile_.size(), kNone32);
    uint32_t left = 0;
    for (uint32_t t = 0; t < tile_.size(); ++t) {
      if (seats_.gone(t)) continue;
      places[t] = left;
      tile_[left] = tile_[t];
      std::copy_n(block_.rows.begin() + static_cast<std::ptrdiff_t>(3 * t * row), 3 * row,
                  block_.rows.begin() + static_cast<std::ptrdiff_t>(3 * left * row));
      ++left;
    }
    tile_.resize(left);
    block_.rows.resize(3 * left * row);
    for (Crumb& crumb : crumbs_) {
      for (uint32_t& t : crumb.triggers) t = places[t];
    }
  }

  const Grid& grid_;
  const CrumbLimits& limits_;
  TriangleBlock& block_;
  std::vector<TileTriangle>& tile_;
  const Parts parts_;
  CrumbCounts* const counts_;
  SeatIndex seats_;
  NearTriangles near_;
  std::vector<uint32_t> uses_;  // of triangles as triggers
  std::vector<uint8_t> stays_;  // of parts: one of its triangles is a trigger
  std::vector<Crumb> crumbs_;
  // The part at hand.
  struct Part {
    std::span<const uint32_t> triangles;
    std::vector<uint32_t> corners, hung;  // seats, ascending; those that others have, too
    std::vector<Edge> edges;
    std::vector<uint32_t> triggers;
    double error = 0;
  };
  Part part_;
};

}  // namespace

bool HasManyCrumbs(std::span<const TileTriangle> tile) {
  constexpr size_t kFew = 8;
  constexpr size_t kTrianglesEach = 40;
  const size_t crumbs = FindSmallParts(tile).triangles.size();
  return crumbs >= kFew && crumbs * kTrianglesEach >= tile.size();
}

std::vector<Crumb> RemoveCrumbs(const Grid& grid, const CrumbLimits& limits, TriangleBlock& tile,
                                CrumbCounts* counts) {
  Parts parts = FindSmallParts(tile.triangles);
  if (parts.triangles.empty()) return {};
  return CrumbRemover(grid, limits, tile, std::move(parts), counts).Run();
}

}  // namespace mtdb::internal
