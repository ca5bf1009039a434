// SPDX-License-Identifier: Apache-2.0
#include "builder/rounds/stage_clock.h"

#include <algorithm>
#include <ctime>
#include <string>

namespace mtdb::internal {

namespace {

double ProcessSeconds() {
  timespec cpu{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &cpu);
  return static_cast<double>(cpu.tv_sec) + 1e-9 * static_cast<double>(cpu.tv_nsec);
}

}  // namespace

StageClock::StageClock(const ProgressCallback& progress, const SpoolSpace& space,
                       std::vector<StageCost>& stages)
    : progress_(progress), space_(space), stages_(stages) {
  stages_.clear();
}

Status StageClock::Report(BuildProgress progress) {
  Count(progress.stage, progress.round);
  if (!progress_) return Status::Ok();
  progress.overall = std::min(1.0, progress.overall);
  progress.tmp_bytes = space_.file_bytes;
  return progress_(progress);
}

void StageClock::Count(const char* stage, uint32_t round) {
  const auto now = std::chrono::steady_clock::now();
  const double cpu_now = ProcessSeconds();
  if (!stages_.empty()) {
    StageCost& last = stages_.back();
    last.seconds += std::chrono::duration<double>(now - begin_).count();
    last.cpu_seconds += cpu_now - begin_cpu_;
    last.tmp_bytes = std::max<uint64_t>(last.tmp_bytes, space_.file_bytes);
  }
  begin_ = now;
  begin_cpu_ = cpu_now;
  std::string name = stage;
  if (round != 0) name += " " + std::to_string(round);
  if (stages_.empty() || stages_.back().stage != name) stages_.push_back({name, 0, 0, 0});
}

}  // namespace mtdb::internal
