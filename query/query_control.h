// SPDX-License-Identifier: Apache-2.0
// QueryControl: watches a query from another thread, and stops it.
#pragma once

#include <atomic>
#include <cstdint>

namespace mtdb {

namespace internal {
struct CacheUser;
class CutImpl;
class Insertion;
class Search;
}  // namespace internal

// Given by pointer in Query; must outlive the query and its Cut. One query at a time. Safe for many
// threads: any of them may cancel or look at the progress.
class QueryControl {
 public:
  // Makes the query, probe or check return kCancelled within some milliseconds, even when it waits
  // for other queries, and whatever its region costs: it looks at cancelled() every few hundred
  // steps. It first finishes a read or decode that is under way, and does not interrupt a sink.
  // Cannot be undone.
  void Cancel() { cancelled_.store(true, std::memory_order_relaxed); }
  bool cancelled() const { return cancelled_.load(std::memory_order_relaxed); }

  // So far; they only grow.
  uint64_t clusters_loaded() const { return clusters_loaded_.load(std::memory_order_relaxed); }
  uint64_t nodes_applied() const { return nodes_applied_.load(std::memory_order_relaxed); }
  uint64_t triangles_emitted() const { return triangles_emitted_.load(std::memory_order_relaxed); }

 private:
  friend struct internal::CacheUser;
  friend class internal::Search;
  friend class internal::Insertion;
  friend class internal::CutImpl;
  void CountLoad() { clusters_loaded_.fetch_add(1, std::memory_order_relaxed); }

  std::atomic<bool> cancelled_{false};
  std::atomic<uint64_t> clusters_loaded_{0};
  std::atomic<uint64_t> nodes_applied_{0};
  std::atomic<uint64_t> triangles_emitted_{0};
};

}  // namespace mtdb
