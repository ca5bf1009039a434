// SPDX-License-Identifier: Apache-2.0
// Sources that answer late, out of order, with errors, or not at all.
#include "tests/query/late_source.h"

#include <array>
#include <atomic>
#include <catch2/catch.hpp>
#include <chrono>
#include <thread>

#include "query/cache/cluster_cache.h"
#include "query/surface.h"
#include "store/base/hash.h"
#include "tests/query/mt_fixture.h"

namespace mtdb::testing {

using namespace internal;

namespace {

MtFixture Fixture() { return MakeTorus(24, 16); }

Query BallOf(const MtFixture& f, double part) {
  Query query;
  const Box3d& bounds = f.source->record_.bounds;
  query.region = SphereRegion(bounds.min, part * f.source->record_.diagonal());
  query.threshold = ConstantThreshold(0);
  return query;
}

Result<TriangleMesh> ExtractMesh(const Surface& surface, const Query& query) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  MTDB_RETURN_IF_ERROR(surface.Extract(query, sink).status());
  return mesh;
}

bool SameMesh(const TriangleMesh& a, const TriangleMesh& b) {
  return a.positions == b.positions && a.triangles == b.triangles && a.rows == b.rows;
}

TriangleMesh Expected(const MtFixture& f, const Query& query) {
  return ExtractMesh(*Surface::Open(f.source).value(), query).value();
}

}  // namespace

TEST_CASE("a late source is asked in batches in the order of their places, once for each unit") {
  const MtFixture f = Fixture();
  for (const unsigned threads : {1u, 3u}) {
    for (const Query& query : {Query{}, BallOf(f, 0.4)}) {
      for (const bool late_rows : {false, true}) {
        const auto source =
            std::make_shared<LateSource>(f.source, LateOptions{.late_rows = late_rows});
        const uint64_t reads = f.source->reads_;
        {
          const auto surface = Surface::Open(source, {.threads = threads}).value();
          REQUIRE(SameMesh(*ExtractMesh(*surface, query), Expected(f, query)));
          REQUIRE(f.source->reads_ - reads <= 2 * f.source->index_.unit_count());
          REQUIRE(surface->cache().idle());
        }
        REQUIRE(source->in_order());
        REQUIRE(source->largest_batch() > 1);
      }
    }
  }
}

TEST_CASE("units fail one by one, by name, and a query that does not need them works") {
  const MtFixture f = Fixture();
  const Query everything;
  std::atomic<UnitId> bad{0};
  LateOptions options;
  options.fails = [&](UnitId unit) {
    return unit == bad ? IoError(UnitName(f.source->record_, unit) + ": the line is dead")
                       : Status::Ok();
  };
  const auto source = std::make_shared<LateSource>(f.source, options);
  for (UnitId unit = 0; unit < f.source->index_.unit_count(); unit += 3) {
    bad = unit;
    const auto surface = Surface::Open(source, {.threads = 2}).value();
    const Status status = ExtractMesh(*surface, everything).status();
    REQUIRE(status.code() == StatusCode::kIoError);
    REQUIRE(status.message().find(UnitName(f.source->record_, unit) + ":") != std::string::npos);
    // The same surface once the unit can be had.
    bad = kNone32;
    REQUIRE(SameMesh(*ExtractMesh(*surface, everything), Expected(f, everything)));
    REQUIRE(surface->cache().idle());
  }
  // The coarsest mesh needs no cluster.
  bad = 0;
  Query coarse;
  coarse.threshold = ConstantThreshold(1e30);
  const auto surface = Surface::Open(source).value();
  REQUIRE(SameMesh(*ExtractMesh(*surface, coarse), Expected(f, coarse)));
}

TEST_CASE("a payload that the index does not describe is refused") {
  const MtFixture f = Fixture();
  const auto source = std::make_shared<LateSource>(f.source, LateOptions{});
  f.source->payloads_[0].push_back(std::byte{0});
  const auto surface = Surface::Open(source).value();
  REQUIRE(ExtractMesh(*surface, Query{}).status().code() == StatusCode::kCorrupt);
}

TEST_CASE("a cancelled query ends though nothing is answered, and so does the surface") {
  const MtFixture f = Fixture();
  const auto source = std::make_shared<LateSource>(f.source, LateOptions{.own_thread = false});
  for (const size_t answers : {size_t{0}, size_t{1}, size_t{5}}) {
    const auto surface = Surface::Open(source, {.threads = 2}).value();
    QueryControl control;
    Query query;
    query.control = &control;
    Status status;
    std::thread asker([&] { status = ExtractMesh(*surface, query).status(); });
    size_t answered = 0;
    while (answered < answers) answered += source->Pump(1);
    while (source->open() == 0) std::this_thread::yield();
    control.Cancel();
    asker.join();
    REQUIRE(status.code() == StatusCode::kCancelled);
    // Nobody wants the rest.
    REQUIRE(source->open() == 0);
    REQUIRE(surface->cache().idle());
  }
  REQUIRE(source->cancelled() > 0);
  // A surface goes while its payloads are on their way.
  {
    const auto surface = Surface::Open(source, {.waits = false}).value();
    REQUIRE(ExtractMesh(*surface, Query{}).status().code() == StatusCode::kNotYet);
    REQUIRE(source->open() > 0);
  }
  REQUIRE(source->open() == 0);
}

