// ClusterCache: the decoded clusters and root pieces of one surface, shared by its queries.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "query/loaded_unit.h"
#include "store/base/status.h"
#include "store/cluster_source.h"

namespace mtdb {

// What one query made the cache do.
struct LoadStats {
  uint64_t clusters_read = 0;     // payloads read from the source
  uint64_t root_pieces_read = 0;  // likewise
  uint64_t bytes_read = 0;        // of both
  double seconds = 0;             // reading, decoding and waiting for other threads that do
};

// Keeps decoded units up to a budget of bytes, the least recently used go first. A unit is pinned
// while a caller holds its pointer; pinned units count, are never dropped, and may exceed the
// budget for as long as they are pinned. Units are decoded from their parents, which are loaded on
// the way, coarsest first. A unit that several threads want is read and decoded by one of them.
// Safe for many threads; a hit costs one short critical section.
class ClusterCache {
 public:
  ClusterCache(std::shared_ptr<ClusterSource> source, size_t budget_bytes);

  // The decoded unit. Errors: those of ClusterSource, and kCorrupt of LoadUnit.
  Result<LoadedUnitPtr> Get(UnitId unit, LoadStats* stats);

  // Drops unpinned units beyond the budget. Get does so too; call it after letting go of many pins.
  void Trim();

  size_t budget_bytes() const { return budget_bytes_; }
  // Bytes of the units held now, pinned ones included.
  size_t bytes() const;
  // Units decoded since the cache was made.
  uint64_t decoded() const;

 private:
  enum class State : uint8_t { kEmpty, kLoading, kReady };
  struct Entry {
    LoadedUnitPtr value;  // when kReady
    size_t bytes = 0;
    uint32_t newer = kNone32;  // neighbours in the list of ready units by last use
    uint32_t older = kNone32;
    State state = State::kEmpty;
  };
  // A load under way: the unit and those ancestors that it lacks.
  struct Plan {
    std::vector<UnitId> claimed;  // this thread loads them
    std::vector<UnitId> awaited;  // another thread does
    std::unordered_map<UnitId, LoadedUnitPtr> pinned;
    std::unordered_map<UnitId, Bytes> payloads;
  };

  void MakePlan(UnitId unit, Plan& plan);
  Status ReadPayloads(Plan& plan, LoadStats& stats);
  Status Execute(Plan& plan, LoadStats& stats);
  Result<LoadedUnitPtr> Load(UnitId unit, LoadStats& stats);
  Result<LoadedUnitPtr> Await(UnitId unit, LoadStats& stats);
  void Publish(UnitId unit, const LoadedUnitPtr& value);
  void Abandon(std::span<const UnitId> units);

  // With mutex_ held.
  void Link(UnitId unit);
  void Unlink(UnitId unit);
  void Touch(UnitId unit);
  void TrimLocked(std::vector<LoadedUnitPtr>& dropped);

  const std::shared_ptr<ClusterSource> source_;
  const size_t budget_bytes_;

  mutable std::mutex mutex_;
  std::condition_variable loaded_;  // some unit left kLoading
  std::vector<Entry> entries_;      // by unit
  uint32_t newest_ = kNone32;
  uint32_t oldest_ = kNone32;
  size_t bytes_ = 0;
  uint64_t decoded_ = 0;
};

}  // namespace mtdb
