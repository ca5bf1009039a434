// SPDX-License-Identifier: Apache-2.0
// ClusterCache: the decoded units of one surface, shared by its queries.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <queue>
#include <span>
#include <string>
#include <vector>

#include "query/cache/loaded_unit.h"
#include "query/cache/spill_file.h"
#include "query/query_control.h"
#include "store/base/status.h"
#include "store/base/threading.h"
#include "store/cluster_source.h"

namespace mtdb::internal {

class UnitReader;

// What one query made the cache do.
struct LoadStats {
  uint64_t clusters_read = 0;     // payloads read from the source
  uint64_t clusters_cached = 0;   // clusters that were there when the query first wanted them
  uint64_t root_pieces_read = 0;  // payloads
  uint64_t bytes_read = 0;        // of clusters and root pieces
  double seconds = 0;             // of the query's own thread: reading, decoding, waiting
  double read_seconds = 0;        // of all threads that worked for the query
  double decode_seconds = 0;      // likewise
};

// What makes a unit of a payload, as LoadUnit does; called by many threads.
using UnitLoader = std::function<decltype(LoadUnit)>;

struct CacheOptions {
  size_t budget_bytes = size_t{256} << 20;
  // With more than one, threads - 1 of the cache's own read and decode what UnitReader::Prefetch
  // names.
  unsigned threads = 1;
  RuntimeForm form = RuntimeForm::kExplicit;
  // False: what would wait fails with kNotYet. A payload that is on its way comes nevertheless.
  bool waits = kThreads;
  UnitLoader loader = LoadUnit;
  // Of the file for units that readers will want again; see ReaderLimits::spills.
  std::string tmp_directory = {};
  uint64_t spill_bytes = 0;
};

// Keeps decoded units within a budget of bytes; the least recently used go first. A unit is pinned
// while a caller holds it: pinned units count and are never dropped. The budget is hard: what finds
// no room waits, or fails with kBudgetExceeded. A unit is decoded from its parents, which are
// loaded on the way, coarsest first; by one thread, however many want it. A source that does not
// answer at once is asked for all payloads that a load lacks, and for what readers name ahead, in
// batches; payloads that have come or are on their way count. In the implicit form payloads are
// kept, within half of the budget, and decoded units only while there is a reader, in what room is
// left. While there are readers whose answers may be larger than the budget, a unit that they used
// and that has to go is put into a file, and comes back from there without its parents. Safe for
// many threads; a hit costs one short critical section. Must outlive its readers and the pointers
// it gave.
class ClusterCache {
 public:
  ClusterCache(std::shared_ptr<ClusterSource> source, const CacheOptions& options);
  ~ClusterCache();
  ClusterCache(const ClusterCache&) = delete;
  ClusterCache& operator=(const ClusterCache&) = delete;

  // The decoded unit, pinned as long as the pointer lives; the index then has the rows
  // that ClusterSource promises with it. For callers that hold a few units; queries have a
  // UnitReader. Never waits for room. Errors: those of ClusterSource, kCorrupt of LoadUnit,
  // kBudgetExceeded when pinned units leave no room, kNoSpace without memory, kNotYet.
  Result<LoadedUnitPtr> Get(UnitId unit, LoadStats* stats);
  // Nobody wants the payloads that are on their way. Queries that wait for some ask again.
  void CancelReads();

  unsigned threads() const { return options_.threads; }
  size_t budget_bytes() const { return options_.budget_bytes; }
  // Bytes of the units and payloads held now, pinned ones and those being decoded or on their way
  // included.
  size_t bytes() const;
  // The most that bytes() has been.
  size_t peak_bytes() const;
  // Units decoded since the cache was made; those that came back from a file do not count.
  uint64_t decoded() const;
  // True when nobody holds a unit, decodes one or waits for room.
  bool idle() const;

