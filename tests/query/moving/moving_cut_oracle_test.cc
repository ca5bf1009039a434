// SPDX-License-Identifier: Apache-2.0
// Random walks of a moving cut, whose cuts are those of a search from the root.
#include <catch2/catch.hpp>
#include <random>
#include <set>
#include <vector>

#include "query/fields/vertical_reach.h"
#include "query/moving/moving_cut.h"
#include "query/query_control.h"
#include "query/surface.h"
#include "tests/query/late_source.h"
#include "tests/query/mt_fixture.h"
#include "tests/query/oracle.h"

namespace mtdb::testing {

using namespace internal;

namespace {

// A viewer that moves a little, or jumps, and what it asks for.
class Walker {
 public:
  // Jumps once in so many steps.
  Walker(const MtFixture& f, uint32_t seed, uint32_t jumps) : f_(f), random_(seed), jumps_(jumps) {
    Jump();
  }

  Query Step() {
    if (random_() % jumps_ == 0) Jump();
    if (random_() % 6 == 0) factor_ *= Uniform(0.7, 1.4);
    const double step = 0.02 * f_.source->record_.diagonal();
    for (int i = 0; i < 3; ++i) at_[i] += Uniform(-step, step);
    turn_ += Uniform(-0.05, 0.05);
    return Again();
  }
  // What Step gave, made anew.
  Query Again() const {
    Query query;
    query.threshold = Field();
    query.region = Near();
    return query;
  }
  std::mt19937& random() { return random_; }

 private:
  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  void Jump() {
    const Box3d& box = f_.source->record_.bounds;
    const double size = Diagonal(box);
    for (int i = 0; i < 3; ++i) at_[i] = Uniform(box.min[i] - size, box.max[i] + size);
    if (random_() % 3 == 0) at_ = at_ * 0.3 + (box.min + box.max) * 0.35;  // may be inside
    turn_ = Uniform(0, 6);
    factor_ = Uniform(0.2, 3);
    error_ = f_.source->record_.grid.Error(static_cast<uint8_t>(random_() % 110));
    kind_ = random_() % 12;
    region_ = random_() % 10;
  }
  Camera View() const {
    Camera camera;
    camera.eye = at_;
    const Box3d& box = f_.source->record_.bounds;
    camera.direction = (box.min + box.max) * 0.5 - at_ +
                       Vec3d{std::cos(turn_), std::sin(turn_), 0.1} * (0.2 * Diagonal(box));
    if (Length(Cross(camera.direction, camera.up)) < 1e-3) camera.up = {1, 0, 0};
    camera.near = kind_ % 2 == 0 ? 0.05 : 0;
    return camera;
  }
  ThresholdPtr Field() const {
    const double slope = factor_ * error_ / Diagonal(f_.source->record_.bounds);
    switch (kind_) {
      case 0: return ConstantThreshold(factor_ * error_);
      case 1: return LinearThreshold(at_, 0, slope);
      case 2: return LinearThreshold(at_, 2 * error_, -slope);
      case 3: return QuadraticThreshold(at_, error_, factor_ * error_);
      case 4: return SquareRootThreshold(at_, 0.2 * error_, factor_ * error_);
      case 5: return ExponentialThreshold(at_, error_, factor_);
      case 6: return ScreenThreshold(View(), 100 * factor_);
      case 7: return ScreenThreshold(View(), 20 * factor_);
      case 8:
        return RegionThreshold(SphereRegion(at_, 0.5), LinearThreshold(at_, 0, slope),
                               ConstantThreshold(2 * error_));
      case 9:
        return RegionThreshold(BoxRegion(Cube(0.3)), FullResolution(),
                               RegionThreshold(FrustumRegion(View()), ConstantThreshold(error_),
                                               ConstantThreshold(4 * error_)));
      case 10:
        return MaxThreshold({ConstantThreshold(error_),
                             RegionThreshold(ComplementRegion(Prism()), ScreenThreshold(View(), 30),
                                             ConstantThreshold(0.5 * error_))});
      default:
        return MinThreshold({LinearThreshold(at_, error_, slope), ConstantThreshold(2 * error_),
                             MaxThreshold({ScreenThreshold(View(), 50), ConstantThreshold(0)})});
    }
  }
  Box3d Cube(double share) const {
    const double size = share * factor_ * Diagonal(f_.source->record_.bounds);
    Box3d box;
    box.Add(at_ - Vec3d{size, size, size});
    box.Add(at_ + Vec3d{size, size, size});
    return box;
  }
  RegionPtr Prism() const {
    const double size = 0.4 * factor_ * Diagonal(f_.source->record_.bounds);
    const auto corner = [&](double turn, double reach) {
      return std::array<double, 2>{at_.x + reach * size * std::cos(turn_ + turn),
                                   at_.y + reach * size * std::sin(turn_ + turn)};
    };
    return PrismRegion({corner(0, 1), corner(1, 0.4), corner(2, 1.2), corner(4, 0.9)}, at_.z - size,
                       at_.z + 2 * size);
  }
  RegionPtr Near() const {
    const double size = 0.3 * factor_ * Diagonal(f_.source->record_.bounds);
    switch (region_) {
      case 0: return BoxRegion(Cube(0.3));
      case 4: return IntersectionRegion({SphereRegion(at_, size), ComplementRegion(Prism())});
      case 5:
        return UnionRegion({Prism(), TubeRegion({at_, at_ + Vec3d{size, 0, size}}, 0.3 * size)});
      case 6: return Prism();
      case 1: return SphereRegion(at_, size);
      case 2: return FrustumRegion(View());
      case 3: return WholeRegion();
      default: return nullptr;
    }
  }

