// SPDX-License-Identifier: Apache-2.0
// The definitions of query/query.h, run naively on the plain DAG; and random queries.
#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>
#include <tuple>
#include <vector>

#include "query/cut.h"
#include "query/query.h"
#include "tests/query/mt_fixture.h"
#include "tests/query/random_regions.h"

namespace mtdb::testing {

class Oracle {
 public:
  // Without the nodes of clusters that are missing, in a set that holds all that come from them.
  Oracle(const MtFixture& fixture, const Query& query, const std::vector<bool>& missing = {})
      : f_(fixture), query_(query) {
    for (const InMemoryMt::Triangle& t : f_.mt.triangles) {
      const InMemoryMt::Node* const remover =
          t.remover < 0 ? nullptr : &f_.mt.nodes[static_cast<size_t>(t.remover)];
      const bool removable = remover != nullptr && (missing.empty() || !missing[remover->cluster]);
      const double b = Bound(remover == nullptr ? 0
                             : removable        ? remover->code
                                         : f_.source->index_.unit(remover->cluster).error_code_max);
      const Triangle3d corners = f_.Corners(t);
      const bool active = query.region == nullptr || query.region->Within(corners, b);
      active_.push_back(active);
      wanted_.push_back(removable && Refused(corners, b));
      bounds_.push_back(b);
    }
  }

  // b(t), where a missing cluster counts with its largest error.
  double bound(uint32_t triangle) const { return bounds_[triangle]; }

  // b(t), by the code of e(t).
  double Bound(uint8_t code) const {
    return f_.source->record_.grid.Error(code) + f_.source->record_.rounding_error;
  }

  bool active(uint32_t triangle) const { return active_[triangle]; }
  // Active and invalid.
  bool wanted(uint32_t triangle) const { return wanted_[triangle]; }
  // Of a cut's active triangles, by the definition: what is asked for and not given.
  Shortfall ShortfallOf(const std::vector<bool>& applied) const {
    Shortfall shortfall;
    for (const uint32_t id : f_.mt.Mesh(applied)) {
      if (!active_[id] || query_.threshold == nullptr) continue;
      const InMemoryMt::Triangle& t = f_.mt.triangles[id];
      const Triangle3d corners = f_.Corners(t);
      const double b = Bound(t.remover < 0 ? 0 : f_.mt.nodes[static_cast<size_t>(t.remover)].code);
      const double least = query_.threshold->Min(corners, b);
      if (least < 0 ? t.remover < 0 : b <= least) continue;
      ++shortfall.triangles;
      shortfall.excess = std::max(shortfall.excess, b - std::max(least, 0.0));
      for (const Vec3d& p : corners) shortfall.bounds.Add(p);
    }
    return shortfall;
  }
  bool Valid(const std::vector<bool>& applied) const {
    for (const uint32_t id : f_.mt.Mesh(applied)) {
      if (wanted_[id]) return false;
    }
    return true;
  }

  // The definition, top down, in random order.
  std::vector<bool> LeastCut(std::mt19937& random) const {
    std::vector<bool> applied(f_.mt.nodes.size(), false);
    for (;;) {
      std::vector<uint32_t> invalid;
      for (const uint32_t id : f_.mt.Mesh(applied)) {
        if (wanted_[id]) invalid.push_back(id);
      }
      if (invalid.empty()) return applied;
      const size_t pick = std::uniform_int_distribution<size_t>(0, invalid.size() - 1)(random);
      f_.mt.Close(f_.mt.triangles[invalid[pick]].remover, applied);
    }
  }

  // The intersection of all valid parent-closed sets, by enumeration of all sets.
  std::vector<bool> LeastCutByEnumeration() const {
    const size_t n = f_.mt.nodes.size();
    std::vector<uint32_t> parents(n, 0);
    for (size_t i = 0; i < n; ++i) {
      for (const int p : f_.mt.Parents(static_cast<int>(i))) parents[i] |= 1u << p;
    }
    uint32_t least = (1u << n) - 1;
    for (uint32_t set = 0; set < (1u << n); ++set) {
      std::vector<bool> applied(n);
      bool closed = true;
      for (size_t i = 0; i < n; ++i) {
        applied[i] = (set >> i) & 1;
        closed &= !applied[i] || (parents[i] & ~set) == 0;
      }
      if (closed && Valid(applied)) least &= set;
    }
    std::vector<bool> applied(n);
    for (size_t i = 0; i < n; ++i) applied[i] = (least >> i) & 1;
    return applied;
  }

