// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <limits>

#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using testing::AppendValue;
using testing::ReadGood;
using testing::ReadOutcome;
using testing::ReadText;
using testing::RequireBadInput;
using testing::ValueInRow;

std::string Header(const std::string& format, int vertices, int faces,
                   const std::string& more_vertex = "") {
  return "ply\nformat " + format + " 1.0\ncomment made by hand\nelement vertex " +
         std::to_string(vertices) + "\nproperty float x\nproperty float y\nproperty float z\n" +
         more_vertex + "element face " + std::to_string(faces) +
         "\nproperty list uchar int vertex_indices\nend_header\n";
}

const std::string kAsciiTriangle = Header("ascii", 3, 1) + "0 0 0\n1 0 0\n0 1.5 0\n3 0 1 2\n";

std::string BinaryTriangle(bool big_endian) {
  std::string file = Header(big_endian ? "binary_big_endian" : "binary_little_endian", 3, 1);
  for (const float v : {0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.5f, 0.f}) {
    AppendValue(&file, v, big_endian);
  }
  file += '\3';
  for (const int32_t v : {0, 1, 2}) AppendValue(&file, v, big_endian);
  return file;
}

void RequireTriangle(const ReadOutcome& outcome) {
  REQUIRE(outcome.mesh.positions == std::vector<Vec3d>{{0, 0, 0}, {1, 0, 0}, {0, 1.5, 0}});
  REQUIRE(outcome.mesh.triangles == std::vector<TriangleVertices>{{0, 1, 2}});
  REQUIRE_FALSE(outcome.mesh.header.double_positions);
}

// Records the blocks and the header, and says no when told to.
class BlockSink final : public MeshSink {
 public:
  Status Begin(const MeshHeader& h) override {
    header = h;
    return Status::Ok();
  }
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan) override {
    largest_block = std::max(largest_block, positions.size());
    vertices += positions.size();
    return Status::Ok();
  }
  Status AddTriangles(std::span<const TriangleVertices> block) override {
    if (refuse_triangles) return InvalidArgument("enough");
    largest_block = std::max(largest_block, block.size());
    triangles += block.size();
    for (const TriangleVertices& t : block) sum += t[0] + 2 * t[1] + 3 * t[2];
    return Status::Ok();
  }
  Status End() override {
    ended = true;
    return Status::Ok();
  }

  MeshHeader header;
  size_t largest_block = 0;
  uint64_t vertices = 0, triangles = 0, sum = 0;
  bool ended = false;
  bool refuse_triangles = false;
};

TEST_CASE("PLY is read in ASCII and in binary of both byte orders") {
  const ReadOutcome ascii = ReadGood("a.ply", kAsciiTriangle);
  RequireTriangle(ascii);
  REQUIRE(ascii.report.format == "PLY ASCII");
  const ReadOutcome little = ReadGood("l.ply", BinaryTriangle(false));
  RequireTriangle(little);
  REQUIRE(little.report.format == "PLY binary little endian");
  const ReadOutcome big = ReadGood("b.ply", BinaryTriangle(true));
  RequireTriangle(big);
  REQUIRE(big.report.format == "PLY binary big endian");
  REQUIRE(big.report.ignored.empty());
  REQUIRE(big.mesh.header.vertex_count == 3u);
}

TEST_CASE("PLY is known by its content whatever the extension") {
  RequireTriangle(ReadGood("mesh.dat", kAsciiTriangle));
  RequireTriangle(ReadGood("mesh.obj", kAsciiTriangle));
}

TEST_CASE("PLY headers may have CR LF, comments and obj_info") {
  std::string text = kAsciiTriangle;
  text.replace(text.find("comment"), 7, "obj_info");
  for (size_t at = 0; (at = text.find('\n', at)) != std::string::npos; at += 2) {
    text.replace(at, 1, "\r\n");
  }
  RequireTriangle(ReadGood("crlf.ply", text));
}

TEST_CASE("PLY ASCII values may be spread over lines and lack the last line end") {
  RequireTriangle(ReadGood("s.ply", Header("ascii", 3, 1) + "0 0\n0 1 0 0\n\n\t0 +1.5 0 3\n0 1 2"));
}

