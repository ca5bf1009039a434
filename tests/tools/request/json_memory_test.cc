// SPDX-License-Identifier: Apache-2.0
// JSON without memory: whichever allocation fails, and all after it, what is asked for is given or
// std::bad_alloc is thrown.
#include <atomic>
#include <catch2/catch.hpp>
#include <new>
#include <optional>
#include <thread>

#include "store/base/json.h"
#include "tests/support/failing_allocation.h"
#include "tools/client/session_message.h"
#include "tools/request/report_json.h"
#include "tools/server/http/server_request.h"
#include "tools/server/internal/server_service.h"

namespace mtdb::test {

using namespace internal;

namespace {

using testing::FailEachAllocation;
using testing::FailingAllocation;

// The text that make() gives, or "" without memory.
template <typename Make>
std::string TextOrNothing(Make&& make) {
  try {
    return make();
  } catch (const std::bad_alloc&) {
    return "";
  }
}

template <typename Make>
void RequireNoMatterWhatFails(Make&& make) {
  const std::string expected = make();
  REQUIRE(!expected.empty());
  for (const auto mode : {FailingAllocation::Mode::kOnce, FailingAllocation::Mode::kFromThenOn}) {
    const uint64_t last = FailEachAllocation(
        mode, [&] { return TextOrNothing(make); },
        [&](uint64_t n, const std::string& text) {
          INFO("allocation " << n);
          REQUIRE((text.empty() || text == expected));
        });
    CHECK(last > 5);
  }
}

constexpr const char* kQuery =
    R"({"region":{"union":[{"point":[1,2,3]},{"box":{"min":[0,0,0],"max":[1,1,1]}}]},"clip":true})";

TEST_CASE("a JSON value that is made, read, copied or written survives a lack of memory",
          "[server]") {
  RequireNoMatterWhatFails([] {
    Json json = {{"list", {1, 2, {{"deep", {"text that is no short one", nullptr, 1.5}}}}}};
    json["more"] = Json::Array();
    json["more"].push_back({{"key", "value"}});
    const Json copy = json;
    json = {};
    return copy.Text();
  });
  RequireNoMatterWhatFails([] { return Json::Parse(kQuery)->Text(); });
}

TEST_CASE("what a server reads and says survives a lack of memory", "[server]") {
  RequireNoMatterWhatFails([] { return ErrorAnswer(400, "bad_query", "no such query").body; });
  RequireNoMatterWhatFails([] {
    ObjectRecord record;
    record.name = "a name that is not short";
    record.attributes.attributes = {{"quality", ScalarType::kFloat32}};
    return CatalogJson({record, record}).Text() + RecordJson(record, 4096).Text();
  });
  RequireNoMatterWhatFails([] {
    std::optional<uint64_t> id;
    const auto request = ParseSessionRequest(SessionRequestText({7, kQuery}), &id);
    return request.ok() ? request->query : "";
  });
  RequireNoMatterWhatFails([] {
    SessionReply reply;
    reply.kind = SessionReply::Kind::kDone;
    reply.id = 3;
    reply.done.limit = "accuracy";
    reply.done.shortfall = {3, 0.1, {{-1, 0, 0.3}, {2, 3, 4e9}}};
    const auto read = ParseSessionReply(SessionReplyText(reply));
    return read.ok() ? SessionReplyText(*read) : "";
  });
  RequireNoMatterWhatFails([] {
    const auto target = ParseTarget(
        "/objects/a/mesh?sphere=1,2,3,4&point=5,6,7&error-at=linear,1,2,3,4,5&error=10%25"
        "&frustum&eye=1,2,3&target=4,5,6&clip&format=glb");
    if (!target.ok()) return std::string();
    const auto request = ParseMeshRequest(*target, "");
    return request.ok() ? request->query.Text() : "";
  });
  RequireNoMatterWhatFails([] {
    const auto target = ParseTarget("/objects/a/mesh");
    if (!target.ok()) return std::string();
    const auto request = ParseMeshRequest(*target, kQuery);
    return request.ok() ? request->query.Text() : "";
  });
}

TEST_CASE("values of many threads go away without memory", "[server]") {
  constexpr size_t kThreads = 4;
  std::vector<Json::Array> values(kThreads);
  for (Json::Array& of_thread : values) {
    for (int i = 0; i < 200; ++i)
      of_thread.push_back({{"a", {1, {2, {3, {4}}}}}, {"b", {{"c", i}}}});
  }
  std::atomic<size_t> started = 0;
  std::atomic<bool> go = false;
  std::vector<std::thread> threads;
  for (Json::Array& of_thread : values) {
    threads.emplace_back([&] {
      ++started;
      while (!go) std::this_thread::yield();
      while (!of_thread.empty()) of_thread.pop_back();
    });
  }
  while (started < kThreads) std::this_thread::yield();
  uint64_t asked = 0;
  {
    const FailingAllocation failing(1, FailingAllocation::Mode::kFromThenOn);
    go = true;
    for (std::thread& thread : threads) thread.join();
    asked = failing.failures();
  }
  CHECK(asked == 0);
}

}  // namespace
}  // namespace mtdb::test
