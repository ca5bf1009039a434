// SPDX-License-Identifier: Apache-2.0
#include "tests/tools/hostile_clients.h"

#include <catch2/catch.hpp>
#include <cstdlib>
#include <random>
#include <sys/prctl.h>
#include <thread>
#include <vector>

#include "tests/support/raw_session.h"
#include "tests/tools/http_testing.h"

namespace mtdb::test {
namespace {

// What every client knows.
struct Target {
  int port = 0;
  int from = 1;
  std::string object;  // "/objects/NAME"
};
using Random = std::mt19937;

void Sleep(int milliseconds) {
  std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
}

void AskForEverything(const Target& target, Random&) {
  RawSession session(target.port, target.object + "/session", 4096, target.from);
  if (session.status() != 101) return Sleep(50);
  for (uint64_t id = 0; session.SendNow(TextFrame(QueryMessage(
           id, id % 2 == 0 ? R"({"threshold": "full"})" : R"({"threshold": "coarsest"})")));
       ++id) {
    Sleep(5);
  }
  Sleep(2000);
}

void AskForParts(const Target& target, Random& random) {
  RawSession session(target.port, target.object + "/session?remember=1000000", 0, target.from);
  if (session.status() != 101) return Sleep(50);
  std::uniform_real_distribution<double> place(-1, 1);
  session.ReceiveText();
  for (uint64_t id = 0; id < 30; ++id) {
    const Json centre{place(random), place(random), place(random)};
    const Json query{{"region", {{"sphere", {{"centre", centre}, {"radius", 0.7}}}}},
                     {"clip", true}};
    if (!session.Send(TextFrame(QueryMessage(id, TextOf(query))))) return;
    if (session.ReceiveText().is_null()) return;
  }
}

void ReadSlowly(const Target& target, Random& random) {
  RawConnection connection(target.port, 4096, target.from);
  connection.Send(RequestText("GET", target.object + "/mesh?format=obj"));
  for (size_t i = 0; i < 20 + random() % 100; ++i) {
    if (connection.Take(100).empty()) return;
    Sleep(100);
  }
}

void AskForCostlyRegions(const Target& target, Random& random) {
  RawConnection connection(target.port, 0, target.from);
  connection.Send(RequestText("POST", target.object + "/mesh", SlowQuery()));
  Sleep(static_cast<int>(random() % 3000));
}

void SendRandomBytes(const Target& target, Random& random) {
  const bool session = random() % 2 == 0;
  std::string bytes =
      session ? UpgradeRequest(target.object + "/session") +
                    TextFrame(QueryMessage(1, R"({"max_triangles": 700})"))
              : RequestText("POST", target.object + "/mesh", R"({"max_triangles": 50})");
  for (size_t k = random() % 4; k > 0; --k) {
    bytes[random() % bytes.size()] = static_cast<char>(random());
  }
  bytes.resize(1 + random() % bytes.size());
  RawConnection connection(target.port, 0, target.from);
  connection.Send(bytes);
  if (random() % 2 == 0) connection.CloseSending();
  Sleep(static_cast<int>(random() % 300));
}

void SendLongMessages(const Target& target, Random& random) {
  RawSession session(target.port, target.object + "/session", 0, target.from);
  if (session.status() != 101) return Sleep(50);
  session.ReceiveText();
  for (int i = 0; i < 10; ++i) {
    std::string message = R"({"id": 1, "query": {"region": [)";
    while (message.size() < (size_t{1} << (12 + random() % 9)) - 16) message += "1,";
    if (!session.Send(TextFrame(message + (random() % 2 == 0 ? "1]}}" : "")))) return;
    if (session.ReceiveText().is_null()) return;
  }
}

void OpenAndClose(const Target& target, Random& random) {
  const RawConnection connection(target.port, 0, target.from);
  Sleep(static_cast<int>(random() % 20));
}

void Live(char kind, const Target& target, unsigned seed) {
  Random random(seed);
  while (true) {
    switch (kind) {
      case 'e': AskForEverything(target, random); break;
      case 'c': AskForParts(target, random); break;
      case 's': ReadSlowly(target, random); break;
      case 'p': AskForCostlyRegions(target, random); break;
      case 'b': SendRandomBytes(target, random); break;
      case 'm': SendLongMessages(target, random); break;
      default: OpenAndClose(target, random);
    }
  }
}

std::string Environment(const char* name) {
  const char* text = std::getenv(name);
  return text == nullptr ? "" : text;
}

// What HostileClients starts; it ends by a signal only.
TEST_CASE("hostile clients", "[.hostile]") {
  const std::string kinds = Environment("MTDB_HOSTILE_KINDS");
  const int addresses = std::stoi("0" + Environment("MTDB_HOSTILE_ADDRESSES"));
  std::vector<std::thread> clients;
  for (size_t i = 0; i < kinds.size(); ++i) {
    Target target{std::stoi("0" + Environment("MTDB_HOSTILE_PORT")), 1,
                  Environment("MTDB_HOSTILE_OBJECT")};
    if (addresses > 0) target.from = 2 + static_cast<int>(i) % addresses;
    clients.emplace_back(Live, kinds[i], target, static_cast<unsigned>(i));
  }
  for (std::thread& client : clients) client.join();
}

}  // namespace

HostileClients::HostileClients(int port, const std::string& object, const std::string& kinds,
                               int addresses) {
  const std::vector<std::string> environment{
      "MTDB_HOSTILE_PORT=" + std::to_string(port), "MTDB_HOSTILE_OBJECT=/objects/" + object,
      "MTDB_HOSTILE_KINDS=" + kinds, "MTDB_HOSTILE_ADDRESSES=" + std::to_string(addresses)};
  std::vector<char*> variables;
  for (const std::string& text : environment) variables.push_back(const_cast<char*>(text.c_str()));
  variables.push_back(nullptr);
  char* arguments[] = {const_cast<char*>("hostile"), const_cast<char*>("[.hostile]"), nullptr};
  process_ = ::fork();
  REQUIRE(process_ >= 0);
  if (process_ > 0) return;
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  const int nowhere = ::open("/dev/null", O_WRONLY);
  ::dup2(nowhere, 1);
  ::execve("/proc/self/exe", arguments, variables.data());
  ::_exit(127);
}

HostileClients::~HostileClients() {
  ::kill(process_, SIGKILL);
  ::waitpid(process_, nullptr, 0);
}

}  // namespace mtdb::test
