// SPDX-License-Identifier: Apache-2.0
// Queries and sessions that take what is there: clusters come late, in any order, twice, or not at
// all. Each answer is held against the definition, the last against a query that waits.
#include <algorithm>
#include <array>
#include <atomic>
#include <catch2/catch.hpp>
#include <chrono>
#include <map>
#include <random>
#include <thread>
#include <vector>

#include "query/cache/cluster_cache.h"
#include "query/session.h"
#include "query/surface.h"
#include "tests/query/explicit_mesh.h"
#include "tests/query/late_source.h"
#include "tests/query/oracle.h"

namespace mtdb::testing {
namespace {

MtFixture Fixture(uint32_t seed) {
  MtOptions o;
  o.shape = std::array{Shape::kSphere, Shape::kTorus, Shape::kSheet, Shape::kTube}[seed % 4];
  o.resolution = 10;
  o.rounds = 4;
  o.tiles = 6;
  o.attributes = seed % 2 == 1;
  o.coincident = seed % 3 == 0;
  o.seed = seed;
  return MakeMt(o);
}

// Those of the list, and all that come from them.
std::vector<bool> MissingOf(const MtFixture& f, const ExtractStats& stats) {
  const ClusterIndex& index = f.source->index_;
  std::vector<bool> missing(index.unit_count());
  for (const MissingCluster& m : stats.missing) missing[m.unit] = true;
  for (UnitId u = index.unit_count(); u-- > 0;) {
    for (const UnitId p : index.parents(u)) missing[u] = missing[u] || missing[p];
  }
  return missing;
}

void CheckOrder(const MtFixture& f, const ExtractStats& stats) {
  const ClusterIndex& index = f.source->index_;
  std::vector<size_t> place(index.unit_count(), 0);
  for (size_t i = 0; i < stats.missing.size(); ++i) {
    REQUIRE(place[stats.missing[i].unit] == 0);  // once
    place[stats.missing[i].unit] = i + 1;
    REQUIRE(stats.missing[i].failure.ok() ==
            (stats.missing[i].reason != MissingCluster::Reason::kFailed));
    if (i > 0) REQUIRE(stats.missing[i - 1].excess >= stats.missing[i].excess);
  }
  for (const MissingCluster& m : stats.missing) {
    for (const UnitId p : index.parents(m.unit)) REQUIRE(place[p] < place[m.unit]);
  }
}

// `cut`: a Cut or a Session.
template <typename C>
std::vector<bool> AppliedOf(const MtFixture& f, const C& cut) {
  std::vector<bool> applied;
  for (const InMemoryMt::Node& node : f.mt.nodes) {
    applied.push_back(cut.applied(node.cluster, node.index));
  }
  return applied;
}

void CheckClosed(const MtFixture& f, const std::vector<bool>& applied) {
  for (size_t n = 0; n < applied.size(); ++n) {
    if (!applied[n]) continue;
    for (const int p : f.mt.Parents(static_cast<int>(n))) REQUIRE(applied[static_cast<size_t>(p)]);
  }
}

// A cut that is not on the way.
void CheckAnswer(const MtFixture& f, const Query& query, const std::vector<bool>& applied,
                 const ExtractStats& stats, std::mt19937& random) {
  const Oracle oracle(f, query, MissingOf(f, stats));
  REQUIRE(applied == oracle.LeastCut(random));
  CheckOrder(f, stats);
  // At least what the definition says; at most what it says where nothing is known of any cluster
  // without a node in the cut.
  double least = 0, most = f.source->record_.rounding_error;
  std::vector<bool> used(f.source->index_.cluster_count());
  for (size_t n = 0; n < applied.size(); ++n) {
    if (applied[n]) used[f.mt.nodes[n].cluster] = true;
  }
  used.flip();
  const Oracle unused(f, query, used);
  for (const uint32_t t : f.mt.Mesh(applied)) {
    if (oracle.active(t)) least = std::max(least, oracle.bound(t));
    if (unused.active(t)) most = std::max(most, unused.bound(t));
  }
  REQUIRE(stats.error_bound >= least);
  REQUIRE(stats.error_bound <= most);
}

// What the session knows of its triangles, against the plain DAG; counts those whose b(t) is known,
// and those of which only the largest is.
void CheckFacts(const MtFixture& f, const Session& session, const ExplicitMesh& mesh,
                const std::vector<bool>& applied, std::array<size_t, 2>* known) {
  const ClusterIndex& index = f.source->index_;
  const Oracle oracle(f, {});
  std::vector<bool> used(index.unit_count());
  for (size_t n = 0; n < applied.size(); ++n) {
    if (applied[n]) used[f.mt.nodes[n].cluster] = true;
  }
  // Several triangles may lie at one place.
  std::multimap<std::array<Vec3i, 3>, uint32_t> at;
  for (const uint32_t id : f.mt.Mesh(applied)) {
    const auto& v = f.mt.triangles[id].vertices;
    at.emplace(ExplicitMesh::Smallest(std::array<Vec3i, 3>{
                   f.mt.positions[v[0]], f.mt.positions[v[1]], f.mt.positions[v[2]]}),
               id);
  }
  mesh.ForEach([&](TriangleKey key, const std::array<Vec3i, 3>& corners) {
    const TriangleFacts facts = session.FactsOf(key);
    ++(*known)[facts.exact ? 0 : 1];
    const auto [begin, end] = at.equal_range(corners);
    const auto match = std::find_if(begin, end, [&](const auto& entry) {
      const InMemoryMt::Triangle& t = f.mt.triangles[entry.second];
      const bool made = t.creator < 0 ? facts.cluster >= index.cluster_count()
                                      : facts.cluster == f.mt.nodes[t.creator].cluster;
      if (!made || t.remover < 0)
        return made && facts.exact && facts.error_bound == oracle.Bound(0);
      const UnitId remover = f.mt.nodes[t.remover].cluster;
      if (facts.exact) return facts.error_bound == oracle.bound(entry.second);
      return !used[remover] &&
             facts.error_bound == oracle.Bound(index.unit(remover).error_code_max);
    });
    REQUIRE(match != end);
    at.erase(match);
  });
  REQUIRE(at.empty());
}

// A session that takes what is there, and the mesh of its client.
class Client {
 public:
  Client(const MtFixture& f, std::shared_ptr<const Surface> surface)
      : f_(f), session_(*Session::Open(std::move(surface), {.available_only = true})) {}
  Session& session() { return *session_; }
  // Nothing while not even the root is there.
  std::optional<ExtractStats> Update(const Query& query, std::mt19937& random) {
    if (mesh_ == nullptr) {
      const Result<BaseMesh> base = session_->Base();
      if (!base.ok()) {
        const StatusCode code = base.status().code();
        REQUIRE((code == StatusCode::kNotYet || code == StatusCode::kIoError));
        return std::nullopt;
      }
      mesh_ = std::make_unique<ExplicitMesh>(*base);
    }
    std::vector<UpdateBatch> batches;
    const Result<SessionUpdate> update = session_->Update(query, &batches);
    INFO(update.status().message());
    REQUIRE(update.ok());
    for (const UpdateBatch& batch : batches) mesh_->Apply(batch);
    const std::vector<bool> applied = AppliedOf(f_, *session_);
    CheckClosed(f_, applied);
    REQUIRE(mesh_->Positions() == CutPositions(f_, applied));
    CheckFacts(f_, *session_, *mesh_, applied, &known_);
    if (update->stats.limit != QueryLimit::kTime && !query.max_triangles) {
      CheckAnswer(f_, query, applied, update->stats, random);
      REQUIRE((update->stats.limit == QueryLimit::kMissing) == !update->stats.missing.empty());
    }
    return update->stats;
  }
  // Until nothing is missing; the cut is then that of a query that waits.
  void UpdateToEnd(const Query& query, LateSource* source, std::mt19937& random) {
    std::optional<ExtractStats> stats;
    for (int i = 0; i == 0 || !stats || stats->limit != QueryLimit::kThreshold; ++i) {
      REQUIRE(i < 20000);
      if (source == nullptr || source->Pump(1 + random() % 9) == 0) {
        std::this_thread::sleep_for(std::chrono::microseconds(100));  // for the cache's threads
      }
      session_->RetryFailed();
      stats = Update(query, random);
    }
    const auto whole = *Surface::Open(f_.source);
    Query waiting = query;
    waiting.max_milliseconds.reset();
    REQUIRE(AppliedOf(f_, *session_) == AppliedOf(f_, *whole->Select(waiting)));
  }
  // Of the triangles after all updates: those whose error was known, and others.
  const std::array<size_t, 2>& known() const { return known_; }

