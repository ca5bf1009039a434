// SPDX-License-Identifier: Apache-2.0
// Faces of more than three corners, in each format that has them.
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using testing::AppendValue;
using testing::ReadGood;
using testing::ReadOutcome;
using testing::RequireBadInput;

using Face = std::vector<int>;

struct Polygons {
  std::vector<Vec3d> vertices;
  std::vector<Face> faces;
};

std::string Text(double value) {
  std::ostringstream out;
  out << value;
  return out.str();
}
std::string PointText(Vec3d p) { return Text(p.x) + " " + Text(p.y) + " " + Text(p.z) + "\n"; }

std::string Obj(const Polygons& m, bool faces_first) {
  std::string vertices, faces;
  for (const Vec3d p : m.vertices) vertices += "v " + PointText(p);
  for (const Face& face : m.faces) {
    faces += "f";
    for (const int v : face) faces += " " + std::to_string(v + 1);
    faces += "\n";
  }
  return faces_first ? faces + vertices : vertices + faces;
}

std::string Off(const Polygons& m, bool) {
  std::string text =
      "OFF\n" + std::to_string(m.vertices.size()) + " " + std::to_string(m.faces.size()) + " 0\n";
  for (const Vec3d p : m.vertices) text += PointText(p);
  for (const Face& face : m.faces) {
    text += std::to_string(face.size());
    for (const int v : face) text += " " + std::to_string(v);
    text += "\n";
  }
  return text;
}

std::string PlyHeader(const Polygons& m, const char* encoding, bool faces_first,
                      const std::string& properties) {
  const std::string faces = "element face " + std::to_string(m.faces.size()) +
                            "\nproperty list uint int vertex_indices\n";
  const std::string vertices =
      "element vertex " + std::to_string(m.vertices.size()) + "\n" + properties;
  return std::string("ply\nformat ") + encoding + " 1.0\n" +
         (faces_first ? faces + vertices : vertices + faces) + "end_header\n";
}

std::string PlyText(const Polygons& m, bool faces_first) {
  std::string vertices, faces;
  for (const Vec3d p : m.vertices) vertices += PointText(p);
  for (const Face& face : m.faces) {
    faces += std::to_string(face.size());
    for (const int v : face) faces += " " + std::to_string(v);
    faces += "\n";
  }
  return PlyHeader(m, "ascii", faces_first,
                   "property float x\nproperty float y\nproperty float z\n") +
         (faces_first ? faces + vertices : vertices + faces);
}

// Coordinates of type T; with a list in front of each vertex these are of no fixed size.
template <typename T>
std::string PlyBinary(const Polygons& m, bool faces_first, bool big, bool lists) {
  std::string vertices, faces;
  for (const Vec3d p : m.vertices) {
    if (lists) {
      vertices += '\1';
      AppendValue(&vertices, int16_t{7}, big);
    }
    vertices += 'c';
    for (int axis = 0; axis < 3; ++axis) AppendValue(&vertices, static_cast<T>(p[axis]), big);
  }
  for (const Face& face : m.faces) {
    AppendValue(&faces, static_cast<uint32_t>(face.size()), big);
    for (const int v : face) AppendValue(&faces, v, big);
  }
  const std::string type = sizeof(T) == 4 ? "float" : "double";
  const std::string properties = std::string(lists ? "property list uchar short l\n" : "") +
                                 "property uchar c\nproperty " + type + " x\nproperty " + type +
                                 " y\nproperty " + type + " z\n";
  return PlyHeader(m, big ? "binary_big_endian" : "binary_little_endian", faces_first, properties) +
         (faces_first ? faces + vertices : vertices + faces);
}

struct Way {
  const char* file;
  std::function<std::string(const Polygons&, bool faces_first)> write;
};
const std::vector<Way>& Ways() {
  static const std::vector<Way> kWays = {
      {"m.obj", Obj},
      {"m.off", Off},
      {"text.ply", PlyText},
      {"float.ply", [](const Polygons& m, bool f) { return PlyBinary<float>(m, f, false, false); }},
      {"big.ply", [](const Polygons& m, bool f) { return PlyBinary<double>(m, f, true, false); }},
      {"lists.ply", [](const Polygons& m, bool f) { return PlyBinary<float>(m, f, true, true); }},
  };
  return kWays;
}

double Area(const TriangleMesh& mesh) {
  double area = 0;
  for (const TriangleVertices& t : mesh.triangles) {
    area += Length(Cross(mesh.positions[t[1]] - mesh.positions[t[0]],
                         mesh.positions[t[2]] - mesh.positions[t[0]])) /
            2;
  }
  return area;
}

