#include "query/cluster_cache.h"

#include <catch2/catch.hpp>
#include <random>
#include <thread>

#include "tests/query/mt_fixture.h"

namespace mtdb::testing {
namespace {

MtFixture Fixture() {
  MtOptions o;
  o.shape = Shape::kTorus;
  o.resolution = 20;
  o.rounds = 5;
  o.tiles = 16;
  return MakeMt(o);
}

}  // namespace

TEST_CASE("A cluster is read with the ancestors that are missing, and once") {
  const MtFixture f = Fixture();
  ClusterCache cache(f.source, size_t{1} << 30);
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
  const uint32_t count = UnitCount(f.source->index());
  LoadStats stats;
  size_t all = 0;
  {
    ClusterCache cache(f.source, size_t{1} << 30);
    for (UnitId u = count; u-- > 0;) REQUIRE(cache.Get(u, &stats).ok());
    all = cache.bytes();
  }
  ClusterCache cache(f.source, all / 2);
  LoadedUnitPtr pinned = cache.Get(count - 1, &stats).value();
  for (UnitId u = count; u-- > 0;) {
    REQUIRE(cache.Get(u, &stats).ok());
    REQUIRE(cache.bytes() <= all / 2);
  }
  REQUIRE(cache.Get(count - 1, &stats).value() == pinned);
  const uint64_t decoded = cache.decoded();
  REQUIRE(cache.Get(0, &stats).ok());  // the newest: still there
  REQUIRE(cache.decoded() == decoded);

  // Everything pinned: over the budget for as long as that lasts.
  std::vector<LoadedUnitPtr> pins;
  for (UnitId u = count; u-- > 0;) pins.push_back(cache.Get(u, &stats).value());
  REQUIRE(cache.bytes() > all / 2);
  pins.clear();
  pinned.reset();
  cache.Trim();
  REQUIRE(cache.bytes() <= all / 2);
}

TEST_CASE("Threads that want overlapping units share the work") {
  const MtFixture f = Fixture();
  const uint32_t count = UnitCount(f.source->index());
  for (int round = 0; round < 10; ++round) {
    ClusterCache cache(f.source, size_t{1} << 30);
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

TEST_CASE("When the thread that loads fails, the others find out for themselves") {
  const MtFixture f = Fixture();
  const uint32_t count = UnitCount(f.source->index());
  ClusterCache cache(f.source, size_t{1} << 30);
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
