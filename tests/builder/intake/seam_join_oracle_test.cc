// SPDX-License-Identifier: Apache-2.0
// Meshes that were cut along edges are joined by themselves, against the definition.
#include <catch2/catch.hpp>
#include <cstring>

#include "builder/intake/seam_join.h"
#include "builder/mesh_survey.h"
#include "tests/builder/fixture.h"
#include "tests/builder/nasty_meshes.h"
#include "tests/support/cut_mesh.h"

namespace mtdb::testing {

using namespace internal;

namespace {

MeshSurvey SurveyOfMesh(const TriangleMesh& mesh, const BuildOptions& options = {}) {
  const Result<MeshSurvey> survey =
      SurveyMesh([&](MeshSink& sink) { return SendMesh(mesh, sink); }, options);
  INFO(survey.status().message());
  REQUIRE(survey.ok());
  return *survey;
}

// A byte a vertex; behind three doubles, when `wide`.
void AddByte(TriangleMesh* mesh, const std::function<int(VertexIndex)>& value, bool wide = false) {
  mesh->header.attributes.attributes.clear();
  for (const char* name : {"a", "b", "c"}) {
    if (wide) mesh->header.attributes.attributes.push_back({name, ScalarType::kFloat64});
  }
  mesh->header.attributes.attributes.push_back({"colour", ScalarType::kUint8});
  mesh->rows.clear();
  for (VertexIndex v = 0; v < mesh->positions.size(); ++v) {
    if (wide) mesh->rows.insert(mesh->rows.end(), 3 * sizeof(double), std::byte{0});
    mesh->rows.push_back(static_cast<std::byte>(value(v)));
  }
}

struct Spools {
  SpoolSpace space{"."};
  Spool vertices{&space, 1 << 16}, triangles{&space, 1 << 16};
  Spool left{&space, 1 << 16}, kept{&space, 1 << 16};
};

SeamJoinTotals Join(const TriangleMesh& mesh, bool doubles, size_t memory, Spools* s) {
  const size_t row = mesh.header.attributes.row_bytes();
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    const Vec3d p = mesh.positions[v];
    const Vec3f f{static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
    REQUIRE((doubles ? s->vertices.Append(&p, sizeof(p)) : s->vertices.Append(&f, sizeof(f))).ok());
    REQUIRE(s->vertices.Append(mesh.rows.data() + v * row, row).ok());
  }
  for (const TriangleVertices& t : mesh.triangles) {
    for (const VertexIndex v : t) {
      const auto number = static_cast<uint32_t>(v);
      REQUIRE(s->triangles.Append(&number, sizeof(number)).ok());
    }
  }
  REQUIRE(s->vertices.Finish().ok());
  REQUIRE(s->triangles.Finish().ok());
  const SeamJoinInput input{&s->vertices, (doubles ? 24u : 12u) + row, doubles, &s->triangles, {}};
  const Result<SeamJoinTotals> totals = JoinSeams(input, &s->space, memory, &s->left, &s->kept);
  INFO(totals.status().message());
  REQUIRE(totals.ok());
  REQUIRE(s->left.Finish().ok());
  REQUIRE(s->kept.Finish().ok());
  return *totals;
}

// Cubes of six quads, each with vertices of its own, at these corners.
TriangleMesh Cubes(const std::vector<Vec3d>& corners) {
  TriangleMesh mesh;
  for (const Vec3d corner : corners) {
    for (int axis = 0; axis < 3; ++axis) {
      for (int side = 0; side < 2; ++side) {
        const VertexIndex v = mesh.positions.size();
        for (int i = 0; i < 4; ++i) {
          Vec3d p{};
          p[axis] = side;
          p[(axis + 1) % 3] = i == 1 || i == 2;
          p[(axis + 2) % 3] = i >= 2;
          mesh.positions.push_back(corner + p);
        }
        if (side == 1) {
          mesh.triangles.push_back({v, v + 1, v + 2});
          mesh.triangles.push_back({v, v + 2, v + 3});
        } else {
          mesh.triangles.push_back({v, v + 2, v + 1});
          mesh.triangles.push_back({v, v + 3, v + 2});
        }
      }
    }
  }
  return mesh;
}

// A sheet of quads, and behind it the same turned over, cut along the other diagonals if `crossed`.
TriangleMesh TwoSided(int n, bool crossed) {
  TriangleMesh mesh;
  for (int side = 0; side < 2; ++side) {
    const VertexIndex first = mesh.positions.size();
    for (int y = 0; y <= n; ++y) {
      for (int x = 0; x <= n; ++x) mesh.positions.push_back({1.0 * x, 1.0 * y, 0.5 * x});
    }
    const auto across = static_cast<VertexIndex>(n + 1);
    for (int y = 0; y < n; ++y) {
      for (int x = 0; x < n; ++x) {
        const VertexIndex a =
            first + static_cast<VertexIndex>(y) * across + static_cast<VertexIndex>(x);
        const VertexIndex b = a + 1, c = a + across + 1, d = a + across;
        if (side == 0) {
          mesh.triangles.push_back({a, b, c});
          mesh.triangles.push_back({a, c, d});
        } else if (crossed) {
          mesh.triangles.push_back({d, c, b});
          mesh.triangles.push_back({d, b, a});
        } else {
          mesh.triangles.push_back({c, b, a});
          mesh.triangles.push_back({d, c, a});
        }
      }
    }
  }
  return mesh;
}

}  // namespace

TEST_CASE("Cut meshes are joined as the definition says, in any memory") {
  std::mt19937_64 random(5);
  for (int round = 0; round < 40; ++round) {
    TriangleMesh mesh = MakeSheet(12, 0.1, static_cast<uint32_t>(round));
    if (round % 4 == 1) mesh = TwoSided(6, round % 8 == 1);
    if (round % 4 == 2) mesh = Cubes({{0, 0, 0}, {1, 1, 0}, {3, 0, 0}, {4, 1, 1}});
    const auto colour = [&](VertexIndex) {
      return round % 3 == 0 ? static_cast<int>(random() % 2) : 0;
    };
    AddByte(&mesh, colour, round % 7 < 3);
    mesh = CutMesh(mesh, static_cast<double>(round % 5) / 4, random());
    for (int i = round % 6; i > 0; --i) {  // triangles with two like corners, and other spoils
      TriangleVertices t = mesh.triangles[random() % mesh.triangles.size()];
      t[random() % 3] = random() % mesh.positions.size();
      mesh.triangles.push_back(t);
    }
    const bool doubles = round % 2 == 0;
    for (Vec3d& p : mesh.positions) {
      if (!doubles) {
        p = {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
      }
      if (p.x == 0 && random() % 2 == 0) p.x = -0.0;
    }
    const JoinedSeams expected = JoinSeamsByDefinition(mesh);
    for (const size_t memory : {size_t{1} << 26, size_t{1} << 12}) {
      INFO("round " << round << ", memory " << memory);
      Spools spools;
      const SeamJoinTotals totals = Join(mesh, doubles, memory, &spools);
      REQUIRE(totals.joined == expected.gone);
      REQUIRE(totals.vertices == mesh.positions.size() - expected.gone);
      if (expected.gone == 0) continue;
      std::vector<uint32_t> number(mesh.positions.size());
      uint32_t count = 0;
      for (size_t v = 0; v < number.size(); ++v) {
        number[v] = expected.first[v] == v ? count++ : number[expected.first[v]];
      }
      SpoolReader reader(&spools.kept);
      for (size_t t = 0; t < mesh.triangles.size(); ++t) {
        if (!expected.has_area[t]) continue;
        std::array<uint32_t, 3> found;
        REQUIRE(reader.Get(&found));
        for (size_t c = 0; c < 3; ++c) REQUIRE(found[c] == number[mesh.triangles[t][c]]);
      }
      CHECK(reader.remaining() == 0);
      CHECK(spools.left.size() ==
            count * ((doubles ? 24 : 12) + mesh.header.attributes.row_bytes()));
    }
  }
}

TEST_CASE("A mesh that is written face by face becomes what it was, and --no-weld keeps it") {
  const TriangleMesh whole = MakeSculpture(4000);
  const TriangleMesh apart = CutMesh(whole, 1, 1);
  const BuiltObject built = Build(apart);
  CHECK(built.record.vertices == whole.positions.size());
  CHECK(built.record.components == 1);
  CHECK(built.record.boundary_edges == 0);
  CHECK(built.record.surface_digest == Build(whole).record.surface_digest);
  BuildOptions kept;
  kept.keep_apart = true;
  CHECK(Build(apart, kept).record.components == whole.triangles.size());
  const MeshSurvey survey = SurveyOfMesh(apart);
  CHECK(survey.welded_vertices == 3 * whole.triangles.size() - whole.positions.size());
  CHECK(survey.equal_vertices == 0);
  CHECK_FALSE(survey.attributes_differ);
}

TEST_CASE("Bodies that touch in an edge or a corner stay bodies") {
  const BuiltObject built = Build(Cubes({{0, 0, 0}, {1, 1, 0}, {2, 2, 1}}));
  CHECK(built.record.components == 3);
  CHECK(built.record.input.nonmanifold_edges == 0);
  CHECK(built.record.input.nonmanifold_vertices == 0);
  CHECK(built.record.boundary_edges == 0);
  CHECK(built.record.vertices == 24);
}

TEST_CASE("Sheets that lie back to back stay apart, however their quads were cut") {
  for (const bool crossed : {false, true}) {
    const MeshSurvey survey = SurveyOfMesh(TwoSided(8, crossed));
    INFO(crossed);
    CHECK(survey.welded_vertices == 0);
    CHECK(survey.equal_vertices == 81);
    CHECK_FALSE(survey.attributes_differ);
    CHECK(survey.components == 2);
  }
}

TEST_CASE("A cut between other attributes stays, and the survey says what --weld would do") {
  TriangleMesh mesh;
  for (int side = 0; side < 2; ++side) {
    const VertexIndex first = mesh.positions.size();
    for (int x = 0; x < 2; ++x) {
      for (int y = 0; y <= 10; ++y) mesh.positions.push_back({1.0 * (x + side), 1.0 * y, 0});
    }
    for (VertexIndex y = 0; y < 10; ++y) {
      const VertexIndex a = first + y, b = a + 11;
      mesh.triangles.push_back({a, b, b + 1});
      mesh.triangles.push_back({a, b + 1, a + 1});
    }
  }
  AddByte(&mesh, [](VertexIndex v) { return v >= 22; });
  const MeshSurvey survey = SurveyOfMesh(mesh);
  CHECK(survey.welded_vertices == 0);
  CHECK(survey.equal_vertices == 11);
  CHECK(survey.attributes_differ);
  CHECK(survey.components == 2);
  BuildOptions weld;
  weld.weld = 0;
  CHECK(SurveyOfMesh(mesh, weld).welded_vertices == survey.equal_vertices);
  AddByte(&mesh, [](VertexIndex) { return 7; });
  CHECK(SurveyOfMesh(mesh).welded_vertices == 11);
  CHECK(SurveyOfMesh(mesh).components == 1);
}

}  // namespace mtdb::testing