TEST_CASE("PLY says the same in both byte orders, whichever scalars lie side by side") {
  constexpr std::pair<const char*, size_t> kTypes[] = {{"uchar", 1}, {"short", 2},  {"int", 4},
                                                       {"float", 4}, {"double", 8}, {"char", 1}};
  std::mt19937 random(1);
  for (int round = 0; round < 300; ++round) {
    std::string properties;
    std::vector<size_t> sizes;
    for (uint32_t i = 0; i < 1 + random() % 6; ++i) {
      // Bytes the most: colours are bytes.
      const auto& [name, size] = kTypes[random() % 2 == 0 ? 0 : random() % 6];
      properties += std::string("property ") + name + " a" + std::to_string(i) + "\n";
      sizes.push_back(size);
    }
    std::string files[2];
    const uint32_t values = random();
    for (const bool big : {false, true}) {
      std::string& file = files[big ? 1 : 0];
      file = std::string("ply\nformat ") + (big ? "binary_big_endian" : "binary_little_endian") +
             " 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n" +
             properties + "end_header\n";
      std::mt19937 bytes(values);
      for (int v = 0; v < 3; ++v) {
        for (int axis = 0; axis < 3; ++axis) AppendValue(&file, 0.1f * v + axis, big);
        for (const size_t size : sizes) {
          const uint64_t value = (uint64_t{bytes()} << 32) | bytes();
          mtdb::testing::AppendRaw(&file, &value, size, big);
        }
      }
    }
    CAPTURE(properties);
    const TriangleMesh little = ReadGood("l.ply", files[0]).mesh;
    const TriangleMesh big = ReadGood("b.ply", files[1]).mesh;
    REQUIRE(big.positions == little.positions);
    REQUIRE(big.rows == little.rows);
  }
}

TEST_CASE("PLY scalar vertex properties of any order and type become attributes") {
  for (const bool big : {false, true}) {
    for (const bool ascii : {false, true}) {
      if (ascii && big) continue;
      const std::string format = ascii ? "ascii"
                                 : big ? "binary_big_endian"
                                       : "binary_little_endian";
      std::string file = "ply\nformat " + format +
                         " 1.0\nelement vertex 2\nproperty uchar red\nproperty float z\n"
                         "property ushort label\nproperty double y\nproperty uchar green\n"
                         "property uchar blue\nproperty float x\nproperty double quality\n"
                         "property char c\nproperty int i\nend_header\n";
      for (int v = 0; v < 2; ++v) {
        if (ascii) {
          file += v == 0 ? "10 3 1000 0.1 20 30 1 0.25 -5 -70000\n"
                         : "11 6 1001 5 21 31 4 1.25 -6 70000\n";
          continue;
        }
        AppendValue(&file, static_cast<uint8_t>(10 + v), big);
        AppendValue(&file, 3.f * static_cast<float>(v + 1), big);
        AppendValue(&file, static_cast<uint16_t>(1000 + v), big);
        AppendValue(&file, v == 0 ? 0.1 : 5.0, big);
        AppendValue(&file, static_cast<uint8_t>(20 + v), big);
        AppendValue(&file, static_cast<uint8_t>(30 + v), big);
        AppendValue(&file, v == 0 ? 1.f : 4.f, big);
        AppendValue(&file, v + 0.25, big);
        AppendValue(&file, static_cast<int8_t>(-5 - v), big);
        AppendValue(&file, v == 0 ? -70000 : 70000, big);
      }
      const ReadOutcome outcome = ReadGood("mixed.ply", file);
      const TriangleMesh& mesh = outcome.mesh;
      CAPTURE(format);
      REQUIRE(mesh.header.double_positions);
      REQUIRE(mesh.positions == std::vector<Vec3d>{{1, 0.1, 3}, {4, 5, 6}});
      REQUIRE(mesh.header.attributes.attributes ==
              std::vector<VertexAttribute>{{"red", ScalarType::kUint8},
                                           {"label", ScalarType::kUint16},
                                           {"green", ScalarType::kUint8},
                                           {"blue", ScalarType::kUint8},
                                           {"quality", ScalarType::kFloat64},
                                           {"c", ScalarType::kInt8},
                                           {"i", ScalarType::kInt32}});
      REQUIRE(mesh.rows.size() == 2 * 18);
      for (int v = 0; v < 2; ++v) {
        REQUIRE(ValueInRow<uint8_t>(mesh, v, 0) == 10 + v);
        REQUIRE(ValueInRow<uint16_t>(mesh, v, 1) == 1000 + v);
        REQUIRE(ValueInRow<uint8_t>(mesh, v, 3) == 20 + v);
        REQUIRE(ValueInRow<uint8_t>(mesh, v, 4) == 30 + v);
        REQUIRE(ValueInRow<double>(mesh, v, 5) == v + 0.25);
        REQUIRE(ValueInRow<int8_t>(mesh, v, 13) == -5 - v);
        REQUIRE(ValueInRow<int32_t>(mesh, v, 14) == (v == 0 ? -70000 : 70000));
      }
      REQUIRE(mesh.triangles.empty());
    }
  }
}

