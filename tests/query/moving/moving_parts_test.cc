// SPDX-License-Identifier: Apache-2.0
// The parts of a moving cut one by one, each against its definition run naively on the plain DAG.
#include <catch2/catch.hpp>
#include <optional>
#include <random>
#include <vector>

#include "query/moving/deadlines.h"
#include "query/moving/decisions.h"
#include "query/moving/insertion.h"
#include "query/moving/removal.h"
#include "query/moving/strength.h"
#include "query/surface.h"
#include "tests/query/mt_fixture.h"
#include "tests/query/oracle.h"

namespace mtdb::testing {

using namespace internal;

namespace {

MtFixture Fixture(uint32_t i) {
  MtOptions options;
  options.shape = static_cast<Shape>(i % 4);
  options.seed = 50 + i;
  options.resolution = 10;
  options.rounds = 3;
  // Random errors grow along many arcs; nearly equal ones along few.
  options.code_min = i % 3 == 1 ? 80 : 0;
  return MakeMt(options);
}

// What MovingCut puts together, in the open.
struct Parts {
  explicit Parts(const MtFixture& fixture)
      : f(fixture),
        surface(*Surface::Open(fixture.source)),
        reader(surface->cache(), {}),
        meter([this] { return reader.Check(); }),
        units(*fixture.source),
        pins(units, reader, meter),
        deadlines(units),
        decisions(units),
        strength(units),
        removal(units),
        insertion(units, decisions, strength) {
    units.judge().SetMeter(&meter);
    units.SetPins(&pins);
  }

  // From nothing to the least cut of the query.
  void Begin(const Query& query) {
    units.judge().SetQuery(query);
    insertion.Begin(nullptr);
    for (UnitId id = f.source->index_.cluster_count(); id < f.source->index_.unit_count(); ++id) {
      units.Open(id);
    }
    Insert(0);
  }
  void Insert(uint64_t round_nodes) {
    const auto end_round = [&] {
      units.CountRound();
      units.EndRound();
      return Status::Ok();
    };
    REQUIRE(insertion.Run(round_nodes, ~uint64_t{0}, end_round).ok());
    REQUIRE(end_round().ok());
  }
  // Calls decide(u, unit, expired) for each unit in which the new query may change something.
  template <typename F>
  void Ask(const Query& query, F&& decide) {
    Judge& judge = units.judge();
    const Judge::Fields from = judge.fields();
    const RegionPtr region = judge.region();
    judge.SetQuery(query);
    insertion.Begin(nullptr);
    const Deadlines::Moved moved{&from, region.get(), !(from == judge.fields()),
                                 region != judge.region()};
    for (const UnitId id : units.open()) {
      MovingUnit& u = *units.Find(id);
      deadlines.Advance(u, moved);
      const LoadedUnit* const unit = pins.Pin(u).value();
      const Expired expired = deadlines.LookAround(u, *unit, moved);
      decide(u, *unit, expired);
    }
  }
  void Evaluate(MovingUnit& u, const LoadedUnit& unit, const Expired& expired,
                std::vector<NodeKey>* weak) {
    for (const NodeIndex node : expired.nodes) {
      const bool changed = decisions.Evaluate(u, unit, node);
      if (!u.applied.Test(node)) {
        if (u.refusing.Test(node)) insertion.Defer(u, node, unit.cluster.error_codes[node]);
      } else if (changed) {
        strength.Recheck(u, node);
        if (!u.strong.Test(node)) weak->push_back(KeyOf(u.id, node));
      }
    }
    for (const uint32_t child : expired.children) {
      if (units.Find(unit.children()[child]) != nullptr) continue;
      insertion.DeferChild(u, child, unit.children()[child]);
    }
  }
  bool Flag(const Bits CutFlags::*flags, const InMemoryMt::Node& node) const {
    const MovingUnit* const u = units.Find(node.cluster);
    return u != nullptr && (u->*flags).Test(node.index);
  }
  std::vector<bool> Applied() const {
    std::vector<bool> applied;
    for (const InMemoryMt::Node& node : f.mt.nodes) {
      applied.push_back(Flag(&CutFlags::applied, node));
    }
    return applied;
  }
  // What is known of a node's triangles is what the definition says.
  bool Right(const Oracle& oracle, const InMemoryMt::Node& node) {
    const MovingUnit& u = *units.Find(node.cluster);
    const CompactCluster& cluster = pins.Pin(*units.Find(node.cluster)).value()->cluster;
    uint32_t refused = 0;
    for (const uint32_t id : node.hole) refused += oracle.wanted(id) ? 1 : 0;
    return u.refusing.Test(node.index) == (refused > 0) &&
           u.refused.CountRange(cluster.hole_begin[node.index],
                                cluster.hole_begin[node.index + 1]) == refused;
  }

