// SPDX-License-Identifier: Apache-2.0
// Memory that was freed goes back to the system: the C library keeps what many threads have freed,
// and a server that once had many clients would look as if it still had them.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>

#include "tools/server/internal/server_pool.h"

namespace mtdb::internal {

struct ProcessMemory {
  uint64_t resident_bytes = 0;   // of the process
  uint64_t anonymous_bytes = 0;  // those of them that no file is behind
  uint64_t heap_bytes = 0;       // allocated and not freed; 0 where the C library does not tell
};
ProcessMemory ReadProcessMemory();

class FreedMemory {
 public:
  // `pool` runs what takes some milliseconds.
  explicit FreedMemory(ServerPool& pool) : pool_(pool) {}
  // The loop's thread, several times a second: looks now and then.
  void Tick(std::chrono::steady_clock::time_point now);

 private:
  ServerPool& pool_;
  std::chrono::steady_clock::time_point next_look_;
  bool running_ = false;
};

}  // namespace mtdb::internal
