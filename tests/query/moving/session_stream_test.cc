// SPDX-License-Identifier: Apache-2.0
// A client that follows a session over stores that the builder made: what it holds is the cut.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "codecs/stream/update_stream.h"
#include "query/session.h"
#include "tests/builder/fixture.h"
#include "tests/support/client_mesh_check.h"
#include "tests/support/mesh_check.h"

namespace mtdb::testing {
namespace {

// A sheet with a fin along its middle row, where three triangles share an edge, and a cone that
// stands on one of its vertices.
TriangleMesh MakeFinnedSheet(int n) {
  TriangleMesh mesh;
  std::mt19937 random(4);
  std::uniform_real_distribution<double> noise(-0.01, 0.01);
  const auto side = static_cast<VertexIndex>(n + 1);
  const auto add_grid = [&](VertexIndex rows, const auto& number) {
    for (VertexIndex r = 0; r + 1 < rows; ++r) {
      for (VertexIndex c = 0; c + 1 < side; ++c) {
        const VertexIndex a = number(r, c), b = number(r, c + 1);
        const VertexIndex d = number(r + 1, c), e = number(r + 1, c + 1);
        mesh.triangles.push_back({a, b, e});
        mesh.triangles.push_back({a, e, d});
      }
    }
  };
  for (VertexIndex r = 0; r < side; ++r) {
    for (VertexIndex c = 0; c < side; ++c) {
      mesh.positions.push_back(
          {static_cast<double>(c) / n, static_cast<double>(r) / n, noise(random)});
    }
  }
  const auto sheet = [&](VertexIndex r, VertexIndex c) { return r * side + c; };
  add_grid(side, sheet);
  const VertexIndex middle = side / 2;
  const VertexIndex first = mesh.positions.size();
  for (VertexIndex r = 1; r < side; ++r) {
    for (VertexIndex c = 0; c < side; ++c) {
      mesh.positions.push_back({static_cast<double>(c) / n,
                                static_cast<double>(middle) / n + noise(random),
                                static_cast<double>(r) / n});
    }
  }
  const auto fin = [&](VertexIndex r, VertexIndex c) {
    return r == 0 ? sheet(middle, c) : first + (r - 1) * side + c;
  };
  add_grid(side, fin);
  const VertexIndex tip = sheet(2, 2);
  const VertexIndex rim = mesh.positions.size();
  for (int i = 0; i < 12; ++i) {
    const double angle = 0.5235987755982988 * i;
    mesh.positions.push_back(mesh.positions[tip] +
                             Vec3d{0.05 * std::cos(angle), 0.05 * std::sin(angle), -0.2});
  }
  for (VertexIndex i = 0; i < 12; ++i) {
    mesh.triangles.push_back({tip, rim + i, rim + (i + 1) % 12});
  }
  return mesh;
}

// The same with two sides but for a strip: sheets and fin alike.
TriangleMesh MakeTwoSidedSheet(int n) {
  TriangleMesh mesh = MakeFinnedSheet(n);
  const size_t count = mesh.triangles.size();
  for (size_t i = 0; i < count; ++i) {
    const auto [a, b, c] = mesh.triangles[i];
    if (mesh.positions[a].x > 0.3) mesh.triangles.push_back({a, c, b});
  }
  return mesh;
}

// Those that meet the region.
std::multiset<std::string> CutTriangles(const Surface& surface, Cut& cut,
                                        const MeetsRegion& region) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  REQUIRE(cut.Emit(sink).ok());
  const size_t row = mesh.header.attributes.row_bytes();
  std::multiset<std::string> set;
  for (const TriangleVertices& t : mesh.triangles) {
    std::array<Vec3i, 3> positions;
    std::array<ByteSpan, 3> rows;
    Triangle3d corners;
    for (size_t c = 0; c < 3; ++c) {
      positions[c] = surface.record().grid.Quantize(mesh.positions[t[c]]);
      rows[c] = ByteSpan(mesh.rows).subspan(t[c] * row, row);
      corners[c] = surface.record().grid.Position(positions[c]);
    }
    if (region && !region(corners)) continue;
    set.insert(TriangleText(positions, rows));
  }
  return set;
}

void Walk(const BuiltObject& object, int steps, uint32_t remembered, bool manifold) {
  const Surface& surface = *object.surface;
  const auto session = *Session::Open(object.surface);
  UpdateEncoder encoder({surface.record().grid, surface.record().attributes, remembered},
                        *session->Base());
  UpdateDecoder decoder;
  REQUIRE(decoder.Feed(encoder.start()).ok());
  std::mt19937 random(7);
  for (int step = 0; step < steps; ++step) {
    Query query = RandomCutQuery(surface.record(), random);
    if (random() % 3 == 0) query.max_triangles = random() % surface.record().triangles;
    std::vector<UpdateBatch> batches;
    REQUIRE(session->Update(query, &batches).ok());
    const Status status = decoder.Feed(encoder.Encode(batches));
    INFO(status.message());
    REQUIRE(status.ok());
    Cut cut = *surface.Select(query);
    REQUIRE(ClientTriangles(decoder.mesh()) == CutTriangles(surface, cut, {}));
    REQUIRE(ClientMeshFault(decoder.mesh()).empty());
    if (manifold) REQUIRE(CheckMesh(Compacted(decoder.mesh())).ok());
  }
}

// As Walk, with a client that is clipped to a box now and then, and gets an update round by round.
void WalkClipped(const BuiltObject& object, int steps, uint32_t remembered) {
  const Surface& surface = *object.surface;
  const ObjectRecord& record = surface.record();
  const auto session = *Session::Open(object.surface);
  UpdateEncoder encoder({record.grid, record.attributes, remembered}, *session->Base());
  UpdateDecoder decoder;
  REQUIRE(decoder.Feed(encoder.start()).ok());
  std::mt19937 random(8);
  std::uniform_real_distribution<double> part(0, 1);
  for (int step = 0; step < steps; ++step) {
    MeetsRegion region;
    if (random() % 6 != 0) {
      const Vec3d size = record.bounds.max - record.bounds.min;
      const double x = part(random);
      const double y = part(random);
      const Vec3d centre = record.bounds.min + Vec3d{x * size.x, y * size.y, part(random) * size.z};
      Box3d box;
      box.Add(centre - size * 0.2);
      box.Add(centre + size * 0.2);
      region = [box = BoxRegion(box)](const Triangle3d& t) { return box->Within(t, 0); };
    }
    const Query query = RandomCutQuery(record, random);
    const auto sink = [&](std::span<const UpdateBatch> batches) {
      return decoder.Feed(encoder.Encode(batches, region));
    };
    REQUIRE(session->Update(query, sink).ok());
    REQUIRE(decoder.Feed(encoder.Encode({}, region)).ok());  // where no round was needed
    Cut cut = *surface.Select(query);
    REQUIRE(ClientTriangles(decoder.mesh()) == CutTriangles(surface, cut, region));
    REQUIRE(ClientMeshFault(decoder.mesh()).empty());
  }
}

// From the root to full resolution and back, twice: the second time out of the client's memory.
void WalkToFullAndBack(const BuiltObject& object) {
  const Surface& surface = *object.surface;
  const auto session = *Session::Open(object.surface);
  UpdateEncoder encoder({surface.record().grid, surface.record().attributes, 1u << 20},
                        *session->Base());
  UpdateDecoder decoder;
  REQUIRE(decoder.Feed(encoder.start()).ok());
  const std::multiset<std::string> root = ClientTriangles(decoder.mesh());
  for (int round = 0; round < 2; ++round) {
    for (const double error : {0.0, 1e300}) {
      Query query;
      query.threshold = ConstantThreshold(error);
      std::vector<UpdateBatch> batches;
      REQUIRE(session->Update(query, &batches).ok());
      const Status status = decoder.Feed(encoder.Encode(batches));
      INFO(status.message());
      REQUIRE(status.ok());
      Cut cut = *surface.Select(query);
      REQUIRE(ClientTriangles(decoder.mesh()) == CutTriangles(surface, cut, {}));
    }
    REQUIRE(ClientTriangles(decoder.mesh()) == root);
  }
  CHECK(encoder.recalled_vertices() == surface.record().nodes);
}

}  // namespace

