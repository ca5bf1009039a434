// SPDX-License-Identifier: Apache-2.0
// Sessions with a budget of triangles whose queries move in small steps.
#include <catch2/catch.hpp>
#include <random>
#include <vector>

#include "query/query_control.h"
#include "query/session.h"
#include "query/surface.h"
#include "tests/query/explicit_mesh.h"
#include "tests/query/late_source.h"
#include "tests/query/mt_fixture.h"
#include "tests/query/oracle.h"

namespace mtdb::testing {
namespace {

Vec3d Near(const Vec3d& p, double by, std::mt19937& random) {
  std::uniform_real_distribution<double> step(-by, by);
  return {p.x + step(random), p.y + step(random), p.z + step(random)};
}

// A path of queries: the kind says what moves.
class Path {
 public:
  Path(const MtFixture& f, int kind, std::mt19937& random)
      : bounds_(f.source->record_.bounds), kind_(kind), random_(random) {
    at_ = Near(bounds_.max, 0.5, random_);
    const uint64_t root = f.mt.root_triangles.size();
    triangles_ = root + (f.source->record_.triangles - root) * (2 + random_() % 5) / 10;
  }

  Query Next() {
    at_ = Near(at_, 0.02, random_);
    if (random_() % 16 == 0) at_ = Near(bounds_.max, 1, random_);  // a jump
    if (random_() % 4 == 0) triangles_ += random_() % 9;
    Query query;
    query.max_triangles = triangles_;
    // Of a mesh that is smaller or larger than any.
    if (random_() % 8 == 0) {
      constexpr uint64_t kOdd[] = {0, 1, 3, uint64_t{1} << 63, UINT64_MAX};
      query.max_triangles = kOdd[random_() % std::size(kOdd)];
    }
    Camera camera;
    camera.eye = at_ + Vec3d{3, 2, 1};
    camera.direction = bounds_.min - camera.eye;
    camera.near = 0.01;
    const RegionPtr ball = SphereRegion(at_, 0.6);
    switch (kind_) {
      case 0: query.threshold = ScreenThreshold(camera, 0.001); break;
      case 1: query.threshold = LinearThreshold(at_, 0, 0.0001); break;
      case 2: query.region = ball; break;
      case 3:
        query.threshold = RegionThreshold(ball, FullResolution(), ScreenThreshold(camera, 0.002));
        break;
      case 4:
        query.region = ball;
        query.threshold = ScreenThreshold(camera, 0.001);
        break;
      default:
        query.threshold =
            MinThreshold({ScreenThreshold(camera, 0.01), LinearThreshold(at_, 0, 0.001)});
        break;
    }
    return query;
  }

 private:
  const Box3d bounds_;
  const int kind_;
  std::mt19937& random_;
  Vec3d at_;
  uint64_t triangles_;
};

}  // namespace

TEST_CASE("a budget that moves gives the cut of its definition") {
  uint64_t ended = 0;
  uint64_t kept = 0;
  uint64_t failed = 0;
  for (int kind = 0; kind < 6; ++kind) {
    for (uint32_t seed = 1; seed <= 4; ++seed) {
      MtOptions options;
      options.shape = seed % 2 == 0 ? Shape::kSheet : Shape::kSphere;
      options.attributes = seed == 3;
      options.seed = seed + 10 * static_cast<uint32_t>(kind);
      const MtFixture f = MakeMt(options);
      const auto surface = *Surface::Open(AsTested(f.source));
      const auto session = *Session::Open(surface);
      ExplicitMesh mesh(*session->Base());
      std::mt19937 random(seed);
      Path path(f, kind, random);
      for (int step = 0; step < 60; ++step) {
        Query query = path.Next();
        // Now and then without the budget, or with another kind of threshold.
        if (step % 13 == 12) query.max_triangles.reset();
        if (step % 17 == 16) query.threshold = ConstantThreshold(0.01);
        // Less than the root, which may be all that is asked for.
        if (step % 11 == 10) query.max_triangles = 1 + random() % 3;
        if (step % 22 == 10) query.threshold = CoarsestThreshold();
        INFO("kind " << kind << ", seed " << seed << ", step " << step);
        // A client that goes away, or a query that is cancelled, leaves the cut as it was.
        if (step % 7 == 3) {
          const uint64_t before = session->applied_count();
          Query other = path.Next();
          QueryControl control;
          if (step % 2 == 0) control.Cancel();
          other.control = &control;
          const auto gone = [](std::span<const UpdateBatch>) {
            return IoError("the client is gone");
          };
          failed += session->Update(other, gone).ok() ? 0 : 1;
          REQUIRE(session->applied_count() == before);
        }
        std::vector<UpdateBatch> batches;
        const Result<SessionUpdate> update = session->Update(query, &batches);
        REQUIRE(update.ok());
        for (const UpdateBatch& batch : batches) mesh.Apply(batch);
        const Oracle oracle(f, query);
        QueryLimit limit = QueryLimit::kThreshold;
        const std::vector<bool> expected = query.max_triangles
                                               ? oracle.CutWithin(*query.max_triangles, &limit)
                                               : oracle.LeastCut(random);
        std::vector<bool> applied;
        for (const InMemoryMt::Node& node : f.mt.nodes) {
          applied.push_back(session->applied(node.cluster, node.index));
        }
        REQUIRE(applied == expected);
        REQUIRE(mesh.Positions() == CutPositions(f, expected));
        REQUIRE(update->stats.triangles == f.mt.Mesh(expected).size());
        REQUIRE(update->stats.limit == limit);
        const Cut cut = *surface->Select(query);
        REQUIRE(update->stats.error_bound <= cut.stats().error_bound);
        REQUIRE(update->stats.shortfall.excess <= cut.stats().shortfall.excess);
        ended += limit == QueryLimit::kTriangles ? 1 : 0;
        kept += update->insertions + update->removals < session->applied_count() / 4 ? 1 : 0;
      }
    }
  }
  CHECK(ended > 700);
  CHECK(kept > 400);
  CHECK(failed > 100);
}

}  // namespace mtdb::testing
