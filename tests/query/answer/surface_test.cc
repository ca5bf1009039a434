// SPDX-License-Identifier: Apache-2.0
// Surfaces as their callers see them: streaming, caching, threads, bad sources.
#include "query/surface.h"

#include <array>
#include <atomic>
#include <catch2/catch.hpp>
#include <chrono>
#include <cstring>
#include <functional>
#include <map>
#include <thread>

#include "query/cache/cluster_cache.h"
#include "query/cache/unit_reader.h"
#include "query/query_control.h"
#include "query/verify_object.h"
#include "tests/query/mt_fixture.h"
#include "tests/query/oracle.h"
#include "tests/support/mesh_check.h"

namespace mtdb::testing {

using namespace internal;

namespace {

MtOptions Medium(uint32_t seed) {
  MtOptions o;
  o.shape = static_cast<Shape>(seed % 4);
  o.resolution = 24;
  o.rounds = 4;
  o.tiles = 16;
  o.attributes = true;
  o.coincident = seed % 8 >= 4;
  o.seed = seed;
  return o;
}

std::shared_ptr<Surface> Open(const MtFixture& f, size_t cache_bytes = size_t{256} << 20,
                              unsigned threads = 2) {
  SurfaceOptions options;
  options.cache_bytes = cache_bytes;
  options.threads = threads;
  return Surface::Open(f.source, options).value();
}

TriangleMesh Extract(const Surface& surface, const Query& query, ExtractStats* stats = nullptr) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  Result<ExtractStats> result = surface.Extract(query, sink);
  INFO(result.status().message());
  REQUIRE(result.ok());
  if (stats != nullptr) *stats = *result;
  return mesh;
}

bool SameMesh(const TriangleMesh& a, const TriangleMesh& b) {
  return a.positions == b.positions && a.triangles == b.triangles && a.rows == b.rows &&
         a.header.vertex_count == b.header.vertex_count &&
         a.header.triangle_count == b.header.triangle_count;
}

// A region that is all of space but does not say so: takes the general path.
RegionPtr Everywhere(const MtFixture& f) {
  Box3d box = f.source->record_.bounds;
  box.min = box.min - Vec3d{1, 1, 1};
  box.max = box.max + Vec3d{1, 1, 1};
  return BoxRegion(box);
}

}  // namespace

TEST_CASE("The streamed full resolution equals the input and the general path") {
  for (uint32_t seed = 1; seed <= 8; ++seed) {
    const MtFixture f = MakeMt(Medium(seed));
    const ObjectRecord& record = f.source->record_;
    ExtractStats streamed_stats;
    ExtractStats general_stats;
    const TriangleMesh streamed = Extract(*Open(f), Query{}, &streamed_stats);
    Query query;
    query.region = Everywhere(f);
    const TriangleMesh general = Extract(*Open(f), query, &general_stats);
    REQUIRE(SameMesh(streamed, general));
    REQUIRE(streamed.triangles.size() == record.triangles);
    REQUIRE(streamed.positions.size() == record.vertices);
    REQUIRE(streamed_stats.active_triangles == general_stats.active_triangles);
    REQUIRE(streamed_stats.nodes_applied == general_stats.nodes_applied);
    REQUIRE(streamed_stats.clusters_used == general_stats.clusters_used);
    REQUIRE(streamed_stats.error_bound == record.rounding_error);
    REQUIRE(general_stats.error_bound == record.rounding_error);
    REQUIRE(streamed_stats.clusters_read == record.clusters);
    REQUIRE(CheckMesh(streamed).ok());
  }
}

TEST_CASE("Vertices carry the attributes that they had in the input") {
  MtOptions o = Medium(1);
  o.coincident = false;
  const MtFixture f = MakeMt(o);
  const size_t row = f.source->record_.attributes.row_bytes();
  REQUIRE(row == 5);
  std::map<std::array<double, 3>, Bytes> expected;
  for (size_t v = 0; v < f.mt.positions.size(); ++v) {
    const Vec3d p = f.source->record_.grid.Position(f.mt.positions[v]);
    const auto begin = f.rows.begin() + static_cast<std::ptrdiff_t>(v * row);
    expected[{p.x, p.y, p.z}] = Bytes(begin, begin + static_cast<std::ptrdiff_t>(row));
  }
  Query query;
  query.threshold = ConstantThreshold(0.05);
  for (const Query& q : {Query{}, query}) {
    const TriangleMesh mesh = Extract(*Open(f), q);
    for (size_t v = 0; v < mesh.positions.size(); ++v) {
      const Vec3d& p = mesh.positions[v];
      const auto begin = mesh.rows.begin() + static_cast<std::ptrdiff_t>(v * row);
      REQUIRE(expected.at({p.x, p.y, p.z}) ==
              Bytes(begin, begin + static_cast<std::ptrdiff_t>(row)));
    }
  }
}

