// SPDX-License-Identifier: Apache-2.0
// Queries and moving cuts on a Multi-Triangulation whose nodes are of no particular shape: each
// exchanges a set of triangles for another one, and inserts two vertices.
#include <algorithm>
#include <catch2/catch.hpp>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <vector>

#include "query/cache/cluster_cache.h"
#include "query/cut/search.h"
#include "query/moving/moving_cut.h"
#include "tests/query/mt_fixture.h"
#include "tests/query/oracle.h"

namespace mtdb::testing {

using namespace internal;

namespace {

constexpr uint32_t kVertices = 2;  // that a node inserts
constexpr uint32_t kNodes = 12;    // of a cluster

// Nodes are made from the root down. Triangles need not fit together: no part of the engine asks.
class ShapelessMt {
 public:
  explicit ShapelessMt(uint32_t seed, uint32_t nodes) : random_(seed) {
    f_.source = std::make_shared<MemoryClusterSource>();
    MakeDag(nodes);
    MakeUnits();
    ObjectRecord& r = f_.source->record_;
    r.name = "shapeless";
    r.clusters = f_.source->index_.cluster_count();
    r.root_pieces = 1;
    r.root_vertices = kRootVertices;
  }

  const MtFixture& fixture() const { return f_; }
  std::unique_ptr<ClusterCache> Cache(size_t bytes) const {
    CacheOptions options;
    options.budget_bytes = bytes;
    options.loader = [this](const ObjectRecord&, const ClusterIndex&, UnitId unit, ByteSpan,
                            std::span<const LoadedUnitPtr>) -> Result<LoadedUnitPtr> {
      return units_[unit];
    };
    return std::make_unique<ClusterCache>(f_.source, options);
  }

 private:
  static constexpr uint32_t kRootVertices = 24;

  uint32_t Below(size_t n) {
    return std::uniform_int_distribution<uint32_t>(0, static_cast<uint32_t>(n) - 1)(random_);
  }
  void AddVertex(Vec3i near, int32_t spread) {
    const auto off = [&] { return static_cast<int32_t>(Below(2 * spread)) - spread; };
    f_.mt.positions.push_back({near.x + off(), near.y + off(), near.z + off()});
  }

  void MakeDag(uint32_t nodes) {
    InMemoryMt& mt = f_.mt;
    f_.source->record_.grid.step = 1.0 / 16384;
    f_.source->record_.grid.error_unit = 1e-3;
    for (uint32_t v = 0; v < kRootVertices; ++v) AddVertex({0, 0, 0}, 16384);
    std::vector<uint32_t> mesh;
    const auto add = [&](std::array<uint32_t, 3> corners, int creator) {
      mesh.push_back(static_cast<uint32_t>(mt.triangles.size()));
      mt.triangles.push_back({corners, creator, -1});
    };
    for (uint32_t t = 0; t < 30; ++t) {
      add({Below(kRootVertices), Below(kRootVertices), Below(kRootVertices)}, -1);
      mt.root_triangles.push_back(t);
    }
    for (uint32_t n = 0; n < nodes; ++n) {
      InMemoryMt::Node node{};
      node.code = static_cast<uint8_t>(Below(100));
      node.cluster = 0;
      const size_t holes = 1 + Below(5);
      for (size_t h = 0; h < holes && mesh.size() > 1; ++h) {
        // Mostly young ones, so that there are chains.
        const size_t at = Below(3) == 0
                              ? Below(mesh.size())
                              : mesh.size() - 1 - Below(std::min<size_t>(mesh.size(), 20));
        node.hole.push_back(mesh[at]);
        mt.triangles[mesh[at]].remover = static_cast<int>(n);
        mesh.erase(mesh.begin() + static_cast<std::ptrdiff_t>(at));
      }
      std::vector<uint32_t> corners;
      for (const uint32_t id : node.hole) {
        const auto& of = mt.triangles[id].vertices;
        corners.insert(corners.end(), of.begin(), of.end());
      }
      const Vec3i near = mt.positions[corners[0]];
      node.vertex = static_cast<uint32_t>(mt.positions.size());
      for (uint32_t v = 0; v < kVertices; ++v) {
        corners.push_back(static_cast<uint32_t>(mt.positions.size()));
        AddVertex(near, 2000);
      }
      const size_t stars = 1 + Below(7);
      for (size_t s = 0; s < stars; ++s) {
        node.star.push_back(static_cast<uint32_t>(mt.triangles.size()));
        add({corners[Below(corners.size())], corners[Below(corners.size())], corners.back()},
            static_cast<int>(n));
      }
      mt.nodes.push_back(std::move(node));
    }
    for (const Vec3i& p : mt.positions) {
      f_.source->record_.bounds.Add(f_.source->record_.grid.Position(p));
    }
  }

