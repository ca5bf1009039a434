// SPDX-License-Identifier: Apache-2.0
#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using testing::ReadGood;
using testing::ReadOutcome;
using testing::ReadText;
using testing::RequireBadInput;
using testing::ValueInRow;

const std::string kVertices = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

TEST_CASE("OBJ faces may be written in four ways and be polygons") {
  const ReadOutcome outcome =
      ReadGood("a.obj", "# a comment\n" + kVertices +
                            "vt 0 0\nvn 0 0 1\nf 1 2 3\nf 1/1 2/1 3/1\nf 1/1/1 2/1/1 4/1/1 # yes\n"
                            "f 1//1 2//1 3//1 4//1\nf 1 2\n");
  REQUIRE(outcome.report.format == "OBJ");
  REQUIRE(outcome.mesh.positions.size() == 4);
  REQUIRE(outcome.mesh.triangles ==
          std::vector<TriangleVertices>{{0, 1, 2}, {0, 1, 2}, {0, 1, 3}, {0, 1, 2}, {0, 2, 3}});
  REQUIRE(outcome.report.polygons == 1);
  REQUIRE(outcome.report.short_faces == 1);
}

TEST_CASE("OBJ negative indices count back from the face's place, positive ones may look ahead") {
  const ReadOutcome outcome =
      ReadGood("n.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nf 1 2 4\nv 0 1 0\nf -1 -2 -3\n");
  REQUIRE(outcome.mesh.triangles == std::vector<TriangleVertices>{{0, 1, 2}, {0, 1, 3}, {3, 2, 1}});
}

TEST_CASE("OBJ lines may be continued and end in CR LF") {
  const ReadOutcome outcome =
      ReadGood("c.obj", "v 0 0 \\\n0\r\nv 1 0 0\r\nv 1 \\\r\n1 \\\r\n0\r\nf 1 2 \\\n 3\r\n");
  REQUIRE(outcome.mesh.positions == std::vector<Vec3d>{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}});
  REQUIRE(outcome.mesh.triangles == std::vector<TriangleVertices>{{0, 1, 2}});
  RequireBadInput("c.obj", "v 0 0 \\\n0\nv 1 \\\n x 0\n", {"line 3", "found 'x'"});
}

TEST_CASE("OBJ colours of all vertices become bytes") {
  const ReadOutcome unit =
      ReadGood("u.obj", "v 0 0 0 1 0.5 0\nv 1 0 0 0.2 0 1\nv 0 1 0 0 0 0.0019\nf 1 2 3\n");
  REQUIRE(unit.mesh.header.attributes.attributes ==
          std::vector<VertexAttribute>{{"red", ScalarType::kUint8},
                                       {"green", ScalarType::kUint8},
                                       {"blue", ScalarType::kUint8}});
  REQUIRE(unit.mesh.rows == Bytes{std::byte{255}, std::byte{128}, std::byte{0}, std::byte{51},
                                  std::byte{0}, std::byte{255}, std::byte{0}, std::byte{0},
                                  std::byte{0}});
  const ReadOutcome bytes = ReadGood("b.obj", "v 0 0 0 200 0 7\nv 1 0 0 255 0 1\n");
  REQUIRE(ValueInRow<uint8_t>(bytes.mesh, 0, 0) == 200);
  REQUIRE(ValueInRow<uint8_t>(bytes.mesh, 1, 2) == 1);
}

TEST_CASE("OBJ colours of some vertices, or out of range, are ignored and reported") {
  const ReadOutcome some = ReadGood("s.obj", "v 0 0 0 1 0.5 0\nv 1 0 0\n");
  REQUIRE(some.mesh.header.attributes.empty());
  REQUIRE(some.report.ignored ==
          std::vector<std::string>{"vertex colours (not all vertices have one)"});
  const ReadOutcome range = ReadGood("r.obj", "v 0 0 0 1.5 0.5 0\nv 1 0 0 0 0 -0.5\n");
  REQUIRE(range.mesh.header.attributes.empty());
  REQUIRE(range.report.ignored == std::vector<std::string>{"vertex colours (not from 0 to 1)"});
}

