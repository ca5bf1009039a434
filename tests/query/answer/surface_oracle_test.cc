// SPDX-License-Identifier: Apache-2.0
// The applied set of a query, node for node, against the definition run naively.
#include <array>
#include <catch2/catch.hpp>
#include <map>
#include <set>

#include "query/surface.h"
#include "tests/query/late_source.h"
#include "tests/query/mt_fixture.h"
#include "tests/query/oracle.h"
#include "tests/support/mesh_check.h"

namespace mtdb::testing {
namespace {

std::vector<bool> Applied(const MtFixture& f, const Cut& cut) {
  std::vector<bool> applied;
  for (const InMemoryMt::Node& node : f.mt.nodes) {
    applied.push_back(cut.applied(node.cluster, node.index));
  }
  return applied;
}

using PositionTriangles = std::multiset<std::array<std::array<double, 3>, 3>>;

std::array<std::array<double, 3>, 3> Key(const Triangle3d& t) {
  std::array<std::array<double, 3>, 3> best{};
  for (size_t r = 0; r < 3; ++r) {
    std::array<std::array<double, 3>, 3> key;
    for (size_t c = 0; c < 3; ++c) {
      const Vec3d& p = t[(c + r) % 3];
      key[c] = {p.x, p.y, p.z};
    }
    if (r == 0 || key < best) best = key;
  }
  return best;
}

PositionTriangles MeshTriangles(const TriangleMesh& mesh) {
  PositionTriangles set;
  for (const TriangleVertices& t : mesh.triangles) {
    set.insert(Key({mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]}));
  }
  return set;
}

PositionTriangles CutTriangles(const MtFixture& f, const std::vector<bool>& applied,
                               const Region* clip) {
  PositionTriangles set;
  for (const uint32_t id : f.mt.Mesh(applied)) {
    const Triangle3d corners = f.Corners(f.mt.triangles[id]);
    if (clip == nullptr || clip->Within(corners, 0)) set.insert(Key(corners));
  }
  return set;
}

// The mesh, and the statistics that follow from the applied set.
void CheckAnswer(const MtFixture& f, const Query& query, const Oracle& oracle,
                 const std::vector<bool>& expected, Cut& cut) {
  REQUIRE(Applied(f, cut) == expected);
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  const Status status = cut.Emit(sink);
  INFO(status.message());
  REQUIRE(status.ok());
  const ObjectRecord& record = f.source->record_;
  const ExtractStats& stats = cut.stats();
  const bool clip = query.clip && query.region != nullptr;
  REQUIRE(MeshTriangles(mesh) == CutTriangles(f, expected, clip ? query.region.get() : nullptr));
  REQUIRE(stats.triangles == mesh.triangles.size());
  REQUIRE(stats.vertices == mesh.positions.size());
  REQUIRE(mesh.rows.size() == mesh.positions.size() * record.attributes.row_bytes());
  const MeshCheck check = CheckMesh(mesh);
  REQUIRE(check.bad_indices == 0);
  REQUIRE(check.unused_vertices == 0);
  if (!clip) {
    REQUIRE(check.ok());
    REQUIRE(check.euler_characteristic == record.euler_characteristic);
    REQUIRE(check.components == record.components);
  }
  uint64_t forced = 0;
  uint64_t count = 0;
  for (size_t i = 0; i < expected.size(); ++i) {
    if (!expected[i]) continue;
    ++count;
    const std::vector<uint32_t>& hole = f.mt.nodes[i].hole;
    forced += std::none_of(hole.begin(), hole.end(), [&](uint32_t t) { return oracle.wanted(t); });
  }
  REQUIRE(stats.nodes_applied == count);
  REQUIRE(stats.nodes_forced == forced);
  // Where a cluster was not needed its largest error may stand for a triangle's.
  uint64_t active = 0;
  uint64_t active_at_most = 0;
  double error = oracle.Bound(0);
  double error_at_most = oracle.Bound(0);
  for (const uint32_t id : f.mt.Mesh(expected)) {
    const InMemoryMt::Triangle& t = f.mt.triangles[id];
    uint8_t code = 0;
    uint8_t largest = 0;
    if (t.remover >= 0) {
      const InMemoryMt::Node& node = f.mt.nodes[static_cast<size_t>(t.remover)];
      code = node.code;
      largest = f.source->index_.unit(node.cluster).error_code_max;
    }
    if (oracle.active(id)) {
      ++active;
      error = std::max(error, oracle.Bound(code));
    }
    if (query.region == nullptr || query.region->Within(f.Corners(t), oracle.Bound(largest))) {
      ++active_at_most;
      error_at_most = std::max(error_at_most, oracle.Bound(largest));
    }
  }
  REQUIRE(stats.error_bound >= error);
  REQUIRE(stats.error_bound <= error_at_most);
  // Not above what was asked for, or it is said by how much and where.
  if (query.threshold != nullptr && query.threshold->constant()) {
    const double asked = std::max(*query.threshold->constant(), 0.0);
    if (*query.threshold->constant() >= 0 && stats.active_triangles > 0) {
      REQUIRE((stats.error_bound <= asked) == !stats.shortfall.any());
    }
    if (stats.shortfall.any()) REQUIRE(stats.shortfall.excess == stats.error_bound - asked);
  }
  const Shortfall shortfall = oracle.ShortfallOf(expected);
  if (stats.limit == QueryLimit::kThreshold) {
    REQUIRE(stats.shortfall.any() == shortfall.any());
    if (query.region == nullptr || query.region->whole()) {
      REQUIRE(stats.shortfall.triangles == shortfall.triangles);
    }
    REQUIRE(stats.shortfall.triangles >= shortfall.triangles);
    REQUIRE(stats.shortfall.excess == Approx(shortfall.excess));
  } else {
    REQUIRE(stats.shortfall.triangles >= shortfall.triangles);
    REQUIRE(stats.shortfall.excess >= shortfall.excess * (1 - 1e-9));
  }
  // Round everything that can be.
  if (stats.shortfall.any()) {
    for (int i = 0; i < 3 && shortfall.any(); ++i) {
      REQUIRE(stats.shortfall.bounds.min[i] <= shortfall.bounds.min[i]);
      REQUIRE(stats.shortfall.bounds.max[i] >= shortfall.bounds.max[i]);
    }
  }
  if (clip) {
    REQUIRE(stats.active_triangles == stats.triangles);
  } else {
    REQUIRE(stats.active_triangles >= active);
    REQUIRE(stats.active_triangles <= active_at_most);
  }
}

std::vector<MtOptions> SmallMts() {
  std::vector<MtOptions> all;
  uint32_t seed = 1;
  for (const Shape shape : {Shape::kSphere, Shape::kTorus, Shape::kSheet, Shape::kTube}) {
    for (const bool coincident : {false, true}) {
      for (const uint8_t code_max : {uint8_t{0}, uint8_t{60}, uint8_t{110}}) {
        MtOptions o;
        o.shape = shape;
        o.resolution = 10;
        o.rounds = 4;
        o.tiles = 6;
        o.coincident = coincident;
        o.attributes = code_max == 60;
        o.code_max = code_max;
        o.root_pieces = static_cast<int>(1 + seed % 6);
        o.seed = seed++;
        all.push_back(o);
      }
    }
  }
  return all;
}

}  // namespace

