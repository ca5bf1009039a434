// SPDX-License-Identifier: Apache-2.0
// What attributes mean in the formats that mesh files have, and what is said of those that mean
// nothing there.
#include <catch2/catch.hpp>
#include <cmath>
#include <random>
#include <set>

#include "codecs/mesh_file/mesh_file.h"
#include "store/base/vertex_meaning.h"
#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using testing::ColouredTetrahedron;
using testing::ReadBytes;
using testing::ReadOutcome;
using testing::ReadPath;
using testing::ScratchFolder;
using testing::Tetrahedron;
using testing::WriteMesh;

struct Written {
  ReadOutcome read;
  MeshWriteReport report;
};

Written WriteAndRead(const TriangleMesh& mesh, const std::string& name,
                     const MeshWriteOptions& options = {}) {
  const ScratchFolder folder;
  auto writer = CreateMeshFileWriter(folder.Path(name), options);
  REQUIRE(writer.ok());
  const Status status = SendMesh(mesh, **writer);
  INFO(status.message());
  REQUIRE(status.ok());
  Written written{ReadPath(folder.Path(name)), (*writer)->report()};
  INFO(written.read.status.message());
  REQUIRE(written.read.status.ok());
  return written;
}

void PutAs(ScalarType type, double value, ByteWriter* rows) {
  switch (type) {
    case ScalarType::kInt8: return rows->Put(static_cast<int8_t>(value));
    case ScalarType::kUint8: return rows->Put(static_cast<uint8_t>(value));
    case ScalarType::kInt16: return rows->Put(static_cast<int16_t>(value));
    case ScalarType::kUint16: return rows->Put(static_cast<uint16_t>(value));
    case ScalarType::kInt32: return rows->Put(static_cast<int32_t>(value));
    case ScalarType::kUint32: return rows->Put(static_cast<uint32_t>(value));
    case ScalarType::kFloat32: return rows->Put(static_cast<float>(value));
    case ScalarType::kFloat64: return rows->Put(value);
  }
}

// What means all of a colour's part.
double WholeOf(ScalarType type) {
  return type >= ScalarType::kFloat32 ? 1 : type == ScalarType::kUint16 ? 65535 : 255;
}

// A tetrahedron whose vertices have the bytes 0, 77, 154 and 231 (and 1, 2, 3 more) in these
// attributes.
TriangleMesh Coloured(std::initializer_list<const char*> names, ScalarType type) {
  TriangleMesh mesh = Tetrahedron();
  ByteWriter rows;
  for (const char* name : names) mesh.header.attributes.attributes.push_back({name, type});
  for (size_t v = 0; v < 4; ++v) {
    for (size_t c = 0; c < names.size(); ++c) {
      PutAs(type,
            static_cast<double>(77 * v + c) / 255 * WholeOf(type) +
                (type < ScalarType::kFloat32 ? 0.5 : 0),
            &rows);
    }
  }
  mesh.rows = rows.Take();
  return mesh;
}

TEST_CASE("Colours of all types and names that programs use reach all formats that have colours") {
  const std::initializer_list<const char*> all_names[] = {
      {"red", "green", "blue"},
      {"red", "green", "blue", "alpha"},
      {"diffuse_red", "diffuse_green", "diffuse_blue"},
      {"r", "g", "b"},
      {"R", "G", "B", "A"}};
  for (const auto& names : all_names) {
    for (const ScalarType type :
         {ScalarType::kUint8, ScalarType::kInt16, ScalarType::kUint16, ScalarType::kInt32,
          ScalarType::kUint32, ScalarType::kFloat32, ScalarType::kFloat64}) {
      const TriangleMesh mesh = Coloured(names, type);
      for (const char* file : {"a.obj", "a.off", "a.glb", "a.drc"}) {
        CAPTURE(*names.begin(), names.size(), static_cast<int>(type), file);
        const Written written = WriteAndRead(mesh, file);
        const ColourAttributes colours = FindColours(written.read.mesh.header.attributes);
        REQUIRE(colours.count >= 3);
        const size_t row = written.read.mesh.header.attributes.row_bytes();
        std::set<int> found;  // .drc may have another order of vertices
        for (size_t v = 0; v < 4; ++v) {
          const std::byte* const at = written.read.mesh.rows.data() + v * row;
          const int red = ColourByte(at + colours.offsets[0], colours.type);
          CHECK(ColourByte(at + colours.offsets[1], colours.type) == red + 1);
          CHECK(ColourByte(at + colours.offsets[2], colours.type) == red + 2);
          if (names.size() == 4 && colours.count == 4) {
            CHECK(ColourByte(at + colours.offsets[3], colours.type) == red + 3);
          }
          found.insert(red);
        }
        CHECK(found == std::set<int>{0, 77, 154, 231});
        const bool loses_alpha = names.size() == 4 && file == std::string("a.obj");
        CHECK(written.report.not_written.size() == (loses_alpha ? 1 : 0));
      }
    }
  }
}

