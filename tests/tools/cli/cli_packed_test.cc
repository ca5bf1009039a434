// SPDX-License-Identifier: Apache-2.0
// Packed files and their URLs where the command line and the C interface take a store.
#include <atomic>
#include <filesystem>
#include <string>
#include <sys/stat.h>

#include "tests/support/client_mesh_check.h"
#include "tests/support/file_server.h"
#include "tests/tools/http_testing.h"
#include "tools/c/mtdb.h"

namespace mtdb::test {

using mtdb::testing::FileServer;

namespace {

// The example's store, packed once.
const std::string& PackedExample() {
  static const Folder kFolder;
  static const std::string kFile = [] {
    const std::string file = kFolder.File("sculpture.mtdbp");
    const Json report = RunJson({"pack", TheExample().store, file});
    CHECK(report.at("file_bytes") == std::filesystem::file_size(file));
    CHECK(report.at("first_bytes") <= (64 << 10));
    return file;
  }();
  return kFile;
}

// Paths and URLs of the same object.
std::vector<std::string> Places(const FileServer& server) {
  std::vector<std::string> places{TheExample().store, PackedExample()};
  if (MTDB_TEST_HTTP) places.push_back(server.url());
  return places;
}

Json WithoutPlace(Json json) {
  for (const char* key : {"store", "file_bytes", "seconds", "bytes_read"}) json.erase(key);
  if (json.contains("objects")) {
    for (Json& object : json.at("objects")) {
      for (const char* key : {"id", "stored_bytes", "file_bytes", "bits_per_vertex"}) {
        object.erase(key);
      }
    }
  }
  return json;
}

}  // namespace

TEST_CASE("every verb that reads takes a packed file, or its URL, for a store") {
  const FileServer server(ReadText(PackedExample()));
  const Folder folder;
  const std::vector<Arguments> regions{
      {"--error", "1%"}, {"--full"}, {"--sphere", "0,0,0,0.7", "--clip"}};
  std::vector<std::string> meshes(regions.size());
  std::string picture;
  Json info, probe;
  for (const std::string& place : Places(server)) {
    INFO(place);
    for (size_t i = 0; i < regions.size(); ++i) {
      Arguments arguments{"extract", place, folder.File("a.ply")};
      arguments.insert(arguments.end(), regions[i].begin(), regions[i].end());
      RunOk(arguments);
      const std::string mesh = ReadText(folder.File("a.ply"));
      if (meshes[i].empty()) meshes[i] = mesh;
      CHECK(mesh == meshes[i]);
    }
    RunOk({"render", place, folder.File("a.png"), "--size", "80x60", "--error", "1%"});
    if (picture.empty()) picture = ReadText(folder.File("a.png"));
    CHECK(ReadText(folder.File("a.png")) == picture);
    const Json here = WithoutPlace(RunJson({"info", place}));
    if (info.empty()) info = here;
    CHECK(here == info);
    const Json hit = WithoutPlace(RunJson({"probe", place, "--point", "3,2,1"}));
    if (probe.empty()) probe = hit;
    CHECK(hit.at("point") == probe.at("point"));
    CHECK_THAT(RunOk({"list", place}), Catch::Contains("sculpture"));
    CHECK_THAT(RunOk({"verify", place, "--level", "global"}), Catch::Contains(": ok"));
    RunJson({"info", place, "--streams"});
  }
}

TEST_CASE("what is unpacked has the digest of what was packed") {
  const FileServer server(ReadText(PackedExample()));
  const Folder folder;
  const std::string digest = TheExample().info.at("digest");
  for (const std::string& place : Places(server)) {
    const std::string store = folder.File("copy.mtdb");
    if (place == TheExample().store) {
      RunFails(1, {"unpack", place, store}, {"expected a packed file"});
      CHECK(!Exists(store));
      continue;
    }
    CHECK_THAT(RunOk({"unpack", place, store, "--replace"}), Catch::Contains(digest));
    RunOk({"verify", store, "--level", "global"});
    RunFails(1, {"unpack", place, store}, {"sculpture", "is there"});
    const std::string again = folder.File("again.mtdbp");
    RunOk({"pack", place, again});
    CHECK(ReadText(again) == ReadText(PackedExample()));
  }
  RunFails(1, {"pack", TheExample().store, folder.File("x.mtdbp"), "--name", "nobody"},
           {"no object nobody; it holds sculpture"});
  CHECK(!Exists(folder.File("x.mtdbp")));
  RunFails(1, {"ingest", TheExample().mesh, PackedExample(), "--name", "x", "--quiet"},
           {"never changed"});
  RunFails(1, {"remove", PackedExample(), "sculpture"}, {"never changed"});
}

TEST_CASE("a packed file takes the place of packed files, not of stores") {
  const Folder folder;
  const std::string store = folder.File("s.mtdb"), link = folder.File("link.mtdbp");
  std::filesystem::copy(TheExample().store, store);
  std::filesystem::create_symlink("s.mtdb", link);
  const std::string before = ReadText(store);
  for (const std::string& from : {store, PackedExample()}) {
    for (const std::string& to : {store, link}) {
      RunFails(1, {"pack", from, to}, {"is a store", "another name"});
      CHECK(ReadText(store) == before);
    }
  }
  const std::string packed = folder.File("p.mtdbp");
  std::ofstream(packed).close();  // of mktemp
  CHECK_THAT(RunOk({"pack", store, packed}), Catch::Contains("p: 1 object, "));
  const std::string once = ReadText(packed);
  RunOk({"pack", packed, packed});
  CHECK(ReadText(packed) == once);
  // Others of its objects would be lost.
  RunFails(1, {"pack", packed, packed, "--name", "sculpture"}, {"is read", "another name"});
  CHECK(ReadText(packed) == once);
  // Cut short, damaged in the one or the other page, of a later version.
  for (const int damage : {0, 1, 2, 3}) {
    std::string bytes = before;
    if (damage == 0) bytes.resize(8192);
    if (damage == 1) std::fill_n(bytes.begin(), 4096, 'x');
    if (damage == 2) std::fill_n(bytes.begin() + 4096, 8192, 'x');
    if (damage == 3) bytes[20] = 7;
    WriteText(store, bytes);
    RunFails(1, {"pack", packed, store}, {"is a store", "another name"});
    CHECK(ReadText(store) == bytes);
  }
}

TEST_CASE("what is said of a packed file has no password and no signature of its URL") {
  const FileServer files(ReadText(PackedExample()));
  const std::string secret = "S3cr3tS3cr3t";
  const std::string url = "http://user:" + secret + "@127.0.0.1:" + std::to_string(files.port()) +
                          "/a.mtdbp?X-Amz-Signature=" + secret;
  const Folder folder;
  for (const std::string verb : {"list", "info", "verify", "copy", "unpack", "extract"}) {
    for (const bool json : {false, true}) {
      Arguments arguments{verb, url};
      if (verb == "copy" || verb == "unpack") arguments.push_back(folder.File(verb));
      if (verb == "extract") arguments.push_back(folder.File("a.ply"));
      if (json) arguments.push_back("--json");
      const Outcome outcome = Run(arguments);
      INFO(Join(arguments) << "\n" << outcome.out << outcome.err);
      if (!json) CHECK(outcome.exit_code == 0);
      CHECK((outcome.out + outcome.err).find(secret) == std::string::npos);
    }
  }
}

TEST_CASE("a server stands before a packed file and before its URL") {
  const FileServer files(ReadText(PackedExample()));
  std::string mesh;
  for (const std::string& place : Places(files)) {
    INFO(place);
    const ServerProcess server(place);
    const HttpAnswer answer = server.Get("/objects/sculpture/mesh?error=1%25&format=ply");
    REQUIRE(answer.status == 200);
    if (mesh.empty()) mesh = answer.body;
    CHECK(answer.body == mesh);
    CHECK(server.Get("/objects").status == 200);
  }
}

#if MTDB_TEST_HTTP

TEST_CASE("a packed file that changes under a server is an error of one request, then served") {
  // So large that the server's first read is not the whole of it.
  const Example large(160000);
  const std::string packed = large.folder.File("sculpture.mtdbp");
  RunOk({"pack", large.store, packed});
  REQUIRE(std::filesystem::file_size(packed) > 256 << 10);
  const std::string first_file = ReadText(packed), other_file = ReadText(PackedExample());
  // 1: gone; 2: touched; 3: another one.
  std::atomic<int> state{0};
  const FileServer files(first_file, [&](const mtdb::testing::FileRequest& request,
                                         mtdb::testing::FileReply* reply) {
    if (state == 1) reply->status = "404 Not Found";
    if (state < 2) return;
    const std::string& file = state == 2 ? first_file : other_file;
    const uint64_t end = std::min<uint64_t>(request.last + 1, file.size());
    const uint64_t first = std::min(request.first, end - 1);
    reply->status = "206 Partial Content";
    reply->headers["ETag"] = state == 2 ? "\"two\"" : "\"three\"";
    reply->body = file.substr(first, end - first);
    reply->headers["Content-Range"] = "bytes " + std::to_string(first) + "-" +
                                      std::to_string(end - 1) + "/" + std::to_string(file.size());
  });
  const std::string target = "/objects/sculpture/mesh?format=ply";
  const std::string mesh = large.folder.File("mesh.ply");
  for (const int s : {1, 2, 3}) {
    INFO(s);
    state = 0;
    const ServerProcess server(files.url());
    state = s;
    const HttpAnswer first = server.Get(target);
    CHECK(first.status >= 400);
    CHECK(first.body.find(files.url()) == std::string::npos);
    // Who meets the change is told, then what is there now is served.
    if (s == 1) state = 0;
    const HttpAnswer second = server.Get(target);
    RunOk({"extract", s == 3 ? PackedExample() : packed, mesh});
    CHECK(second.status == 200);
    CHECK(second.body == ReadText(mesh));
  }
}

TEST_CASE("what came of a URL is kept on disk, and need not come again") {
  const Example large(160000);
  const std::string packed = large.folder.File("sculpture.mtdbp");
  const std::string kept = large.folder.File("kept/deep");
  RunOk({"pack", large.store, packed});
  std::atomic<uint64_t> bytes{0};
  const auto count = [&](const mtdb::testing::FileRequest&, mtdb::testing::FileReply* reply) {
    bytes += reply->body.size();
  };
  const FileServer files(ReadText(packed), count);
  // The same content from another place.
  const FileServer others(ReadText(packed), count);
  const auto extract = [&](const std::string& url, const std::string& size) {
    bytes = 0;
    const std::string out = large.folder.File("out.ply");
    RunOk({"extract", url, out, "--cache-directory", kept, "--cache-directory-bytes", size});
    CHECK(ReadText(out) == ReadText(large.full));
    return bytes.load();
  };
  constexpr uint64_t kHead = 64 << 10;
  CHECK(extract(files.url(), "1G") > 256 << 10);
  CHECK(extract(files.url(), "1G") == kHead);
  CHECK(extract(others.url(), "1G") == kHead);
  const auto entries = [&] {
    std::vector<std::filesystem::path> paths;
    for (const auto& entry : std::filesystem::directory_iterator(kept)) paths.push_back(entry);
    return paths;
  };
  REQUIRE(!entries().empty());
  // Whatever is damaged comes again, and once only.
  const uint64_t end = std::filesystem::file_size(entries()[0]);
  for (const uint64_t at : {uint64_t{8 * 40}, uint64_t{200 << 10}, end - 1}) {
    INFO(at);
    std::fstream file(entries()[0], std::ios::in | std::ios::out | std::ios::binary);
    file.seekg(static_cast<std::streamoff>(at));
    const int byte = file.get();
    file.seekp(static_cast<std::streamoff>(at));
    file.put(static_cast<char>(byte ^ 1));
    file.close();
    CHECK(extract(files.url(), "1G") > kHead);
    CHECK(extract(files.url(), "1G") == kHead);
  }
  std::filesystem::resize_file(entries()[0], end / 2);
  CHECK(extract(files.url(), "1G") > kHead);
  CHECK(extract(files.url(), "1G") == kHead);
  // The limit holds, also for what others left.
  extract(files.url(), "100K");
  uint64_t left = 0;
  for (const auto& entry : entries()) {
    struct stat s {};
    REQUIRE(::stat(entry.c_str(), &s) == 0);
    left += static_cast<uint64_t>(s.st_blocks) * 512;
  }
  CHECK(left <= 100 << 10);
  const std::string file = large.folder.File("sculpture.ply");
  RunFails(1, {"info", files.url(), "--cache-directory", file}, {"cannot keep ranges"});
  RunFails(2, {"info", files.url(), "--cache-directory-bytes", "1G"}, {"--cache-directory"});
}

TEST_CASE("what came damaged once is not kept for ever") {
  const std::string right = ReadText(PackedExample());
  const Folder folder;
  const std::string out = folder.File("out.ply"), whole = folder.File("whole.ply");
  RunOk({"extract", PackedExample(), whole});
  std::atomic<uint64_t> wrong{0};  // the byte that comes damaged; 0: none
  const FileServer files(
      right, [&](const mtdb::testing::FileRequest& request, mtdb::testing::FileReply* reply) {
        if (wrong == 0 || wrong < request.first || wrong >= request.first + reply->body.size())
          return;
        char& byte = reply->body[wrong - request.first];
        byte = static_cast<char>(byte ^ 0x10);
      });
  for (int i = 1; i < 24; ++i) {
    wrong = right.size() * static_cast<size_t>(i) / 24;
    INFO("byte " << wrong);
    const std::string kept = folder.File("kept" + std::to_string(i));
    const Arguments arguments{"extract", files.url(), out, "--cache-directory", kept};
    const Outcome damaged = Run(arguments);
    CHECK(damaged.exit_code == 1);
    CHECK_THAT(damaged.err, Catch::Contains("get the file anew"));
    wrong = 0;
    // From what is kept of it, and from the server.
    RunOk(arguments);
    CHECK(ReadText(out) == ReadText(whole));
    std::filesystem::remove(out);
  }
}

TEST_CASE("no entry of a folder of kept ranges is waited for") {
  const Folder folder;
  const FileServer files(ReadText(PackedExample()));
  const std::string kept = folder.File("kept"), out = folder.File("out.ply");
  RunOk({"extract", files.url(), out, "--cache-directory", kept});
  for (const auto& entry : std::filesystem::directory_iterator(kept)) {
    std::filesystem::remove(entry.path());
    REQUIRE(::mkfifo(entry.path().c_str(), 0600) == 0);
  }
  RunOk({"extract", files.url(), out, "--cache-directory", kept});
}

TEST_CASE("the C interface opens URLs") {
  const FileServer files(ReadText(PackedExample()));
  mtdb_database* database = nullptr;
  mtdb_object* object = nullptr;
  mtdb_error error{};
  REQUIRE(mtdb_open(files.url().c_str(), nullptr, &database, &error) == MTDB_OK);
  REQUIRE(mtdb_open_object(database, nullptr, nullptr, &object, &error) == MTDB_OK);
  mtdb_free_object(object);
  mtdb_free_database(database);
  database = nullptr;
  CHECK(mtdb_open(files.url("/x y").c_str(), nullptr, &database, &error) == MTDB_INVALID_ARGUMENT);
}

TEST_CASE("each database of a process keeps what it reads of a URL in its own folder, or nowhere") {
  const FileServer files(ReadText(PackedExample()));
  const Folder folder;
  const std::string one = folder.File("one"), other = folder.File("other");
  const auto entries = [](const std::string& path) -> ptrdiff_t {
    if (!Exists(path)) return -1;
    return std::distance(std::filesystem::directory_iterator(path), {});
  };
  const auto read = [&](const mtdb_open_options* options) {
    mtdb_database* database = nullptr;
    mtdb_object* object = nullptr;
    mtdb_cut* cut = nullptr;
    mtdb_error error{};
    REQUIRE(mtdb_open(files.url().c_str(), options, &database, &error) == MTDB_OK);
    REQUIRE(mtdb_open_object(database, nullptr, nullptr, &object, &error) == MTDB_OK);
    REQUIRE(mtdb_select(object, nullptr, nullptr, &cut, &error) == MTDB_OK);
    mtdb_free_cut(cut);
    mtdb_free_object(object);
    mtdb_free_database(database);
  };
  mtdb_open_options options;
  MTDB_INIT(options);
  options.cache_directory = one.c_str();
  read(&options);
  const ptrdiff_t kept = entries(one);
  CHECK(kept > 0);
  std::filesystem::remove_all(one);
  read(nullptr);
  CHECK(entries(one) == -1);
  options.cache_directory = other.c_str();
  read(&options);
  CHECK(entries(other) == kept);
  CHECK(entries(one) == -1);
  // The limit is the database's own, too.
  options.cache_directory_bytes = 1;
  read(&options);
  CHECK(entries(other) == 0);
}

#endif

}  // namespace mtdb::test