TEST_CASE("On tiny MTs the cut is the least of all valid parent-closed sets") {
  std::mt19937 random(11);
  uint64_t partial = 0;
  for (uint32_t seed = 0; seed < 40; ++seed) {
    MtOptions o;
    o.shape = static_cast<Shape>(seed % 4);
    o.resolution = 4;
    o.rounds = 3;
    o.tiles = 2;
    o.max_nodes = 11;
    o.seed = seed + 100;
    const MtFixture f = MakeMt(o);
    const auto surface = Surface::Open(AsTested(f.source)).value();
    for (int i = 0; i < 8; ++i) {
      const Query query = RandomQuery(f, random);
      const Oracle oracle(f, query);
      const std::vector<bool> expected = oracle.LeastCutByEnumeration();
      REQUIRE(oracle.LeastCut(random) == expected);
      Result<Cut> cut = surface->Select(query);
      REQUIRE(cut.ok());
      CheckAnswer(f, query, oracle, expected, *cut);
      const auto count = std::count(expected.begin(), expected.end(), true);
      partial += count > 0 && static_cast<size_t>(count) < expected.size();
    }
  }
  REQUIRE(partial > 80);  // most answers are neither the root nor everything
}

TEST_CASE("On small MTs the cut equals the definition, node for node") {
  std::mt19937 random(12);
  uint64_t forced = 0;
  uint64_t partial = 0;
  for (const MtOptions& options : SmallMts()) {
    const MtFixture f = MakeMt(options);
    REQUIRE(f.source->index_.cluster_count() > 4);
    const auto surface = Surface::Open(AsTested(f.source)).value();
    for (int i = 0; i < 60; ++i) {
      Query query = RandomQuery(f, random);
      query.clip = i % 3 == 0;
      const Oracle oracle(f, query);
      const std::vector<bool> expected = oracle.LeastCut(random);
      Result<Cut> cut = surface->Select(query);
      REQUIRE(cut.ok());
      CheckAnswer(f, query, oracle, expected, *cut);
      forced += cut->stats().nodes_forced;
      const auto count = std::count(expected.begin(), expected.end(), true);
      partial += count > 0 && static_cast<size_t>(count) < expected.size();
    }
  }
  REQUIRE(forced > 100);
  REQUIRE(partial > 400);
}

