// SPDX-License-Identifier: Apache-2.0
// WorkMeter: counts what a query's questions cost, and ends them when the query is to end.
#pragma once

#include <cstdint>
#include <functional>
#include <utility>

#include "store/base/status.h"

namespace mtdb::internal {

// A question to a region or threshold may take long: 100,000 corners, thousands of members. So
// whoever answers counts steps here, each worth some ten to a hundred nanoseconds, and every few
// hundred of them the query looks at its control and its deadline. Once it is to end, each step
// says so, questions end with whatever answer, and the query, which may use none of these, returns
// status(). While a meter lives it is the one of its thread, unless a newer one lives.
class WorkMeter {
 public:
  static constexpr uint64_t kStepsPerLook = 512;

  explicit WorkMeter(std::function<Status()> look) : look_(std::move(look)), outer_(current_) {
    current_ = this;
  }
  ~WorkMeter() { current_ = outer_; }
  WorkMeter(const WorkMeter&) = delete;
  WorkMeter& operator=(const WorkMeter&) = delete;

  // The thread's; null when nobody counts.
  static WorkMeter* Current() { return current_; }

  // False when the query is to end.
  bool Spend(uint64_t steps) {
    steps_ += steps;
    return steps_ < next_look_ || Look();
  }
  // Why it is to end; ok while it is not.
  const Status& status() const { return status_; }
  uint64_t steps() const { return steps_; }
  // What ended the questions does not any more.
  void Resume() {
    status_ = Status::Ok();
    next_look_ = steps_;
  }

 private:
  bool Look() {
    if (!status_.ok()) return false;
    status_ = look_();
    if (status_.ok()) next_look_ = steps_ + kStepsPerLook;
    return status_.ok();
  }

  // NOLINTNEXTLINE(readability-identifier-naming)
  static inline thread_local WorkMeter* current_ = nullptr;

  std::function<Status()> look_;
  WorkMeter* const outer_;
  uint64_t steps_ = 0;
  uint64_t next_look_ = kStepsPerLook;
  Status status_;
};

// For regions and thresholds: steps of the question at hand. False: the answer does not matter.
inline bool SpendSteps(uint64_t steps) {
  WorkMeter* const meter = WorkMeter::Current();
  return meter == nullptr || meter->Spend(steps);
}

}  // namespace mtdb::internal
