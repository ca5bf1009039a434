// SPDX-License-Identifier: Apache-2.0
// What extract says of the file that it has written, and what is in it.
#include <catch2/catch.hpp>
#include <cstring>

#include "codecs/mesh_file/mesh_file.h"
#include "tests/tools/cli_testing.h"
#include "tools/request/mesh_output.h"

namespace mtdb::test {
namespace {

// Two triangles at `offset`, with these properties beside x, y and z, and their values at each
// vertex.
std::string SquarePly(const std::string& properties, const std::string& values, Vec3d offset = {},
                      const std::string& type = "double") {
  std::string text = "ply\nformat ascii 1.0\nelement vertex 4\n";
  for (const char* axis : {"x", "y", "z"}) text += "property " + type + " " + axis + "\n";
  text += properties + "element face 2\nproperty list uchar int vertex_indices\nend_header\n";
  for (const auto& [x, y] : {std::pair(0.1, 0.2), {1.3, 0.2}, {1.3, 1.7}, {0.1, 1.7}}) {
    char line[128];
    std::snprintf(line, sizeof(line), "%.12g %.12g %.12g ", offset.x + x, offset.y + y, offset.z);
    text += line + values + "\n";
  }
  return text + "3 0 1 2\n3 0 2 3\n";
}

TriangleMesh MeshOf(const std::string& path) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  const Status status = ReadMeshFile(path, sink, nullptr);
  INFO(status.message());
  REQUIRE(status.ok());
  return mesh;
}

bool HasType(const std::string& path, const char* type) {
  return ReadText(path).find(std::string("property ") + type + " x\n") != std::string::npos;
}

TEST_CASE("an origin is told where the file's positions are offsets, and nowhere else", "[cli]") {
  const Folder folder;
  WriteText(folder.File("a.ply"), SquarePly("", "", {431234.567, 4812345.678, 321.09}));
  RunOk({"ingest", folder.File("a.ply"), folder.File("s.mtdb"), "--quiet"});
  for (const char* file : {"o.obj", "o.ply", "o.off", "o.glb", "o.stl", "o.drc"}) {
    CAPTURE(file);
    const std::string name = file;
    const bool offsets = name == "o.stl" || name == "o.drc", node = name == "o.glb";
    const Json json = RunJson({"extract", folder.File("s.mtdb"), folder.File(file)});
    CHECK(json.at("origin").is_null() == !offsets);
    CHECK(json.at("node_origin").is_null() == !node);
    const std::string said = RunOk({"extract", folder.File("s.mtdb"), folder.File(file)});
    CHECK((said.find("are offsets from ") != std::string::npos) == (offsets || node));
    CHECK((said.find("which its node holds") != std::string::npos) == node);
    // mtdb's own readers give all of them back.
    CHECK(Length(MeshOf(folder.File(file)).positions[0] - Vec3d{431234.667, 4812345.878, 321.09}) <
          (name == "o.drc" ? 3 : 1e-6));
  }
}

TEST_CASE("floats come back as floats, bit for bit; doubles where they are asked for", "[cli]") {
  const Folder folder;
  WriteText(folder.File("a.ply"), SquarePly("", "", {1, 2, 3}, "float"));
  const TriangleMesh input = MeshOf(folder.File("a.ply"));
  for (const char* how : {"--bits=16", "--lossless", ""}) {
    Arguments ingest{"ingest", folder.File("a.ply"), folder.File("s.mtdb"), "--quiet", "--replace"};
    if (*how != 0) ingest.push_back(how);
    RunOk(ingest);
    const Json json = RunJson({"extract", folder.File("s.mtdb"), folder.File("o.ply")});
    CAPTURE(how);
    CHECK(json.at("positions") == "float32");
    CHECK(HasType(folder.File("o.ply"), "float"));
    const Json forced =
        RunJson({"extract", folder.File("s.mtdb"), folder.File("d.ply"), "--double-positions"});
    CHECK(forced.at("positions") == "float64");
    CHECK(HasType(folder.File("d.ply"), "double"));
    if (std::string(how) == "--bits=16") continue;
    // Kept without loss, or as decimals: the floats that were read.
    for (const Vec3d& p : MeshOf(folder.File("o.ply")).positions) {
      CHECK(std::any_of(input.positions.begin(), input.positions.end(), [&](const Vec3d& q) {
        return Length(p - Vec3d{double{static_cast<float>(q.x)}, double{static_cast<float>(q.y)},
                                double{static_cast<float>(q.z)}}) == 0;
      }));
    }
  }
  RunFails(1, {"extract", folder.File("s.mtdb"), folder.File("o.stl"), "--double-positions"},
           {"no positions of float64", ".ply"});
}

TEST_CASE("what a format has no place for is said, in text and JSON", "[cli]") {
  const Folder folder;
  WriteText(folder.File("a.ply"),
            SquarePly("property double nx\nproperty double ny\nproperty double nz\n"
                      "property float red\nproperty float green\nproperty float blue\n"
                      "property float quality\n",
                      "0 0 1 0.25 0.5 1 7"));
  RunOk({"ingest", folder.File("a.ply"), folder.File("s.mtdb"), "--quiet"});
  const auto extract = [&](const std::string& name, const char* option = nullptr) {
    Arguments arguments{"extract", folder.File("s.mtdb"), folder.File(name)};
    if (option != nullptr) arguments.push_back(option);
    return RunJson(arguments);
  };
  CHECK(extract("o.stl").at("not_written").size() == 2);
  CHECK_THAT(RunOk({"extract", folder.File("s.mtdb"), folder.File("o.stl")}),
             Catch::Contains("  not written: nx, ny, nz (float64), red, green, blue, quality "
                             "(float32)\n"));
  CHECK(extract("o.obj").at("not_written") == Json::array({"quality (float32)"}));
  CHECK_THAT(ReadText(folder.File("o.obj")), Catch::Contains(" 0.25 0.5 1\n"));
  CHECK(extract("o.glb").at("not_written").empty());
  CHECK_THAT(ReadText(folder.File("o.glb")),
             Catch::Contains("\"NORMAL\"") && Catch::Contains("\"COLOR_0\""));
  CHECK(extract("o.off").at("not_written") ==
        Json::array({"nx, ny, nz (float64)", "quality (float32)"}));
  CHECK(ReadText(folder.File("o.off")).starts_with("COFF\n"));
  CHECK(extract("o.off", "--normals").at("not_written") == Json::array({"quality (float32)"}));
  CHECK(ReadText(folder.File("o.off")).starts_with("CNOFF\n"));
  CHECK(extract("o.ply").at("not_written").empty());
}

TEST_CASE("a terrain's z is up, and degrees and feet are metres in a .glb; meshes stay", "[cli]") {
  ObjectRecord record;
  record.bounds.Add(Vec3d{10, 59, 0});
  record.bounds.Add(Vec3d{12, 61, 100});
  CHECK(!MeshOptionsOf(record, false).up_frame);
  CHECK(MeshOptionsOf(record, true).off_normals);
  record.error_measure = ErrorMeasure::kVertical;
  CHECK(MeshOptionsOf(record, false).up_frame->metres == Vec3d{1, 1, 1});
  record.raster.emplace();
  record.raster->height_units = "ft";
  record.georeference = "PROJCRS[...]";
  CHECK(MeshOptionsOf(record, false).up_frame->metres == Vec3d{1, 1, 1});
  record.georeference = "GEOGCRS[...]";
  const auto frame = *MeshOptionsOf(record, false).up_frame;
  CHECK(frame.metres.x == Approx(111195 * 0.5));
  CHECK(frame.metres.y == Approx(111195));
  CHECK(frame.metres.z == 0.3048);
  CHECK(frame.metres_from == Vec3d{11, 60, 0});
}

TEST_CASE("what a server says of a file is read, and nothing else", "[cli]") {
  MeshWriteReport report;
  report.positions = "float32";
  report.origin = Vec3d{1, 2.5, -3};
  report.not_written = {"a, b (uint8)"};
  report.notes = {"a note"};
  const MeshWriteReport back = ParseMeshFile(MeshFileJson(report).Text());
  CHECK(MeshFileJson(back) == MeshFileJson(report));
  CHECK(MeshFileText(back) ==
        "  float32 positions in the file are offsets from 1.0 2.5 -3.0\n"
        "  not written: a, b (uint8)\n  a note\n");
  for (const char* text : {"", "null", "[]", "{}", R"({"origin":[1,2],"notes":[1],"positions":3})",
                           R"({"origin":["a",2,3],"not_written":"x"})"}) {
    CHECK(MeshFileText(ParseMeshFile(text)).empty());
  }
}

}  // namespace
}  // namespace mtdb::test
