// SPDX-License-Identifier: Apache-2.0
// Table, desk and spill within one budget: what gives way to what, and where it goes.
#include "query/cache/cache_memory.h"

#include <catch2/catch.hpp>
#include <memory>
#include <vector>

#include "query/cache/cluster_cache.h"
#include "query/cache/unit_image.h"
#include "tests/query/mt_fixture.h"
#include "tests/support/failing_allocation.h"

namespace mtdb::testing {

using namespace internal;

namespace {

// Decoded units, and a memory in which they are put by hand.
struct World {
  explicit World(size_t budget, uint64_t spill_bytes = 0)
      : f(MakeTorus(20, 16)), all(f.source, {size_t{1} << 30}) {
    CacheOptions options;
    options.budget_bytes = budget;
    options.spill_bytes = spill_bytes;
    memory = std::make_unique<CacheMemory>(
        f.source, options, [](PayloadDesk::Batch&, UnitId, const Result<Bytes>&) {});
  }
  void Fill(UnitId unit, size_t bytes) {
    LoadStats stats;
    memory->units.Claim(unit, bytes);
    memory->units.Fill(unit, all.Get(unit, &stats).value());
    memory->units.Pin(unit);
    memory->units.Unpin(unit);
  }
  bool MakeRoom(size_t bytes) {
    MutexLock lock(mutex);
    Evicted evicted(*memory);
    const bool made = memory->MakeRoom(bytes, evicted);
    memory->LetGo(evicted, lock);
    return made;
  }

