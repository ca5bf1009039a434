// SPDX-License-Identifier: Apache-2.0
// What comes in: meshes that were split along seams, corners that cannot be, vertices of many
// charts, triangles back to back with an image on either side.
#include <catch2/catch.hpp>
#include <limits>
#include <map>

#include "tests/builder/fixture.h"
#include "tests/textures/charted_mesh.h"
#include "tests/textures/corner_list.h"

namespace mtdb::testing {
namespace {

BuildOptions Lossless() {
  BuildOptions options;
  options.mode = PositionMode::kLossless;
  return options;
}

// A vertex for each corner that differs, as in files with one index a corner.
TriangleMesh SplitAtSeams(const TriangleMesh& mesh) {
  TriangleMesh split = mesh;
  split.positions.clear();
  std::map<std::tuple<VertexIndex, float, float, uint32_t>, VertexIndex> numbers;
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (size_t c = 0; c < 3; ++c) {
      const VertexIndex v = mesh.triangles[t][c];
      const TextureCorner& corner = mesh.corners[3 * t + c];
      const auto [at, fresh] =
          numbers.try_emplace({v, corner.u, corner.v, corner.page}, split.positions.size());
      if (fresh) split.positions.push_back(mesh.positions[v]);
      split.triangles[t][c] = at->second;
    }
  }
  return split;
}

// A cone of `sides` triangles, each a chart of its own.
TriangleMesh MakeFan(uint32_t sides) {
  TriangleMesh mesh;
  mesh.header.textured = true;
  mesh.header.textures = {{"a.png", "image/png", 64, 64, {}}};
  mesh.positions.push_back({0, 0, 1});
  for (uint32_t i = 0; i < sides; ++i) {
    const double turn = 6.283185307179586 * i / sides;
    mesh.positions.push_back({std::cos(turn), std::sin(turn), 0});
  }
  for (Vec3d& p : mesh.positions) {
    p = {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
  }
  for (uint32_t i = 0; i < sides; ++i) {
    mesh.triangles.push_back({0, 1 + i, 1 + (i + 1) % sides});
    const float u = static_cast<float>(i) / static_cast<float>(sides);
    mesh.corners.insert(mesh.corners.end(), {{u, 0, 0}, {u + 0.01f, 0.5f, 0}, {u, 0.25f, 0}});
  }
  return mesh;
}

// A sphere as programs for modelling make it: each triangle at a pole has its own u there, and one
// meridian is a seam.
TriangleMesh MakeUvSphere(uint32_t columns, uint32_t rows) {
  TriangleMesh mesh;
  mesh.header.textured = true;
  mesh.header.textures = {{"globe.png", "image/png", 2048, 1024, {}}};
  const double turn = 6.283185307179586;
  const auto vertex = [&](uint32_t i, uint32_t j) -> VertexIndex {
    if (j == 0) return 0;
    if (j == rows) return 1;
    return 2 + (j - 1) * columns + i % columns;
  };
  mesh.positions = {{0, 0, -1}, {0, 0, 1}};
  for (uint32_t j = 1; j < rows; ++j) {
    const double up = -std::cos(turn / 2 * j / rows), out = std::sin(turn / 2 * j / rows);
    for (uint32_t i = 0; i < columns; ++i) {
      const double a = turn * i / columns;
      mesh.positions.push_back({static_cast<float>(out * std::cos(a)),
                                static_cast<float>(out * std::sin(a)), static_cast<float>(up)});
    }
  }
  const auto add = [&](std::array<std::array<uint32_t, 2>, 3> t, double middle) {
    TriangleVertices& triangle = mesh.triangles.emplace_back();
    for (size_t c = 0; c < 3; ++c) {
      const auto [i, j] = t[c];
      triangle[c] = vertex(i, j);
      const bool pole = j == 0 || j == rows;
      mesh.corners.push_back({static_cast<float>((pole ? middle : i) / columns),
                              static_cast<float>(static_cast<double>(j) / rows), 0});
    }
  };
  for (uint32_t j = 0; j < rows; ++j) {
    for (uint32_t i = 0; i < columns; ++i) {
      if (j > 0) add({{{i, j}, {i + 1, j}, {i + 1, j + 1}}}, i + 0.5);
      if (j + 1 < rows) add({{{i, j}, {i + 1, j + 1}, {i, j + 1}}}, i + 0.5);
    }
  }
  return mesh;
}

Status BuildStatus(const TriangleMesh& mesh) {
  const TempStore store;
  return BuildInto(store.database(), "object", mesh, Lossless()).status();
}

}  // namespace

TEST_CASE("A mesh that was split at seams is the one that was not") {
  for (const Charting charting : {Charting::kViews, Charting::kPatches, Charting::kSlit}) {
    CAPTURE(NameOf(charting));
    const TriangleMesh mesh = MakeCharted(charting, 40, 20, 0.5, 3);
    const TriangleMesh split = SplitAtSeams(mesh);
    REQUIRE(split.positions.size() > mesh.positions.size());
    const BuiltObject built = Build(mesh, Lossless());
    const BuiltObject joined = Build(split, Lossless());
    CHECK(joined.record.vertices == built.record.vertices);
    CHECK(joined.record.boundary_edges == built.record.boundary_edges);
    CHECK(joined.record.root_triangles <= built.record.root_triangles * 5 / 4);
    CHECK(CornersOf(Extract(*joined.surface, {}), 0) == CornersOf(mesh, 0));
  }
}

TEST_CASE("The result does not depend on threads, and not on memory") {
  const TriangleMesh mesh = MakeCharted(Charting::kViews, 128, 64, 1, 4);
  BuildOptions options = Lossless();
  options.tile_triangles = 512;
  options.threads = 1;
  const BuiltObject one = Build(mesh, options);
  options.threads = 2;
  options.memory_bytes = uint64_t{256} << 20;
  const BuiltObject two = Build(mesh, options);
  CHECK(one.record.digest_hex() == two.record.digest_hex());
}

TEST_CASE("Without its texture a mesh is simplified across seams") {
  const TriangleMesh mesh = MakeCharted(Charting::kTriangles, 40, 20, 0, 5);
  BuildOptions options = Lossless();
  const BuiltObject textured = Build(mesh, options);
  CHECK(textured.record.root_triangles == mesh.triangles.size());
  options.drop_texture = true;
  const BuiltObject plain = Build(mesh, options);
  CHECK_FALSE(plain.record.texture);
  CHECK(plain.record.root_triangles < mesh.triangles.size() / 4);
  const TriangleMesh back = Extract(*plain.surface, {});
  CHECK_FALSE(back.header.textured);
  CHECK(back.corners.empty());
}

TEST_CASE("A vertex of any number of charts has all its corners") {
  for (const uint32_t sides : {3u, 14u, 15u, 16u, 40u}) {
    CAPTURE(sides);
    const TriangleMesh mesh = MakeFan(sides);
    const BuiltObject built = Build(mesh, Lossless());
    CHECK(CornersOf(Extract(*built.surface, {}), 0) == CornersOf(mesh, 0));
  }
}

TEST_CASE("The poles of a globe stay, and its meridian is simplified") {
  for (const uint32_t columns : {12u, 16u, 32u, 64u}) {
    CAPTURE(columns);
    const TriangleMesh mesh = MakeUvSphere(columns, columns / 2);
    const BuiltObject built = Build(mesh, Lossless());
    CHECK(CornersOf(Extract(*built.surface, {}), 0) == CornersOf(mesh, 0));
    CHECK(built.record.root_triangles < mesh.triangles.size());
  }
}

TEST_CASE("Images that are repeated often are kept, in larger steps where that needs be") {
  TriangleMesh mesh = MakeCharted(Charting::kSlit, 24, 12, 0, 9);
  for (TextureCorner& corner : mesh.corners) corner.u *= 3000;
  const BuiltObject built = Build(mesh, {});
  const double step = built.record.texture->step;
  CHECK(step > 1.0 / 8192);
  CHECK(CornersOf(Extract(*built.surface, {}), 0).size() == mesh.triangles.size());
  BuildOptions fine;
  fine.texture_step = 1.0 / 65536;
  const TempStore store;
  CHECK(BuildInto(store.database(), "object", mesh, fine).status().code() == StatusCode::kBadInput);
}

TEST_CASE("What floats beside a textured surface stays") {
  TriangleMesh mesh = MakeCharted(Charting::kPatches, 40, 20, 0, 10);
  const size_t own = mesh.triangles.size();
  for (size_t t = 0; t < own; t += 50) {
    const VertexIndex first = mesh.positions.size();
    for (const VertexIndex v : mesh.triangles[t]) {
      mesh.positions.push_back(mesh.positions[v] + Vec3d{0.001, 0.001, 0.001});
    }
    mesh.triangles.push_back({first, first + 1, first + 2});
    mesh.corners.insert(mesh.corners.end(), {{0, 0, 1}, {0.1f, 0, 1}, {0, 0.1f, 1}});
  }
  BuildOptions options;
  options.texture_step = 0;
  const BuiltObject built = Build(mesh, options);
  CHECK(built.record.root_triangles >= mesh.triangles.size() - own);
}

TEST_CASE("Triangles back to back keep the image on either side") {
  TriangleMesh mesh = MakeCharted(Charting::kSlit, 24, 12, 0, 6);
  const size_t front = mesh.triangles.size();
  for (const bool alike : {false, true}) {
    CAPTURE(alike);
    TriangleMesh both = mesh;
    for (size_t t = 0; t < front; ++t) {
      const TriangleVertices v = mesh.triangles[t];
      both.triangles.push_back({v[0], v[2], v[1]});
      for (const size_t c : {0u, 2u, 1u}) {
        TextureCorner corner = mesh.corners[3 * t + c];
        if (!alike) corner.page = 1;
        both.corners.push_back(corner);
      }
    }
    const BuiltObject built = Build(both, Lossless());
    CHECK(built.record.input.two_sided_triangles == (alike ? front : 0));
    CHECK(CornersOf(Extract(*built.surface, {}), 0) == CornersOf(both, 0));
  }
}

TEST_CASE("Corners that cannot be are refused with their triangle") {
  const TriangleMesh good = MakeCharted(Charting::kPatches, 8, 6, 0, 7);
  const auto refused = [&](const TextureCorner& corner) {
    TriangleMesh bad = good;
    bad.corners[3 * 5 + 1] = corner;
    const Status status = BuildStatus(bad);
    CHECK(status.code() == StatusCode::kBadInput);
    CHECK_THAT(status.message(), Catch::Contains("triangle 5"));
  };
  const uint32_t page = good.corners[15].page;
  refused({0, std::numeric_limits<float>::quiet_NaN(), page});
  refused({std::numeric_limits<float>::infinity(), 0, page});
  refused({3e7f, 0, page});
  refused({0, 0, 1 - page});
  refused({0, 0, 2});
}

}  // namespace mtdb::testing
