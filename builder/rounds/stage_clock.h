// SPDX-License-Identifier: Apache-2.0
// StageClock: tells a build's progress, and counts what its stages take.
#pragma once

#include <chrono>
#include <cstdint>
#include <vector>

#include "builder/build.h"
#include "builder/disk/spool.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Shares of the whole work, for progress only.
constexpr double kReadShare = 0.04;
constexpr double kJoinShare = 0.12;
constexpr double kRoundsEnd = 0.98;

// Work of one thread. What it is made of must outlive it.
class StageClock {
 public:
  StageClock(const ProgressCallback& progress, const SpoolSpace& space,
             std::vector<StageCost>& stages);

  // The build is at work on this stage. Sets the progress's tmp_bytes; the error is the caller's,
  // who cancels the build.
  Status Report(BuildProgress progress);
  // Adds the time since the last call to the stage that was named then.
  void Count(const char* stage, uint32_t round = 0);

 private:
  const ProgressCallback& progress_;
  const SpoolSpace& space_;
  std::vector<StageCost>& stages_;
  std::chrono::steady_clock::time_point begin_;
  double begin_cpu_ = 0;
};

}  // namespace mtdb::internal