  MtFixture f;
  ClusterCache all;
  std::unique_ptr<CacheMemory> memory;
  Mutex mutex;
};

Payload SomePayload(size_t bytes) { return std::make_shared<const Bytes>(bytes); }

}  // namespace

TEST_CASE("Room is made from units, then from payloads, then from what was asked for ahead") {
  World w(1000);
  CacheMemory& m = *w.memory;
  const auto user =
      std::make_shared<CacheUser>(w.f.source->record_, m.units.size(), ReaderLimits{});
  for (const UnitId u : {1, 2}) w.Fill(u, 200);
  m.units.Pin(1);
  for (const UnitId u : {3, 4}) REQUIRE(m.payloads.Put(u, SomePayload(100)));
  m.payloads.Want(3);
  const auto ahead = m.payloads.NewBatch(1, user, Asking::kAhead);
  m.payloads.Expect(ahead, 5, 200);
  const auto waited = m.payloads.NewBatch(1, user, Asking::kToWait);
  m.payloads.Expect(waited, 6, 200);
  REQUIRE(m.budget.used() == 1000);
  REQUIRE(w.MakeRoom(0));
  REQUIRE(m.units.ready(2));
  REQUIRE(w.MakeRoom(200));
  REQUIRE(m.units.empty(2));
  REQUIRE(m.payloads.Find(4) != nullptr);
  REQUIRE(w.MakeRoom(300));
  REQUIRE(m.payloads.Find(4) == nullptr);
  REQUIRE(m.payloads.on_its_way(5));
  REQUIRE(w.MakeRoom(500));
  REQUIRE(!m.payloads.on_its_way(5));
  // What is pinned, wanted or waited for stays.
  REQUIRE(!w.MakeRoom(501));
  REQUIRE(m.units.ready(1));
  REQUIRE(m.payloads.Find(3) != nullptr);
  REQUIRE(m.payloads.on_its_way(6));
  REQUIRE(m.budget.peak() == 1000);
  m.payloads.Unwant(3);
}

TEST_CASE("A unit that was used goes into the file, once, and is there as long as the period") {
  World w(1000, size_t{1} << 20);
  CacheMemory& m = *w.memory;
  w.Fill(1, 400);
  m.AddReader(true);
  m.AddReader(true);
  w.Fill(2, 400);
  // Before the first reader nobody cared which were used.
  REQUIRE(w.MakeRoom(600));
  REQUIRE(!m.spill.Has(1));
  REQUIRE(w.MakeRoom(1000));
  REQUIRE(m.spill.Has(2));
  REQUIRE(m.units.empty(2));
  REQUIRE(m.CanLoad(2));
  LoadStats stats;
  const LoadedUnitPtr back = m.spill.file()->Read(m.spill.place(2));
  REQUIRE(MakeUnitImage(*back) == MakeUnitImage(*w.all.Get(2, &stats).value()));
  // It is not written a second time.
  const uint64_t place = m.spill.place(2).offset;
  w.Fill(2, 400);
  REQUIRE(w.MakeRoom(1000));
  REQUIRE(m.spill.place(2).offset == place);
  {
    CacheMemory::Rest rest;
    m.RemoveReader(true, rest);
    REQUIRE(rest.file == nullptr);
  }
  REQUIRE(m.spill.Has(2));
  CacheMemory::Rest rest;
  m.RemoveReader(true, rest);
  REQUIRE(rest.file != nullptr);
  REQUIRE(!m.spill.Has(2));
  REQUIRE(m.spill.file() == nullptr);
  // A new period, and a new file.
  m.AddReader(true);
  REQUIRE(!m.spill.Has(2));
  REQUIRE(m.spill.file() != rest.file);
}

TEST_CASE("While it is being written a unit is claimed; what is not written is decoded again") {
  World w(1000, size_t{1} << 20);
  CacheMemory& m = *w.memory;
  m.AddReader(true);
  w.Fill(2, 400);
  {
    Evicted evicted(m);
    REQUIRE(m.MakeRoom(1000, evicted));
    REQUIRE(m.spill.Has(2));
    REQUIRE(!m.units.empty(2));
    REQUIRE(!m.units.ready(2));
    REQUIRE(m.budget.used() == 0);
  }
  REQUIRE(!m.spill.Has(2));
  REQUIRE(m.units.empty(2));
  // The reader goes, and another comes, while it is written.
  w.Fill(2, 400);
  MutexLock lock(w.mutex);
  Evicted evicted(m);
  REQUIRE(m.MakeRoom(1000, evicted));
  const auto old_file = m.spill.file();
  CacheMemory::Rest rest;
  m.RemoveReader(true, rest);
  m.AddReader(true);
  evicted.units[0].place = old_file->Write(*evicted.units[0].value);
  evicted.Settle(old_file);
  REQUIRE(!m.spill.Has(2));
  REQUIRE(m.units.empty(2));
}

TEST_CASE("Making room needs no memory, and loses nothing without") {
  using Mode = FailingAllocation::Mode;
  for (const Mode mode : {Mode::kOnce, Mode::kFromThenOn}) {
    World w(1000, size_t{1} << 20);
    CacheMemory& m = *w.memory;
    m.AddReader(true);
    const auto fill = [&] {
      for (const UnitId u : {1, 2, 3}) w.Fill(u, 300);
      REQUIRE(m.payloads.Put(4, SomePayload(100)));
    };
    fill();
    const uint64_t n = FailEachAllocation(
        mode, [&] { return w.MakeRoom(1000); },
        [&](uint64_t, bool made) {
          REQUIRE(made);
          REQUIRE(m.budget.used() == 0);
          REQUIRE(m.units.idle());
          for (const UnitId u : {1, 2, 3}) REQUIRE(m.units.empty(u));
          fill();
        });
    REQUIRE(n > 1);
  }
}

TEST_CASE("What a query may read ends before the first cluster beyond its limit") {
  const MtFixture f = MakeTorus(20, 16);
  const ClusterIndex& index = f.source->index_;
  const auto length = [&](UnitId u) { return uint64_t{index.location(u).length}; };
  CacheUser user(f.source->record_, index.unit_count(), {nullptr, length(0) + length(1)});
  const UnitId root = index.cluster_count();
  std::vector<UnitId> units{root, 0, 1, 2};
  user.CutToLimit(units, index);
  REQUIRE(units == std::vector<UnitId>{root, 0, 1});  // root pieces are read in any case
  user.CountRead(root, true, length(root));
  REQUIRE(user.bytes_left() ==
          length(0) + length(1) - std::min(length(0) + length(1), length(root)));
  REQUIRE(user.stats.root_pieces_read == 1);
  REQUIRE(!user.out_of_bytes);
  REQUIRE(user.OverLimit(2).code() == StatusCode::kBudgetExceeded);
  REQUIRE(user.out_of_bytes);
}

}  // namespace mtdb::testing
