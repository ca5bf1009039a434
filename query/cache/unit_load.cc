// SPDX-License-Identifier: Apache-2.0
#include "query/cache/unit_load.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "query/cache/load_plan.h"
#include "query/fields/stopwatch.h"
#include "store/base/out_of_memory.h"

namespace mtdb::internal {
namespace {

// A unit that one thread loads. What is not ready when it goes is as if it had not been begun, and
// who waits for it looks again. With the mutex held at both ends.
class Claimed {
 public:
  Claimed(CacheMemory& memory, UnitId unit) : memory_(memory), unit_(unit) {}
  ~Claimed() {
    memory_.units.Unclaim(unit_);
    memory_.changed.notify_all();
  }
  Claimed(const Claimed&) = delete;
  Claimed& operator=(const Claimed&) = delete;

 private:
  CacheMemory& memory_;
  const UnitId unit_;
};

// What is read without the mutex, and what that took.
struct Reading {
  std::shared_ptr<SpillFile> file;  // null: the unit is decoded
  SpillPlace place;
  Payload payload;                     // the one that is there, or null; then the one that was read
  std::optional<uint64_t> bytes_left;  // of the query's limit
  uint64_t bytes_read = 0;
  double read_seconds = 0;
  double decode_seconds = 0;
};

// One load.
class Load {
 public:
  Load(CacheMemory& memory, Loaders& loaders, CacheUserPtr user, Waiting waiting)
      : memory_(memory), loaders_(loaders), user_(std::move(user)), waiting_(waiting) {}

  // What is in the cache by chance may take the room of what a plan needs first: who has the cache
  // for itself starts again without, and without what others have asked for. So it finds room for
  // LoadBytes() at least.
  LoadOutcome Run(UnitId unit, MutexLock& lock) {
    Status status = CatchOutOfMemory([&] { return Try(unit, lock); });
    if (no_room_ && waiting_ == Waiting::kAlone) {
      no_room_ = false;
      Evicted evicted(memory_);
      memory_.MakeRoom(memory_.budget.limit(), evicted);
      memory_.LetGo(evicted, lock);
      memory_.payloads.WithdrawIf([](const auto&) { return true; });
      status = CatchOutOfMemory([&] { return Try(unit, lock); });
    }
    return {std::move(status), no_room_};
  }

 private:
  // Takes what another thread is at later, and goes on with what nobody has begun. Who has the
  // cache for itself keeps the order that LoadBytes() counts on.
  Status Try(UnitId unit, MutexLock& lock) {
    UnitTable& units = memory_.units;
    LoadPlan plan(memory_, unit);
    plan.Make();
    while (!plan.todo().empty()) {
      if (plan.outdated()) {
        plan.Make();
        continue;
      }
      const size_t first = waiting_ == Waiting::kAlone ? 1 : plan.todo().size();
      const auto candidates = std::span(plan.todo()).first(first);
      const auto next = std::ranges::find_if(candidates, [&](UnitId u) {
        return units.ready(u) || (units.empty(u) && HasPayload(u) && plan.HasParents(u));
      });
      if (next == candidates.end()) {
        MTDB_RETURN_IF_ERROR(memory_.at_once ? Wait(unit, lock) : AskForPlan(plan, lock));
        continue;
      }
      const UnitId u = *next;
      if (watched()) MTDB_RETURN_IF_ERROR(user_->Check());
      if (units.empty(u)) MTDB_RETURN_IF_ERROR(LoadOne(u, plan, lock));
      if (units.ready(u)) plan.Finish(u);
    }
    plan.Take();
    return Status::Ok();
  }

