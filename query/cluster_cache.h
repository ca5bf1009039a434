// ClusterCache: the decoded clusters and root pieces of one surface, shared by its queries.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <queue>
#include <span>
#include <thread>
#include <vector>

#include "query/loaded_unit.h"
#include "store/base/status.h"
#include "store/cluster_source.h"

namespace mtdb {

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

// Keeps decoded units within a budget of bytes; the least recently used go first. A unit is pinned
// while a caller holds it: pinned units count and are never dropped. The budget is hard: what finds
// no room waits, or fails with kBudgetExceeded. A unit is decoded from its parents, which are
// loaded on the way, coarsest first; by one thread, however many want it. In the implicit form it
// keeps payloads, within half of the budget, and decoded units only while there is a reader, in
// what room is left. Safe for many threads; a hit costs one short critical section. Must outlive
// its readers and the pointers it gave.
class ClusterCache {
 public:
  // What makes a unit of a payload, as LoadUnit does; called by many threads.
  using Loader = std::function<decltype(LoadUnit)>;

  // With threads > 1, threads - 1 of its own read and decode what UnitReader::Prefetch names.
  ClusterCache(std::shared_ptr<ClusterSource> source, size_t budget_bytes, unsigned threads = 1,
               RuntimeForm form = RuntimeForm::kExplicit, Loader loader = LoadUnit);
  ~ClusterCache();
  ClusterCache(const ClusterCache&) = delete;
  ClusterCache& operator=(const ClusterCache&) = delete;

  // The decoded unit, pinned as long as the pointer lives. For callers that hold a few units;
  // queries have a UnitReader. Never waits for room. Errors: those of ClusterSource, kCorrupt of
  // LoadUnit, kBudgetExceeded when pinned units leave no room, kNoSpace without memory.
  Result<LoadedUnitPtr> Get(UnitId unit, LoadStats* stats);

  unsigned threads() const { return threads_; }
  size_t budget_bytes() const { return budget_bytes_; }
  // Bytes of the units and payloads held now, pinned ones and those being decoded included.
  size_t bytes() const;
  // The most that bytes() has been.
  size_t peak_bytes() const;
  // Units decoded since the cache was made.
  uint64_t decoded() const;
  // True when nobody holds a unit, decodes one or waits for room.
  bool idle() const;

 private:
  friend class UnitReader;
  enum class State : uint8_t { kEmpty, kLoading, kReady };
  using Payload = std::shared_ptr<const Bytes>;
  struct Entry {
    LoadedUnitPtr value;  // when kReady
    Payload payload;      // in the implicit form, or null
    size_t bytes = 0;     // an estimate when kLoading
    uint32_t pins = 0;
    uint32_t newer = kNone32;  // neighbours in the list of ready units by last use
    uint32_t older = kNone32;
    State state = State::kEmpty;
  };
  // What all threads that work for one query have done for it.
  struct Tally {
    LoadStats stats;
    std::vector<bool> read;  // per unit: by this query
    bool stopped = false;    // the query is over: its jobs are void
  };
  struct Job {
    UnitId unit;
    std::shared_ptr<Tally> tally;
    friend bool operator<(const Job& a, const Job& b) { return a.unit < b.unit; }
  };
  // On whose behalf a unit is loaded.
  struct Errand {
    Tally& tally;
    UnitReader* reader = nullptr;  // null: nothing can interrupt it
    bool exclusive = false;        // nobody else holds units
    bool helps = false;            // works on jobs while it waits
    bool no_room = false;          // out: why it failed
  };
  class Plan;
  class Claim;
  using Lock = std::unique_lock<std::mutex>;

  Result<LoadedUnitPtr> GetPinned(UnitId unit, LoadStats* stats);
  // With mutex_ held; let go of while reading, decoding and waiting. The unit comes back pinned.
  Result<LoadedUnitPtr> Load(UnitId unit, Errand& errand, Lock& lock);
  Result<LoadedUnitPtr> TryLoad(UnitId unit, Errand& errand, Lock& lock);
  Status LoadOne(UnitId unit, Errand& errand, Lock& lock);
  Status Reserve(UnitId unit, Errand& errand, std::vector<LoadedUnitPtr>& dropped);
  Result<LoadedUnitPtr> ReadAndDecode(UnitId unit, Errand& errand, LoadStats& stats,
                                      Payload& payload);
  Result<Bytes> ReadPayload(UnitId unit);
  Status Wait(Errand& errand, Lock& lock);
  bool RunJob(Lock& lock);
  void StartWorkers();
  void Work();
  void RemoveReader(Tally& tally);

  // With mutex_ held.
  void Pin(UnitId unit);
  void Unpin(UnitId unit) { --entries_[unit].pins; }
  void Drop(UnitId unit, std::vector<LoadedUnitPtr>& dropped);
  // Of a unit that was just decoded, and is not linked yet.
  void KeepPayload(UnitId unit, Payload payload, std::vector<LoadedUnitPtr>& dropped);
  void DropOldestPayload();
  // In the implicit form, when nobody asks: drops the units that nobody holds.
  void DropIdle(std::vector<LoadedUnitPtr>& dropped);
  void Enter() { ++holders_; }
  void Leave();
  void Link(UnitId unit);
  void Unlink(UnitId unit);
  // Drops units until `bytes` more fit; false when pinned units do not let it. Like Drop and all
  // that goes with a reader it does not fail for lack of memory.
  bool MakeRoom(size_t bytes, std::vector<LoadedUnitPtr>& dropped);
  // Bytes of the unit when decoded, guessed from the index.
  size_t EstimateBytes(UnitId unit) const;

  const std::shared_ptr<ClusterSource> source_;
  const ClusterIndex& index_;
  const size_t budget_bytes_;
  const unsigned threads_;
  const RuntimeForm form_;
  const Loader loader_;

  mutable std::mutex mutex_;
  std::condition_variable loaded_;  // some unit left kLoading
  std::condition_variable room_;    // holders_ or exclusive_ changed
  std::condition_variable work_;    // there are jobs
  std::vector<Entry> entries_;      // by unit
  uint32_t newest_ = kNone32;
  uint32_t oldest_ = kNone32;
  std::deque<UnitId> payloads_;  // kept ones, oldest first
  size_t payload_bytes_ = 0;     // of these; in bytes_ too
  uint32_t readers_ = 0;
  size_t bytes_ = 0;
  size_t peak_bytes_ = 0;
  uint64_t decoded_ = 0;
  size_t dropped_bytes_ = 0;  // since memory was last given back to the system
  uint32_t holders_ = 0;      // readers that hold units, pointers given away, jobs under way
  std::atomic<uint32_t> exclusive_waiting_{0};  // readers that wait until nobody holds any
  bool exclusive_ = false;                      // one reader has the cache for itself
  std::priority_queue<Job> jobs_;               // coarsest first
  bool stopping_ = false;
  std::vector<std::thread> workers_;
};

}  // namespace mtdb