TEST_CASE("PLY positions declared double are flagged, also when all are short") {
  std::string text = kAsciiTriangle;
  for (const char* axis : {"float x", "float y", "float z"}) {
    text.replace(text.find(axis), 5, "double");
  }
  REQUIRE(ReadGood("d.ply", text).mesh.header.double_positions);
}

TEST_CASE("PLY ASCII floats are read as double, tiny ones kept or 0") {
  const ReadOutcome outcome =
      ReadGood("f.ply", Header("ascii", 1, 0) + "0.100000001490116119384765625 1e-40 1e-400\n");
  REQUIRE(outcome.mesh.positions[0].x == double{0.1f});
  REQUIRE(outcome.mesh.positions[0].y == 1e-40);
  REQUIRE(outcome.mesh.positions[0].z == 0);
}

TEST_CASE("PLY polygons are split and short faces dropped, in all encodings") {
  const ReadOutcome ascii = ReadGood(
      "p.ply", Header("ascii", 5, 4) +
                   "0 0 0 1 0 0 1 1 0 0 1 0 -1 0.5 0\n4 0 1 2 3\n2 0 1\n3 4 1 0\n5 4 3 2 1 0\n");
  std::string file = Header("binary_little_endian", 5, 4);
  for (int i = 0; i < 15; ++i) AppendValue(&file, static_cast<float>(i));
  for (const std::vector<int>& face :
       {std::vector<int>{0, 1, 2, 3}, {0, 1}, {4, 1, 0}, {4, 3, 2, 1, 0}}) {
    file += static_cast<char>(face.size());
    for (const int v : face) AppendValue(&file, v);
  }
  const ReadOutcome binary = ReadGood("p.ply", file);
  for (const ReadOutcome* outcome : {&ascii, &binary}) {
    REQUIRE(outcome->mesh.triangles ==
            std::vector<TriangleVertices>{
                {0, 1, 2}, {0, 2, 3}, {4, 1, 0}, {4, 3, 2}, {4, 2, 1}, {4, 1, 0}});
    REQUIRE(outcome->report.polygons == 2);
    REQUIRE(outcome->report.short_faces == 1);
  }
}

TEST_CASE("PLY tristrips alternate orientation, restart at -1 and skip stitching") {
  const std::string header =
      "element vertex 7\nproperty float x\nproperty float y\nproperty float z\n"
      "element tristrips 1\nproperty list int int vertex_indices\nend_header\n";
  const std::vector<int> strip = {0, 1, 2, 3, 4, -1, 4, 5, 6, 6, 0, 1, -1, 2, 3};
  const std::vector<TriangleVertices> expected = {
      {0, 1, 2}, {2, 1, 3}, {2, 3, 4}, {4, 5, 6}, {0, 6, 1}};
  std::string ascii = "ply\nformat ascii 1.0\n" + header;
  for (int i = 0; i < 21; ++i) ascii.append(std::to_string(i)).append(" ");
  ascii += "15";
  for (const int v : strip) ascii.append(" ").append(std::to_string(v));
  std::string binary = "ply\nformat binary_big_endian 1.0\n" + header;
  for (int i = 0; i < 21; ++i) AppendValue(&binary, static_cast<float>(i), true);
  AppendValue(&binary, 15, true);
  for (const int v : strip) AppendValue(&binary, v, true);
  for (const std::string& file : {ascii, binary}) {
    const ReadOutcome outcome = ReadGood("strips.ply", file);
    REQUIRE(outcome.mesh.triangles == expected);
    REQUIRE(outcome.report.strips == 2);
    REQUIRE(outcome.report.ignored.empty());
  }
}

