// SPDX-License-Identifier: Apache-2.0
// The cut itself, against the plain DAG: what is inserted, taken back, removed, undone and counted.
#include "query/cut/cut_state.h"

#include <catch2/catch.hpp>
#include <random>
#include <set>
#include <vector>

#include "query/cut/judge.h"
#include "query/cut/stored_order_pass.h"
#include "query/cut/unit_pins.h"
#include "query/cut/unit_queue.h"
#include "query/surface.h"
#include "tests/query/mt_fixture.h"
#include "tests/query/oracle.h"

namespace mtdb::testing {

using namespace internal;

namespace {

MtFixture Fixture(uint32_t i) {
  MtOptions options;
  options.shape = static_cast<Shape>(i % 4);
  options.seed = 70 + i;
  options.resolution = 9;
  options.coincident = i % 3 == 1;
  return MakeMt(options);
}

struct Holder {
  Holder(const MtFixture& fixture, bool remembers)
      : f(fixture),
        surface(*Surface::Open(fixture.source)),
        reader(surface->cache(), {}),
        meter([this] { return reader.Check(); }),
        cut(*fixture.source, remembers),
        pins(cut, reader, meter) {
    for (UnitId id = f.source->index_.cluster_count(); id < f.source->index_.unit_count(); ++id) {
      cut.InsertRoot(cut.Open(id), Loaded(id));
    }
  }
  const LoadedUnit& Loaded(UnitId id) { return *pins.Pin(cut.Open(id)).value(); }
  std::vector<bool> Applied() const { return AppliedIn(f, cut); }
  // The counts are those of the DAG's mesh; a unit that has not been looked at counts as its
  // largest.
  void RequireRight(const std::vector<bool>& applied) {
    REQUIRE(Applied() == applied);
    std::array<uint64_t, 256> by_code{};
    const std::vector<uint32_t> mesh = f.mt.Mesh(applied);
    for (const uint32_t id : mesh) {
      const InMemoryMt::Triangle& t = f.mt.triangles[id];
      if (t.remover < 0) {
        ++by_code[0];
        continue;
      }
      const InMemoryMt::Node& node = f.mt.nodes[static_cast<size_t>(t.remover)];
      const bool inside =
          t.creator >= 0 && f.mt.nodes[static_cast<size_t>(t.creator)].cluster == node.cluster;
      ++by_code[inside || cut.Looked(node.cluster) ? node.code : cut.LargestCode(node.cluster)];
    }
    REQUIRE(cut.counts().triangles == mesh.size());
    REQUIRE(cut.counts().applied ==
            static_cast<uint64_t>(std::count(applied.begin(), applied.end(), true)));
    if (cut.remembers()) REQUIRE(cut.counts().by_code == by_code);
    uint64_t present = 0;
    for (const UnitId id : cut.open()) present += cut.Find(id)->present.Count();
    REQUIRE(present == mesh.size());
  }

