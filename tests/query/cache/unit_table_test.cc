// SPDX-License-Identifier: Apache-2.0
// The table of units alone: against a list, without threads.
#include "query/cache/unit_table.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <list>
#include <map>
#include <random>
#include <set>

#include "query/cache/cluster_cache.h"
#include "tests/query/mt_fixture.h"

namespace mtdb::testing {

using namespace internal;

namespace {

LoadedUnitPtr Unit(UnitId id) {
  const auto unit = std::make_shared<LoadedUnit>();
  unit->id = id;
  return unit;
}

std::vector<UnitId> Unpinned(UnitTable& table) {
  std::vector<UnitId> units;
  table.ForEachUnpinned([&](UnitId u) {
    units.push_back(u);
    return true;
  });
  return units;
}

// The definition: units by their last use, and what each counts.
struct Model {
  std::list<UnitId> ready;  // the least recently used first
  std::map<UnitId, size_t> bytes;
  std::map<UnitId, int> pins;
  std::set<UnitId> claimed;

  std::vector<UnitId> Unpinned() const {
    std::vector<UnitId> units;
    for (const UnitId u : ready) {
      if (pins.at(u) == 0) units.push_back(u);
    }
    return units;
  }
  size_t Used() const {
    size_t sum = 0;
    for (const auto& [u, count] : bytes) sum += count;
    return sum;
  }
};

}  // namespace

TEST_CASE("A budget knows what there is, what there may be, and what there was at most") {
  ByteBudget budget(100);
  REQUIRE(budget.HasRoom(100));
  REQUIRE(!budget.HasRoom(101));
  budget.Add(60);
  REQUIRE(budget.HasRoom(40));
  REQUIRE(!budget.HasRoom(41));
  budget.Remove(50);
  budget.Add(20);
  REQUIRE(budget.used() == 30);
  REQUIRE(budget.peak() == 60);
  REQUIRE(budget.limit() == 100);
}

TEST_CASE("The table is a list of units by their last use, of which the pinned stay") {
  const MtFixture f = MakeTorus(20, 16);
  for (unsigned seed = 0; seed < 20; ++seed) {
    std::mt19937 random(seed);
    ByteBudget budget(size_t{1} << 20);
    UnitTable table(f.source->record_, f.source->index_, false, budget);
    Model model;
    for (int step = 0; step < 2000; ++step) {
      const UnitId u = random() % table.size();
      const bool ready = std::ranges::find(model.ready, u) != model.ready.end();
      const unsigned act = random() % 8;
      if (!ready && !model.claimed.contains(u)) {
        table.Claim(u, model.bytes[u] = random() % 1000);
        model.claimed.insert(u);
      } else if (!ready && act < 2) {
        table.Unclaim(u);
        model.claimed.erase(u);
        model.bytes.erase(u);
      } else if (!ready) {
        table.Fill(u, Unit(u));
        model.claimed.erase(u);
        model.ready.push_back(u);
        model.pins[u] = 0;
      } else if (act < 3) {
        table.Pin(u);
        ++model.pins[u];
        model.ready.remove(u);
        model.ready.push_back(u);
      } else if (model.pins[u] > 0) {
        table.Unpin(u);
        --model.pins[u];
      } else if (act < 5) {
        table.MakeOldest(u);
        model.ready.remove(u);
        model.ready.push_front(u);
      } else {
        REQUIRE(table.Drop(u)->id == u);
        model.ready.remove(u);
        model.bytes.erase(u);
      }
      REQUIRE(table.empty(u) == !model.bytes.contains(u));
      REQUIRE(table.ready(u) == (!table.empty(u) && !model.claimed.contains(u)));
      REQUIRE(budget.used() == model.Used());
      REQUIRE(Unpinned(table) == model.Unpinned());
    }
    const bool idle = model.claimed.empty() && model.Unpinned().size() == model.ready.size();
    REQUIRE(table.idle() == idle);
  }
}

TEST_CASE("Units can be dropped while they are gone through, as long as one likes") {
  const MtFixture f = MakeTorus(20, 16);
  ByteBudget budget(100);
  UnitTable table(f.source->record_, f.source->index_, false, budget);
  for (UnitId u = 0; u < 6; ++u) {
    table.Claim(u, 10);
    table.Fill(u, Unit(u));
  }
  table.Pin(2);
  table.ForEachUnpinned([&](UnitId u) {
    table.Drop(u);
    return budget.used() > 30;
  });
  REQUIRE(Unpinned(table) == std::vector<UnitId>{4, 5});
  REQUIRE(table.ready(2));
  // What is pinned, or not there, does not become the oldest.
  table.MakeOldest(2);
  table.MakeOldest(0);
  REQUIRE(table.empty(0));
  REQUIRE(Unpinned(table) == std::vector<UnitId>{4, 5});
}

TEST_CASE("A unit is used in the period in which it was last pinned, unless it is forgotten") {
  const MtFixture f = MakeTorus(20, 16);
  ByteBudget budget(100);
  UnitTable table(f.source->record_, f.source->index_, false, budget);
  table.BeginPeriod();
  REQUIRE(!table.UsedInPeriod(1));
  table.Claim(1, 10);
  table.Fill(1, Unit(1));
  table.Pin(1);
  table.Unpin(1);
  REQUIRE(table.UsedInPeriod(1));
  table.Drop(1);
  REQUIRE(table.UsedInPeriod(1));
  table.BeginPeriod();
  REQUIRE(!table.UsedInPeriod(1));
  table.Claim(1, 10);
  table.Fill(1, Unit(1));
  table.Pin(1);
  table.Unpin(1);
  table.MakeOldest(1);
  REQUIRE(!table.UsedInPeriod(1));
}

TEST_CASE("What a load takes is what its units take, each there until its last child is") {
  const MtFixture f = MakeTorus(20, 16);
  const ClusterIndex& index = f.source->index_;
  ClusterCache cache(f.source, {size_t{1} << 30});
  LoadStats stats;
  for (const bool payloads : {false, true}) {
    ByteBudget budget(size_t{1} << 30);
    UnitTable table(f.source->record_, index, payloads, budget);
    std::vector<size_t> bytes(table.size());
    for (UnitId u = table.size(); u-- > 0;) {
      bytes[u] = cache.Get(u, &stats).value()->memory_bytes();
      table.NoteSize(u, bytes[u]);
    }
    for (UnitId target = 0; target < table.size(); ++target) {
      std::set<UnitId> family{target};
      for (bool grown = true; grown;) {
        const size_t before = family.size();
        for (const UnitId u : std::set<UnitId>(family)) {
          for (const UnitId p : index.parents(u)) family.insert(p);
        }
        grown = family.size() > before;
      }
      size_t most = 0;
      for (const UnitId now : family) {
        size_t held = payloads ? index.location(now).length : 0;
        for (const UnitId u : family) {
          const bool wanted = std::ranges::any_of(family, [&](UnitId child) {
            const auto parents = index.parents(child);
            return child <= now && std::ranges::find(parents, u) != parents.end();
          });
          if (u > now && wanted) held += bytes[u];
        }
        most = std::max(most, held + std::max(bytes[now], table.EstimateBytes(now)));
      }
      REQUIRE(table.LoadBytes(target) == most);
      REQUIRE(table[target].overhead == most - bytes[target]);
      REQUIRE(table.EstimateBytes(target) <= table.LargestEstimate());
    }
  }
}

}  // namespace mtdb::testing
