// SPDX-License-Identifier: Apache-2.0
// What `mtdb serve` has for the viewer: probes, and the page; and `mtdb view`.
#include "tests/tools/http_testing.h"

namespace mtdb::test {
namespace {

const std::string kObject = "/objects/sculpture";

// As the JSON of `mtdb probe`, without what depends on the clock and on what was read before.
Json WithoutWork(Json json) {
  for (const char* key : {"schema", "seconds", "clusters_read", "bytes_read"}) json.erase(key);
  return json;
}

TEST_CASE("the server probes as mtdb probe does", "[server]") {
  const Example& example = TheExample();
  const ServerProcess server(example.store);
  const auto both = [&](const std::string& what, const std::string& value,
                        const std::string& error) {
    Arguments arguments{"probe", example.store, "--" + what + "=" + value};
    std::string target = kObject + "/probe?" + what + "=" + value;
    if (!error.empty()) {
      arguments.push_back("--error=" + error);
      target += "&error=" + error;
    }
    INFO(target);
    const HttpAnswer answer = server.Get(target);
    REQUIRE(answer.status == 200);
    CHECK(answer.header("Content-Type") == "application/json");
    const Json json = ParseJson(answer.body);
    CHECK(WithoutWork(json) == WithoutWork(RunJson(arguments)));
    return json;
  };
  CHECK(both("point", "0.3,-2,1.5", "").at("hit") == true);
  CHECK(both("point", "0.3,-2,1.5", "0.02").contains("distance"));
  both("ray", "0.2,0.1,9,0,0,-1", "");
  both("ray", "3,4,5,-3,-4,-4.5", "0.01");
  CHECK(both("ray", "0,0,9,0,0,1", "").at("hit") == false);
  CHECK(server.Get(kObject + "/probe?point=0,0,9&limit=0.001").json().at("hit") == false);
}

TEST_CASE("probes that cannot be answered get a status and a reason", "[server]") {
  const ServerProcess server(TheExample().store);
  const auto refused = [&](int status, const std::string& code, const std::string& words,
                           const std::string& target) {
    INFO(target);
    const HttpAnswer answer = server.Get(target);
    CHECK(answer.status == status);
    CHECK(answer.json().at("code") == code);
    CHECK_THAT(answer.error(), Catch::Contains(words));
  };
  const std::string probe = kObject + "/probe";
  refused(400, "bad_query", "a point or a ray", probe);
  refused(400, "bad_query", "a point or a ray", probe + "?point=0,0,0&ray=0,0,0,1,0,0");
  refused(400, "bad_query", "point: expected", probe + "?point=0,0");
  refused(400, "bad_query", "point: given twice", probe + "?point=0,0,0&point=0,0,0");
  refused(400, "bad_query", "ray: ", probe + "?ray=0,0,0,0,0,0");
  refused(400, "bad_query", "error: expected", probe + "?point=0,0,0&error=-1");
  refused(400, "bad_query", "limit: expected", probe + "?point=0,0,0&limit=nan");
  refused(400, "bad_query", "colour: no such", probe + "?point=0,0,0&colour=red");
  refused(404, "no_such_object", "'nothing'", "/objects/nothing/probe?point=0,0,0");
  CHECK(server.Ask("POST", probe + "?point=0,0,0", "{}").status == 405);
}

bool HasPage(const ServerProcess& server) { return server.Get("/").status == 200; }

TEST_CASE("the server shows the viewer, or says why not", "[server]") {
  const ServerProcess server(TheExample().store);
  const HttpAnswer page = server.Get("/");
  if (!HasPage(server)) {
    CHECK(page.status == 404);
    CHECK(page.json().at("code") == "no_viewer");
    CHECK_THAT(page.error(), Catch::Contains("built without the viewer"));
    RunFails(1, {"view", TheExample().store, "--no-browser"}, {"built without the viewer"});
    return;
  }
  for (const std::string path : {"/", "/index.html", "/viewer.js", "/decoder.js", "/decoder.wasm",
                                 "/engine.js", "/engine.wasm", "/draping.js"}) {
    INFO(path);
    const HttpAnswer file = server.Get(path);
    CHECK(file.status == 200);
    CHECK(file.header("Content-Encoding") == "gzip");
    CHECK(file.body.starts_with("\x1f\x8b"));
    CHECK(file.header("X-Content-Type-Options") == "nosniff");
    const std::string policy = file.header("Content-Security-Policy");
    CHECK_THAT(policy, Catch::Contains("default-src 'none'"));
    CHECK_THAT(policy, Catch::Contains("script-src 'self' 'wasm-unsafe-eval';"));
    CHECK_THAT(policy, Catch::Contains("connect-src 'self';"));
    CHECK_THAT(policy, !Catch::Contains("unsafe-inline"));
    CHECK(server.Ask("HEAD", path).status == 200);
    CHECK(server.Ask("POST", path, "{}").status == 405);
  }
  CHECK(server.Get("/viewer.js").header("Content-Type") == "text/javascript; charset=utf-8");
  CHECK(server.Get("/decoder.wasm").header("Content-Type") == "application/wasm");
  CHECK(server.Get("/").body == server.Get("/index.html").body);
  CHECK(server.Get("/other.js").status == 404);
}

TEST_CASE("view writes the page for any web server", "[server]") {
  const Folder folder;
  const std::string www = folder.File("deep/www");
  const std::string store = TheExample().store;
  const ServerProcess server(store);
  if (!HasPage(server)) {
    RunFails(1, {"view", "--write-page", www}, {"built without the viewer"});
    return;
  }
  RunOk({"view", "--write-page", www});
  for (const char* name : {"index.html", "viewer.css", "viewer.js", "engine.js", "engine.wasm"}) {
    CHECK(Exists(www + "/" + name));
  }
  CHECK(ReadText(www + "/engine.wasm").starts_with(std::string("\0asm", 4)));
  const std::string page = ReadText(www + "/index.html");
  CHECK_THAT(page, Catch::Contains("connect-src 'self';"));
  CHECK_THAT(page, Catch::EndsWith("</html>\n"));
  RunOk({"view", "--write-page", www, "--allowed-source", "https://a.example:8443",
         "--allowed-source", "http://[::1]"});
  CHECK_THAT(ReadText(www + "/index.html"),
             Catch::Contains("connect-src 'self' https://a.example:8443 http://[::1];"));
  for (const char* odd : {"a.example", "https://", "https://a.example/path",
                          "https://a; script-src *", "https://a\"", "*", "ftp://a"}) {
    RunFails(1, {"view", "--write-page", www, "--allowed-source", odd}, {"no origin"});
  }
  RunFails(2, {"view"}, {"STORE"});
  RunFails(2, {"view", store, "--write-page", www}, {"mtdb pack STORE " + www + "/scan.mtdbp"});
  RunFails(2, {"view", store, "--allowed-source", "https://a"}, {"--write-page"});
  RunFails(1, {"view", "--write-page", store + "/www"}, {"cannot be made"});
}

TEST_CASE("view --drape serves an image and its place beside the page", "[server]") {
  const std::string store = TheExample().store;
  if (!HasPage(ServerProcess(store))) return;
  const Folder folder;
  const std::string image = folder.File("photo.png");
  RunOk({"render", store, image, "--size", "40x20"});
  WriteText(folder.File("photo.pgw"), "0.1 0.015625 -0.03125 -0.25 1234567.3 -2.5");
  const std::string out = folder.File("out");
  const pid_t process =
      Start({"view", store, "--no-browser", "--drape", image}, out, folder.File("err"));
  for (int i = 0; i < 4000 && !(Exists(out) && ReadText(out).ends_with('\n')); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  const std::string told = ReadText(out);
  CHECK_THAT(told, Catch::EndsWith("/?drape=drape.png\n"));
  const int port = std::stoi(told.substr(told.find(':', 7) + 1));
  const HttpAnswer served = AskServer(port, "GET", "/drape.png");
  CHECK(served.status == 200);
  CHECK(served.header("Content-Type") == "image/png");
  CHECK(served.header("X-Content-Type-Options") == "nosniff");
  CHECK(served.body == ReadText(image));
  std::istringstream world(AskServer(port, "GET", "/drape.pgw").body);
  for (const double expected : {0.1, 0.015625, -0.03125, -0.25, 1234567.3, -2.5}) {
    double number = 0;
    CHECK(world >> number);
    CHECK(number == Approx(expected).epsilon(1e-15));
  }
  CHECK(AskServer(port, "POST", "/drape.png").status == 405);
  CHECK(AskServer(port, "GET", "/photo.png").status == 404);
  ::kill(process, SIGTERM);
  CHECK(Finish(process).exit_code == 0);
  RunFails(1, {"view", store, "--no-browser", "--drape", folder.File("none.png")}, {"none.png"});
  RunFails(2, {"view", "--write-page", folder.File("www"), "--drape", image}, {"--drape"});
}

TEST_CASE("view serves on a free port and asks the desktop for a browser", "[server]") {
  const std::string store = TheExample().store;
  if (!HasPage(ServerProcess(store))) return;
  const Folder folder;
  const std::string told = folder.File("told"), desktop = folder.File("xdg-open");
  WriteText(desktop, "#!/bin/sh\nprintf '%s' \"$1\" > '" + told + ".part' && mv '" + told +
                         ".part' '" + told + "'\n");
  std::filesystem::permissions(desktop, std::filesystem::perms::owner_all);
  const std::string path = std::getenv("PATH");
  ::setenv("PATH", (std::filesystem::path(desktop).parent_path().string() + ":" + path).c_str(), 1);
  const pid_t process = Start({"view", store}, folder.File("out"), folder.File("err"));
  ::setenv("PATH", path.c_str(), 1);
  for (int i = 0; i < 4000 && !Exists(told); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  ::kill(process, SIGTERM);
  CHECK(Finish(process).exit_code == 0);
  const std::string url = ReadText(folder.File("out"));
  CHECK_THAT(url, Catch::StartsWith("http://127.0.0.1:"));
  CHECK(ReadText(told) + "\n" == url.substr(0, url.size() - 1) + "/\n");
  RunFails(1, {"view", folder.File("none.mtdb")}, {"none.mtdb"});
}

}  // namespace
}  // namespace mtdb::test