  // The unit's parents are ready and pinned, or it is in the file; when it cannot be had from
  // there, it is not ready afterwards.
  Status LoadOne(UnitId unit, LoadPlan& plan, MutexLock& lock) {
    UnitTable& units = memory_.units;
    Reading reading;
    if (memory_.spill.Has(unit)) {
      // That the file goes meanwhile changes nothing.
      reading.file = memory_.spill.file();
      reading.place = memory_.spill.place(unit);
    }
    Evicted evicted(memory_);
    const Status claimed = Claim(unit, units.EstimateBytes(unit), plan, evicted);
    memory_.LetGo(evicted, lock);
    MTDB_RETURN_IF_ERROR(claimed);
    const Claimed claim(memory_, unit);
    reading.payload = memory_.payloads.Find(unit);
    if (watched() && user_->limits.max_bytes) reading.bytes_left = user_->bytes_left();
    const bool trim = memory_.MuchWasDropped();
    lock.unlock();
    if (trim) GiveMemoryBack();
    Result<LoadedUnitPtr> loaded = CatchOutOfMemory([&] { return Read(unit, reading); });
    lock.lock();
    Count(unit, reading);
    MTDB_RETURN_IF_ERROR(loaded.status());
    if (*loaded == nullptr) {
      memory_.spill.Set(unit, reading.file, std::nullopt);
      return Status::Ok();
    }
    // The guess gives way to what it is. A unit that was restored has arrays without spare room;
    // but it counts like others.
    units.NoteSize(unit,
                   reading.file != nullptr ? units[unit].decoded_bytes : (*loaded)->memory_bytes());
    units.Unclaim(unit);
    MTDB_RETURN_IF_ERROR(Claim(unit, units[unit].decoded_bytes, plan, evicted));
    units.Fill(unit, *std::move(loaded));
    units.Pin(unit);  // others may look for room meanwhile
    memory_.decoded += reading.file == nullptr ? 1 : 0;
    Keep(unit, reading, evicted);
    memory_.LetGo(evicted, lock);
    units.Unpin(unit);
    if (!memory_.at_once) PushChildren(unit);
    return Status::Ok();
  }

  // Claims a unit that will take so many bytes.
  Status Claim(UnitId unit, size_t bytes, LoadPlan& plan, Evicted& evicted) {
    if (!memory_.MakeRoom(bytes, evicted) &&
        !(plan.GiveUpPayloads(unit) && memory_.MakeRoom(bytes, evicted))) {
      return NoRoom(unit, bytes);
    }
    memory_.units.Claim(unit, bytes);
    return Status::Ok();
  }

  // Null when the file does not have it.
  Result<LoadedUnitPtr> Read(UnitId unit, Reading& reading) const {
    const Stopwatch read_watch;
    LoadedUnitPtr restored;
    Status status;
    if (reading.file != nullptr) {
      restored = reading.file->Read(reading.place);
    } else {
      status = ReadPayload(unit, reading);
    }
    reading.read_seconds = read_watch.Seconds();
    MTDB_RETURN_IF_ERROR(status);
    if (reading.file != nullptr) return restored;
    const Stopwatch decode_watch;
    std::vector<LoadedUnitPtr> parents;
    for (const UnitId p : memory_.index.parents(unit)) parents.push_back(memory_.units[p].value);
    Result<LoadedUnitPtr> decoded = memory_.options.loader(memory_.source->record(), memory_.index,
                                                           unit, *reading.payload, parents);
    reading.decode_seconds = decode_watch.Seconds();
    return decoded;
  }

  // What a query with a limit has read it keeps.
  Status ReadPayload(UnitId unit, Reading& reading) const {
    if (reading.bytes_left && reading.payload == nullptr) {
      const auto kept = user_->payloads.find(unit);
      if (kept != user_->payloads.end()) reading.payload = kept->second;
    }
    if (reading.payload == nullptr) {
      if (reading.bytes_left && memory_.index.unit(unit).nodes > 0 &&
          memory_.index.location(unit).length > *reading.bytes_left) {
        return user_->OverLimit(unit);
      }
      MTDB_RETURN_IF_ERROR(ReadUnits(*memory_.source, {&unit, 1}, [&](UnitId, Bytes read) {
        reading.payload = std::make_shared<const Bytes>(std::move(read));
        return Status::Ok();
      }));
      reading.bytes_read = reading.payload->size();
    }
    if (reading.bytes_left) user_->payloads.emplace(unit, reading.payload);
    return Status::Ok();
  }