TEST_CASE("Normals are those of the cut's triangles, also where it is clipped") {
  std::mt19937 random(21);
  for (uint32_t seed = 1; seed <= 4; ++seed) {
    MtOptions o = Medium(seed);
    o.coincident = false;
    const MtFixture f = MakeMt(o);
    const auto surface = Open(f);
    for (int i = 0; i < 8; ++i) {
      Query query = i == 0 ? Query{} : RandomQuery(f, random);
      const TriangleMesh plain = Extract(*surface, query);
      std::map<std::array<double, 3>, Vec3d> sums;
      for (const TriangleVertices& t : plain.triangles) {
        const Vec3d a = plain.positions[t[0]];
        const Vec3d n = Cross(plain.positions[t[1]] - a, plain.positions[t[2]] - a);
        for (const VertexIndex v : t) {
          const Vec3d& p = plain.positions[v];
          sums[{p.x, p.y, p.z}] += n;
        }
      }
      query.normals = true;
      query.clip = i % 2 == 0;
      const TriangleMesh mesh = Extract(*surface, query);
      const size_t row = mesh.header.attributes.row_bytes();
      REQUIRE(row == plain.header.attributes.row_bytes() + sizeof(Vec3f));
      REQUIRE(mesh.rows.size() == mesh.positions.size() * row);
      for (size_t v = 0; v < mesh.positions.size(); ++v) {
        const Vec3d& p = mesh.positions[v];
        const Vec3d& sum = sums.at({p.x, p.y, p.z});
        Vec3f n;
        std::memcpy(&n, mesh.rows.data() + (v + 1) * row - sizeof(n), sizeof(n));
        const Vec3d difference = sum * (1 / Length(sum)) - Vec3d{n.x, n.y, n.z};
        REQUIRE(Length(difference) < 1e-6);
      }
    }
  }
}

TEST_CASE("An object with a part of normals gets no others") {
  const MtFixture f = MakeMt(Medium(1));
  f.source->record_.attributes.attributes[0].name = "ny";
  Query query;
  query.normals = true;
  REQUIRE(Open(f)->Select(query).status().code() == StatusCode::kInvalidArgument);
}

TEST_CASE("Active triangles come first") {
  std::mt19937 random(22);
  const MtFixture f = MakeMt(Medium(3));
  const auto surface = Open(f);
  uint64_t mixed = 0;
  for (int i = 0; i < 40; ++i) {
    const Query query = RandomQuery(f, random);
    ExtractStats stats;
    const TriangleMesh mesh = Extract(*surface, query, &stats);
    REQUIRE(stats.active_triangles <= stats.triangles);
    mixed += stats.active_triangles > 0 && stats.active_triangles < stats.triangles;
    // What meets the region is active.
    for (size_t t = stats.active_triangles; t < mesh.triangles.size(); ++t) {
      const TriangleVertices& v = mesh.triangles[t];
      REQUIRE_FALSE(query.region->Within(
          {mesh.positions[v[0]], mesh.positions[v[1]], mesh.positions[v[2]]}, 0));
    }
  }
  REQUIRE(mixed > 5);
}

TEST_CASE("A budget below the root gives the root, and one above everything gives everything") {
  const MtFixture f = MakeMt(Medium(2));
  const auto surface = Open(f);
  Query query;
  query.max_triangles = 0;
  ExtractStats stats;
  REQUIRE(Extract(*surface, query, &stats).triangles.size() == f.source->record_.root_triangles);
  REQUIRE(stats.nodes_applied == 0);
  REQUIRE(stats.error_bound > 0.01);
  query.max_triangles = f.source->record_.triangles;
  REQUIRE(Extract(*surface, query, &stats).triangles.size() == f.source->record_.triangles);
  REQUIRE(stats.error_bound == f.source->record_.rounding_error);
}

