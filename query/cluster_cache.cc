#include "query/cluster_cache.h"

#include <algorithm>
#include <chrono>
#include <functional>
#ifdef __GLIBC__
#include <malloc.h>
#endif
#include <optional>
#include <string>
#include <system_error>
#include <unordered_map>

#include "query/internal/stopwatch.h"
#include "query/unit_reader.h"
#include "store/base/out_of_memory.h"

namespace mtdb {

// Why nobody waits forever. A thread that has claimed a unit (kLoading) reads and decodes it
// without waiting for anything, so waiting for a claimed unit ends. Room is waited for in two
// places only, by readers that hold nothing: at the door, and for exclusive use. Who waits for
// exclusive use closes the door; whoever is inside holds units, does not wait for room (what finds
// none fails), and lets go after a step. So it becomes the only holder, all else can be dropped,
// and what finds no room then never will.
//
// Nor when memory runs out: with mutex_ held, what has been counted or pinned or claimed belongs to
// something whose destructor takes it back (Plan, Claim), or nothing that needs memory follows.

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

// What a load has yet to do: the units that are not ready, and pins on those that they come from.
class ClusterCache::Plan {
 public:
  Plan(ClusterCache& cache, UnitId target) : cache_(cache), target_(target) {}
  ~Plan() {
    for (const auto& [u, value] : pinned_) cache_.Unpin(u);
  }
  Plan(const Plan&) = delete;
  Plan& operator=(const Plan&) = delete;

  void Make() {
    std::vector<UnitId> open{target_};
    while (!open.empty()) {
      const UnitId u = open.back();
      open.pop_back();
      if (users_.contains(u)) continue;
      users_.emplace(u, 0);
      if (cache_.entries_[u].state == State::kReady) {
        PinUnit(u);
        continue;
      }
      todo_.push_back(u);
      for (const UnitId p : cache_.index_.parents(u)) open.push_back(p);
    }
    for (const UnitId u : todo_) {
      for (const UnitId p : cache_.index_.parents(u)) ++users_[p];
    }
    std::sort(todo_.begin(), todo_.end(), std::greater<>());
  }

  const std::vector<UnitId>& todo() const { return todo_; }
  bool HasParents(UnitId unit) const {
    return std::ranges::all_of(cache_.index_.parents(unit),
                               [&](UnitId p) { return pinned_.contains(p); });
  }
  // The unit is ready: its parents are needed for one thing less.
  void Finish(UnitId unit) {
    PinUnit(unit);
    std::vector<UnitId> done{unit};
    while (!done.empty()) {
      const UnitId u = done.back();
      done.pop_back();
      std::erase(todo_, u);
      for (const UnitId p : cache_.index_.parents(u)) {
        if (--users_[p] > 0) continue;
        if (pinned_.erase(p) > 0) {
          cache_.Unpin(p);
        } else {
          done.push_back(p);
        }
      }
    }
  }
  // Hands the target's pin to the caller.
  LoadedUnitPtr Take() {
    LoadedUnitPtr value = pinned_.at(target_);
    pinned_.erase(target_);
    return value;
  }

 private:
  void PinUnit(UnitId unit) {
    pinned_.emplace(unit, cache_.entries_[unit].value);
    cache_.Pin(unit);
  }

  ClusterCache& cache_;
  const UnitId target_;
  std::vector<UnitId> todo_;                    // coarsest first
  std::unordered_map<UnitId, uint32_t> users_;  // units of todo_ that a unit is a parent of
  std::unordered_map<UnitId, LoadedUnitPtr> pinned_;
};

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

ClusterCache::ClusterCache(std::shared_ptr<ClusterSource> source, size_t budget_bytes,
                           unsigned threads, RuntimeForm form, Loader loader)
    : source_(std::move(source)),
      index_(source_->index()),
      budget_bytes_(budget_bytes),
      threads_(threads),
      form_(form),
      loader_(std::move(loader)),
      entries_(index_.unit_count()) {}

ClusterCache::~ClusterCache() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  work_.notify_all();
  for (std::thread& worker : workers_) worker.join();
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
    Tally tally;
    tally.stats = *stats;
    tally.read.resize(entries_.size());
    Errand errand{tally};
    Enter();
    Result<LoadedUnitPtr> loaded = Load(unit, errand, lock);
    Leave();
    DropIdle(dropped);
    *stats = tally.stats;
    stats->seconds += watch.Seconds();
    MTDB_ASSIGN_OR_RETURN(value, std::move(loaded));
  }
  lock.unlock();
  // Also unpins when there is no memory for the pointer.
  return LoadedUnitPtr(value.get(), [this, unit](const LoadedUnit*) {
    std::vector<LoadedUnitPtr> idle;
    const std::lock_guard unpin_lock(mutex_);
    Unpin(unit);
    DropIdle(idle);
  });
}

