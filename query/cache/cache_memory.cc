// SPDX-License-Identifier: Apache-2.0
#include "query/cache/cache_memory.h"

#include <algorithm>
#include <bit>
#ifdef __GLIBC__
#include <malloc.h>
#endif
#include <utility>

#include "query/fields/make_room.h"
#include "store/base/out_of_memory.h"

namespace mtdb::internal {
namespace {

constexpr size_t kMuchBytes = size_t{16} << 20;
// Payloads that are kept take at most this share of the budget: the rest is for the units that a
// query decodes.
constexpr size_t kPayloadShare = 2;

}  // namespace

void GiveMemoryBack() {
#ifdef __GLIBC__
  malloc_trim(0);
#endif
}

CacheMemory::CacheMemory(std::shared_ptr<ClusterSource> from, const CacheOptions& cache_options,
                         PayloadDesk::OnAnswer on_answer)
    : source(std::move(from)),
      index(source->index()),
      options(cache_options),
      at_once(source->answers_at_once()),
      budget(options.budget_bytes),
      units(source->record(), index, !at_once || options.form == RuntimeForm::kImplicit, budget),
      spill(options.tmp_directory, options.spill_bytes),
      payloads(source, budget, changed, std::move(on_answer)) {}

// Decoded units go before payloads, which are smaller and cost a read; then what nobody waits for.
bool CacheMemory::MakeRoom(size_t bytes, Evicted& evicted) {
  units.ForEachUnpinned([&](UnitId unit) {
    if (budget.HasRoom(bytes)) return false;
    dropped_bytes += units[unit].bytes;
    LoadedUnitPtr value = units.Drop(unit);
    // Without memory the unit goes here, with the mutex held.
    static_cast<void>(TryAllocate([&] {
      MakeRoomForOne(evicted.units);
      const bool spills = units.UsedInPeriod(unit) && spill.Expect(unit, units.size());
      if (spills) units.Claim(unit, 0);
      evicted.units.push_back({unit, std::move(value), spills, std::nullopt});
    }));
    return true;
  });
  while (!budget.HasRoom(bytes) && payloads.DropOldest()) {
  }
  while (!budget.HasRoom(bytes) && payloads.WithdrawAhead()) {
  }
  return budget.HasRoom(bytes);
}

void CacheMemory::LetGo(Evicted& evicted, MutexLock& lock) {
  if (evicted.units.empty()) return;
  const std::shared_ptr<SpillFile> file = spill.file();
  lock.unlock();
  for (Evicted::Unit& unit : evicted.units) {
    if (unit.spills) unit.place = file->Write(*unit.value);
    unit.value.reset();
  }
  lock.lock();
  evicted.Settle(file);
}

void Evicted::Settle(const std::shared_ptr<SpillFile>& file) {
  bool spilled = false;
  for (const Unit& unit : units) {
    if (!unit.spills) continue;
    memory.spill.Set(unit.id, file, unit.place);
    memory.units.Unclaim(unit.id);
    spilled = true;
  }
  units.clear();
  if (spilled) memory.changed.notify_all();
}

void CacheMemory::KeepPayload(UnitId unit, Payload payload, Evicted& evicted) {
  const size_t most = options.budget_bytes / kPayloadShare;
  const size_t more = payloads.Find(unit) != nullptr ? 0 : payload->size();
  if (more > most) return;
  while (payloads.bytes() + more > most) {
    if (!payloads.DropOldest()) return;
  }
  // Without memory it will be read again.
  if (more > 0 && MakeRoom(more, evicted)) payloads.Put(unit, std::move(payload));
}

PayloadDesk::BatchPtr CacheMemory::Ask(std::span<const UnitId> wanted, const CacheUserPtr& user,
                                       Asking asking, MutexLock& lock) {
  Evicted evicted(*this);
  const PayloadDesk::BatchPtr batch = payloads.NewBatch(wanted.size(), user, asking);
  for (const UnitId u : wanted) {
    if (!units.empty(u) || CanLoad(u) || payloads.on_its_way(u)) continue;
    const size_t bytes = payloads.SizeOf(u);
    const bool fits = asking == Asking::kAhead ? budget.HasRoom(bytes) : MakeRoom(bytes, evicted);
    if (!fits) break;
    payloads.Expect(batch, u, bytes);
  }
  if (batch->units.empty()) return nullptr;
  LetGo(evicted, lock);
  payloads.Send(batch, lock);
  return batch;
}

Status CacheMemory::Accept(UnitId unit, Result<Bytes> payload, CacheUser& user, Evicted& evicted) {
  MTDB_RETURN_IF_ERROR(payload.status());
  const size_t bytes = payload->size();
  if (!index.Has(unit) || bytes != index.location(unit).length) {
    return Corrupt(UnitName(source->record(), unit) + ": the source gave " + std::to_string(bytes) +
                   " bytes, which its index does not say");
  }
  user.CountRead(unit, index.unit(unit).nodes == 0, bytes);
  // It was counted, but for a row that came with it.
  if (!MakeRoom(bytes, evicted)) return Status::Ok();
  const bool kept = payloads.Put(unit, std::make_shared<const Bytes>(*std::move(payload)));
  return kept ? Status::Ok() : OutOfMemory();
}

void CacheMemory::AddReader(bool spills) {
  if (spills && spill.AddReader()) units.BeginPeriod();
  ++readers;
}

void CacheMemory::RemoveReader(bool spills, Rest& rest) {
  --readers;
  if (spills) rest.file = spill.RemoveReader();
  rest.units = DropIdle();
  rest.much = !rest.units.empty() && MuchWasDropped();
}

CacheMemory::Rest::~Rest() {
  units.clear();
  if (much) GiveMemoryBack();
}

std::vector<LoadedUnitPtr> CacheMemory::DropIdle() {
  std::vector<LoadedUnitPtr> dropped;
  if (options.form == RuntimeForm::kExplicit || readers > 0) return dropped;
  units.ForEachUnpinned([&](UnitId unit) {
    dropped_bytes += units[unit].bytes;
    LoadedUnitPtr value = units.Drop(unit);
    static_cast<void>(TryAllocate([&] { dropped.push_back(std::move(value)); }));
    return true;
  });
  return dropped;
}

bool CacheMemory::MuchWasDropped() {
  if (dropped_bytes < kMuchBytes) return false;
  dropped_bytes = 0;
  return true;
}

size_t CacheMemory::UnitBudget() const {
  const bool implicit = options.form == RuntimeForm::kImplicit;
  return options.budget_bytes - (implicit ? options.budget_bytes / kPayloadShare : 0);
}

Status CacheMemory::TooSmall(UnitId unit, size_t needed) const {
  // What a query holds at once shows as it goes on; some of the largest units are enough.
  constexpr size_t kKiB = 1024;
  const size_t enough =
      std::bit_ceil(std::max(2 * needed, 16 * units.LargestEstimate()) / kKiB + 1);
  return {StatusCode::kBudgetExceeded,
          UnitName(source->record(), unit) + ": needs " + std::to_string(needed) +
              " bytes, with what it is decoded from and what is used with it, but the cache is "
              "limited to " +
              std::to_string(options.budget_bytes) + "; allow it some " + std::to_string(enough) +
              " KiB (--cache " + std::to_string(enough) + "K)"};
}

}  // namespace mtdb::internal