TEST_CASE("All bytes of sRGB come back from the linear colours of a .glb") {
  TriangleMesh mesh;
  for (const char* name : {"red", "green", "blue", "alpha"}) {
    mesh.header.attributes.attributes.push_back({name, ScalarType::kUint8});
  }
  for (int i = 0; i < 256; ++i) {
    mesh.positions.push_back({static_cast<double>(i), static_cast<double>(i * i), 0});
    for (const int c : {i, 255 - i, i / 2, i}) mesh.rows.push_back(static_cast<std::byte>(c));
    if (i > 1) {
      const auto v = static_cast<VertexIndex>(i);
      mesh.triangles.push_back({v - 2, v - 1, v});
    }
  }
  CHECK(WriteAndRead(mesh, "a.glb").read.mesh.rows == mesh.rows);
  CHECK(LinearOfSrgb(0.5) == Approx(0.21404114));
  CHECK(SrgbOfLinear(LinearOfSrgb(0.02)) == Approx(0.02));
  CHECK(SrgbOfLinear(1) == Approx(1));
}

TEST_CASE("Colours of 16 bits and floats keep their digits in a .glb and an .obj") {
  const ScratchFolder folder;
  TriangleMesh mesh = Coloured({"red", "green", "blue"}, ScalarType::kUint16);
  REQUIRE(WriteMesh(mesh, folder.Path("a.glb")).ok());
  CHECK_THAT(ReadBytes(folder.Path("a.glb")),
             Catch::Contains(R"("componentType":5126,"count":4,"type":"VEC3"})"));
  mesh = Coloured({"red", "green", "blue"}, ScalarType::kFloat32);
  const float red = 0.123456f;
  std::memcpy(mesh.rows.data(), &red, sizeof(red));
  REQUIRE(WriteMesh(mesh, folder.Path("a.obj")).ok());
  CHECK_THAT(ReadBytes(folder.Path("a.obj")), Catch::StartsWith("v 0 0 0 0.123456 "));
}

TEST_CASE("Colours outside of what they mean are cut, and that is said") {
  TriangleMesh mesh = Coloured({"red", "green", "blue"}, ScalarType::kFloat32);
  const float bad[3] = {-1, NAN, 17};
  std::memcpy(mesh.rows.data(), bad, sizeof(bad));
  for (const char* file : {"a.obj", "a.off", "a.glb", "a.drc"}) {
    const Written written = WriteAndRead(mesh, file);
    CAPTURE(file);
    REQUIRE(!written.report.notes.empty());
    CHECK_THAT(written.report.notes.back(), Catch::Contains("3 components of colours"));
  }
}

TEST_CASE("Normals of float and double, under all names that programs use, are normals") {
  const std::initializer_list<const char*> all_names[] = {
      {"nx", "ny", "nz"}, {"normal_x", "normal_y", "normal_z"}, {"NX", "NY", "NZ"}};
  for (const auto& names : all_names) {
    for (const ScalarType type : {ScalarType::kFloat32, ScalarType::kFloat64}) {
      TriangleMesh mesh = Tetrahedron();
      ByteWriter rows;
      for (const char* name : names) mesh.header.attributes.attributes.push_back({name, type});
      for (int v = 0; v < 4; ++v) {
        for (const double c : {0.6, 0.0, -0.8}) PutAs(type, c, &rows);
      }
      mesh.rows = rows.Take();
      for (const char* file : {"a.off", "a.glb", "a.drc"}) {
        CAPTURE(*names.begin(), static_cast<int>(type), file);
        MeshWriteOptions options;
        options.off_normals = true;
        const Written written = WriteAndRead(mesh, file, options);
        CHECK(written.report.not_written.empty());
        const NormalAttributes found = FindNormals(written.read.mesh.header.attributes);
        REQUIRE(found.found);
        const Vec3d n = NormalIn(written.read.mesh.rows.data(), found);
        CHECK(Length(n - Vec3d{0.6, 0, -0.8}) < 0.01);
      }
      const ScratchFolder folder;
      REQUIRE(WriteMesh(mesh, folder.Path("a.obj")).ok());
      CHECK_THAT(ReadBytes(folder.Path("a.obj")), Catch::Contains("\nvn 0.6 0 -0.8\n"));
    }
  }
}