 private:
  friend class AvailableUnits;
  friend class UnitReader;
  enum class State : uint8_t { kEmpty, kLoading, kReady };
  using Payload = std::shared_ptr<const Bytes>;
  class Batch;
  struct Entry {
    LoadedUnitPtr value;           // when kReady
    Payload payload;               // that has come, or is kept in the implicit form
    const Batch* asked = nullptr;  // the payload is on its way
    size_t asked_bytes = 0;        // counted for that
    size_t bytes = 0;              // an estimate when kLoading
    // Of a unit that was decoded once; they stay.
    size_t decoded_bytes = 0;
    size_t overhead = 0;  // what a load into an empty cache takes at most beside that
    uint32_t pins = 0;
    uint32_t plans = 0;        // that will decode it: its payload stays
    uint32_t newer = kNone32;  // neighbours in the list of ready units by last use
    uint32_t older = kNone32;
    uint32_t used_in = 0;  // the last period of spilling in which it was pinned
    State state = State::kEmpty;
    // In the file at this place, unless it is kLoading and on its way there.
    bool spilled = false;
    SpillPlace place;
  };
  // A query, as the threads see it that work for it.
  struct Client {
    LoadStats stats;
    std::vector<bool> read;             // per unit: by this query
    std::vector<bool> done;             // likewise: it will not want it again
    std::map<UnitId, Status> failures;  // of reads
    QueryControl* control = nullptr;    // null when the query is over
    bool stopped = false;               // it is over: its jobs are void
    // Of one that takes what is there: what found no room to be loaded, and bytes() then.
    std::map<UnitId, size_t> no_room;
    bool takes_what_is_there = false;  // and leaves what it asked for on its way
  };
  using ClientPtr = std::shared_ptr<Client>;
  struct Job {
    UnitId unit;
    ClientPtr client;
    friend bool operator<(const Job& a, const Job& b) { return a.unit < b.unit; }
  };
  class Plan;
  // Why payloads are asked for.
  enum class Asking : uint8_t {
    kToWait,    // whoever waits for them decodes them
    kToDecode,  // nobody waits: the cache's threads decode what comes
    kAhead,     // likewise, and they give way to all else
  };
  // On whose behalf a unit is loaded, and how.
  struct LoadRequest {
    ClientPtr client;
    UnitReader* reader = nullptr;  // null: nothing can interrupt it
    bool exclusive = false;        // nobody else holds units
    bool helps = false;            // works on jobs while it waits
    bool waits = true;             // false: kNotYet instead
    bool no_room = false;          // out: why it failed
    Plan* plan = nullptr;
  };
  class Claim;
  // Units that have left the cache and are to be destroyed, or put into the file before.
  struct Dropped;
  // Where answers of the source find the cache, or nothing when it is gone.
  struct Door {
    Mutex mutex;
    ClusterCache* cache = nullptr;
  };
  using Lock = MutexLock;

  Result<LoadedUnitPtr> GetPinned(UnitId unit, LoadStats* stats);
  // With mutex_ held; let go of while reading, decoding and waiting. The unit comes back pinned.
  Result<LoadedUnitPtr> Load(UnitId unit, LoadRequest& request, Lock& lock);
  Result<LoadedUnitPtr> TryLoad(UnitId unit, LoadRequest& request, Lock& lock);
  Status LoadOne(UnitId unit, LoadRequest& request, Lock& lock);
  void CountLoad(UnitId unit, const LoadStats& load, Client& client);
  Status Reserve(UnitId unit, LoadRequest& request, Dropped& dropped);
  Result<LoadedUnitPtr> ReadAndDecode(UnitId unit, LoadRequest& request, LoadStats& stats,
                                      Payload& payload);
  Status Wait(UnitId unit, LoadRequest& request, Lock& lock);
  Status NoRoom(UnitId unit, size_t bytes) const;
  // The same of all that is needed at once, with the size of a cache that has room for it.
  Status TooSmall(UnitId unit, size_t needed) const;
  // What a load into an empty cache takes at most, when the unit and all that it comes from have
  // been decoded once: a unit at a time, coarsest first, each kept until its last child is decoded.
  size_t LoadBytes(UnitId unit) const;
  bool RunJob(Lock& lock);
  void StartWorkers();
  void PushChildren(UnitId unit, const ClientPtr& client);
  void Work();
  void AddReader(bool spills);
  void RemoveReader(Client& client, bool spills);
  // A query has done with the unit. When it is the only one, the unit leaves the cache first, and
  // need not come back.
  void Forget(UnitId unit, Client& client);

