// SPDX-License-Identifier: Apache-2.0
// The corners that a session tells of its triangles are those of the cut, wherever it moved before.
#include <algorithm>
#include <catch2/catch.hpp>
#include <memory>
#include <random>
#include <vector>

#include "query/session.h"
#include "tests/builder/fixture.h"
#include "tests/query/explicit_mesh.h"
#include "tests/textures/charted_mesh.h"
#include "tests/textures/corner_list.h"

namespace mtdb::testing {
namespace {

// What a client has, with the corners that the session tells.
TriangleMesh MeshOf(const ExplicitMesh& client, const Grid& grid, const Session& session) {
  TriangleMesh mesh;
  for (const auto& [key, vertices] : client.triangles()) {
    const TriangleCorners told = session.CornersOf(key);
    for (const VertexIndex vertex : vertices) {
      const auto at = std::ranges::find(told.vertices, vertex);
      REQUIRE(at != told.vertices.end());
      mesh.corners.push_back(told.corners.at(static_cast<size_t>(at - told.vertices.begin())));
      mesh.positions.push_back(grid.Position(client.position(vertex)));
    }
    const VertexIndex end = mesh.positions.size();
    mesh.triangles.push_back({end - 3, end - 2, end - 1});
  }
  return mesh;
}

}  // namespace

TEST_CASE("A session tells the corners that the cut has, wherever it moved before") {
  for (uint32_t charting = 0; charting < kChartings; ++charting) {
    BuildOptions options;
    options.mode = PositionMode::kLossless;
    options.tile_triangles = 256;
    const BuiltObject built =
        Build(MakeCharted(static_cast<Charting>(charting), 48, 24, 0.5, charting + 1), options);
    for (const RuntimeForm form : {RuntimeForm::kImplicit, RuntimeForm::kExplicit}) {
      CAPTURE(NameOf(static_cast<Charting>(charting)));
      const auto surface = *Surface::Open(*built.store->database().OpenObject(built.record.name),
                                          {.form = form, .threads = 1});
      const auto session = *Session::Open(surface, {.available_only = true});
      ExplicitMesh client(*session->Base());
      std::mt19937 random(charting);
      uint64_t insertions = 0, removals = 0;
      for (int move = 0; move < 30; ++move) {
        Query query = move % 7 == 6 ? Query() : RandomCutQuery(built.record, random);
        std::vector<UpdateBatch> batches;
        const SessionUpdate update = *session->Update(query, &batches);
        REQUIRE(update.stats.missing.empty());
        insertions += update.insertions;
        removals += update.removals;
        for (const UpdateBatch& batch : batches) client.Apply(batch);
        REQUIRE(CornersOf(MeshOf(client, built.record.grid, *session), 0) ==
                CornersOf(Extract(*surface, query), 0));
      }
      if (static_cast<Charting>(charting) == Charting::kTriangles) continue;  // has one cut
      REQUIRE(insertions > 200);
      REQUIRE(removals > 200);
    }
  }
}

}  // namespace mtdb::testing