TEST_CASE("OFF has normals when they are asked for, and else says that it has not") {
  const TriangleMesh mesh = ColouredTetrahedron();
  const Written plain = WriteAndRead(mesh, "a.off");
  CHECK(plain.read.report.format == "COFF ASCII");
  CHECK(plain.report.not_written ==
        std::vector<std::string>{"nx, ny, nz (float32)", "quality (float64)"});
  MeshWriteOptions options;
  options.off_normals = true;
  const Written asked = WriteAndRead(mesh, "a.off", options);
  CHECK(asked.read.report.format == "CNOFF ASCII");
  CHECK(asked.report.not_written == std::vector<std::string>{"quality (float64)"});
  TriangleMesh bare = Tetrahedron();
  CHECK(WriteAndRead(bare, "a.off", options).read.report.format == "OFF ASCII");
}

TEST_CASE("What a format has no place for is said, by name and type") {
  const TriangleMesh mesh = ColouredTetrahedron();
  using List = std::vector<std::string>;
  CHECK(WriteAndRead(mesh, "a.ply").report.not_written.empty());
  CHECK(WriteAndRead(mesh, "a.drc").report.not_written.empty());
  CHECK(WriteAndRead(mesh, "a.glb").report.not_written.empty());
  CHECK(WriteAndRead(mesh, "a.obj").report.not_written ==
        List{"alpha (uint8)", "quality (float64)"});
  CHECK(WriteAndRead(mesh, "a.stl").report.not_written ==
        List{"nx, ny, nz (float32)", "red, green, blue, alpha (uint8)", "quality (float64)"});
  TriangleMesh many = Tetrahedron();
  for (int i = 0; i < 100; ++i) {
    many.header.attributes.attributes.push_back({"a" + std::to_string(i), ScalarType::kUint8});
  }
  many.rows.assign(400, std::byte{1});
  const List list = WriteAndRead(many, "a.stl").report.not_written;
  REQUIRE(list.size() == 2);
  CHECK(list[1] == "60 more");
  CHECK(WriteAndRead(many, "a.glb").report.not_written.size() == 1);
}

// Far from 0 for its size.
TriangleMesh FarMesh(uint32_t seed, double extent) {
  std::mt19937 random(seed);
  TriangleMesh mesh;
  mesh.header.double_positions = true;
  const auto place = [&](double scale) {
    return scale * (static_cast<double>(random()) / 4294967296.0 - 0.5);
  };
  const Vec3d middle{place(1e7), place(1e8), place(1e4)};
  for (int i = 0; i < 30; ++i) {
    mesh.positions.push_back(middle + Vec3d{place(extent), place(extent), place(extent)});
    mesh.header.bounds.Add(mesh.positions.back());
  }
  for (VertexIndex v = 2; v < 30; ++v) mesh.triangles.push_back({v - 2, v - 1, v});
  return mesh;
}

TEST_CASE("Only files whose positions are offsets tell an origin, and STL's comes back exactly") {
  for (uint32_t seed = 0; seed < 60; ++seed) {
    const double extent = std::pow(10.0, static_cast<double>(seed % 6) - 3);
    const TriangleMesh mesh = FarMesh(seed, extent);
    CAPTURE(seed, extent);
    for (const char* file : {"a.ply", "a.obj", "a.off"}) {
      const Written written = WriteAndRead(mesh, file);
      CHECK(!written.report.origin);
      CHECK(!written.report.node_origin);
      CHECK(written.read.mesh.positions == mesh.positions);
    }
    const Written glb = WriteAndRead(mesh, "a.glb");
    CHECK(!glb.report.origin);
    CHECK(glb.report.node_origin);
    CHECK(WriteAndRead(mesh, "a.drc").report.origin);
    const ScratchFolder folder;
    auto writer = CreateMeshFileWriter(folder.Path("a.stl")).value();
    REQUIRE(SendMesh(mesh, *writer).ok());
    REQUIRE(writer->report().origin);
    const ReadOutcome stl = ReadPath(folder.Path("a.stl"));
    REQUIRE(stl.status.ok());
    // The same sums of a double and a float32, bit for bit.
    const Vec3d o = *writer->report().origin;
    const Vec3d p = mesh.positions[0];
    Vec3d expected;
    for (int i = 0; i < 3; ++i) {
      expected[i] = o[i] + static_cast<double>(static_cast<float>(p[i] - o[i]));
    }
    REQUIRE(!stl.mesh.positions.empty());
    CHECK(stl.mesh.positions[0] == expected);
    CHECK(Length(expected - p) <= writer->rounding());
  }
}

