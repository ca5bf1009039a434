// SPDX-License-Identifier: Apache-2.0
// Targets and parameters of requests to the server.
#include "tools/server/http/server_request.h"

#include <catch2/catch.hpp>
#include <random>

#include "tools/client/http_client.h"
#include "tools/client/internal/remote_object.h"

namespace mtdb::test {

using namespace internal;

namespace {

std::string QueryFrom(const std::string& target, const std::string& body = "") {
  const auto parsed = ParseTarget(target);
  REQUIRE(parsed.ok());
  const auto request = ParseMeshRequest(*parsed, body);
  return request.ok() ? request->format + " " + request->query.Text() : request.status().message();
}

TEST_CASE("a target is split into decoded segments and parameters", "[server]") {
  const auto target = ParseTarget("/objects/a%2Fb%20%C3%A9/mesh?clip&error=1e+2&&box=1%2c2#x");
  REQUIRE(target.ok());
  CHECK(target->path == std::vector<std::string>{"objects", "a/b \xc3\xa9", "mesh"});
  using Pairs = std::vector<std::pair<std::string, std::string>>;
  CHECK(target->parameters == Pairs{{"clip", ""}, {"error", "1e+2"}, {"box", "1,2"}});
  CHECK(ParseTarget("/")->path == std::vector<std::string>{""});
  CHECK(ParseTarget("http://host:80/healthz")->path == std::vector<std::string>{"healthz"});
  for (const char* wrong : {"", "x", "*", "http://host", "/%", "/%4", "/%zz", "/a?b=%"}) {
    INFO(wrong);
    CHECK_FALSE(ParseTarget(wrong).ok());
  }
}

TEST_CASE("any name survives being put into a target", "[server]") {
  std::mt19937 random(1);
  for (int i = 0; i < 200; ++i) {
    std::string name(1 + random() % 20, 'x');
    for (char& c : name) c = static_cast<char>(random());
    const auto target = ParseTarget("/objects/" + PercentEncode(name));
    REQUIRE(target.ok());
    REQUIRE(target->path == std::vector<std::string>{"objects", name});
  }
}

TEST_CASE("parameters stand for the same query as the options of extract", "[server]") {
  CHECK(QueryFrom("/") == R"(ply {"threshold":"full"})");
  CHECK(QueryFrom("/?full=1&format=glb") == R"(glb {"threshold":"full"})");
  CHECK(QueryFrom("/?error=0.5&normals&clip=false") == R"(ply {"threshold":0.5,"normals":true})");
  CHECK(QueryFrom(
            "/?sphere=1,2,3,4&point=5,6,7&clip=true&triangles=9&max-bytes=2K&max-milliseconds=3") ==
        R"(ply {"region":{"union":[{"sphere":{"centre":[1.0,2.0,3.0],"radius":4.0}},)"
        R"({"point":[5.0,6.0,7.0]}]},"threshold":"full","max_triangles":9,"max_bytes":2048,)"
        R"("max_milliseconds":3.0,"clip":true})");
  CHECK(QueryFrom("/?error=10%25&error-at=linear,1,2,3,4,5") ==
        R"(ply {"threshold":{"smallest":[{"linear":{"point":[1.0,2.0,3.0],"base":4.0,)"
        R"("slope":5.0}},{"relative":0.1}]}})");
  CHECK(QueryFrom("/?format=stl", R"({"threshold": 1})") == R"(stl {"threshold":1})");
}

TEST_CASE("a wrong parameter is named, with what was expected", "[server]") {
  const auto wrong = [](const std::string& target, const std::string& words,
                        const std::string& body = "") {
    INFO(target);
    CHECK_THAT(QueryFrom(target, body), Catch::StartsWith(words));
  };
  wrong("/?colour=1", "colour: no such parameter");
  wrong("/?format=exe", "format: expected ply, obj, stl, off, glb or drc, found 'exe'");
  wrong("/?error=-1",
        "error: expected a number that is not negative, at most 1e30, or a percentage of the "
        "object's diagonal, as 0.1%, found '-1'");
  wrong("/?error=1&error=2", "error: is given twice");
  wrong("/?clip=maybe", "clip: expected true, false or nothing");
  wrong("/?double-positions=maybe", "double-positions: expected true, false or nothing");
  wrong("/?clip", "clip: needs a region: give box, sphere");
  wrong("/?box=1,2", "box: expected 6 numbers");
  wrong("/?full&error=1", "full: does not go with");
  wrong("/?error=x%25",
        "error: expected a number that is not negative, at most 1e30, or a percentage");
  wrong("/?frustum", "frustum: needs a camera: give eye and target");
  wrong("/?triangles=0", "triangles: expected a whole number above 0");
  wrong("/?error=1", "the body holds the query", "{}");
  wrong("/", "body: byte 1: not JSON", "x");
}

TEST_CASE("a URL is taken apart, or refused", "[server]") {
  const auto url = ParseHttpUrl("http://host:81/objects/a%20b");
  REQUIRE(url.ok());
  CHECK(url->host == "host");
  CHECK(url->port == "81");
  CHECK(url->path == "/objects/a%20b");
  CHECK(url->origin() == "http://host:81");
  CHECK(ParseHttpUrl("http://host")->port == "80");
  CHECK(ParseHttpUrl("http://host")->path == "/");
  CHECK(ParseHttpUrl("http://[::1]:8080/")->host == "::1");
  CHECK(ParseHttpUrl("http://[::1]:8080/")->origin() == "http://[::1]:8080");
  for (const char* wrong :
       {"", "host", "https://host", "http://", "http://:80", "http://host:", "http://host:x",
        "http://host:65536", "http://[::1", "http://a b", "http://u@host", "http://host/?q"}) {
    INFO(wrong);
    CHECK_FALSE(ParseHttpUrl(wrong).ok());
  }
}

TEST_CASE("a refusal says whether it is one of mtdb serve", "[server]") {
  const auto code = [](unsigned status, const std::string& text) {
    return Refused("http://host:80", status, text).code();
  };
  const std::string told = R"({"error": "no object 'x'", "code": "no_such_object"})";
  CHECK(Refused("http://host:80", 404, told).message() == "http://host:80: 404: no object 'x'");
  CHECK(code(404, told) == StatusCode::kNotFound);
  CHECK(code(400, told) == StatusCode::kInvalidArgument);
  CHECK(code(503, told) == StatusCode::kBusy);
  CHECK(code(500, told) == StatusCode::kIoError);
  CHECK(code(404, "<html>") == StatusCode::kBadInput);
  CHECK(code(200, "{}") == StatusCode::kBadInput);
  CHECK(code(503, "<html>") == StatusCode::kBusy);  // a proxy before it
}

}  // namespace
}  // namespace mtdb::test
