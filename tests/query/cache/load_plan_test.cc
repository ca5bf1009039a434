// SPDX-License-Identifier: Apache-2.0
// What has yet to be done until a unit is loaded, step by step and without a source.
#include "query/cache/load_plan.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <memory>
#include <set>

#include "query/cache/cluster_cache.h"
#include "store/base/out_of_memory.h"
#include "tests/query/mt_fixture.h"
#include "tests/support/failing_allocation.h"

namespace mtdb::testing {

using namespace internal;

namespace {

struct World {
  World() : f(MakeTorus(20, 16)), all(f.source, {size_t{1} << 30}) {
    CacheOptions options;
    options.spill_bytes = size_t{1} << 30;
    memory = std::make_unique<CacheMemory>(
        f.source, options, [](PayloadDesk::Batch&, UnitId, const Result<Bytes>&) {});
    memory->AddReader(true);
  }
  std::set<UnitId> Family(UnitId unit) const {
    std::set<UnitId> family{unit};
    for (UnitId u = 0; u < memory->units.size(); ++u) {  // parents are larger
      if (!family.contains(u)) continue;
      for (const UnitId p : memory->index.parents(u)) family.insert(p);
    }
    return family;
  }
  void Load(UnitId unit) {
    LoadStats stats;
    memory->units.Claim(unit, 100);
    memory->units.Fill(unit, all.Get(unit, &stats).value());
    memory->units.Pin(unit);
    memory->units.Unpin(unit);
  }
  void DropAll(Mutex& mutex) {
    MutexLock lock(mutex);
    Evicted evicted(*memory);
    memory->MakeRoom(memory->budget.limit(), evicted);
    memory->LetGo(evicted, lock);
  }
  bool Pinned(UnitId unit) const { return memory->units[unit].pins > 0; }

  MtFixture f;
  ClusterCache all;
  std::unique_ptr<CacheMemory> memory;
};

Payload SomePayload() { return std::make_shared<const Bytes>(10); }

}  // namespace

TEST_CASE("A plan has what is missing, coarsest first, and pins what is needed and no more") {
  World w;
  for (UnitId target = 0; target < w.memory->units.size(); target += 3) {
    const std::set<UnitId> family = w.Family(target);
    LoadPlan plan(*w.memory, target);
    plan.Make();
    REQUIRE(plan.todo() == std::vector<UnitId>(family.rbegin(), family.rend()));
    while (!plan.todo().empty()) {
      const UnitId next = plan.todo().front();
      REQUIRE(!plan.outdated());
      REQUIRE(plan.HasParents(next));
      w.Load(next);
      plan.Finish(next);
      for (const UnitId u : family) {
        const bool needed = std::ranges::any_of(plan.todo(), [&](UnitId child) {
          return std::ranges::count(w.memory->index.parents(child), u) > 0;
        });
        REQUIRE(w.Pinned(u) == (w.memory->units.ready(u) && (needed || u == target)));
      }
      for (const UnitId u : plan.todo()) {
        const auto parents = w.memory->index.parents(u);
        REQUIRE(plan.HasParents(u) ==
                std::ranges::all_of(parents, [&](UnitId p) { return w.memory->units.ready(p); }));
      }
    }
    plan.Take();
    w.memory->units.Unpin(target);
    REQUIRE(w.memory->units.idle());
    Mutex mutex;
    w.DropAll(mutex);
    CacheMemory::Rest rest;
    w.memory->RemoveReader(true, rest);
    w.memory->AddReader(true);
  }
}

TEST_CASE("What is in the file comes without its parents, until it is not there any more") {
  World w;
  Mutex mutex;
  REQUIRE(w.Family(0).size() > 3);
  w.Load(0);
  w.DropAll(mutex);
  LoadPlan plan(*w.memory, 0);
  plan.Make();
  REQUIRE(plan.todo() == std::vector<UnitId>{0});
  REQUIRE(plan.HasParents(0));
  w.memory->spill.Set(0, w.memory->spill.file(), std::nullopt);
  REQUIRE(plan.outdated());
  plan.Make();
  REQUIRE(plan.todo().size() == w.Family(0).size());
  REQUIRE(!plan.HasParents(0));
}

TEST_CASE("A plan gives up the payloads of what comes later, but for those that others want") {
  World w;
  LoadPlan plan(*w.memory, 0), other(*w.memory, 1);
  plan.Make();
  other.Make();
  const std::set<UnitId> family = w.Family(0), others = w.Family(1);
  PayloadDesk& desk = w.memory->payloads;
  for (const UnitId u : family) REQUIRE(desk.Put(u, SomePayload()));
  const UnitId first = plan.todo().front();
  REQUIRE(plan.GiveUpPayloads(first));
  REQUIRE(!plan.GiveUpPayloads(first));
  for (const UnitId u : family) {
    REQUIRE((desk.Find(u) != nullptr) == (u == first || others.contains(u)));
  }
}

TEST_CASE("A plan that could not be made for lack of memory pins and wants nothing") {
  using Mode = FailingAllocation::Mode;
  World w;
  const std::set<UnitId> family = w.Family(0);
  for (const UnitId u : family) {
    if (w.memory->index.parents(u).empty()) w.Load(u);
    if (w.memory->units.empty(u)) REQUIRE(w.memory->payloads.Put(u, SomePayload()));
  }
  const size_t there = w.memory->payloads.bytes();
  for (const Mode mode : {Mode::kOnce, Mode::kFromThenOn}) {
    const auto run = [&] {
      return CatchOutOfMemory([&]() -> Status {
        LoadPlan plan(*w.memory, 0);
        plan.Make();
        plan.Make();
        return Status::Ok();
      });
    };
    uint64_t failures = 0;
    FailEachAllocation(mode, run, [&](uint64_t, const Status& status) {
      failures += status.ok() ? 0 : 1;
      REQUIRE(w.memory->units.idle());
      REQUIRE(w.memory->payloads.bytes() == there);
    });
    REQUIRE(failures > 5);
  }
  // Nobody wants one.
  while (w.memory->payloads.DropOldest()) {
  }
  REQUIRE(w.memory->payloads.bytes() == 0);
}

}  // namespace mtdb::testing