TEST_CASE("Bytes in the cache are free, and a smaller budget never reads or refines more") {
  const MtFixture f = MakeMt(Medium(3));
  uint64_t root_bytes = 0;
  for (const Bytes& payload : f.source->root_payloads()) root_bytes += payload.size();
  Query query;
  uint64_t triangles = 0;
  double error = 1e9;
  ExtractStats stats;
  bool partial = false;
  for (uint64_t bytes = 0; triangles < f.source->record_.triangles; bytes += 4000) {
    query.max_bytes = bytes;
    // A cache that holds little: what was read is kept by the query.
    const auto surface = Open(f, size_t{400000}, 1);
    const TriangleMesh mesh = Extract(*surface, query, &stats);
    REQUIRE(CheckMesh(mesh).ok());
    REQUIRE(stats.bytes_read <= std::max(bytes, root_bytes));
    REQUIRE(stats.triangles >= triangles);
    REQUIRE(stats.error_bound <= error);
    partial |= stats.limit == QueryLimit::kBytes && stats.nodes_applied > 0;
    triangles = stats.triangles;
    error = stats.error_bound;
  }
  REQUIRE(partial);
  REQUIRE(stats.limit == QueryLimit::kThreshold);
  const auto warm = Open(f);
  Extract(*warm, Query{});
  query.max_bytes = 0;
  Extract(*warm, query, &stats);
  REQUIRE(stats.bytes_read == 0);
  REQUIRE(stats.triangles == f.source->record_.triangles);
}

TEST_CASE("When the time is over, the answer is what was found till then") {
  const MtFixture f = MakeMt(Medium(3));
  const auto slow_source = [&](uint32_t) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    return Status::Ok();
  };
  f.source->on_read_ = slow_source;
  ExtractStats stats;
  Query query;
  query.max_milliseconds = 20;
  const TriangleMesh mesh = Extract(*Open(f), query, &stats);
  REQUIRE(CheckMesh(mesh).ok());
  REQUIRE(stats.limit == QueryLimit::kTime);
  REQUIRE(stats.nodes_applied < f.source->record_.nodes);
  REQUIRE(stats.error_bound > 0.01);
  f.source->on_read_ = nullptr;
  query.max_milliseconds = 1e9;
  Extract(*Open(f), query, &stats);
  REQUIRE(stats.limit == QueryLimit::kThreshold);
  REQUIRE(stats.triangles == f.source->record_.triangles);
  query.max_milliseconds = 0;
  Extract(*Open(f), query, &stats);
  REQUIRE(stats.triangles == f.source->record_.root_triangles);
}

TEST_CASE("A query reads no cluster that the index proves unnecessary") {
  const MtFixture f = MakeMt(Medium(3));
  Query query;
  query.threshold = CoarsestThreshold();
  ExtractStats stats;
  Extract(*Open(f), query, &stats);
  REQUIRE(stats.clusters_read == 0);
  query.threshold = nullptr;
  query.region = SphereRegion({100, 100, 100}, 1);
  Extract(*Open(f), query, &stats);
  REQUIRE(stats.clusters_read == 0);
  REQUIRE(stats.active_triangles == 0);
  // A small ball at full resolution: some, not all.
  MtOptions o = Medium(1);
  o.code_max = 30;
  const MtFixture fine = MakeMt(o);
  query.region = SphereRegion(fine.Corners(fine.mt.triangles[fine.mt.root_triangles[0]])[0], 0.01);
  Extract(*Open(fine), query, &stats);
  REQUIRE(stats.clusters_used > 0);
  REQUIRE(stats.clusters_read < stats.clusters_total);
  const uint64_t cold = fine.source->reads_;
  const auto surface = Open(fine);
  Extract(*surface, query);
  const uint64_t once = fine.source->reads_ - cold;
  Extract(*surface, query, &stats);
  REQUIRE(fine.source->reads_ - cold == once);  // all from the cache
  REQUIRE(stats.clusters_read == 0);
  REQUIRE(stats.bytes_read == 0);
}

