// SPDX-License-Identifier: Apache-2.0
#include "tests/query/plain_dag.h"

#include <catch2/catch.hpp>
#include <map>

#include "query/cache/cluster_cache.h"

namespace mtdb::sheets {
namespace {

using mtdb::testing::InMemoryMt;
using mtdb::testing::MtFixture;
using namespace mtdb::internal;

// Units from the root on, so that what creates a triangle comes before what removes it.
class DagMaker {
 public:
  explicit DagMaker(const Surface& surface) : index_(surface.index()) {}

  void Add(const LoadedUnit& unit) {
    AddVertices(unit);
    const CompactCluster& c = unit.cluster;
    std::vector<uint32_t>& slots = slots_[unit.id];
    for (uint32_t slot = 0; slot < c.listed(); ++slot) {
      if (slot >= c.in_triangles()) {
        mt_.root_triangles.push_back(AddTriangle(unit, slot, -1, slots));
        continue;
      }
      const SlotOrigin& origin = unit.origins[slot];
      slots.push_back(slots_.at(unit.parents[origin.parent])[origin.slot]);
    }
    for (NodeIndex i = 0; i < c.nodes(); ++i) {
      // Further numbers of a node that brings a crumb say nothing.
      if (c.crumb(i) && c.hole(i).empty()) continue;
      const auto number = static_cast<int>(mt_.nodes.size());
      InMemoryMt::Node& node = mt_.nodes.emplace_back();
      node.code = c.error_codes[i];
      node.boundary = c.boundary(i);
      node.vertex = vertices_.at(index_.first_vertex(unit.id) + i);
      node.cluster = unit.id;
      node.index = i;
      for (uint32_t slot = c.star_begin[i]; slot < c.star_begin[i + 1]; ++slot) {
        node.star.push_back(AddTriangle(unit, slot, number, slots));
      }
      for (const uint32_t slot : c.hole(i)) {
        node.hole.push_back(slots[slot]);
        REQUIRE(mt_.triangles[slots[slot]].remover == -1);
        mt_.triangles[slots[slot]].remover = number;
      }
    }
  }

  // Parents get the larger numbers.
  InMemoryMt Take() {
    const auto last = static_cast<int>(mt_.nodes.size()) - 1;
    std::reverse(mt_.nodes.begin(), mt_.nodes.end());
    for (InMemoryMt::Triangle& t : mt_.triangles) {
      if (t.creator >= 0) t.creator = last - t.creator;
      if (t.remover >= 0) t.remover = last - t.remover;
    }
    return std::move(mt_);
  }

 private:
  void AddVertices(const LoadedUnit& unit) {
    const uint32_t external = unit.cluster.external_vertices();
    locals_.clear();
    for (uint32_t v = 0; v < external + unit.nodes(); ++v) {
      const VertexIndex number =
          v < external ? unit.vertex(v) : index_.first_vertex(unit.id) + (v - external);
      const auto [at, fresh] =
          vertices_.try_emplace(number, static_cast<uint32_t>(mt_.positions.size()));
      if (fresh) mt_.positions.push_back(unit.positions()[v]);
      REQUIRE(mt_.positions[at->second] == unit.positions()[v]);
      locals_.push_back(at->second);
    }
  }
  uint32_t AddTriangle(const LoadedUnit& unit, uint32_t slot, int creator,
                       std::vector<uint32_t>& slots) {
    const auto id = static_cast<uint32_t>(mt_.triangles.size());
    const auto [a, b, c] = unit.corners(slot, unit.creator(slot));
    mt_.triangles.push_back({{locals_[a], locals_[b], locals_[c]}, creator, -1});
    REQUIRE(slots.size() == slot);
    slots.push_back(id);
    return id;
  }

  const ClusterIndex& index_;
  InMemoryMt mt_;
  std::map<VertexIndex, uint32_t> vertices_;       // by the object's numbers
  std::vector<uint32_t> locals_;                   // of the unit's local vertices
  std::map<UnitId, std::vector<uint32_t>> slots_;  // triangles
};

}  // namespace

MtFixture PlainDagOf(const Surface& surface) {
  MtFixture fixture;
  fixture.source = std::make_shared<mtdb::testing::MemoryClusterSource>();
  fixture.source->record_ = surface.record();
  fixture.source->index_ = surface.index();
  DagMaker maker(surface);
  LoadStats stats;
  for (UnitId unit = surface.index().unit_count(); unit-- > 0;) {
    const Result<LoadedUnitPtr> loaded = surface.cache().Get(unit, &stats);
    REQUIRE(loaded.ok());
    maker.Add(**loaded);
  }
  fixture.mt = maker.Take();
  return fixture;
}

}  // namespace mtdb::sheets
