// SPDX-License-Identifier: Apache-2.0
// A lack of memory at every allocation of a build: an error, and the next build works.
#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>

#include "store/verify_store.h"
#include "tests/builder/fixture.h"
#include "tests/support/failing_allocation.h"
#include "tests/support/temporary_folder.h"

namespace mtdb::testing {
namespace {

using Mode = FailingAllocation::Mode;

// With an attribute, and enough tiles for two rounds.
TriangleMesh MakeSmallMesh() {
  TriangleMesh mesh = MakeSculpture(600);
  NumberVertices(&mesh);
  return mesh;
}

size_t FilesIn(const std::string& folder) {
  size_t files = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder)) ++files;
  return files;
}

}  // namespace

TEST_CASE("Memory that runs out at any allocation of a build is an error, and a later one works") {
  const TriangleMesh mesh = MakeSmallMesh();
  const std::string expected = [&] {
    BuildOptions options;
    options.tile_triangles = 128;
    return Build(mesh, options).record.digest_hex();
  }();
  for (const unsigned threads : {1u, 3u}) {
    for (const Mode mode : {Mode::kOnce, Mode::kFromThenOn}) {
      const TemporaryFolder folder;
      TempStore store;
      BuildOptions options;
      options.threads = threads;
      options.tile_triangles = 128;
      options.tmp_directory = folder.path();
      options.journal_path = folder.path() + "/journal";
      uint64_t published = 0;
      // Later allocations are left out more and more; all kinds of them come.
      uint64_t n = 1;
      for (bool reached = true; reached; n += 1 + n / (threads == 1 ? 16 : 8)) {
        INFO("threads " << threads << ", allocation " << n << (mode == Mode::kOnce ? "" : " on"));
        options.resume = n % 2 == 0;
        std::unique_ptr<ObjectWriter> writer = store.database().Create("object", true).value();
        Result<ObjectRecord> record = [&] {
          const FailingAllocation failing(n, mode);
          Result<ObjectRecord> result = BuildObject(mesh, options, *writer);
          reached = failing.failures() > 0;
          return result;
        }();
        writer.reset();
        if (record.ok()) {  // a thread less, or the journal's last word
          REQUIRE(record->digest_hex() == expected);
          ++published;
        } else {
          INFO(record.status().message());
          REQUIRE(reached);
          REQUIRE((record.status().code() == StatusCode::kNoSpace ||
                   record.status().code() == StatusCode::kIoError));
        }
        REQUIRE(FilesIn(folder.path()) <= 1);  // the journal
      }
      CHECK(n > 100);
      CHECK(published >= 1);
      options.resume = true;
      const auto record = BuildInto(store.database(), "again", mesh, options);
      INFO(record.status().message());
      REQUIRE(record.ok());
      REQUIRE(record->digest_hex() == expected);
      REQUIRE(FilesIn(folder.path()) == 0);
      CheckReport report;
      REQUIRE(VerifyStore(store.path(), "", &report).ok());
      REQUIRE(report.failures == std::vector<std::string>{});
    }
  }
}

}  // namespace mtdb::testing
