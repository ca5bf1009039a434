// SPDX-License-Identifier: Apache-2.0
// Draco's own decoder is the oracle of the .drc writer.
#include <algorithm>
#include <cmath>
#include <draco/compression/decode.h>
#include <filesystem>
#include <map>
#include <memory>

#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using testing::ColouredTetrahedron;
using testing::ReadBytes;
using testing::ScratchFolder;
using testing::WriteMesh;

std::unique_ptr<draco::Mesh> Decode(const std::string& path) {
  const std::string bytes = ReadBytes(path);
  draco::DecoderBuffer buffer;
  buffer.Init(bytes.data(), bytes.size());
  draco::Decoder decoder;
  auto mesh = decoder.DecodeMeshFromBuffer(&buffer);
  INFO(mesh.status().error_msg_string());
  REQUIRE(mesh.ok());
  return std::move(mesh).value();
}

// A wavy sheet of side * side vertices with colours.
TriangleMesh Sheet(size_t side) {
  TriangleMesh mesh;
  for (const char* name : {"red", "green", "blue"}) {
    mesh.header.attributes.attributes.push_back({name, ScalarType::kUint8});
  }
  for (size_t y = 0; y < side; ++y) {
    for (size_t x = 0; x < side; ++x) {
      mesh.positions.push_back({static_cast<double>(x), static_cast<double>(y),
                                10 * std::sin(0.2 * static_cast<double>(x + 2 * y))});
      for (const size_t c : {x, y, x + y}) mesh.rows.push_back(static_cast<std::byte>(c));
    }
  }
  for (size_t y = 0; y + 1 < side; ++y) {
    for (size_t x = 0; x + 1 < side; ++x) {
      const VertexIndex a = y * side + x;
      mesh.triangles.push_back({a, a + 1, a + side});
      mesh.triangles.push_back({a + 1, a + side + 1, a + side});
    }
  }
  return mesh;
}

TEST_CASE("Draco gives back positions within half a quantum, and colours exactly") {
  const ScratchFolder folder;
  constexpr size_t kSide = 40;
  const TriangleMesh mesh = Sheet(kSide);
  for (const int bits : {11, 16}) {
    MeshWriteOptions options;
    options.draco_position_bits = bits;
    REQUIRE(WriteMesh(mesh, folder.Path("s.drc"), options).ok());
    const std::unique_ptr<draco::Mesh> decoded = Decode(folder.Path("s.drc"));
    REQUIRE(decoded->num_points() == mesh.positions.size());
    REQUIRE(decoded->num_faces() == mesh.triangles.size());
    const auto* const position = decoded->GetNamedAttribute(draco::GeometryAttribute::POSITION);
    const auto* const colour = decoded->GetNamedAttribute(draco::GeometryAttribute::COLOR);
    REQUIRE(colour != nullptr);
    REQUIRE(colour->num_components() == 3);
    const double quantum = (kSide - 1) / (std::ldexp(1.0, bits) - 1);
    for (uint32_t i = 0; i < decoded->num_points(); ++i) {
      const draco::PointIndex point(i);
      float p[3];
      uint8_t c[3];
      position->GetMappedValue(point, p);
      colour->GetMappedValue(point, c);
      const auto x = static_cast<size_t>(std::lround(p[0]));
      const auto y = static_cast<size_t>(std::lround(p[1]));
      REQUIRE(std::max(x, y) < kSide);
      const Vec3d q = mesh.positions[y * kSide + x];
      for (int axis = 0; axis < 3; ++axis) {
        REQUIRE(std::abs(p[axis] - q[axis]) <= quantum * 0.5 + 1e-5);
      }
      REQUIRE(c[0] == x);
      REQUIRE(c[1] == y);
      REQUIRE(c[2] == x + y);
    }
  }
}

TEST_CASE("Draco carries normals as such and other attributes with their names") {
  const ScratchFolder folder;
  TriangleMesh mesh = ColouredTetrahedron();
  REQUIRE(WriteMesh(mesh, folder.Path("a.drc")).ok());
  const std::unique_ptr<draco::Mesh> decoded = Decode(folder.Path("a.drc"));
  REQUIRE(decoded->num_attributes() == 4);
  REQUIRE(decoded->GetNamedAttribute(draco::GeometryAttribute::NORMAL) != nullptr);
  REQUIRE(decoded->GetNamedAttribute(draco::GeometryAttribute::COLOR)->num_components() == 4);
  const auto* const quality = decoded->GetNamedAttribute(draco::GeometryAttribute::GENERIC);
  REQUIRE(quality != nullptr);
  REQUIRE(quality->data_type() == draco::DT_FLOAT64);
  std::vector<double> values;
  for (uint32_t i = 0; i < decoded->num_points(); ++i) {
    double value = 0;
    quality->GetMappedValue(draco::PointIndex(i), &value);
    values.push_back(value);
  }
  std::sort(values.begin(), values.end());
  REQUIRE(values == std::vector<double>{1.0 / 4, 1.0 / 3, 1.0 / 2, 1.0});
  REQUIRE(decoded->GetAttributeIdByMetadataEntry("name", "quality") >= 0);
}

TEST_CASE("Draco levels trade size for time, and both decode") {
  const ScratchFolder folder;
  const TriangleMesh mesh = Sheet(100);
  std::map<int, size_t> sizes;
  for (const int level : {0, 7, 10}) {
    MeshWriteOptions options;
    options.draco_level = level;
    REQUIRE(WriteMesh(mesh, folder.Path("l.drc"), options).ok());
    REQUIRE(Decode(folder.Path("l.drc"))->num_faces() == mesh.triangles.size());
    sizes[level] = ReadBytes(folder.Path("l.drc")).size();
  }
  REQUIRE(sizes[10] < sizes[0]);
  REQUIRE(sizes[7] < sizes[0]);
}

