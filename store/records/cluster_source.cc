// SPDX-License-Identifier: Apache-2.0
#include "store/cluster_source.h"

#include <deque>
#include <optional>
#include <utility>

#include "store/base/out_of_memory.h"
#include "store/base/threading.h"
#include "store/base/wait_scope.h"

namespace mtdb {
namespace {

// Answers until they are taken.
class Inbox final : public PayloadReceiver {
 public:
  void Receive(UnitId unit, Result<Bytes> payload) override {
    const MutexLock lock(mutex_);
    // Without memory for the answer the reader still learns that there was one.
    if (!TryAllocate([&] { answers_.emplace_back(unit, std::move(payload)); })) ++lost_;
    arrived_.notify_all();
  }

  Result<std::pair<UnitId, Bytes>> Next() {
    MutexLock lock(mutex_);
#if MTDB_THREADS
    if (!WaitScope::Wait(arrived_, lock, [&] { return !answers_.empty() || lost_ > 0; })) {
      return Status(StatusCode::kCancelled, "cancelled");
    }
#endif
    if (lost_ > 0) return OutOfMemory();
    if (answers_.empty()) return NotYet("the source has not answered");
    auto [unit, payload] = std::move(answers_.front());
    answers_.pop_front();
    if (!payload.ok()) return payload.status();
    return std::pair(unit, *std::move(payload));
  }

 private:
  Mutex mutex_;
  ConditionVariable arrived_;
  std::deque<std::pair<UnitId, Result<Bytes>>> answers_;
  size_t lost_ = 0;
};

}  // namespace

Status ReadUnits(ClusterSource& source, std::span<const UnitId> units,
                 const std::function<Status(UnitId, Bytes)>& receive) {
  const auto inbox = std::make_shared<Inbox>();
  source.Read(units, inbox);
  for (size_t left = units.size(); left > 0; --left) {
    auto next = inbox->Next();
    Status status = next.status();
    if (status.ok()) status = receive(next->first, std::move(next->second));
    if (!status.ok()) {
      source.Cancel(*inbox);
      return status;
    }
  }
  return Status::Ok();
}

}  // namespace mtdb
