// SPDX-License-Identifier: Apache-2.0
#include "query/cache/cluster_cache.h"

#include <array>
#include <catch2/catch.hpp>
#include <chrono>
#include <random>
#include <thread>

#include "query/cache/unit_reader.h"
#include "tests/query/mt_fixture.h"

namespace mtdb::testing {

using namespace internal;

namespace {

MtFixture Fixture() { return MakeTorus(20, 16); }

}  // namespace

TEST_CASE("A cluster is read with the ancestors that are missing, and once") {
  const MtFixture f = Fixture();
  ClusterCache cache(f.source, {size_t{1} << 30});
  LoadStats stats;
  const LoadedUnitPtr first = cache.Get(0, &stats).value();
  REQUIRE(first->id == 0);
  const uint64_t units = stats.clusters_read + stats.root_pieces_read;
  REQUIRE(units > first->parents.size());
  REQUIRE(units == cache.decoded());
  for (const UnitId p : first->parents) REQUIRE(cache.Get(p, &stats).value()->id == p);
  REQUIRE(cache.Get(0, &stats).value() == first);
  REQUIRE(stats.clusters_read + stats.root_pieces_read == units);
  REQUIRE(f.source->reads_ == units);
  REQUIRE(cache.bytes() > first->memory_bytes());
}

TEST_CASE("The least recently used unpinned units go first, pinned ones stay") {
  const MtFixture f = Fixture();
  const uint32_t count = f.source->index().unit_count();
  LoadStats stats;
  size_t all = 0;
  {
    ClusterCache cache(f.source, {size_t{1} << 30});
    for (UnitId u = count; u-- > 0;) REQUIRE(cache.Get(u, &stats).ok());
    all = cache.bytes();
  }
  ClusterCache cache(f.source, {all / 2});
  LoadedUnitPtr pinned = cache.Get(count - 1, &stats).value();
  for (UnitId u = count; u-- > 0;) REQUIRE(cache.Get(u, &stats).ok());
  REQUIRE(cache.Get(count - 1, &stats).value() == pinned);
  const uint64_t decoded = cache.decoded();
  REQUIRE(cache.Get(0, &stats).ok());  // the newest: still there
  REQUIRE(cache.decoded() == decoded);

  // Everything pinned: no room for more, until that ends.
  std::vector<LoadedUnitPtr> pins;
  Status refused;
  UnitId next = count;
  while (refused.ok() && next > 0) {
    Result<LoadedUnitPtr> loaded = cache.Get(--next, &stats);
    refused = loaded.status();
    if (loaded.ok()) pins.push_back(*loaded);
  }
  REQUIRE(refused.code() == StatusCode::kBudgetExceeded);
  pins.clear();
  pinned.reset();
  REQUIRE(cache.Get(next, &stats).ok());
  REQUIRE(cache.peak_bytes() <= all / 2);
}

namespace {

constexpr int kSteps = 60;
using Wanted = std::array<UnitId, 3>;

std::vector<Wanted> RandomSteps(uint32_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<Wanted> steps(kSteps);
  for (Wanted& wanted : steps) {
    for (UnitId& u : wanted) u = random() % count;
  }
  return steps;
}

Status HoldAll(UnitReader& reader, const Wanted& wanted) {
  for (const UnitId u : wanted) {
    const Result<const LoadedUnit*> unit = reader.Get(u);
    if (!unit.ok()) return unit.status();
    if ((*unit)->id != u) return Corrupt("another unit");
  }
  return Status::Ok();
}

// Bytes that a cache needs so that the units can be held at the same time.
size_t SmallestCache(const MtFixture& f, const Wanted& wanted, size_t at_least) {
  for (size_t budget = at_least;; budget += 4000) {
    ClusterCache cache(f.source, {budget});
    UnitReader reader(cache, {});
    Status status = HoldAll(reader, wanted);
    if (!status.ok() && reader.crowded()) {
      reader.Release();
      REQUIRE(reader.WaitForRoom().ok());
      status = HoldAll(reader, wanted);
    }
    REQUIRE(cache.peak_bytes() <= budget);
    if (status.ok()) return budget;
    REQUIRE(status.code() == StatusCode::kBudgetExceeded);
  }
}

}  // namespace

TEST_CASE("Readers wait for room and none of them forever", "[threads]") {
  const MtFixture f = Fixture();
  const uint32_t count = f.source->index().unit_count();
  constexpr unsigned kReaders = 6;
  // What is enough for each of them alone is enough for all of them.
  size_t budget = 0;
  for (unsigned t = 0; t < kReaders; ++t) {
    for (const Wanted& wanted : RandomSteps(count, t)) budget = SmallestCache(f, wanted, budget);
  }
  for (const unsigned own_threads : {1u, 3u}) {
    ClusterCache cache(f.source, {budget, own_threads});
    std::atomic<int> failed{0};
    std::atomic<int> crowded{0};
    std::vector<std::thread> threads;
    for (unsigned t = 0; t < kReaders; ++t) {
      threads.emplace_back([&, t] {
        UnitReader reader(cache, {});
        for (const Wanted& wanted : RandomSteps(count, t)) {
          reader.Prefetch(wanted);
          Status status = HoldAll(reader, wanted);
          if (!status.ok() && reader.crowded()) {
            ++crowded;
            reader.Release();
            if (!reader.WaitForRoom().ok()) ++failed;
            status = HoldAll(reader, wanted);
          }
          if (!status.ok()) ++failed;
          std::this_thread::sleep_for(std::chrono::microseconds(100));  // others find it full
          reader.Release();
        }
      });
    }
    for (std::thread& thread : threads) thread.join();
    REQUIRE(failed == 0);
    REQUIRE(crowded > 0);
    REQUIRE(cache.peak_bytes() <= budget);
  }
}

TEST_CASE("What is named ahead is loaded by other threads, once, and counted for its query",
          "[threads]") {
  const MtFixture f = Fixture();
  const uint32_t count = f.source->index().unit_count();
  ClusterCache cache(f.source, {size_t{1} << 30, 3});
  UnitReader reader(cache, {});
  REQUIRE(reader.prefetch_units() > 0);
  std::vector<UnitId> units;
  for (UnitId u = 0; u < count; ++u) units.push_back(u);
  reader.Prefetch(units);
  for (const UnitId u : units) {
    REQUIRE((*reader.Get(u))->id == u);
    reader.Release();
  }
  REQUIRE(cache.decoded() == count);
  REQUIRE(f.source->reads_ == count);
  const LoadStats stats = reader.stats();
  REQUIRE(stats.clusters_read + stats.root_pieces_read == count);
  REQUIRE(stats.clusters_cached == 0);
  UnitReader second(cache, {});
  REQUIRE(second.Get(0).ok());
  REQUIRE(second.stats().clusters_cached == 1);
  REQUIRE(second.stats().clusters_read == 0);
}

TEST_CASE("Threads that want overlapping units share the work", "[threads]") {
  const MtFixture f = Fixture();
  const uint32_t count = f.source->index().unit_count();
  for (int round = 0; round < 10; ++round) {
    ClusterCache cache(f.source, {size_t{1} << 30});
    const uint64_t before = f.source->reads_;
    std::atomic<uint64_t> read{0};
    std::atomic<int> wrong{0};
    std::vector<std::thread> threads;
    for (unsigned t = 0; t < 6; ++t) {
      threads.emplace_back([&, t] {
        std::mt19937 random(t + 100u * static_cast<unsigned>(round));
        LoadStats stats;
        for (int i = 0; i < 200; ++i) {
          const UnitId unit = random() % count;
          const Result<LoadedUnitPtr> loaded = cache.Get(unit, &stats);
          if (!loaded.ok() || (*loaded)->id != unit) ++wrong;
        }
        read += stats.clusters_read + stats.root_pieces_read;
      });
    }
    for (std::thread& thread : threads) thread.join();
    REQUIRE(wrong == 0);
    REQUIRE(cache.decoded() <= count);
    REQUIRE(read == cache.decoded());
    REQUIRE(f.source->reads_ - before == cache.decoded());
  }
}

TEST_CASE("When the thread that loads fails, the others find out for themselves", "[threads]") {
  const MtFixture f = Fixture();
  const uint32_t count = f.source->index().unit_count();
  ClusterCache cache(f.source, {size_t{1} << 30});
  std::atomic<int> failures_left{20};
  f.source->on_read_ = [&](uint32_t) {
    return failures_left.fetch_sub(1) > 0 ? IoError("not now") : Status::Ok();
  };
  std::atomic<int> failed{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 6; ++t) {
    threads.emplace_back([&] {
      LoadStats stats;
      for (UnitId u = 0; u < count; ++u) {
        while (!cache.Get(u, &stats).ok()) ++failed;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  REQUIRE(failed > 0);
  REQUIRE(cache.decoded() == count);
}

}  // namespace mtdb::testing
