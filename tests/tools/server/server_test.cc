// SPDX-License-Identifier: Apache-2.0
// The server as clients meet it: right answers, wrong requests, limits, hostile bytes, many
// clients, clients that go away, shutdown.
#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <cmath>
#include <future>
#include <random>
#include <sys/resource.h>

#include "tests/tools/http_testing.h"

namespace mtdb::test {
namespace {

constexpr const char* kObject = "/objects/sculpture";
const std::string kMesh = std::string(kObject) + "/mesh";

// One server for all tests that leave it as it is.
const ServerProcess& TheServer() {
  static const ServerProcess kServer(TheExample().store);
  return kServer;
}

// What extract writes.
std::string Extracted(const std::string& store, Arguments options,
                      const std::string& extension = ".ply") {
  const Folder folder;
  const std::string output = folder.File("cut" + extension);
  options.insert(options.begin(), {"extract", store, output});
  RunOk(options);
  return ReadText(output);
}

void CheckHidesPaths(const HttpAnswer& answer, const Example& example) {
  const std::string folder = std::filesystem::path(example.store).parent_path();
  CHECK(answer.body.find(folder) == std::string::npos);
  CHECK(answer.body.find("/tmp") == std::string::npos);
}

TEST_CASE("the server tells what it has as info and list do", "[server]") {
  const ServerProcess& server = TheServer();
  const HttpAnswer catalog = server.Get("/objects");
  CHECK(catalog.status == 200);
  CHECK(catalog.header("Content-Type") == "application/json");
  CHECK(catalog.json().at("objects") == RunJson({"list", TheExample().store}).at("objects"));
  const HttpAnswer info = server.Get(kObject);
  CHECK(info.status == 200);
  CHECK(info.json() == TheExample().info);
  CHECK(server.Get("/healthz").json() == Json{{"status", "ok"}});
  const HttpAnswer head = server.Ask("HEAD", kObject);
  CHECK(head.status == 200);
  CHECK(head.header("Content-Length") == info.header("Content-Length"));
}

TEST_CASE("a mesh is byte for byte what extract writes, by parameters and by JSON", "[server]") {
  const ServerProcess& server = TheServer();
  const std::string& store = TheExample().store;
  const std::string coarse = Extracted(store, {"--error", "0.2%"});
  const HttpAnswer answer = server.Get(kMesh + "?error=0.2%25");
  CHECK(answer.status == 200);
  CHECK(answer.body == coarse);
  const Folder folder;
  const Json stats = RunJson({"extract", store, folder.File("x.ply"), "--error", "0.2%"});
  CHECK(answer.header("X-Mtdb-Triangles") == std::to_string(stats.at("triangles").get<int>()));
  CHECK(answer.header("X-Mtdb-Vertices") == std::to_string(stats.at("vertices").get<int>()));
  CHECK(std::stod(answer.header("X-Mtdb-Error-Bound")) == stats.at("error_bound"));
  CHECK(answer.header("X-Mtdb-Limit") == "accuracy");
  const std::string query = R"({"threshold": {"relative": 0.002}})";
  CHECK(server.Ask("POST", kMesh, query).body == coarse);
  CHECK(server.Ask("POST", kMesh + "?format=ply", query).body == coarse);
  CHECK(server.Ask("POST", kMesh + "?error=0.2%25").body == coarse);
  CHECK(server.Get(kMesh).body == ReadText(TheExample().full));
  CHECK(server.Get(kMesh + "?sphere=0,0,1,0.5&clip&normals&triangles=3000").body ==
        Extracted(store, {"--sphere", "0,0,1,0.5", "--clip", "--normals", "--triangles", "3000"}));
  const HttpAnswer head = server.Ask("HEAD", kMesh + "?error=0.2%25");
  CHECK(head.header("Content-Length") == std::to_string(coarse.size()));
  CHECK(server.temporary_files() == 0);
}

TEST_CASE("the server sends every format", "[server]") {
  for (const std::string format : {"ply", "obj", "stl", "off", "glb", "drc"}) {
    INFO(format);
    const HttpAnswer answer = TheServer().Get(kMesh + "?error=1%25&format=" + format);
    CHECK(answer.status == 200);
    CHECK(answer.body == Extracted(TheExample().store, {"--error", "1%"}, "." + format));
  }
}

TEST_CASE("requests that cannot be served get a status and a reason", "[server]") {
  const ServerProcess& server = TheServer();
  const auto refused = [&](int status, const std::string& code, const std::string& words,
                           const std::string& method, const std::string& target,
                           const std::string& body = "") {
    INFO(method << " " << target);
    const HttpAnswer answer = server.Ask(method, target, body);
    CHECK(answer.status == status);
    REQUIRE(answer.header("Content-Type") == "application/json");
    CHECK(answer.code() == code);
    CHECK_THAT(answer.error(), Catch::Contains(words));
    CheckHidesPaths(answer, TheExample());
  };
  refused(400, "bad_query", "error: expected a number", "GET", kMesh + "?error=x");
  refused(400, "bad_query", "colour: no such parameter", "GET", kMesh + "?colour=red");
  refused(400, "bad_query", "format: expected ply", "GET", kMesh + "?format=../../x");
  refused(400, "bad_query", "query: no key \"file\"", "POST", kMesh, R"({"file": "/etc/passwd"})");
  refused(400, "bad_query", "region.sphere.radius: expected", "POST", kMesh,
          R"({"region": {"sphere": {"centre": [0, 0, 0], "radius": -1}}})");
  refused(400, "bad_query", "body: byte 1: not JSON", "POST", kMesh, "mesh, please");
  refused(400, "bad_query", "the body holds the query", "POST", kMesh + "?error=1", "{}");
  refused(400, "bad_query", "query: no such parameter", "GET", kMesh + "?query=/etc/passwd");
  refused(404, "no_such_object", "no object 'nothing'", "GET", "/objects/nothing");
  refused(404, "no_such_object", "no object 'nothing'", "GET", "/objects/nothing/mesh");
  refused(404, "no_such_object", "no object '../../etc'", "GET", "/objects/..%2F..%2Fetc/mesh");
  for (const char* path : {"//", "/etc/passwd", "/objects/", "/objects/sculpture/mesh/x",
                           "/objects/sculpture/ply", "/../../etc/passwd", "/healthz/x"}) {
    refused(404, "no_such_path", "/objects/NAME/mesh", "GET", path);
  }
  refused(400, "bad_request", "hexadecimal", "GET", "/objects/%zz");
  refused(405, "method_not_allowed", "GET or HEAD", "POST", "/objects");
  refused(405, "method_not_allowed", "GET or HEAD", "DELETE", kObject);
  refused(405, "method_not_allowed", "POST", "PUT", kMesh, "{}");
  CHECK(server.Ask("DELETE", kMesh).header("Allow") == "GET, HEAD, POST");
}

TEST_CASE("a name that is made to mean this machine does not open the server", "[server]") {
  const auto status = [](const ServerProcess& server, const std::string& host,
                         const std::string& target) {
    RawConnection connection(server.port());
    connection.Send("GET " + target + " HTTP/1.1\r\n" + host + "\r\n");
    const HttpAnswer answer = connection.ReceiveAnswer();
    if (answer.status == 403) CHECK(answer.code() == "foreign_host");
    return answer.status;
  };
  for (const std::string target : {"/objects", "/healthz", "/metrics", "/nothing"}) {
    CHECK(status(TheServer(), "Host: rebound.example\r\n", target) == 403);
  }
  const auto of = [&](const ServerProcess& server, const std::string& host) {
    return status(server, "Host: " + host + "\r\n", "/healthz");
  };
  for (const std::string host : {"127.0.0.1", "127.0.0.1:8080", "[::1]:80", "localhost",
                                 "LocalHost:8080", "192.168.1.7:99"}) {
    CHECK(of(TheServer(), host) == 200);
  }
  for (const std::string host : {"rebound.example", "localhost.rebound.example:80", "127.0.0.1.x",
                                 "x@127.0.0.1", "[::1", ":80", "localhost:x", "1.2.3.4.5"}) {
    CHECK(of(TheServer(), host) == 403);
  }
  // Programs of the past, and no browser.
  CHECK(status(TheServer(), "", "/healthz") == 200);
  const ServerProcess named(SmallExample().store,
                            {"--allowed-host", "scans.example", "--allowed-host", "b.example"});
  CHECK(of(named, "Scans.Example:8080") == 200);
  CHECK(of(named, "b.example") == 200);
  CHECK(of(named, "x.scans.example") == 403);
  const ServerProcess open(SmallExample().store, {"--allowed-host", "*"});
  CHECK(of(open, "any.example") == 200);
}

TEST_CASE("requests beyond the limits are refused before they are read", "[server]") {
  const ServerProcess& server = TheServer();
  const auto sent = [&](const std::string& text) {
    RawConnection connection(server.port());
    connection.Send(text);
    const HttpAnswer answer = connection.ReceiveAnswer();
    CHECK(connection.ReceiveAll().empty());
    return answer;
  };
  CHECK(sent(RequestText("POST", kMesh, std::string(2 << 20, 'x'))).code() == "body_too_large");
  const std::string chunk = "10000\r\n" + std::string(0x10000, 'x') + "\r\n";
  std::string chunks = RequestText("POST", kMesh, "", "Transfer-Encoding: chunked\r\n");
  for (int i = 0; i < 20; ++i) chunks += chunk;
  CHECK(sent(chunks).status == 413);
  CHECK(sent(RequestText("POST", kMesh, "", "Content-Length: 18446744073709551615\r\n")).status ==
        413);
  CHECK(sent(RequestText("GET", "/" + std::string(20000, 'x'))).status == 431);
  CHECK(sent(RequestText("GET", "/", "", "X: " + std::string(20000, 'x') + "\r\n")).code() ==
        "header_too_large");
  CHECK(sent("HELLO\r\n\r\n").code() == "bad_request");

  const ServerProcess small(TheExample().store, {"--max-triangles", "1000"});
  const HttpAnswer answer = small.Get(kMesh);
  CHECK(answer.status == 400);
  CHECK_THAT(answer.error(), Catch::Contains("at most 1000"));
  CHECK(small.Get(kMesh + "?triangles=900").status == 200);
  CHECK(small.temporary_files() == 0);
}

TEST_CASE("a request that two programs may read differently is refused", "[server]") {
  const auto status = [](const std::string& method, const std::string& headers,
                         const std::string& body) {
    RawConnection connection(TheServer().port());
    connection.Send(method + " /objects/sculpture/mesh HTTP/1.1\r\n" + headers + "\r\n" + body);
    return connection.ReceiveAnswer(false).status;
  };
  const std::string host = "Host: localhost\r\n", chunks = "2\r\n{}\r\n0\r\n\r\n";
  CHECK(status("GET", host + host, "") == 400);
  CHECK(status("GET", host + "HOST: evil.example\r\n", "") == 400);
  for (const std::string coding :
       {"gzip", "identity", "chunked, gzip", "gzip, chunked", "chunked, chunked", "xchunked", ""}) {
    INFO(coding);
    CHECK(status("POST", host + "Transfer-Encoding: " + coding + "\r\n", chunks) == 400);
  }
  CHECK(status("POST", host + "Transfer-Encoding: chunked\r\nTransfer-Encoding: chunked\r\n",
               chunks) == 400);
  CHECK(status("POST", host + "Transfer-Encoding: chunked\r\nContent-Length: 2\r\n", chunks) ==
        400);
  CHECK(status("POST", host + "Content-Length: 2\r\nContent-Length: 2\r\n", "{}") == 400);
  CHECK(status("POST", host + "Transfer-Encoding: CHUNKED\r\n", chunks) == 200);
  CHECK(TheServer().Get("/healthz").status == 200);
}

TEST_CASE("a connection serves many requests, also when they come at once or in bytes",
          "[server]") {
  const ServerProcess& server = TheServer();
  RawConnection connection(server.port());
  const std::string body = R"({"max_triangles": 500})";
  const std::string text = RequestText("GET", "/healthz") + RequestText("POST", kMesh, body) +
                           RequestText("GET", "/nothing") + RequestText("GET", kObject);
  for (const bool whole : {true, false}) {
    const size_t step = whole ? text.size() : 1;
    for (size_t i = 0; i < text.size(); i += step) connection.Send(text.substr(i, step));
    CHECK(connection.ReceiveAnswer().status == 200);
    CHECK(connection.ReceiveAnswer().body == Extracted(TheExample().store, {"--triangles", "500"}));
    CHECK(connection.ReceiveAnswer().status == 404);
    CHECK(connection.ReceiveAnswer().json() == TheExample().info);
  }
  connection.Send(RequestText("POST", kMesh, "", "Expect: 100-continue\r\nContent-Length: 2\r\n"));
  CHECK(connection.ReceiveAnswer().status == 100);
  connection.Send("{}");
  CHECK(connection.ReceiveAnswer().status == 200);
  connection.Send(RequestText("GET", "/healthz", "", "Connection: close\r\n"));
  CHECK(connection.ReceiveAnswer().header("Connection") == "close");
  CHECK(connection.ReceiveAll().empty());
}

TEST_CASE("truncated requests and random bytes harm nobody", "[server]") {
  const ServerProcess server(SmallExample().store);
  const std::string text = RequestText("POST", kMesh + "?format=ply", R"({"max_triangles": 50})");
  for (size_t size = 0; size < text.size(); size += 3) {
    RawConnection connection(server.port());
    connection.Send(text.substr(0, size));
    connection.CloseSending();
    const std::string answer = connection.ReceiveAll();
    INFO(answer);
    CHECK((answer.empty() || answer.starts_with("HTTP/1.1 4")));
  }
  std::mt19937 random(7);
  for (int i = 0; i < 150; ++i) {
    std::string bytes = text;
    if (i % 2 == 0) {
      bytes.resize(1 + random() % 2000);
      for (char& c : bytes) c = static_cast<char>(random());
    } else {
      for (int k = 0; k < 3; ++k) bytes[random() % bytes.size()] = static_cast<char>(random());
    }
    RawConnection connection(server.port());
    connection.Send(bytes + "\r\n\r\n");
    connection.CloseSending();
    const std::string answer = connection.ReceiveAll();
    CHECK((answer.empty() || answer.starts_with("HTTP/1.1 ")));
  }
  CHECK(server.Get("/healthz").status == 200);
  CHECK(server.Metric("mtdb_requests_in_flight") == 1);
  CHECK(server.errors().empty());
}

TEST_CASE("many clients at once share an object's cache", "[server]") {
  constexpr int kClients = 120;
  const Example& example = TheExample();
  const ServerProcess server(example.store);
  const std::string coarse = Extracted(example.store, {"--error", "0.5%"});
  const std::string part = Extracted(example.store, {"--sphere", "0,0,1,0.4"});
  std::atomic<int> right{0};
  std::vector<std::thread> clients;
  for (int i = 0; i < kClients; ++i) {
    clients.emplace_back([&, i] {
      RawConnection connection(server.port());
      for (int k = 0; k < 2; ++k) {
        const bool first = (i + k) % 2 == 0;
        connection.Send(
            RequestText("GET", kMesh + (first ? "?error=0.5%25" : "?sphere=0,0,1,0.4")));
        if (connection.ReceiveAnswer().body == (first ? coarse : part)) ++right;
      }
    });
  }
  for (std::thread& client : clients) client.join();
  CHECK(right == 2 * kClients);
  CHECK(server.Metric("mtdb_queries_total") == 2 * kClients);
  CHECK(server.Metric("mtdb_objects_open") == 1);
  CHECK(server.Metric("mtdb_requests_total{code=\"200\"}") >= 2 * kClients);
  // Each was decoded once.
  const double units =
      example.info.at("clusters").get<double>() + example.info.at("root_pieces").get<double>();
  CHECK(server.Metric("mtdb_cache_decodes_total") <= units);
  CHECK(server.Metric("mtdb_cache_hits_total") > kClients);
  CHECK(server.Metric("mtdb_cache_bytes") > 0);
  CHECK(server.temporary_files() == 0);
}

TEST_CASE("connections above the limit are told to come again", "[server]") {
  const ServerProcess server(SmallExample().store, {"--max-connections", "2"});
  RawConnection first(server.port());
  auto second = std::make_unique<RawConnection>(server.port());
  for (RawConnection* connection : {&first, second.get()}) {
    connection->Send(RequestText("GET", "/healthz"));
    CHECK(connection->ReceiveAnswer().status == 200);
  }
  const HttpAnswer refused = server.Get("/healthz");
  CHECK(refused.status == 503);
  CHECK(refused.code() == "too_many_connections");
  CHECK(refused.header("Retry-After") == "1");
  second.reset();
  int status = 503;
  for (int i = 0; i < 1000 && status == 503; ++i) status = server.Get("/healthz").status;
  CHECK(status == 200);
}

TEST_CASE("a client that goes away takes its query with it", "[server]") {
  const ServerProcess server(TheExample().store, {"--threads", "1"});
  {
    RawConnection running(server.port());
    running.Send(RequestText("POST", kMesh, SlowQuery()));
    REQUIRE(server.Reaches("mtdb_queries_running", 1));
    RawConnection waiting(server.port());
    waiting.Send(RequestText("GET", kMesh));
    REQUIRE(server.Reaches("mtdb_queries_waiting", 1));
    CHECK(server.Metric("mtdb_queries_cancelled_total") == 0);
  }
  CHECK(server.Reaches("mtdb_queries_cancelled_total", 2));
  CHECK(server.Reaches("mtdb_requests_total{code=\"499\"}", 2));
  CHECK(server.Get(kMesh).status == 200);
  CHECK(server.Metric("mtdb_queries_running") == 0);
  CHECK(server.temporary_files() == 0);
}

TEST_CASE("a request that takes too long is given up", "[server]") {
  const ServerProcess server(TheExample().store, {"--timeout", "0.2"});
  const HttpAnswer answer = server.Ask("POST", kMesh, SlowQuery());
  CHECK(answer.status == 503);
  CHECK(answer.code() == "timeout");
  CHECK(server.Metric("mtdb_queries_cancelled_total") == 1);
}

TEST_CASE("clients that do not read or do not write are dropped, others are served", "[server]") {
  const ServerProcess server(TheExample().store, {"--idle", "0.3"});
  RawConnection deaf(server.port(), 4096);
  // Several answers, more than the system buffers.
  std::string requests;
  for (int i = 0; i < 12; ++i) requests += RequestText("GET", kMesh + "?format=obj");
  deaf.Send(requests);
  RawConnection mute(server.port());
  mute.Send("GET /healthz HT");
  RawConnection silent(server.port());
  CHECK(server.Get(kMesh + "?triangles=500").status == 200);
  CHECK(mute.ReceiveAll().empty());
  CHECK(silent.ReceiveAll().empty());
  CHECK(server.Reaches("mtdb_requests_total{code=\"408\"}", 1));
  CHECK(server.Reaches("mtdb_requests_total{code=\"503\"}", 1));
  CHECK(server.temporary_files() == 0);
}

TEST_CASE("objects come, change and go while the server runs", "[server]") {
  const Folder folder;
  const std::string store = folder.File("store.mtdb");
  const std::string mesh = folder.File("terrain.ply");
  std::filesystem::copy_file(SmallExample().store, store);
  const ServerProcess server(store, {"--max-objects", "1"});
  CHECK(server.Get("/objects/hill").status == 404);
  for (const char* triangles : {"500", "900"}) {
    RunOk({"generate", "terrain", mesh, "--triangles", triangles});
    RunOk({"ingest", mesh, store, "--name", "hill", "--quiet", "--replace"});
    CHECK(server.Get("/objects").json().at("objects").size() == 2);
    CHECK(server.Get("/objects/hill/mesh").body == Extracted(store, {"--name", "hill"}));
  }
  CHECK(server.Get(kMesh).body == Extracted(store, {"--name", "sculpture"}));
  CHECK(server.Metric("mtdb_objects_open") == 1);
  RunOk({"remove", store, "hill"});
  CHECK(server.Get("/objects/hill/mesh").code() == "no_such_object");
  CHECK(server.Get("/objects").json().at("objects").size() == 1);
}

TEST_CASE("a damaged store is an error that tells clients no more than that", "[server]") {
  const Folder folder;
  const std::string store = folder.File("store.mtdb");
  std::filesystem::copy_file(SmallExample().store, store);
  const ServerProcess server(store);
  std::string bytes = ReadText(store);
  for (size_t i = 16384; i < bytes.size(); i += 64) bytes[i] = static_cast<char>(bytes[i] ^ 0x55);
  std::fstream(store, std::ios::in | std::ios::out | std::ios::binary) << bytes;
  const HttpAnswer answer = server.Get(kMesh);
  CHECK(answer.status == 500);
  CHECK(answer.code() == "store_error");
  CHECK(answer.body.find(store) == std::string::npos);
  CHECK_THAT(server.errors(), Catch::Contains(store));
  CHECK(server.Get("/healthz").status == 200);
}

// As cp does it: the file is emptied, then filled from the front.
void CopyOver(const std::string& bytes, const std::string& path) {
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  for (size_t at = 0; at < bytes.size(); at += 1 << 16) {
    out.write(bytes.data() + at,
              static_cast<std::streamsize>(std::min(bytes.size() - at, size_t{1} << 16)));
    out.flush();
  }
}

TEST_CASE("a store that is written over or cut off while it is served harms no server",
          "[server]") {
  const Folder folder;
  const std::string store = folder.File("store.mtdb");
  const std::string other = folder.File("other.mtdb");
  for (const auto& [path, seed] : {std::pair{store, "1"}, std::pair{other, "2"}}) {
    const std::string mesh = folder.File("mesh.ply");
    RunOk({"generate", "sculpture", mesh, "--triangles", "20000", "--seed", seed});
    RunOk({"ingest", mesh, path, "--name", "x", "--quiet"});
  }
  const std::array files{ReadText(store), ReadText(other)};
  // A cache of 1 MB holds little: clusters are read again and again.
  const ServerProcess server(store, {"--cache", "1M"});
  const std::string target = "/objects/x/mesh?format=ply";
  const HttpAnswer first = server.Get(target);
  REQUIRE(first.status == 200);
  CopyOver(files[1], store);
  HttpAnswer second = server.Get(target);
  for (int i = 0; i < 10 && second.status != 200; ++i) second = server.Get(target);
  REQUIRE(second.status == 200);
  REQUIRE(second.body != first.body);
  std::atomic<bool> done = false;
  std::atomic<int> wrong = 0;
  std::atomic<int> good = 0;
  std::thread client([&] {
    while (!done) {
      const HttpAnswer answer = server.Get(target);
      if (answer.status == 200) {
        ++good;
        if (answer.body != first.body && answer.body != second.body) ++wrong;
      } else if (answer.status < 400) {
        ++wrong;  // no answer: the server is gone
      }
    }
  });
  std::mt19937_64 random(3);
  for (int round = 0; round < 40; ++round) {
    const auto wait = [&] {
      std::this_thread::sleep_for(std::chrono::microseconds(random() % 20000));
    };
    CopyOver(files[static_cast<size_t>(round % 2)], store);
    wait();
    std::filesystem::resize_file(store, random() % files[0].size());
    wait();
  }
  CopyOver(files[0], store);
  done = true;
  client.join();
  CHECK(wrong == 0);
  HttpAnswer last = server.Get(target);
  for (int i = 0; i < 10 && last.status != 200; ++i) last = server.Get(target);
  CHECK(last.status == 200);
  CHECK(last.body == first.body);
}

TEST_CASE("a packed file that is replaced or written over while it is served is served anew",
          "[server]") {
  const Folder folder;
  const std::string packed = folder.File("served.mtdbp");
  std::array<std::string, 2> files, meshes;
  for (const size_t i : {size_t{0}, size_t{1}}) {
    const std::string mesh = folder.File("mesh.ply"), store = folder.File("store.mtdb");
    RunOk({"generate", "sculpture", mesh, "--triangles", "3000", "--seed", std::to_string(i)});
    RunOk({"ingest", mesh, store, "--name", "x", "--quiet", "--replace"});
    RunOk({"pack", store, packed});
    files[i] = ReadText(packed);
    meshes[i] = Extracted(store, {});
  }
  const std::string target = "/objects/x/mesh";
  const ServerProcess server(packed);
  CHECK(server.Get(target).body == meshes[1]);
  for (const size_t i : {size_t{0}, size_t{1}, size_t{1}, size_t{0}}) {
    const std::string next = folder.File("next.mtdbp");
    WriteText(next, files[i]);
    std::filesystem::rename(next, packed);
    CHECK(server.Get(target).body == meshes[i]);
    CopyOver(files[1 - i], packed);
    CHECK(server.Get(target).body == meshes[1 - i]);
  }
  std::filesystem::remove(packed);  // what is open is served on
  CHECK(server.Get(target).body == meshes[1]);
}

TEST_CASE("a server that is told to stop finishes what runs", "[server]") {
  ServerProcess server(TheExample().store);
  RawConnection idle(server.port());
  RawConnection client(server.port());
  client.Send(RequestText("GET", kMesh));
  REQUIRE(server.Reaches("mtdb_queries_total", 1));
  const std::string tmp = server.TmpFolder();
  std::future<HttpAnswer> answer =
      std::async(std::launch::async, [&] { return client.ReceiveAnswer(); });
  CHECK(server.Stop().exit_code == 0);
  CHECK(answer.get().body == ReadText(TheExample().full));
  CHECK(idle.ReceiveAll().empty());
  CHECK(std::filesystem::is_empty(tmp));
  CHECK(server.errors().empty());
}

TEST_CASE("a server that is told to stop cancels what does not end", "[server]") {
  for (const bool twice : {false, true}) {
    ServerProcess server(TheExample().store, {"--grace", twice ? "1000" : "0.2"});
    RawConnection client(server.port());
    client.Send(RequestText("POST", kMesh, SlowQuery()));
    REQUIRE(server.Reaches("mtdb_queries_running", 1));
    server.Signal(SIGINT);
    if (twice) {
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
      server.Signal(SIGTERM);
    }
    CHECK(client.ReceiveAnswer().code() == "shutting_down");
    CHECK(server.Finish().exit_code == 0);
  }
}

TEST_CASE("serve says what is wrong with where it should listen", "[server]") {
  const std::string& store = SmallExample().store;
  RunFails(1, {"serve", store, "--listen", "127.0.0.1:" + std::to_string(TheServer().port())},
           {"cannot listen", "--listen"});
  RunFails(1, {"serve", "/nowhere/x.mtdb"}, {"/nowhere/x.mtdb"});
  RunFails(1, {"serve", store, "--listen", "0", "--tmp", "/nowhere"}, {"/nowhere", "--tmp"});
  for (const char* wrong : {"", "x", "localhost", "1.2.3:80", "127.0.0.1:70000", "::1:80"}) {
    RunFails(2, {"serve", store, std::string("--listen=") + wrong}, {"--listen"});
  }
  RunFails(2, {"serve", store, "--threads", "0"}, {"--threads"});
}

}  // namespace
}  // namespace mtdb::test
