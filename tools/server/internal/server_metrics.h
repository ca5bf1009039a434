// SPDX-License-Identifier: Apache-2.0
// Counters of a server, as Prometheus reads them.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <mutex>
#include <string>

#include "tools/server/internal/server_pool.h"

namespace mtdb::internal {

// Safe for many threads.
class ServerMetrics {
 public:
  std::atomic<uint64_t> connections{0};  // open now
  std::atomic<uint64_t> in_flight{0};    // requests read and not yet answered
  std::atomic<uint64_t> queries{0};      // begun
  std::atomic<uint64_t> queries_cancelled{0};
  ServerPool::Figures query_jobs;           // meshes and updates
  ServerPool::Figures upstream_jobs;        // what waits for the server that has the store
  ServerPool::Figures catalog_jobs;         // what is short
  std::atomic<uint64_t> triangles_sent{0};  // of meshes that went out whole
  std::atomic<uint64_t> sent_bytes{0};      // of answers
  std::atomic<uint64_t> read_bytes{0};      // payloads, from the store
  std::atomic<uint64_t> cache_hits{0};      // clusters that a query found decoded
  std::atomic<uint64_t> sessions{0};        // open now
  std::atomic<uint64_t> sessions_opened{0};
  std::atomic<uint64_t> updates{0};  // of sessions, done
  std::atomic<uint64_t> updates_superseded{0};
  std::atomic<uint64_t> stream_bytes{0};  // sent

  // A request is over. `code` is the HTTP status; 499 when the client went away.
  void Finish(unsigned code, double seconds);

  struct Cache {
    uint64_t objects_open = 0;
    uint64_t bytes = 0;
    uint64_t decoded = 0;  // units, since the server started
  };
  // What all clients share (ServerLedger).
  struct Shared {
    uint64_t bytes = 0;
    uint64_t limit = 0;
    uint64_t evictions = 0;
  };
  std::string Text(const Cache& cache, const Shared& temporary, const Shared& sessions_memory,
                   const Shared& tiles) const;

 private:
  std::string RequestsText() const;

  static constexpr std::array<double, 10> kBounds{0.001, 0.005, 0.01, 0.05, 0.1,
                                                  0.5,   1,     5,    10,   60};  // seconds
  mutable std::mutex mutex_;
  std::array<uint64_t, 600> requests_{};  // by code
  std::array<uint64_t, kBounds.size() + 1> slots_{};
  double seconds_ = 0;
};

}  // namespace mtdb::internal