// The smallest cache, in steps of 1,000 bytes, that all of the queries can work with.
size_t SmallestCache(const MtFixture& f, const std::vector<Query>& queries) {
  for (size_t bytes = 0;; bytes += 1000) {
    const auto surface = Open(f, bytes, 1);
    bool all = true;
    for (const Query& query : queries) {
      TriangleMesh mesh;
      TriangleMeshSink sink(&mesh);
      const Result<ExtractStats> result = surface->Extract(query, sink);
      REQUIRE(surface->cache().peak_bytes() <= bytes);
      if (result.ok()) continue;
      REQUIRE(result.status().code() == StatusCode::kBudgetExceeded);
      all = false;
      break;
    }
    if (all) return bytes;
  }
}

std::vector<Query> SomeQueries(const MtFixture& f, std::mt19937& random) {
  std::vector<Query> queries{Query{}};
  for (int i = 0; i < 7; ++i) queries.push_back(RandomQuery(f, random));
  queries[5].max_triangles = 400;
  return queries;
}

TEST_CASE("Whether a cache is large enough for a query does not depend on what is in it",
          "[threads]") {
  std::mt19937 random(11);
  for (uint32_t seed = 1; seed <= 4; ++seed) {
    const MtFixture f = MakeMt(Medium(seed));
    const std::vector<Query> queries = SomeQueries(f, random);
    std::vector<size_t> smallest;
    for (const Query& query : queries) smallest.push_back(SmallestCache(f, {query}));
    for (const size_t budget : smallest) {
      for (const size_t bytes : {budget, budget - 1000}) {
        const auto surface = Open(f, bytes, 1 + random() % 3);
        for (int i = 0; i < 24; ++i) {
          const size_t q = random() % queries.size();
          TriangleMesh mesh;
          TriangleMeshSink sink(&mesh);
          const Status status = surface->Extract(queries[q], sink).status();
          INFO(seed << ": query " << q << " needs " << smallest[q] << ", has " << bytes);
          REQUIRE(status.ok() == (smallest[q] <= bytes));
          if (!status.ok()) REQUIRE(status.code() == StatusCode::kBudgetExceeded);
        }
      }
    }
  }
}

TEST_CASE("The smallest cache that can hold a query's steps gives the same answers", "[threads]") {
  std::mt19937 random(5);
  for (uint32_t seed = 1; seed <= 6; ++seed) {
    const MtFixture f = MakeMt(Medium(seed));
    const auto large = Open(f);
    const std::vector<Query> queries = SomeQueries(f, random);
    const size_t budget = SmallestCache(f, queries);
    REQUIRE(budget > 0);
    for (const unsigned threads : {1u, 4u}) {
      const auto small = Open(f, budget, threads);
      for (const Query& query : queries) {
        REQUIRE(SameMesh(Extract(*small, query), Extract(*large, query)));
      }
      REQUIRE(small->cache().peak_bytes() <= budget);
      REQUIRE(small->cache().decoded() > 2 * f.source->index_.unit_count());
    }
    REQUIRE(large->cache().decoded() == f.source->index_.unit_count());
  }
}

TEST_CASE("Many threads on one surface get the answers of one, and decode each cluster once",
          "[threads]") {
  const MtFixture f = MakeMt(Medium(9));
  std::mt19937 random(6);
  const std::vector<Query> queries = SomeQueries(f, random);
  const size_t smallest = SmallestCache(f, queries);
  std::vector<TriangleMesh> expected;
  const auto alone = Open(f, size_t{256} << 20, 1);
  for (const Query& query : queries) expected.push_back(Extract(*alone, query));
  for (const size_t budget : {size_t{256} << 20, 3 * smallest, smallest * 3 / 2}) {
    const auto shared = Open(f, budget, 3);
    std::vector<std::thread> threads;
    std::atomic<int> wrong{0};
    for (size_t t = 0; t < 8; ++t) {
      threads.emplace_back([&, t] {
        for (size_t i = 0; i < 2 * queries.size(); ++i) {
          const size_t q = (i + t) % queries.size();
          TriangleMesh mesh;
          TriangleMeshSink sink(&mesh);
          if (!shared->Extract(queries[q], sink).ok() || !SameMesh(mesh, expected[q])) ++wrong;
        }
      });
    }
    for (std::thread& thread : threads) thread.join();
    REQUIRE(wrong == 0);
    if (budget > 1000000) REQUIRE(shared->cache().decoded() == f.source->index_.unit_count());
    REQUIRE(shared->cache().peak_bytes() <= budget);
  }
}