TEST_CASE("PLY has float32 where the grid's points stay apart, and double elsewhere or if asked") {
  TriangleMesh mesh = Tetrahedron();
  mesh.header.double_positions = true;
  mesh.header.position_step = 0.001;
  mesh.positions[3] = {2.001, 0.1, 1000.123};
  for (const Vec3d& p : mesh.positions) mesh.header.bounds.Add(p);
  Written written = WriteAndRead(mesh, "a.ply");
  CHECK(written.report.positions == "float32");
  CHECK_FALSE(written.read.mesh.header.double_positions);
  for (size_t v = 0; v < 4; ++v) {
    for (int i = 0; i < 3; ++i) {
      CHECK(written.read.mesh.positions[v][i] == double{static_cast<float>(mesh.positions[v][i])});
      CHECK(std::abs(written.read.mesh.positions[v][i] - mesh.positions[v][i]) <= 0.001 / 8);
    }
  }
  MeshWriteOptions options;
  options.double_positions = true;
  written = WriteAndRead(mesh, "a.ply", options);
  CHECK(written.report.positions == "float64");
  CHECK(written.read.mesh.positions == mesh.positions);
  CHECK_FALSE(CreateMeshFileWriter("a.stl", options).ok());
  mesh.header.position_step = 1000.123 / 0x1p21 * 0.99;
  CHECK(WriteAndRead(mesh, "a.ply").report.positions == "float64");
  mesh.header.position_step = 1000.123 / 0x1p21 * 1.01;
  CHECK(WriteAndRead(mesh, "a.ply").report.positions == "float32");
  mesh.header.position_step = 0;
  CHECK(WriteAndRead(mesh, "a.ply").report.positions == "float64");
}

TEST_CASE("What PLY rounds to float32 is within what its writer promised") {
  TriangleMesh mesh = Tetrahedron();
  mesh.header.double_positions = true;
  mesh.header.position_step = 0.01;
  std::mt19937 random(5);
  for (Vec3d& p : mesh.positions) {
    for (int i = 0; i < 3; ++i) p[i] = 0.01 * static_cast<double>(random() % 2000000);
    mesh.header.bounds.Add(p);
  }
  const ScratchFolder folder;
  auto writer = CreateMeshFileWriter(folder.Path("a.ply")).value();
  const double most = writer->LargestRounding(mesh.header);
  REQUIRE(SendMesh(mesh, *writer).ok());
  CHECK(writer->rounding() > 0);
  CHECK(writer->rounding() <= most);
  CHECK(most <= 0.01 / 8 * std::sqrt(3.0) * 1.001);
}

TEST_CASE("Writers refuse names that no attribute may have; PLY has none with spaces") {
  for (const char* name : {"x", "a\nproperty float b", "", "\xff"}) {
    TriangleMesh mesh = Tetrahedron();
    mesh.header.attributes.attributes = {{name, ScalarType::kUint8}};
    mesh.rows.assign(4, std::byte{1});
    for (const char* file : {"a.ply", "a.obj", "a.off", "a.stl", "a.glb", "a.drc"}) {
      const ScratchFolder folder;
      const Status status = WriteMesh(mesh, folder.Path(file));
      CAPTURE(name, file, status.message());
      CHECK(status.code() == StatusCode::kInvalidArgument);
      CHECK(status.message().find('\n') == std::string::npos);
      CHECK(folder.file_count() == 0);
    }
  }
  TriangleMesh mesh = Tetrahedron();
  mesh.header.attributes.attributes = {{"a b", ScalarType::kUint8}, {"a_b", ScalarType::kUint8}};
  mesh.rows.assign(8, std::byte{1});
  const Written written = WriteAndRead(mesh, "a.ply");
  const auto& list = written.read.mesh.header.attributes.attributes;
  REQUIRE(list.size() == 2);
  CHECK(list[0].name == "a_b_2");
  CHECK(list[1].name == "a_b");
  CHECK(written.report.notes ==
        std::vector<std::string>{"attribute 'a b' is named 'a_b_2' in the file"});
}

TEST_CASE("A .glb whose z is up turns it to y at its node, exactly, and into metres if asked") {
  TriangleMesh mesh = FarMesh(3, 1000);
  MeshWriteOptions options;
  options.up_frame = MeshWriteOptions::UpFrame{};
  Written written = WriteAndRead(mesh, "a.glb", options);
  CHECK(!written.report.node_origin);
  CHECK_THAT(written.report.notes.at(0), Catch::Contains("z is up"));
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    const Vec3d p = written.read.mesh.positions[v];
    CHECK(Length(Vec3d{p.x, -p.z, p.y} - mesh.positions[v]) < 1e-3);
  }
  CHECK(written.read.mesh.triangles == mesh.triangles);
  const Vec3d middle = mesh.positions[0];
  options.up_frame->metres = {2, 3, 0.5};
  options.up_frame->metres_from = {middle.x, middle.y, 0};
  written = WriteAndRead(mesh, "a.glb", options);
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    const Vec3d p = written.read.mesh.positions[v];
    const Vec3d d = mesh.positions[v] - options.up_frame->metres_from;
    CHECK(Length(p - Vec3d{2 * d.x, 0.5 * d.z, -3 * d.y}) < 1e-3);
  }
}

}  // namespace
}  // namespace mtdb