TEST_CASE("PLY: what mtdb does not carry is skipped and reported") {
  const std::string header =
      "element camera 1\nproperty float fov\nproperty list uchar short list\n"
      "element face 2\nproperty int material_index\nproperty list uchar int vertex_index\n"
      "property list uchar float texcoord\n"
      "element vertex 3\nproperty float x\nproperty list uchar int rings\nproperty float y\n"
      "property float z\nproperty uchar red\nelement edge 1\nproperty int vertex1\n"
      "property int vertex2\nend_header\n";
  const std::string ascii = "ply\nformat ascii 1.0\n" + header +
                            "0.5 2 7 8\n9 3 0 1 2 2 0.5 0.5\n9 4 0 1 2 0 0\n"
                            "0 0 0 0 50\n1 2 4 5 0 0 51\n0 1 3 1.5 0 52\n0 1\nrest\n";
  std::string binary = "ply\nformat binary_little_endian 1.0\n" + header;
  AppendValue(&binary, 0.5f);
  binary += '\2';
  AppendValue(&binary, int16_t{7});
  AppendValue(&binary, int16_t{8});
  for (const std::vector<int>& face : {std::vector<int>{0, 1, 2}, {0, 1, 2, 0}}) {
    AppendValue(&binary, 9);
    binary += static_cast<char>(face.size());
    for (const int v : face) AppendValue(&binary, v);
    binary += static_cast<char>(face.size() == 3 ? 1 : 0);
    if (face.size() == 3) AppendValue(&binary, 0.5f);
  }
  for (int v = 0; v < 3; ++v) {
    AppendValue(&binary, v == 1 ? 1.f : 0.f);
    binary += '\1';
    AppendValue(&binary, 77);
    AppendValue(&binary, v == 2 ? 1.5f : 0.f);
    AppendValue(&binary, 0.f);
    binary += static_cast<char>(50 + v);
  }
  AppendValue(&binary, 0);
  AppendValue(&binary, 1);
  binary += "rest\n";
  for (const std::string& file : {ascii, binary}) {
    const ReadOutcome outcome = ReadGood("all.ply", file);
    REQUIRE(outcome.mesh.positions == std::vector<Vec3d>{{0, 0, 0}, {1, 0, 0}, {0, 1.5, 0}});
    REQUIRE(outcome.mesh.triangles ==
            std::vector<TriangleVertices>{{0, 1, 2}, {0, 1, 2}, {0, 2, 0}});
    REQUIRE(ValueInRow<uint8_t>(outcome.mesh, 2, 0) == 52);
    REQUIRE(outcome.report.ignored ==
            std::vector<std::string>{"vertex list property rings", "element camera",
                                     "face property material_index", "element edge",
                                     "wrong texture coordinates of 1 triangle",
                                     "5 bytes after the last element"});
  }
}

TEST_CASE("PLY binary is sent in blocks of at most 65536, over the reader's buffer") {
  constexpr int kSide = 400;  // some 6 MB, more than the buffer
  const testing::ScratchFolder folder;
  for (const bool big : {false, true}) {
    std::string file = Header(big ? "binary_big_endian" : "binary_little_endian", kSide * kSide,
                              3 * kSide * kSide);
    for (int i = 0; i < 3 * kSide * kSide; ++i) AppendValue(&file, static_cast<float>(i), big);
    uint64_t sum = 0;
    for (int i = 0; i < 3 * kSide * kSide; ++i) {
      // A quad now and then leaves the fast path.
      const int corners = i % 1000 == 999 ? 4 : 3;
      file += static_cast<char>(corners);
      // The last corner twice: both diagonals are as good.
      const int v[4] = {i / 3, (i * 7) % (kSide * kSide), i % 1001, i % 1001};
      for (int k = 0; k < corners; ++k) AppendValue(&file, v[k], big);
      sum += static_cast<uint64_t>(v[0]) + 2 * v[1] + 3 * v[2];
      if (corners == 4) sum += static_cast<uint64_t>(v[0]) + 2 * v[2] + 3 * v[3];
    }
    BlockSink sink;
    MeshReadReport report;
    REQUIRE(ReadMeshFile(folder.Write("big.ply", file), sink, &report).ok());
    REQUIRE(sink.vertices == kSide * kSide);
    REQUIRE(sink.triangles == 3 * kSide * kSide + 480);
    REQUIRE(report.polygons == 480);
    REQUIRE(sink.sum == sum);
    REQUIRE(sink.largest_block <= 65536);
    REQUIRE(sink.ended);
  }
}

