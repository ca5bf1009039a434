// SPDX-License-Identifier: Apache-2.0
// PayloadDesk: payloads that are there, and those that the source was asked for.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "query/cache/byte_budget.h"
#include "query/cache/cache_user.h"
#include "store/base/threading.h"
#include "store/cluster_source.h"

namespace mtdb::internal {

// Why payloads are asked for.
enum class Asking : uint8_t {
  kToWait,    // whoever waits for them decodes them
  kToDecode,  // nobody waits: the cache's threads decode what comes
  kAhead,     // likewise, and they give way to all else
};

// Payloads that are there and that are on their way count in the budget. Each is on its way once.
// An answer that is not expected any more is none. The cache's mutex guards it; where a function
// takes the lock, it lets go of that while it calls the source.
class PayloadDesk {
 public:
  class Batch;
  using BatchPtr = std::shared_ptr<Batch>;
  // Takes an answer, on any thread and without the mutex.
  using OnAnswer = std::function<void(Batch&, UnitId, Result<Bytes>)>;

  // Notifies `changed` when a batch does not come.
  PayloadDesk(std::shared_ptr<ClusterSource> source, ByteBudget& budget, ConditionVariable& changed,
              OnAnswer on_answer);
  // The source is told that nothing is wanted, and its answers find nobody.
  ~PayloadDesk();

  // Null when it is not there.
  const Payload& Find(UnitId unit) const { return entries_[unit].payload; }
  bool on_its_way(UnitId unit) const { return entries_[unit].batch != nullptr; }
  // Of the payload, or what is usual when nothing is known of the unit.
  size_t SizeOf(UnitId unit) const;
  // Of those that are there.
  size_t bytes() const { return bytes_; }
  size_t bytes_on_their_way() const { return bytes_on_their_way_; }

  // Somebody is about to decode the unit: its payload stays until Unwant.
  void Want(UnitId unit) { ++entries_[unit].wanted; }
  void Unwant(UnitId unit) { --entries_[unit].wanted; }
  // When at most one wants it: it is not there, and not on its way. False when it was neither.
  bool GiveUp(UnitId unit);

  // False without memory; then it is not there.
  bool Put(UnitId unit, Payload payload);
  void Drop(UnitId unit);
  // Of those that nobody wants; false when there is none.
  bool DropOldest();

  // A batch of at most so many units, none so far.
  BatchPtr NewBatch(size_t units, CacheUserPtr user, Asking asking);
  // The unit is on its way, and counts so many bytes. Needs no memory.
  void Expect(const BatchPtr& batch, UnitId unit, size_t bytes);
  // Asks the source, in the order of the places. What could not be asked for is withdrawn.
  void Send(const BatchPtr& batch, MutexLock& lock);
  bool Expects(const Batch& batch, UnitId unit) const { return entries_[unit].batch == &batch; }
  // It is not on its way any more; false when it was not, in this batch.
  bool TakeOff(const Batch& batch, UnitId unit);
  // Nobody wants these batches: those for which f(batch) is true.
  template <typename F>
  void WithdrawIf(F&& f) {
    for (size_t i = batches_.size(); i-- > 0;) {
      if (f(*batches_[i])) Withdraw(BatchPtr(batches_[i]));
    }
  }
  // The oldest that was asked for ahead; false when there is none.
  bool WithdrawAhead();
  // Tells the source of batches that were withdrawn.
  void TellSource(MutexLock& lock);

 private:
  struct Entry {
    Payload payload;
    const Batch* batch = nullptr;  // on its way in this one
    size_t expected_bytes = 0;     // counted for that
    uint32_t wanted = 0;
  };
  // Where answers find the desk, or nothing when it is gone.
  struct Door {
    Mutex mutex;
    OnAnswer on_answer;
  };
  void TakeOff(UnitId unit);
  void Withdraw(const BatchPtr& batch);

  const std::shared_ptr<ClusterSource> source_;
  ByteBudget& budget_;
  ConditionVariable& changed_;
  const std::shared_ptr<Door> door_;
  std::vector<Entry> entries_;       // by unit
  std::deque<UnitId> there_;         // oldest first
  size_t bytes_ = 0;                 // of these
  std::vector<BatchPtr> batches_;    // with units on their way, oldest first
  size_t bytes_on_their_way_ = 0;    // of these
  std::vector<BatchPtr> withdrawn_;  // which the source does not know yet
};

// What was asked for in one call.
class PayloadDesk::Batch final : public PayloadReceiver {
 public:
  Batch(std::shared_ptr<Door> door, CacheUserPtr for_user, Asking why)
      : user(std::move(for_user)), asking(why), door_(std::move(door)) {}
  void Receive(UnitId unit, Result<Bytes> payload) override {
    const MutexLock lock(door_->mutex);
    if (door_->on_answer) door_->on_answer(*this, unit, std::move(payload));
  }

  const CacheUserPtr user;
  const Asking asking;
  std::vector<UnitId> units;  // that were expected
  size_t open = 0;            // that are on their way

 private:
  const std::shared_ptr<Door> door_;
};

}  // namespace mtdb::internal