TEST_CASE("Draco options out of range and meshes that it cannot encode are refused") {
  const ScratchFolder folder;
  for (const auto& [bits, level] : {std::pair{0, 7}, {31, 7}, {16, -1}, {16, 11}}) {
    MeshWriteOptions options;
    options.draco_position_bits = bits;
    options.draco_level = level;
    REQUIRE(CreateMeshFileWriter(folder.Path("o.drc"), options).status().code() ==
            StatusCode::kInvalidArgument);
  }
  TriangleMesh mesh = ColouredTetrahedron();
  mesh.triangles.clear();
  REQUIRE(WriteMesh(mesh, folder.Path("e.drc")).message().find("Draco holds 1 to") !=
          std::string::npos);
  mesh.triangles = {{1, 1, 2}};
  const Status degenerate = WriteMesh(mesh, folder.Path("e.drc"));
  REQUIRE(degenerate.code() == StatusCode::kInvalidArgument);
  REQUIRE(degenerate.message().find("Draco cannot encode the mesh") != std::string::npos);
  REQUIRE(folder.file_count() == 0);
}

TEST_CASE("positions move by no more than Draco's writer says, before the mesh and after it") {
  const ScratchFolder folder;
  int file = 0;
  for (const double scale : {1e-6, 1.0, 3e7}) {
    for (const double away : {0.0, 3.0, 4e4, 1e6}) {
      for (const int bits : {1, 8, 16, 24, 30}) {
        for (const bool doubles : {false, true}) {
          TriangleMesh mesh = Sheet(6);
          for (Vec3d& p : mesh.positions) {
            p = {scale * (p.x + away), scale * (p.y / 3 - 2 * away), scale * (p.z + away)};
            if (!doubles) {
              for (int i = 0; i < 3; ++i) p[i] = static_cast<double>(static_cast<float>(p[i]));
            }
            mesh.header.bounds.Add(p);
          }
          mesh.header.double_positions = doubles;
          const std::string path = folder.Path(std::to_string(file++) + ".drc");
          MeshWriteOptions options;
          options.draco_position_bits = bits;
          const auto writer = CreateMeshFileWriter(path, options).value();
          const double most = writer->LargestRounding(mesh.header);
          REQUIRE(SendMesh(mesh, *writer).ok());
          INFO(scale << " " << away << " " << bits << " " << doubles);
          CHECK(writer->rounding() <= most);
          const auto read = Decode(path);
          std::vector<double> told(3);
          if (read->GetMetadata() != nullptr) {
            read->GetMetadata()->GetEntryDoubleArray("origin", &told);
          }
          const draco::PointAttribute& at =
              *read->GetNamedAttribute(draco::GeometryAttribute::POSITION);
          double worst = 0;
          for (draco::PointIndex v(0); v < read->num_points(); ++v) {
            double xyz[3];
            at.ConvertValue<double>(at.mapped_index(v), 3, xyz);
            double nearest = 1e300;
            for (const Vec3d& p : mesh.positions) {
              nearest = std::min(
                  nearest, Length(p - Vec3d{told[0] + xyz[0], told[1] + xyz[1], told[2] + xyz[2]}));
            }
            worst = std::max(worst, nearest);
          }
          CHECK(worst <= writer->rounding() * (1 + 1e-9));
        }
      }
    }
  }
}

TEST_CASE("what the Draco writer does not refuse, Draco reads, however many attributes there are") {
  const ScratchFolder folder;
  constexpr size_t kMost = 128;  // besides positions; colours count as one
  for (const size_t count : {size_t{1}, kMost - 1, kMost, kMost + 1, size_t{200}, size_t{300}}) {
    TriangleMesh mesh = Sheet(4);
    mesh.rows.clear();
    for (size_t i = 1; i < count; ++i) {
      mesh.header.attributes.attributes.push_back({"a" + std::to_string(i), ScalarType::kUint8});
    }
    for (size_t i = 0; i < mesh.positions.size() * mesh.header.attributes.row_bytes(); ++i) {
      mesh.rows.push_back(static_cast<std::byte>(i));
    }
    const std::string path = folder.Path(std::to_string(count) + ".drc");
    const Status written = WriteMesh(mesh, path);
    INFO(count << " " << written.message());
    REQUIRE(written.ok() == (count <= kMost));
    if (written.ok()) {
      REQUIRE(Decode(path)->num_attributes() == static_cast<int>(count) + 1);
    } else {
      REQUIRE(written.message().find("Draco holds at most 128 attributes") != std::string::npos);
      REQUIRE(!std::filesystem::exists(path));
    }
  }
}

TEST_CASE("Draco takes non-manifold meshes, and normals that are not finite") {
  const ScratchFolder folder;
  TriangleMesh mesh = ColouredTetrahedron();
  mesh.triangles.push_back({0, 1, 3});
  mesh.triangles.push_back({1, 0, 2});
  mesh.triangles.push_back({2, 2, 3});
  for (size_t i = 0; i < 12; ++i) mesh.rows[i] = std::byte{0xff};  // nan nan nan
  REQUIRE(WriteMesh(mesh, folder.Path("n.drc")).ok());
  REQUIRE(Decode(folder.Path("n.drc"))->num_faces() == 6);
}

}  // namespace
}  // namespace mtdb