  // The least level of a triangle at which it would not be refused with a bound, by trying all; -1
  // when it is not.
  int LevelOf(const InMemoryMt::Triangle& t, double b) const {
    const Triangle3d corners = f_.Corners(t);
    if (!Refused(corners, b)) return -1;
    const ThresholdPtr pixel =
        query_.threshold == nullptr ? nullptr : query_.threshold->AtPixels(1);
    const double h = f_.source->record_.rounding_error;
    const int top = pixel == nullptr ? 255 : 1023;
    for (int level = 0; level < top; ++level) {
      const double permitted = pixel == nullptr
                                   ? Bound(static_cast<uint8_t>(level))
                                   : std::exp2((level - 512) / 8.0) * pixel->Min(corners, b);
      if (b <= std::max(permitted, h)) return level;
    }
    return top;
  }

  // The definition of a budget of triangles: the least cuts for one cutoff after the other, as long
  // as they fit.
  std::vector<bool> CutWithin(uint64_t most, QueryLimit* limit) const {
    std::vector<int> levels;
    for (size_t id = 0; id < f_.mt.triangles.size(); ++id) {
      levels.push_back(wanted_[id] ? LevelOf(f_.mt.triangles[id], bounds_[id]) : -1);
    }
    const auto unit_of = [&](uint32_t id) {
      return f_.mt.nodes[static_cast<size_t>(f_.mt.triangles[id].remover)].cluster;
    };
    std::vector<bool> applied(f_.mt.nodes.size(), false);
    *limit = QueryLimit::kTriangles;
    for (int level = 1023; level >= 0; --level) {
      if (std::find(levels.begin(), levels.end(), level) == levels.end()) continue;
      for (UnitId from = f_.source->index_.cluster_count(); from-- > 0;) {
        std::vector<bool> next = applied;
        for (bool again = true; again;) {
          again = false;
          for (const uint32_t id : f_.mt.Mesh(next)) {
            if (levels[id] < level || (levels[id] == level && unit_of(id) < from)) continue;
            if (levels[id] < 0) continue;
            f_.mt.Close(f_.mt.triangles[id].remover, next);
            again = true;
            break;
          }
        }
        if (next != applied && f_.mt.Mesh(next).size() > most) return applied;
        applied = next;
      }
    }
    *limit = QueryLimit::kThreshold;
    return applied;
  }

  // From level to level, until the next node or the next cluster does not fit. `limit` says which.
  std::vector<bool> GreedyCut(QueryLimit* limit) const {
    const ClusterIndex& index = f_.source->index_;
    std::vector<bool> applied(f_.mt.nodes.size(), false);
    std::vector<bool> before = applied;  // this cutoff
    std::pair<int, uint32_t> cutoff{1 << 20, 0};
    std::vector<bool> looked_into(index.cluster_count(), false);
    std::vector<bool> read(index.cluster_count(), false);
    uint64_t bytes_read = 0;
    for (UnitId u = index.cluster_count(); u < index.unit_count(); ++u) {
      bytes_read += index.location(u).length;
    }
    using Rank = std::tuple<int, uint32_t, bool, uint32_t>;  // level, cluster, look, node
    for (;;) {
      std::optional<Rank> best;
      uint32_t best_triangle = 0;
      for (const uint32_t id : f_.mt.Mesh(applied)) {
        const InMemoryMt::Triangle& t = f_.mt.triangles[id];
        if (t.remover < 0) continue;
        const InMemoryMt::Node& node = f_.mt.nodes[static_cast<size_t>(t.remover)];
        const bool look = !looked_into[node.cluster];
        const int level =
            LevelOf(t, look ? Bound(index.unit(node.cluster).error_code_max) : bounds_[id]);
        const Rank rank{level, node.cluster, look, look ? kNone32 : kNone32 - node.index};
        if (level < 0 || (best && rank <= *best)) continue;
        best = rank;
        best_triangle = id;
      }
      *limit = QueryLimit::kThreshold;
      if (!best) return applied;
      if (const std::pair now{std::get<0>(*best), std::get<1>(*best)}; now < cutoff) {
        cutoff = now;
        before = applied;
      }
      if (std::get<2>(*best)) {
        std::vector<bool> next = read;
        uint64_t cost = 0;
        std::vector<uint32_t> open{std::get<1>(*best)};
        while (!open.empty()) {
          const UnitId c = open.back();
          open.pop_back();
          if (c >= index.cluster_count() || next[c]) continue;
          next[c] = true;
          cost += index.location(c).length;
          for (const UnitId p : index.parents(c)) open.push_back(p);
        }
        *limit = QueryLimit::kBytes;
        if (query_.max_bytes && bytes_read + cost > *query_.max_bytes) return applied;
        bytes_read += cost;
        read = next;
        looked_into[std::get<1>(*best)] = true;
        continue;
      }
      std::vector<bool> next = applied;
      f_.mt.Close(f_.mt.triangles[best_triangle].remover, next);
      *limit = QueryLimit::kTriangles;
      if (query_.max_triangles && f_.mt.Mesh(next).size() > *query_.max_triangles) return before;
      applied = next;
    }
  }