  const MtFixture& f;
  std::shared_ptr<const Surface> surface;
  UnitReader reader;
  WorkMeter meter;
  CutState cut;
  UnitPins pins;
};

}  // namespace

TEST_CASE("A cut holds what was inserted with its ancestors, until it is removed or undone") {
  for (uint32_t i = 0; i < 6; ++i) {
    const MtFixture f = Fixture(i);
    Holder holder(f, i % 2 == 0);
    std::mt19937 random(i);
    std::vector<bool> applied(f.mt.nodes.size(), false);
    holder.cut.EndRound();
    std::vector<bool> at_round = applied;
    for (int step = 0; step < 120; ++step) {
      const auto n = std::uniform_int_distribution<size_t>(0, f.mt.nodes.size() - 1)(random);
      const InMemoryMt::Node& node = f.mt.nodes[n];
      std::vector<CutState::NodeRef> inserted;
      const unsigned what = random() % 8;
      if (what < 4) {
        CutUnit& u = holder.cut.Open(node.cluster);
        REQUIRE(holder.cut.Insert({&u, node.index}, holder.pins, &inserted).ok());
        std::vector<bool> next = applied;
        f.mt.Close(static_cast<int>(n), next);
        holder.RequireRight(next);
        if (what == 3) {
          holder.cut.TakeBack(inserted);
          holder.RequireRight(applied);
        } else {
          applied = next;
        }
      } else if (what < 6) {
        // Some applied node without applied children.
        std::vector<bool> needed(applied.size());
        for (size_t c = 0; c < applied.size(); ++c) {
          if (!applied[c]) continue;
          for (const int p : f.mt.Parents(static_cast<int>(c)))
            needed[static_cast<size_t>(p)] = true;
        }
        for (size_t c = 0; c < applied.size(); ++c) {
          if (!applied[c] || needed[c]) continue;
          const UnitId id = f.mt.nodes[c].cluster;
          const LoadedUnit& unit = holder.Loaded(id);
          holder.cut.Remove(*holder.cut.Find(id), unit, f.mt.nodes[c].index);
          applied[c] = false;
          break;
        }
        holder.RequireRight(applied);
      } else if (what == 6) {
        holder.cut.EndRound();
        at_round = applied;
      } else {
        holder.pins.Release();
        holder.cut.Undo();
        applied = at_round;
        holder.RequireRight(applied);
      }
    }
  }
}

TEST_CASE("Units with work are taken once, coarsest first") {
  const MtFixture f = Fixture(0);
  Holder holder(f, false);
  UnitQueue queue(holder.cut);
  const UnitId units = f.source->index_.unit_count();
  REQUIRE(units > 3);
  for (const UnitId id : {UnitId{1}, units - 1, UnitId{0}, UnitId{1}}) {
    queue.Add(holder.cut.Open(id));
  }
  REQUIRE(queue.Take().id == units - 1);
  queue.Add(holder.cut.Open(2));
  for (const UnitId id : {UnitId{2}, UnitId{1}, UnitId{0}}) {
    REQUIRE(!queue.empty());
    REQUIRE(queue.Take().id == id);
  }
  REQUIRE(queue.empty());
  queue.Add(holder.cut.Open(1));
  queue.Clear();
  REQUIRE(queue.empty());
}

TEST_CASE("Two nodes that remove one triangle are found, and nothing has changed") {
  const MtFixture f = Fixture(0);
  Holder holder(f, false);
  // A node of an inner cluster, whose in-triangles come from elsewhere.
  for (size_t n = 0; n < f.mt.nodes.size(); ++n) {
    const InMemoryMt::Node& node = f.mt.nodes[n];
    const std::vector<int> parents = f.mt.Parents(static_cast<int>(n));
    if (parents.empty()) continue;
    std::vector<CutState::NodeRef> inserted;
    const InMemoryMt::Node& parent = f.mt.nodes[static_cast<size_t>(parents[0])];
    REQUIRE(
        holder.cut.Insert({&holder.cut.Open(parent.cluster), parent.index}, holder.pins, &inserted)
            .ok());
    // As if another node had removed all that the parent created.
    CutUnit& of = *holder.cut.Find(parent.cluster);
    const CompactCluster& cluster = holder.Loaded(parent.cluster).cluster;
    of.present.ClearRange(cluster.star_begin[parent.index] - of.first_own,
                          cluster.star_begin[parent.index + 1] - of.first_own);
    const std::vector<bool> before = holder.Applied();
    inserted.clear();
    const Status status =
        holder.cut.Insert({&holder.cut.Open(node.cluster), node.index}, holder.pins, &inserted);
    CHECK(status.code() == StatusCode::kCorrupt);
    CHECK(status.message().find("two nodes remove one triangle") != std::string::npos);
    CHECK(inserted.empty());
    CHECK(holder.Applied() == before);
    return;
  }
  FAIL("no node has parents");
}

TEST_CASE("The pass in stored order inserts what node by node would be") {
  uint64_t by_pass = 0;
  uint64_t left = 0;
  for (uint32_t i = 0; i < 40; ++i) {
    const MtFixture f = Fixture(i);
    std::mt19937 random(i);
    const Query query = RandomQuery(f, random);
    Judge judge(*f.source, f.source->record_.rounding_error);
    judge.SetQuery(query);
    // Node by node, as long as one of the unit's removes a present refused triangle.
    const auto complete = [&](Holder& holder, UnitId id) {
      judge.SetMeter(&holder.meter);
      const LoadedUnit& unit = holder.Loaded(id);
      CutUnit& u = *holder.cut.Find(id);
      std::vector<CutState::NodeRef> inserted;
      for (size_t before = 1; before != inserted.size();) {
        before = inserted.size();
        for (NodeIndex node = 0; node < unit.nodes(); ++node) {
          for (const uint32_t slot : unit.cluster.hole(node)) {
            if (!holder.cut.Present(u, unit, slot)) continue;
            const uint8_t code = unit.cluster.error_codes[node];
            if (!judge.Refused(unit, slot, unit.creator(slot), code)) continue;
            REQUIRE(holder.cut.Insert({&u, node}, holder.pins, &inserted).ok());
            break;
          }
        }
      }
      return inserted.size();
    };
    Holder fast(f, false);
    Holder slow(f, false);
    // Parents before children, as a search that looks into all clusters.
    for (UnitId id = f.source->index_.cluster_count(); id-- > 0;) {
      const LoadedUnit& unit = fast.Loaded(id);
      judge.SetMeter(&fast.meter);
      StoredOrderPass(fast.cut, judge).Run(*fast.cut.Find(id), unit);
      by_pass += fast.cut.Find(id)->applied_count;
      left += complete(fast, id);
      complete(slow, id);
      REQUIRE(fast.Applied() == slow.Applied());
    }
    fast.RequireRight(slow.Applied());
  }
  CHECK(left > 0);
  CHECK(by_pass > left);
}

}  // namespace mtdb::testing
