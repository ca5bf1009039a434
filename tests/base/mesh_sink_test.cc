// SPDX-License-Identifier: Apache-2.0
#include "store/base/mesh_sink.h"

#include <catch2/catch.hpp>
#include <vector>

namespace mtdb::testing {
namespace {

constexpr size_t kBlock = 65536;

// Sends a header that announces so many of either, and blocks of as many as come.
TriangleMesh Receive(uint64_t announced, size_t blocks) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  MeshHeader header;
  header.attributes.attributes.push_back({"quality", ScalarType::kFloat32});
  header.vertex_count = header.triangle_count = announced;
  const std::vector<Vec3d> positions(kBlock);
  const Bytes rows(kBlock * header.attributes.row_bytes());
  const std::vector<TriangleVertices> triangles(kBlock);
  REQUIRE(sink.Begin(header).ok());
  for (size_t i = 0; i < blocks; ++i) REQUIRE(sink.AddVertices(positions, rows).ok());
  for (size_t i = 0; i < blocks; ++i) REQUIRE(sink.AddTriangles(triangles).ok());
  REQUIRE(sink.End().ok());
  REQUIRE(mesh.positions.size() == blocks * kBlock);
  REQUIRE(mesh.triangles.size() == blocks * kBlock);
  REQUIRE(mesh.rows.size() == blocks * kBlock * header.attributes.row_bytes());
  REQUIRE(mesh.header.vertex_count == blocks * kBlock);
  return mesh;
}

}  // namespace

TEST_CASE("A mesh in memory takes the room that was announced, and no more") {
  constexpr size_t kBlocks = 40;
  const TriangleMesh mesh = Receive(kBlocks * kBlock, kBlocks);
  REQUIRE(mesh.positions.capacity() == kBlocks * kBlock);
  REQUIRE(mesh.triangles.capacity() == kBlocks * kBlock);
}

TEST_CASE("Counts that were announced and do not come take little room") {
  for (const uint64_t announced : {uint64_t{1} << 40, ~uint64_t{0}}) {
    const TriangleMesh mesh = Receive(announced, 1);
    REQUIRE(mesh.positions.capacity() <= 256 * kBlock);
    REQUIRE(mesh.triangles.capacity() <= 256 * kBlock);
  }
}

TEST_CASE("More may come than was announced") {
  for (const uint64_t announced : {0, 1, 100'000}) {
    const TriangleMesh mesh = Receive(announced, 5);
    REQUIRE(mesh.positions.capacity() <= 10 * kBlock);
  }
}

}  // namespace mtdb::testing
