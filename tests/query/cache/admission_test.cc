// SPDX-License-Identifier: Apache-2.0
// Who may hold units alone: the door, and what a reader may hold.
#include "query/cache/admission.h"

#include <catch2/catch.hpp>
#include <random>
#include <thread>
#include <vector>

namespace mtdb::testing {

using namespace internal;

namespace {

Status Refuse(ConditionVariable&) { return {StatusCode::kNotYet, "does not wait"}; }
Status FailToWait(ConditionVariable&) { ThrowOutOfMemory(); }

}  // namespace

TEST_CASE("What is held needs its bytes and room to load any one of it anew") {
  Holding held;
  REQUIRE(!held.inside());
  REQUIRE(held.NeededWith(10, 5) == 15);
  held.Add(3, 10, 5);
  REQUIRE(held.inside());
  REQUIRE(held.NeededWith(20, 2) == 35);  // the first one's overhead is larger
  REQUIRE(held.NeededWith(20, 7) == 37);
  held.Add(4, 20, 7);
  REQUIRE(held.bytes == 30);
  REQUIRE(held.overhead == 7);
  held.Clear();
  REQUIRE(!held.inside());
  REQUIRE(held.NeededWith(0, 0) == 0);
  held.alone = true;
  REQUIRE(held.inside());
}

TEST_CASE("Any number comes in by the open door, and one alone when they have left") {
  Admission admission;
  REQUIRE(admission.idle());
  REQUIRE(admission.Enter(Refuse).ok());
  REQUIRE(admission.Enter(Refuse).ok());
  REQUIRE(!admission.idle());
  // Who waits to be alone closes the door, and gives way when it does not wait.
  const auto look = [&](ConditionVariable& changed) {
    REQUIRE(admission.closed());
    REQUIRE(admission.awaited());
    REQUIRE(admission.Enter(Refuse).code() == StatusCode::kNotYet);
    return Refuse(changed);
  };
  REQUIRE(admission.EnterAlone(look).code() == StatusCode::kNotYet);
  REQUIRE(!admission.closed());
  REQUIRE(admission.EnterAlone(FailToWait).code() == StatusCode::kNoSpace);
  REQUIRE(!admission.closed());
  admission.Leave();
  const auto leave = [&](ConditionVariable&) {
    admission.Leave();
    return Status::Ok();
  };
  REQUIRE(admission.EnterAlone(leave).ok());
  REQUIRE(admission.closed());
  REQUIRE(!admission.awaited());
  REQUIRE(admission.Enter(Refuse).code() == StatusCode::kNotYet);
  REQUIRE(admission.EnterAlone(Refuse).code() == StatusCode::kNotYet);
  admission.LeaveAlone();
  REQUIRE(admission.idle());
}

TEST_CASE("Nobody waits in a circle, and who is alone is", "[threads]") {
  Mutex mutex;
  Admission admission;
  int inside = 0, wrong = 0;
  bool alone = false;
  std::vector<std::thread> threads;
  for (unsigned t = 0; t < 6; ++t) {
    threads.emplace_back([&, t] {
      std::mt19937 random(t);
      for (int step = 0; step < 300; ++step) {
        const bool wants_all = random() % 3 == 0;
        MutexLock lock(mutex);
        const auto wait = [&](ConditionVariable& changed) {
          changed.wait(lock);
          return Status::Ok();
        };
        const Status in = wants_all ? admission.EnterAlone(wait) : admission.Enter(wait);
        if (!in.ok() || alone || (wants_all && inside > 0)) ++wrong;
        ++inside;
        alone = wants_all;
        lock.unlock();
        if (random() % 4 == 0) std::this_thread::yield();
        lock.lock();
        --inside;
        if (wants_all) {
          alone = false;
          admission.LeaveAlone();
        } else {
          admission.Leave();
        }
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  REQUIRE(wrong == 0);
  REQUIRE(admission.idle());
}

}  // namespace mtdb::testing
