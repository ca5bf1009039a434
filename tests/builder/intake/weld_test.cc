// SPDX-License-Identifier: Apache-2.0
// Welding, against its definition.
#include <catch2/catch.hpp>
#include <cstring>
#include <numeric>
#include <random>

#include "builder/intake/near_join.h"
#include "builder/intake/soup_join.h"
#include "builder/mesh_survey.h"
#include "tests/builder/fixture.h"

namespace mtdb::testing {

using namespace internal;

namespace {

// A vertex as spools have it: a position and a row that tells its number.
struct Point {
  Vec3d position;
  uint32_t row = 0;
  uint32_t unused = 0;
};

void Fill(const std::vector<Point>& points, Spool* spool) {
  for (const Point& p : points) REQUIRE(spool->Append(&p, sizeof(p)).ok());
  REQUIRE(spool->Finish().ok());
}

template <typename T>
std::vector<T> Contents(Spool& spool) {
  REQUIRE(spool.Finish().ok());
  std::vector<T> values(spool.size() / sizeof(T));
  REQUIRE(spool.Read(0, values.data(), values.size() * sizeof(T)).ok());
  return values;
}

// For each point the first of its chain of distances of at most `tolerance`.
std::vector<uint32_t> Chains(const std::vector<Point>& points, double tolerance) {
  std::vector<uint32_t> first(points.size());
  std::iota(first.begin(), first.end(), 0u);
  for (bool changed = true; changed;) {
    changed = false;
    for (size_t i = 0; i < points.size(); ++i) {
      for (size_t j = 0; j < i; ++j) {
        if (first[i] == first[j]) continue;
        if (Length(points[i].position - points[j].position) > tolerance) continue;
        first[i] = first[j] = std::min(first[i], first[j]);
        changed = true;
      }
    }
  }
  return first;
}

std::vector<Point> RandomPoints(size_t count, double size, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> at(-size, size);
  std::vector<Point> points(count);
  for (uint32_t i = 0; i < count; ++i) points[i] = {{at(random), at(random), at(random)}, i, 0};
  return points;
}

NearJoinTotals Join(const std::vector<Point>& points, double tolerance, size_t memory,
                    std::vector<Point>* left, std::vector<uint32_t>* numbers) {
  const SpoolSpace space{"."};
  Spool vertices(&space, 1 << 16), left_spool(&space, 1 << 16), number_spool(&space, 1 << 16);
  Fill(points, &vertices);
  const NearJoinInput input{&vertices, sizeof(Point),
                            [](const std::byte* bytes) {
                              Vec3d p;
                              std::memcpy(&p, bytes, sizeof(p));
                              return p;
                            },
                            tolerance};
  const Result<NearJoinTotals> totals = JoinNear(input, &space, memory, &left_spool, &number_spool);
  INFO(totals.status().message());
  REQUIRE(totals.ok());
  *left = Contents<Point>(left_spool);
  *numbers = Contents<uint32_t>(number_spool);
  REQUIRE(left->size() == totals->vertices);
  REQUIRE(numbers->size() == points.size());
  return *totals;
}

// Two squares of side x side cells that adjoin at x = side, each with vertices of its own there;
// those of the second are off by `gap`.
TriangleMesh TwoTiles(int side, double gap, bool turned) {
  TriangleMesh mesh;
  mesh.header.attributes.attributes.push_back({"tile", ScalarType::kUint8});
  for (int tile = 0; tile < 2; ++tile) {
    const VertexIndex first = mesh.positions.size();
    for (int y = 0; y <= side; ++y) {
      for (int x = 0; x <= side; ++x) {
        const double shift = tile == 1 && x == 0 ? gap : 0;
        mesh.positions.push_back(
            {static_cast<double>(x + tile * side), y + shift, 0.25 * ((x + tile * side) * y % 7)});
        mesh.rows.push_back(static_cast<std::byte>(tile));
      }
    }
    for (int y = 0; y < side; ++y) {
      for (int x = 0; x < side; ++x) {
        const VertexIndex v = first + static_cast<VertexIndex>(y * (side + 1) + x);
        const VertexIndex up = v + static_cast<VertexIndex>(side) + 1;
        mesh.triangles.push_back({v, v + 1, up + 1});
        mesh.triangles.push_back({v, up + 1, up});
        if (!turned || tile == 0) continue;
        for (size_t i = 1; i <= 2; ++i) {
          std::swap(mesh.triangles[mesh.triangles.size() - i][1],
                    mesh.triangles[mesh.triangles.size() - i][2]);
        }
      }
    }
  }
  return mesh;
}

BuiltObject BuildWelded(const TriangleMesh& mesh, double tolerance) {
  BuildOptions options;
  options.weld = tolerance;
  return Build(mesh, options);
}

}  // namespace

TEST_CASE("Near vertices become the first of their chain, whatever the memory") {
  for (const uint32_t seed : {1u, 2u, 3u}) {
    const std::vector<Point> points = RandomPoints(1500, 10, seed);
    for (const double tolerance : {0.01, 0.5, 1.3}) {
      const std::vector<uint32_t> expected = Chains(points, tolerance);
      std::vector<Point> left;
      std::vector<uint32_t> numbers;
      const NearJoinTotals totals = Join(points, tolerance, 1 << 24, &left, &numbers);
      double displacement = 0;
      uint32_t next = 0;
      for (uint32_t i = 0; i < points.size(); ++i) {
        REQUIRE(numbers[i] < left.size());
        REQUIRE(left[numbers[i]].row == expected[i]);
        if (expected[i] == i) REQUIRE(numbers[i] == next++);
        displacement =
            std::max(displacement, Length(points[i].position - points[expected[i]].position));
      }
      CHECK(totals.displacement == displacement);
    }
  }
  const std::vector<Point> many = RandomPoints(120'000, 10, 9);
  std::vector<Point> left, left_of_parts;
  std::vector<uint32_t> numbers, numbers_of_parts;
  Join(many, 0.1, size_t{1} << 30, &left, &numbers);
  Join(many, 0.1, size_t{6} << 20, &left_of_parts, &numbers_of_parts);
  CHECK(left.size() < many.size());
  CHECK(left.size() == left_of_parts.size());
  CHECK(numbers == numbers_of_parts);
}

TEST_CASE("A tolerance far above the edges, or below the coordinates' precision, is refused") {
  const auto status = [](double size, double tolerance) {
    const SpoolSpace space{"."};
    Spool vertices(&space, 1 << 16), left(&space, 0), numbers(&space, 0);
    Fill(RandomPoints(2000, size, 3), &vertices);
    const NearJoinInput input{&vertices, sizeof(Point),
                              [](const std::byte* bytes) {
                                Vec3d p;
                                std::memcpy(&p, bytes, sizeof(p));
                                return p;
                              },
                              tolerance};
    return JoinNear(input, &space, 1 << 24, &left, &numbers).status();
  };
  CHECK(status(10, 1000).code() == StatusCode::kInvalidArgument);
  CHECK_THAT(status(10, 1000).message(), Catch::Contains("below the lengths of the mesh's edges"));
  // Much of the mesh in one place, nothing near another: it does not fit the memory.
  std::vector<Point> lattice;
  for (uint32_t i = 0; i < 60 * 60 * 60; ++i) {
    const Vec3i cell{static_cast<int>(i % 60), static_cast<int>(i / 60 % 60),
                     static_cast<int>(i / 3600)};
    lattice.push_back({ToDouble(cell) * 1.001, i, 0});
  }
  const SpoolSpace space{"."};
  Spool vertices(&space, 1 << 16), left(&space, 0), numbers(&space, 0);
  Fill(lattice, &vertices);
  const NearJoinInput input{&vertices, sizeof(Point),
                            [](const std::byte* bytes) {
                              Vec3d p;
                              std::memcpy(&p, bytes, sizeof(p));
                              return p;
                            },
                            1};
  const Status much = JoinNear(input, &space, 1 << 20, &left, &numbers).status();
  CHECK(much.code() == StatusCode::kBudgetExceeded);
  CHECK_THAT(much.message(), Catch::Contains("--memory"));
  CHECK(status(1e6, 1e-12).code() == StatusCode::kInvalidArgument);
  CHECK_THAT(status(1e6, 1e-12).message(), Catch::Contains("precision"));
}

TEST_CASE("Adjoining tiles become one surface, and the first tile's attributes stay") {
  const TriangleMesh apart = TwoTiles(20, 0, false);
  CHECK(Build(apart).record.components == 2);
  const BuiltObject welded = BuildWelded(apart, 0);
  CHECK(welded.record.components == 1);
  CHECK(welded.record.boundary_edges == 120);
  CHECK(welded.record.vertices == 21 * 41);
  CHECK(welded.record.triangles == apart.triangles.size());
  CHECK(welded.record.rounding_error < 1e-12);
  const TriangleMesh mesh = Extract(*welded.surface, Query{});
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    REQUIRE(mesh.rows[v] == static_cast<std::byte>(mesh.positions[v].x > 20));
  }
}

TEST_CASE("Within a tolerance tiles that differ become one, and the bound knows what was moved") {
  const double gap = 0.03;
  const TriangleMesh apart = TwoTiles(20, gap, false);
  CHECK(BuildWelded(apart, 0).record.components == 2);
  CHECK(BuildWelded(apart, gap / 2).record.components == 2);
  const BuiltObject welded = BuildWelded(apart, gap * 1.01);
  CHECK(welded.record.components == 1);
  CHECK(welded.record.rounding_error >= gap * 0.999);
  BuildOptions options;
  options.weld = gap * 1.01;
  const Result<MeshSurvey> survey =
      SurveyMesh([&](MeshSink& sink) { return SendMesh(apart, sink); }, options);
  REQUIRE(survey.ok());
  CHECK(survey->components == 1);
  CHECK(survey->welded_vertices == 21);
}

TEST_CASE("Where welding makes an edge non-manifold, it is kept and never simplified") {
  // The second tile is turned over: both triangles run along the common edges in one direction.
  const BuiltObject turned = BuildWelded(TwoTiles(20, 0, true), 0);
  CHECK(turned.record.components == 1);
  CHECK(turned.record.input.nonmanifold_edges == 20);
  CHECK(turned.record.triangles == 1600);
}

TEST_CASE("A mesh whose triangles have vertices of their own becomes what it was") {
  const TriangleMesh whole = MakeSculpture(4000);
  TriangleMesh apart;
  apart.header = whole.header;
  apart.header.vertex_count.reset();
  for (const TriangleVertices& t : whole.triangles) {
    const VertexIndex v = apart.positions.size();
    for (const VertexIndex corner : t) apart.positions.push_back(whole.positions[corner]);
    apart.triangles.push_back({v, v + 1, v + 2});
  }
  const BuiltObject welded = BuildWelded(apart, 0);
  CHECK(welded.record.vertices == whole.positions.size());
  CHECK(welded.record.components == 1);
  CHECK(welded.record.boundary_edges == 0);
  CHECK(welded.record.surface_digest == Build(whole).record.surface_digest);
}

TEST_CASE("Triangles of which two corners are welded are dropped and counted") {
  TriangleMesh mesh = TwoTiles(4, 0, false);
  const VertexIndex v = mesh.positions.size();
  for (const double x : {0.0, 1e-4}) {
    mesh.positions.push_back({20 + x, 20, 0});
    mesh.rows.push_back(std::byte{0});
  }
  mesh.triangles.push_back({0, v, v + 1});
  mesh.triangles.push_back({0, 1, v});
  const BuiltObject welded = BuildWelded(mesh, 1e-3);
  CHECK(welded.record.input.degenerate_triangles == 1);
  CHECK(welded.record.triangles == mesh.triangles.size() - 1);
}

}  // namespace mtdb::testing