  const MtFixture& f_;
  std::mt19937 random_;
  uint32_t jumps_;
  Vec3d at_;
  double turn_ = 0;
  double factor_ = 1;
  double error_ = 0;
  uint32_t kind_ = 0;
  uint32_t region_ = 0;
};

// What a moving cut tells of its changes, round by round.
class Follower {
 public:
  explicit Follower(const MtFixture& f) : f_(f), numbers_(f.source->index_.cluster_count()) {
    for (size_t n = 0; n < f.mt.nodes.size(); ++n) {
      const InMemoryMt::Node& node = f.mt.nodes[n];
      auto& of = numbers_[node.cluster];
      if (of.size() <= node.index) of.resize(node.index + 1);
      of[node.index] = n;
    }
    applied.assign(f.mt.nodes.size(), false);
  }
  // Checks that the changes begin where the last ones ended, and that the cut holds all parents.
  void Follow(const MovingCut& cut) {
    cut.ForEachChange([&](UnitId unit, const Bits& before, const Bits& now) {
      for (NodeIndex i = 0; i < numbers_[unit].size(); ++i) {
        const size_t n = numbers_[unit][i];
        REQUIRE(applied[n] == (!before.empty() && before.Test(i)));
        applied[n] = now.Test(i);
      }
    });
    uint64_t count = 0;
    for (size_t n = 0; n < applied.size(); ++n) {
      const InMemoryMt::Node& node = f_.mt.nodes[n];
      const Bits& bits = cut.applied(node.cluster);
      REQUIRE(applied[n] == (!bits.empty() && bits.Test(node.index)));
      if (!applied[n]) continue;
      ++count;
      for (const int p : f_.mt.Parents(static_cast<int>(n)))
        REQUIRE(applied[static_cast<size_t>(p)]);
    }
    REQUIRE(cut.counts().applied == count);
    uint64_t triangles = 0;
    for (const uint64_t of_code : cut.counts().by_code) triangles += of_code;
    REQUIRE(triangles == cut.counts().triangles);
  }
  void RequireCut(const Cut& cut) const {
    for (size_t n = 0; n < applied.size(); ++n) {
      const InMemoryMt::Node& node = f_.mt.nodes[n];
      REQUIRE(applied[n] == cut.applied(node.cluster, node.index));
    }
  }
  std::vector<bool> applied;

