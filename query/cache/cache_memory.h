// SPDX-License-Identifier: Apache-2.0
// CacheMemory: all that a cache keeps, within one budget.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "query/cache/byte_budget.h"
#include "query/cache/cache_user.h"
#include "query/cache/loaded_unit.h"
#include "query/cache/payload_desk.h"
#include "query/cache/spill.h"
#include "query/cache/unit_table.h"
#include "query/runtime_form.h"
#include "store/base/status.h"
#include "store/base/threading.h"
#include "store/cluster_source.h"

namespace mtdb::internal {

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

// Units that have left the table, to be destroyed, or put into the file before, by
// CacheMemory::LetGo. With the cache's mutex held at both ends.
struct Evicted;

// The table of units, the desk for payloads and the file share the budget: what needs room takes it
// from units that nobody holds, then from payloads that nobody wants, then from what is asked for
// ahead. The cache's mutex guards all; where a function takes the lock it lets go of it meanwhile.
struct CacheMemory {
  CacheMemory(std::shared_ptr<ClusterSource> from, const CacheOptions& cache_options,
              PayloadDesk::OnAnswer on_answer);

  // False when pinned units do not let it. Needs no memory, like all that goes with a reader.
  bool MakeRoom(size_t bytes, Evicted& evicted);
  // Destroys the units and fills the file.
  void LetGo(Evicted& evicted, MutexLock& lock);
  // Of a unit that was decoded, in the implicit form.
  void KeepPayload(UnitId unit, Payload payload, Evicted& evicted);
  // True for a unit that can be loaded, given its parents or the file, without asking the source
  // for what comes later.
  bool CanLoad(UnitId unit) const {
    return at_once || payloads.Find(unit) != nullptr || spill.Has(unit);
  }
  // Asks for payloads that are neither there nor on their way, as many as find room. Null: there
  // was none to ask for.
  PayloadDesk::BatchPtr Ask(std::span<const UnitId> wanted, const CacheUserPtr& user, Asking asking,
                            MutexLock& lock);
  // An answer that was expected. When it is a payload, and there is room, it is there.
  Status Accept(UnitId unit, Result<Bytes> payload, CacheUser& user, Evicted& evicted);

  void AddReader(bool spills);
  // What the reader leaves behind, to be destroyed without the mutex.
  struct Rest {
    ~Rest();
    std::vector<LoadedUnitPtr> units;
    std::shared_ptr<SpillFile> file;
    bool much = false;
  };
  void RemoveReader(bool spills, Rest& rest);
  // In the implicit form, when there is no reader: the units that nobody holds.
  std::vector<LoadedUnitPtr> DropIdle();
  // True once in so many bytes that were dropped: whoever is told calls GiveMemoryBack without the
  // mutex.
  bool MuchWasDropped();

  // Of the budget, what payloads leave for units.
  size_t UnitBudget() const;
  // kBudgetExceeded, with the size of a cache that has room for so much at once.
  Status TooSmall(UnitId unit, size_t needed) const;
  // The same of what is there and so many bytes.
  Status NoRoom(UnitId unit, size_t bytes) const { return TooSmall(unit, budget.used() + bytes); }

  const std::shared_ptr<ClusterSource> source;
  const ClusterIndex& index;
  const CacheOptions options;
  const bool at_once;         // how the source answers
  ConditionVariable changed;  // some unit is not claimed any more, a payload came, or will not
  ByteBudget budget;
  UnitTable units;
  Spill spill;
  uint32_t readers = 0;
  uint64_t decoded = 0;      // units, so far
  size_t dropped_bytes = 0;  // since memory was last given back to the system
  PayloadDesk payloads;      // goes first, and no answer comes any more
};

// Units that were to be put into the file and have not been when this goes are decoded again.
struct Evicted {
  struct Unit {
    UnitId id;
    LoadedUnitPtr value;
    bool spills;  // it is claimed until it is in the file
    std::optional<SpillPlace> place;
  };
  explicit Evicted(CacheMemory& from) : memory(from) {}
  ~Evicted() { Settle(memory.spill.file()); }
  Evicted(const Evicted&) = delete;
  Evicted& operator=(const Evicted&) = delete;
  // They are in this file, or nowhere.
  void Settle(const std::shared_ptr<SpillFile>& file);

  CacheMemory& memory;
  std::vector<Unit> units;
};

// The C library keeps what is freed, thread by thread, beyond any budget. This has it give that
// back, in a millisecond or two.
void GiveMemoryBack();

}  // namespace mtdb::internal