TEST_CASE("PLY rows of thousands of attributes are read in shorter blocks") {
  constexpr int kAttributes = 2000, kVertices = 1500;
  std::string properties;
  for (int i = 0; i < kAttributes; ++i) {
    properties.append("property double a").append(std::to_string(i)).append("\n");
  }
  std::string file = Header("binary_little_endian", kVertices, 0, properties);
  for (int v = 0; v < kVertices; ++v) {
    for (int i = 0; i < 3; ++i) AppendValue(&file, static_cast<float>(v));
    for (int i = 0; i < kAttributes; ++i) AppendValue(&file, static_cast<double>(v + i));
  }
  const ReadOutcome outcome = ReadGood("wide.ply", file);
  REQUIRE(outcome.mesh.positions.size() == kVertices);
  REQUIRE(ValueInRow<double>(outcome.mesh, 1499, 8 * 1999) == 1499 + 1999);
  REQUIRE(ValueInRow<double>(outcome.mesh, 700, 0) == 700);
  properties.clear();
  for (int i = 0; i < 5000; ++i) {
    properties.append("property char a").append(std::to_string(i)).append("\n");
  }
  RequireBadInput("wide.ply", Header("ascii", 1, 0, properties) + "0\n",
                  {"more than 4096 properties"});
}

TEST_CASE("An error of the sink stops the reader and is returned") {
  const testing::ScratchFolder folder;
  BlockSink sink;
  sink.refuse_triangles = true;
  const Status status = ReadMeshFile(folder.Write("a.ply", kAsciiTriangle), sink, nullptr);
  REQUIRE(status.message() == "enough");
  REQUIRE_FALSE(sink.ended);
}

TEST_CASE("PLY: a bad vertex index names the face, the index and the count") {
  const std::string start = Header("ascii", 3, 2) + "0 0 0\n1 0 0\n0 1.5 0\n3 0 1 2\n3 0 1 ";
  RequireBadInput("scan.ply", start + "3\n",
                  {"face 1 (line 15): vertex index 3, but the file has 3 vertices"});
  RequireBadInput("scan.ply", start + "-1\n", {"face 1 (line 15): vertex index -1, but"});
  for (const bool big : {false, true}) {
    for (const int32_t bad : {3, -1, -2147483647, 70000}) {
      std::string file = BinaryTriangle(big);
      file.resize(file.size() - 4);
      AppendValue(&file, bad, big);
      const std::string part =
          "face 0: vertex index " + std::to_string(bad) + ", but the file has 3 vertices";
      RequireBadInput("scan.ply", file, {part.c_str()});
    }
  }
}

TEST_CASE("PLY: coordinates that are not finite are refused with their place") {
  const std::string face = "3 0 1 0\n";
  RequireBadInput("n.ply", Header("ascii", 2, 1) + "0 0 0\n0 nan 0\n" + face,
                  {"vertex 1 (line 12): y is nan", "face 0 (line 13) uses this vertex"});
  RequireBadInput("n.ply", Header("ascii", 2, 1) + "0 0 0\n0 0 -inf\n" + face,
                  {"vertex 1", "z is -inf"});
  RequireBadInput("n.ply", Header("ascii", 2, 1) + "0 0 0\n1e390 0 0\n" + face,
                  {"vertex 1", "x is inf"});
  for (const bool big : {false, true}) {
    for (const float bad : {std::nanf(""), std::numeric_limits<float>::infinity()}) {
      std::string file = Header(big ? "binary_big_endian" : "binary_little_endian", 2, 1);
      for (const float v : {0.f, 0.f, 0.f, 0.f, 0.f, bad}) AppendValue(&file, v, big);
      file += '\3';
      for (const int v : {0, 1, 0}) AppendValue(&file, v, big);
      RequireBadInput("n.ply", file, {"vertex 1: z is", "expected a finite number"});
    }
  }
}

