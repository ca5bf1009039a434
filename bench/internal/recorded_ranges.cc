// SPDX-License-Identifier: Apache-2.0
#include "bench/internal/recorded_ranges.h"

#include <algorithm>
#include <utility>

namespace mtdb {

using Clock = std::chrono::steady_clock;

RangeReader::Ticket RecordedRanges::Read(ByteRange range, Answer answer) {
  size_t at = 0;
  {
    const std::lock_guard lock(mutex_);
    at = all_.size();
    all_.push_back({range, Clock::now(), {}});
  }
  const Ticket ticket = inner_->Read(range, [this, at, answer](Result<Bytes> bytes) {
    {
      const std::lock_guard lock(mutex_);
      all_[at].end = Clock::now();
    }
    answer(std::move(bytes));
  });
  const std::lock_guard lock(mutex_);
  if (ticket == 0) all_[at].range.bytes = 0;
  return ticket;
}

std::vector<RecordedRanges::Request> RecordedRanges::requests_made() const {
  const std::lock_guard lock(mutex_);
  std::vector<Request> made(all_);
  std::erase_if(made, [](const Request& r) { return r.range.bytes == 0; });
  return made;
}

size_t RecordedRanges::RoundTrips() const {
  const std::vector<Request> made = requests_made();
  std::vector<size_t> depth(made.size());
  size_t most = 1;
  for (size_t i = 0; i < made.size(); ++i) {
    if (made[i].end == Clock::time_point()) continue;
    depth[i] = 2;
    for (size_t j = 0; j < i; ++j) {
      if (depth[j] > 0 && made[j].end <= made[i].begin) depth[i] = std::max(depth[i], depth[j] + 1);
    }
    most = std::max(most, depth[i]);
  }
  return most;
}

}  // namespace mtdb