  // What is not there for the plan can be waited for: asks for it. kBudgetExceeded when there is no
  // room for a single payload, or none may be read.
  Status AskForPlan(LoadRequest& request, Lock& lock);
  // Asks for payloads that are neither there nor on their way, as many as find room, in one batch
  // in the order of their places. Null: there was none to ask for.
  std::shared_ptr<Batch> Ask(std::span<const UnitId> units, const ClientPtr& client, Asking asking,
                             Lock& lock);
  // For whoever wants these units soon: asks for them and their missing parents.
  void AskAhead(std::span<const UnitId> units, const ClientPtr& client, Lock& lock);
  void Arrive(Batch& batch, UnitId unit, Result<Bytes> payload);
  // A unit of which nothing is on its way any more.
  void Withdraw(UnitId unit);
  void Withdraw(const Batch& batch);
  // Tells the source of batches that were withdrawn. Lets go of mutex_.
  void TellSource(Lock& lock);
  bool HasPayload(UnitId unit, const LoadRequest& request) const;
  // True for a unit that can be loaded, given its parents or the file, without asking the source
  // for what comes later.
  bool CanLoad(UnitId unit) const {
    return at_once_ || entries_[unit].payload != nullptr || entries_[unit].spilled;
  }

  // With mutex_ held.
  void Pin(UnitId unit);
  void Unpin(UnitId unit) { --entries_[unit].pins; }
  LoadedUnitPtr Drop(UnitId unit);
  void DropOrSpill(UnitId unit, Dropped& dropped);
  // Destroys them and fills the file, with mutex_ let go of meanwhile. Needs no memory.
  void LetGo(Dropped& dropped, Lock& lock);
  // Of a unit that was just decoded, and is not linked yet.
  void KeepPayload(UnitId unit, Payload payload, Dropped& dropped);
  // Of those that no plan needs; false when there is none.
  bool DropOldestPayload();
  void DropPayload(UnitId unit);
  // In the implicit form, when nobody asks: drops the units that nobody holds.
  void DropIdle(std::vector<LoadedUnitPtr>& dropped);
  void Enter() { ++holders_; }
  void Leave();
  void Link(UnitId unit);
  void Unlink(UnitId unit);
  // Drops units until `bytes` more fit; false when pinned units do not let it. Like Drop and all
  // that goes with a reader it does not fail for lack of memory.
  bool MakeRoom(size_t bytes, Dropped& dropped);
  // Of the payload, where it is counted while it is decoded.
  size_t PayloadBytes(UnitId unit) const;
  // Bytes of the unit when decoded, guessed from the index.
  size_t EstimateBytes(UnitId unit) const;
  size_t TypicalBytes() const;
  // Of the budget, what payloads leave for units.
  size_t UnitBudget() const;

  const std::shared_ptr<ClusterSource> source_;
  const ClusterIndex& index_;
  const CacheOptions options_;
  const bool at_once_;  // how the source answers
  const std::shared_ptr<Door> door_;

  mutable Mutex mutex_;
  ConditionVariable loaded_;    // some unit left kLoading, or a payload came, or will not
  ConditionVariable room_;      // holders_ or exclusive_ changed
  ConditionVariable work_;      // there are jobs
  std::vector<Entry> entries_;  // by unit
  uint32_t newest_ = kNone32;
  uint32_t oldest_ = kNone32;
  std::deque<UnitId> payloads_;                    // that are there, oldest first
  size_t payload_bytes_ = 0;                       // of these; in bytes_ too
  std::vector<std::shared_ptr<Batch>> batches_;    // with units on their way, oldest first
  std::vector<std::shared_ptr<Batch>> withdrawn_;  // which the source does not know yet
  uint32_t readers_ = 0;
  std::shared_ptr<SpillFile> spill_;  // while there are readers that spill
  uint32_t spillers_ = 0;
  uint32_t spill_period_ = 0;  // counts the times that there were some
  size_t bytes_ = 0;
  size_t peak_bytes_ = 0;
  uint64_t decoded_ = 0;
  size_t dropped_bytes_ = 0;  // since memory was last given back to the system
  uint32_t holders_ = 0;      // readers that hold units, pointers given away, jobs under way
  std::atomic<uint32_t> exclusive_waiting_{0};  // readers that wait until nobody holds any
  bool exclusive_ = false;                      // one reader has the cache for itself
  std::priority_queue<Job> jobs_;               // coarsest first
  bool stopping_ = false;
#if MTDB_THREADS
  std::vector<std::thread> workers_;
#endif
};

}  // namespace mtdb::internal