TEST_CASE("PLY: header errors name the line and what was expected") {
  const auto bad = [](const std::string& text, std::initializer_list<const char*> parts) {
    RequireBadInput("h.ply", text, parts);
  };
  bad("just a text\nof two lines\n", {"line 1: expected 'ply', found 'just a text'"});
  bad("ply\nformat ascii 2.0\nend_header\n", {"line 2: expected format version 1.0"});
  bad("ply\nformat binary_middle_endian 1.0\n", {"line 2", "found 'binary_middle_endian'"});
  bad("ply\nelement vertex 0\nend_header\n", {"no format line"});
  bad("ply\nformat ascii 1.0\nelement vertex -3\n", {"line 3", "found count '-3'"});
  bad("ply\nformat ascii 1.0\nelement vertex many\n", {"line 3", "'many'"});
  bad("ply\nformat ascii 1.0\nproperty float x\n", {"line 3: a property before the first element"});
  bad("ply\nformat ascii 1.0\nelement vertex 1\nproperty int64 x\n", {"line 4", "found 'int64'"});
  bad("ply\nformat ascii 1.0\nelement vertex 1\nproperty list float int x\n",
      {"line 4", "integer type for the count"});
  bad("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float x\n",
      {"line 5: property 'x' is declared twice"});
  bad("ply\nformat ascii 1.0\nelement vertex 1\nelement vertex 1\n", {"line 4", "declared twice"});
  bad("ply\nformat ascii 1.0\nelement vertex 1\nproperty float \x1b[2J\n",
      {"line 4: expected a name of 1 to 255 printable characters, found '?[2J'"});
  bad("ply\nformat ascii 1.0\nelement vertex 1\nproperty float\n", {"line 4", "found ''"});
  bad("ply\nformat ascii 1.0\nelephant\n", {"line 3", "found 'elephant'"});
  bad("ply\nformat ascii 1.0\nelement face 0\nend_header\n", {"no vertex element"});
  bad(Header("ascii", 0, 0), {"no vertices"});
  bad("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float z\n"
      "end_header\n0 0\n",
      {"the vertex element has no property y"});
  bad("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
      "property list uchar float z\nend_header\n0 0 1 0\n",
      {"vertex property z: expected a number, found a list"});
  bad("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
      "property float z\nelement face 1\nproperty int material\nend_header\n0 0 0\n7\n",
      {"element face has no list property vertex_indices"});
  bad("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
      "property float z\nelement face 1\nproperty list uchar float vertex_index\nend_header\n"
      "0 0 0\n1 0\n",
      {"vertex_index: expected a list of integers"});
}

TEST_CASE("PLY: values of the wrong kind are refused with line and text") {
  RequireBadInput("v.ply", Header("ascii", 2, 0) + "0 0 0\n0 wide 0\n",
                  {"vertex 1 (line 12): property y: expected a number, found 'wide'"});
  RequireBadInput("v.ply", Header("ascii", 1, 0, "property uchar red\n") + "0 0 0 256\n",
                  {"property red: expected an integer from 0 to 255, found '256'"});
  RequireBadInput("v.ply", Header("ascii", 1, 1) + "0 0 0\n-3 0 0 0\n", {"face 0", "'-3'"});
  RequireBadInput("v.ply", Header("ascii", 1, 1) + "0 0 0\n1.5 0 0 0\n", {"face 0", "'1.5'"});
  REQUIRE(ReadGood("v.ply", Header("ascii", 1, 0, "property uchar red\n") + "0 0 0 255.0\n")
              .mesh.rows == Bytes{std::byte{255}});
}

