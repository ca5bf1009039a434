// SPDX-License-Identifier: Apache-2.0
// CacheUser: a query, as the cache and the threads see it that work for it.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <unordered_map>
#include <vector>

#include "query/query_control.h"
#include "store/base/bytes.h"
#include "store/base/ids.h"
#include "store/base/status.h"
#include "store/base/threading.h"
#include "store/cluster_index.h"
#include "store/object_record.h"

namespace mtdb::internal {

using Payload = std::shared_ptr<const Bytes>;

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

struct ReaderLimits {
  QueryControl* control = nullptr;
  // To read from the source. Root pieces are read in any case, and count.
  std::optional<uint64_t> max_bytes;
  // Holds what is there, and keeps it; see UnitReader::available(). What it asked for stays on its
  // way when it goes.
  bool available_only = false;
  // Goes over its units several times: what has to leave the cache meanwhile is put into a file.
  bool spills = false;
};

// The functions are for the query's own thread; with the cache's mutex held, but for Check and
// OverLimit.
struct CacheUser {
  using TimePoint = std::chrono::steady_clock::time_point;

  CacheUser(const ObjectRecord& of, uint32_t units, const ReaderLimits& reader_limits);

  // kCancelled when the caller asked to stop; kBudgetExceeded, and out_of_time, when the deadline
  // is over.
  Status Check();
  // Waits for a change, or a little when there is something to watch.
  Status WaitOn(ConditionVariable& changed, MutexLock& lock);
  // Of max_bytes.
  uint64_t bytes_left() const;
  // Of units to be read in this order, those that max_bytes allows.
  void CutToLimit(std::vector<UnitId>& units, const ClusterIndex& index) const;
  // The error of what max_bytes does not allow.
  Status OverLimit(UnitId unit);
  void CountRead(UnitId unit, bool root_piece, uint64_t bytes);

  const ObjectRecord& record;
  ReaderLimits limits;  // without the control when the query is over
  // Of the query's own thread.
  std::optional<TimePoint> deadline;
  bool out_of_bytes = false;
  bool out_of_time = false;
  std::unordered_map<UnitId, Payload> payloads;  // with max_bytes: nothing is read twice
  // With the cache's mutex held.
  LoadStats stats;
  std::vector<bool> read;             // per unit: by this query
  std::vector<bool> done;             // likewise: it will not want it again
  std::map<UnitId, Status> failures;  // of reads
  // Of one that takes what is there: what found no room to be loaded, and the bytes in use then.
  std::map<UnitId, size_t> no_room;
  bool over = false;  // its jobs are void
};
using CacheUserPtr = std::shared_ptr<CacheUser>;

}  // namespace mtdb::internal
