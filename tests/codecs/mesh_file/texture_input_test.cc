// SPDX-License-Identifier: Apache-2.0
// Texture coordinates as other programs write them, and as hostile files have them.
#include <algorithm>
#include <catch2/catch.hpp>

#include "codecs/mesh_file/textures/corner_table.h"
#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using testing::AppendValue;
using testing::ReadBytes;
using testing::ReadOutcome;
using testing::ReadPath;
using testing::ScratchFolder;

constexpr uint32_t kNoPage = TextureCorner::kNoPage;

std::string Png(uint8_t side) {
  std::string png("\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0", 19);
  png += static_cast<char>(side);
  png += std::string("\0\0\0", 3);
  return png + static_cast<char>(side);
}

ReadOutcome ReadBack(const std::string& path) {
  ReadOutcome outcome = ReadPath(path);
  INFO(outcome.status.message());
  REQUIRE(outcome.status.ok());
  return outcome;
}
ReadOutcome ReadGoodText(const std::string& name, const std::string& text) {
  const ScratchFolder folder;
  return ReadBack(folder.Write(name, text));
}

bool Mentions(const ReadOutcome& outcome, const std::string& what) {
  return std::ranges::any_of(outcome.report.ignored, [&](const std::string& line) {
    return line.find(what) != std::string::npos;
  });
}

const std::string kSquare = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
const std::string kPlaces = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";
const std::string kFace = "f 1/1 2/2 3/3\n";

TEST_CASE("OBJ: corners of polygons keep their coordinates, counted from either end") {
  // A polygon that is no fan of its first corner: the ear cutter finds its triangles.
  const std::string text =
      "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\n"
      "vt 0 0\nvt 0.4 0 0.7\nvt 0.4 0.4\nvt 0.2 0.1\nvt 0\n"
      "f 1/1/1 2/2 3/3 4/-2\nf -5/-5 -4/-4 -2/4 -1/-1\nf 1//1 2//1 3//1\n";
  const ReadOutcome read = ReadGoodText("a.obj", text);
  REQUIRE(read.mesh.header.textured);
  REQUIRE(read.mesh.corners.size() == 3 * read.mesh.triangles.size());
  REQUIRE(read.mesh.triangles.size() == 5);
  const std::vector<TextureCorner> of_vertex{
      {0, 0, 0}, {0.4f, 0, 0}, {0.4f, 0.4f, 0}, {0.2f, 0.1f, 0}, {0, 0, 0}};
  for (size_t t = 0; t < 4; ++t) {
    for (size_t c = 0; c < 3; ++c) {
      CHECK(read.mesh.corners[3 * t + c] == of_vertex[read.mesh.triangles[t][c]]);
    }
  }
  CHECK(read.mesh.corners[12] == TextureCorner{0, 0, kNoPage});
  REQUIRE(read.mesh.header.textures.size() == 1);
  CHECK(read.mesh.header.textures[0].name == "texture");
  CHECK(read.mesh.header.textures[0].load == nullptr);
  CHECK_FALSE(Mentions(read, "texture coordinates"));
}

TEST_CASE("OBJ: a face of more corners than are cut keeps its coordinates too") {
  std::string text, face = "f";
  constexpr int kCorners = (1 << 18) + 5;
  for (int i = 0; i < kCorners; ++i) {
    text += "v " + std::to_string(i % 512) + " " + std::to_string(i / 512) + " 0\n";
    text += "vt " + std::to_string(i % 512) + " " + std::to_string(i / 512) + "\n";
    face += " " + std::to_string(i + 1) + "/" + std::to_string(i + 1);
  }
  const ReadOutcome read =
      ReadGoodText("a.obj", text + "f 1/2 2/3 3/4 5/5\n" + face + "\nf 1/1 2/2 3/3\n");
  REQUIRE(read.mesh.triangles.size() == kCorners - 2 + 3);
  REQUIRE(read.mesh.corners.size() == 3 * read.mesh.triangles.size());
  bool same = true;
  for (size_t i = 6; i < read.mesh.corners.size(); ++i) {
    const Vec3d p = read.mesh.positions[read.mesh.triangles[i / 3][i % 3]];
    same &=
        read.mesh.corners[i] == TextureCorner{static_cast<float>(p.x), static_cast<float>(p.y), 0};
  }
  CHECK(same);
}