 private:
  bool Refused(const Triangle3d& t, double b) const {
    const bool active = query_.region == nullptr || query_.region->Within(t, b);
    const double least = query_.threshold == nullptr ? -1 : query_.threshold->Min(t, b);
    return active && (least < 0 || !(b <= std::max(least, f_.source->record_.rounding_error)));
  }

  const MtFixture& f_;
  const Query query_;
  std::vector<bool> active_;
  std::vector<bool> wanted_;
  std::vector<double> bounds_;
};

constexpr int kThresholdKinds = 11;

inline ThresholdPtr RandomThreshold(int kind, const MtFixture& fixture, std::mt19937& random) {
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const Box3d& bounds = fixture.source->record_.bounds;
  const double size = Diagonal(bounds);
  const auto error = [&] {
    return fixture.source->record_.grid.Error(static_cast<uint8_t>(random() % 110));
  };
  Vec3d point;
  for (int i = 0; i < 3; ++i) point[i] = uniform(bounds.min[i] - 0.1, bounds.max[i] + 0.1);
  switch (kind) {
    case 0: return ConstantThreshold(random() % 4 == 0 ? 0 : error());
    case 1: return LinearThreshold(point, error() - 0.05, uniform(0, 0.2));
    case 2: return LinearThreshold(point, error(), -uniform(0, 0.2));
    case 3: return QuadraticThreshold(point, error() - 0.05, uniform(-0.1, 0.3));
    case 4: return SquareRootThreshold(point, error() - 0.05, uniform(-0.1, 0.3));
    case 5: return ExponentialThreshold(point, error(), uniform(-3, 3));
    case 6: return ScreenThreshold(RandomCamera(bounds, random), uniform(1, 50));
    case 7:
      return RegionThreshold(AnyRegion(bounds, random).region, ConstantThreshold(error()),
                             ConstantThreshold(error()));
    case 8: {
      GridField field;
      field.origin = bounds.min;
      field.cell_size = (bounds.max - bounds.min + Vec3d{size, size, size} * 0.1) * 0.25;
      field.counts = {4, 3, 4};
      for (int i = 0; i < 48; ++i) field.errors.push_back(error());
      return GridThreshold(std::move(field));
    }
    case 9: {
      const double base = error() - 0.02;
      return FunctionThreshold(
          [=](const Box3d& box) { return base + 0.1 * std::max(0.0, box.min.z - point.z); });
    }
    default: return random() % 8 == 0 ? CoarsestThreshold() : ConstantThreshold(error());
  }
}

// Regions and thresholds of every kind, and none.
inline Query RandomQuery(const MtFixture& fixture, std::mt19937& random) {
  const Box3d& bounds = fixture.source->record_.bounds;
  const auto threshold = [&] {
    return RandomThreshold(static_cast<int>(random() % kThresholdKinds), fixture, random);
  };
  Query query;
  switch (random() % 8) {
    case 0: break;
    case 1: query.region = WholeRegion(); break;
    default: query.region = AnyRegion(bounds, random).region;
  }
  switch (random() % 8) {
    case 0: break;
    case 1: query.threshold = FullResolution(); break;
    case 2: query.threshold = MinThreshold({threshold(), threshold()}); break;
    case 3: query.threshold = MaxThreshold({threshold(), threshold()}); break;
    default: query.threshold = threshold();
  }
  return query;
}

}  // namespace mtdb::testing
