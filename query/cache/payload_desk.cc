// SPDX-License-Identifier: Apache-2.0
#include "query/cache/payload_desk.h"

#include <algorithm>
#include <tuple>
#include <utility>

#include "query/fields/make_room.h"
#include "store/base/out_of_memory.h"

namespace mtdb::internal {

PayloadDesk::PayloadDesk(std::shared_ptr<ClusterSource> source, ByteBudget& budget,
                         ConditionVariable& changed, OnAnswer on_answer)
    : source_(std::move(source)),
      budget_(budget),
      changed_(changed),
      door_(std::make_shared<Door>()),
      entries_(source_->index().unit_count()) {
  door_->on_answer = std::move(on_answer);
}

PayloadDesk::~PayloadDesk() {
  {
    const MutexLock lock(door_->mutex);
    door_->on_answer = nullptr;
  }
  for (const auto& batch : batches_) source_->Cancel(*batch);
  for (const auto& batch : withdrawn_) source_->Cancel(*batch);
}

size_t PayloadDesk::SizeOf(UnitId unit) const {
  const ClusterIndex& index = source_->index();
  if (index.Has(unit)) return index.location(unit).length;
  return source_->record().payload_bytes / std::max(1u, index.unit_count()) + 1;
}

bool PayloadDesk::GiveUp(UnitId unit) {
  const Entry& entry = entries_[unit];
  if (entry.wanted > 1 || (entry.batch == nullptr && entry.payload == nullptr)) return false;
  if (entry.batch != nullptr) TakeOff(unit);
  if (entry.payload != nullptr) Drop(unit);
  return true;
}

bool PayloadDesk::Put(UnitId unit, Payload payload) {
  if (!TryAllocate([&] { there_.push_back(unit); })) return false;
  bytes_ += payload->size();
  budget_.Add(payload->size());
  entries_[unit].payload = std::move(payload);
  return true;
}

void PayloadDesk::Drop(UnitId unit) {
  Payload& payload = entries_[unit].payload;
  there_.erase(std::ranges::find(there_, unit));
  bytes_ -= payload->size();
  budget_.Remove(payload->size());
  payload.reset();
}

bool PayloadDesk::DropOldest() {
  const auto at = std::ranges::find(there_, 0u, [&](UnitId u) { return entries_[u].wanted; });
  if (at == there_.end()) return false;
  Drop(*at);
  return true;
}

PayloadDesk::BatchPtr PayloadDesk::NewBatch(size_t units, CacheUserPtr user, Asking asking) {
  const auto batch = std::make_shared<Batch>(door_, std::move(user), asking);
  batch->units.reserve(units);
  MakeRoomForOne(batches_);
  return batch;
}

void PayloadDesk::Expect(const BatchPtr& batch, UnitId unit, size_t bytes) {
  if (batch->open++ == 0) batches_.push_back(batch);
  batch->units.push_back(unit);
  entries_[unit].batch = batch.get();
  entries_[unit].expected_bytes = bytes;
  bytes_on_their_way_ += bytes;
  budget_.Add(bytes);
}

void PayloadDesk::Send(const BatchPtr& batch, MutexLock& lock) {
  const ClusterIndex& index = source_->index();
  std::ranges::sort(batch->units, {}, [&](UnitId u) {
    if (!index.Has(u)) return std::tuple(kNone32, kNone32, u);
    const PayloadLocation& at = index.location(u);
    return std::tuple(at.value, at.offset, u);
  });
  TellSource(lock);
  lock.unlock();
  const bool asked = TryAllocate([&] { source_->Read(batch->units, batch); });
  lock.lock();
  if (!asked) Withdraw(batch);
}

bool PayloadDesk::TakeOff(const Batch& batch, UnitId unit) {
  if (unit >= entries_.size() || !Expects(batch, unit)) return false;
  TakeOff(unit);
  return true;
}

void PayloadDesk::TakeOff(UnitId unit) {
  Entry& entry = entries_[unit];
  const auto batch = std::ranges::find(batches_, entry.batch, &BatchPtr::get);
  bytes_on_their_way_ -= entry.expected_bytes;
  budget_.Remove(entry.expected_bytes);
  entry.expected_bytes = 0;
  entry.batch = nullptr;
  if (--(*batch)->open == 0) batches_.erase(batch);
}

// The list of the withdrawn may miss some that the source then answers in vain.
void PayloadDesk::Withdraw(const BatchPtr& batch) {
  if (batch->open == 0) return;
  for (const UnitId u : batch->units) {
    if (Expects(*batch, u)) TakeOff(u);
  }
  static_cast<void>(TryAllocate([&] { withdrawn_.push_back(batch); }));
  changed_.notify_all();
}

bool PayloadDesk::WithdrawAhead() {
  const auto at =
      std::ranges::find(batches_, Asking::kAhead, [](const BatchPtr& b) { return b->asking; });
  if (at == batches_.end()) return false;
  Withdraw(BatchPtr(*at));
  return true;
}

void PayloadDesk::TellSource(MutexLock& lock) {
  if (withdrawn_.empty()) return;
  std::vector<BatchPtr> batches;
  batches.swap(withdrawn_);
  lock.unlock();
  for (const auto& batch : batches) source_->Cancel(*batch);
  lock.lock();
}

}  // namespace mtdb::internal
