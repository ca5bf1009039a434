// SPDX-License-Identifier: Apache-2.0
// Comparisons by `mtdb serve`: what `mtdb diff` tells, within the server's limits.
#include <random>

#include "tests/tools/http_testing.h"

namespace mtdb::test {
namespace {

// A sheet of 40 x 40 squares, and one with four spikes.
struct Sheets {
  Folder folder;
  std::string store = folder.File("sheets.mtdb");
  Sheets() {
    const std::string flat = folder.File("flat.obj"), spiky = folder.File("spiky.obj");
    WriteText(flat, Sheet(0));
    WriteText(spiky, Sheet(0.5));
    RunOk({"ingest", flat, store, "--name", "flat"});
    RunOk({"ingest", spiky, store, "--name", "a/spiky"});
  }
  static std::string Sheet(double height) {
    std::string text;
    for (int y = 0; y <= 40; ++y) {
      for (int x = 0; x <= 40; ++x) {
        const double z = x % 20 == 7 && y % 20 == 12 ? height : 0;
        text += "v " + std::to_string(x) + " " + std::to_string(y) + " " + std::to_string(z) + "\n";
      }
    }
    for (int y = 0; y < 40; ++y) {
      for (int x = 0; x < 40; ++x) {
        const int a = y * 41 + x + 1;
        text += "f " + std::to_string(a) + " " + std::to_string(a + 1) + " " +
                std::to_string(a + 42) + " " + std::to_string(a + 41) + "\n";
      }
    }
    return text;
  }
};

// With more members of the body.
std::string Body(const std::string& more = "") {
  return R"({"object": "flat", "other": "a/spiky")" + (more.empty() ? "" : ", " + more) + "}";
}

// Without what depends on the clock and on what was read before.
Json WithoutWork(Json json) {
  for (const char* key : {"schema", "seconds", "clusters_read", "bytes_read"}) json.erase(key);
  return json;
}

// The example's sculpture beside another one, whose comparison takes long.
struct Sculptures {
  Folder folder;
  std::string store = folder.File("two.mtdb");
  Sculptures() {
    for (const std::string seed : {"1", "2"}) {
      const std::string mesh = folder.File(seed + ".ply");
      RunOk({"generate", "sculpture", mesh, "--triangles", "60k", "--seed", seed});
      RunOk({"ingest", mesh, store, "--name", seed});
    }
  }
  static std::string Body(const std::string& more) {
    return R"({"object": "1", "other": "2", )" + more + "}";
  }
  static std::string Endless() { return Body(R"("tolerance": 0.04, "width": 0)"); }
};

TEST_CASE("the server compares as mtdb diff does", "[server]") {
  const Sheets sheets;
  const ServerProcess server(sheets.store);
  const auto same = [&](const std::string& body, const Arguments& options) {
    INFO(body);
    Arguments arguments{"diff",    sheets.store, sheets.store, "--name",    "flat",
                        "--other", "a/spiky",    "--json",     "--threads", "1"};
    arguments.insert(arguments.end(), options.begin(), options.end());
    const HttpAnswer answer = server.Ask("POST", "/diff", Body(body));
    REQUIRE(answer.status == 200);
    CHECK(answer.header("Content-Type") == "application/json");
    const Json json = ParseJson(answer.body);
    CHECK(WithoutWork(json) == WithoutWork(ParseJson(Run(arguments).out)));
    return json;
  };
  CHECK(same("", {}).at("verdict") == "undecided");
  CHECK(same(R"("tolerance": 0.6)", {"--tolerance", "0.6"}).at("verdict") == "within");
  const Json exceeds = same(R"("tolerance": {"relative": 0.005})", {"--tolerance", "0.5%"});
  CHECK(exceeds.at("verdict") == "exceeds");
  CHECK(exceeds.at("b_to_a").at("places").size() == 4);
  CHECK_FALSE(same(R"("asks": "a", "width": 0.001, "as_stored": true)",
                   {"--asks", "a", "--width", "0.001", "--as-stored"})
                  .contains("b_to_a"));
  same(R"("reach": 0.2, "tolerance": 0.1, "transform": [[1,0,0,0],[0,1,0,0],[0,0,1,3],[0,0,0,1]])",
       {"--reach", "0.2", "--tolerance", "0.1", "--transform=1,0,0,0,0,1,0,0,0,0,1,3,0,0,0,1"});
  const Json part = same(
      R"("tolerance": 0.1, "region": {"union": [{"box": {"min": [0, 0, -1], "max": [20, 20, 1]}}]})",
      {"--tolerance", "0.1", "--box=0,0,-1,20,20,1"});
  CHECK(part.at("b_to_a").at("places").size() == 1);
  CHECK(same(R"("tolerance": 0.1, "max_milliseconds": 0)",
             {"--tolerance", "0.1", "--max-milliseconds", "0"})
            .at("out_of_time") == true);
  const Json twins = server.Ask("POST", "/diff", R"({"object":"flat","other":"flat"})").json();
  CHECK(twins.at("identical") == true);
  // An object, and itself when it is moved.
  const Json moved = server
                         .Ask("POST", "/diff",
                              R"({"object":"flat","other":"flat","width":0.01,)"
                              R"("transform":[[1,0,0,0],[0,1,0,0],[0,0,1,2],[0,0,0,1]]})")
                         .json();
  CHECK(moved.at("distance").at("low") <= 2);
  CHECK(moved.at("distance").at("high") >= 2);
}

TEST_CASE("places beyond the most of them are joined, not left out", "[server]") {
  const Sheets sheets;
  const ServerProcess server(sheets.store);
  for (const int most : {1, 2, 3, 4, 9}) {
    const std::string more = R"("tolerance": 0.1, "max_places": )" + std::to_string(most);
    const Json json = server.Ask("POST", "/diff", Body(more)).json();
    for (const char* const side : {"a_to_b", "b_to_a"}) {
      const Json& places = json.at(side).at("places");
      CHECK(places.size() >= 1);
      CHECK(places.size() <= static_cast<size_t>(most));
      // Each spike is in one of them.
      for (const int x : {7, 27}) {
        for (const int y : {12, 32}) {
          CHECK(std::any_of(places.begin(), places.end(), [&](const Json& place) {
            const Json &min = place.at("box").at("min"), &max = place.at("box").at("max");
            return min[0] <= x && x <= max[0] && min[1] <= y && y <= max[1];
          }));
        }
      }
    }
  }
}

TEST_CASE("the server compares heights as mtdb diff --heights does", "[server]") {
  const Folder folder;
  const std::string store = folder.File("hills.mtdb");
  for (const auto& [name, height] : {std::pair{"flat", 0.0}, {"a/spiky", 0.5}}) {
    const std::string file = folder.File("sheet.obj");
    WriteText(file, Sheets::Sheet(height));
    RunOk({"ingest", file, store, "--name", name, "--terrain"});
  }
  const ServerProcess server(store);
  const HttpAnswer answer =
      server.Ask("POST", "/diff", Body(R"("heights": true, "width": 0, "window": [0, 0, 20, 40])"));
  REQUIRE(answer.status == 200);
  CHECK(
      WithoutWork(answer.json()) ==
      WithoutWork(RunJson({"diff", store, store, "--name", "flat", "--other", "a/spiky",
                           "--heights", "--width", "0", "--window=0,0,20,40", "--threads", "1"})));
  CHECK(answer.json().at("fill_volume").at("low") == Approx(2.0 / 3));
  const Json within =
      server.Ask("POST", "/diff", Body(R"("heights": true, "tolerance": 0.6)")).json();
  CHECK(within.at("verdict") == "within");
  for (const char* const wrong :
       {R"("heights": 1)", R"("heights": true, "window": [0, 0, 1])",
        R"("heights": true, "window": [0, 0, 1, "x"])",
        R"("heights": true, "window": [1, 0, 0, 1])", R"("heights": true, "reach": 1)",
        R"("heights": true, "asks": "a")", R"("heights": true, "region": {"point": [0, 0, 0]})",
        R"("window": [0, 0, 1, 1])"}) {
    INFO(wrong);
    const HttpAnswer refused = server.Ask("POST", "/diff", Body(wrong));
    CHECK(refused.status == 400);
    CHECK(refused.code() == "bad_query");
  }
}

TEST_CASE("comparisons that mean nothing get a status and a reason", "[server]") {
  const Sheets sheets;
  const ServerProcess server(sheets.store);
  const auto refused = [&](int status, const std::string& code, const std::string& words,
                           const std::string& body) {
    INFO(body);
    const HttpAnswer answer = server.Ask("POST", "/diff", body);
    CHECK(answer.status == status);
    CHECK(answer.code() == code);
    CHECK_THAT(answer.error(), Catch::Contains(words));
  };
  const auto bad = [&](const std::string& words, const std::string& body) {
    refused(400, "bad_query", words, body);
  };
  bad("body: byte", "");
  bad("body: byte", "x");
  bad("body: expected an object", "[]");
  bad("body: expected an object", "null");
  bad("object: expected the name", "{}");
  bad("other: expected the name", R"({"object": "flat"})");
  bad("other: expected the name", R"({"object": "flat", "other": 3})");
  bad("no key \"colour\"", Body(R"("colour": 1)"));
  bad("tolerance: expected a length", Body(R"("tolerance": -1)"));
  bad("tolerance: expected a length", Body(R"("tolerance": 1e31)"));
  bad("tolerance: expected a length", Body(R"("tolerance": "1%")"));
  bad("tolerance: expected a length", Body(R"("tolerance": {"relative": 1, "x": 2})"));
  bad("width: expected a length", Body(R"("width": null)"));
  bad("reach: expected a length", Body(R"("reach": {"relative": []})"));
  bad("max_milliseconds: expected a number", Body(R"("max_milliseconds": -1)"));
  bad("max_places: expected a whole number above 0", Body(R"("max_places": 0)"));
  bad("max_places: expected a whole number above 0", Body(R"("max_places": 1.5)"));
  bad("asks: expected", Body(R"("asks": "c")"));
  bad("as_stored: expected true or false", Body(R"("as_stored": 1)"));
  bad("transform: expected a matrix", Body(R"("transform": [1, 0])"));
  bad("transform: expected a matrix",
      Body(R"("transform": [[1,0,0,0],[0,1,0,0],[0,0,1],[0,0,0,1]])"));
  bad("transform: ", Body(R"("transform": [[0,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]])"));
  bad("transform: ", Body(R"("transform": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,1,1]])"));
  bad("region", Body(R"("region": {"ball": 1})"));
  bad("region.box", Body(R"("region": {"box": 1})"));
  bad("body: a number that is too large", Body(R"("tolerance": 1e999)"));
  bad("body: byte", Body("\"region\": " + std::string(5000, '[')));
  refused(404, "no_such_object", "'nothing'", R"({"object": "nothing", "other": "flat"})");
  refused(404, "no_such_object", "'nothing'", R"({"object": "flat", "other": "nothing"})");
  refused(413, "body_too_large", "1048576", Body() + std::string(1 << 20, ' '));
  for (const char* const method : {"GET", "HEAD", "PUT", "DELETE"}) {
    const HttpAnswer answer = server.Ask(method, "/diff");
    CHECK(answer.status == 405);
    CHECK(answer.header("Allow") == "POST");
  }
  CHECK(server.Ask("POST", "/diff/x", Body()).status == 404);
  CHECK(server.Ask("POST", "/diff", Body()).status == 200);
}

TEST_CASE("bodies of comparisons that are cut off or mangled harm nobody", "[server]") {
  const Sheets sheets;
  const ServerProcess server(sheets.store);
  const std::string good =
      Body(R"("tolerance": {"relative": 0.1}, "reach": 3, "asks": "both", "as_stored": false,)"
           R"("max_milliseconds": 50, "transform": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]],)"
           R"("region": {"sphere": {"centre": [1, 2, 3], "radius": 4}})");
  CHECK(server.Ask("POST", "/diff", good).status == 200);
  for (size_t size = 0; size < good.size(); ++size) {
    REQUIRE(server.Ask("POST", "/diff", good.substr(0, size)).status == 400);
  }
  std::mt19937 random(3);
  for (int i = 0; i < 300; ++i) {
    std::string body = good;
    for (int k = 0; k <= i % 3; ++k) body[random() % body.size()] = static_cast<char>(random());
    INFO(body);
    const int status = server.Ask("POST", "/diff", body).status;
    CHECK((status == 200 || status == 400 || status == 404));
  }
  CHECK(server.Ask("POST", "/diff", good).status == 200);
  CHECK(server.errors().empty());
}

TEST_CASE("a comparison whose client goes away is cancelled, and one that takes too long",
          "[server]") {
  const Sculptures sculptures;
  {
    const ServerProcess server(sculptures.store, {"--threads", "1"});
    {
      RawConnection running(server.port());
      running.Send(RequestText("POST", "/diff", Sculptures::Endless()));
      REQUIRE(server.Reaches("mtdb_queries_running", 1));
      RawConnection waiting(server.port());
      waiting.Send(RequestText("POST", "/diff", Sculptures::Endless()));
      REQUIRE(server.Reaches("mtdb_queries_total", 1));
    }
    CHECK(server.Reaches("mtdb_queries_cancelled_total", 2));
    CHECK(server.Becomes("mtdb_queries_running", 0));
    CHECK(server.Metric("mtdb_session_memory_bytes") == 0);
    // Its time is a client's own limit, and what was proved is the answer.
    const HttpAnswer some =
        server.Ask("POST", "/diff",
                   Sculptures::Body(R"("tolerance": 0.04, "width": 0, "max_milliseconds": 100)"));
    CHECK(some.status == 200);
    CHECK(some.json().at("out_of_time") == true);
    CHECK(some.json().at("distance").at("low") > 0);
  }
  const ServerProcess hurried(sculptures.store, {"--timeout", "0.3"});
  const HttpAnswer answer = hurried.Ask("POST", "/diff", Sculptures::Endless());
  CHECK(answer.status == 503);
  CHECK(answer.code() == "timeout");
}

TEST_CASE("comparisons take no more memory than they may, and tell what is proved", "[server]") {
  const Sculptures sculptures;
  const std::string body = Sculptures::Body(R"("tolerance": 0.04, "max_milliseconds": 4000)");
  const ServerProcess roomy(sculptures.store);
  const Json all = roomy.Ask("POST", "/diff", body).json();
  CHECK(all.at("out_of_memory") == false);
  const ServerProcess server(sculptures.store, {"--session-memory", "2M"});
  const HttpAnswer answer = server.Ask("POST", "/diff", body);
  REQUIRE(answer.status == 200);
  const Json json = answer.json();
  CHECK(json.at("out_of_memory") == true);
  CHECK(json.at("out_of_time") == false);
  for (const char* const side : {"a_to_b", "b_to_a"}) {
    const Json &some = json.at(side).at("distance"), &narrow = all.at(side).at("distance");
    CHECK(some.at("low") <= narrow.at("high"));
    CHECK(some.at("high") >= narrow.at("low"));
  }
  CHECK(server.Metric("mtdb_session_memory_bytes") == 0);
}

}  // namespace
}  // namespace mtdb::test