TEST_CASE("A query can be cancelled from another thread, also while it waits for room",
          "[threads]") {
  const MtFixture f = MakeMt(Medium(3));
  const auto surface = Open(f, SmallestCache(f, {Query{}}));
  // Somebody else holds units and does not let go, and pointers fill what is left.
  UnitReader other(surface->cache(), {});
  REQUIRE(other.Get(f.source->index_.unit_count() - 1).ok());
  std::vector<LoadedUnitPtr> pointers;
  LoadStats stats;
  for (UnitId u = f.source->index_.unit_count(); u-- > 0;) {
    Result<LoadedUnitPtr> unit = surface->cache().Get(u, &stats);
    if (!unit.ok()) break;
    pointers.push_back(*std::move(unit));
  }
  REQUIRE(pointers.size() < f.source->index_.unit_count());
  QueryControl control;
  Query query;
  query.control = &control;
  StatusCode code = StatusCode::kOk;
  std::thread thread([&] {
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    code = surface->Extract(query, sink).status().code();
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(20));  // until it waits, if it is soon
  control.Cancel();
  thread.join();
  REQUIRE(code == StatusCode::kCancelled);
  other.Release();
  pointers.clear();
  REQUIRE(surface->cache().idle());
  REQUIRE(Extract(*surface, Query{}).triangles.size() == f.source->record_.triangles);
}

TEST_CASE("A cancelled query stops at its next step, and progress is seen") {
  const MtFixture f = MakeMt(Medium(3));
  for (const bool whole : {true, false}) {
    Query query;
    if (!whole) query.region = Everywhere(f);
    QueryControl control;
    query.control = &control;
    const auto surface = Open(f, size_t{256} << 20, 1);
    f.source->on_read_ = [&](uint32_t) {
      if (control.clusters_loaded() == 10) control.Cancel();
      return Status::Ok();
    };
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    REQUIRE(surface->Extract(query, sink).status().code() == StatusCode::kCancelled);
    REQUIRE(control.clusters_loaded() < f.source->index_.unit_count());
    REQUIRE(control.triangles_emitted() == 0);
    REQUIRE(surface->Select(query).status().code() == StatusCode::kCancelled);
    f.source->on_read_ = nullptr;
    QueryControl watched;
    query.control = &watched;
    Extract(*surface, query);
    REQUIRE(watched.triangles_emitted() == f.source->record_.triangles);
    if (!whole) REQUIRE(watched.nodes_applied() == f.source->record_.nodes);
  }
}

TEST_CASE("An error of the source is the query's error, and the next query recovers") {
  const MtFixture f = MakeMt(Medium(4));
  const uint32_t clusters = f.source->record_.clusters;
  for (const uint32_t bad : {0u, clusters / 2, clusters - 1, clusters}) {
    const auto surface = Open(f);
    f.source->on_read_ = [bad](uint32_t unit) {
      return unit == bad ? IoError("disk gone") : Status::Ok();
    };
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    const Result<ExtractStats> result = surface->Extract(Query{}, sink);
    REQUIRE(!result.ok());
    REQUIRE(result.status().code() == StatusCode::kIoError);
    f.source->on_read_ = nullptr;
    REQUIRE(Extract(*surface, Query{}).triangles.size() == f.source->record_.triangles);
  }
}

TEST_CASE("An error of the sink stops the extraction") {
  class FullSink final : public MeshSink {
   public:
    Status Begin(const MeshHeader&) override { return Status::Ok(); }
    Status AddVertices(std::span<const Vec3d>, ByteSpan) override { return Status::Ok(); }
    Status AddTriangles(std::span<const TriangleVertices>) override {
      return {StatusCode::kNoSpace, "full"};
    }
    Status End() override { return Status::Ok(); }
  } sink;
  const MtFixture f = MakeMt(Medium(4));
  REQUIRE(Open(f)->Extract(Query{}, sink).status().code() == StatusCode::kNoSpace);
}

TEST_CASE("Damaged payloads give kCorrupt or another valid mesh, never a crash") {
  std::mt19937 random(8);
  uint64_t refused = 0;
  for (uint32_t seed = 1; seed <= 8; ++seed) {
    MtOptions o = Medium(seed);
    o.resolution = 10;
    o.tiles = 4;
    const MtFixture f = MakeMt(o);
    for (int i = 0; i < 60; ++i) {
      const std::vector<Bytes> payloads = f.source->payloads_;
      const std::span<Bytes> values =
          random() % 4 == 0 ? f.source->root_payloads() : f.source->cluster_payloads();
      Bytes& victim = values[random() % values.size()];
      switch (random() % 4) {
        case 0: victim.resize(random() % (victim.size() + 1)); break;
        case 1: victim = values[random() % values.size()]; break;
        case 2: victim.push_back(std::byte{1}); break;
        default: victim[random() % victim.size()] ^= static_cast<std::byte>(1u << (random() % 8));
      }
      const auto surface = Open(f);
      for (const Query& query : {Query{}, RandomQuery(f, random)}) {
        TriangleMesh mesh;
        TriangleMeshSink sink(&mesh);
        const Result<ExtractStats> result = surface->Extract(query, sink);
        if (!result.ok()) {
          ++refused;
          const StatusCode code = result.status().code();  // unsupported: a stream's tag changed
          REQUIRE((code == StatusCode::kCorrupt || code == StatusCode::kUnsupported));
          REQUIRE(result.status().message().find("fixture") != std::string::npos);
        } else {
          REQUIRE(CheckMesh(mesh).bad_indices == 0);
        }
      }
      CheckReport report;
      REQUIRE(VerifyObject(*surface, VerifyLevel::kFull, &report).ok());
      REQUIRE(VerifyObject(*surface, VerifyLevel::kGlobal, &report).ok());
      f.source->payloads_ = payloads;
    }
  }
  REQUIRE(refused > 200);
}

TEST_CASE("An index that disagrees with a payload is found when the cluster is loaded") {
  const MtFixture f = MakeMt(Medium(5));
  const ClusterIndex index = f.source->index_;
  const ObjectRecord record = f.source->record_;
  const auto with_change = [&](const std::function<void(UnitEntry&)>& change,
                               const std::function<void(UnitEntry&)>& change_root) {
    ClusterIndex out;
    for (UnitId u = 0; u < index.unit_count(); ++u) {
      UnitEntry entry = index.unit(u);
      if (u == index.cluster_count() / 2) change(entry);
      if (u == index.cluster_count()) change_root(entry);
      out.Add(entry, {}, index.children(u));
    }
    out.Finish(index.root_vertices());
    return out;
  };
  const auto no_change = [](auto&) {};
  std::vector<ClusterIndex> wrong;
  for (const auto& change : std::vector<std::function<void(UnitEntry&)>>{
           [](UnitEntry& e) { ++e.in_triangles; }, [](UnitEntry& e) { --e.in_triangles; },
           [](UnitEntry& e) { ++e.out_triangles; }, [](UnitEntry& e) { ++e.nodes; },
           [](UnitEntry& e) { ++e.external_vertices; }, [](UnitEntry& e) { ++e.error_code_min; },
           [](UnitEntry& e) { --e.error_code_max; },
           [](UnitEntry& e) { e.explicit_arcs = !e.explicit_arcs; }}) {
    wrong.push_back(with_change(change, no_change));
  }
  wrong.push_back(with_change(no_change, [](UnitEntry& e) { ++e.out_triangles; }));
  wrong.push_back(with_change(no_change, [](UnitEntry& e) { ++e.external_vertices; }));
  for (size_t i = 0; i < wrong.size(); ++i) {
    f.source->index_ = wrong[i];
    f.source->record_ = record;
    if (i == 3) ++f.source->record_.vertices, ++f.source->record_.nodes;
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    INFO(i);
    REQUIRE(Open(f)->Extract(Query{}, sink).status().code() == StatusCode::kCorrupt);
  }
}

TEST_CASE("An index that disagrees with the record or is no DAG is refused") {
  const MtFixture f = MakeMt(Medium(4));
  const ObjectRecord record = f.source->record_;
  f.source->record_.clusters += 1;
  REQUIRE(Surface::Open(f.source).status().code() == StatusCode::kCorrupt);
  f.source->record_ = record;
  f.source->record_.vertices += 1;
  REQUIRE(Surface::Open(f.source).status().code() == StatusCode::kCorrupt);
  f.source->record_ = record;
  f.source->record_.triangles += 1;  // found out when streaming
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  REQUIRE(Open(f)->Extract(Query{}, sink).status().code() == StatusCode::kCorrupt);
}

}  // namespace mtdb::testing