TEST_CASE("OBJ: materials that share an image share its page") {
  const ScratchFolder folder;
  folder.Write("a.png", Png(8));
  folder.Write("Böse Namen.png", Png(9));
  folder.Write(
      "one two.mtl",
      "# materials\nnewmtl red\nmap_Kd -s 1 1 1 -o 0.5 -clamp on -bm 0.5 a.png\nKd 1 0 0\r\n"
      "newmtl also red\r\nmap_kd .\\a.png\r\nmap_Kd -blendu off -mm 0 1 ./a.png\n"
      "newmtl plain\nKd 0 1 0\nnewmtl unused\nmap_Kd unused.png\n");
  folder.Write("b.mtl", "newmtl blue\nmap_Kd Böse Namen.png\nnewmtl red\nmap_Kd none.png\n");
  const std::string path =
      folder.Write("m.obj", kSquare + kPlaces + "mtllib one two.mtl\nmtllib b.mtl\n" + kFace +
                                "usemtl red\n" + kFace + "usemtl blue\n" + kFace +
                                "usemtl also red\n" + kFace + "usemtl plain\n" + kFace +
                                "usemtl nobody\n" + kFace + "usemtl red\nf 1/1 2/2 3\n");
  const ReadOutcome read = ReadBack(path);
  REQUIRE(read.mesh.header.textures.size() == 2);
  CHECK(read.mesh.header.textures[0].name == "a.png");
  CHECK(read.mesh.header.textures[0].width == 8);
  CHECK(read.mesh.header.textures[1].name == "Böse Namen.png");
  CHECK(read.mesh.header.textures[1].height == 9);
  std::vector<uint32_t> pages;
  for (size_t i = 1; i < read.mesh.corners.size(); i += 3)
    pages.push_back(read.mesh.corners[i].page);
  CHECK(pages == std::vector<uint32_t>{kNoPage, 0, 1, 0, kNoPage, kNoPage, kNoPage});
  CHECK(read.mesh.corners[1] == TextureCorner{1, 0, kNoPage});  // no image, but coordinates
  CHECK(read.mesh.corners[19] == TextureCorner{0, 0, kNoPage});
  CHECK(Mentions(read, "3 materials without an image"));
  CHECK(Mentions(read, "moves and scales"));
}

TEST_CASE("OBJ: missing material files and images are told, and refuse nothing") {
  const ScratchFolder folder;
  folder.Write("a.mtl", "newmtl m\nmap_Kd textures\\gone.jpg\n");
  const ReadOutcome image =
      ReadBack(folder.Write("m.obj", kSquare + kPlaces + "mtllib a.mtl\nusemtl m\n" + kFace));
  REQUIRE(image.mesh.header.textures.size() == 1);
  CHECK(image.mesh.corners[0].page == 0);
  CHECK(image.mesh.header.textures[0].name == "gone.jpg");
  CHECK(image.mesh.header.textures[0].width == 0);
  const Result<Bytes> bytes = image.mesh.header.textures[0].load();
  CHECK(bytes.status().code() == StatusCode::kNotFound);
  CHECK_THAT(bytes.status().message(), Catch::Contains(folder.Path("textures/gone.jpg")));
  CHECK(Mentions(image, "textures/gone.jpg: no such file"));
  const ReadOutcome library =
      ReadBack(folder.Write("n.obj", kSquare + kPlaces + "mtllib none.mtl\nusemtl m\n" + kFace));
  CHECK(Mentions(library, "none.mtl: no such file"));
  REQUIRE(library.mesh.header.textures.size() == 1);
  CHECK(library.mesh.corners[2] == TextureCorner{1, 1, 0});
}