  // The first nodes are the coarsest, and units are numbered from the finest on.
  void MakeUnits() {
    InMemoryMt& mt = f_.mt;
    const auto clusters = static_cast<uint32_t>((mt.nodes.size() + kNodes - 1) / kNodes);
    for (size_t n = 0; n < mt.nodes.size(); ++n) {
      mt.nodes[n].cluster = clusters - 1 - static_cast<uint32_t>(n / kNodes);
      mt.nodes[n].index = static_cast<NodeIndex>(n % kNodes);
    }
    std::vector<UnitId> unit_of(mt.triangles.size());  // that creates it
    std::vector<uint32_t> slot_of(mt.triangles.size());
    std::vector<std::shared_ptr<LoadedUnit>> units(clusters + 1);
    std::vector<UnitEntry> entries(clusters + 1);
    for (UnitId id = clusters + 1; id-- > 0;)
      MakeUnit(id, clusters, unit_of, slot_of, units, entries);
    f_.source->index_ = {};
    for (UnitId id = 0; id <= clusters; ++id) {
      f_.source->index_.Add(entries[id], {0, 0, 1}, units[id]->cluster.children);
      f_.source->payloads_.push_back(Bytes(1));
      units_.push_back(units[id]);
    }
    f_.source->index_.Finish(kRootVertices);
  }

