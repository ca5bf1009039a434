// SPDX-License-Identifier: Apache-2.0
// Jobs alone: their order, whose they are, and the threads that do them.
#include "query/cache/loaders.h"

#include <catch2/catch.hpp>
#include <chrono>
#include <thread>
#include <vector>

namespace mtdb::testing {

using namespace internal;

namespace {

const ObjectRecord kNoRecord;

CacheUserPtr User() { return std::make_shared<CacheUser>(kNoRecord, 100, ReaderLimits{}); }

}  // namespace

TEST_CASE("The coarsest unit is loaded first, whoever wants it; what is void takes no turn") {
  Mutex mutex;
  std::vector<UnitId> done;
  Loaders loaders(mutex, 0, [&](const Loaders::Job& job, MutexLock&) {
    if (job.user->over) return false;
    done.push_back(job.unit);
    return true;
  });
  loaders.Start();
  REQUIRE(!loaders.has_threads());
  const CacheUserPtr one = User(), other = User(), gone = User();
  gone->over = true;
  for (const UnitId u : {3, 9, 1}) loaders.Push(u, one);
  for (const UnitId u : {7, 2}) loaders.Push(u, other);
  for (const UnitId u : {8, 0}) loaders.Push(u, gone);
  MutexLock lock(mutex);
  REQUIRE(loaders.RunOne(lock));
  REQUIRE(loaders.RunOne(lock));
  REQUIRE(done == std::vector<UnitId>{9, 7});
  loaders.RemoveJobsOf(one);
  REQUIRE(loaders.RunOne(lock));
  REQUIRE(!loaders.RunOne(lock));
  REQUIRE(done == std::vector<UnitId>{9, 7, 2});
  lock.unlock();
}

TEST_CASE("Threads do each job once, beside whoever helps, and end when they are told",
          "[threads]") {
  for (const unsigned count : {1u, 4u}) {
    Mutex mutex;
    std::vector<int> done(1000);
    int left = 1000;
    Loaders loaders(mutex, count, [&](const Loaders::Job& job, MutexLock& lock) {
      lock.unlock();
      std::this_thread::yield();
      lock.lock();
      ++done[job.unit];
      --left;
      return true;
    });
    const CacheUserPtr user = User();
    MutexLock lock(mutex);
    loaders.Start();
    loaders.Start();
    REQUIRE(loaders.has_threads());
    for (UnitId u = 0; u < done.size(); ++u) loaders.Push(u, user);
    loaders.Wake();
    while (left > 0) {
      if (loaders.RunOne(lock)) continue;
      lock.unlock();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      lock.lock();
    }
    lock.unlock();
    loaders.Stop();
    REQUIRE(done == std::vector<int>(1000, 1));
  }
}

}  // namespace mtdb::testing