TEST_CASE("For every kind of region and threshold the cut equals the definition") {
  std::mt19937 random(14);
  std::vector<uint64_t> by_region(kRegionKinds + 1), by_threshold(kThresholdKinds);
  for (const MtOptions& options : SmallMts()) {
    if (options.code_max == 0) continue;
    const MtFixture f = MakeMt(options);
    const auto surface = Surface::Open(AsTested(f.source)).value();
    const Box3d& bounds = f.source->record_.bounds;
    for (int i = 0; i < 1 + kRegionKinds + kThresholdKinds; ++i) {
      const int region = std::min(i, kRegionKinds);
      const int threshold = i - 1 - kRegionKinds;
      for (int k = 0; k < 15; ++k) {
        Query query = RandomQuery(f, random);
        query.clip = k % 2 == 0;
        if (threshold >= 0) {
          query.threshold = RandomThreshold(threshold, f, random);
        } else {
          query.region = region < kRegionKinds ? RandomRegion(region, bounds, random).region
                                               : RandomCombination(bounds, random).region;
        }
        const Oracle oracle(f, query);
        const std::vector<bool> expected = oracle.LeastCut(random);
        Result<Cut> cut = surface->Select(query);
        REQUIRE(cut.ok());
        CheckAnswer(f, query, oracle, expected, *cut);
        const auto count = std::count(expected.begin(), expected.end(), true);
        const bool partial = count > 0 && static_cast<size_t>(count) < expected.size();
        (threshold < 0 ? by_region[static_cast<size_t>(region)]
                       : by_threshold[static_cast<size_t>(threshold)]) += partial;
      }
    }
  }
  // Of 240 answers to each kind, these are neither the root nor everything.
  for (const uint64_t partial : by_region) CHECK(partial > 40);
  for (const uint64_t partial : by_threshold) CHECK(partial > 40);
}

TEST_CASE("With budgets of triangles and bytes the highest levels are refined first") {
  std::mt19937 random(13);
  std::array<uint64_t, 4> ended{};
  for (const MtOptions& options : SmallMts()) {
    const MtFixture f = MakeMt(options);
    uint64_t all_bytes = 0;
    for (const Bytes& payload : f.source->cluster_payloads()) all_bytes += payload.size();
    uint64_t root_bytes = 0;
    for (const Bytes& payload : f.source->root_payloads()) root_bytes += payload.size();
    for (int i = 0; i < 9; ++i) {
      Query query = RandomQuery(f, random);
      query.clip = i % 4 == 0;
      if (i % 3 != 1) query.max_triangles = random() % (f.source->record_.triangles + 10);
      if (i % 3 != 0) query.max_bytes = random() % (root_bytes + all_bytes + 100);
      const Oracle oracle(f, query);
      QueryLimit limit{};
      const std::vector<bool> expected = oracle.GreedyCut(&limit);
      if (query.max_triangles && !query.max_bytes) {
        QueryLimit by_definition{};
        REQUIRE(oracle.CutWithin(*query.max_triangles, &by_definition) == expected);
        REQUIRE(by_definition == limit);
      }
      const auto surface = Surface::Open(AsTested(f.source)).value();  // nothing is in the cache
      Result<Cut> cut = surface->Select(query);
      REQUIRE(cut.ok());
      CheckAnswer(f, query, oracle, expected, *cut);
      REQUIRE(cut->stats().limit == limit);
      if (query.max_bytes) {
        REQUIRE(cut->stats().bytes_read <= std::max(*query.max_bytes, root_bytes));
      }
      ++ended[static_cast<size_t>(limit)];
    }
  }
  REQUIRE(ended[static_cast<size_t>(QueryLimit::kThreshold)] > 20);
  REQUIRE(ended[static_cast<size_t>(QueryLimit::kTriangles)] > 20);
  REQUIRE(ended[static_cast<size_t>(QueryLimit::kBytes)] > 20);
}

}  // namespace mtdb::testing
