// SPDX-License-Identifier: Apache-2.0
// The corners that a session tells of its triangles are those of the cut, wherever it moved before.
#include <array>
#include <catch2/catch.hpp>
#include <map>
#include <memory>
#include <random>
#include <vector>

#include "query/session.h"
#include "tests/builder/fixture.h"
#include "tests/textures/charted_mesh.h"
#include "tests/textures/corner_list.h"

namespace mtdb::testing {
namespace {

// What a client has of a session's mesh.
class Client {
 public:
  Client(const BaseMesh& base, const Grid& grid) : grid_(grid) {
    for (size_t v = 0; v < base.vertices.size(); ++v) {
      positions_[base.vertices[v]] = base.positions[v];
    }
    for (size_t t = 0; t < base.triangles.size(); ++t) {
      const auto& c = base.triangles[t];
      triangles_[base.triangle_keys[t]] = {base.vertices[c[0]], base.vertices[c[1]],
                                           base.vertices[c[2]]};
    }
  }
  void Apply(const UpdateBatch& batch) {
    for (const UpdateBatch::Node& node : batch.nodes) {
      const auto ring = batch.ring_of(node);
      if (batch.insert) positions_[node.vertex] = node.position;
      for (uint32_t j = 0; j < UpdateBatch::StarCount(node); ++j) {
        if (batch.insert) {
          triangles_[node.first_star + j] = {node.vertex, ring[j], ring[(j + 1) % ring.size()]};
        } else {
          triangles_.erase(node.first_star + j);
        }
      }
      for (const auto& t : batch.hole_of(node)) {
        if (batch.insert) {
          triangles_.erase(t.key);
        } else {
          triangles_[t.key] = {ring[t.corners[0]], ring[t.corners[1]], ring[t.corners[2]]};
        }
      }
    }
  }
  // With the corners that the session tells.
  TriangleMesh Mesh(const Session& session) const {
    TriangleMesh mesh;
    for (const auto& [key, vertices] : triangles_) {
      const TriangleCorners told = session.CornersOf(key);
      for (const VertexIndex vertex : vertices) {
        const auto at = std::ranges::find(told.vertices, vertex);
        REQUIRE(at != told.vertices.end());
        mesh.corners.push_back(told.corners.at(static_cast<size_t>(at - told.vertices.begin())));
        mesh.positions.push_back(grid_.Position(positions_.at(vertex)));
      }
      const VertexIndex end = mesh.positions.size();
      mesh.triangles.push_back({end - 3, end - 2, end - 1});
    }
    return mesh;
  }

 private:
  const Grid grid_;
  std::map<VertexIndex, Vec3i> positions_;
  std::map<TriangleKey, std::array<VertexIndex, 3>> triangles_;
};

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
      Client client(*session->Base(), built.record.grid);
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
        REQUIRE(CornersOf(client.Mesh(*session), 0) == CornersOf(Extract(*surface, query), 0));
      }
      if (static_cast<Charting>(charting) == Charting::kTriangles) continue;  // has one cut
      REQUIRE(insertions > 200);
      REQUIRE(removals > 200);
    }
  }
}

}  // namespace mtdb::testing
