// SPDX-License-Identifier: Apache-2.0
// Control messages of sessions: what they say is read back, and what they must not say is refused.
#include "tools/client/session_message.h"

#include <catch2/catch.hpp>
#include <string>

namespace mtdb::test {
namespace {

SessionReply DoneReply() {
  SessionReply reply;
  reply.kind = SessionReply::Kind::kDone;
  reply.id = kLargestId;
  const Shortfall shortfall{3, 0.1, {{-1, 0, 0.3}, {2, 3, 4e9}}};
  reply.done = {12, 8, 5, 0.125, shortfall, "accuracy", 3, 4, 1, 99, 0.5};
  return reply;
}

SessionReply HelloReply() {
  SessionReply reply;
  reply.kind = SessionReply::Kind::kHello;
  reply.hello = {"a \"b\"", 1000, 502, 2.5, 1e-3, true, 64, 777, 4096};
  return reply;
}

std::string Without(std::string text, const std::string& part, const std::string& by = "") {
  const size_t at = text.find(part);
  REQUIRE(at != std::string::npos);
  return text.replace(at, part.size(), by);
}

TEST_CASE("a session's request is read as it was written", "[server]") {
  std::optional<uint64_t> id;
  const auto request = ParseSessionRequest(
      SessionRequestText({7, R"({"threshold": 0.1, "region": {"point": [1, 2, 3]}})"}), &id);
  REQUIRE(request.ok());
  CHECK(id == 7u);
  CHECK(request->id == 7);
  CHECK(request->query == R"({"threshold":0.1,"region":{"point":[1,2,3]}})");
}

TEST_CASE("a session's reply is read as it was written", "[server]") {
  const auto done = ParseSessionReply(SessionReplyText(DoneReply()));
  REQUIRE(done.ok());
  CHECK(done->kind == SessionReply::Kind::kDone);
  CHECK(done->id == kLargestId);
  CHECK(done->done.error_bound == 0.125);
  CHECK(done->done.shortfall == DoneReply().done.shortfall);
  CHECK(done->done.limit == "accuracy");
  CHECK(done->done.bytes == 99);
  CHECK(SessionReplyText(*done) == SessionReplyText(DoneReply()));
  const auto hello = ParseSessionReply(SessionReplyText(HelloReply()));
  REQUIRE(hello.ok());
  CHECK(hello->hello.object == "a \"b\"");
  CHECK(hello->hello.double_positions);
  CHECK(SessionReplyText(*hello) == SessionReplyText(HelloReply()));
  SessionReply error;
  error.error = "no";
  error.code = "bad_query";
  CHECK(SessionReplyText(error) == R"({"error":"no","code":"bad_query"})");
  CHECK_FALSE(ParseSessionReply(SessionReplyText(error))->id.has_value());
  const auto superseded = ParseSessionReply(R"({"id": 3, "superseded": true})");
  REQUIRE(superseded.ok());
  CHECK(superseded->kind == SessionReply::Kind::kSuperseded);
}

TEST_CASE("replies that lack something or have it wrong are refused", "[server]") {
  const std::string done = SessionReplyText(DoneReply());
  const std::string hello = SessionReplyText(HelloReply());
  for (const std::string& text :
       {std::string(), std::string("{}"), std::string("[]"), std::string("null"),
        std::string(200000, '['), std::string(R"({"superseded": true})"),
        std::string(R"({"id": 1, "superseded": false})"), std::string(R"({"error": "x"})"),
        std::string(R"({"id": 1, "done": 7})"), Without(done, R"("limit":"accuracy",)"),
        Without(done, "0.125", "-1"), Without(done, "0.125", "1e999"), Without(done, "99", "-99"),
        Without(done, "\"accuracy\"", "3"), Without(done, R"("id":)", R"("no":)"),
        Without(hello, "true", "1"), Without(hello, "1000", "1000.5"), hello.substr(1)}) {
    INFO(text.substr(0, 200));
    CHECK_FALSE(ParseSessionReply(text).ok());
  }
  CHECK(ParseSessionReply(Without(hello, R"("protocol":1)", R"("protocol":2)")).status().code() ==
        StatusCode::kUnsupported);
  for (size_t size = 0; size < done.size(); ++size) {
    CHECK_FALSE(ParseSessionReply(done.substr(0, size)).ok());
  }
}

}  // namespace
}  // namespace mtdb::test