TEST_CASE("OBJ: names that lead out of the folder are looked for inside of it") {
  const ScratchFolder folder;
  folder.Write("secret.png", Png(3));
  std::filesystem::create_directory(folder.Path("in"));
  folder.Write("in/a.png", Png(4));
  for (const char* name : {"../secret.png", "C:\\work\\secret.png", "/etc/passwd"}) {
    INFO(name);
    folder.Write("in/a.mtl", std::string("newmtl m\nmap_Kd ") + name + "\n");
    const ReadOutcome read =
        ReadBack(folder.Write("in/m.obj", kSquare + kPlaces + "mtllib a.mtl\nusemtl m\n" + kFace));
    REQUIRE(read.mesh.header.textures.size() == 1);
    CHECK_FALSE(read.mesh.header.textures[0].load().ok());
  }
  folder.Write("in/a.mtl", "newmtl m\nmap_Kd D:\\projects\\a.png\n");
  const ReadOutcome read = ReadBack(
      folder.Write("in/m.obj", kSquare + kPlaces + "mtllib ../in/a.mtl\nusemtl m\n" + kFace));
  CHECK(read.mesh.header.textures[0].width == 4);
}

TEST_CASE("OBJ: wrong coordinates are those of their triangle alone, and are counted") {
  for (const char* face : {"f 1/9 2/2 3/3\n", "f 1/0 2/2 3/3\n", "f 1/-9 2/2 3/3\n",
                           "f 1/5 2/2 3/3\n", "f 1/6 2/2 3/3\n", "f 1/7 2/2 3/3\n",
                           "f 1/99999999999999999999 2/2 3/3\n", "f 1/2-3 2/2 3/3\n"}) {
    INFO(face);
    const ReadOutcome read =
        ReadGoodText("m.obj", kSquare + kPlaces + "vt nan 0\nvt 1e30 0\nvt x\n" + kFace + face);
    REQUIRE(read.mesh.corners.size() == 6);
    CHECK(read.mesh.corners[2] == TextureCorner{1, 1, 0});
    CHECK(read.mesh.corners[3] == TextureCorner{0, 0, kNoPage});
    CHECK(read.mesh.corners[4] == TextureCorner{0, 0, kNoPage});
    CHECK(Mentions(read, "wrong texture coordinates of 1 triangle"));
  }
  // References without any "vt", as some programs write them.
  const ReadOutcome none = ReadGoodText("m.obj", kSquare + kFace);
  CHECK_FALSE(none.mesh.header.textured);
  CHECK(none.mesh.corners.empty());
}

TEST_CASE("OBJ: material files of garbage do no harm") {
  const ScratchFolder folder;
  std::string garbage;
  uint32_t state = 7;
  for (int i = 0; i < 20000; ++i) {
    state = state * 1664525 + 1013904223;
    garbage += static_cast<char>(state >> 24);
  }
  for (const std::string& text :
       {std::string("map_Kd a.png\n"), std::string("newmtl\nmap_Kd\nmap_Kd -s\nmap_Kd -s 1 1\n"),
        std::string("newmtl m\nmap_Kd -o 1 2 3 4 5\nmap_Kd -clamp\nmap_Kd -mm 1\n"),
        std::string("newmtl m\nmap_Kd .\n"), std::string("newmtl m\nmap_Kd ..\n"),
        std::string("newmtl m\nmap_Kd a\0b.png\n", 24), "newmtl m\nmap_Kd " + garbage, garbage}) {
    folder.Write("a.mtl", text);
    const ReadOutcome read = ReadBack(folder.Write("m.obj", kSquare + kPlaces +
                                                                "mtllib a.mtl\nmtllib .\nmtllib\n"
                                                                "usemtl m\n" +
                                                                kFace));
    REQUIRE(read.mesh.header.textures.size() == 1);
    const Texture& page = read.mesh.header.textures[0];
    CHECK_FALSE(page.name.empty());
    CHECK(page.name.find_first_of(std::string("/\\\n\0", 4)) == std::string::npos);
    if (page.load != nullptr) CHECK_FALSE(page.load().ok());
  }
}