  const MtFixture& f;
  std::shared_ptr<const Surface> surface;
  UnitReader reader;
  WorkMeter meter;
  MovingUnits units;
  UnitPins pins;
  Deadlines deadlines;
  Decisions decisions;
  Strength strength;
  NodeRemoval removal;
  Insertion insertion;
};

// A field that moves a little, or another query.
class Queries {
 public:
  Queries(const MtFixture& f, uint32_t seed) : f_(f), random_(seed) {
    at_ = f.source->record_.bounds.max;
  }
  Query Next() {
    if (random_() % 8 == 0) return RandomQuery(f_, random_);
    const Box3d& box = f_.source->record_.bounds;
    std::uniform_real_distribution<double> step(-0.03, 0.03);
    for (int i = 0; i < 3; ++i) at_[i] += step(random_) * Diagonal(box);
    Query query;
    query.threshold = LinearThreshold(at_, 0, 0.02);
    if (random_() % 4 == 0) query.region = SphereRegion(at_, Diagonal(box) * 0.6);
    return query;
  }
  std::mt19937& random() { return random_; }

 private:
  const MtFixture& f_;
  std::mt19937 random_;
  Vec3d at_;
};

}  // namespace

TEST_CASE("Decisions whose deadlines have not passed are still right") {
  uint64_t stand = 0;
  for (uint32_t i = 0; i < 8; ++i) {
    const MtFixture f = Fixture(i);
    Queries queries(f, i);
    Parts parts(f);
    parts.Begin(queries.Next());
    for (int step = 0; step < 60; ++step) {
      const Query query = queries.Next();
      const Oracle oracle(f, query);
      std::vector<std::vector<bool>> expired_nodes(f.source->index_.unit_count());
      parts.Ask(query, [&](MovingUnit& u, const LoadedUnit& unit, const auto& expired) {
        auto& nodes = expired_nodes[u.id];
        nodes.resize(unit.nodes());
        for (const NodeIndex node : expired.nodes) nodes[node] = true;
        // Of a child that is not open: none of its triangles could be refused.
        std::vector<bool> children(unit.children().size());
        for (const uint32_t c : expired.children) children[c] = true;
        u.present.ForEach([&](uint32_t own) {
          const uint32_t slot = own + u.first_own;
          const uint32_t remover = unit.removers()[slot];
          if (!RemovedByChild(remover) || children[ChildOrdinal(remover)]) return;
          const UnitId child = unit.children()[ChildOrdinal(remover)];
          if (parts.units.Find(child) != nullptr) return;
          REQUIRE(!parts.units.judge().Refused(unit, slot, unit.creator(slot),
                                               parts.units.LargestCode(child)));
        });
        std::vector<NodeKey> weak;
        parts.Evaluate(u, unit, expired, &weak);
      });
      for (const InMemoryMt::Node& node : f.mt.nodes) {
        if (!parts.Flag(&CutFlags::known, node)) continue;
        stand += expired_nodes[node.cluster][node.index] ? 0 : 1;
        REQUIRE(parts.Right(oracle, node));
      }
      std::vector<NodeKey> weak;
      REQUIRE(parts.strength.Run(&weak).ok());
    }
  }
  CHECK(stand > 1000);
}

TEST_CASE("What a border that moves elsewhere cannot change is not asked about") {
  const MtFixture f = MakeTorus(48, 20);
  const Box3d& bounds = f.source->record_.bounds;
  const Vec3d centre = (bounds.min + bounds.max) * 0.5;
  const auto query_at = [&](double share) {
    Box3d box;
    box.Add(bounds.min - Vec3d{1, 1, 1});
    box.Add(
        Vec3d{bounds.min.x + share * (bounds.max.x - bounds.min.x), centre.y, bounds.max.z + 1});
    Query query;
    query.region = BoxRegion(box);
    return query;
  };
  Parts parts(f);
  parts.Begin(query_at(0.7));
  uint64_t near = 0;
  uint64_t far = 0;
  for (int step = 1; step < 20; ++step) {
    const double share = 0.7 + 0.003 * step;
    const double face = bounds.min.x + share * (bounds.max.x - bounds.min.x);
    parts.Ask(query_at(share), [&](MovingUnit& u, const LoadedUnit& unit, const auto& expired) {
      for (const NodeIndex node : expired.nodes) {
        const Box3d box = f.source->record_.grid.Bounds(unit.star_bounds(node));
        const bool may_meet = box.max.x + 2 * Diagonal(box) > face;
        ++(expired.all || may_meet || u.deadlines.reach(node) == 0 ? near : far);
      }
      std::vector<NodeKey> weak;
      parts.Evaluate(u, unit, expired, &weak);
    });
  }
  CHECK(near > 100);
  CHECK(far == 0);
}

TEST_CASE("A node is strong by a chain of refused triangles from the root, and by nothing else") {
  uint64_t weak_nodes = 0;
  for (uint32_t i = 0; i < 8; ++i) {
    const MtFixture f = Fixture(i);
    Queries queries(f, 100 + i);
    Parts parts(f);
    parts.Begin(queries.Next());
    for (int step = 0; step < 40; ++step) {
      const Query query = queries.Next();
      const Oracle oracle(f, query);
      std::vector<NodeKey> weak;
      parts.Ask(query, [&](MovingUnit& u, const LoadedUnit& unit, const auto& expired) {
        parts.Evaluate(u, unit, expired, &weak);
      });
      const size_t changed = weak.size();
      std::vector<bool> was;
      for (const InMemoryMt::Node& n : f.mt.nodes) was.push_back(parts.Flag(&CutFlags::strong, n));
      REQUIRE(parts.strength.Run(&weak).ok());
      // Parents have the larger numbers.
      std::vector<bool> strong(f.mt.nodes.size());
      size_t weakened = 0;
      for (size_t n = f.mt.nodes.size(); n-- > 0;) {
        const InMemoryMt::Node& node = f.mt.nodes[n];
        const bool applied = parts.Flag(&CutFlags::applied, node);
        for (const uint32_t id : node.hole) {
          const int creator = f.mt.triangles[id].creator;
          strong[n] = strong[n] || (applied && oracle.wanted(id) &&
                                    (creator < 0 || strong[static_cast<size_t>(creator)]));
        }
        REQUIRE(parts.Flag(&CutFlags::strong, node) == strong[n]);
        weakened += was[n] && !strong[n] ? 1 : 0;
        weak_nodes += applied && !strong[n] ? 1 : 0;
      }
      REQUIRE(weak.size() == changed + weakened);
    }
  }
  CHECK(weak_nodes > 100);
}

TEST_CASE("Removal leaves a part of the new least cut, and insertion completes it") {
  uint64_t removed = 0;
  uint64_t kept_weak = 0;
  for (uint32_t i = 0; i < 12; ++i) {
    const MtFixture f = Fixture(i);
    Queries queries(f, 200 + i);
    Parts parts(f);
    parts.Begin(queries.Next());
    for (int step = 0; step < 60; ++step) {
      const Query query = queries.Next();
      const std::vector<bool> least = Oracle(f, query).LeastCut(queries.random());
      const std::vector<bool> before = parts.Applied();
      std::vector<NodeKey> weak;
      parts.Ask(query, [&](MovingUnit& u, const LoadedUnit& unit, const auto& expired) {
        parts.Evaluate(u, unit, expired, &weak);
      });
      REQUIRE(parts.strength.Run(&weak).ok());
      REQUIRE(parts.removal.Run(weak).ok());
      const std::vector<bool> left = parts.Applied();
      for (size_t n = 0; n < left.size(); ++n) {
        removed += before[n] && !left[n] ? 1 : 0;
        REQUIRE((before[n] || !left[n]));
        if (!left[n]) continue;
        REQUIRE(least[n]);
        for (const int p : f.mt.Parents(static_cast<int>(n))) REQUIRE(left[static_cast<size_t>(p)]);
        kept_weak += parts.Flag(&CutFlags::strong, f.mt.nodes[n]) ? 0 : 1;
      }
      REQUIRE(parts.units.counts().triangles == f.mt.Mesh(left).size());
      parts.Insert(step % 2 == 0 ? 0 : 1 + queries.random()() % 10);
      REQUIRE(parts.Applied() == least);
      REQUIRE(parts.units.counts().triangles == f.mt.Mesh(least).size());
    }
  }
  CHECK(removed > 1000);
  CHECK(kept_weak > 10);
}

}  // namespace mtdb::testing