// What is in the cache by chance may take the room of what a plan needs first: who has the cache
// for itself starts again without.
Result<LoadedUnitPtr> ClusterCache::Load(UnitId unit, Errand& errand, Lock& lock) {
  const auto load = [&] { return TryLoad(unit, errand, lock); };
  Result<LoadedUnitPtr> loaded = CatchOutOfMemory(load);
  if (loaded.ok() || !errand.exclusive || !errand.no_room) return loaded;
  errand.no_room = false;
  std::vector<LoadedUnitPtr> dropped;
  MakeRoom(budget_bytes_, dropped);
  return CatchOutOfMemory(load);
}

// Takes what another thread is at later, and goes on with what nobody has begun.
Result<LoadedUnitPtr> ClusterCache::TryLoad(UnitId unit, Errand& errand, Lock& lock) {
  Plan plan(*this, unit);
  plan.Make();
  while (!plan.todo().empty()) {
    const auto next = std::ranges::find_if(plan.todo(), [&](UnitId u) {
      const State state = entries_[u].state;
      return state == State::kReady || (state == State::kEmpty && plan.HasParents(u));
    });
    if (next == plan.todo().end()) {
      MTDB_RETURN_IF_ERROR(Wait(errand, lock));
      continue;
    }
    const UnitId u = *next;
    if (errand.reader != nullptr) MTDB_RETURN_IF_ERROR(errand.reader->Check());
    if (entries_[u].state == State::kEmpty) MTDB_RETURN_IF_ERROR(LoadOne(u, errand, lock));
    plan.Finish(u);
  }
  return plan.Take();
}

// The unit's parents are ready and pinned.
Status ClusterCache::LoadOne(UnitId unit, Errand& errand, Lock& lock) {
  std::vector<LoadedUnitPtr> dropped;
  MTDB_RETURN_IF_ERROR(Reserve(unit, errand, dropped));
  const Claim claim(*this, unit);
  Entry& entry = entries_[unit];
  LoadStats stats;
  Payload payload = entry.payload;
  const bool trim = dropped_bytes_ >= kTrimBytes;
  if (trim) dropped_bytes_ = 0;
  lock.unlock();
  dropped.clear();
  if (trim) GiveMemoryBack();
  Result<LoadedUnitPtr> loaded =
      CatchOutOfMemory([&] { return ReadAndDecode(unit, errand, stats, payload); });
  lock.lock();
  errand.tally.stats.read_seconds += stats.read_seconds;
  errand.tally.stats.decode_seconds += stats.decode_seconds;
  if (stats.bytes_read > 0) {
    errand.tally.stats.bytes_read += stats.bytes_read;
    ++(index_.unit(unit).nodes == 0 ? errand.tally.stats.root_pieces_read
                                    : errand.tally.stats.clusters_read);
    errand.tally.read[unit] = true;
  }
  // The guess gives way to what it is.
  bytes_ -= entry.bytes;
  entry.bytes = loaded.ok() ? (*loaded)->memory_bytes() : 0;
  entry.state = State::kEmpty;
  MTDB_RETURN_IF_ERROR(loaded.status());
  MTDB_RETURN_IF_ERROR(Reserve(unit, errand, dropped));
  entry.value = *std::move(loaded);
  entry.state = State::kReady;
  ++decoded_;
  if (form_ == RuntimeForm::kImplicit) KeepPayload(unit, std::move(payload), dropped);
  Link(unit);
  return Status::Ok();
}

