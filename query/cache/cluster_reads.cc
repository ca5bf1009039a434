// SPDX-License-Identifier: Apache-2.0
// The part of ClusterCache that asks a source that answers later.
#include <algorithm>
#include <functional>
#include <string>
#include <tuple>

#include "query/cache/cache_plan.h"
#include "query/cache/cluster_cache.h"
#include "query/cache/unit_reader.h"
#include "store/base/out_of_memory.h"

namespace mtdb::internal {
namespace {

// What is asked for ahead and has not been decoded takes at most this share.
constexpr size_t kAheadShare = 4;

}  // namespace

// True for any that can be read now.
bool ClusterCache::HasPayload(UnitId unit, const LoadRequest& request) const {
  return CanLoad(unit) || (request.reader != nullptr && request.reader->payloads_.contains(unit));
}

Status ClusterCache::AskForPlan(LoadRequest& request, Lock& lock) {
  std::vector<UnitId> missing;
  UnitId waits_for = kNone32;
  for (const UnitId u : request.plan->todo()) {
    const Entry& entry = entries_[u];
    const auto failed = request.client->failures.find(u);
    if (failed != request.client->failures.end()) return failed->second;
    if (entry.asked != nullptr || entry.state == State::kLoading) waits_for = u;
    if (entry.state != State::kEmpty || entry.asked != nullptr || HasPayload(u, request)) continue;
    missing.push_back(u);
  }
  // A job decodes what has come.
  if (request.waits && !missing.empty()) {
    const UnitId first = missing.front();
    if (UnitReader* const reader = request.reader; reader != nullptr) {
      MTDB_RETURN_IF_ERROR(reader->Check());
      reader->CutToLimit(missing);
      if (missing.empty() && waits_for == kNone32) return reader->OverLimit(first);
    }
    const std::shared_ptr<Batch> batch = Ask(missing, request.client, Asking::kToWait, lock);
    if (batch == nullptr && waits_for == kNone32 && !missing.empty()) {
      if (request.plan->GiveUpPayloads(first)) return Status::Ok();
      request.no_room = true;
      return NoRoom(first, index_.Has(first) ? index_.location(first).length : 1);
    }
    // It may have come during the call.
    if (batch != nullptr) return Status::Ok();
  }
  return Wait(waits_for, request, lock);
}

std::shared_ptr<ClusterCache::Batch> ClusterCache::Ask(std::span<const UnitId> units,
                                                       const ClientPtr& client, Asking asking,
                                                       Lock& lock) {
  const auto batch = std::make_shared<Batch>(door_, client, asking);
  batch->units.reserve(units.size());
  MakeRoomForOne(batches_);
  Dropped dropped(*this);
  const ObjectRecord& record = source_->record();
  const uint64_t typical = record.payload_bytes / std::max(1u, index_.unit_count()) + 1;
  for (const UnitId u : units) {
    Entry& entry = entries_[u];
    if (entry.state != State::kEmpty || CanLoad(u) || entry.asked != nullptr) {
      continue;
    }
    const size_t bytes = index_.Has(u) ? index_.location(u).length : typical;
    const bool fits = asking == Asking::kAhead ? bytes_ + bytes <= options_.budget_bytes
                                               : MakeRoom(bytes, dropped);
    if (!fits) break;
    entry.asked = batch.get();
    entry.asked_bytes = bytes;
    bytes_ += bytes;
    batch->units.push_back(u);
  }
  if (batch->units.empty()) return nullptr;
  peak_bytes_ = std::max(peak_bytes_, bytes_);
  batch->open = batch->units.size();
  batches_.push_back(batch);
  std::vector<UnitId> order;
  if (!TryAllocate([&] { order = batch->units; })) {
    Withdraw(*batch);
    return nullptr;
  }
  std::ranges::sort(order, {}, [&](UnitId u) {
    if (!index_.Has(u)) return std::tuple(kNone32, kNone32, u);
    const PayloadLocation& at = index_.location(u);
    return std::tuple(at.value, at.offset, u);
  });
  LetGo(dropped, lock);
  TellSource(lock);
  lock.unlock();
  const bool asked = TryAllocate([&] { source_->Read(order, batch); });
  lock.lock();
  if (!asked) Withdraw(*batch);
  return batch;
}

void ClusterCache::AskAhead(std::span<const UnitId> units, const ClientPtr& client, Lock& lock) {
  std::vector<UnitId> list;
  std::vector<bool> listed(entries_.size());
  const auto add = [&](UnitId u) {
    if (listed[u] || entries_[u].state != State::kEmpty) return;
    listed[u] = true;
    list.push_back(u);
  };
  for (const UnitId u : units) add(u);
  size_t bytes = payload_bytes_;
  for (const auto& batch : batches_) {
    for (const UnitId u : batch->units) {
      if (entries_[u].asked == batch.get()) bytes += entries_[u].asked_bytes;
    }
  }
  for (size_t i = 0; i < list.size(); ++i) {
    if (!index_.Has(list[i])) continue;
    bytes += index_.location(list[i]).length;
    if (bytes > options_.budget_bytes / kAheadShare) {
      list.resize(i);
      break;
    }
    for (const UnitId p : index_.parents(list[i])) add(p);
  }
  std::ranges::sort(list, std::greater<>());
  Ask(list, client, Asking::kAhead, lock);
}

void ClusterCache::Arrive(Batch& batch, UnitId unit, Result<Bytes> payload) {
  MutexLock lock(mutex_);
  if (unit >= entries_.size() || entries_[unit].asked != &batch) return;  // withdrawn
  Dropped dropped(*this);
  Entry& entry = entries_[unit];
  const ClientPtr client = batch.client;
  const bool decodes = batch.asking != Asking::kToWait;
  Withdraw(unit);
  Status status = payload.status();
  if (status.ok() && (!index_.Has(unit) || payload->size() != index_.location(unit).length)) {
    status = Corrupt(UnitName(source_->record(), unit) + ": the source gave " +
                     std::to_string(payload->size()) + " bytes, which its index does not say");
  }
  if (status.ok()) {
    const size_t bytes = payload->size();
    client->stats.bytes_read += bytes;
    ++(index_.unit(unit).nodes == 0 ? client->stats.root_pieces_read : client->stats.clusters_read);
    client->read[unit] = true;
    if (client->control != nullptr) client->control->CountLoad();
    // It was counted, but for a row that came with it.
    if (MakeRoom(bytes, dropped)) {
      Payload shared;
      const bool kept = TryAllocate([&] {
        shared = std::make_shared<const Bytes>(std::move(*payload));
        payloads_.push_back(unit);
      });
      if (kept) {
        entry.payload = std::move(shared);
        payload_bytes_ += bytes;
        bytes_ += bytes;
        peak_bytes_ = std::max(peak_bytes_, bytes_);
      } else {
        status = OutOfMemory();
      }
    }
  }
  if (!status.ok()) static_cast<void>(TryAllocate([&] { client->failures[unit] = status; }));
  loaded_.notify_all();
  if (decodes && entry.payload != nullptr && !client->stopped) {
    static_cast<void>(TryAllocate([&] { jobs_.push({unit, client}); }));
    work_.notify_all();
  }
  LetGo(dropped, lock);
}

void ClusterCache::Withdraw(UnitId unit) {
  Entry& entry = entries_[unit];
  const auto batch = std::ranges::find(batches_, entry.asked, &std::shared_ptr<Batch>::get);
  if (--(*batch)->open == 0) batches_.erase(batch);
  bytes_ -= entry.asked_bytes;
  entry.asked_bytes = 0;
  entry.asked = nullptr;
}

// The list of the withdrawn may miss some that the source then answers in vain.
void ClusterCache::Withdraw(const Batch& batch) {
  const auto at = std::ranges::find(batches_, &batch, &std::shared_ptr<Batch>::get);
  if (at == batches_.end()) return;
  const std::shared_ptr<Batch> held = *at;
  for (const UnitId u : held->units) {
    if (entries_[u].asked == held.get()) Withdraw(u);
  }
  static_cast<void>(TryAllocate([&] { withdrawn_.push_back(held); }));
  loaded_.notify_all();
}

void ClusterCache::TellSource(Lock& lock) {
  if (withdrawn_.empty()) return;
  std::vector<std::shared_ptr<Batch>> batches;
  batches.swap(withdrawn_);
  lock.unlock();
  for (const auto& batch : batches) source_->Cancel(*batch);
  lock.lock();
}

void ClusterCache::CancelReads() {
  MutexLock lock(mutex_);
  while (!batches_.empty()) Withdraw(*std::shared_ptr<Batch>(batches_.back()));
  TellSource(lock);
}

}  // namespace mtdb::internal