TEST_CASE("a client that follows a session holds the mesh of its cut, attributes included") {
  TriangleMesh sculpture = MakeSculpture(6000);
  NumberVertices(&sculpture);
  Walk(Build(sculpture), 60, 100, true);
  Walk(Build(MakeTerrain(5000)), 60, 0, true);
}

TEST_CASE("a client follows a session over non-manifold edges and vertices") {
  TriangleMesh sheet = MakeFinnedSheet(40);
  NumberVertices(&sheet);
  Walk(Build(sheet), 80, 50, false);
}

TEST_CASE("a client follows a session over two-sided sheets that meet") {
  TriangleMesh sheet = MakeTwoSidedSheet(30);
  NumberVertices(&sheet);
  const BuiltObject object = Build(sheet);
  CHECK(object.record.input.two_sided_triangles > 1000);
  CHECK(object.record.root_triangles < 400);
  Walk(object, 60, 50, false);
  WalkClipped(object, 40, 50);
  WalkToFullAndBack(object);
}

TEST_CASE("a clipped client that follows a session holds what of its cut meets the region") {
  TriangleMesh terrain = MakeTerrain(5000);
  NumberVertices(&terrain);
  WalkClipped(Build(terrain), 40, 50);
  WalkClipped(Build(MakeSculpture(6000)), 40, 0);
  WalkClipped(Build(MakeFinnedSheet(40)), 60, 100);
}