  void Count(UnitId unit, const Reading& reading) {
    user_->stats.read_seconds += reading.read_seconds;
    user_->stats.decode_seconds += reading.decode_seconds;
    if (reading.bytes_read == 0) return;
    user_->CountRead(unit, memory_.index.unit(unit).nodes == 0, reading.bytes_read);
  }

  // Of what has been decoded, the payload goes, but for the implicit form.
  void Keep(UnitId unit, Reading& reading, Evicted& evicted) {
    if (memory_.options.form == RuntimeForm::kImplicit && reading.payload != nullptr) {
      memory_.KeepPayload(unit, std::move(reading.payload), evicted);
    } else if (memory_.payloads.Find(unit) != nullptr) {
      memory_.payloads.Drop(unit);
    }
  }

  // Something that is not there for the plan can be waited for: asks for it. kBudgetExceeded when
  // there is no room for a single payload, or none may be read.
  Status AskForPlan(LoadPlan& plan, MutexLock& lock) {
    std::vector<UnitId> missing;
    UnitId waits_for = kNone32;
    for (const UnitId u : plan.todo()) {
      const auto failed = user_->failures.find(u);
      if (failed != user_->failures.end()) return failed->second;
      const bool empty = memory_.units.empty(u);
      if (memory_.payloads.on_its_way(u) || (!empty && !memory_.units.ready(u))) {
        waits_for = u;
      } else if (empty && !HasPayload(u)) {
        missing.push_back(u);
      }
    }
    // A job decodes what has come.
    if (waiting_ == Waiting::kNever || missing.empty()) return Wait(waits_for, lock);
    const UnitId first = missing.front();
    if (watched()) {
      MTDB_RETURN_IF_ERROR(user_->Check());
      user_->CutToLimit(missing, memory_.index);
      if (missing.empty()) {
        return waits_for == kNone32 ? user_->OverLimit(first) : Wait(waits_for, lock);
      }
    }
    // It may have come during the call.
    if (memory_.Ask(missing, user_, Asking::kToWait, lock) != nullptr) return Status::Ok();
    if (waits_for != kNone32) return Wait(waits_for, lock);
    return plan.GiveUpPayloads(first) ? Status::Ok()
                                      : NoRoom(first, memory_.payloads.SizeOf(first));
  }

  // Until something has changed.
  Status Wait(UnitId unit, MutexLock& lock) {
    if (watched() && loaders_.RunOne(lock)) return Status::Ok();
    if (!memory_.options.waits || waiting_ == Waiting::kNever) {
      return NotYet(UnitName(memory_.source->record(), unit) + ": is on its way; ask again");
    }
    if (watched()) return user_->WaitOn(memory_.changed, lock);
#if MTDB_THREADS
    memory_.changed.wait(lock);
#endif
    return Status::Ok();
  }

  // A payload that came before the parents were decoded waits for them here.
  void PushChildren(UnitId unit) {
    const ClusterIndex& index = memory_.index;
    for (const UnitId c : index.children(unit)) {
      if (!index.Has(c) || !memory_.units.empty(c) || memory_.payloads.Find(c) == nullptr) continue;
      if (!std::ranges::all_of(index.parents(c),
                               [&](UnitId p) { return memory_.units.ready(p); })) {
        continue;
      }
      static_cast<void>(TryAllocate([&] { loaders_.Push(c, user_); }));
      loaders_.Wake();
    }
  }

  Status NoRoom(UnitId unit, size_t bytes) {
    no_room_ = true;
    return memory_.NoRoom(unit, bytes);
  }

  // True for any that can be read now.
  bool HasPayload(UnitId unit) const {
    return memory_.CanLoad(unit) || (watched() && user_->payloads.contains(unit));
  }
  bool watched() const { return waiting_ >= Waiting::kWatched; }

  CacheMemory& memory_;
  Loaders& loaders_;
  const CacheUserPtr user_;
  const Waiting waiting_;
  bool no_room_ = false;
};

}  // namespace

LoadOutcome LoadIntoMemory(UnitId unit, CacheMemory& memory, Loaders& loaders, CacheUserPtr user,
                           Waiting waiting, MutexLock& lock) {
  return Load(memory, loaders, std::move(user), waiting).Run(unit, lock);
}

}  // namespace mtdb::internal
