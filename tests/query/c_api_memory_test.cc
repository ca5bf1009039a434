// SPDX-License-Identifier: Apache-2.0
// The C interface that writes, follows and draws, while memory runs out: an error, and nothing
// lost.
#include <array>
#include <catch2/catch.hpp>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/support/failing_allocation.h"
#include "tests/support/temporary_folder.h"
#include "tools/c/mtdb_follow.h"
#include "tools/c/mtdb_show.h"
#include "tools/c/mtdb_write.h"

namespace mtdb::testing {
namespace {

struct Square {
  std::vector<double> positions;
  std::vector<uint32_t> indices;

  explicit Square(uint32_t side) {
    for (uint32_t y = 0; y < side; ++y) {
      for (uint32_t x = 0; x < side; ++x) {
        positions.insert(positions.end(), {x * 0.5, y * 0.5, (x * y % 7) * 0.25});
        if (x + 1 == side || y + 1 == side) continue;
        const uint32_t a = y * side + x;
        indices.insert(indices.end(), {a, a + 1, a + side + 1, a, a + side + 1, a + side});
      }
    }
  }
  mtdb_input Input() const {
    mtdb_input input;
    MTDB_INIT(input);
    input.vertices = positions.size() / 3;
    input.triangles = indices.size() / 3;
    input.positions = positions.data();
    input.indices = indices.data();
    return input;
  }
};

int Feed(void* client, const unsigned char* bytes, size_t size) {
  return mtdb_feed_client(static_cast<mtdb_client*>(client), bytes, size, nullptr);
}

// Each allocation of `run` fails in turn, at most some hundreds of them; it must say so, or have
// done without. Then it works again.
template <typename Run>
void FailSome(const char* what, Run&& run) {
  INFO(what);
  uint64_t failures = 0;
  for (uint64_t n = 1; n < 100'000; n += 1 + n / 16) {
    uint64_t failed = 0;
    mtdb_code code = MTDB_OK;
    {
      const FailingAllocation failing(n, FailingAllocation::Mode::kOnce);
      code = run();
      failed = failing.failures();
    }
    if (failed == 0) break;
    ++failures;
    INFO("allocation " << n);
    REQUIRE((code == MTDB_OK || code == MTDB_NO_SPACE || code == MTDB_CANCELLED));
  }
  CHECK(failures > 3);
  CHECK(run() == MTDB_OK);
}

TEST_CASE("C that lacks memory to write, follow and draw says so and goes on", "[c_api]") {
  const TemporaryFolder folder;
  const Square square(12);
  const mtdb_input input = square.Input();
  const std::string path = folder.path() + "/a.mtdb";
  mtdb_database* database = nullptr;
  REQUIRE(mtdb_open_writable(path.c_str(), &database, nullptr) == MTDB_OK);
  mtdb_ingest_options options;
  MTDB_INIT(options);
  options.replace = 1;
  options.threads = 1;
  REQUIRE(mtdb_ingest_arrays(database, "a", &input, &options, nullptr, nullptr) == MTDB_OK);
  FailSome("ingest",
           [&] { return mtdb_ingest_arrays(database, "a", &input, &options, nullptr, nullptr); });
  mtdb_object* object = nullptr;
  REQUIRE(mtdb_open_object(database, "a", nullptr, &object, nullptr) == MTDB_OK);
  FailSome("mesh", [&] {
    mtdb_cut* cut = nullptr;
    mtdb_mesh* mesh = nullptr;
    mtdb_code code = mtdb_select(object, nullptr, nullptr, &cut, nullptr);
    if (code == MTDB_OK) code = mtdb_get_cut_mesh(cut, nullptr, &mesh, nullptr);
    mtdb_free_cut(cut);
    mtdb_free_mesh(mesh);
    return code;
  });
  FailSome("session", [&] {
    mtdb_session* session = nullptr;
    mtdb_client* client = nullptr;
    mtdb_code code = mtdb_open_session(object, nullptr, &session, nullptr);
    if (code == MTDB_OK) code = mtdb_create_client(nullptr, &client, nullptr);
    if (code == MTDB_OK) {
      code = mtdb_update_session(session, nullptr, nullptr, Feed, client, nullptr, nullptr);
    }
    mtdb_mesh* mesh = nullptr;
    if (code == MTDB_OK) code = mtdb_get_client_mesh(client, &mesh, nullptr);
    mtdb_free_mesh(mesh);
    mtdb_free_client(client);
    mtdb_free_session(session);
    return code;
  });
  FailSome("json", [&] {
    mtdb_json* json = nullptr;
    const mtdb_code code = mtdb_get_object_json(object, &json, nullptr);
    mtdb_free_json(json);
    return code;
  });
  mtdb_free_object(object);
  mtdb_free_database(database);
}

}  // namespace
}  // namespace mtdb::testing
