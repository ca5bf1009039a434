// SPDX-License-Identifier: Apache-2.0
// A server for a long time under hostile and honest clients: what it holds must stay flat.
// tests/campaigns/server_soak runs it.
#include <atomic>
#include <catch2/catch.hpp>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "tests/support/raw_session.h"
#include "tests/tools/hostile_clients.h"
#include "tests/tools/http_testing.h"

namespace mtdb::test {
namespace {

struct Maxima {
  int looks = 0;
  uint64_t resident_bytes = 0;
  size_t descriptors = 0;
  double temporary_bytes = 0;
  double session_bytes = 0;
};

// One of the honest: asks, and compares with what is right.
void AskHonestly(const ServerProcess& server, unsigned seed, const std::vector<std::string>& right,
                 const std::atomic<bool>& over, std::atomic<uint64_t>& answers,
                 std::atomic<uint64_t>& refused, std::atomic<uint64_t>& wrong,
                 std::atomic<uint64_t>& slowest_ms) {
  std::mt19937 random(seed);
  while (!over) {
    const size_t which = random() % right.size();
    const auto begin = std::chrono::steady_clock::now();
    RawConnection connection(server.port(), 0, 100 + static_cast<int>(seed));
    connection.Send(RequestText(
        "GET", "/objects/sculpture/mesh?triangles=" + std::to_string(500 * (which + 1))));
    const HttpAnswer answer = connection.ReceiveAnswer();
    const auto ms = static_cast<uint64_t>(std::chrono::duration_cast<std::chrono::milliseconds>(
                                              std::chrono::steady_clock::now() - begin)
                                              .count());
    for (uint64_t most = slowest_ms; ms > most && !slowest_ms.compare_exchange_weak(most, ms);) {
    }
    if (answer.status == 200) {
      ++(answer.body == right[which] ? answers : wrong);
    } else {
      ++refused;
    }
  }
}

// All have left. What the server has allocated is what it has in its cache, and some more; what it
// keeps of the system's memory goes down to about that, in its own time.
void CheckWhatIsKept(const ServerProcess& server) {
  constexpr double kMore = 64e6;  // of objects, indices, threads
  double heap = 0, resident = 0, cache = 0;
  for (int i = 0; i < 60; ++i) {
    heap = server.Metric("mtdb_heap_bytes");
    if (heap == 0) return;  // not known here
    resident = static_cast<double>(server.resident_bytes());
    cache = server.Metric("mtdb_cache_bytes");
    if (heap < cache + kMore && resident < heap + 2 * kMore) break;
    std::this_thread::sleep_for(std::chrono::seconds(1));
  }
  std::printf("all have left: resident %.0f MB, %.0f MB of them allocated, cache %.0f MB\n",
              resident / 1e6, heap / 1e6, cache / 1e6);
  CHECK(heap < cache + kMore);
  CHECK(resident < heap + 2 * kMore);
}

TEST_CASE("a server under hostile clients holds no more as time goes by", "[.soak]") {
  const char* text = std::getenv("MTDB_SOAK_SECONDS");
  const int seconds = text == nullptr ? 30 : std::stoi(text);
  // Start() ends a process that takes longer than its time; clients of a busy machine may need an
  // hour to come to their end.
  ::setenv("MTDB_SOAK_SECONDS", std::to_string(seconds + 3600).c_str(), 1);
  const Example example(200000);
  ServerProcess server(example.store,
                       {"--max-connections", "400", "--max-sessions", "120", "--max-tmp", "256M",
                        "--session-memory", "512M", "--idle", "5", "--timeout", "20"});
  std::vector<std::string> right;
  for (int i = 1; i <= 4; ++i) {
    right.push_back(
        server.Get("/objects/sculpture/mesh?triangles=" + std::to_string(500 * i)).body);
  }
  std::string kinds;
  while (kinds.size() < 180) kinds += "ecspbmf";
  auto hostile = std::make_unique<HostileClients>(server.port(), "sculpture", kinds, 8);
  std::atomic<bool> over{false};
  std::atomic<uint64_t> answers{0}, refused{0}, wrong{0}, slowest_ms{0};
  std::vector<std::thread> honest;
  for (unsigned i = 0; i < 20; ++i) {
    honest.emplace_back(
        [&, i] { AskHonestly(server, i, right, over, answers, refused, wrong, slowest_ms); });
  }
  // Until there are as many sessions as there will be.
  const double begun = std::min(seconds / 4.0, 300.0);
  Maxima beginning;
  Maxima halves[2];  // of the rest
  Maxima part;       // since the last line was printed
  double next_line = 0;
  const auto begin = std::chrono::steady_clock::now();
  const std::string descriptors = "/proc/" + std::to_string(server.process()) + "/fd";
  for (double passed = 0; passed < seconds;) {
    std::this_thread::sleep_for(std::chrono::seconds(1));
    passed = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    Maxima& m = passed < begun ? beginning : halves[2 * passed < begun + seconds ? 0 : 1];
    ++m.looks;
    m.resident_bytes = std::max(m.resident_bytes, server.resident_bytes());
    size_t open = 0;
    for (const auto& entry : std::filesystem::directory_iterator(descriptors)) {
      open += entry.path().empty() ? 0 : 1;
    }
    const double temporary = server.Metric("mtdb_temporary_bytes");
    for (Maxima* of : {&m, &part}) {
      of->descriptors = std::max(of->descriptors, open);
      of->temporary_bytes = std::max(of->temporary_bytes, temporary);
    }
    m.session_bytes = std::max(m.session_bytes, server.Metric("mtdb_session_memory_bytes"));
    CHECK(server.temporary_files() == 0);
    part.resident_bytes = std::max(part.resident_bytes, server.resident_bytes());
    part.session_bytes = std::max(part.session_bytes, server.Metric("mtdb_session_memory_bytes"));
    if (passed < next_line) continue;
    std::printf(
        "%6.0f s: resident up to %.0f MB, %zu descriptors, temporary files %.1f MB, sessions %.0f "
        "MB, cache %.0f MB\n",
        passed, static_cast<double>(part.resident_bytes) / 1e6, part.descriptors,
        part.temporary_bytes / 1e6, part.session_bytes / 1e6,
        server.Metric("mtdb_cache_bytes") / 1e6);
    std::fflush(stdout);
    part = {};
    next_line += seconds / 20.0;
  }
  CHECK(hostile->running());
  over = true;
  for (std::thread& client : honest) client.join();
  for (const Maxima& m : halves) {
    std::printf(
        "half: resident %.0f MB, %zu descriptors, temporary files %.1f MB, sessions %.1f MB\n",
        static_cast<double>(m.resident_bytes) / 1e6, m.descriptors, m.temporary_bytes / 1e6,
        m.session_bytes / 1e6);
  }
  std::printf(
      "honest: %llu right, %llu refused, %llu wrong, the slowest after %llu ms\n"
      "server: %.0f queries, %.0f preempted, %.0f cancelled, %.0f sessions\n",
      static_cast<unsigned long long>(answers), static_cast<unsigned long long>(refused),
      static_cast<unsigned long long>(wrong), static_cast<unsigned long long>(slowest_ms),
      server.Metric("mtdb_queries_total"), server.Metric("mtdb_queries_preempted_total"),
      server.Metric("mtdb_queries_cancelled_total"), server.Metric("mtdb_sessions_total"));
  hostile.reset();
  CHECK(server.Becomes("mtdb_session_memory_bytes", 0));
  CheckWhatIsKept(server);
  CHECK(wrong == 0);
  CHECK(server.Get("/healthz").status == 200);
  CHECK(answers > 0);
  if (std::min(halves[0].looks, halves[1].looks) >= 60) {
    CHECK(halves[1].resident_bytes < halves[0].resident_bytes * 9 / 8 + (64 << 20));
  } else {
    std::printf("too short, or too busy, to tell whether memory stays flat\n");
  }
  CHECK(halves[1].descriptors <= 2 * 400 + 100);
  CHECK(halves[1].temporary_bytes <= 256 << 20);
  CHECK(halves[1].session_bytes <= 512 << 20);
  const pid_t process = server.process();
  CHECK(::kill(process, 0) == 0);
  server.Signal(SIGTERM);
  const Outcome outcome = server.Finish();
  INFO("signal " << outcome.signal << ": " << server.errors());
  CHECK(outcome.exit_code == 0);
}

}  // namespace
}  // namespace mtdb::test
