// SPDX-License-Identifier: Apache-2.0
// Lack of memory at every allocation: an error, nothing lost, and the next query works.
#include "store/base/out_of_memory.h"

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <chrono>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "query/cache/cluster_cache.h"
#include "query/probe.h"
#include "query/query_json.h"
#include "query/session.h"
#include "query/surface.h"
#include "query/verify_object.h"
#include "tests/builder/fixture.h"
#include "tests/query/mt_fixture.h"
#include "tests/support/failing_allocation.h"
#include "tools/c/mtdb.h"

namespace mtdb::testing {

using namespace internal;

namespace {

using Mode = FailingAllocation::Mode;
constexpr std::array<Mode, 2> kModes{Mode::kOnce, Mode::kFromThenOn};

MtFixture Small(bool attributes = true) {
  MtOptions o;
  o.shape = Shape::kTorus;
  o.resolution = 10;
  o.rounds = 3;
  o.tiles = 4;
  o.attributes = attributes;
  return MakeMt(o);
}

Query Detailed(const MtFixture& f) {
  Query query;
  const Box3d& box = f.source->record_.bounds;
  query.region = UnionRegion({SphereRegion(box.max, Diagonal(box) / 2), BoxRegion({})});
  query.threshold = LinearThreshold(box.min, 0, 0.05);
  return query;
}

struct How {
  const char* name;
  unsigned threads = 1;
  RuntimeForm form = RuntimeForm::kExplicit;
  size_t cache_bytes = size_t{64} << 20;
  bool warm = false;
};

std::shared_ptr<Surface> Open(const MtFixture& f, const How& how) {
  SurfaceOptions options;
  options.threads = how.threads;
  options.form = how.form;
  options.cache_bytes = how.cache_bytes;
  return Surface::Open(f.source, options).value();
}

// A job under way for a query that is over ends soon.
bool BecomesIdle(const Surface& surface) {
  for (int i = 0; i < 10'000; ++i) {
    if (surface.cache().idle()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return false;
}

bool SameMesh(const TriangleMesh& a, const TriangleMesh& b) {
  return a.positions == b.positions && a.triangles == b.triangles && a.rows == b.rows;
}

// The smallest cache with which the query works, about.
size_t TightCache(const MtFixture& f, const Query& query) {
  for (size_t bytes = 1 << 12;; bytes += bytes / 8) {
    How how{"tight"};
    how.cache_bytes = bytes;
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    if (Open(f, how)->Extract(query, sink).ok()) return bytes;
  }
}

// Each allocation of the query fails in turn; after each failure the same
// surface answers rightly.
void CheckQuery(const MtFixture& f, const Query& query, const How& how, Mode mode) {
  INFO(how.name << (mode == Mode::kOnce ? ", once" : ", from then on"));
  TriangleMesh expected;
  {
    TriangleMeshSink sink(&expected);
    REQUIRE(Open(f, {"oracle"})->Extract(query, sink).ok());
  }
  std::shared_ptr<Surface> surface = Open(f, how);
  uint64_t failures = 0;
  TriangleMesh mesh;
  const auto run = [&]() -> Result<ExtractStats> {
    TriangleMeshSink sink(&mesh);
    return surface->Extract(query, sink);
  };
  const uint64_t n = FailEachAllocation(mode, run, [&](uint64_t nth, Result<ExtractStats> stats) {
    INFO("allocation " << nth);
    if (stats.ok()) {
      REQUIRE(SameMesh(mesh, expected));
    } else {
      REQUIRE(stats.status().code() == StatusCode::kNoSpace);
      ++failures;
    }
    REQUIRE(BecomesIdle(*surface));
    mesh = {};
    TriangleMeshSink sink(&mesh);
    const Result<ExtractStats> again = surface->Extract(query, sink);
    INFO(again.status().message());
    REQUIRE(again.ok());
    REQUIRE(SameMesh(mesh, expected));
    mesh = {};
    if (!how.warm) surface = Open(f, how);
  });
  CHECK(n > 20);
  CHECK(failures > 20);
}

}  // namespace

TEST_CASE(
    "The n-th allocation fails, once or from then on, and the creation "
    "of a thread counts") {
  const auto count_failures = [](uint64_t nth, Mode mode) {
    uint64_t failed = 0;
    const FailingAllocation failing(nth, mode);
    for (int i = 0; i < 4; ++i) {
      try {
        ::operator delete(::operator new(8));  // calls that no compiler leaves out
      } catch (const std::bad_alloc&) {
        ++failed;
      }
    }
    return failed == failing.failures() ? failed : 99;
  };
  CHECK(count_failures(2, Mode::kOnce) == 1);
  CHECK(count_failures(2, Mode::kFromThenOn) == 3);
  CHECK(count_failures(5, Mode::kFromThenOn) == 0);

  const auto start_thread = [] {
    return CatchOutOfMemory([]() -> Status {
      try {
        std::thread([] {}).join();
      } catch (const std::system_error&) {
        return {StatusCode::kBusy, "no thread"};
      }
      return Status::Ok();
    });
  };
  std::vector<StatusCode> codes;
  codes.reserve(10);
  const uint64_t n =
      FailEachAllocation(Mode::kOnce, start_thread,
                         [&](uint64_t, const Status& status) { codes.push_back(status.code()); });
  CHECK(n >= 3);
  CHECK(codes.front() == StatusCode::kNoSpace);  // the thread's function
  CHECK(std::count(codes.begin(), codes.end(), StatusCode::kBusy) == 1);
  CHECK(codes.back() == StatusCode::kOk);
}

TEST_CASE("A lack of memory becomes a Status without memory") {
  const auto run = [] {
    return CatchOutOfMemory([]() -> Result<std::string> { return std::string(1000, 'x'); });
  };
  const uint64_t n = FailEachAllocation(Mode::kFromThenOn, run, [](uint64_t, auto result) {
    if (result.ok()) return;
    CHECK(result.status().code() == StatusCode::kNoSpace);
    CHECK(result.status().message() == "out of memory");
  });
  CHECK(n == 2);
}

TEST_CASE("A query whose n-th allocation fails says so, and the next one is right") {
  const MtFixture f = Small();
  std::vector<Query> queries(1);  // all of it
  queries.push_back(Detailed(f));
  queries.push_back(Detailed(f));
  queries.back().clip = true;
  queries.back().normals = true;
  queries.push_back(Detailed(f));
  queries.back().max_triangles = 150;
  queries.push_back(Detailed(f));
  queries.back().max_bytes = 2000;
  for (const Query& query : queries) {
    for (const Mode mode : kModes) {
      CheckQuery(f, query, {"cold"}, mode);
      CheckQuery(f, query, {"warm", 1, RuntimeForm::kExplicit, size_t{64} << 20, true}, mode);
    }
  }
  for (const Mode mode : kModes) {
    CheckQuery(f, queries[1], {"threads", 3}, mode);
    CheckQuery(f, queries[1], {"implicit", 1, RuntimeForm::kImplicit}, mode);
    CheckQuery(f, queries[1], {"tight", 1, RuntimeForm::kExplicit, TightCache(f, queries[1])},
               mode);
    CheckQuery(
        f, queries[1],
        {"implicit, tight, threads", 3, RuntimeForm::kImplicit, TightCache(f, queries[1]) * 3 / 2},
        mode);
  }
}

TEST_CASE(
    "A cut that could not be sent for lack of memory is sent again, all "
    "of it") {
  const MtFixture f = Small();
  for (const Query& query : {Query{}, Detailed(f)}) {
    TriangleMesh expected;
    const auto surface = Open(f, {"cold"});
    Cut cut = surface->Select(query).value();
    TriangleMeshSink first(&expected);
    REQUIRE(cut.Emit(first).ok());
    for (const Mode mode : kModes) {
      std::optional<Cut> again(surface->Select(query).value());
      TriangleMesh mesh;
      const auto run = [&] {
        TriangleMeshSink sink(&mesh);
        return again->Emit(sink);
      };
      FailEachAllocation(mode, run, [&](uint64_t nth, const Status& status) {
        INFO("allocation " << nth);
        if (!status.ok()) REQUIRE(status.code() == StatusCode::kNoSpace);
        mesh = {};
        TriangleMeshSink sink(&mesh);
        REQUIRE(again->Emit(sink).ok());
        REQUIRE(SameMesh(mesh, expected));
        mesh = {};
        again.emplace(surface->Select(query).value());
      });
    }
  }
}

// The vertices of the applied nodes, as the client of a session knows them.
class Follower {
 public:
  void Apply(std::span<const UpdateBatch> batches) {
    for (const UpdateBatch& batch : batches) {
      for (const UpdateBatch::Node& node : batch.nodes) {
        const bool fits =
            batch.insert ? vertices_.insert(node.vertex).second : vertices_.erase(node.vertex) == 1;
        REQUIRE(fits);
      }
    }
  }
  bool Holds(const MtFixture& f, const Session& session) const {
    uint64_t count = 0;
    const ClusterIndex& index = f.source->index();
    for (uint32_t c = 0; c < index.cluster_count(); ++c) {
      for (NodeIndex i = 0; i < index.unit(c).nodes; ++i) {
        const bool applied = session.applied(c, i);
        count += applied ? 1 : 0;
        if (applied != vertices_.contains(index.first_vertex(c) + i)) return false;
      }
    }
    return count == session.applied_count();
  }

 private:
  std::set<VertexIndex> vertices_;
};

bool SameCut(const MtFixture& f, const Session& session, const Cut& cut) {
  const ClusterIndex& index = f.source->index();
  for (uint32_t c = 0; c < index.cluster_count(); ++c) {
    for (NodeIndex i = 0; i < index.unit(c).nodes; ++i) {
      if (session.applied(c, i) != cut.applied(c, i)) return false;
    }
  }
  return true;
}

TEST_CASE(
    "A session whose n-th allocation fails keeps a cut that its client "
    "has, and goes on") {
  const MtFixture f = Small();
  const Box3d& box = f.source->record_.bounds;
  std::vector<Query> queries(3);
  queries[0].threshold = LinearThreshold(box.min, 0, 0.05);
  queries[1].threshold = LinearThreshold(box.max, 0, 0.05);
  queries[1].region = SphereRegion(box.max, Diagonal(box) / 2);
  queries[2].max_triangles = 200;
  for (const bool rounds : {false, true}) {
    for (const Mode mode : kModes) {
      const auto surface = Open(f, {"session", 2});
      std::vector<Cut> cuts;
      for (const Query& query : queries) cuts.push_back(surface->Select(query).value());
      const auto session = Session::Open(surface).value();
      Follower follower;
      std::vector<UpdateBatch> taken;
      taken.reserve(10'000);
      size_t next = 0;
      const auto update = [&]() -> Result<SessionUpdate> {
        if (!rounds) return session->Update(queries[next], &taken);
        return session->Update(queries[next], [&](std::span<const UpdateBatch> round) {
          std::vector<UpdateBatch> copy(round.begin(), round.end());
          for (UpdateBatch& batch : copy) taken.push_back(std::move(batch));
          return Status::Ok();
        });
      };
      // From each of the queries to each other one, which all share their
      // units.
      for (size_t from = 0; from < queries.size(); ++from) {
        for (size_t to = 0; to < queries.size(); ++to) {
          if (from == to) continue;
          const auto go = [&](size_t where) {
            next = where;
            taken.clear();
            const Result<SessionUpdate> done = update();
            INFO(done.status().message());
            REQUIRE(done.ok());
            follower.Apply(taken);
            REQUIRE(follower.Holds(f, *session));
            REQUIRE(SameCut(f, *session, cuts[where]));
          };
          go(from);
          next = to;
          taken.clear();
          FailEachAllocation(mode, update, [&](uint64_t nth, const auto& done) {
            INFO("from " << from << " to " << to << ", allocation " << nth);
            if (!done.ok()) REQUIRE(done.status().code() == StatusCode::kNoSpace);
            if (!done.ok() && !rounds) taken.clear();
            follower.Apply(taken);
            REQUIRE(follower.Holds(f, *session));
            REQUIRE(BecomesIdle(*surface));
            go(to);
            go(from);
            next = to;
            taken.clear();
          });
        }
      }
    }
  }
}

const Status& StatusOf(const Status& status) { return status; }
template <typename T>
const Status& StatusOf(const Result<T>& result) {
  return result.status();
}

// Runs f with each allocation failing, and then without.
template <typename Run, typename Right>
void CheckRuns(const Surface* surface, Run&& run, Right&& right) {
  for (const Mode mode : kModes) {
    const uint64_t n = FailEachAllocation(mode, run, [&](uint64_t nth, const auto& answer) {
      INFO("allocation " << nth);
      if (answer.ok()) {
        REQUIRE(right(answer));
      } else {
        REQUIRE(StatusOf(answer).code() == StatusCode::kNoSpace);
      }
      if (surface != nullptr) REQUIRE(BecomesIdle(*surface));
      const auto again = run();
      REQUIRE(again.ok());
      REQUIRE(right(again));
    });
    CHECK(n > 1);
  }
}

TEST_CASE("Opening, a session's base, a probe and a check without memory say so") {
  const MtFixture f = Small();
  const auto right = [](const auto&) { return true; };
  CheckRuns(
      nullptr, [&] { return Surface::Open(f.source); }, right);
  const auto surface = Open(f, {"shared", 2});
  CheckRuns(
      surface.get(), [&] { return Session::Open(surface); }, right);
  const auto session = Session::Open(surface).value();
  const BaseMesh base = session->Base().value();
  CheckRuns(
      surface.get(), [&] { return session->Base(); },
      [&](const Result<BaseMesh>& b) { return b->triangle_keys == base.triangle_keys; });

  const Vec3d centre = (f.source->record_.bounds.min + f.source->record_.bounds.max) * 0.5;
  for (const bool cold : {false, true}) {
    const auto probed = [&] { return cold ? Open(f, {"probe"}) : surface; };
    const double closest = FindClosestPoint(*surface, centre).value().hit->distance;
    const double hit = CastRay(*surface, centre, {1, 0.1, 0.2}).value().hit->distance;
    std::shared_ptr<Surface> on = probed();
    CheckRuns(
        on.get(), [&] { return FindClosestPoint(*on, centre); },
        [&](const Result<ProbeAnswer>& a) { return a->hit->distance == closest; });
    on = probed();
    CheckRuns(
        on.get(),
        [&] {
          return CastRay(*on, centre, {1, 0.1, 0.2});
        },
        [&](const Result<ProbeAnswer>& a) { return a->hit->distance == hit; });
  }
  for (const VerifyLevel level : {VerifyLevel::kFull, VerifyLevel::kGlobal}) {
    CheckReport report;
    CheckRuns(
        surface.get(),
        [&] {
          report.checks.clear();
          report.failures.clear();
          return VerifyObject(*surface, level, &report);
        },
        [&](const Status&) { return report.ok(); });
  }
}

TEST_CASE("A query in JSON without memory to read it is refused, whatever it asks for") {
  const char* const text = R"({
    "region": {"union": [
      {"prism": {"polygon": [[0, 0], [2, 0], [1, 2], [0, 1]], "min_z": 0}},
      {"intersection": [{"sphere": {"centre": [0, 0, 0], "radius": 1}},
                        {"outside": {"tube": {"line": [[0, 0, 0], [1, 1, 1]], "radius": 1}}}]},
      {"polyhedron": [{"point": [0, 0, 0], "normal": [0, 0, 1]}]}]},
    "threshold": {"smallest": [
      {"grid": {"origin": [0, 0, 0], "cell": [1, 1, 1], "counts": [2, 2, 1], "errors": [1, 2, 3, 4]}},
      {"by_region": {"region": {"point": [0, 0, 0]}, "inside": "full", "outside": 0.25}}]},
    "clip": true, "max_triangles": 7})";
  const Result<Query> query = ParseQuery(text, 1);
  INFO(query.status().message());
  REQUIRE(query.ok());
  CheckRuns(
      nullptr, [&] { return ParseQuery(text, 1); },
      [](const Result<Query>& q) { return q->max_triangles == 7u && q->region && q->threshold; });
  // What is wrong with it is told when there is memory for that.
  for (const char* wrong : {R"({"region": {"sphere": {"centre": [0, 0], "radius": [1, 2]}}})",
                            R"({"region": [[1, 2], {"a": [3]}]})", R"({"threshold": [1, 2)"}) {
    const Status expected = ParseQuery(wrong, 1).status();
    for (const Mode mode : kModes) {
      FailEachAllocation(
          mode, [&] { return ParseQuery(wrong, 1); },
          [&](uint64_t, const Result<Query>& parsed) {
            const Status& status = parsed.status();
            if (status.code() == StatusCode::kNoSpace) return;
            REQUIRE(status.code() == expected.code());
            REQUIRE(status.message() == expected.message());
          });
    }
  }
}

TEST_CASE("No exception leaves the C interface, which works again with memory") {
  const BuiltObject built = Build(MakeSculpture(600));
  mtdb_error error;
  mtdb_database* database = nullptr;
  REQUIRE(mtdb_open(built.store->path().c_str(), nullptr, &database, &error) == MTDB_OK);
  uint64_t vertices = 0;
  // All that a caller does with an object, from a cold cache.
  const auto run = [&]() -> Status {
    mtdb_object* object = nullptr;
    mtdb_query* query = nullptr;
    mtdb_cut* cut = nullptr;
    mtdb_texts* failures = nullptr;
    mtdb_stats stats;
    mtdb_hit hit;
    MTDB_INIT(stats);
    MTDB_INIT(hit);
    const double point[3] = {0, 0, 0};
    mtdb_code code = mtdb_open_object(database, nullptr, nullptr, &object, &error);
    const auto then = [&](auto&& call) {
      if (code == MTDB_OK) code = call();
    };
    then([&] {
      return mtdb_create_query(object, R"({"threshold": {"relative": 0.001}})", &query, &error);
    });
    then([&] { return mtdb_select(object, query, nullptr, &cut, &error); });
    then([&] { return mtdb_get_cut_stats(cut, &stats, &error); });
    then([&] {
      mtdb_sink sink;
      MTDB_INIT(sink);
      return mtdb_emit_cut(cut, &sink, &error);
    });
    then([&] { return mtdb_find_closest_point(object, point, 1e9, nullptr, &hit, &error); });
    then([&] { return mtdb_verify(object, MTDB_VERIFY_FULL, nullptr, &failures, &error); });
    mtdb_free_texts(failures);
    mtdb_free_cut(cut);
    mtdb_free_query(query);
    mtdb_free_object(object);
    vertices = stats.vertices;
    if (code == MTDB_OK) return Status::Ok();
    return {static_cast<StatusCode>(code), "from C"};
  };
  REQUIRE(run().ok());
  const uint64_t expected = vertices;
  CheckRuns(nullptr, run, [&](const Status&) { return vertices == expected; });
  mtdb_free_database(database);
}

TEST_CASE("A cache without memory is as it was") {
  const MtFixture f = Small();
  for (const Mode mode : kModes) {
    std::shared_ptr<Surface> surface = Open(f, {"cache"});
    LoadStats stats;
    const auto run = [&]() -> Result<LoadedUnitPtr> { return surface->cache().Get(0, &stats); };
    FailEachAllocation(mode, run, [&](uint64_t, Result<LoadedUnitPtr> unit) {
      if (unit.ok()) {
        REQUIRE((*unit)->id == 0);
        REQUIRE(!surface->cache().idle());
        unit = Status(StatusCode::kNoSpace, "");
      }
      REQUIRE(surface->cache().idle());
      REQUIRE(surface->cache().Get(0, &stats).ok());
      REQUIRE(surface->cache().idle());
      surface = Open(f, {"cache"});
    });
  }
}

}  // namespace mtdb::testing
