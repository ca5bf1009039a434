// SPDX-License-Identifier: Apache-2.0
#include "tools/server/internal/server_metrics.h"

#include <algorithm>
#include <cstdio>

#include "tools/server/internal/freed_memory.h"

namespace mtdb::internal {

namespace {

std::string Number(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.9g", value);
  return text;
}

}  // namespace

void ServerMetrics::Finish(unsigned code, double seconds) {
  const std::lock_guard lock(mutex_);
  ++requests_[std::min<size_t>(code, requests_.size() - 1)];
  const auto slot = std::lower_bound(kBounds.begin(), kBounds.end(), seconds) - kBounds.begin();
  ++slots_[static_cast<size_t>(slot)];
  seconds_ += seconds;
}

namespace {

void AddHead(std::string* text, const std::string& name, const char* type, const char* help) {
  *text += "# HELP " + name + " " + help + "\n# TYPE " + name + " " + type + "\n";
}

}  // namespace

std::string ServerMetrics::Text(const Cache& cache, const Shared& temporary,
                                const Shared& sessions_memory, const Shared& tiles) const {
  std::string text;
  const auto add = [&](const std::string& name, const char* type, const char* help,
                       uint64_t value) {
    AddHead(&text, name, type, help);
    text += name + " " + std::to_string(value) + "\n";
  };
  const char* counter = "counter";
  const char* gauge = "gauge";
  add("mtdb_connections", gauge, "Open connections.", connections);
  add("mtdb_requests_in_flight", gauge, "Requests read and not yet answered.", in_flight);
  add("mtdb_queries_total", counter, "Mesh queries begun.", queries);
  add("mtdb_queries_cancelled_total", counter, "Mesh queries stopped before their end.",
      queries_cancelled);
  add("mtdb_queries_running", gauge, "Queries and updates that run.", query_jobs.running);
  add("mtdb_queries_waiting", gauge, "Queries and updates that wait for their turn.",
      query_jobs.waiting);
  add("mtdb_queries_preempted_total", counter,
      "Queries and updates that were stopped and begun anew later, for others that waited.",
      query_jobs.preempted);
  add("mtdb_triangles_sent_total", counter, "Triangles of meshes that were sent whole.",
      triangles_sent);
  add("mtdb_sent_bytes_total", counter, "Bytes of answers sent.", sent_bytes);
  add("mtdb_read_bytes_total", counter, "Bytes of payloads read from the store.", read_bytes);
  add("mtdb_cache_hits_total", counter, "Clusters that a query found decoded.", cache_hits);
  add("mtdb_cache_decodes_total", counter, "Clusters and root pieces decoded.", cache.decoded);
  add("mtdb_cache_bytes", gauge, "Bytes of decoded clusters in memory.", cache.bytes);
  add("mtdb_objects_open", gauge, "Objects that are open.", cache.objects_open);

  const ProcessMemory memory = ReadProcessMemory();
  add("process_resident_memory_bytes", gauge, "Resident memory.", memory.resident_bytes);
  add("mtdb_heap_bytes", gauge, "Memory that is allocated; 0 where that is not known.",
      memory.heap_bytes);

  add("mtdb_temporary_bytes", gauge, "Bytes of answers in temporary files.", temporary.bytes);
  add("mtdb_temporary_limit_bytes", gauge, "The most that they may be.", temporary.limit);
  add("mtdb_temporary_evictions_total", counter,
      "Answers that were broken off so that others found room.", temporary.evictions);

  add("mtdb_tile_space_bytes", gauge, "Bytes of what tiles are made of, in temporary files.",
      tiles.bytes);
  add("mtdb_tile_space_limit_bytes", gauge, "The most that they may be.", tiles.limit);
  add("mtdb_tile_space_evictions_total", counter,
      "Trees of tiles that were given up so that others found room.", tiles.evictions);

  add("mtdb_sessions", gauge, "Open sessions.", sessions);
  add("mtdb_sessions_total", counter, "Sessions opened.", sessions_opened);
  add("mtdb_session_updates_total", counter, "Queries of sessions that were answered in full.",
      updates);
  add("mtdb_session_updates_superseded_total", counter,
      "Queries of sessions that a later one took the place of.", updates_superseded);
  add("mtdb_session_stream_bytes_total", counter, "Bytes of update streams sent.", stream_bytes);
  add("mtdb_session_memory_bytes", gauge, "Memory of sessions, about.", sessions_memory.bytes);
  add("mtdb_session_memory_limit_bytes", gauge, "The most that it may be.", sessions_memory.limit);
  add("mtdb_session_memory_evictions_total", counter,
      "Sessions that were closed so that others found room.", sessions_memory.evictions);
  return text + RequestsText();
}

std::string ServerMetrics::RequestsText() const {
  std::string text;
  const std::lock_guard lock(mutex_);
  AddHead(&text, "mtdb_requests_total", "counter",
          "Requests by status; 499: the client went away.");
  for (size_t code = 0; code < requests_.size(); ++code) {
    if (requests_[code] == 0) continue;
    text += "mtdb_requests_total{code=\"" + std::to_string(code) + "\"} " +
            std::to_string(requests_[code]) + "\n";
  }
  AddHead(&text, "mtdb_request_seconds", "histogram",
          "From a request's last byte to its answer's last.");
  uint64_t sum = 0;
  for (size_t i = 0; i < slots_.size(); ++i) {
    sum += slots_[i];
    const std::string bound = i < kBounds.size() ? Number(kBounds[i]) : "+Inf";
    text += "mtdb_request_seconds_bucket{le=\"" + bound + "\"} " + std::to_string(sum) + "\n";
  }
  text += "mtdb_request_seconds_sum " + Number(seconds_) + "\n";
  text += "mtdb_request_seconds_count " + std::to_string(sum) + "\n";
  return text;
}

}  // namespace mtdb::internal
