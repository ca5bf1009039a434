// SPDX-License-Identifier: Apache-2.0
#include "query/cache/cluster_cache.h"

#include <algorithm>
#include <bit>
#ifdef __GLIBC__
#include <malloc.h>
#endif
#include <optional>
#include <string>
#include <system_error>
#include <unordered_map>

#include "query/cache/cache_plan.h"
#include "query/cache/unit_reader.h"
#include "query/fields/stopwatch.h"
#include "store/base/out_of_memory.h"

namespace mtdb::internal {

// Why nobody waits forever. A thread that has claimed a unit (kLoading) reads and decodes it
// without waiting for anything, so waiting for a claimed unit ends. Waiting for a payload that is
// on its way ends as the source answers every unit; whoever takes it off its way wakes all, who
// then ask for it themselves. Payloads that a plan has yet to decode are dropped by that plan only,
// so that plans cannot take them from each other without end. Room is waited for in two places
// only, by readers that hold nothing: at the door, and for exclusive use. Who waits for exclusive
// use closes the door; whoever is inside holds units, does not wait for room (what finds none
// fails), and lets go after a step. So it becomes the only holder, all else can be dropped, and
// what finds no room then never will.
//
// Nor when memory runs out: with mutex_ held, what has been counted or pinned or claimed belongs to
// something whose destructor takes it back (Plan, Claim), or nothing that needs memory follows.
//
// mutex_ is not held while the source is called. Answers hold the door's mutex, then take mutex_.

namespace {

// The C library keeps what is freed, thread by thread, beyond any budget. To have it give that back
// takes a millisecond or two: once in so many bytes that were dropped.
constexpr size_t kTrimBytes = size_t{16} << 20;

void GiveMemoryBack() {
#ifdef __GLIBC__
  malloc_trim(0);
#endif
}

// Payloads take at most this share of the budget: the rest is for the units that a query decodes.
constexpr size_t kPayloadShare = 2;

}  // namespace

// A unit that one thread decodes. What is not ready when it goes is as if it had not been begun,
// and who waits for it looks again. With mutex_ held at both ends.
class ClusterCache::Claim {
 public:
  Claim(ClusterCache& cache, UnitId unit) : cache_(cache), entry_(cache.entries_[unit]) {}
  ~Claim() {
    if (entry_.state == State::kLoading) {
      cache_.bytes_ -= entry_.bytes;
      entry_.bytes = 0;
      entry_.state = State::kEmpty;
    }
    cache_.loaded_.notify_all();
  }
  Claim(const Claim&) = delete;
  Claim& operator=(const Claim&) = delete;

