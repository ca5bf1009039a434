// SPDX-License-Identifier: Apache-2.0
// A compact cluster says what the cluster says that it was made of, and refuses what it cannot.
#include "query/cache/compact_cluster.h"

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <limits>
#include <random>
#include <span>
#include <vector>

#include "query/cache/cluster_cache.h"
#include "query/cache/unit_image.h"
#include "tests/query/mt_fixture.h"

namespace mtdb::testing {

using namespace internal;

namespace {

// A strip of so many nodes, each of which removes the triangle of the one before.
Cluster Strip(uint32_t nodes, uint32_t children) {
  Cluster c;
  c.in.triangles = {{0, 1, 2}};
  c.in.vertices = {7, 8, 9};
  for (uint32_t v = 0; v < 3 + nodes; ++v) c.in.positions.push_back({static_cast<int>(v), 1, 2});
  c.first_own_slot = 1;
  c.ring_begin = c.hole_begin = {0};
  c.star_begin = {1};
  c.removers = {0};
  for (uint32_t child = 0; child < children; ++child) c.children.push_back(child);
  for (uint32_t i = 0; i < nodes; ++i) {
    c.error_codes.push_back(static_cast<uint8_t>(i));
    c.ring_vertices.insert(c.ring_vertices.end(), {i, i + 1});
    c.hole_slots.push_back(i);
    c.ring_begin.push_back(2 * i + 2);
    c.hole_begin.push_back(i + 1);
    c.star_begin.push_back(i + 2);
    c.removers.push_back(i + 1 < nodes  ? i + 1
                         : children > 0 ? kChildFlag | (children - 1)
                                        : kDrain);
  }
  return c;
}

StatusCode CodeOf(const Cluster& cluster) { return MakeCompact(cluster, "here").status().code(); }

}  // namespace

TEST_CASE("A compact cluster says the same") {
  for (const uint32_t children : {0u, 1u, 9u, kMostChildren}) {
    const Cluster wide = Strip(500, children);
    const CompactCluster c = MakeCompact(wide, "here").value();
    REQUIRE(c.nodes() == wide.nodes());
    REQUIRE(c.slots() == wide.slots());
    REQUIRE(c.external_vertices() == wide.external_vertices());
    for (uint32_t s = 0; s < c.slots(); ++s) REQUIRE(c.removers[s] == wide.removers[s]);
    for (uint32_t v = 0; v < c.positions.size(); ++v) REQUIRE(c.position(v) == wide.position(v));
    for (NodeIndex i = 0; i < c.nodes(); ++i) {
      REQUIRE(std::ranges::equal(c.ring(i), wide.ring(i)));
      REQUIRE(std::ranges::equal(c.hole(i), wide.hole(i)));
      REQUIRE(c.boundary(i) == wide.boundary(i));
      REQUIRE(c.created_triangle(i, i + 1) == wide.created_triangle(i, i + 1));
    }
  }
}

TEST_CASE("A cluster of more than 16 bits count is refused") {
  REQUIRE(CodeOf(Strip(32'767, 0)) == StatusCode::kOk);
  REQUIRE(CodeOf(Strip(32'768, 0)) == StatusCode::kCorrupt);
  REQUIRE(CodeOf(Strip(10, kMostChildren)) == StatusCode::kOk);
  REQUIRE(CodeOf(Strip(10, kMostChildren + 1)) == StatusCode::kCorrupt);
  Cluster piece;
  piece.in.triangles.assign(65'535, {0, 1, 2});
  piece.removers.assign(65'535, kDrain);
  piece.in.positions.resize(65'535);
  REQUIRE(CodeOf(piece) == StatusCode::kOk);
  Cluster larger = piece;
  larger.in.positions.emplace_back();
  REQUIRE(CodeOf(larger) == StatusCode::kCorrupt);
  larger = piece;
  larger.removers.push_back(kDrain);
  REQUIRE(CodeOf(larger) == StatusCode::kCorrupt);
}

TEST_CASE("A cluster whose row in the index names too many in-triangles is refused") {
  const MtFixture f = MakeTorus(40, 16);
  const ClusterIndex& index = f.source->index();
  ClusterCache cache(f.source, {size_t{1} << 30});
  LoadStats stats;
  for (const uint32_t in_triangles : {kMostSlots, kMostSlots + 1, kNone32}) {
    ClusterIndex hostile;
    for (UnitId u = 0; u < index.unit_count(); ++u) {
      UnitEntry entry = index.unit(u);
      if (u == 0) entry.in_triangles = in_triangles;
      hostile.Add(entry, index.location(u), index.children(u));
    }
    hostile.Finish(index.root_vertices());
    std::vector<LoadedUnitPtr> parents;
    for (const UnitId p : index.parents(0)) parents.push_back(cache.Get(p, &stats).value());
    const Status status = LoadUnit(f.source->record(), hostile, 0, {}, parents).status();
    REQUIRE(status.code() == StatusCode::kCorrupt);
    const bool is_refused =
        status.message().find("more than a cluster may have") != std::string::npos;
    REQUIRE(is_refused == (in_triangles > kMostSlots));
  }
}

TEST_CASE("Positions are kept, near and far") {
  constexpr int32_t kLeast = std::numeric_limits<int32_t>::min();
  constexpr int32_t kGreatest = std::numeric_limits<int32_t>::max();
  std::mt19937 random(1);
  for (const int32_t low : {kLeast, -70'000, -3, kGreatest - 0xffff}) {
    for (const uint32_t extent : {0u, 1u, 0xffffu, 0x10000u, 0xffffffffu}) {
      std::vector<Vec3i> positions;
      for (int i = 0; i < 40; ++i) {
        Vec3i p;
        for (int c = 0; c < 3; ++c) {
          const uint32_t step = i < 2 ? i * extent : random() % (uint64_t{extent} + 1);
          p[c] = static_cast<int32_t>(static_cast<uint32_t>(low) + step);
        }
        positions.push_back(p);
      }
      const LocalPositions local(positions);
      REQUIRE(local.All() == positions);
      REQUIRE(LocalPositions(local).All() == positions);
    }
  }
  REQUIRE(LocalPositions(std::vector<Vec3i>()).size() == 0);
}

TEST_CASE("A decoded cluster has no spare room") {
  const MtFixture f = MakeTorus(40, 16);
  ClusterCache cache(f.source, {size_t{1} << 30});
  LoadStats stats;
  size_t bytes = 0, needed = 0;
  for (UnitId u = 0; u < f.source->record_.clusters; ++u) {
    const LoadedUnitPtr unit = cache.Get(u, &stats).value();
    bytes += unit->memory_bytes();
    needed += MakeUnitImage(*unit).size() + sizeof(LoadedUnit);
  }
  REQUIRE(bytes <= needed);
}

// Each at its in-slot, however many are asked about at once; others nowhere.
void RequireArcsArrive(const LoadedUnit& unit) {
  std::vector<Arc> arcs;
  for (const SlotOrigin& origin : unit.origins) {
    arcs.push_back({unit.parents[origin.parent], origin.slot});
    REQUIRE(unit.FindInSlot(arcs.back()) == arcs.size() - 1);
  }
  const size_t known = arcs.size();
  for (const UnitId parent : unit.parents) arcs.push_back({parent, 70000});
  arcs.push_back({unit.id, 0});
  std::array<uint32_t, LoadedUnit::kArcsAtOnce> slots{};
  for (size_t first = 0; first < arcs.size();) {
    const size_t n = std::min(1 + first % slots.size(), arcs.size() - first);
    unit.FindInSlots(std::span(arcs).subspan(first, n), slots.data());
    for (size_t i = 0; i < n; ++i) {
      REQUIRE(slots[i] == (first + i < known ? first + i : size_t{kNone32}));
    }
    first += n;
  }
}

TEST_CASE("A decoded cluster knows who creates and removes its slots") {
  const MtFixture f = MakeTorus(40, 16);
  ClusterCache cache(f.source, {size_t{1} << 30});
  LoadStats stats;
  size_t to_children = 0;
  for (UnitId u = 0; u < f.source->index().unit_count(); ++u) {
    const LoadedUnitPtr unit = cache.Get(u, &stats).value();
    std::vector<std::vector<LocalNumber>> removed_by(unit->children().size());
    NodeIndex creator = kNone32;
    for (uint32_t slot = 0; slot < unit->cluster.slots(); ++slot) {
      // kNone32 + 1 is the first node.
      while (creator + 1 < unit->nodes() && unit->cluster.star_begin[creator + 1] <= slot) {
        ++creator;
      }
      REQUIRE(unit->creator(slot) == (slot < unit->cluster.listed() ? kNone32 : creator));
      const uint32_t remover = unit->removers()[slot];
      if (RemovedByChild(remover)) {
        removed_by[ChildOrdinal(remover)].push_back(static_cast<LocalNumber>(slot));
      }
      if (slot < unit->first_own_slot()) continue;
      const uint32_t own = slot - unit->first_own_slot();
      REQUIRE((unit->drain[own >> 6] >> (own & 63) & 1) == (remover == kDrain));
    }
    RequireArcsArrive(*unit);
    for (uint32_t child = 0; child < removed_by.size(); ++child) {
      REQUIRE(std::ranges::equal(unit->slots_of_child(child), removed_by[child]));
      to_children += removed_by[child].size();
    }
  }
  REQUIRE(to_children > 0);
}

}  // namespace mtdb::testing
