// SPDX-License-Identifier: Apache-2.0
// Textured meshes through the writers and back.
#include <algorithm>
#include <catch2/catch.hpp>

#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using testing::ReadBytes;
using testing::ReadOutcome;
using testing::ReadPath;
using testing::ScratchFolder;

constexpr uint32_t kNoPage = TextureCorner::kNoPage;

// The head of a PNG of that size, which is all that anybody reads of it.
std::string PngOf(uint32_t width, uint32_t height, const std::string& rest = "") {
  std::string png("\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 16);
  for (const uint32_t n : {width, height}) {
    for (int shift = 24; shift >= 0; shift -= 8) png += static_cast<char>(n >> shift);
  }
  return png + rest;
}

Texture Page(const std::string& name, const std::string& file) {
  Texture page{name, "image/png", 0, 0, {}};
  page.load = [file]() -> Result<Bytes> {
    const auto* const begin = reinterpret_cast<const std::byte*>(file.data());
    return Bytes(begin, begin + file.size());
  };
  return page;
}

// A tetrahedron: two triangles on page 0, one on page 1, one on none; with seams.
TriangleMesh Textured() {
  TriangleMesh mesh = testing::Tetrahedron();
  mesh.header.textured = true;
  mesh.header.textures = {Page("a b.png", PngOf(64, 32)), Page("c.png", PngOf(7, 9, "more"))};
  mesh.corners = {{0, 0, 0},         {0.5f, 1, 0},    {0.25f, 0.75f, 0}, {0, 0, 0},
                  {0.5f, 0.5f, 0},   {1, 0.125f, 0},  {2, -1.5f, 1},     {0.5f, 1, 1},
                  {0.25f, 0.75f, 1}, {0, 0, kNoPage}, {0, 0, kNoPage},   {0, 0, kNoPage}};
  return mesh;
}

struct WriteOutcome {
  Status status = Status::Ok();
  MeshWriteReport report;
};

WriteOutcome Write(const TriangleMesh& mesh, const std::string& path,
                   const MeshWriteOptions& options = {}) {
  WriteOutcome outcome;
  Result<std::unique_ptr<MeshFileWriter>> writer = CreateMeshFileWriter(path, options);
  REQUIRE(writer.ok());
  outcome.status = SendMesh(mesh, **writer);
  if (outcome.status.ok()) outcome.report = (*writer)->report();
  return outcome;
}

ReadOutcome ReadBack(const std::string& path) {
  ReadOutcome outcome = ReadPath(path);
  INFO(outcome.status.message());
  REQUIRE(outcome.status.ok());
  return outcome;
}

std::string LoadText(const Texture& texture) {
  REQUIRE(texture.load != nullptr);
  const Result<Bytes> bytes = texture.load();
  INFO(bytes.status().message());
  REQUIRE(bytes.ok());
  return std::string(AsString(*bytes));
}

// One line per triangle, sorted: the places of its corners, their coordinates and the page's image.
std::vector<std::string> Shown(const TriangleMesh& mesh) {
  std::vector<std::string> lines;
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    std::ostringstream line;
    for (size_t c = 0; c < 3; ++c) {
      const Vec3d p = mesh.positions[mesh.triangles[t][c]];
      const TextureCorner& corner = mesh.corners[3 * t + c];
      line << p.x << ' ' << p.y << ' ' << p.z << ": " << corner.u << ' ' << corner.v << "; ";
    }
    const uint32_t page = mesh.corners[3 * t].page;
    lines.push_back(line.str() + (page == kNoPage ? "none" : mesh.header.textures[page].name));
  }
  std::ranges::sort(lines);
  return lines;
}

TEST_CASE("PLY and OBJ keep a textured mesh's corners, its pages and their images") {
  for (const char* name : {"m.ply", "m.obj"}) {
    INFO(name);
    const ScratchFolder folder;
    const TriangleMesh mesh = Textured();
    REQUIRE(Write(mesh, folder.Path(name)).status.ok());
    CHECK(ReadBytes(folder.Path("a b.png")) == PngOf(64, 32));
    CHECK(ReadBytes(folder.Path("c.png")) == PngOf(7, 9, "more"));
    const ReadOutcome read = ReadBack(folder.Path(name));
    CHECK(read.mesh.positions.size() == mesh.positions.size());
    CHECK(read.mesh.triangles == mesh.triangles);
    REQUIRE(read.mesh.header.textured);
    CHECK(read.mesh.corners == mesh.corners);
    CHECK(read.mesh.header.attributes.empty());
    REQUIRE(read.mesh.header.textures.size() == 2);
    for (size_t page = 0; page < 2; ++page) {
      CHECK(read.mesh.header.textures[page].name == mesh.header.textures[page].name);
      CHECK(read.mesh.header.textures[page].media_type == "image/png");
      CHECK(LoadText(read.mesh.header.textures[page]) == LoadText(mesh.header.textures[page]));
    }
    CHECK(read.mesh.header.textures[0].width == 64);
    CHECK(read.mesh.header.textures[1].height == 9);
  }
}

