// SPDX-License-Identifier: Apache-2.0
// Sessions of a server that is a process of its own: clients that follow it, that ask too much,
// that are slow, hostile, many, or gone.
#include <array>
#include <atomic>
#include <catch2/catch.hpp>
#include <random>
#include <set>

#include "query/query_json.h"
#include "query/surface.h"
#include "store/database.h"
#include "tests/support/attribute_kinds.h"
#include "tests/support/client_mesh_check.h"
#include "tests/support/raw_session.h"
#include "tests/tools/http_testing.h"
#include "tools/client/client.h"

namespace mtdb::test {
namespace {

const std::string kSession = "/objects/sculpture/session";
constexpr const char* kFull = R"({"threshold": "full"})";
constexpr const char* kCoarsest = R"({"threshold": "coarsest"})";

// One server for all tests that leave it as it is.
const ServerProcess& TheServer() {
  static const ServerProcess kServer(TheExample().store);
  return kServer;
}

std::unique_ptr<RemoteSession> OpenSession(const ServerProcess& server,
                                           const RemoteSessionOptions& options = {}) {
  auto session = RemoteSession::Open(server.url(), options);
  INFO(session.status().message());
  REQUIRE(session.ok());
  return *std::move(session);
}

RemoteUpdate UpdateOk(RemoteSession& session, const std::string& query) {
  const auto update = session.Update(query);
  INFO(query << ": " << update.status().message());
  REQUIRE(update.ok());
  return *update;
}

using Corner = std::pair<std::array<double, 3>, std::string>;  // position and row
using Corners = std::array<Corner, 3>;

// The triangles as positions and attributes, each from its smallest corner on.
std::multiset<Corners> TrianglesOf(const TriangleMesh& mesh) {
  const size_t row = mesh.header.attributes.row_bytes();
  std::multiset<Corners> set;
  for (const TriangleVertices& t : mesh.triangles) {
    Corners c;
    for (size_t i = 0; i < 3; ++i) {
      const Vec3d p = mesh.positions[t[i]];
      c[i] = {{p.x, p.y, p.z}, std::string(AsString(ByteSpan(mesh.rows).subspan(t[i] * row, row)))};
    }
    set.insert(std::min({c, Corners{c[1], c[2], c[0]}, Corners{c[2], c[0], c[1]}}));
  }
  return set;
}

std::multiset<Corners> TrianglesOf(const RemoteSession& session) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  REQUIRE(session.SendMesh(sink).ok());
  return TrianglesOf(mesh);
}

// The store without a server.
class LocalObject {
 public:
  explicit LocalObject(const std::string& store, const std::string& name = "")
      : surface_(*Surface::Open(*(*Database::Open(store))->OpenObject(name))) {}
  const ObjectRecord& record() const { return surface_->record(); }
  std::multiset<Corners> Extract(const std::string& text, ExtractStats* stats = nullptr) const {
    const auto query = ParseQuery(text, surface_->record());
    REQUIRE(query.ok());
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    const auto extracted = surface_->Extract(*query, sink);
    REQUIRE(extracted.ok());
    if (stats != nullptr) *stats = *extracted;
    return TrianglesOf(mesh);
  }