TEST_CASE("a client holds the rows of its cut, of every kind of attribute") {
  for (const AttributeKind& kind : AttributeKinds(MakeSculpture(3000))) {
    INFO(kind.name);
    const BuiltObject object = Build(kind);
    Walk(object, 15, 0, false);
    Walk(object, 15, 100, true);
    WalkClipped(object, 15, 50);
    WalkToFullAndBack(object);
  }
}

TEST_CASE("a client that takes round after round holds a mesh after each, of falling errors") {
  const BuiltObject object = Build(MakeSculpture(100000));
  const Surface& surface = *object.surface;
  const auto session = *Session::Open(object.surface);
  UpdateEncoder encoder({surface.record().grid, surface.record().attributes, 1000},
                        *session->Base());
  UpdateDecoder decoder;
  REQUIRE(decoder.Feed(encoder.start()).ok());
  const auto move = [&](const Query& query, uint64_t taken) {
    uint64_t rounds = 0;
    uint64_t applied = session->applied_count();
    const Result<SessionUpdate> update =
        session->Update(query, [&](std::span<const UpdateBatch> batches) {
          if (rounds == taken) return IoError("the client is gone");
          ++rounds;
          REQUIRE(decoder.Feed(encoder.Encode(batches)).ok());
          REQUIRE(ClientMeshFault(decoder.mesh()).empty());
          REQUIRE(CheckMesh(Compacted(decoder.mesh())).ok());
          for (const UpdateBatch& batch : batches) {
            applied += batch.insert ? batch.nodes.size() : 0;
            applied -= batch.insert ? 0 : batch.nodes.size();
          }
          return Status::Ok();
        });
    REQUIRE(session->applied_count() == applied);
    REQUIRE(decoder.mesh().vertex_count() == surface.index().root_vertices() + applied);
    REQUIRE(update.ok() == (taken == 100));
    if (update.ok()) {
      Cut cut = *surface.Select(query);
      REQUIRE(ClientTriangles(decoder.mesh()) == CutTriangles(surface, cut, {}));
      REQUIRE(update->stats.triangles == cut.triangle_count());
      REQUIRE(update->stats.nodes_forced == cut.stats().nodes_forced);
    }
    return rounds;
  };
  const double diagonal = surface.record().diagonal();
  const Vec3d corner = surface.record().bounds.max;
  Query query;
  query.threshold = LinearThreshold(corner, 0, 0.001);
  CHECK(move(query, 100) >= 2);
  query.threshold = LinearThreshold(corner + Vec3d{0.01, 0, 0} * diagonal, 0, 0.001);
  CHECK(move(query, 100) == 1);  // a small step
  query.threshold = nullptr;
  CHECK(move(query, 2) == 2);  // then the client refuses
  CHECK(move(query, 100) >= 2);
  query.threshold = ConstantThreshold(0.1 * diagonal);
  CHECK(move(query, 100) == 1);
}

}  // namespace mtdb::testing