TEST_CASE("A .glb has a primitive for each page, and vertices that are split at seams") {
  const ScratchFolder folder;
  const TriangleMesh mesh = Textured();
  REQUIRE(Write(mesh, folder.Path("m.glb")).status.ok());
  CHECK(folder.file_count() == 1);
  ReadOutcome read = ReadBack(folder.Path("m.glb"));
  REQUIRE(read.mesh.header.textured);
  REQUIRE(read.mesh.header.textures.size() == 2);
  CHECK(Shown(read.mesh) == Shown(mesh));
  // On page 0, vertex 1 has two places; the other page, and none, have three vertices each.
  CHECK(read.mesh.positions.size() == 5 + 3 + 3);
  CHECK(read.mesh.header.textures[0].width == 64);
  // The images outlive the file that was read, and are what was written.
  std::filesystem::remove(folder.Path("m.glb"));
  CHECK(LoadText(read.mesh.header.textures[0]) == PngOf(64, 32));
  CHECK(LoadText(read.mesh.header.textures[1]) == PngOf(7, 9, "more"));
}

TEST_CASE("Normals and scalars stay beside texture coordinates, and colours do not tint images") {
  const ScratchFolder folder;
  TriangleMesh mesh = testing::ColouredTetrahedron();
  const TriangleMesh textured = Textured();
  mesh.header.textured = true;
  mesh.header.textures = textured.header.textures;
  mesh.corners = textured.corners;
  for (const char* name : {"m.ply", "m.obj", "m.glb"}) {
    INFO(name);
    const WriteOutcome written = Write(mesh, folder.Path(name));
    REQUIRE(written.status.ok());
    const ReadOutcome read = ReadBack(folder.Path(name));
    CHECK(Shown(read.mesh) == Shown(mesh));
    if (std::string(name) == "m.ply") CHECK(read.mesh.rows == mesh.rows);
    if (std::string(name) == "m.obj") CHECK(read.mesh.rows.size() == 12);
    if (std::string(name) != "m.glb") continue;
    CHECK(read.mesh.header.attributes.attributes[0].name == "nx");
    CHECK(written.report.not_written ==
          std::vector<std::string>{"red, green, blue, alpha (uint8)"});
  }
}

TEST_CASE("Coordinates without any image survive as one page that nobody has the bytes of") {
  for (const char* name : {"m.ply", "m.obj", "m.glb"}) {
    INFO(name);
    const ScratchFolder folder;
    TriangleMesh mesh = Textured();
    mesh.header.textures = {{"texture", "", 0, 0, {}}};
    for (size_t i = 0; i < 9; ++i) mesh.corners[i].page = 0;
    mesh.triangles.pop_back();
    mesh.corners.resize(9);
    REQUIRE(Write(mesh, folder.Path(name)).status.ok());
    CHECK(folder.file_count() == 1);
    const ReadOutcome read = ReadBack(folder.Path(name));
    CHECK(Shown(read.mesh) == Shown(mesh));
    REQUIRE(read.mesh.header.textures.size() == 1);
    CHECK(read.mesh.header.textures[0].load == nullptr);
  }
}

TEST_CASE("Images get names of their own, inside of the mesh's folder") {
  const ScratchFolder folder;
  TriangleMesh mesh = Textured();
  mesh.header.textures[0].name = "../../x/a.png";
  mesh.header.textures[1].name = "/tmp/A.png";
  for (const char* name : {"m.ply", "m.obj"}) {
    REQUIRE(Write(mesh, folder.Path(name)).status.ok());
    CHECK(ReadBytes(folder.Path("a.png")) == PngOf(64, 32));
    CHECK(ReadBytes(folder.Path("A_2.png")) == PngOf(7, 9, "more"));
    CHECK(ReadBack(folder.Path(name)).mesh.corners == mesh.corners);
  }
  mesh.header.textures[0].name = "m.obj";
  mesh.header.textures[1].name = "m.mtl";
  REQUIRE(Write(mesh, folder.Path("m.obj")).status.ok());
  const ReadOutcome read = ReadBack(folder.Path("m.obj"));
  CHECK(read.mesh.header.textures[0].name == "m_2.obj");
  CHECK(read.mesh.header.textures[1].name == "m_2.mtl");
}

TEST_CASE("An image that fails is the writer's error, and leaves nothing behind") {
  for (const char* name : {"m.ply", "m.obj", "m.glb"}) {
    const ScratchFolder folder;
    TriangleMesh mesh = Textured();
    mesh.header.textures[1].load = []() -> Result<Bytes> { return IoError("page 1 is gone"); };
    const Status status = Write(mesh, folder.Path(name)).status;
    CHECK(status.code() == StatusCode::kIoError);
    CHECK_THAT(status.message(), Catch::Contains("page 1 is gone"));
    CHECK(folder.file_count() == 0);
  }
}

