// Lack of memory at every allocation: an error, nothing lost, and the next query works.
#include "store/base/out_of_memory.h"

#include <catch2/catch.hpp>
#include <memory>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "tests/support/failing_allocation.h"

namespace mtdb::testing {
namespace {

using Mode = FailingAllocation::Mode;

}  // namespace

TEST_CASE("The n-th allocation fails, once or from then on, and the creation of a thread counts") {
  const auto count_failures = [](uint64_t nth, Mode mode) {
    uint64_t failed = 0;
    const FailingAllocation failing(nth, mode);
    for (int i = 0; i < 4; ++i) {
      try {
        ::operator delete(::operator new(8));  // calls that no compiler leaves out
      } catch (const std::bad_alloc&) {
        ++failed;
      }
    }
    return failed == failing.failures() ? failed : 99;
  };
  CHECK(count_failures(2, Mode::kOnce) == 1);
  CHECK(count_failures(2, Mode::kFromThenOn) == 3);
  CHECK(count_failures(5, Mode::kFromThenOn) == 0);

  const auto start_thread = [] {
    return CatchOutOfMemory([]() -> Status {
      try {
        std::thread([] {}).join();
      } catch (const std::system_error&) {
        return {StatusCode::kBusy, "no thread"};
      }
      return Status::Ok();
    });
  };
  std::vector<StatusCode> codes;
  codes.reserve(10);
  const uint64_t n =
      FailEachAllocation(Mode::kOnce, start_thread,
                         [&](uint64_t, const Status& status) { codes.push_back(status.code()); });
  CHECK(n >= 3);
  CHECK(codes.front() == StatusCode::kNoSpace);  // the thread's function
  CHECK(std::count(codes.begin(), codes.end(), StatusCode::kBusy) == 1);
  CHECK(codes.back() == StatusCode::kOk);
}

TEST_CASE("A lack of memory becomes a Status without memory") {
  const auto run = [] {
    return CatchOutOfMemory([]() -> Result<std::string> { return std::string(1000, 'x'); });
  };
  const uint64_t n = FailEachAllocation(Mode::kFromThenOn, run, [](uint64_t, auto result) {
    if (result.ok()) return;
    CHECK(result.status().code() == StatusCode::kNoSpace);
    CHECK(result.status().message() == "out of memory");
  });
  CHECK(n == 2);
}

}  // namespace mtdb::testing
