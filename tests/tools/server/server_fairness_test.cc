// SPDX-License-Identifier: Apache-2.0
// What clients of a server get beside others that want everything: their share, soon. Whose turn it
// is, counted in decisions: fair_queue_test.cc.
#include <catch2/catch.hpp>

#include "tests/support/raw_session.h"
#include "tests/tools/hostile_clients.h"
#include "tests/tools/http_testing.h"
#include "tools/client/client.h"

namespace mtdb::test {
namespace {

const std::string kMesh = "/objects/sculpture/mesh";

// Small meshes and a session, of a client who gets them right while others are at work.
void CheckIsServed(const ServerProcess& server, int from) {
  const std::string few = server.Get(kMesh + "?triangles=500").body;
  for (int i = 0; i < 5; ++i) {
    RawConnection connection(server.port(), 0, from);
    connection.Send(RequestText("GET", kMesh + "?triangles=500"));
    const HttpAnswer answer = connection.ReceiveAnswer();
    CHECK(answer.status == 200);
    CHECK(answer.body == few);
  }
  RawSession session(server.port(), "/objects/sculpture/session", 0, from);
  REQUIRE(session.status() == 101);
  CHECK(session.ReceiveText().contains("hello"));
  for (uint64_t id = 1; id <= 5; ++id) {
    session.Send(TextFrame(
        QueryMessage(id, id % 2 == 0 ? R"({"max_triangles": 900})" : R"({"threshold": "full"})")));
    const Json reply = session.ReceiveText();
    REQUIRE(reply.is_object());
    CHECK(reply.at("id") == id);
    CHECK(reply.contains("done"));
  }
}

TEST_CASE("sessions that ask for everything and never read keep nobody waiting", "[server]") {
  const ServerProcess server(TheExample().store, {"--threads", "1"});
  for (const int addresses : {0, 3}) {
    const HostileClients hostile(server.port(), "sculpture", std::string(24, 'e'), addresses);
    REQUIRE(server.Reaches("mtdb_sessions", 16));
    CheckIsServed(server, 1);
    CHECK(hostile.running());
  }
  CHECK(server.Becomes("mtdb_sessions", 0));
}

TEST_CASE("costly queries of one client never occupy all threads", "[server]") {
  for (const std::string threads : {"1", "3"}) {
    ServerProcess server(TheExample().store, {"--threads", threads, "--grace", "0.1"});
    std::vector<std::unique_ptr<RawConnection>> costly;
    for (int i = 0; i < 8; ++i) {
      costly.push_back(std::make_unique<RawConnection>(server.port(), 0, 2));
      costly.back()->Send(RequestText("POST", kMesh, EndlessQuery()));
    }
    REQUIRE(server.Reaches("mtdb_queries_waiting", 8 - 2 * std::stoi(threads)));
    CheckIsServed(server, 1);
    // One that asks again and again from the same address.
    CheckIsServed(server, 2);
    CHECK(server.Metric("mtdb_requests_in_flight") == 9);
    // When they go, nothing of them is left.
    costly.clear();
    CHECK(server.Becomes("mtdb_queries_running", 0));
    CHECK(server.Metric("mtdb_queries_waiting") == 0);
    CHECK(server.Metric("mtdb_requests_total{code=\"499\"}") == 8);
    CHECK(server.Stop().exit_code == 0);
    CHECK(server.errors().empty());
  }
}

TEST_CASE("hostile clients of all kinds keep nobody from his meshes and sessions", "[server]") {
  const ServerProcess server(TheExample().store, {"--threads", "2"});
  std::string kinds;
  for (int i = 0; i < 6; ++i) kinds += "ecspbmf";
  const HostileClients hostile(server.port(), "sculpture", kinds, 4);
  REQUIRE(server.Reaches("mtdb_queries_total", 4));
  for (int i = 0; i < 4; ++i) CheckIsServed(server, 1);
  CHECK(hostile.running());
  CHECK(server.errors().empty());
}

}  // namespace
}  // namespace mtdb::test
