// SPDX-License-Identifier: Apache-2.0
#include "query/cache/cache_user.h"

#include <string>

#include "query/cache/loaded_unit.h"

namespace mtdb::internal {
namespace {

// How long a cancelled query may sleep on.
constexpr std::chrono::milliseconds kWatch{4};

}  // namespace

CacheUser::CacheUser(const ObjectRecord& of, uint32_t units, const ReaderLimits& reader_limits)
    : record(of), limits(reader_limits), read(units), done(units) {}

Status CacheUser::Check() {
  if (limits.control != nullptr && limits.control->cancelled()) {
    return {StatusCode::kCancelled, record.name + ": the query was cancelled"};
  }
  if (deadline && std::chrono::steady_clock::now() >= *deadline) {
    out_of_time = true;
    return {StatusCode::kBudgetExceeded, record.name + ": the time is over"};
  }
  return Status::Ok();
}

Status CacheUser::WaitOn(ConditionVariable& changed, MutexLock& lock) {
#if MTDB_THREADS
  if (limits.control == nullptr && !deadline) {
    changed.wait(lock);
  } else {
    changed.wait_for(lock, kWatch);
  }
#else
  static_cast<void>(changed);
  static_cast<void>(lock);
#endif
  return Check();
}

uint64_t CacheUser::bytes_left() const {
  return *limits.max_bytes > stats.bytes_read ? *limits.max_bytes - stats.bytes_read : 0;
}

void CacheUser::CutToLimit(std::vector<UnitId>& units, const ClusterIndex& index) const {
  if (!limits.max_bytes) return;
  uint64_t left = bytes_left();
  for (size_t i = 0; i < units.size(); ++i) {
    if (!index.Has(units[i]) || index.unit(units[i]).nodes == 0) continue;
    const uint64_t bytes = index.location(units[i]).length;
    if (bytes > left) {
      units.resize(i);
      return;
    }
    left -= bytes;
  }
}

Status CacheUser::OverLimit(UnitId unit) {
  out_of_bytes = true;
  return {StatusCode::kBudgetExceeded,
          UnitName(record, unit) + ": to read it exceeds the query's limit of " +
              std::to_string(*limits.max_bytes) + " bytes; raise it, or the cache's size"};
}

void CacheUser::CountRead(UnitId unit, bool root_piece, uint64_t bytes) {
  stats.bytes_read += bytes;
  ++(root_piece ? stats.root_pieces_read : stats.clusters_read);
  read[unit] = true;
  if (limits.control != nullptr) limits.control->CountLoad();
}

}  // namespace mtdb::internal