const Polygons kComb{{{0, 0, 0},
                      {9, 0, 0},
                      {9, 5, 0},
                      {8, 5, 0},
                      {8, 1, 0},
                      {7, 1, 0},
                      {7, 5, 0},
                      {6, 5, 0},
                      {6, 1, 0},
                      {1, 1, 0},
                      {1, 5, 0},
                      {0, 5, 0}},
                     {{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}}};
// With a triangle before and behind it, whose place among the triangles stays.
const Polygons kArrow{{{0, 2, 0}, {1, -2, 0}, {2, 2, 0}, {1, 1, 0}, {5, 5, 5}},
                      {{0, 1, 4}, {0, 1, 2, 3}, {1, 2, 4}}};

TEST_CASE("concave faces are covered by triangles in every format, in any order of elements") {
  for (const Way& way : Ways()) {
    for (const bool faces_first : {false, true}) {
      CAPTURE(way.file, faces_first);
      const ReadOutcome comb = ReadGood(way.file, way.write(kComb, faces_first));
      REQUIRE(comb.mesh.triangles.size() == 10);
      REQUIRE(Area(comb.mesh) == 21);
      REQUIRE(comb.report.polygons == 1);
      REQUIRE(comb.report.fans == 0);
      const ReadOutcome arrow = ReadGood(way.file, way.write(kArrow, faces_first));
      REQUIRE(arrow.mesh.triangles ==
              std::vector<TriangleVertices>{{0, 1, 4}, {0, 1, 3}, {1, 2, 3}, {1, 2, 4}});
    }
  }
}

TEST_CASE("faces that cross themselves become fans, and are counted") {
  const Polygons bow{{{0, 0, 0}, {4, 4, 0}, {4, 0, 0}, {0, 4, 0}, {9, 9, 9}},
                     {{0, 1, 2, 3}, {0, 2, 1, 3}, {0, 1, 4}}};
  for (const Way& way : Ways()) {
    CAPTURE(way.file);
    const ReadOutcome outcome = ReadGood(way.file, way.write(bow, false));
    REQUIRE(outcome.report.polygons == 2);
    REQUIRE(outcome.report.fans == 1);
    REQUIRE(outcome.mesh.triangles[0] == TriangleVertices{0, 1, 2});
    REQUIRE(outcome.mesh.triangles.size() == 5);
  }
}

// A grid of arrowheads whose area is known, with the vertices scattered over the file: more corners
// than are collected at a time, and more vertices than are kept in memory.
Polygons ManyArrows(int count) {
  Polygons m;
  const int scatter = 100'003;  // prime
  m.vertices.resize(static_cast<size_t>(4 * count));
  const auto place = [&](int v) { return static_cast<int>(int64_t{v} * scatter % (4 * count)); };
  for (int i = 0; i < count; ++i) {
    const double x = 4 * (i % 500), y = 8 * (i / 500);
    const Vec3d corners[4] = {
        {x, y + 2, 0}, {x + 1, y - 2, 0}, {x + 2, y + 2, 0}, {x + 1, y + 1, 0}};
    Face face;
    for (int c = 0; c < 4; ++c) {
      face.push_back(place(4 * i + c));
      m.vertices[static_cast<size_t>(face.back())] = corners[c];
    }
    m.faces.push_back(face);
  }
  return m;
}