TEST_CASE("what does not wait says so, and is complete when all has come") {
  const MtFixture f = Fixture();
  for (const bool late_rows : {false, true}) {
    for (const size_t at_a_time : {size_t{1}, size_t{7}, size_t{1000}}) {
      const auto source = std::make_shared<LateSource>(
          f.source, LateOptions{.own_thread = false, .late_rows = late_rows});
      const auto surface = Surface::Open(source, {.waits = false}).value();
      for (const Query& query : {BallOf(f, 0.3), Query{}}) {
        auto mesh = ExtractMesh(*surface, query);
        int rounds = 0;
        while (mesh.status().code() == StatusCode::kNotYet) {
          REQUIRE(mesh.status().message().find("fixture: ") == 0);
          // With nothing asked for, another thread decodes what has come.
          if (source->Pump(at_a_time) == 0) {
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
          }
          REQUIRE(++rounds < 10000);
          mesh = ExtractMesh(*surface, query);
        }
        REQUIRE(mesh.status().message() == "");
        REQUIRE(SameMesh(*mesh, Expected(f, query)));
      }
      REQUIRE(surface->cache().idle());
      surface->cache().CancelReads();
      REQUIRE(source->open() == 0);
    }
  }
}

TEST_CASE("queries that cross, fail and are cancelled all end within the budget", "[threads]") {
  const MtFixture f = Fixture();
  size_t all = 0;
  {
    const auto surface = Surface::Open(f.source).value();
    REQUIRE(ExtractMesh(*surface, Query{}).ok());
    all = surface->cache().bytes();
  }
  const std::array queries{Query{}, BallOf(f, 0.2), BallOf(f, 0.5)};
  std::vector<TriangleMesh> expected;
  for (const Query& query : queries) expected.push_back(Expected(f, query));
  for (const size_t budget : {2 * all, 3 * all / 5, all / 2}) {
    for (const RuntimeForm form : {RuntimeForm::kExplicit, RuntimeForm::kImplicit}) {
      for (const double failing : {0.0, 0.02}) {
        std::atomic<uint64_t> random{1};
        LateOptions options;
        options.fails = [&](UnitId) {
          const uint64_t r = Mix64(random.fetch_add(1));
          return static_cast<double>(r % 1000) < 1000 * failing ? IoError("lost") : Status::Ok();
        };
        const auto source = std::make_shared<LateSource>(f.source, options);
        const auto surface =
            Surface::Open(source, {.cache_bytes = budget, .form = form, .threads = 2}).value();
        std::mutex mutex;
        std::vector<std::string> wrong;
        std::vector<std::thread> askers;
        for (unsigned t = 0; t < 4; ++t) {
          askers.emplace_back([&, t] {
            for (unsigned i = 0; i < 6; ++i) {
              const size_t q = (t + i) % queries.size();
              QueryControl control;
              Query query = queries[q];
              query.control = &control;
              const bool cancels = (t + i) % 5 == 0;
              if (cancels) control.Cancel();
              const auto mesh = ExtractMesh(*surface, query);
              const StatusCode code = mesh.status().code();
              const bool lost = code == StatusCode::kIoError && failing > 0;
              if (mesh.ok() ? SameMesh(*mesh, expected[q])
                            : (code == StatusCode::kCancelled && cancels) || lost) {
                continue;
              }
              const std::lock_guard lock(mutex);
              wrong.push_back(mesh.status().message());
            }
          });
        }
        for (std::thread& t : askers) t.join();
        INFO(budget << " of " << all << " bytes, " << failing);
        REQUIRE(wrong == std::vector<std::string>());
        while (!surface->cache().idle()) std::this_thread::yield();  // workers end what they began
        REQUIRE(surface->cache().peak_bytes() <= budget);
      }
    }
  }
}

TEST_CASE("a cut over a late source is that over any other, node for node") {
  const MtFixture f = Fixture();
  const auto late = Surface::Open(std::make_shared<LateSource>(f.source, LateOptions{})).value();
  const auto whole = Surface::Open(f.source).value();
  for (const double part : {0.1, 0.6, 0.3}) {
    const Query query = BallOf(f, part);
    const auto a = late->Select(query);
    const auto b = whole->Select(query);
    REQUIRE(a.ok());
    for (UnitId u = 0; u < f.source->index_.cluster_count(); ++u) {
      for (NodeIndex i = 0; i < f.source->index_.unit(u).nodes; ++i) {
        REQUIRE(a->applied(u, i) == b->applied(u, i));
      }
    }
  }
}

}  // namespace mtdb::testing