 private:
  std::shared_ptr<Surface> surface_;
};

std::string RandomQuery(std::mt19937& random) {
  std::uniform_real_distribution<double> place(-1, 1), size(0.1, 0.8), log_error(-4, -1.5);
  const auto point = [&] { return Json{place(random), place(random), place(random)}; };
  Json query;
  const double error = std::pow(10, log_error(random));
  switch (random() % 4) {
    case 0: query["region"] = {{"sphere", {{"centre", point()}, {"radius", size(random)}}}}; break;
    case 1: {
      const Json low = point();
      Json high = low;
      for (Json& value : high) value = value.get<double>() + size(random);
      query["region"] = {{"box", {{"min", low}, {"max", high}}}};
      break;
    }
    case 2: {
      const Json camera{{"eye", {5 * place(random), -4, 1}}, {"target", point()}, {"fov", 25}};
      return Json{{"region", {{"frustum", camera}}},
                  {"threshold", {{"screen", {{"camera", camera}, {"pixels", 2}}}}}}
          .dump();
    }
    default: break;
  }
  if (query.contains("region") && random() % 2 == 0) query["clip"] = true;
  if (random() % 3 == 0) {
    query["max_triangles"] = 500 + random() % 4000;
  } else {
    query["threshold"] = {{"relative", error}};
  }
  return TextOf(query);
}

TEST_CASE("a session's client has the mesh that extract gives, query after query", "[server]") {
  const LocalObject object(TheExample().store);
  std::mt19937 random(7);
  for (const uint32_t remembered : {0u, 5000u}) {
    RemoteSessionOptions options;
    options.remembered_vertices = remembered;
    const auto session = OpenSession(TheServer(), options);
    CHECK(session->object() == "sculpture");
    CHECK(session->remembered_vertices() == remembered);
    CHECK(session->object_triangles() == TheExample().info.at("triangles"));
    CHECK(TrianglesOf(*session) == object.Extract(kCoarsest));
    for (int step = 0; step < 16; ++step) {
      const std::string query = step == 0 ? kFull : RandomQuery(random);
      INFO(query);
      uint64_t bytes = 0, messages = 0;
      const auto update = session->Update(query, [&](uint64_t n) {
        CHECK(testing::ClientMeshFault(session->mesh()).empty());
        bytes += n;
        ++messages;
        return Status::Ok();
      });
      REQUIRE(update.ok());
      ExtractStats stats;
      REQUIRE(TrianglesOf(*session) == object.Extract(query, &stats));
      CHECK(update->id == static_cast<uint64_t>(step) + 1);
      CHECK(update->triangles == stats.triangles);
      CHECK(update->vertices == stats.vertices);
      // A session's cut may know more of its errors than a search does.
      CHECK(update->active_triangles <= stats.active_triangles);
      CHECK(update->error_bound <= stats.error_bound);
      CHECK(update->bytes == bytes);
      CHECK(update->messages == messages);
      CHECK((update->insertions + update->removals > 0) == (bytes > 0));
      CHECK(update->first_ms <= update->done_ms);
    }
    session->Close();
    CHECK_FALSE(session->connected());
    CHECK(session->Update(kFull).status().code() == StatusCode::kIoError);
  }
  CHECK(TheServer().Becomes("mtdb_sessions", 0));
  CHECK(TheServer().Metric("mtdb_session_stream_bytes_total") > 0);
  CHECK(TheServer().errors().empty());
}

TEST_CASE("every kind of attribute reaches a session's client, and what follow writes",
          "[server]") {
  const Folder folder;
  const std::string store = folder.File("kinds.mtdb");
  const std::string input = folder.File("kind.ply");
  const std::string path = folder.File("path.jsonl");
  WriteText(path, std::string(kFull) + "\n" + kCoarsest + "\n" + kFull + "\n");
  const std::vector<testing::AttributeKind> kinds =
      testing::AttributeKinds(ReadMesh(SmallExample().mesh));
  for (const testing::AttributeKind& kind : kinds) {
    const auto writer = CreateMeshFileWriter(input, {});
    REQUIRE(writer.ok());
    REQUIRE(SendMesh(kind.mesh, **writer).ok());
    Arguments ingest{"ingest", input, store, "--quiet", "--name", kind.name};
    if (kind.lossless_positions) ingest.push_back("--lossless");
    if (kind.normal_bits) {
      ingest.insert(ingest.end(), {"--normal-bits", std::to_string(*kind.normal_bits)});
    }
    for (const auto& [name, step] : kind.steps) {
      ingest.insert(ingest.end(), {"--attribute-step", name + "=" + std::to_string(step)});
    }
    RunOk(ingest);
  }
  const ServerProcess server(store);
  std::mt19937 random(17);
  for (const testing::AttributeKind& kind : kinds) {
    INFO(kind.name);
    const LocalObject object(store, kind.name);
    RemoteSessionOptions options;
    options.name = kind.name;
    options.remembered_vertices = 300;
    const auto session = OpenSession(server, options);
    CHECK(session->mesh().options().attributes == object.record().attributes);
    for (int step = 0; step < 6; ++step) {
      const std::string query = step % 2 == 0 ? kFull : step == 1 ? kCoarsest : RandomQuery(random);
      UpdateOk(*session, query);
      const bool same = TrianglesOf(*session) == object.Extract(query);
      REQUIRE(same);
    }
    const std::string out = folder.File("step-%d.ply");
    RunOk({"follow", server.url(), "--name", kind.name, "--path", path, "--output", out});
    RunOk({"extract", store, folder.File("full.ply"), "--name", kind.name});
    const bool same = TrianglesOf(ReadMesh(folder.File("step-3.ply"))) ==
                      TrianglesOf(ReadMesh(folder.File("full.ply")));
    CHECK(same);
  }
}

TEST_CASE("a query that is wrong or too large is refused, and the session goes on", "[server]") {
  const ServerProcess server(TheExample().store, {"--session-triangles", "6000"});
  const auto session = OpenSession(server);
  const auto before = UpdateOk(*session, R"({"max_triangles": 3000})");
  const auto refused = [&](const std::string& query, StatusCode code, const std::string& words) {
    const auto update = session->Update(query);
    INFO(query << ": " << update.status().message());
    REQUIRE_FALSE(update.ok());
    CHECK(update.status().code() == code);
    CHECK_THAT(update.status().message(),
               Catch::Contains(words) && Catch::StartsWith(server.url()));
    CHECK(session->connected());
  };
  refused(kFull, StatusCode::kBudgetExceeded, "more than the 6000 triangles");
  refused(R"({"threshold": -1})", StatusCode::kInvalidArgument, "threshold: expected");
  refused(R"({"clip": true})", StatusCode::kInvalidArgument, "clip: needs a region");
  refused(R"({"normals": true})", StatusCode::kInvalidArgument, "normals: ");
  refused(R"({"file": "/etc/passwd"})", StatusCode::kInvalidArgument, "no key");
  CHECK(session->Update("mesh, please").status().code() == StatusCode::kInvalidArgument);
  CHECK(session->Update("{}" + std::string(2 << 20, ' ')).status().code() ==
        StatusCode::kInvalidArgument);
  CHECK(testing::ClientMeshFault(session->mesh()).empty());
  CHECK(session->mesh().triangle_count() <= 6000);
  const auto after = UpdateOk(*session, R"({"max_triangles": 3000})");
  CHECK(after.triangles == before.triangles);

  RemoteSessionOptions small;
  small.max_triangles = 10;
  CHECK_THAT(RemoteSession::Open(server.url(), small).status().message(),
             Catch::Contains("400: the coarsest mesh has"));
  RemoteSessionOptions other;
  other.name = "nothing";
  CHECK(RemoteSession::Open(server.url(), other).status().code() == StatusCode::kNotFound);
}

TEST_CASE("an answer is that of its query, an error too", "[server]") {
  const auto session = OpenSession(TheServer());
  CHECK(session->answered() == 0);
  REQUIRE(session->Send(R"({"threshold": -1})").ok());
  const auto update = session->Update(kFull);
  INFO(update.status().message());
  REQUIRE(update.ok());
  CHECK(update->id == 2);
  CHECK(session->answered() == 2);
  REQUIRE(session->Send(R"({"threshold": -1})").ok());
  CHECK(session->Receive().status().code() == StatusCode::kInvalidArgument);
  CHECK(session->answered() == 3);
  CHECK(session->Receive().status().code() == StatusCode::kInvalidArgument);
  CHECK(session->answered() == 0);
}

TEST_CASE("the latest query wins, and each has one answer", "[server]") {
  const ServerProcess server(TheExample().store, {"--threads", "1"});
  const auto session = OpenSession(server);
  REQUIRE(session->Send(SlowQuery()).ok());
  REQUIRE(server.Reaches("mtdb_queries_running", 1));
  std::set<uint64_t> open{1};
  for (int i = 0; i < 5; ++i) {
    const auto id = session->Send(R"({"max_triangles": )" + std::to_string(1000 + i) + "}");
    REQUIRE(id.ok());
    open.insert(*id);
  }
  uint64_t last = 0;
  std::set<uint64_t> superseded;
  while (!open.empty()) {
    const auto update = session->Receive();
    REQUIRE(update.ok());
    CHECK(open.erase(update->id) == 1);
    if (update->superseded) superseded.insert(update->id);
    if (!update->superseded) last = update->id;
  }
  // Those between are, too, unless the machine is so slow that they are done before the next one.
  CHECK(superseded.contains(1));
  CHECK(last == 6);
  CHECK(session->mesh().triangle_count() <= 1004);
  CHECK(session->Receive().status().code() == StatusCode::kInvalidArgument);
  CHECK(server.Metric("mtdb_session_updates_superseded_total") ==
        static_cast<double>(superseded.size()));
  CHECK(server.Metric("mtdb_session_updates_total") == 6 - static_cast<double>(superseded.size()));

  // All in one piece: none is done before the last is read.
  RawSession raw(server.port(), kSession);
  std::string frames = TextFrame(QueryMessage(1, SlowQuery()));
  for (uint64_t id = 2; id <= 6; ++id) {
    frames += TextFrame(QueryMessage(id, R"({"max_triangles": 1000})"));
  }
  raw.Send(frames);
  CHECK(raw.ReceiveText().contains("hello"));
  for (int i = 0; i < 5; ++i) CHECK(raw.ReceiveText().contains("superseded"));
  CHECK(raw.ReceiveText().at("done").at("triangles") <= 1000);
}

TEST_CASE("many sessions at once share an object's cache", "[server]") {
  constexpr int kClients = 150;
  const ServerProcess server(SmallExample().store, {"--max-sessions", "150"});
  const LocalObject object(SmallExample().store);
  const std::string some = R"({"region": {"sphere": {"centre": [0, 0, 1], "radius": 0.5}}})";
  const std::array<std::multiset<Corners>, 2> right{object.Extract(kFull), object.Extract(some)};
  std::atomic<int> good{0}, opened{0};
  std::vector<std::thread> clients;
  for (int i = 0; i < kClients; ++i) {
    clients.emplace_back([&, i] {
      RemoteSessionOptions options;
      options.name = "sculpture";
      const auto session = RemoteSession::Open(server.url(), options);
      if (!session.ok()) return;
      ++opened;
      // Until all are there.
      ServerProcess::Await([&] { return opened == kClients; });
      for (int k = 0; k < 3; ++k) {
        const bool full = (i + k) % 2 == 0;
        if (!(*session)->Update(full ? kFull : some).ok()) return;
        TriangleMesh mesh;
        TriangleMeshSink sink(&mesh);
        if (!(*session)->SendMesh(sink).ok()) return;
        if (TrianglesOf(mesh) == right[full ? 0 : 1]) ++good;
      }
      (*session)->Close();
    });
  }
  for (std::thread& client : clients) client.join();
  CHECK(good == 3 * kClients);
  CHECK(server.Metric("mtdb_sessions_total") == kClients);
  CHECK(server.Metric("mtdb_objects_open") == 1);
  const Json& info = SmallExample().info;
  CHECK(server.Metric("mtdb_cache_decodes_total") <=
        info.at("clusters").get<double>() + info.at("root_pieces").get<double>());
  CHECK(server.Becomes("mtdb_sessions", 0));
  CHECK(server.errors().empty());
}

TEST_CASE("sessions above the limits are told to come again", "[server]") {
  const Folder folder;
  const std::string store = folder.File("store.mtdb");
  const std::string mesh = folder.File("terrain.ply");
  std::filesystem::copy_file(SmallExample().store, store);
  RunOk({"generate", "terrain", mesh, "--triangles", "500"});
  RunOk({"ingest", mesh, store, "--name", "hill", "--quiet"});
  const ServerProcess server(store, {"--max-sessions", "2", "--max-objects", "1"});
  RawSession first(server.port(), kSession);
  CHECK(first.status() == 101);
  CHECK(first.ReceiveText().at("hello").at("object") == "sculpture");
  // The object that a session is open on stays open.
  CHECK(server.Get("/objects/hill/mesh").status == 200);
  CHECK(server.Get("/objects/sculpture/mesh").status == 200);
  RawConnection other(server.port());
  other.Send(UpgradeRequest("/objects/hill/session"));
  CHECK(other.ReceiveAnswer().code() == "too_many_objects");
  {
    const RawSession second(server.port(), kSession);
    CHECK(second.status() == 101);
    RawConnection third(server.port());
    third.Send(UpgradeRequest(kSession));
    CHECK(third.ReceiveAnswer().code() == "too_many_sessions");
  }
  CHECK(server.Becomes("mtdb_sessions", 1));
  CHECK(RawSession(server.port(), kSession).status() == 101);
}

TEST_CASE("the hello says which limits hold", "[server]") {
  const ServerProcess server(SmallExample().store, {"--session-triangles", "99999999999999"});
  const auto hello = [&](const std::string& parameters) {
    RawSession session(server.port(), kSession + parameters);
    return session.ReceiveText().at("hello");
  };
  const uint64_t most = hello("").at("max_triangles");
  CHECK(most < uint64_t{1} << 30);
  CHECK(hello("").at("remember") == 0);
  CHECK(hello("?remember=99999999999").at("remember") == most);
  for (const char* parameters : {"?triangles=700&remember=900", "?remember=900&triangles=700"}) {
    CHECK(hello(parameters).at("max_triangles") == 700);
    CHECK(hello(parameters).at("remember") == 900);
  }
}

TEST_CASE("a client's limit on triangles leaves room for their vertices", "[server]") {
  constexpr int kTriangles = 20;  // which do not touch
  const Folder folder;
  const std::string mesh = folder.File("loose.obj");
  std::string text;
  for (int i = 0; i < kTriangles; ++i) {
    const std::string x = std::to_string(3 * i);
    text += "v " + x + " 0 0\nv " + x + " 1 0\nv " + x + " 0 1\nf -3 -2 -1\n";
  }
  WriteText(mesh, text);
  RunOk({"ingest", mesh, folder.File("store.mtdb"), "--quiet"});
  const ServerProcess server(folder.File("store.mtdb"));
  RemoteSessionOptions options;
  options.max_triangles = kTriangles;
  options.remembered_vertices = 0;
  const auto session = OpenSession(server, options);
  CHECK(UpdateOk(*session, kFull).vertices == 3 * kTriangles);
}

TEST_CASE("a store's short name leaves what clients are told as it is", "[server]") {
  const Folder folder;
  std::filesystem::copy_file(SmallExample().store, folder.File("s"));
  const std::filesystem::path before = std::filesystem::current_path();
  std::filesystem::current_path(std::filesystem::path(folder.File("s")).parent_path());
  const auto server = std::make_unique<ServerProcess>("s");
  std::filesystem::current_path(before);
  CHECK_THAT(OpenSession(*server)->Update(R"({"normals": true})").status().message(),
             Catch::EndsWith("normals: a session's client makes them itself; leave it out"));
}

TEST_CASE("who may not open a session is told why, by HTTP", "[server]") {
  const ServerProcess& server = TheServer();
  const auto refused = [&](const std::string& target, const std::string& more, int status,
                           const std::string& code) {
    INFO(target << " " << more);
    RawConnection connection(server.port());
    connection.Send(UpgradeRequest(target, more));
    const HttpAnswer answer = connection.ReceiveAnswer();
    CHECK(answer.status == status);
    CHECK(answer.code() == code);
  };
  refused("/objects/nothing/session", "", 404, "no_such_object");
  refused("/objects//session", "", 404, "no_such_path");
  refused(kSession + "?remember=-1", "", 400, "bad_query");
  refused(kSession + "?colour=1", "", 400, "bad_query");
  refused(kSession + "?triangles=1", "", 400, "bad_query");
  refused(kSession, "Origin: http://elsewhere.example\r\n", 403, "foreign_origin");
  refused(kSession, "Origin: null\r\n", 403, "foreign_origin");
  refused(kSession, "Origin: https://localhost\r\n", 403, "foreign_origin");
  CHECK(server.Get(kSession).code() == "upgrade_required");
  const auto of_host = [&](const std::string& host) {
    std::string request = UpgradeRequest(kSession, "Origin: http://" + host + "\r\n");
    const std::string usual = "Host: localhost\r\n";
    request.replace(request.find(usual), usual.size(), "Host: " + host + "\r\n");
    RawConnection own(server.port());
    own.Send(request);
    return own.ReceiveAnswer(true).status;
  };
  CHECK(of_host("localhost") == 101);
  CHECK(of_host("localhost:8080") == 101);
  CHECK(of_host("127.0.0.1:8080") == 101);
  CHECK(of_host("[::1]:8080") == 101);
  // A name that somebody made mean this machine.
  CHECK(of_host("rebound.example:8080") == 403);
  const ServerProcess open(SmallExample().store, {"--allowed-origin", "http://a.example"});
  RawConnection page(open.port());
  page.Send(UpgradeRequest(kSession, "Origin: http://a.example\r\n"));
  CHECK(page.ReceiveAnswer(true).status == 101);
}

TEST_CASE("hostile frames end a session with a code, and no other", "[server]") {
  const ServerProcess& server = TheServer();
  const auto closed = [&](const std::string& bytes) {
    RawSession session(server.port(), kSession);
    REQUIRE(session.status() == 101);
    session.Send(bytes);
    return session.ReceiveClose();
  };
  CHECK(closed(TextFrame(std::string((1 << 20) + 1, ' '))) == 1009);
  CHECK(closed(FrameText(0x80 | kText, "", true).substr(0, 1) + "\xff\x7f\xff\xff\xff\xff\xff\xff" +
               "\xff" + "mask") == 1009);
  CHECK(closed(FrameText(0x80 | kBinary, "x")) == 1003);
  CHECK(closed(TextFrame("\xc3(")) == 1007);
  CHECK(closed(FrameText(0x80 | kText, "{}", false)) == 1002);
  CHECK(closed(FrameText(0x83, "{}")) == 1002);          // an unknown opcode
  CHECK(closed(FrameText(0xc0 | kText, "{}")) == 1002);  // compressed
  CHECK(closed(FrameText(0x80, "{}")) == 1002);          // goes on with nothing
  CHECK(closed(FrameText(kPing, "x")) == 1002);          // a ping in parts
  CHECK(closed(FrameText(0x80 | kPing, std::string(126, 'x'))) == 1002);

  RawSession session(server.port(), kSession);
  CHECK(session.ReceiveText().contains("hello"));
  const auto bad = [&](const std::string& text) {
    INFO(text.substr(0, 80));
    session.Send(TextFrame(text));
    const Json reply = session.ReceiveText();
    CHECK(reply.at("code") == "bad_message");
    return reply;
  };
  CHECK_FALSE(bad("").contains("id"));
  CHECK_FALSE(bad("[1, 2]").contains("id"));
  CHECK_FALSE(bad(std::string(100000, '[')).contains("id"));
  CHECK_FALSE(bad(R"({"query": {}})").contains("id"));
  CHECK_FALSE(bad(R"({"id": -1, "query": {}})").contains("id"));
  CHECK_FALSE(bad(R"({"id": 9007199254740992, "query": {}})").contains("id"));
  CHECK(bad(R"({"id": 5})").at("id") == 5);
  CHECK(bad(R"({"id": 5, "query": "full"})").at("id") == 5);
  CHECK(bad(R"({"id": 5, "query": {}, "file": "/etc/passwd"})").at("id") == 5);
  session.Send(FrameText(0x80 | kPing, "x"));
  CHECK(session.ReceiveFrame()->opcode == kPong);
  session.Send(TextFrame(QueryMessage(8, R"({"max_triangles": 900})")));
  CHECK(session.ReceiveText().at("id") == 8);

  std::mt19937 random(3);
  for (int i = 0; i < 60; ++i) {
    RawSession hostile(server.port(), kSession);
    std::string bytes = TextFrame(QueryMessage(1, R"({"max_triangles": 700})"));
    bytes += bytes;
    for (int k = 0; k < 3; ++k) bytes[random() % bytes.size()] = static_cast<char>(random());
    hostile.Send(bytes.substr(0, random() % bytes.size()));
    hostile.CloseSending();
    hostile.ReceiveAll();
  }
  session.Close();
  CHECK(server.Becomes("mtdb_sessions", 0));
  CHECK(server.errors().empty());
}

TEST_CASE("a client that goes away in the middle leaves nothing behind", "[server]") {
  const ServerProcess server(TheExample().store, {"--threads", "1"});
  {
    RawSession running(server.port(), kSession);
    running.Send(TextFrame(QueryMessage(1, SlowQuery())));
    REQUIRE(server.Reaches("mtdb_queries_running", 1));
    RawSession waiting(server.port(), kSession);
  }
  CHECK(server.Becomes("mtdb_queries_running", 0));
  CHECK(server.Becomes("mtdb_sessions", 0));
  CHECK(server.Becomes("mtdb_connections", 1));  // that which asks
  const auto session = OpenSession(server);
  CHECK(UpdateOk(*session, kFull).triangles == TheExample().info.at("triangles"));
}

TEST_CASE("a client that does not read is waited for, within bounds", "[server]") {
  const ServerProcess server(TheExample().store);
  RawSession deaf(server.port(), kSession, 4096);
  REQUIRE(deaf.status() == 101);
  const uint64_t resident = server.resident_bytes();
  constexpr int kQueries = 4000;
  int sent = 0;
  while (sent < kQueries && deaf.SendNow(TextFrame(QueryMessage(
                                static_cast<uint64_t>(sent), sent % 2 == 0 ? kFull : kCoarsest)))) {
    ++sent;
    if (sent % 2 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  // What is on its way comes to rest far from the end.
  double bytes = -1;
  ServerProcess::Await([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    return bytes == std::exchange(bytes, server.Metric("mtdb_session_stream_bytes_total"));
  });
  CHECK(bytes < 3 << 20);
  CHECK(server.Becomes("mtdb_queries_running", 0));
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // which keep what is freed
  CHECK(server.resident_bytes() < resident + (64 << 20));
#else
  CHECK(server.resident_bytes() + resident > 0);
#endif
  CHECK(server.Get("/healthz").status == 200);
  // When it reads again, each query has its answer.
  CHECK(deaf.ReceiveText().contains("hello"));
  std::set<int> answered;
  while (static_cast<int>(answered.size()) < sent) {
    const Json reply = deaf.ReceiveText();
    REQUIRE(reply.is_object());
    CHECK((reply.contains("done") || reply.contains("superseded")));
    CHECK(answered.insert(reply.at("id").get<int>()).second);
  }
}

TEST_CASE("clients of sessions that do nothing are dropped", "[server]") {
  const ServerProcess server(TheExample().store, {"--idle", "1", "--session-idle", "0.6"});
  RawSession deaf(server.port(), kSession, 4096);
  // Far more than the system takes.
  for (uint64_t id = 0; id < 200; ++id) {
    if (!deaf.SendNow(TextFrame(QueryMessage(id, id % 2 == 0 ? kFull : kCoarsest)))) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  // It reads, but does not answer the ping.
  RawSession silent(server.port(), kSession);
  CHECK(silent.ReceiveText().contains("hello"));
  bool pinged = false;
  while (const auto frame = silent.ReceiveFrame()) pinged = pinged || frame->opcode == kPing;
  CHECK(pinged);
  CHECK(server.Becomes("mtdb_sessions", 0));
}

TEST_CASE("an update that takes too long is given up, not the session", "[server]") {
  const ServerProcess server(TheExample().store, {"--timeout", "1"});
  const auto session = OpenSession(server);
  const auto update = session->Update(SlowQuery());
  CHECK(update.status().code() == StatusCode::kBusy);
  CHECK_THAT(update.status().message(), Catch::Contains("time"));
  CHECK(UpdateOk(*session, R"({"max_triangles": 900})").triangles <= 900);
}

TEST_CASE("a server that is told to stop ends its sessions", "[server]") {
  {
    ServerProcess server(TheExample().store);
    RawSession idle(server.port(), kSession);
    CHECK(idle.ReceiveText().contains("hello"));
    server.Signal(SIGTERM);
    CHECK(idle.ReceiveClose() == 1001);
    idle.Close();
    CHECK(server.Finish().exit_code == 0);
  }
  ServerProcess server(TheExample().store, {"--grace", "0.2"});
  RawSession running(server.port(), kSession);
  CHECK(running.ReceiveText().contains("hello"));
  running.Send(TextFrame(QueryMessage(4, SlowQuery())));
  REQUIRE(server.Reaches("mtdb_queries_running", 1));
  server.Signal(SIGTERM);
  const Json reply = running.ReceiveText();
  CHECK(reply.at("id") == 4);
  CHECK(reply.at("code") == "shutting_down");
  CHECK(running.ReceiveClose() == 1001);
  // It does not wait for the client's last word for long.
  CHECK(server.Finish().exit_code == 0);
  CHECK(server.errors().empty());
}

TEST_CASE("a server that stops tells of running queries only when there are any", "[server]") {
  ServerProcess server(TheExample().store, {"--grace", "0"});
  RawSession running(server.port(), kSession);
  CHECK(running.ReceiveText().contains("hello"));
  running.Send(TextFrame(QueryMessage(4, SlowQuery())));
  REQUIRE(server.Reaches("mtdb_queries_running", 1));
  server.Signal(SIGTERM);
  CHECK(running.ReceiveText().at("code") == "shutting_down");
  // The query is over. The server wakes when all the time is, too, and the client has not closed.
  server.Signal(SIGSTOP);
  std::this_thread::sleep_for(std::chrono::milliseconds(2500));
  server.Signal(SIGCONT);
  CHECK(server.Finish().exit_code == 0);
  CHECK(server.errors().empty());
}

TEST_CASE("a server that is told to stop takes no more queries", "[server]") {
  ServerProcess server(TheExample().store, {"--grace", "600"});
  RawSession running(server.port(), kSession);
  CHECK(running.ReceiveText().contains("hello"));
  running.Send(TextFrame(QueryMessage(4, SlowQuery())));
  REQUIRE(server.Reaches("mtdb_queries_running", 1));
  server.Signal(SIGTERM);
  REQUIRE(ServerProcess::Await([&] { return server.Get("/healthz").status == 0; }));
  running.Send(TextFrame(QueryMessage(5, kFull)));
  const Json refused = running.ReceiveText();
  CHECK(refused.at("id") == 5);
  CHECK(refused.at("code") == "shutting_down");
  server.Signal(SIGTERM);
  CHECK(running.ReceiveText().at("id") == 4);
  CHECK(running.ReceiveClose() == 1001);
  CHECK(server.Finish().exit_code == 0);
}

TEST_CASE("a client whose server is killed says so, or finds another", "[server]") {
  auto server = std::make_unique<ServerProcess>(SmallExample().store);
  const int port = server->port();
  const auto lost = OpenSession(*server);
  RemoteSessionOptions options;
  options.reconnect_seconds = 20;
  const auto patient = OpenSession(*server, options);
  UpdateOk(*lost, kFull);
  const RemoteUpdate before = UpdateOk(*patient, kFull);
  server->Signal(SIGKILL);
  CHECK(server->Finish().signal == SIGKILL);
  const auto update = lost->Update(kCoarsest);
  CHECK(update.status().code() == StatusCode::kIoError);
  CHECK_THAT(update.status().message(), Catch::Contains("127.0.0.1:" + std::to_string(port)) &&
                                            Catch::Contains("the server closed the connection"));
  CHECK_FALSE(lost->connected());
  CHECK(lost->mesh().triangle_count() == before.triangles);
  CHECK_THAT(RemoteSession::Open(server->url()).status().message(),
             Catch::Contains("cannot connect"));

  server = std::make_unique<ServerProcess>(SmallExample().store, Arguments{}, port);
  const RemoteUpdate after = UpdateOk(*patient, kFull);
  CHECK(after.restarted);
  CHECK(after.triangles == before.triangles);
  CHECK_FALSE(UpdateOk(*patient, kCoarsest).restarted);
}

TEST_CASE("an object that is replaced is gone from its sessions", "[server]") {
  const Folder folder;
  const std::string store = folder.File("store.mtdb");
  const std::string mesh = folder.File("terrain.ply");
  std::filesystem::copy_file(SmallExample().store, store);
  const ServerProcess server(store);
  const auto session = OpenSession(server);
  RunOk({"remove", store, "sculpture"});
  RunOk({"generate", "terrain", mesh, "--triangles", "4000"});
  RunOk({"ingest", mesh, store, "--quiet"});
  const auto update = session->Update(kFull);
  CHECK(update.status().code() == StatusCode::kNotFound);
  CHECK(session->connected());
}

// Passes a connection on to `port`; of the server's first `bytes` bytes it changes that at `flip`,
// then it closes.
class Tamperer {
 public:
  Tamperer(int port, size_t bytes, size_t flip) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    REQUIRE(::bind(socket_, reinterpret_cast<sockaddr*>(&address), size) == 0);
    REQUIRE(::listen(socket_, 1) == 0);
    REQUIRE(::getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size) == 0);
    port_ = ntohs(address.sin_port);
    thread_ = std::thread([this, port, bytes, flip] { Pass(port, bytes, flip); });
  }
  ~Tamperer() {
    thread_.join();
    ::close(socket_);
  }
  std::string url() const {
    return "http://127.0.0.1:" + std::to_string(port_) + "/objects/sculpture";
  }

 private:
  void Pass(int port, size_t bytes, size_t flip) const {
    const int client = ::accept(socket_, nullptr, nullptr);
    const int server = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    char block[4096];
    size_t passed = 0;
    bool open = ::connect(server, reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0;
    while (open && passed < bytes) {
      pollfd entries[2] = {{client, POLLIN, 0}, {server, POLLIN, 0}};
      if (::poll(entries, 2, kSocketTimeoutMs) <= 0) break;
      if (entries[0].revents != 0) {
        const ssize_t n = ::recv(client, block, sizeof(block), 0);
        open = n > 0 && ::send(server, block, static_cast<size_t>(n), MSG_NOSIGNAL) == n;
      }
      if (entries[1].revents != 0) {
        const ssize_t n = ::recv(server, block, std::min(sizeof(block), bytes - passed), 0);
        if (n > 0 && flip >= passed && flip < passed + static_cast<size_t>(n)) {
          block[flip - passed] = static_cast<char>(block[flip - passed] ^ 0x24);
        }
        passed += n > 0 ? static_cast<size_t>(n) : 0;
        open = open && n > 0 && ::send(client, block, static_cast<size_t>(n), MSG_NOSIGNAL) == n;
      }
    }
    ::close(server);
    ::close(client);
  }
  int socket_;
  int port_ = 0;
  std::thread thread_;
};

TEST_CASE("a client is not taken in by a stream that is broken", "[server]") {
  const ServerProcess server(SmallExample().store);
  std::mt19937 random(11);
  constexpr size_t kAll = 6000;  // handshake, hello, base mesh and a part of the updates
  int refused = 0;
  for (int i = 0; i < 120; ++i) {
    const size_t bytes = i % 2 == 0 ? random() % kAll : kAll;
    const Tamperer tamperer(server.port(), bytes, i % 2 == 0 ? kAll : random() % kAll);
    RemoteSessionOptions options;
    options.timeout_seconds = 20;
    const auto session = RemoteSession::Open(tamperer.url(), options);
    if (!session.ok()) {
      CHECK_FALSE(session.status().message().empty());
      ++refused;
      continue;
    }
    const auto update = (*session)->Update(kFull);
    if (!update.ok()) ++refused;
    CHECK(testing::ClientMeshFault((*session)->mesh()).empty());
  }
  CHECK(refused == 120);
  CHECK(server.Becomes("mtdb_sessions", 0));
}

}  // namespace
}  // namespace mtdb::test