TEST_CASE("more polygons and vertices than are kept in memory find their corners") {
  const Polygons many = ManyArrows(140'000);
  for (const Way& way : Ways()) {
    CAPTURE(way.file);
    const ReadOutcome outcome = ReadGood(way.file, way.write(many, true));
    REQUIRE(outcome.mesh.triangles.size() == 280'000);
    REQUIRE(Area(outcome.mesh) == 3.0 * 140'000);
    REQUIRE(outcome.report.fans == 0);
    // In the order of the faces.
    for (size_t i = 0; i < many.faces.size(); ++i) {
      REQUIRE(outcome.mesh.triangles[2 * i][0] == static_cast<VertexIndex>(many.faces[i][0]));
    }
  }
}

TEST_CASE(
    "a face of very many corners is cut; of more than 2^18 it becomes a fan, and is counted") {
  Polygons teeth;
  const auto add = [&](double x, double y) { teeth.vertices.push_back({x, y, 0}); };
  constexpr int kTeeth = 10'000;
  add(0, 0);
  add(4 * kTeeth, 0);
  for (int i = kTeeth; i-- > 0;) {
    add(4 * i + 3, 9);
    add(4 * i + 2, 9);
    add(4 * i + 2, 1);
    add(4 * i + 1, 1);
  }
  add(0, 1);
  teeth.faces = {{}, {0, 1, 2}};
  for (size_t v = 0; v < teeth.vertices.size(); ++v) teeth.faces[0].push_back(static_cast<int>(v));
  const ReadOutcome cut = ReadGood("cut.ply", PlyBinary<float>(teeth, false, false, false));
  REQUIRE(cut.report.fans == 0);
  REQUIRE(cut.mesh.triangles.size() == teeth.vertices.size() - 1);
  REQUIRE(cut.mesh.triangles.back() == TriangleVertices{0, 1, 2});

  Polygons huge{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}, {0, 2, 1}, {}, {0, 1, 2}}};
  for (int i = 0; i < 300'000; ++i) huge.faces[2].push_back(i % 3);
  const ReadOutcome fan = ReadGood("fan.ply", PlyBinary<float>(huge, false, false, false));
  REQUIRE(fan.report.fans == 1);
  REQUIRE(fan.mesh.triangles.size() == 300'001);
  REQUIRE(fan.mesh.triangles[2] == TriangleVertices{0, 1, 2});
  REQUIRE(fan.mesh.triangles[300'000 - 1] == TriangleVertices{0, 1, 2});
  REQUIRE(fan.mesh.triangles.back() == TriangleVertices{0, 1, 2});
}

// Each place for a vertex without a place: in front, between, behind.
TEST_CASE("vertices without numbers that no face uses are left out, and counted") {
  const double nan = std::nan("");
  const Polygons holey{{{nan, 0, 0},
                        {0, 2, 0},
                        {1, -2, 0},
                        {0, nan, 1},
                        {0, nan, 2},
                        {2, 2, 0},
                        {1, 1, 0},
                        {0, 0, nan}},
                       {{1, 2, 5, 6}, {1, 2, 5}}};
  for (const Way& way : Ways()) {
    for (const bool faces_first : {false, true}) {
      CAPTURE(way.file, faces_first);
      const ReadOutcome outcome = ReadGood(way.file, way.write(holey, faces_first));
      REQUIRE(outcome.report.left_out_vertices == 4);
      REQUIRE(outcome.mesh.positions ==
              std::vector<Vec3d>{{0, 2, 0}, {1, -2, 0}, {2, 2, 0}, {1, 1, 0}});
      REQUIRE(outcome.mesh.triangles ==
              std::vector<TriangleVertices>{{0, 1, 3}, {1, 2, 3}, {0, 1, 2}});
    }
  }
}

TEST_CASE("a face with a vertex without numbers is refused, naming both") {
  const double inf = std::numeric_limits<double>::infinity();
  const Polygons bad{{{0, 0, 0}, {1, 0, 0}, {1, inf, 0}, {0, 1, 0}}, {{0, 1, 3}, {0, 1, 2, 3}}};
  for (const Way& way : Ways()) {
    CAPTURE(way.file);
    RequireBadInput(way.file, way.write(bad, false),
                    {"y is inf, expected a finite number", "face", "uses this vertex"});
  }
  RequireBadInput("m.obj", Obj(bad, false), {"line 3: y is inf", "the face of line 6"});
  RequireBadInput("m.off", Off(bad, false), {"line 5: y is inf", "face 1 of line 8"});
  RequireBadInput("m.ply", PlyText(bad, false),
                  {"vertex 2 (line 12): y is inf", "face 1 (line 15)"});
}

TEST_CASE("thousands of vertices left out do not move the others") {
  // A raster of a scanner, with NaN where it saw nothing.
  Polygons m;
  std::vector<Vec3d> kept;
  std::vector<int> number(10'000, -1);
  for (int v = 0; v < 10'000; ++v) {
    const bool seen = v % 7 < 3 && (v < 3000 || v > 4500);
    m.vertices.push_back({seen ? v : std::nan(""), v * 2.0, 1});
    if (!seen) continue;
    number[static_cast<size_t>(v)] = static_cast<int>(kept.size());
    kept.push_back(m.vertices.back());
  }
  std::vector<TriangleVertices> expected;
  for (int v = 0; v + 2 < 10'000; v += 7) {
    if (v + 2 >= 3000 && v <= 4500) continue;
    m.faces.push_back({v, v + 1, v + 2});
    TriangleVertices t{};
    for (int c = 0; c < 3; ++c) t[c] = static_cast<VertexIndex>(number[static_cast<size_t>(v + c)]);
    expected.push_back(t);
  }
  for (const Way& way : Ways()) {
    CAPTURE(way.file);
    const ReadOutcome outcome = ReadGood(way.file, way.write(m, false));
    REQUIRE(outcome.mesh.positions == kept);
    REQUIRE(outcome.mesh.triangles == expected);
    REQUIRE(outcome.report.left_out_vertices == 10'000 - kept.size());
  }
}

}  // namespace
}  // namespace mtdb