const std::string kPlyVertices =
    "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n";

TEST_CASE("PLY: faces have coordinates and the number of their image") {
  const ScratchFolder folder;
  folder.Write("a b.png", Png(5));
  const std::string path = folder.Write(
      "a.ply",
      "ply\nformat ascii 1.0\ncomment TextureFile a b.png\ncomment TextureFile gone.jpg\n" +
          kPlyVertices +
          "element face 6\nproperty list uchar float texcoord\nproperty uchar flags\n"
          "property list uchar int vertex_indices\nproperty int texnumber\nend_header\n"
          "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
          "6 0 0 0.5 0 1 1 7 3 0 1 2 1\n"
          "8 0 0 0.25 0 0.5 0.5 0 1 7 4 0 1 2 3 0\n"
          "0 7 3 0 1 2 0\n"
          "6 0 0 0.5 0 1 1 7 3 0 1 2 -1\n"
          "6 0 0 0.5 0 1 1 7 3 0 1 2 2\n"
          "4 0 0 0.5 0 7 3 0 1 2 0\n");
  const ReadOutcome read = ReadBack(path);
  REQUIRE(read.mesh.header.textures.size() == 2);
  CHECK(read.mesh.header.textures[0].width == 5);
  CHECK(read.mesh.header.textures[1].load().status().code() == StatusCode::kNotFound);
  REQUIRE(read.mesh.triangles.size() == 7);
  const std::vector<TextureCorner> expected{
      {0, 0, 1},       {0.5f, 0, 1},    {1, 1, 1},       {0, 0, 0},          {0.25f, 0, 0},
      {0.5f, 0.5f, 0}, {0, 0, 0},       {0.5f, 0.5f, 0}, {0, 1, 0},          {0, 0, kNoPage},
      {0, 0, kNoPage}, {0, 0, kNoPage}, {0, 0, kNoPage}, {0.5f, 0, kNoPage}, {1, 1, kNoPage},
      {0, 0, kNoPage}, {0, 0, kNoPage}, {0, 0, kNoPage}, {0, 0, kNoPage},    {0, 0, kNoPage},
      {0, 0, kNoPage}};
  CHECK(read.mesh.corners == expected);
  CHECK(Mentions(read, "face property flags"));
  CHECK_FALSE(Mentions(read, "texcoord"));
  CHECK_FALSE(Mentions(read, "texnumber"));
  CHECK(Mentions(read, "wrong texture coordinates of 2 triangles"));
}

TEST_CASE("PLY: coordinates of vertices become those of corners, and are no attributes") {
  for (const char* names : {"texture_u texture_v", "s t", "u v"}) {
    for (const bool faces_first : {false, true}) {
      for (const bool polygons : {false, true}) {
        INFO(names << faces_first << polygons);
        const std::string u(names, std::string(names).find(' '));
        const std::string v(std::string(names).substr(u.size() + 1));
        std::string vertices, faces;
        for (int i = 0; i < 4; ++i) {
          for (const float n : {static_cast<float>(i % 2), static_cast<float>(i / 2), 0.f}) {
            AppendValue(&vertices, n, true);
          }
          AppendValue(&vertices, static_cast<float>(i) / 4, true);
          AppendValue(&vertices, uint8_t{200});
          AppendValue(&vertices, 0.5f, true);
        }
        for (const std::vector<int>& face :
             {std::vector<int>{0, 1, 3},
              polygons ? std::vector<int>{0, 1, 3, 2} : std::vector<int>{0, 3, 2}}) {
          AppendValue(&faces, static_cast<uint8_t>(face.size()));
          for (const int corner : face) AppendValue(&faces, corner, true);
        }
        const std::string vertex_header = kPlyVertices + "property float " + u +
                                          "\nproperty uchar quality\nproperty float " + v + "\n";
        const std::string face_header = "element face 2\nproperty list uchar int vertex_indices\n";
        const ReadOutcome read = ReadGoodText(
            "a.ply", "ply\nformat binary_big_endian 1.0\n" +
                         (faces_first ? face_header + vertex_header : vertex_header + face_header) +
                         "end_header\n" + (faces_first ? faces + vertices : vertices + faces));
        REQUIRE(read.mesh.header.attributes.attributes ==
                std::vector<VertexAttribute>{{"quality", ScalarType::kUint8}});
        CHECK(read.mesh.rows == Bytes(4, std::byte{200}));
        REQUIRE(read.mesh.corners.size() == 3 * read.mesh.triangles.size());
        for (size_t i = 0; i < read.mesh.corners.size(); ++i) {
          const auto vertex = static_cast<float>(read.mesh.triangles[i / 3][i % 3]);
          CHECK(read.mesh.corners[i] == TextureCorner{vertex / 4, 0.5f, 0});
        }
      }
    }
  }
}