TEST_CASE("Images of pages that no triangle uses are not written") {
  for (const char* name : {"m.ply", "m.obj", "m.glb"}) {
    INFO(name);
    const ScratchFolder folder;
    TriangleMesh mesh = Textured();
    mesh.triangles.resize(2);
    mesh.corners.resize(6);
    mesh.header.textures[1].load = []() -> Result<Bytes> { return IoError("not asked"); };
    REQUIRE(Write(mesh, folder.Path(name)).status.ok());
    CHECK_FALSE(std::filesystem::exists(folder.Path("c.png")));
    CHECK(Shown(ReadBack(folder.Path(name)).mesh) == Shown(mesh));
  }
}

TEST_CASE("Formats without textures say so, and corners must follow their triangles") {
  const ScratchFolder folder;
  TriangleMesh mesh = Textured();
  for (const char* name : {"m.stl", "m.off", "m.drc"}) {
    INFO(name);
    const WriteOutcome written = Write(mesh, folder.Path(name));
    REQUIRE(written.status.ok());
    CHECK(written.report.not_written == std::vector<std::string>{"texture coordinates"});
  }
  TriangleMesh on_two = mesh;
  on_two.corners[1].page = 1;
  TriangleMesh beyond = mesh;
  for (size_t i = 0; i < 3; ++i) beyond.corners[i].page = 2;
  for (const char* name : {"m.ply", "m.obj", "m.glb"}) {
    INFO(name);
    CHECK(Write(on_two, folder.Path(name)).status.code() == StatusCode::kInvalidArgument);
    CHECK(Write(beyond, folder.Path(name)).status.code() == StatusCode::kInvalidArgument);
    auto writer = *CreateMeshFileWriter(folder.Path(name), {});
    MeshHeader header = mesh.header;
    header.vertex_count = mesh.positions.size();
    header.triangle_count = mesh.triangles.size();
    REQUIRE(writer->Begin(header).ok());
    REQUIRE(writer->AddVertices(mesh.positions, {}).ok());
    REQUIRE(writer->AddTriangles(mesh.triangles).ok());
    CHECK(writer->AddCorners(std::span(mesh.corners).first(6)).code() ==
          StatusCode::kInvalidArgument);
    CHECK(writer->End().code() == StatusCode::kInvalidArgument);
  }
}

TEST_CASE("Into a descriptor, files of meshes come without their images") {
  for (const char* name : {"m.ply", "m.obj"}) {
    INFO(name);
    const ScratchFolder folder;
    const TriangleMesh mesh = Textured();
    std::FILE* const file = std::fopen(folder.Path("out").c_str(), "w+");
    REQUIRE(file != nullptr);
    MeshWriteOptions options;
    options.descriptor = ::fileno(file);
    const WriteOutcome written = Write(mesh, folder.Path(name), options);
    std::fclose(file);
    REQUIRE(written.status.ok());
    REQUIRE(written.report.not_written.size() == 1);
    CHECK_THAT(written.report.not_written[0], Catch::StartsWith("2 images"));
    CHECK(folder.file_count() == 1);
    std::filesystem::rename(folder.Path("out"), folder.Path(name));
    const ReadOutcome read = ReadBack(folder.Path(name));
    REQUIRE(read.mesh.corners.size() == mesh.corners.size());
    CHECK(read.mesh.corners[7].u == 0.5f);
  }
}

TEST_CASE("Many triangles share lines of coordinates, and come back as they were") {
  const ScratchFolder folder;
  TriangleMesh mesh;
  constexpr uint32_t kSide = 300;
  for (uint32_t y = 0; y <= kSide; ++y) {
    for (uint32_t x = 0; x <= kSide; ++x) {
      mesh.positions.push_back({static_cast<double>(x), static_cast<double>(y), 0});
    }
  }
  mesh.header.textured = true;
  mesh.header.textures = {Page("a.png", PngOf(64, 32))};
  for (uint32_t y = 0; y < kSide; ++y) {
    for (uint32_t x = 0; x < kSide; ++x) {
      const uint64_t v = y * (kSide + 1) + x;
      for (const TriangleVertices& t : {TriangleVertices{v, v + 1, v + kSide + 2},
                                        TriangleVertices{v, v + kSide + 2, v + kSide + 1}}) {
        mesh.triangles.push_back(t);
        for (const VertexIndex corner : t) {
          const Vec3d p = mesh.positions[corner];
          mesh.corners.push_back({static_cast<float>(p.x) / 512, static_cast<float>(p.y) / 512, 0});
        }
      }
    }
  }
  for (const char* name : {"m.ply", "m.obj", "m.glb"}) {
    INFO(name);
    REQUIRE(Write(mesh, folder.Path(name)).status.ok());
    const ReadOutcome read = ReadBack(folder.Path(name));
    CHECK(read.mesh.positions.size() == mesh.positions.size());
    // In parentheses, so that nobody prints all of it.
    CHECK((read.mesh.corners == mesh.corners));
    if (std::string(name) != "m.glb") CHECK((read.mesh.triangles == mesh.triangles));
  }
  const std::string text = ReadBytes(folder.Path("m.obj"));
  size_t lines = 0;
  for (size_t at = text.find("\nvt "); at != text.npos; at = text.find("\nvt ", at + 1)) ++lines;
  CHECK(lines < mesh.positions.size() * 3 / 2);
}

}  // namespace
}  // namespace mtdb