// Claims the unit, and entry.bytes for it, or a guess when that is 0.
Status ClusterCache::Reserve(UnitId unit, Errand& errand, std::vector<LoadedUnitPtr>& dropped) {
  Entry& entry = entries_[unit];
  const size_t bytes = entry.bytes > 0 ? entry.bytes : EstimateBytes(unit);
  if (!MakeRoom(bytes, dropped)) {
    entry.bytes = 0;
    errand.no_room = true;
    return {StatusCode::kBudgetExceeded,
            UnitName(source_->record(), unit) + ": needs " + std::to_string(bytes) +
                " bytes beside the " + std::to_string(bytes_) +
                " that are in use, but the cache is limited to " + std::to_string(budget_bytes_) +
                "; open the surface with a cache of at least " + std::to_string(bytes_ + bytes)};
  }
  entry.bytes = bytes;
  entry.state = State::kLoading;
  bytes_ += bytes;
  peak_bytes_ = std::max(peak_bytes_, bytes_);
  return Status::Ok();
}

// `payload`: the one that is kept, or null; then the one that was read.
Result<LoadedUnitPtr> ClusterCache::ReadAndDecode(UnitId unit, Errand& errand, LoadStats& stats,
                                                  Payload& payload) {
  const Stopwatch read_watch;
  UnitReader* reader = errand.reader;
  const bool keep = reader != nullptr && reader->limits_.max_bytes.has_value();
  if (payload != nullptr) {
    // Nothing to read.
  } else if (const auto kept = keep ? reader->payloads_.find(unit)
                                    : std::unordered_map<UnitId, Payload>::iterator{};
             keep && kept != reader->payloads_.end()) {
    payload = kept->second;
  } else {
    if (keep && index_.unit(unit).nodes > 0 &&
        index_.location(unit).length > reader->bytes_left()) {
      reader->out_of_bytes_ = true;
      return Status(StatusCode::kBudgetExceeded, UnitName(source_->record(), unit) +
                                                     ": to read it exceeds the query's limit of " +
                                                     std::to_string(*reader->limits_.max_bytes) +
                                                     " bytes; raise it, or the cache's size");
    }
    MTDB_ASSIGN_OR_RETURN(Bytes bytes, ReadPayload(unit));
    payload = std::make_shared<const Bytes>(std::move(bytes));
    stats.bytes_read = payload->size();
    if (keep) reader->payloads_.emplace(unit, payload);
    if (reader != nullptr) reader->NoteLoad();
  }
  stats.read_seconds = read_watch.Seconds();
  const Stopwatch decode_watch;
  std::vector<LoadedUnitPtr> parents;
  for (const UnitId p : index_.parents(unit)) parents.push_back(entries_[p].value);
  Result<LoadedUnitPtr> loaded = loader_(source_->record(), index_, unit, *payload, parents);
  stats.decode_seconds = decode_watch.Seconds();
  return loaded;
}

Result<Bytes> ClusterCache::ReadPayload(UnitId unit) {
  std::optional<Bytes> found;
  const auto receive = [&](UnitId, Bytes payload) {
    found = std::move(payload);
    return Status::Ok();
  };
  MTDB_RETURN_IF_ERROR(source_->Read({&unit, 1}, receive));
  if (!found) {
    return IoError(UnitName(source_->record(), unit) + ": the source did not deliver the payload");
  }
  return *std::move(found);
}

// Until something has changed.
Status ClusterCache::Wait(Errand& errand, Lock& lock) {
  if (errand.helps && RunJob(lock)) return Status::Ok();
  if (errand.reader == nullptr) {
    loaded_.wait(lock);
    return Status::Ok();
  }
  errand.reader->WaitOn(loaded_, lock);
  return errand.reader->Check();
}

// Does not wait for room: a unit that finds none is left to the query.
bool ClusterCache::RunJob(Lock& lock) {
  while (!jobs_.empty()) {
    const Job job = jobs_.top();
    jobs_.pop();
    if (job.tally->stopped || exclusive_ || exclusive_waiting_ > 0) continue;
    if (entries_[job.unit].state != State::kEmpty) continue;
    Enter();
    Errand errand{*job.tally};
    if (Load(job.unit, errand, lock).ok()) Unpin(job.unit);
    Leave();
    std::vector<LoadedUnitPtr> dropped;  // when the query is over meanwhile
    DropIdle(dropped);
    return true;
  }
  return false;
}

// As many as can be made: a query does without.
void ClusterCache::StartWorkers() {
  try {
    while (workers_.size() + 1 < threads_) workers_.emplace_back([this] { Work(); });
  } catch (const std::bad_alloc&) {
  } catch (const std::system_error&) {
  }
}