 private:
  ClusterCache& cache_;
  Entry& entry_;
};

ClusterCache::ClusterCache(std::shared_ptr<ClusterSource> source, const CacheOptions& options)
    : source_(std::move(source)),
      index_(source_->index()),
      options_(options),
      at_once_(source_->answers_at_once()),
      door_(std::make_shared<Door>()),
      entries_(index_.unit_count()) {
  door_->cache = this;
}

ClusterCache::~ClusterCache() {
  {
    const MutexLock lock(mutex_);
    stopping_ = true;
  }
  work_.notify_all();
#if MTDB_THREADS
  for (std::thread& worker : workers_) worker.join();
#endif
  {
    const MutexLock lock(door_->mutex);
    door_->cache = nullptr;
  }
  for (const auto& batch : batches_) source_->Cancel(*batch);
  for (const auto& batch : withdrawn_) source_->Cancel(*batch);
}

Result<LoadedUnitPtr> ClusterCache::Get(UnitId unit, LoadStats* stats) {
  return CatchOutOfMemory([&] { return GetPinned(unit, stats); });
}

Result<LoadedUnitPtr> ClusterCache::GetPinned(UnitId unit, LoadStats* stats) {
  std::vector<LoadedUnitPtr> dropped;
  Lock lock(mutex_);
  MTDB_CHECK(unit < entries_.size(), "no such cluster or root piece");
  LoadedUnitPtr value;
  if (entries_[unit].state == State::kReady) {
    Pin(unit);
    value = entries_[unit].value;
  } else {
    const Stopwatch watch;
    const auto client = std::make_shared<Client>();
    client->stats = *stats;
    client->read.resize(entries_.size());
    client->done.resize(entries_.size());
    LoadRequest request{client};
    Enter();
    Result<LoadedUnitPtr> loaded = Load(unit, request, lock);
    Leave();
    DropIdle(dropped);
    *stats = client->stats;
    stats->seconds += watch.Seconds();
    MTDB_ASSIGN_OR_RETURN(value, std::move(loaded));
  }
  lock.unlock();
  // Also unpins when there is no memory for the pointer.
  return LoadedUnitPtr(value.get(), [this, unit](const LoadedUnit*) {
    std::vector<LoadedUnitPtr> idle;
    const MutexLock unpin_lock(mutex_);
    Unpin(unit);
    DropIdle(idle);
  });
}

// What is in the cache by chance may take the room of what a plan needs first: who has the cache
// for itself starts again without, and without what others have asked for. So it finds room for
// LoadBytes() at least.
Result<LoadedUnitPtr> ClusterCache::Load(UnitId unit, LoadRequest& request, Lock& lock) {
  const auto load = [&] { return TryLoad(unit, request, lock); };
  Result<LoadedUnitPtr> loaded = CatchOutOfMemory(load);
  if (loaded.ok() || !request.exclusive || !request.no_room) return loaded;
  request.no_room = false;
  Dropped dropped(*this);
  MakeRoom(options_.budget_bytes, dropped);
  LetGo(dropped, lock);
  while (!batches_.empty()) Withdraw(*std::shared_ptr<Batch>(batches_.back()));
  return CatchOutOfMemory(load);
}

// Takes what another thread is at later, and goes on with what nobody has begun. Who has the cache
// for itself keeps the order that LoadBytes() counts on.
Result<LoadedUnitPtr> ClusterCache::TryLoad(UnitId unit, LoadRequest& request, Lock& lock) {
  Plan plan(*this, unit);
  plan.Make();
  request.plan = &plan;
  while (!plan.todo().empty()) {
    const auto next = std::ranges::find_if(plan.todo(), [&](UnitId u) {
      const State state = entries_[u].state;
      if (request.exclusive && u != plan.todo().front()) return false;
      return state == State::kReady ||
             (state == State::kEmpty && HasPayload(u, request) && plan.HasParents(u));
    });
    if (plan.outdated()) {
      plan.Make();
      continue;
    }
    if (next == plan.todo().end()) {
      if (at_once_) {
        MTDB_RETURN_IF_ERROR(Wait(unit, request, lock));
      } else {
        MTDB_RETURN_IF_ERROR(AskForPlan(request, lock));
      }
      continue;
    }
    const UnitId u = *next;
    if (request.reader != nullptr) MTDB_RETURN_IF_ERROR(request.reader->Check());
    if (entries_[u].state == State::kEmpty) MTDB_RETURN_IF_ERROR(LoadOne(u, request, lock));
    if (entries_[u].state == State::kReady) plan.Finish(u);
  }
  return plan.Take();
}

// The unit's parents are ready and pinned, or it is in the file; when it cannot be had from there,
// it is not ready afterwards.
Status ClusterCache::LoadOne(UnitId unit, LoadRequest& request, Lock& lock) {
  Entry& entry = entries_[unit];
  // That the file goes meanwhile changes nothing.
  const std::shared_ptr<SpillFile> file = entry.spilled ? spill_ : nullptr;
  const SpillPlace place = entry.place;
  Dropped dropped(*this);
  const Status reserved = Reserve(unit, request, dropped);
  LetGo(dropped, lock);
  MTDB_RETURN_IF_ERROR(reserved);
  const Claim claim(*this, unit);
  LoadStats stats;
  Payload payload = entry.payload;
  const bool trim = dropped_bytes_ >= kTrimBytes;
  if (trim) dropped_bytes_ = 0;
  lock.unlock();
  if (trim) GiveMemoryBack();
  Result<LoadedUnitPtr> loaded = CatchOutOfMemory([&]() -> Result<LoadedUnitPtr> {
    if (file == nullptr) return ReadAndDecode(unit, request, stats, payload);
    const Stopwatch watch;
    LoadedUnitPtr restored = file->Read(place);
    stats.read_seconds = watch.Seconds();
    return restored;
  });
  lock.lock();
  const bool lost = loaded.ok() && *loaded == nullptr;
  CountLoad(unit, stats, *request.client);
  if (lost) {
    entry.spilled = false;
    return Status::Ok();
  }
  if (loaded.ok()) {
    // A unit that was restored has arrays without spare room; but it counts like others.
    if (file == nullptr) entry.decoded_bytes = (*loaded)->memory_bytes();
    if (entry.overhead == 0) entry.overhead = LoadBytes(unit) - entry.decoded_bytes;
  }
  // The guess gives way to what it is.
  bytes_ -= entry.bytes;
  entry.bytes = loaded.ok() ? entry.decoded_bytes : 0;
  entry.state = State::kEmpty;
  MTDB_RETURN_IF_ERROR(loaded.status());
  MTDB_RETURN_IF_ERROR(Reserve(unit, request, dropped));
  entry.value = *std::move(loaded);
  entry.state = State::kReady;
  decoded_ += file == nullptr ? 1 : 0;
  if (options_.form == RuntimeForm::kImplicit && payload != nullptr) {
    KeepPayload(unit, std::move(payload), dropped);
  } else if (entry.payload != nullptr) {
    DropPayload(unit);
  }
  Link(unit);
  Pin(unit);  // others may look for room meanwhile
  LetGo(dropped, lock);
  Unpin(unit);
  if (!at_once_) PushChildren(unit, request.client);
  return Status::Ok();
}

void ClusterCache::CountLoad(UnitId unit, const LoadStats& load, Client& client) {
  client.stats.read_seconds += load.read_seconds;
  client.stats.decode_seconds += load.decode_seconds;
  if (load.bytes_read == 0) return;
  client.stats.bytes_read += load.bytes_read;
  ++(index_.unit(unit).nodes == 0 ? client.stats.root_pieces_read : client.stats.clusters_read);
  client.read[unit] = true;
}

Status ClusterCache::NoRoom(UnitId unit, size_t bytes) const {
  return TooSmall(unit, bytes_ + bytes);
}

Status ClusterCache::TooSmall(UnitId unit, size_t needed) const {
  // What a query holds at once shows as it goes on; some of the largest units are enough.
  size_t largest = 0;
  for (UnitId u = 0; u < entries_.size(); ++u) {
    if (index_.Has(u)) largest = std::max(largest, EstimateBytes(u));
  }
  constexpr size_t kKiB = 1024;
  const size_t enough = std::bit_ceil(std::max(2 * needed, 16 * largest) / kKiB + 1);
  return {StatusCode::kBudgetExceeded,
          UnitName(source_->record(), unit) + ": needs " + std::to_string(needed) +
              " bytes, with what it is decoded from and what is used with it, but the cache is "
              "limited to " +
              std::to_string(options_.budget_bytes) + "; allow it some " + std::to_string(enough) +
              " KiB (--cache " + std::to_string(enough) + "K)"};
}

size_t ClusterCache::LoadBytes(UnitId unit) const {
  std::vector<UnitId> order{unit};
  std::unordered_map<UnitId, uint32_t> users;  // units of `order` that a unit is a parent of
  for (size_t i = 0; i < order.size(); ++i) {
    for (const UnitId p : index_.parents(order[i])) {
      if (users[p]++ == 0) order.push_back(p);
    }
  }
  std::ranges::sort(order, std::greater<>());
  size_t held = 0, most = 0;
  for (const UnitId u : order) {
    const size_t bytes = entries_[u].decoded_bytes;
    most = std::max(most, held + PayloadBytes(u) + std::max(bytes, EstimateBytes(u)));
    held += bytes;
    for (const UnitId p : index_.parents(u)) {
      if (--users[p] == 0) held -= entries_[p].decoded_bytes;
    }
  }
  return most;
}

// Claims the unit, and entry.bytes for it, or a guess when that is 0.
Status ClusterCache::Reserve(UnitId unit, LoadRequest& request, Dropped& dropped) {
  Entry& entry = entries_[unit];
  const size_t bytes = entry.bytes > 0 ? entry.bytes : EstimateBytes(unit);
  if (!MakeRoom(bytes, dropped) &&
      !(request.plan->GiveUpPayloads(unit) && MakeRoom(bytes, dropped))) {
    entry.bytes = 0;
    request.no_room = true;
    return NoRoom(unit, bytes);
  }
  entry.bytes = bytes;
  entry.state = State::kLoading;
  bytes_ += bytes;
  peak_bytes_ = std::max(peak_bytes_, bytes_);
  return Status::Ok();
}

// `payload`: the one that is kept, or null; then the one that was read.
Result<LoadedUnitPtr> ClusterCache::ReadAndDecode(UnitId unit, LoadRequest& request,
                                                  LoadStats& stats, Payload& payload) {
  const Stopwatch read_watch;
  UnitReader* reader = request.reader;
  const bool keep = reader != nullptr && reader->limits_.max_bytes.has_value();
  if (payload == nullptr && keep) {
    if (const auto kept = reader->payloads_.find(unit); kept != reader->payloads_.end()) {
      payload = kept->second;
    }
  }
  if (payload == nullptr) {
    if (keep && index_.unit(unit).nodes > 0 &&
        index_.location(unit).length > reader->bytes_left()) {
      return reader->OverLimit(unit);
    }
    std::optional<Bytes> bytes;
    MTDB_RETURN_IF_ERROR(ReadUnits(*source_, {&unit, 1}, [&](UnitId, Bytes read) {
      bytes = std::move(read);
      return Status::Ok();
    }));
    payload = std::make_shared<const Bytes>(*std::move(bytes));
    stats.bytes_read = payload->size();
    if (reader != nullptr) reader->NoteLoad();
  }
  if (keep) reader->payloads_.emplace(unit, payload);
  stats.read_seconds = read_watch.Seconds();
  const Stopwatch decode_watch;
  std::vector<LoadedUnitPtr> parents;
  for (const UnitId p : index_.parents(unit)) parents.push_back(entries_[p].value);
  Result<LoadedUnitPtr> loaded =
      options_.loader(source_->record(), index_, unit, *payload, parents);
  stats.decode_seconds = decode_watch.Seconds();
  return loaded;
}

// Until something has changed.
Status ClusterCache::Wait(UnitId unit, LoadRequest& request, Lock& lock) {
  if (request.helps && RunJob(lock)) return Status::Ok();
  if (!options_.waits || !request.waits) {
    return NotYet(UnitName(source_->record(), unit) + ": is on its way; ask again");
  }
  if (request.reader != nullptr) {
    MTDB_RETURN_IF_ERROR(request.reader->WaitOn(loaded_, lock));
    return request.reader->Check();
  }
#if MTDB_THREADS
  loaded_.wait(lock);
#endif
  return Status::Ok();
}

// Does not wait for room: a unit that finds none is left to the query.
bool ClusterCache::RunJob(Lock& lock) {
  while (!jobs_.empty()) {
    const Job job = jobs_.top();
    jobs_.pop();
    if (job.client->stopped || exclusive_ || exclusive_waiting_ > 0) continue;
    if (entries_[job.unit].state != State::kEmpty || job.client->done[job.unit]) continue;
    Enter();
    LoadRequest request{job.client};
    request.waits = at_once_;
    const Status status = Load(job.unit, request, lock).status();
    if (status.ok()) {
      Unpin(job.unit);
    } else if (job.client->takes_what_is_there && status.code() != StatusCode::kNotYet) {
      // It asks for nothing that has failed, and for room when there is more of it.
      static_cast<void>(TryAllocate([&] {
        if (request.no_room) {
          job.client->no_room[job.unit] = bytes_;
        } else {
          job.client->failures[job.unit] = status;
        }
      }));
    }
    Leave();
    std::vector<LoadedUnitPtr> dropped;  // when the query is over meanwhile
    DropIdle(dropped);
    return true;
  }
  return false;
}

// A payload that came before the parents were decoded waits for them here.
void ClusterCache::PushChildren(UnitId unit, const ClientPtr& client) {
  for (const UnitId c : index_.children(unit)) {
    if (!index_.Has(c) || entries_[c].state != State::kEmpty || entries_[c].payload == nullptr) {
      continue;
    }
    if (std::ranges::any_of(index_.parents(c),
                            [&](UnitId p) { return entries_[p].state != State::kReady; })) {
      continue;
    }
    static_cast<void>(TryAllocate([&] { jobs_.push({c, client}); }));
    work_.notify_all();
  }
}

// As many as can be made: a query does without.
void ClusterCache::StartWorkers() {
#if MTDB_THREADS
  try {
    while (workers_.size() + 1 < options_.threads) workers_.emplace_back([this] { Work(); });
  } catch (const std::bad_alloc&) {
  } catch (const std::system_error&) {
  }
#endif
}

void ClusterCache::Work() {
#if MTDB_THREADS
  Lock lock(mutex_);
  while (!stopping_) {
    if (!RunJob(lock)) work_.wait(lock);
  }
#endif
}

void ClusterCache::AddReader(bool spills) {
  const MutexLock lock(mutex_);
  if (spills && options_.spill_bytes > 0) {
    if (spillers_ == 0) {
      spill_ = std::make_shared<SpillFile>(options_.tmp_directory, options_.spill_bytes);
      ++spill_period_;
    }
    ++spillers_;
  }
  ++readers_;
}

// What the last reader leaves behind goes back to the system.
void ClusterCache::RemoveReader(Client& client, bool spills) {
  std::shared_ptr<SpillFile> file;
  std::vector<LoadedUnitPtr> dropped;
  bool trim = false;
  {
    MutexLock lock(mutex_);
    client.stopped = true;
    client.control = nullptr;
    // What nobody will wait for need not come. Who does not wait, or takes
    // what is there, comes back for it.
    while (options_.waits && !client.takes_what_is_there) {
      const auto batch =
          std::ranges::find(batches_, &client, [](const auto& b) { return b->client.get(); });
      if (batch == batches_.end()) break;
      Withdraw(*std::shared_ptr<Batch>(*batch));
    }
    TellSource(lock);
    --readers_;
    if (spills && options_.spill_bytes > 0 && --spillers_ == 0) {
      file = std::move(spill_);
      if (!file->empty()) {
        for (Entry& entry : entries_) entry.spilled = false;
      }
    }
    DropIdle(dropped);
    trim = !dropped.empty() && dropped_bytes_ >= kTrimBytes;
    if (trim) dropped_bytes_ = 0;
  }
  dropped.clear();
  if (trim) GiveMemoryBack();
}

void ClusterCache::Forget(UnitId unit, Client& client) {
  const MutexLock lock(mutex_);
  client.done[unit] = true;
  Entry& entry = entries_[unit];
  if (spillers_ > 1 || entry.state != State::kReady || entry.pins > 0) return;
  entry.used_in = 0;
  if (oldest_ == unit) return;
  Unlink(unit);
  entry.older = kNone32;
  entry.newer = oldest_;
  (oldest_ == kNone32 ? newest_ : entries_[oldest_].older) = unit;
  oldest_ = unit;
}

size_t ClusterCache::bytes() const {
  const MutexLock lock(mutex_);
  return bytes_;
}

size_t ClusterCache::peak_bytes() const {
  const MutexLock lock(mutex_);
  return peak_bytes_;
}

uint64_t ClusterCache::decoded() const {
  const MutexLock lock(mutex_);
  return decoded_;
}

bool ClusterCache::idle() const {
  const MutexLock lock(mutex_);
  return holders_ == 0 && exclusive_waiting_ == 0 && !exclusive_ &&
         std::ranges::all_of(entries_, [](const Entry& entry) {
           return entry.pins == 0 && entry.state != State::kLoading;
         });
}

void ClusterCache::Leave() {
  --holders_;
  if (exclusive_waiting_ > 0) room_.notify_all();
}

void ClusterCache::Pin(UnitId unit) {
  ++entries_[unit].pins;
  entries_[unit].used_in = spill_period_;
  if (newest_ == unit) return;
  Unlink(unit);
  Link(unit);
}

void ClusterCache::Link(UnitId unit) {
  Entry& entry = entries_[unit];
  entry.newer = kNone32;
  entry.older = newest_;
  (newest_ == kNone32 ? oldest_ : entries_[newest_].newer) = unit;
  newest_ = unit;
}

void ClusterCache::Unlink(UnitId unit) {
  const Entry& entry = entries_[unit];
  (entry.newer == kNone32 ? newest_ : entries_[entry.newer].older) = entry.older;
  (entry.older == kNone32 ? oldest_ : entries_[entry.older].newer) = entry.newer;
}

// Decoded units go before payloads, which are smaller and cost a read; then what nobody waits for.
bool ClusterCache::MakeRoom(size_t bytes, Dropped& dropped) {
  uint32_t unit = oldest_;
  while (bytes_ + bytes > options_.budget_bytes && unit != kNone32) {
    const uint32_t next = entries_[unit].newer;
    if (entries_[unit].pins == 0) DropOrSpill(unit, dropped);
    unit = next;
  }
  while (bytes_ + bytes > options_.budget_bytes && DropOldestPayload()) {
  }
  while (bytes_ + bytes > options_.budget_bytes) {
    const auto ahead =
        std::ranges::find(batches_, Asking::kAhead, [](const auto& b) { return b->asking; });
    if (ahead == batches_.end()) break;
    Withdraw(*std::shared_ptr<Batch>(*ahead));
  }
  return bytes_ + bytes <= options_.budget_bytes;
}

LoadedUnitPtr ClusterCache::Drop(UnitId unit) {
  Entry& entry = entries_[unit];
  Unlink(unit);
  bytes_ -= entry.bytes;
  dropped_bytes_ += entry.bytes;
  entry.bytes = 0;
  entry.state = State::kEmpty;
  return std::move(entry.value);
}

// Without memory it goes here, with mutex_ held.
void ClusterCache::DropOrSpill(UnitId unit, Dropped& dropped) {
  LoadedUnitPtr value = Drop(unit);
  Entry& entry = entries_[unit];
  const bool wanted = spill_ != nullptr && entry.used_in == spill_period_ && !entry.spilled;
  static_cast<void>(TryAllocate([&] {
    if (!wanted || !spill_->open()) {
      dropped.units.push_back(std::move(value));
      return;
    }
    dropped.spills.push_back({unit, std::move(value), std::nullopt});
    entry.state = State::kLoading;
    entry.spilled = true;
  }));
}

void ClusterCache::LetGo(Dropped& dropped, Lock& lock) {
  if (dropped.units.empty() && dropped.spills.empty()) return;
  const std::shared_ptr<SpillFile> file = spill_;
  lock.unlock();
  dropped.units.clear();
  for (Dropped::Spill& spill : dropped.spills) {
    if (file != nullptr) spill.place = file->Write(*spill.unit);
    spill.unit.reset();
  }
  lock.lock();
  for (const Dropped::Spill& spill : dropped.spills) {
    Entry& entry = entries_[spill.id];
    entry.spilled = spill.place.has_value() && spill_ == file;
    if (entry.spilled) entry.place = *spill.place;
  }
  dropped.Settle();
}

void ClusterCache::DropIdle(std::vector<LoadedUnitPtr>& dropped) {
  if (options_.form == RuntimeForm::kExplicit || readers_ > 0) return;
  for (uint32_t unit = oldest_; unit != kNone32;) {
    const uint32_t next = entries_[unit].newer;
    if (entries_[unit].pins == 0) {
      LoadedUnitPtr value = Drop(unit);
      static_cast<void>(TryAllocate([&] { dropped.push_back(std::move(value)); }));
    }
    unit = next;
  }
}

void ClusterCache::KeepPayload(UnitId unit, Payload payload, Dropped& dropped) {
  const size_t most = options_.budget_bytes / kPayloadShare;
  while (payload_bytes_ > most && DropOldestPayload()) {
  }
  if (entries_[unit].payload != nullptr) return;
  const size_t bytes = payload->size();
  if (bytes > most) return;
  while (payload_bytes_ + bytes > most) {
    if (!DropOldestPayload()) return;
  }
  if (!MakeRoom(bytes, dropped)) return;
  // Without memory it will be read again.
  if (!TryAllocate([&] { payloads_.push_back(unit); })) return;
  payload_bytes_ += bytes;
  bytes_ += bytes;
  peak_bytes_ = std::max(peak_bytes_, bytes_);
  entries_[unit].payload = std::move(payload);
}

bool ClusterCache::DropOldestPayload() {
  const auto at = std::ranges::find_if(payloads_, [&](UnitId u) { return entries_[u].plans == 0; });
  if (at == payloads_.end()) return false;
  DropPayload(*at);
  return true;
}

void ClusterCache::DropPayload(UnitId unit) {
  Payload& payload = entries_[unit].payload;
  payloads_.erase(std::ranges::find(payloads_, unit));
  payload_bytes_ -= payload->size();
  bytes_ -= payload->size();
  payload.reset();
}

size_t ClusterCache::PayloadBytes(UnitId unit) const {
  const bool counted = !at_once_ || options_.form == RuntimeForm::kImplicit;
  return counted ? index_.location(unit).length : 0;
}

size_t ClusterCache::UnitBudget() const {
  const bool implicit = options_.form == RuntimeForm::kImplicit;
  return options_.budget_bytes - (implicit ? options_.budget_bytes / kPayloadShare : 0);
}

// Some 60 bytes a node are usual.
size_t ClusterCache::TypicalBytes() const {
  const ObjectRecord& record = source_->record();
  return sizeof(LoadedUnit) +
         (60 + record.attributes.row_bytes()) * (record.nodes / std::max(1u, record.clusters));
}

// Six star triangles a node are usual.
size_t ClusterCache::EstimateBytes(UnitId unit) const {
  const size_t row_bytes = source_->record().attributes.row_bytes();
  const UnitEntry& entry = index_.unit(unit);
  const size_t stars = size_t{6} * entry.nodes;
  const size_t listed = entry.nodes > 0 ? 0 : entry.out_triangles;
  return sizeof(LoadedUnit) + entry.in_triangles * size_t{16} + stars * size_t{6} +
         listed * size_t{9} + entry.nodes * (size_t{13} + row_bytes) +
         entry.external_vertices * (size_t{6} + sizeof(VertexIndex) + 4 + row_bytes);
}

}  // namespace mtdb::internal