 private:
  const MtFixture& f_;
  const std::unique_ptr<Session> session_;
  std::unique_ptr<ExplicitMesh> mesh_;
  std::array<size_t, 2> known_{};
};

RuntimeForm FormOf(uint32_t seed) {
  return seed % 3 == 0 ? RuntimeForm::kImplicit : RuntimeForm::kExplicit;
}

}  // namespace

TEST_CASE(
    "a session that takes what is there has the least cut through that, and ends at the cut of a "
    "query that waits") {
  for (uint32_t seed = 1; seed <= 12; ++seed) {
    const MtFixture f = Fixture(seed);
    std::mt19937 random(seed);
    for (const unsigned threads : {1u, 3u}) {
      for (const bool fails : {false, true}) {
        std::atomic<uint32_t> reads{seed};
        LateOptions options{.seed = seed, .own_thread = false, .twice = seed % 2 == 0};
        if (fails) {
          options.fails = [&](UnitId) {
            return reads.fetch_add(1) % 5 == 0 ? IoError("the line is dead") : Status::Ok();
          };
        }
        const auto source = std::make_shared<LateSource>(f.source, options);
        const auto surface = *Surface::Open(source, {.form = FormOf(seed), .threads = threads});
        Client client(f, surface);
        for (int q = 0; q < 6; ++q) {
          Query query = RandomQuery(f, random);
          if (q % 3 == 1) query.max_milliseconds = 0;
          for (int step = 0; step < 6; ++step) {
            source->Pump(random() % 4);
            client.Update(query, random);
          }
          if (q % 2 == 1) client.UpdateToEnd(query, source.get(), random);
        }
      }
    }
  }
}

TEST_CASE("a session that takes what is there of a store does so too") {
  for (const unsigned seed : {5u, 6u, 7u, 9u}) {
    const MtFixture f = Fixture(seed);
    std::mt19937 random(seed);
    const auto surface =
        *Surface::Open(f.source, {.form = FormOf(seed), .threads = 1 + seed / 2 % 2});
    Client client(f, surface);
    for (int q = 0; q < 12; ++q) {
      Query query = RandomQuery(f, random);
      if (q % 3 == 2) query.max_milliseconds = 0;
      client.UpdateToEnd(query, nullptr, random);
      if (q % 4 == 3) {
        Query budget = query;
        budget.max_milliseconds.reset();
        budget.max_triangles = random() % 400;
        client.Update(budget, random);
      }
    }
    REQUIRE(client.known()[0] > 0);
    REQUIRE(client.known()[1] > 0);
  }
}

TEST_CASE("a later query that means the same as the one before loses nothing that is missing") {
  const MtFixture f = Fixture(7);
  std::mt19937 random(1);
  const auto source = std::make_shared<LateSource>(f.source, LateOptions{.own_thread = false});
  Client client(f, *Surface::Open(source, {.threads = 1}));
  Query coarse, same;
  coarse.threshold = CoarsestThreshold();
  client.UpdateToEnd(coarse, source.get(), random);
  REQUIRE(client.Update({}, random)->limit == QueryLimit::kMissing);
  same.threshold = FullResolution();
  client.UpdateToEnd(same, source.get(), random);
}

// Calls of 0 ms end after their least work, so no time is assumed.
TEST_CASE("calls of 0 ms whose query is made anew each time are as many as those of one query") {
  for (const uint32_t seed : {1u, 3u, 4u, 6u}) {
    const MtFixture f = Fixture(seed);
    const Box3d& box = f.source->record_.bounds;
    const auto made = [&] {
      Query query;
      query.region = SphereRegion(box.max, Diagonal(box) * 0.6);
      query.threshold = LinearThreshold(box.max, 0, 0.001);
      query.max_milliseconds = 0;
      return query;
    };
    const auto calls = [&](const auto& next) {
      const auto surface = *Surface::Open(f.source, {.form = FormOf(seed), .threads = 1});
      const auto session = *Session::Open(surface, {.available_only = true});
      std::vector<UpdateBatch> batches;
      for (int n = 1;; ++n) {
        REQUIRE(n < 1000);
        const auto update = session->Update(next(), &batches);
        REQUIRE((update.ok() || update.status().code() == StatusCode::kNotYet));
        if (update.ok() && update->stats.limit == QueryLimit::kThreshold) return n;
      }
    };
    const Query one = made();
    const int least = calls([&] { return one; });
    CHECK(least > 2);
    CHECK(calls(made) == least);
  }
}

TEST_CASE("with a budget of triangles a session gets to its end in calls of any shortness") {
  for (const uint32_t seed : {1u, 3u, 4u, 6u}) {
    const MtFixture f = Fixture(seed);
    const auto whole = *Surface::Open(f.source);
    for (const unsigned threads : {1u, 3u}) {
      std::mt19937 random(seed);
      const auto source =
          std::make_shared<LateSource>(f.source, LateOptions{.seed = seed, .own_thread = false});
      const auto surface = *Surface::Open(source, {.form = FormOf(seed), .threads = threads});
      Client client(f, surface);
      const auto wait = [&] {
        if (source->Pump(1 + random() % 5) == 0) {
          std::this_thread::sleep_for(std::chrono::microseconds(100));  // for the cache's threads
        }
      };
      const auto is_answer = [&](Query query) {
        query.max_milliseconds.reset();
        return AppliedOf(f, client.session()) == AppliedOf(f, *whole->Select(query));
      };
      const auto random_query = [&] {
        Query query = RandomQuery(f, random);
        query.max_milliseconds = 0;
        query.max_triangles = 50 + random() % 800;
        return query;
      };
      for (int q = 0; q < 6; ++q) {
        const Query query = random_query();
        std::optional<ExtractStats> stats;
        for (int i = 0; !stats || stats->limit == QueryLimit::kTime || !stats->missing.empty();
             ++i) {
          REQUIRE(i < 20000);
          if (stats && stats->limit != QueryLimit::kTime) wait();
          stats = client.Update(query, random);
          if (!stats) wait();
        }
        REQUIRE(is_answer(query));
        // Each call another query: one of them is answered, again and again.
        const Query a = random_query(), b = random_query();
        for (int answers = 0, i = 0; answers < 3; ++i) {
          REQUIRE(i < 20000);
          wait();
          client.Update(i % 2 == 0 ? a : b, random);
          if (is_answer(a) || is_answer(b)) ++answers;
        }
        // Back to a cut without a budget.
        Query unlimited = RandomQuery(f, random);
        unlimited.max_milliseconds = 0;
        if (q % 2 == 1) client.UpdateToEnd(unlimited, source.get(), random);
      }
    }
  }
}

TEST_CASE("a query that takes what is there has the least cut through that") {
  for (uint32_t seed = 1; seed <= 6; ++seed) {
    const MtFixture f = Fixture(seed);
    std::mt19937 random(seed);
    const auto source =
        std::make_shared<LateSource>(f.source, LateOptions{.seed = seed, .own_thread = false});
    const auto surface = *Surface::Open(source, {.form = FormOf(seed), .threads = 1 + seed % 2});
    for (int q = 0; q < 5; ++q) {
      Query query = RandomQuery(f, random);
      query.available_only = true;
      query.clip = q % 2 == 1;
      std::vector<bool> last;
      for (int i = 0;; ++i) {
        REQUIRE(i < 20000);
        const Result<Cut> cut = surface->Select(query);
        if (cut.ok()) {
          const ExtractStats& stats = cut->stats();
          const std::vector<bool> applied = AppliedOf(f, *cut);
          CheckAnswer(f, query, applied, stats, random);
          TriangleMesh mesh;
          TriangleMeshSink sink(&mesh);
          Cut emitted = std::move(*surface->Select(query));
          REQUIRE(emitted.Emit(sink).ok());
          REQUIRE(mesh.triangles.size() == emitted.triangle_count());
          last = applied;
          if (stats.limit == QueryLimit::kThreshold) break;
        } else {
          REQUIRE(cut.status().code() == StatusCode::kNotYet);
        }
        if (source->Pump(1 + random() % 5) == 0) {
          std::this_thread::sleep_for(std::chrono::microseconds(100));
        }
      }
      Query waiting = query;
      waiting.available_only = false;
      const auto whole = *Surface::Open(f.source);
      const std::vector<bool> wanted = AppliedOf(f, *whole->Select(waiting));
      REQUIRE(last == wanted);
      // Once more: what was left to others meanwhile is said to be missing.
      const Result<Cut> again = surface->Select(query);
      if (again.ok() && again->stats().limit == QueryLimit::kThreshold) {
        REQUIRE(AppliedOf(f, *again) == wanted);
      }
    }
    Query limited;
    limited.available_only = true;
    limited.max_bytes = 1;
    REQUIRE(surface->Select(limited).status().code() == StatusCode::kInvalidArgument);
  }
}

TEST_CASE("what the cache has no room for is missing, and asked for no more") {
  const MtFixture f = Fixture(2);
  size_t all = 0;
  {
    const auto surface = *Surface::Open(f.source);
    Query query;
    query.threshold = ConstantThreshold(0);
    query.region = WholeRegion();
    REQUIRE(surface->Select(query).ok());
    all = surface->cache().bytes();
  }
  for (const unsigned threads : {1u, 2u}) {
    for (const size_t budget : {all / 3, all / 2, 3 * all / 4}) {
      std::mt19937 random(7);
      const auto source = std::make_shared<LateSource>(f.source, LateOptions{.own_thread = false});
      const auto surface = *Surface::Open(source, {.cache_bytes = budget, .threads = threads});
      Client client(f, surface);
      std::optional<ExtractStats> stats;
      const auto full = [&] {
        return stats && std::ranges::any_of(stats->missing, [](const MissingCluster& m) {
                 return m.reason == MissingCluster::Reason::kNoRoom;
               });
      };
      for (int i = 0; !full(); ++i) {
        INFO(budget << " of " << all << ", " << threads << " threads, "
                    << (stats ? stats->missing.size() : 0));
        REQUIRE(i < 20000);
        source->Pump(3);
        std::this_thread::sleep_for(std::chrono::microseconds(200));
        stats = client.Update({}, random);
        REQUIRE(surface->cache().peak_bytes() <= budget);
      }
      REQUIRE(stats->limit == QueryLimit::kMissing);
      REQUIRE(client.session().applied_count() > 0);
      // A query that needs less is answered.
      Query coarse;
      coarse.threshold = CoarsestThreshold();
      client.UpdateToEnd(coarse, source.get(), random);
    }
  }
}

TEST_CASE("what a later query does not want is not read for it") {
  const MtFixture f = Fixture(3);
  const auto source = std::make_shared<LateSource>(f.source, LateOptions{.own_thread = false});
  const auto surface = *Surface::Open(source, {.threads = 1});
  std::mt19937 random(1);
  {
    Client client(f, surface);
    Query coarse;
    coarse.threshold = CoarsestThreshold();
    client.UpdateToEnd(coarse, source.get(), random);
    client.Update({}, random);
    REQUIRE(source->open() > 0);
    client.Update(coarse, random);
    REQUIRE(source->open() == 0);
    client.Update({}, random);
    REQUIRE(source->open() > 0);
  }
  REQUIRE(source->open() == 0);
  REQUIRE(surface->cache().idle());
}

}  // namespace mtdb::testing
