// SPDX-License-Identifier: Apache-2.0
// mtdb fetch, against `mtdb serve` and against servers that misbehave.
#include <catch2/catch.hpp>

#include "tests/tools/http_testing.h"

namespace mtdb::test {
namespace {

// Answers one connection with `answer`, whatever it is asked, and closes it.
class WrongServer {
 public:
  explicit WrongServer(std::string answer) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    REQUIRE(::bind(socket_, reinterpret_cast<sockaddr*>(&address), size) == 0);
    REQUIRE(::listen(socket_, 1) == 0);
    REQUIRE(::getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size) == 0);
    port_ = ntohs(address.sin_port);
    thread_ = std::thread([this, text = std::move(answer)] {
      const int client = ::accept(socket_, nullptr, nullptr);
      char block[4096];
      (void)::recv(client, block, sizeof(block), 0);
      (void)::send(client, text.data(), text.size(), MSG_NOSIGNAL);
      ::shutdown(client, SHUT_WR);
      while (::recv(client, block, sizeof(block), 0) > 0) {
      }
      ::close(client);
    });
  }
  ~WrongServer() {
    thread_.join();
    ::close(socket_);
  }
  std::string url() const { return "http://127.0.0.1:" + std::to_string(port_); }

 private:
  int socket_;
  int port_ = 0;
  std::thread thread_;
};

TEST_CASE("fetch writes what extract writes where the region meets nothing", "[cli]") {
  const ServerProcess server(SmallExample().store);
  const Folder folder;
  for (const std::string format : {"ply", "obj", "stl", "off", "glb"}) {
    const std::string fetched = folder.File("fetched." + format);
    const std::string extracted = folder.File("extracted." + format);
    const Arguments query{"--sphere", "1000,1000,1000,1", "--clip"};
    Arguments fetch{"fetch", server.url(), fetched};
    Arguments extract{"extract", SmallExample().store, extracted};
    fetch.insert(fetch.end(), query.begin(), query.end());
    extract.insert(extract.end(), query.begin(), query.end());
    CAPTURE(format);
    CHECK(RunJson(fetch).at("triangles") == 0);
    RunOk(extract);
    REQUIRE(Exists(fetched));
    CHECK(ReadText(fetched) == ReadText(extracted));
  }
}

TEST_CASE("fetch writes what extract writes", "[cli]") {
  const ServerProcess server(TheExample().store);
  const Folder folder;
  const std::string fetched = folder.File("fetched");
  const std::string extracted = folder.File("extracted");
  const std::vector<Arguments> queries{
      {},
      {"--error", "0.4%", "--normals"},
      {"--sphere", "0,0,1,0.5", "--clip", "--error", "0.1%"},
      {"--pixels", "2", "--frustum", "--eye", "0,-5,1", "--target", "0,0,0"}};
  for (const Arguments& query : queries) {
    Arguments fetch{"fetch", server.url() + "/objects/sculpture", fetched + ".ply"};
    Arguments extract{"extract", TheExample().store, extracted + ".ply"};
    fetch.insert(fetch.end(), query.begin(), query.end());
    extract.insert(extract.end(), query.begin(), query.end());
    const Json got = RunJson(fetch);
    const Json expected = RunJson(extract);
    CHECK(ReadText(fetched + ".ply") == ReadText(extracted + ".ply"));
    for (const char* key :
         {"triangles", "vertices", "active_triangles", "error_bound", "limit", "clusters_total"}) {
      INFO(key);
      CHECK(got.at(key) == expected.at(key));
    }
    CHECK(got.at("bytes_received") == std::filesystem::file_size(fetched + ".ply"));
  }
  for (const std::string extension : {".obj", ".stl", ".off", ".glb", ".drc"}) {
    RunOk({"fetch", server.url(), fetched + extension, "--triangles", "2000"});
    RunOk({"extract", TheExample().store, extracted + extension, "--triangles", "2000"});
    CHECK(ReadText(fetched + extension) == ReadText(extracted + extension));
  }
  CHECK_THAT(RunOk({"fetch", server.url(), fetched + ".ply", "--name", "sculpture"}),
             Catch::Contains("triangles") && Catch::Contains("received"));
  CHECK(RunOk({"fetch", server.url(), fetched + ".ply", "--error", "2", "--print-query"}) ==
        RunOk({"extract", "x", fetched + ".ply", "--error", "2", "--print-query"}));
}

TEST_CASE("fetch tells what a server said, and leaves no file", "[cli]") {
  const ServerProcess server(SmallExample().store, {"--max-triangles", "1000"});
  const Folder folder;
  const std::string out = folder.File("out.ply");
  RunFails(1, {"fetch", server.url() + "/objects/nothing", out}, {"404", "no object 'nothing'"});
  RunFails(1, {"fetch", server.url(), out, "--name", "a/b"}, {"404", "no object 'a/b'"});
  RunFails(1, {"fetch", server.url(), out}, {"400", "at most 1000"});
  RunFails(2, {"fetch", server.url() + "/x", out}, {"/objects/NAME"});
  RunFails(1, {"fetch", server.url() + "/objects/a", out, "--name", "b"}, {"--name"});
  RunFails(2, {"fetch", server.url(), folder.File("out.png")}, {".ply"});
  RunFails(1, {"fetch", server.url(), folder.File("no/out.ply"), "--triangles", "900"},
           {"no/out.ply", "cannot be written"});
  for (const char* wrong : {"https://localhost", "localhost:80", "http://", "http://h:x"}) {
    RunFails(2, {"fetch", wrong, out}, {"URL", wrong});
  }
  RunFails(1, {"fetch", "http://127.0.0.1:1", out}, {"127.0.0.1:1", "cannot connect"});
  CHECK_FALSE(Exists(out));
}

TEST_CASE("fetch is not taken in by an answer that is broken", "[cli]") {
  const Folder folder;
  const std::string out = folder.File("out.ply");
  const auto fails = [&](const std::string& answer, const std::string& words) {
    INFO(answer);
    const WrongServer server(answer);
    RunFails(1, {"fetch", server.url() + "/objects/a", out, "--timeout", "20"}, {words});
    CHECK(std::filesystem::is_empty(std::filesystem::path(out).parent_path()));
  };
  const std::string head = "HTTP/1.1 200 OK\r\n";
  const std::string mesh = head + "X-Mtdb-Triangles: 1\r\n";
  fails(mesh + "Content-Length: 100\r\n\r\nply", "broke off");
  fails(mesh + "Transfer-Encoding: chunked\r\n\r\n5\r\nply\r", "broke off");
  fails(head + "Content-Length: 3\r\n\r\nply", "not a mesh");
  fails(mesh + "Content-Length: 0\r\n\r\n", "not a mesh");
  fails("", "closed the connection");
  fails("SSH-2.0-OpenSSH_9.2\r\n", "waiting for an answer");
  fails("HTTP/1.1 500 Oops\r\nContent-Length: 4\r\n\r\noops", "500");
  fails("HTTP/1.1 404 No\r\nContent-Length: 11\r\n\r\n{\"error\":1}", "404");
  fails("HTTP/1.1 302 Found\r\nLocation: /\r\nContent-Length: 0\r\n\r\n", "302");
}

}  // namespace
}  // namespace mtdb::test
