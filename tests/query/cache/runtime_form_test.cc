// SPDX-License-Identifier: Apache-2.0
// The implicit form: payloads are kept, queries decode.
#include <atomic>
#include <catch2/catch.hpp>
#include <random>
#include <thread>

#include "query/cache/cluster_cache.h"
#include "query/cache/unit_reader.h"
#include "query/surface.h"
#include "query/verify_object.h"
#include "tests/query/mt_fixture.h"
#include "tests/query/oracle.h"

namespace mtdb::testing {

using namespace internal;

namespace {

constexpr size_t kAmple = size_t{256} << 20;

MtFixture Fixture(uint32_t seed) {
  MtOptions o;
  o.shape = static_cast<Shape>(seed % 4);
  o.resolution = 24;
  o.rounds = 4;
  o.tiles = 16;
  o.attributes = true;
  o.seed = seed;
  return MakeMt(o);
}

std::shared_ptr<Surface> Open(const MtFixture& f, RuntimeForm form, size_t cache_bytes = kAmple,
                              unsigned threads = 1) {
  SurfaceOptions options;
  options.cache_bytes = cache_bytes;
  options.form = form;
  options.threads = threads;
  return Surface::Open(f.source, options).value();
}

size_t PayloadBytes(const MtFixture& f) {
  size_t bytes = 0;
  for (const Bytes& payload : f.source->payloads_) bytes += payload.size();
  return bytes;
}

Result<TriangleMesh> Extract(const Surface& surface, const Query& query,
                             ExtractStats* stats = nullptr) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  MTDB_ASSIGN_OR_RETURN(const ExtractStats all, surface.Extract(query, sink));
  if (stats != nullptr) *stats = all;
  return mesh;
}

bool SameMesh(const TriangleMesh& a, const TriangleMesh& b) {
  return a.positions == b.positions && a.triangles == b.triangles && a.rows == b.rows;
}

std::vector<Query> SomeQueries(const MtFixture& f, std::mt19937& random) {
  std::vector<Query> queries{Query{}};
  for (int i = 0; i < 8; ++i) queries.push_back(RandomQuery(f, random));
  queries[3].max_triangles = 400;
  return queries;
}

TEST_CASE("Both forms give the same answers, in caches of any size that is enough") {
  std::mt19937 random(1);
  for (uint32_t seed = 1; seed <= 4; ++seed) {
    const MtFixture f = Fixture(seed);
    const auto listed = Open(f, RuntimeForm::kExplicit);
    for (const Query& query : SomeQueries(f, random)) {
      const TriangleMesh expected = Extract(*listed, query).value();
      size_t refused = 0;
      for (size_t bytes = 1000; bytes < kAmple; bytes *= 3) {
        const auto small = Open(f, RuntimeForm::kImplicit, bytes);
        for (int again = 0; again < 2; ++again) {
          const Result<TriangleMesh> mesh = Extract(*small, query);
          REQUIRE(small->cache().peak_bytes() <= bytes);
          if (mesh.ok()) {
            REQUIRE(SameMesh(*mesh, expected));
          } else {
            REQUIRE(mesh.status().code() == StatusCode::kBudgetExceeded);
            ++refused;
          }
        }
      }
      REQUIRE(refused > 0);
    }
  }
}

TEST_CASE("Between queries the implicit form keeps payloads only, and reads none of them again") {
  const MtFixture f = Fixture(3);
  const uint32_t units = f.source->index_.unit_count();
  const auto surface = Open(f, RuntimeForm::kImplicit);
  ExtractStats stats;
  Extract(*surface, Query{}, &stats).value();
  REQUIRE(stats.clusters_read == stats.clusters_total);
  REQUIRE(surface->cache().bytes() == PayloadBytes(f));
  REQUIRE(surface->cache().peak_bytes() > 5 * PayloadBytes(f));
  REQUIRE(surface->cache().decoded() == units);
  REQUIRE(f.source->reads_ == units);
  Extract(*surface, Query{}, &stats).value();
  REQUIRE(stats.clusters_read == 0);
  REQUIRE(stats.bytes_read == 0);
  REQUIRE(stats.clusters_cached == stats.clusters_total);
  REQUIRE(surface->cache().bytes() == PayloadBytes(f));
  REQUIRE(surface->cache().decoded() == 2 * units);
  REQUIRE(f.source->reads_ == units);
  // A cut that lives keeps what it needs.
  {
    Query query;
    query.region = SphereRegion({0, 0, 0}, 100);
    const Cut cut = surface->Select(query).value();
    REQUIRE(surface->cache().bytes() > 5 * PayloadBytes(f));
  }
  REQUIRE(surface->cache().bytes() == PayloadBytes(f));
}

TEST_CASE("Payloads that are kept do not count as bytes to be read") {
  const MtFixture f = Fixture(3);
  const auto surface = Open(f, RuntimeForm::kImplicit);
  Extract(*surface, Query{}).value();
  Query query;
  query.max_bytes = 0;
  ExtractStats stats;
  REQUIRE(Extract(*surface, query, &stats).value().triangles.size() == f.source->record_.triangles);
  REQUIRE(stats.bytes_read == 0);
}

TEST_CASE("Payloads take half of the budget at most, the oldest go first") {
  const MtFixture f = Fixture(3);
  const size_t budget = PayloadBytes(f);
  ClusterCache cache(f.source, {kAmple, 1, RuntimeForm::kImplicit});
  LoadStats stats;
  REQUIRE(cache.Get(0, &stats).ok());
  REQUIRE(cache.bytes() < budget);  // of the unit and its ancestors
  const auto surface = Open(f, RuntimeForm::kImplicit, 6 * budget);
  Extract(*surface, Query{}).value();
  REQUIRE(surface->cache().bytes() == budget);  // all of them
  size_t tight = budget;
  for (;; tight += budget / 16) {
    const auto small = Open(f, RuntimeForm::kImplicit, tight);
    if (!Extract(*small, Query{}).ok()) continue;
    REQUIRE(small->cache().bytes() <= tight / 2);
    REQUIRE(small->cache().bytes() > 0);
    break;
  }
  REQUIRE(tight < 6 * budget);
}

TEST_CASE("Threads that share an implicit surface get the answers of one alone", "[threads]") {
  std::mt19937 random(7);
  const MtFixture f = Fixture(2);
  const std::vector<Query> queries = SomeQueries(f, random);
  std::vector<TriangleMesh> expected;
  const auto listed = Open(f, RuntimeForm::kExplicit);
  for (const Query& query : queries) expected.push_back(Extract(*listed, query).value());
  const auto surface = Open(f, RuntimeForm::kImplicit, kAmple, 3);
  std::atomic<int> wrong{0};
  std::vector<std::thread> threads;
  for (size_t t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      for (size_t i = 0; i < 3 * queries.size(); ++i) {
        const size_t q = (i + t) % queries.size();
        const Result<TriangleMesh> mesh = Extract(*surface, queries[q]);
        if (!mesh.ok() || !SameMesh(*mesh, expected[q])) ++wrong;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  REQUIRE(wrong == 0);
  // Its threads may be at what a query no longer wanted.
  while (surface->cache().bytes() > PayloadBytes(f)) std::this_thread::yield();
}

TEST_CASE("An implicit surface is verified with every unit decoded once") {
  const MtFixture f = Fixture(1);
  const auto surface = Open(f, RuntimeForm::kImplicit);
  CheckReport report;
  REQUIRE(VerifyObject(*surface, VerifyLevel::kFull, &report).ok());
  REQUIRE(surface->cache().decoded() == f.source->index_.unit_count());
}

}  // namespace
}  // namespace mtdb::testing
