// SPDX-License-Identifier: Apache-2.0
// Objects of `mtdb serve` as packed files, by ranges.
#include <atomic>
#include <fstream>
#include <memory>
#include <random>

#include "tests/support/file_server.h"
#include "tests/support/raw_session.h"
#include "tests/tools/http_testing.h"

namespace mtdb::test {
namespace {

HttpAnswer GetPart(const ServerProcess& server, const std::string& target,
                   const std::string& headers) {
  RawConnection connection(server.port());
  connection.Send(RequestText("GET", target, "", headers));
  return connection.ReceiveAnswer(false);
}

std::string Packed(const std::string& store, const std::string& name, const Folder& folder) {
  const std::string path = folder.File(name + ".mtdbp");
  RunOk({"pack", store, path, "--name", name});
  return path;
}

TEST_CASE("the server offers an object as the packed file that mtdb pack writes", "[server]") {
  const Example& example = TheExample();
  const Folder folder;
  const std::string path = Packed(example.store, "sculpture", folder), file = ReadText(path);
  const std::string target = "/objects/sculpture/packed";
  // From a store, and from a packed file.
  for (const std::string& served : {example.store, path}) {
    INFO(served);
    const ServerProcess server(served);
    const HttpAnswer whole = server.Get(target);
    REQUIRE(whole.status == 200);
    CHECK(whole.body == file);
    CHECK(whole.header("Cache-Control") == "no-store");
    const std::string etag = whole.header("ETag"), hash = etag.substr(1, etag.size() - 2);
    REQUIRE(hash.size() == 32);
    const auto part = [&](const std::string& range, int status, const std::string& bytes) {
      INFO(range);
      const HttpAnswer answer = GetPart(server, target, "Range: bytes=" + range + "\r\n");
      CHECK(answer.status == status);
      CHECK(answer.header("ETag") == etag);
      CHECK(answer.body == bytes);
    };
    part("0-0", 206, file.substr(0, 1));
    part("100-4711", 206, file.substr(100, 4612));
    part("100-", 206, file.substr(100));
    part("-77", 206, file.substr(file.size() - 77));
    part("100-99999999999", 206, file.substr(100));
    part("-99999999999", 206, file);
    for (const char* odd :
         {"7-3", "1-2,5-6", "a-b", "-", "1-2-3", "+1-2", "99999999999999999999-"}) {
      part(odd, 200, file);
    }
    std::mt19937 random(1);
    for (int i = 0; i < 40; ++i) {
      const size_t from = random() % file.size(), size = 1 + random() % (file.size() - from);
      part(std::to_string(from) + "-" + std::to_string(from + size - 1), 206,
           file.substr(from, size));
    }
    CHECK(GetPart(server, target, "Range: bytes=5-6\r\n").header("Content-Range") ==
          "bytes 5-6/" + std::to_string(file.size()));
    const std::string behind = "Range: bytes=" + std::to_string(file.size()) + "-\r\n";
    CHECK(GetPart(server, target, behind).status == 416);
    CHECK(GetPart(server, target, behind).header("Content-Range") ==
          "bytes */" + std::to_string(file.size()));
    // Answers that may be kept for good, and the file that it no longer is.
    CHECK_THAT(
        GetPart(server, target + "?hash=" + hash, "Range: bytes=0-9\r\n").header("Cache-Control"),
        Catch::Contains("immutable"));
    CHECK(GetPart(server, target + "?hash=0" + hash.substr(1), "Range: bytes=0-9\r\n").status ==
          (hash[0] == '0' ? 206 : 412));
    CHECK(GetPart(server, target, "Range: bytes=0-9\r\nIf-Range: " + etag + "\r\n").status == 206);
    CHECK(GetPart(server, target, "Range: bytes=0-9\r\nIf-Range: \"1\"\r\n").status == 412);
    CHECK(server.Get(target + "?colour=red").status == 400);
    CHECK(server.Get("/objects/nothing/packed").status == 404);
    CHECK(server.Ask("POST", target, "{}").status == 405);
    CHECK(server.Ask("HEAD", target).status == 200);
    CHECK(server.temporary_files() == 0);
  }
}

TEST_CASE("a client with the engine reads from a server of mtdb as from any", "[server]") {
  const Example& example = TheExample();
  const Folder folder;
  const ServerProcess server(example.store);
  const std::string url = server.url() + "/objects/sculpture/packed";
  RunOk({"extract", example.store, folder.File("a.ply"), "--name", "sculpture", "--error", "0.2%"});
  RunOk({"extract", url, folder.File("b.ply"), "--error", "0.2%"});
  CHECK(ReadText(folder.File("a.ply")) == ReadText(folder.File("b.ply")));
  RunOk({"verify", url});
}

TEST_CASE("an object that was renamed is what it is called now", "[server]") {
  const Folder folder;
  const std::string store = folder.File("s.mtdb");
  std::filesystem::copy_file(TheExample().store, store);
  const ServerProcess server(store);
  const std::string probe = "/probe?point=0,0,0";
  const auto names = [&](const std::string& name) {
    const std::string path = "/objects/" + name;
    std::vector<std::string> told;
    const auto tell = [&](const Json& json, const char* key) {
      told.push_back(json.value(key, "none"));
    };
    tell(ParseJson(server.Get(path).body), "object");
    tell(ParseJson(server.Get(path + probe).body), "object");
    tell(RawSession(server.port(), path + "/session").ReceiveText().at("hello"), "object");
    const std::string packed = folder.File("packed.mtdbp");
    std::ofstream(packed, std::ios::binary) << server.Get(path + "/packed").body;
    tell(RunJson({"list", packed}).at("objects").at(0), "object");
    return told;
  };
  CHECK(names("sculpture") == std::vector<std::string>(4, "sculpture"));
  RunOk({"rename", store, "sculpture", "statue"});
  CHECK(names("statue") == std::vector<std::string>(4, "statue"));
  CHECK(server.Get("/objects/sculpture/packed").status == 404);
  RunOk({"rename", store, "statue", "sculpture"});
  CHECK(names("sculpture") == std::vector<std::string>(4, "sculpture"));
}

TEST_CASE("nobody waits for a server behind the server that trickles", "[server]") {
  const Folder folder;
  // More than comes with the first request.
  const std::string mesh = folder.File("sculpture.ply"), store = folder.File("s.mtdb");
  RunOk({"generate", "sculpture", mesh, "--triangles", "60000"});
  RunOk({"ingest", mesh, store, "--quiet"});
  std::atomic<bool> trickles{false};
  const testing::FileServer files(
      ReadText(Packed(store, "sculpture", folder)),
      [&](const testing::FileRequest& request, testing::FileReply* reply) {
        if (!trickles) return;
        reply->raw = "HTTP/1.1 206 Partial Content\r\nETag: \"one\"\r\nContent-Length: " +
                     std::to_string(request.last - request.first + 1) +
                     "\r\nContent-Range: " + reply->headers["Content-Range"] + "\r\n\r\n";
        reply->again = "x";
      });
  const ServerProcess server(files.url(), {"--timeout", "3", "--threads", "1"});
  trickles = true;
  const std::string target = "/objects/sculpture/packed";
  // More of them than the server has threads, of several clients.
  std::vector<std::unique_ptr<RawConnection>> waiting;
  for (int i = 0; i < 20; ++i) {
    waiting.push_back(std::make_unique<RawConnection>(server.port(), 0, 1 + i % 4));
    waiting.back()->Send(RequestText("GET", target));
  }
  for (int i = 0; i < 10; ++i) {
    RawConnection session(server.port(), 0, 5);
    session.Send(
        RequestText("GET", "/objects/sculpture/session", "",
                    "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
                    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"));
    CHECK(server.Get("/objects").status == 200);
    CHECK(server.Get("/objects/sculpture").status == 200);
  }
  for (const auto& connection : waiting) {
    const HttpAnswer answer = connection->ReceiveAnswer(false);
    CHECK(answer.status == 503);
    CHECK(answer.code() == "timeout");
  }
  // When it is well again, so is everything.
  trickles = false;
  CHECK(ServerProcess::Await([&] { return server.Get(target).status == 200; }));
}

TEST_CASE("what replaces an object is another packed file", "[server]") {
  const Folder folder;
  const std::string store = folder.File("s.mtdb");
  for (const char* triangles : {"3000", "5000"}) {
    RunOk({"generate", "terrain", folder.File(triangles) + ".ply", "--triangles", triangles});
  }
  RunOk({"ingest", folder.File("3000.ply"), store, "--name", "a", "--quiet"});
  const ServerProcess server(store);
  const std::string target = "/objects/a/packed";
  const HttpAnswer first = server.Get(target);
  CHECK(first.body == ReadText(Packed(store, "a", folder)));
  RunOk({"ingest", folder.File("5000.ply"), store, "--name", "a", "--replace", "--quiet"});
  const std::string etag = first.header("ETag");
  CHECK(GetPart(server, target + "?hash=" + etag.substr(1, 32), "Range: bytes=0-9\r\n").status ==
        412);
  const HttpAnswer second = server.Get(target);
  CHECK(second.header("ETag") != etag);
  CHECK(second.body == ReadText(Packed(store, "a", folder)));
  RunOk({"remove", store, "a"});
  CHECK(server.Get(target).status == 404);
}

}  // namespace
}  // namespace mtdb::test