void ClusterCache::Work() {
  Lock lock(mutex_);
  while (!stopping_) {
    if (!RunJob(lock)) work_.wait(lock);
  }
}

// What the last reader leaves behind goes back to the system.
void ClusterCache::RemoveReader(Tally& tally) {
  std::vector<LoadedUnitPtr> dropped;
  bool trim = false;
  {
    const std::lock_guard lock(mutex_);
    tally.stopped = true;
    --readers_;
    DropIdle(dropped);
    trim = !dropped.empty() && dropped_bytes_ >= kTrimBytes;
    if (trim) dropped_bytes_ = 0;
  }
  dropped.clear();
  if (trim) GiveMemoryBack();
}

size_t ClusterCache::bytes() const {
  const std::lock_guard lock(mutex_);
  return bytes_;
}

size_t ClusterCache::peak_bytes() const {
  const std::lock_guard lock(mutex_);
  return peak_bytes_;
}

uint64_t ClusterCache::decoded() const {
  const std::lock_guard lock(mutex_);
  return decoded_;
}

bool ClusterCache::idle() const {
  const std::lock_guard lock(mutex_);
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

// Decoded units go before payloads, which are smaller and cost a read.
bool ClusterCache::MakeRoom(size_t bytes, std::vector<LoadedUnitPtr>& dropped) {
  uint32_t unit = oldest_;
  while (bytes_ + bytes > budget_bytes_ && unit != kNone32) {
    const uint32_t next = entries_[unit].newer;
    if (entries_[unit].pins == 0) Drop(unit, dropped);
    unit = next;
  }
  while (bytes_ + bytes > budget_bytes_ && !payloads_.empty()) DropOldestPayload();
  return bytes_ + bytes <= budget_bytes_;
}

void ClusterCache::Drop(UnitId unit, std::vector<LoadedUnitPtr>& dropped) {
  Entry& entry = entries_[unit];
  Unlink(unit);
  LoadedUnitPtr value = std::move(entry.value);
  try {
    dropped.push_back(std::move(value));
  } catch (const std::bad_alloc&) {  // then it goes here, with mutex_ held
  }
  bytes_ -= entry.bytes;
  dropped_bytes_ += entry.bytes;
  entry.bytes = 0;
  entry.state = State::kEmpty;
}

void ClusterCache::DropIdle(std::vector<LoadedUnitPtr>& dropped) {
  if (form_ == RuntimeForm::kExplicit || readers_ > 0) return;
  for (uint32_t unit = oldest_; unit != kNone32;) {
    const uint32_t next = entries_[unit].newer;
    if (entries_[unit].pins == 0) Drop(unit, dropped);
    unit = next;
  }
}

void ClusterCache::KeepPayload(UnitId unit, Payload payload, std::vector<LoadedUnitPtr>& dropped) {
  if (entries_[unit].payload != nullptr) return;
  const size_t most = budget_bytes_ / kPayloadShare;
  const size_t bytes = payload->size();
  if (bytes > most) return;
  while (payload_bytes_ + bytes > most) DropOldestPayload();
  if (!MakeRoom(bytes, dropped)) return;
  try {
    payloads_.push_back(unit);
  } catch (const std::bad_alloc&) {  // it will be read again
    return;
  }
  payload_bytes_ += bytes;
  bytes_ += bytes;
  peak_bytes_ = std::max(peak_bytes_, bytes_);
  entries_[unit].payload = std::move(payload);
}

void ClusterCache::DropOldestPayload() {
  Payload& payload = entries_[payloads_.front()].payload;
  payloads_.pop_front();
  payload_bytes_ -= payload->size();
  bytes_ -= payload->size();
  payload.reset();
}

// Six star triangles a node are usual.
size_t ClusterCache::EstimateBytes(UnitId unit) const {
  const size_t row_bytes = source_->record().attributes.row_bytes();
  const UnitEntry& entry = index_.unit(unit);
  const size_t stars = size_t{6} * entry.nodes;
  const size_t listed = entry.nodes > 0 ? 0 : entry.out_triangles;
  return sizeof(LoadedUnit) + entry.in_triangles * size_t{32} + stars * size_t{12} +
         listed * size_t{17} + entry.nodes * (sizeof(Vec3i) + 13 + row_bytes) +
         entry.external_vertices * (sizeof(Vec3i) + sizeof(VertexIndex) + 4 + row_bytes);
}

}  // namespace mtdb