  void MakeUnit(UnitId id, UnitId root, std::vector<UnitId>& unit_of,
                std::vector<uint32_t>& slot_of, std::vector<std::shared_ptr<LoadedUnit>>& units,
                std::vector<UnitEntry>& entries) {
    const InMemoryMt& mt = f_.mt;
    auto unit = std::make_shared<LoadedUnit>();
    units[id] = unit;
    unit->id = id;
    Cluster c;
    std::vector<uint32_t> nodes;
    for (uint32_t n = 0; n < mt.nodes.size(); ++n) {
      if (mt.nodes[n].cluster == id && id != root) nodes.push_back(n);
    }
    // The triangles that it lists.
    std::vector<uint32_t> listed = id == root ? mt.root_triangles : std::vector<uint32_t>{};
    for (const uint32_t n : nodes) {
      for (const uint32_t t : mt.nodes[n].hole) {
        if (mt.triangles[t].creator < 0 ||
            mt.nodes[static_cast<size_t>(mt.triangles[t].creator)].cluster != id) {
          listed.push_back(t);
        }
      }
    }
    std::map<uint32_t, uint32_t> locals;
    const auto local = [&](uint32_t v) {
      const auto [at, added] = locals.emplace(v, static_cast<uint32_t>(locals.size()));
      if (added) {
        c.in.positions.push_back(mt.positions[v]);
        entries[id].bounds.Add(mt.positions[v]);
      }
      return at->second;
    };
    const auto corners = [&](uint32_t t) {
      const auto& v = mt.triangles[t].vertices;
      return std::array<uint32_t, 3>{local(v[0]), local(v[1]), local(v[2])};
    };
    std::vector<uint32_t> slots = listed;
    for (const uint32_t t : listed) c.in.triangles.push_back(corners(t));
    c.in.vertices.resize(locals.size());
    unit->owners.assign(locals.size(), kNone32);
    c.first_own_slot = id == root ? 0 : static_cast<uint32_t>(listed.size());
    std::map<uint32_t, uint32_t> slot_here;
    for (uint32_t s = 0; s < slots.size(); ++s) slot_here[slots[s]] = s;
    c.ring_begin = c.hole_begin = {0};
    c.vertex_begin = {static_cast<uint32_t>(locals.size())};
    c.star_begin = {static_cast<uint32_t>(slots.size())};
    for (const uint32_t n : nodes) {
      const InMemoryMt::Node& node = mt.nodes[n];
      c.error_codes.push_back(node.code);
      for (uint32_t v = 0; v < kVertices; ++v) local(node.vertex + v);
      c.vertex_begin.push_back(static_cast<uint32_t>(locals.size()));
      std::set<uint32_t> ring;
      for (const uint32_t t : node.hole) {
        c.hole_slots.push_back(slot_here.at(t));
        for (const uint32_t v : corners(t)) ring.insert(v);
      }
      c.ring_vertices.insert(c.ring_vertices.end(), ring.begin(), ring.end());
      for (const uint32_t t : node.star) {
        slot_here[t] = static_cast<uint32_t>(slots.size());
        slots.push_back(t);
        c.created_corners.push_back(corners(t));
      }
      c.ring_begin.push_back(static_cast<uint32_t>(c.ring_vertices.size()));
      c.hole_begin.push_back(static_cast<uint32_t>(c.hole_slots.size()));
      c.star_begin.push_back(static_cast<uint32_t>(slots.size()));
    }
    std::set<UnitId> children;
    for (uint32_t s = c.first_own_slot; s < slots.size(); ++s) {
      unit_of[slots[s]] = id;
      slot_of[slots[s]] = s;
      const int remover = mt.triangles[slots[s]].remover;
      if (remover >= 0 && mt.nodes[static_cast<size_t>(remover)].cluster != id) {
        children.insert(mt.nodes[static_cast<size_t>(remover)].cluster);
      }
    }
    c.children.assign(children.begin(), children.end());
    unit->drain.resize((slots.size() - c.first_own_slot + 63) / 64);
    for (uint32_t s = 0; s < slots.size(); ++s) {
      const int remover = mt.triangles[slots[s]].remover;
      if (remover < 0) {
        c.removers.push_back(kDrain);
        unit->drain[(s - c.first_own_slot) >> 6] |= uint64_t{1} << ((s - c.first_own_slot) & 63);
        continue;
      }
      const InMemoryMt::Node& node = mt.nodes[static_cast<size_t>(remover)];
      const auto child = std::lower_bound(c.children.begin(), c.children.end(), node.cluster);
      c.removers.push_back(node.cluster == id
                               ? node.index
                               : kChildFlag | static_cast<uint32_t>(child - c.children.begin()));
    }
    unit->cluster = MakeCompact(c, "unit").value();
    FillOrigins(*unit, listed, unit_of, slot_of, units);
    FillOutSlots(*unit);
    for (uint32_t s = c.listed(); s < slots.size(); s += LoadedUnit::kCreatorStep) {
      const auto creator = static_cast<size_t>(mt.triangles[slots[s]].creator);
      unit->creators.push_back(static_cast<LocalNumber>(mt.nodes[creator].index));
    }
    UnitEntry& entry = entries[id];
    entry.round = id == root ? kRootRound : 1;
    entry.hilbert = id;
    entry.nodes = static_cast<uint32_t>(nodes.size());
    entry.in_triangles = c.first_own_slot;
    entry.external_vertices = c.external_vertices();
    entry.error_code_min = id == root ? 0 : 255;
    for (const uint8_t code : c.error_codes) {
      entry.error_code_min = std::min(entry.error_code_min, code);
      entry.error_code_max = std::max(entry.error_code_max, code);
    }
  }

  static void FillOutSlots(LoadedUnit& unit) {
    for (uint32_t child = 0; child < unit.children().size(); ++child) {
      unit.out_begin.push_back(static_cast<LocalNumber>(unit.out_slots.size()));
      for (uint32_t s = unit.first_own_slot(); s < unit.cluster.slots(); ++s) {
        if (unit.removers()[s] != (kChildFlag | child)) continue;
        unit.out_slots.push_back(static_cast<LocalNumber>(s));
      }
    }
    unit.out_begin.push_back(static_cast<LocalNumber>(unit.out_slots.size()));
  }

