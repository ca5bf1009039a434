// SPDX-License-Identifier: Apache-2.0
// A server that is short of something: memory, temporary files, room for sessions.
#include <catch2/catch.hpp>
#include <sys/resource.h>

#include "tests/support/raw_session.h"
#include "tests/tools/hostile_clients.h"
#include "tests/tools/http_testing.h"

namespace mtdb::test {
namespace {

const std::string kMesh = "/objects/sculpture/mesh";
const std::string kSession = "/objects/sculpture/session";
constexpr const char* kFull = R"({"threshold": "full"})";

TEST_CASE("answers under way take no more of temporary files than they may", "[server]") {
  const ServerProcess server(TheExample().store, {"--max-tmp", "3M"});
  const auto bytes = [&] { return server.Metric("mtdb_temporary_bytes"); };
  // Those who do not read hold what they were given, until others want some.
  std::vector<std::unique_ptr<RawConnection>> slow;
  for (int i = 0; i < 12; ++i) {
    slow.push_back(std::make_unique<RawConnection>(server.port(), 4096, 2));
    slow.back()->Send(RequestText("GET", kMesh + "?format=obj"));
  }
  REQUIRE(server.Reaches("mtdb_temporary_bytes", 1));
  const std::string few = server.Get(kMesh + "?triangles=500").body;
  CHECK(few.size() > 500);
  for (int i = 0; i < 20; ++i) {
    CHECK(server.Get(kMesh + "?triangles=500").body == few);
    CHECK(bytes() <= 3 << 20);
    CHECK(bytes() > 1 << 19);  // and not in the system's buffers, where no limit sees it
  }
  CHECK(server.Get(kMesh).status == 200);
  CHECK(server.Metric("mtdb_temporary_limit_bytes") == 3 << 20);
  slow.clear();
  CHECK(server.Becomes("mtdb_temporary_bytes", 0));

  const ServerProcess small(TheExample().store, {"--max-tmp", "100K"});
  const HttpAnswer refused = small.Get(kMesh + "?format=obj");
  CHECK(refused.status == 503);
  CHECK(refused.code() == "no_temporary_space");
  CHECK_THAT(refused.error(), Catch::Contains("102400") && Catch::Contains("--max-tmp"));
  CHECK(small.Get(kMesh + "?triangles=500").status == 200);
  CHECK(small.Becomes("mtdb_temporary_bytes", 0));
}

TEST_CASE("sessions take no more memory than they may", "[server]") {
  const ServerProcess server(TheExample().store, {"--session-memory", "12M"});
  std::vector<std::unique_ptr<RawSession>> sessions;
  int done = 0, refused = 0;
  for (int i = 0; i < 8; ++i) {
    sessions.push_back(std::make_unique<RawSession>(server.port(), kSession, 0, 2));
    REQUIRE(sessions.back()->status() == 101);
    CHECK(sessions.back()->ReceiveText().contains("hello"));
    sessions.back()->Send(TextFrame(QueryMessage(1, kFull)));
    const Json reply = sessions.back()->ReceiveText();
    REQUIRE(reply.is_object());
    if (reply.contains("done")) ++done;
    if (reply.contains("error")) {
      CHECK(reply.at("code") == "no_session_memory");
      CHECK_THAT(reply.at("error").get<std::string>(), Catch::Contains("12582912"));
      ++refused;
    }
    CHECK(server.Metric("mtdb_session_memory_bytes") <= 12 << 20);
  }
  CHECK(done > 0);
  // Another client's session finds room: one of them is closed, and told why.
  RawSession other(server.port(), kSession);
  REQUIRE(other.status() == 101);
  CHECK(other.ReceiveText().contains("hello"));
  other.Send(TextFrame(QueryMessage(1, kFull)));
  CHECK(other.ReceiveText().contains("done"));
  CHECK(server.Metric("mtdb_session_memory_bytes") <= 12 << 20);
  CHECK(refused + server.Metric("mtdb_session_memory_evictions_total") > 0);
  sessions.clear();
  other.Close();
  CHECK(server.Becomes("mtdb_session_memory_bytes", 0));
}

TEST_CASE("a server that was killed leaves no files", "[server]") {
  ServerProcess server(TheExample().store);
  RawConnection slow(server.port(), 4096);
  // Several answers, more than the system buffers.
  std::string requests;
  for (int i = 0; i < 12; ++i) requests += RequestText("GET", kMesh + "?format=obj");
  slow.Send(requests);
  REQUIRE(server.Reaches("mtdb_temporary_bytes", 1));
  const std::string tmp = server.TmpFolder();
  CHECK(std::filesystem::is_empty(tmp));
  server.Signal(SIGKILL);
  CHECK(server.Finish().signal == SIGKILL);
  CHECK(std::filesystem::is_empty(tmp));
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // they need the address space
// In so much of address space it starts or says that it cannot; what clients ask for is answered or
// refused; and it ends when it is told to.
TEST_CASE("a server in little memory answers or refuses, goes on, and can be stopped", "[server]") {
  const std::string store = TheExample().store;
  int started = 0;
  for (uint64_t megabytes = 60; megabytes <= 420; megabytes += 40) {
    INFO(megabytes << " MB");
    const Folder folder;
    rlimit before{};
    REQUIRE(::getrlimit(RLIMIT_AS, &before) == 0);
    const rlimit little{megabytes << 20, before.rlim_max};
    REQUIRE(::setrlimit(RLIMIT_AS, &little) == 0);
    const pid_t process = Start({"serve", store, "--listen", "0", "--threads", "4"},
                                folder.File("out"), folder.File("err"));
    REQUIRE(::setrlimit(RLIMIT_AS, &before) == 0);
    int port = 0;
    int status = 0;
    bool ended = false;
    ServerProcess::Await([&] {
      ended = ::waitpid(process, &status, WNOHANG) == process;
      const std::string line = ReadText(folder.File("out"));
      if (line.ends_with('\n')) port = std::stoi(line.substr(line.rfind(':') + 1));
      return ended || port > 0;
    });
    if (ended) {
      // With too little for the libraries the system does not even start it.
      const std::string said = ReadText(folder.File("err"));
      INFO(said);
      CHECK(WIFEXITED(status));
      CHECK((WEXITSTATUS(status) == 127 || IsOneLine(said)));
      continue;
    }
    REQUIRE(port > 0);
    ++started;
    {
      const HostileClients clients(port, "sculpture", "eccps");
      for (int i = 0; i < 8; ++i) {
        RawConnection connection(port);
        connection.Send(RequestText("GET", kMesh + "?triangles=2000"));
        const HttpAnswer answer = connection.ReceiveAnswer();
        CHECK((answer.status == 200 || answer.status == 503 || answer.status == 0));
      }
    }
    const auto answered = [&] {
      RawConnection connection(port);
      connection.Send(RequestText("GET", "/healthz"));
      return connection.ReceiveAnswer().status == 200;
    };
    const bool goes_on = ServerProcess::Await(answered);
    ::kill(process, SIGTERM);
    const Outcome outcome = Finish(process);
    INFO("exit " << outcome.exit_code << ", signal " << outcome.signal << ": "
                 << ReadText(folder.File("err")));
    CHECK(goes_on);
    CHECK(outcome.exit_code == 0);
  }
  CHECK(started > 0);
}
#endif

}  // namespace
}  // namespace mtdb::test
