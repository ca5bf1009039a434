// SPDX-License-Identifier: Apache-2.0
#include "query/cut/missing_clusters.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <unordered_map>

#include "query/cache/unit_reader.h"

namespace mtdb::internal {
namespace {

constexpr size_t kMostAhead = 256;

// Larger errors first, measured by what is asked for; then parents before children.
bool HelpsMore(const MissingCluster& a, const MissingCluster& b) {
  return std::tuple(a.excess, a.error, a.unit) > std::tuple(b.excess, b.error, b.unit);
}

double Excess(double error, double threshold) {
  return threshold > 0 ? error / threshold : std::numeric_limits<double>::infinity();
}

// Whether some triangle of the box's middle would be refused with the unit's largest error. `bound`
// and `range` are set where it is.
bool SurelyWants(const UnitEntry& unit, const Judge& judge, double* bound, ErrorRange* range) {
  if (!judge.MayRefuse(unit.bounds, unit.error_code_max)) return false;
  *bound = judge.Bound(unit.error_code_max);
  *range = judge.RangeIn(judge.ModelBox(unit.bounds), *bound);
  // Between the two it depends on where in the box the errors are.
  return range->low <= 0 || *bound > std::sqrt(range->low * range->high);
}

}  // namespace

std::vector<MissingCluster> RankMissing(const ClusterIndex& index, const Judge& judge,
                                        const AvailableUnits& units) {
  std::vector<MissingCluster> ranked;
  std::unordered_map<UnitId, size_t> places;
  std::vector<UnitId> ids(units.missing().list().begin(), units.missing().list().end());
  std::ranges::sort(ids);  // children before parents
  ranked.reserve(ids.size());
  for (const UnitId id : ids) {
    places.emplace(id, ranked.size());
    MissingCluster m{id, 0, 0, units.missing().reason(id), {}};
    if (m.reason == MissingCluster::Reason::kFailed) m.failure = units.failure(id);
    if (index.Has(id)) {
      const UnitEntry& unit = index.unit(id);
      m.error = judge.Bound(unit.error_code_max);
      m.excess = Excess(m.error, judge.RangeIn(judge.ModelBox(unit.bounds), m.error).low);
    }
    ranked.push_back(std::move(m));
  }
  // What others come from helps as much as they do.
  for (const UnitId id : ids) {
    if (!index.Has(id)) continue;
    const MissingCluster& child = ranked[places.at(id)];
    for (const UnitId p : index.parents(id)) {
      const auto at = places.find(p);
      if (at == places.end()) continue;
      MissingCluster& parent = ranked[at->second];
      parent.error = std::max(parent.error, child.error);
      parent.excess = std::max(parent.excess, child.excess);
    }
  }
  std::ranges::sort(ranked, HelpsMore);
  return ranked;
}

void AskForMissing(const ClusterIndex& index, const Judge& judge,
                   const std::vector<MissingCluster>& missing, bool all, AvailableUnits& units) {
  std::vector<MissingCluster> wishes(missing);
  std::vector<bool> listed(index.unit_count());
  for (const MissingCluster& m : missing) listed[m.unit] = true;
  for (size_t i = 0; i < wishes.size() && wishes.size() < missing.size() + kMostAhead; ++i) {
    if (!index.Has(wishes[i].unit)) continue;
    for (const UnitId child : index.children(wishes[i].unit)) {
      if (listed[child] || !index.Has(child) || units.Find(child) != nullptr) continue;
      const UnitEntry& unit = index.unit(child);
      double error = 0;
      ErrorRange range;
      if (!SurelyWants(unit, judge, &error, &range)) continue;
      listed[child] = true;
      // It cannot help before what it comes from.
      wishes.push_back({child,
                        std::min(error, wishes[i].error),
                        std::min(Excess(error, range.low), wishes[i].excess),
                        {},
                        {}});
    }
  }
  std::ranges::sort(wishes, HelpsMore);
  std::vector<UnitId> order;
  order.reserve(wishes.size());
  for (const MissingCluster& w : wishes) order.push_back(w.unit);
  units.Ask(order, all);
}

void AskForWanted(const Judge& judge, std::vector<UnitId>& units, UnitReader& reader) {
  const ClusterIndex& index = judge.index();
  std::vector<bool> listed(index.unit_count());
  for (const UnitId u : units) listed[u] = true;
  const size_t most = units.size() + kMostAhead;
  for (size_t i = 0; i < units.size() && units.size() < most; ++i) {
    if (!index.Has(units[i])) continue;
    if (!judge.meter().Spend(1)) return;
    for (const UnitId child : index.children(units[i])) {
      double bound = 0;
      ErrorRange range;
      if (listed[child] || !index.Has(child) ||
          !SurelyWants(index.unit(child), judge, &bound, &range)) {
        continue;
      }
      listed[child] = true;
      units.push_back(child);
    }
  }
  reader.Prefetch(units);
}

}  // namespace mtdb::internal