TEST_CASE("OBJ statements that mtdb does not carry are reported once each") {
  const ReadOutcome outcome =
      ReadGood("i.obj",
               "mtllib a.mtl\no thing\ng part\nv 0 0 0 1\nvt 0 0\nvt 1 1\nvn 0 0 1\nusemtl m\n"
               "s off\ns 1\nl 1 1\n");
  REQUIRE(outcome.report.ignored ==
          std::vector<std::string>{"vertex weights", "1 material files", "1 object names",
                                   "1 groups", "2 texture coordinates", "1 normals",
                                   "1 uses of materials", "2 smoothing groups", "1 lines"});
}

TEST_CASE("OBJ positions are double when a number has more than nine significant digits") {
  const ReadOutcome single = ReadGood("s.obj", "v 0.123456789 1000000.5000000 0.00000000000012\n");
  REQUIRE_FALSE(single.mesh.header.double_positions);
  REQUIRE(single.mesh.header.from_text);
  REQUIRE(single.mesh.positions[0].x == 0.123456789);
  const ReadOutcome more = ReadGood("d.obj", "v 0.1 0 0\nv 0.1234567891 0 0\n");
  REQUIRE(more.mesh.header.double_positions);
  REQUIRE(more.mesh.positions[1].x == 0.1234567891);
  REQUIRE(more.mesh.positions[0].x == 0.1);
}

TEST_CASE("OBJ: bad lines are refused with line, expectation and text") {
  const auto bad = [](const std::string& text, std::initializer_list<const char*> parts) {
    RequireBadInput("bad.obj", text, parts);
  };
  bad("v 1 2\n", {"line 1: expected 'v X Y Z', found 2 numbers"});
  bad(kVertices + "v 1 2 3,5\n", {"line 5: expected a number, found '3,5'"});
  bad(kVertices + "v 1 nan 3\nf 1 2 5\n", {"line 5: y is nan", "the face of line 6"});
  bad(kVertices + "v 1 2 1e400\nf -1 2 3\n", {"line 5: z is inf"});
  bad(kVertices + "f 1 2 5\n", {"line 5: vertex index 5, but the file has 4 vertices"});
  bad(kVertices + "f 1 2 -5\n", {"line 5: vertex index -5, but the file has 4 vertices up to"});
  bad(kVertices + "f 0 1 2\n", {"line 5: vertex index 0", "counted from 1"});
  bad(kVertices + "f 1 2 x\n", {"line 5: expected a corner", "found 'x'"});
  bad(kVertices + "f 1 2 3/x\n", {"line 5: expected a corner", "found '3/x'"});
  bad(kVertices + "f 1 2 99999999999999999999\n", {"line 5: expected a corner"});
  bad("v 0 0 0 a b c\n", {"line 1: expected a colour, found 'a'"});
  bad("Dear reader,\nthis is a letter.\n", {"no vertices, expected lines 'v X Y Z'"});
}

TEST_CASE("OBJ: a prefix is a mesh, or refused with one line") {
  const std::string file = kVertices + "vn 0 0 1\nf 1//1 2//1 3//1\nf -1 -2 -3\n";
  size_t good = 0;
  for (size_t n = 0; n <= file.size(); ++n) {
    CAPTURE(n);
    const ReadOutcome outcome = ReadText("cut.obj", file.substr(0, n));
    if (outcome.status.ok()) {
      ++good;
      REQUIRE_FALSE(outcome.mesh.positions.empty());
    } else {
      RequireBadInput("cut.obj", file.substr(0, n), {});
    }
  }
  REQUIRE(good > 20);
  REQUIRE(good < file.size());
  RequireBadInput("cut.obj", kVertices.substr(0, 5), {"line 1"});
}

}  // namespace
}  // namespace mtdb
