// SPDX-License-Identifier: Apache-2.0
// Queries, budgets and sessions on random complexes, against the definitions: sheets that meet, two
// sides, whatever nodes they make.
#include <catch2/catch.hpp>
#include <random>

#include "query/session.h"
#include "tests/builder/fixture.h"
#include "tests/query/explicit_mesh.h"
#include "tests/query/oracle.h"
#include "tests/query/plain_dag.h"
#include "tests/sheets/mesh_of.h"
#include "tests/sheets/random_complex.h"

namespace mtdb::sheets {
namespace {

using namespace mtdb::testing;
using sheets::Shape;

constexpr int kSteps = 12;

std::vector<bool> AppliedBy(const MtFixture& f, const Cut& cut) {
  std::vector<bool> applied;
  for (const InMemoryMt::Node& node : f.mt.nodes) {
    applied.push_back(cut.applied(node.cluster, node.index));
  }
  return applied;
}

struct Tally {
  uint64_t cuts = 0, budgets = 0, several_holes = 0;
};

// A session goes from query to query; each cut is the one that the definition asks for.
void Walk(const MtFixture& f, const std::shared_ptr<Surface>& surface, uint32_t seed,
          Tally* tally) {
  const auto session = *Session::Open(surface);
  ExplicitMesh mesh(*session->Base());
  std::mt19937 random(seed);
  for (int step = 0; step < kSteps; ++step) {
    CAPTURE(step);
    Query query = RandomQuery(f, random);
    if (random() % 3 == 0) query.max_triangles = random() % f.mt.triangles.size();
    const Cut cut = *surface->Select(query);
    const std::vector<bool> applied = AppliedBy(f, cut);
    const Oracle oracle(f, query);
    if (query.max_triangles) {
      QueryLimit limit;
      REQUIRE(applied == oracle.CutWithin(*query.max_triangles, &limit));
      REQUIRE(limit == cut.stats().limit);
      ++tally->budgets;
    } else {
      REQUIRE(applied == oracle.LeastCut(random));
    }
    REQUIRE(cut.triangle_count() == f.mt.Mesh(applied).size());
    std::vector<UpdateBatch> batches;
    REQUIRE(session->Update(query, &batches).ok());
    for (const UpdateBatch& batch : batches) {
      mesh.Apply(batch);
      tally->several_holes += batch.nodes.size() - batch.updates();
    }
    REQUIRE(mesh.Positions() == CutPositions(f, applied));
    ++tally->cuts;
  }
}

}  // namespace

TEST_CASE("Cuts, budgets and sessions of complexes are those of the definitions") {
  for (uint32_t shape = 0; shape < kShapes; ++shape) {
    Tally tally;
    for (uint32_t seed = 0; seed < 2; ++seed) {
      INFO(NameOf(static_cast<Shape>(shape)) << ", seed " << seed);
      BuildOptions options;
      options.step = kLatticeStep;
      options.tile_triangles = 64;
      const RandomComplex made = MakeRandomComplex(static_cast<Shape>(shape), seed);
      const BuiltObject built = Build(MeshOf(made.complex), options);
      Walk(PlainDagOf(*built.surface), built.surface, seed, &tally);
    }
    CHECK(tally.cuts == 2 * kSteps);
    CHECK(tally.budgets > 0);
    CHECK(tally.several_holes > 0);
  }
}

}  // namespace mtdb::sheets