TEST_CASE("PLY: a vector's parts, doubles and lone names stay attributes") {
  for (const char* properties :
       {"property float u\nproperty float v\nproperty float w\n", "property float s\n",
        "property double s\nproperty double t\n", "property int u\nproperty int v\n"}) {
    INFO(properties);
    const std::string names(properties);
    const auto count = static_cast<size_t>(std::ranges::count(names, '\n'));
    std::string text =
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
        "property float y\nproperty float z\n" +
        names + "end_header\n0 0 0";
    for (size_t i = 0; i < count; ++i) text += " 1";
    const ReadOutcome outcome = ReadGoodText("a.ply", text + "\n");
    CHECK_FALSE(outcome.mesh.header.textured);
    CHECK(outcome.mesh.header.attributes.attributes.size() == count);
  }
}

TEST_CASE("PLY: lists of coordinates that are cut short are refused") {
  std::string text = "ply\nformat binary_little_endian 1.0\n" + kPlyVertices +
                     "element face 1\nproperty list uchar int vertex_indices\n"
                     "property list uint float texcoord\nend_header\n" +
                     std::string(48, '\0');
  text += '\3';
  for (const int v : {0, 1, 2}) AppendValue(&text, v);
  std::string cut = text;
  AppendValue(&cut, uint32_t{6});
  AppendValue(&cut, 1.f);
  testing::RequireBadInput("a.ply", cut, {"face 0", "texcoord"});
  AppendValue(&text, uint32_t{0xffffffff});
  testing::RequireBadInput("a.ply", text, {"face 0", "texcoord"});
}

TEST_CASE("More coordinates than memory is for are in a temporary file, whose size is limited") {
  constexpr uint32_t kCount = (1 << 22) + (1 << 20) + 7;
  const auto place = [](uint32_t i) {
    return internal::TexturePlace{static_cast<float>(i), static_cast<float>(i % 1000)};
  };
  internal::CornerTable table({std::filesystem::temp_directory_path().string()});
  for (const uint32_t count : {kCount, uint32_t{1000}, kCount - 5}) {
    table.Clear();
    bool good = true;
    for (uint32_t i = 0; i < count; ++i) good &= table.Append(place(i)).ok();
    CHECK(table.size() == count);
    // Scattered, then in order.
    for (uint64_t k = 0; k < 200000; ++k) {
      const auto i = static_cast<uint32_t>(k < 100000 ? k * 2654435761u % count : k % count);
      internal::TexturePlace found;
      good &= table.Get(i, &found).ok() && found.u == place(i).u && found.v == place(i).v;
    }
    internal::TexturePlace last;
    good &= table.Get(count - 1, &last).ok() && last.u == place(count - 1).u;
    CHECK(good);
  }
  internal::CornerTable small({"", 1 << 20});
  Status status = Status::Ok();
  for (uint32_t i = 0; i < kCount && status.ok(); ++i) status = small.Append(place(i));
  CHECK(status.code() == StatusCode::kBudgetExceeded);
  CHECK_THAT(status.message(), Catch::Contains("--max-tmp"));
}

}  // namespace
}  // namespace mtdb