TEST_CASE("PLY: a negative list count is refused") {
  std::string header = Header("binary_little_endian", 1, 1);
  header.replace(header.find("list uchar"), 10, "list char");
  std::string file = header;
  for (int i = 0; i < 3; ++i) AppendValue(&file, 0.f);
  file += '\xff';
  RequireBadInput("c.ply", file, {"face 0: list vertex_indices", "found -1"});
}

TEST_CASE("PLY: huge counts are compared with the bytes that remain") {
  for (const char* format : {"ascii", "binary_little_endian", "binary_big_endian"}) {
    std::string text = Header(format, 3, 1);
    text.replace(text.find("vertex 3"), 8, "vertex 9000000000000000000");
    RequireBadInput("huge.ply", text + "0 0 0\n",
                    {"the header promises 9000000000000000000 of element vertex", "6 bytes"});
    text = Header(format, 1, 1);
    text.replace(text.find("face 1"), 6, "face 9223372036854775807");
    RequireBadInput("huge.ply", text + "0 0 0 0 0 0 0", {"9223372036854775807 of element face"});
  }
  std::string list = Header("binary_little_endian", 1, 1);
  list.replace(list.find("list uchar"), 10, "list uint");
  for (int i = 0; i < 3; ++i) AppendValue(&list, 0.f);
  AppendValue(&list, 0xfffffff0u);
  RequireBadInput("huge.ply", list,
                  {"face 0: list vertex_indices of 4294967280 items, but only 0 bytes are left"});
  // Elements of no size are no work.
  std::string empty = kAsciiTriangle;
  empty.insert(empty.find("end_header"), "element nothing 9000000000000000000\n");
  RequireTriangle(ReadGood("huge.ply", empty));
}

TEST_CASE("PLY: every prefix of a binary file is refused") {
  for (const bool big : {false, true}) {
    const std::string file = BinaryTriangle(big);
    for (size_t n = 0; n < file.size(); ++n) {
      CAPTURE(n);
      RequireBadInput("cut.ply", file.substr(0, n), {});
    }
    REQUIRE(ReadText("cut.ply", file).status.ok());
  }
}

TEST_CASE("PLY: every prefix of an ASCII file is refused, but for the last line end") {
  for (size_t n = 0; n + 1 < kAsciiTriangle.size(); ++n) {
    CAPTURE(n);
    RequireBadInput("cut.ply", kAsciiTriangle.substr(0, n), {});
  }
  RequireTriangle(ReadGood("cut.ply", kAsciiTriangle.substr(0, kAsciiTriangle.size() - 1)));
}

TEST_CASE("PLY: every prefix of a file with lists, strips and other elements is refused") {
  std::string file =
      "ply\nformat binary_little_endian 1.0\nelement extra 2\nproperty list uchar short s\n"
      "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
      "property list uchar int rings\nelement other 2\nproperty double d\n"
      "element tristrips 1\nproperty list int int vertex_indices\nend_header\n";
  for (int i = 0; i < 2; ++i) {
    file += '\1';
    AppendValue(&file, int16_t{3});
  }
  for (int v = 0; v < 3; ++v) {
    for (int i = 0; i < 3; ++i) AppendValue(&file, 1.f);
    file += '\1';
    AppendValue(&file, 4);
  }
  AppendValue(&file, 1.0);
  AppendValue(&file, 2.0);
  for (const int v : {3, 0, 1, 2}) AppendValue(&file, v);
  for (size_t n = 0; n < file.size(); ++n) {
    CAPTURE(n);
    RequireBadInput("cut.ply", file.substr(0, n), {});
  }
  REQUIRE(ReadGood("cut.ply", file).mesh.triangles.size() == 1);
}

TEST_CASE("PLY: a flipped byte of the header is an error or a mesh, never a crash") {
  const std::string file = BinaryTriangle(false);
  const size_t header_bytes = file.find("end_header\n") + 11;
  for (size_t i = 0; i < header_bytes; ++i) {
    for (const int bit : {1, 4, 16, 64, 128}) {
      std::string damaged = file;
      damaged[i] = static_cast<char>(damaged[i] ^ bit);
      const ReadOutcome outcome = ReadText("flip.ply", damaged);
      REQUIRE((outcome.status.ok() || outcome.status.code() == StatusCode::kBadInput));
    }
  }
}

}  // namespace
}  // namespace mtdb