 private:
  const MtFixture& f_;
  std::vector<std::vector<size_t>> numbers_;  // per cluster and node
};

MtOptions Varied(uint32_t i) {
  MtOptions options;
  options.shape = static_cast<Shape>(i % 4);
  options.seed = i;
  options.resolution = i % 3 == 0 ? 14 : 9;
  options.rounds = i % 2 == 0 ? 4 : 3;
  options.coincident = i % 5 == 1;
  // Random errors grow along many arcs; nearly equal ones along few.
  options.code_min = i % 3 == 1 ? 80 : 0;
  return options;
}

// Every third is a terrain, whose errors are heights; the borders of some move.
MtFixture MakeVaried(uint32_t i) {
  MtFixture f = MakeMt(Varied(i));
  if (i % 3 != 2) return f;
  f.source->record_.error_measure = ErrorMeasure::kVertical;
  f.source->record_.border_moves = i % 2 == 0;
  return f;
}

// What the judge asks: of a terrain what is above and below counts.
Query AsJudged(const MtFixture& f, Query query) {
  if (f.source->record_.error_measure != ErrorMeasure::kVertical) return query;
  const double aside = f.source->record_.border_moves ? 1 : 0;
  query.region = VerticalReach(query.region, {aside, aside});
  query.threshold = VerticalReach(query.threshold, {aside, aside});
  return query;
}

}  // namespace

TEST_CASE("a moving cut is at the least cut after every step of a random walk") {
  uint64_t weak = 0;
  uint64_t fell_short = 0;
  for (uint32_t i = 0; i < 12; ++i) {
    const MtFixture f = MakeVaried(i);
    // Some caches are too small for what a step may hold.
    const auto surface =
        *Surface::Open(AsTested(f.source), {.cache_bytes = i % 4 == 3 ? 400000u : 8u << 20});
    MovingCut cut(*f.source);
    Follower follower(f);
    Walker walker(f, i, 20);
    for (int step = 0; step < 600; ++step) {
      const Query query = walker.Step();
      const uint64_t round_nodes = walker.random()() % 3 == 0 ? 1 + walker.random()() % 20 : 0;
      {
        UnitReader reader(surface->cache(), {});
        const Status status = cut.Move(reader, query, round_nodes, [&] {
          follower.Follow(cut);
          return Status::Ok();
        });
        INFO(status.message());
        REQUIRE(status.ok());
      }
      if (step % 5 == 0) {
        UnitReader reader(surface->cache(), {});
        const auto nothing = [] { return Status::Ok(); };
        REQUIRE(cut.Move(reader, walker.Again(), 0, nothing).ok());
        REQUIRE(cut.evaluated() == 0);
      }
      const Cut select = *surface->Select(query);
      follower.RequireCut(select);
      REQUIRE(cut.counts().triangles == select.triangle_count());
      REQUIRE(cut.counts().forced == select.stats().nodes_forced);
      REQUIRE(cut.counts().clusters_used == select.stats().clusters_used);
      // Clusters that stayed open tell more of their errors than a search learns.
      uint64_t active = 0;
      uint8_t largest = 0;
      const Oracle oracle(f, AsJudged(f, query));
      for (const uint32_t id : f.mt.Mesh(follower.applied)) {
        if (!oracle.active(id)) continue;
        ++active;
        const int remover = f.mt.triangles[id].remover;
        if (remover >= 0)
          largest = std::max(largest, f.mt.nodes[static_cast<size_t>(remover)].code);
      }
      const Grid& grid = f.source->record_.grid;
      REQUIRE(cut.active().count >= active);
      REQUIRE(cut.active().count <= select.stats().active_triangles);
      REQUIRE(cut.active().largest_code >= largest);
      REQUIRE(grid.Error(cut.active().largest_code) + f.source->record_.rounding_error <=
              select.error_bound());
      const Shortfall shortfall = oracle.ShortfallOf(follower.applied);
      REQUIRE(cut.active().shortfall.any() == shortfall.any());
      REQUIRE(cut.active().shortfall.excess == Approx(shortfall.excess));
      REQUIRE(cut.active().shortfall.triangles >= shortfall.triangles);
      REQUIRE(cut.active().shortfall.triangles <= select.stats().shortfall.triangles);
      fell_short += shortfall.any() ? 1 : 0;
      weak += select.stats().nodes_forced;
    }
  }
  CHECK(weak > 0);
  CHECK(fell_short > 100);
}

TEST_CASE("a moving cut that is stopped anywhere is at the cut of its last round, and goes on") {
  uint64_t stopped = 0;
  uint64_t in_rounds = 0;
  for (uint32_t i = 0; i < 6; ++i) {
    const MtFixture f = MakeVaried(i);
    const auto surface = *Surface::Open(AsTested(f.source));
    MovingCut cut(*f.source);
    Follower follower(f);
    Walker walker(f, i + 100, 3);
    std::mt19937& random = walker.random();
    for (int step = 0; step < 500; ++step) {
      Query query = walker.Step();
      // The threshold counts the questions and cancels, or the taker of a round fails.
      QueryControl control;
      query.control = &control;
      const bool cancels = random() % 3 == 0;
      int left = static_cast<int>(random() % 300);
      if (cancels) {
        const ThresholdPtr field = query.threshold;
        query.threshold = FunctionThreshold([&, field](const Box3d& box) {
          if (left-- == 0) control.Cancel();
          return field->Range(box, 0).low;
        });
      }
      const bool rounds_fail = random() % 3 == 0;
      int rounds_left = rounds_fail ? static_cast<int>(random() % 3) : 1000;
      const uint64_t round_nodes = rounds_fail || random() % 2 == 0 ? 1 + random() % 5 : 0;
      uint32_t rounds = 0;
      UnitReader reader(surface->cache(), {&control, std::nullopt});
      const Status status = cut.Move(reader, query, round_nodes, [&] {
        if (rounds_left-- == 0) return IoError("the client is gone");
        ++rounds;
        follower.Follow(cut);
        return Status::Ok();
      });
      if (status.ok()) {
        query.control = nullptr;
        const Cut select = *surface->Select(query);
        follower.RequireCut(select);
        REQUIRE(cut.counts().triangles == select.triangle_count());
        continue;
      }
      ++stopped;
      in_rounds += rounds > 0 ? 1 : 0;
      for (size_t n = 0; n < f.mt.nodes.size(); ++n) {
        const InMemoryMt::Node& node = f.mt.nodes[n];
        const Bits& bits = cut.applied(node.cluster);
        REQUIRE(follower.applied[n] == (!bits.empty() && bits.Test(node.index)));
      }
    }
  }
  CHECK(stopped > 100);
  CHECK(in_rounds > 20);
}

TEST_CASE("a moving cut keeps nothing of clusters that it no longer needs") {
  for (uint32_t i = 0; i < 8; ++i) {
    const MtFixture f = MakeMt(Varied(i));
    const auto surface = *Surface::Open(AsTested(f.source));
    const size_t clusters = f.source->index_.cluster_count();
    const size_t root_pieces = f.source->index_.root_piece_count();
    MovingCut cut(*f.source);
    const auto move = [&](const ThresholdPtr& threshold) {
      Query query;
      query.threshold = threshold;
      UnitReader reader(surface->cache(), {});
      REQUIRE(cut.Move(reader, query, 0, [] { return Status::Ok(); }).ok());
    };
    move(CoarsestThreshold());
    CHECK(cut.open_units() == root_pieces);
    move(FullResolution());
    CHECK(cut.open_units() == root_pieces + clusters);
    move(CoarsestThreshold());
    CHECK(cut.open_units() == root_pieces);
    // By small steps, of which the last ones change nothing.
    for (int code = 0; code < 120; ++code) {
      move(ConstantThreshold(f.source->record_.grid.Error(static_cast<uint8_t>(code))));
    }
    const double largest = f.source->record_.grid.Error(120);
    for (int step = 1; step < 30; ++step) move(ConstantThreshold(largest + 0.001 * step));
    CHECK(cut.open_units() == root_pieces);
  }
}

}  // namespace mtdb::testing
