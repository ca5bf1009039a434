// SPDX-License-Identifier: Apache-2.0
#include "tools/server/internal/freed_memory.h"

#include <cstdio>
#include <memory>
#include <new>
#include <unistd.h>

#if defined(__GLIBC__) && __GLIBC_PREREQ(2, 33)
#include <malloc.h>
#define MTDB_MALLINFO 1
#else
#define MTDB_MALLINFO 0
#endif

namespace mtdb::internal {

namespace {

constexpr auto kPeriod = std::chrono::seconds(2);
// After an attempt, whose gain may be small: pages with something in use stay.
constexpr auto kPause = std::chrono::seconds(20);
// What may be kept beside what is in use, for the next clients.
constexpr uint64_t kKeptBytes = uint64_t{48} << 20;

bool KeepsMuch(const ProcessMemory& memory) {
  return memory.heap_bytes != 0 &&
         memory.anonymous_bytes > memory.heap_bytes + memory.heap_bytes / 4 + kKeptBytes;
}

}  // namespace

ProcessMemory ReadProcessMemory() {
  ProcessMemory memory;
  if (std::FILE* const file = std::fopen("/proc/self/statm", "re")) {
    unsigned long long size = 0, resident = 0, shared = 0;
    if (std::fscanf(file, "%llu %llu %llu", &size, &resident, &shared) == 3) {
      const auto page = static_cast<uint64_t>(::sysconf(_SC_PAGESIZE));
      memory.resident_bytes = resident * page;
      memory.anonymous_bytes = (resident - shared) * page;
    }
    std::fclose(file);
  }
#if MTDB_MALLINFO
  const struct mallinfo2 info = ::mallinfo2();
  memory.heap_bytes = info.uordblks + info.hblkhd;
#endif
  return memory;
}

void FreedMemory::Tick(std::chrono::steady_clock::time_point now) {
#if MTDB_MALLINFO
  if (running_ || now < next_look_) return;
  next_look_ = now + kPeriod;
  if (!KeepsMuch(ReadProcessMemory())) return;
  next_look_ = now + kPause;
  try {
    const auto job = std::make_shared<ServerPool::Job>();
    job->client.address = "memory";
    job->work = [] { (void)::malloc_trim(0); };
    job->done = [this] { running_ = false; };
    pool_.Submit(job);
    running_ = true;
  } catch (const std::bad_alloc&) {
    // The next look comes.
  }
#else
  static_cast<void>(now);
#endif
}

}  // namespace mtdb::internal