  static void FillOrigins(LoadedUnit& unit, const std::vector<uint32_t>& listed,
                          const std::vector<UnitId>& unit_of, const std::vector<uint32_t>& slot_of,
                          const std::vector<std::shared_ptr<LoadedUnit>>& units) {
    const uint32_t in_triangles = unit.cluster.first_own_slot;
    std::set<UnitId> parents;
    for (uint32_t s = 0; s < in_triangles; ++s) parents.insert(unit_of[listed[s]]);
    unit.parents.assign(parents.begin(), parents.end());
    for (uint32_t s = 0; s < in_triangles; ++s) {
      const UnitId parent = unit_of[listed[s]];
      const auto at = std::lower_bound(unit.parents.begin(), unit.parents.end(), parent);
      unit.origins.push_back(
          {static_cast<LocalNumber>(at - unit.parents.begin()),
           static_cast<LocalNumber>(slot_of[listed[s]]),
           static_cast<LocalNumber>(units[parent]->creator(slot_of[listed[s]]))});
      unit.by_origin.push_back(static_cast<LocalNumber>(s));
    }
    std::sort(unit.by_origin.begin(), unit.by_origin.end(), [&](uint32_t a, uint32_t b) {
      return std::pair(unit.origins[a].parent, unit.origins[a].slot) <
             std::pair(unit.origins[b].parent, unit.origins[b].slot);
    });
  }

  std::mt19937 random_;
  MtFixture f_;
  std::vector<LoadedUnitPtr> units_;
};

uint64_t Count(const std::vector<bool>& flags) {
  return static_cast<uint64_t>(std::count(flags.begin(), flags.end(), true));
}

}  // namespace

TEST_CASE("A search finds the least cut of nodes of any shape") {
  uint64_t applied_in_all = 0;
  for (uint32_t seed = 0; seed < 60; ++seed) {
    const ShapelessMt mt(seed, seed % 3 == 0 ? 10 : 150);
    const MtFixture& f = mt.fixture();
    const auto cache = mt.Cache(8 << 20);
    std::mt19937 random(seed);
    for (int i = 0; i < 12; ++i) {
      Query query = RandomQuery(f, random);
      const Oracle oracle(f, query);
      std::vector<bool> expected = oracle.LeastCut(random);
      if (seed % 3 == 0) REQUIRE(expected == oracle.LeastCutByEnumeration());
      QueryLimit limit = QueryLimit::kThreshold;
      if (i % 3 == 2) {
        query.max_triangles = f.mt.root_triangles.size() + random() % 300;
        expected = Oracle(f, query).GreedyCut(&limit);
      }
      UnitReader reader(*cache, {});
      CutState cut(*f.source, false);
      const auto outcome =
          Search(*f.source, reader, query, f.source->record_.rounding_error, &cut).Run();
      INFO("seed " << seed << ", query " << i << ": " << outcome.status().message());
      REQUIRE(outcome.ok());
      REQUIRE(AppliedIn(f, cut) == expected);
      REQUIRE(outcome->limit == limit);
      REQUIRE(cut.counts().triangles == f.mt.Mesh(expected).size());
      REQUIRE(cut.counts().vertices == kVertices * Count(expected));
      applied_in_all += Count(expected);
    }
  }
  CHECK(applied_in_all > 5000);
}

TEST_CASE("A moving cut follows the least cut of nodes of any shape") {
  for (uint32_t seed = 0; seed < 20; ++seed) {
    const ShapelessMt mt(1000 + seed, 150);
    const MtFixture& f = mt.fixture();
    const auto cache = mt.Cache(8 << 20);
    std::mt19937 random(seed);
    MovingCut cut(*f.source);
    Vec3d at = f.source->record_.bounds.max;
    for (int step = 0; step < 100; ++step) {
      Query query;
      if (step % 10 == 0) query = RandomQuery(f, random);
      std::uniform_real_distribution<double> by(-0.1, 0.1);
      for (int i = 0; i < 3; ++i) at[i] += by(random);
      if (step % 10 != 0) query.threshold = LinearThreshold(at, 0, 0.3);
      UnitReader reader(*cache, {});
      const uint64_t round_nodes = step % 3 == 0 ? 1 + random() % 10 : 0;
      REQUIRE(cut.Move(reader, query, round_nodes, [] { return Status::Ok(); }).ok());
      const std::vector<bool> expected = Oracle(f, query).LeastCut(random);
      for (size_t n = 0; n < expected.size(); ++n) {
        const Bits& bits = cut.applied(f.mt.nodes[n].cluster);
        REQUIRE(expected[n] == (!bits.empty() && bits.Test(f.mt.nodes[n].index)));
      }
      REQUIRE(cut.counts().triangles == f.mt.Mesh(expected).size());
      REQUIRE(cut.counts().vertices == kVertices * Count(expected));
    }
  }
}

}  // namespace mtdb::testing
