// SPDX-License-Identifier: Apache-2.0
#include "tools/server/internal/fair_queue.h"

#include <algorithm>

#include "store/base/check.h"

namespace mtdb::internal {

bool FairQueue::LongSlotFor(const Group& group) const {
  const size_t most = std::max(1u, limits_.long_slots - 1);
  return long_running_ < limits_.long_slots && group.long_running < most;
}

bool FairQueue::MayRun(const Entry& entry) const {
  return entry.is_long ? LongSlotFor(groups_.at(entry.address))
                       : running_.size() - long_running_ < limits_.slots;
}

void FairQueue::Push(Job job, const ServerClient& client, bool is_long) {
  Entries one;
  one.push_back({job, client.address, client.connection, is_long, false, 0});
  Group& group = groups_[client.address];
  Share& member = group.members[client.connection];
  if (group.jobs++ == 0) group.used = std::max(group.used, now_);
  if (member.jobs++ == 0) member.used = std::max(member.used, group.now);
  waiting_.splice(waiting_.end(), one);
  if (!is_long) ++short_waiting_;
}

std::optional<FairQueue::Job> FairQueue::Start(double now_seconds) {
  // The address that has used the least, then its connection that has; among equals the first.
  auto next = waiting_.end();
  const Group* least = nullptr;
  for (auto at = waiting_.begin(); at != waiting_.end(); ++at) {
    if (!MayRun(*at)) continue;
    const Group& group = groups_.at(at->address);
    const bool first = least == nullptr || group.used < least->used;
    if (!first && (&group != least || group.members.at(at->connection).used >=
                                          group.members.at(next->connection).used)) {
      continue;
    }
    next = at;
    least = &group;
  }
  if (next == waiting_.end()) return std::nullopt;
  Group& group = groups_.at(next->address);
  now_ = std::max(now_, group.used);
  group.now = std::max(group.now, group.members.at(next->connection).used);
  Charge(*next, kLeastCharge);
  next->begin = now_seconds;
  if (next->is_long) {
    ++long_running_;
    ++group.long_running;
  } else {
    --short_waiting_;
  }
  running_.splice(running_.end(), waiting_, next);
  return next->job;
}

std::optional<FairQueue::Job> FairQueue::Preempt(double now_seconds) {
  size_t wanted = short_waiting_;
  // What is free already, or will be.
  const size_t taken = running_.size() - long_running_;
  size_t coming = limits_.slots - std::min<size_t>(limits_.slots, taken);
  for (const Entry& entry : running_) coming += entry.stopping && !entry.is_long ? 1 : 0;
  auto last = running_.end();
  for (auto at = running_.begin(); at != running_.end() && coming < wanted; ++at) {
    if (at->is_long || at->stopping || now_seconds - at->begin < limits_.long_seconds) continue;
    Group& group = groups_.at(at->address);
    if (LongSlotFor(group)) {
      at->is_long = true;
      ++long_running_;
      ++group.long_running;
      ++coming;
    } else {
      last = at;  // that has the least to lose
    }
  }
  if (coming >= wanted || last == running_.end()) return std::nullopt;
  last->stopping = true;
  return last->job;
}

void FairQueue::Finish(Job job, double now_seconds) {
  const auto has_id = [job](const Entry& entry) { return entry.job == job; };
  if (const auto at = std::find_if(running_.begin(), running_.end(), has_id);
      at != running_.end()) {
    Charge(*at, std::max(0.0, now_seconds - at->begin - kLeastCharge));
    if (at->is_long) {
      --long_running_;
      --groups_.at(at->address).long_running;
    }
    Leave(*at);
    running_.erase(at);
  } else {
    const auto waits = std::find_if(waiting_.begin(), waiting_.end(), has_id);
    MTDB_CHECK(waits != waiting_.end(), "no such job");
    if (!waits->is_long) --short_waiting_;
    Leave(*waits);
    waiting_.erase(waits);
  }
  // Those who ask for nothing are remembered only while others are behind them.
  const bool idle = waiting_.empty() && running_.empty();
  std::erase_if(groups_, [&](const auto& entry) {
    return entry.second.jobs == 0 && (idle || entry.second.used <= now_);
  });
}

void FairQueue::Charge(const Entry& entry, double seconds) {
  Group& group = groups_.at(entry.address);
  Share& member = group.members.at(entry.connection);
  group.used = std::min(group.used + seconds, now_ + kMostBehind);
  member.used = std::min(member.used + seconds, group.now + kMostBehind);
}

void FairQueue::Leave(const Entry& entry) {
  Group& group = groups_.at(entry.address);
  --group.jobs;
  Share& member = group.members.at(entry.connection);
  --member.jobs;
  std::erase_if(group.members, [&](const auto& other) {
    return other.second.jobs == 0 && (group.jobs == 0 || other.second.used <= group.now);
  });
}

}  // namespace mtdb::internal
