// SPDX-License-Identifier: Apache-2.0
#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using testing::ReadGood;
using testing::ReadOutcome;
using testing::ReadText;
using testing::RequireBadInput;
using testing::ValueInRow;

const std::string kQuad = "OFF\n# a comment\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";

TEST_CASE("OFF is read, with polygons split and short faces dropped") {
  const ReadOutcome outcome = ReadGood("q.off", kQuad);
  REQUIRE(outcome.report.format == "OFF ASCII");
  REQUIRE(outcome.mesh.positions.size() == 4);
  REQUIRE(outcome.mesh.triangles == std::vector<TriangleVertices>{{0, 1, 2}, {0, 2, 3}});
  REQUIRE(outcome.report.polygons == 1);
  const ReadOutcome more =
      ReadGood("m.off",
               "OFF 3 3 0 # counts here\r\n\r\n0 0 0 # one\r\n1 0 0\r\n0 1 0\r\n"
               "2 0 1\r\n3 0 1 2 255 0 0\r\n1 0\r\n");
  REQUIRE(more.mesh.triangles == std::vector<TriangleVertices>{{0, 1, 2}});
  REQUIRE(more.report.short_faces == 2);
  REQUIRE(more.report.ignored == std::vector<std::string>{"face colours"});
}

TEST_CASE("OFF is known by its content whatever the extension") {
  REQUIRE(ReadGood("mesh.txt", kQuad).mesh.triangles.size() == 2);
}

TEST_CASE("COFF colours are bytes or fractions, with and without alpha") {
  const ReadOutcome bytes = ReadGood("b.off", "COFF\n2 0 0\n0 0 0 255 1 2 128\n1 0 0 0 1 0 255\n");
  REQUIRE(bytes.mesh.header.attributes.attributes.size() == 4);
  REQUIRE(ValueInRow<uint8_t>(bytes.mesh, 0, 3) == 128);
  REQUIRE(ValueInRow<uint8_t>(bytes.mesh, 1, 1) == 1);
  const ReadOutcome unit = ReadGood("u.off", "COFF\n2 0 0\n0 0 0 1 0.5 0\n1 0 0 0 1 0.2\n");
  REQUIRE(unit.mesh.header.attributes.attributes ==
          std::vector<VertexAttribute>{{"red", ScalarType::kUint8},
                                       {"green", ScalarType::kUint8},
                                       {"blue", ScalarType::kUint8}});
  REQUIRE(ValueInRow<uint8_t>(unit.mesh, 0, 0) == 255);
  REQUIRE(ValueInRow<uint8_t>(unit.mesh, 0, 1) == 128);
  REQUIRE(ValueInRow<uint8_t>(unit.mesh, 1, 2) == 51);
}

TEST_CASE("NOFF and CNOFF carry normals") {
  const ReadOutcome n = ReadGood("n.off", "NOFF\n1 0 0\n0 0 0 0.5 -1 2\n");
  REQUIRE(n.mesh.header.attributes.attributes[2] == VertexAttribute{"nz", ScalarType::kFloat32});
  REQUIRE(ValueInRow<float>(n.mesh, 0, 4) == -1);
  const ReadOutcome cn = ReadGood("cn.off", "CNOFF\n1 0 0\n0 0 0 0.5 -1 2 10 20 30 40\n");
  REQUIRE(ValueInRow<float>(cn.mesh, 0, 0) == 0.5f);
  REQUIRE(ValueInRow<uint8_t>(cn.mesh, 0, 12) == 10);
  REQUIRE(ValueInRow<uint8_t>(cn.mesh, 0, 15) == 40);
}

TEST_CASE("OFF of other kinds is unsupported, and said so") {
  for (const char* text : {"OFF BINARY\n", "STOFF\n1 0 0\n", "4OFF\n1 0 0\n", "nOFF\n3\n"}) {
    const ReadOutcome outcome = ReadText("k.off", text);
    INFO(outcome.status.message());
    REQUIRE(outcome.status.code() == StatusCode::kUnsupported);
  }
}

TEST_CASE("OFF: bad input is refused with line, expectation and text") {
  const auto bad = [](const std::string& text, std::initializer_list<const char*> parts) {
    RequireBadInput("bad.off", text, parts);
  };
  bad("hello\n", {"line 1: expected 'OFF', found 'hello'"});
  bad("OFF\n", {"expected the counts 'V F E', found the end of the file"});
  bad("OFF\n3 x 0\n", {"line 2: expected the counts"});
  bad("OFF\n-3 1 0\n", {"line 2: expected the counts"});
  bad("OFF\n0 0 0\n", {"no vertices"});
  bad("OFF\n9000000000000000000 1 0\n0 0 0\n", {"line 2: the header promises 9000000000000000000"});
  bad("OFF\n1 9000000000000000000 0\n0 0 0\n", {"line 2: the header promises 1 vertices and 9000"});
  bad("OFF\n1 0 0\n0 0 zero\n", {"line 3: expected a number, found 'zero'"});
  bad("OFF\n1 0 0\n0 0 nan\n", {"line 3: z is nan"});
  bad("OFF\n2 0 0\n0 0 0\n0 0      \n", {"line 4: vertex 1: expected 3 numbers, found 2"});
  bad("COFF\n1 0 0\n0 0 0 256 0 0 0\n", {"line 3: expected a colour from 0 to 255, found '256'"});
  bad("COFF\n1 0 0\n0 0 0 0.5 0 1.5 0\n", {"line 3: expected a colour from 0 to 1, found '1.5'"});
  bad("OFF\n1 1 0\n0 0 0\n3 0 0 1\n",
      {"line 4: face 0: vertex index 1, but the file has 1 vertices"});
  bad("OFF\n1 1 0\n0 0 0\n3 0 0 -1\n", {"line 4: face 0: vertex index -1"});
  bad("OFF\n1 1 0\n0 0 0\n-3 0 0 0\n", {"line 4: face 0: expected a count", "'-3'"});
  bad("OFF\n1 1 0\n0 0 0\n4 0 0 0\n", {"line 4: face 0: expected 4 vertex indices, found 3"});
  bad("OFF\n1 1 0\n0 0 0\n999999999999 0\n", {"face 0: expected 999999999999 vertex indices"});
}

TEST_CASE("OFF: every prefix is refused, but for the last line end") {
  for (size_t n = 0; n + 1 < kQuad.size(); ++n) {
    CAPTURE(n);
    RequireBadInput("cut.off", kQuad.substr(0, n), {});
  }
  REQUIRE(ReadGood("cut.off", kQuad.substr(0, kQuad.size() - 1)).mesh.triangles.size() == 2);
}

}  // namespace
}  // namespace mtdb
