// SPDX-License-Identifier: Apache-2.0
// What `mtdb extract` writes as binary glTF.
#include <cstring>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

Json Description(const std::string& path) {
  const std::string bytes = ReadText(path);
  REQUIRE(bytes.starts_with("glTF"));
  uint32_t length = 0;
  std::memcpy(&length, bytes.data() + 12, sizeof(length));
  return ParseJson(bytes.substr(20, length));
}

TEST_CASE("extract writes .glb with colours, normals and scalars", "[cli]") {
  const Folder folder;
  std::string text = "ply\nformat ascii 1.0\nelement vertex 4\n";
  for (const char* axis : {"x", "y", "z"}) text += std::string("property double ") + axis + "\n";
  for (const char* n : {"nx", "ny", "nz"}) text += std::string("property float ") + n + "\n";
  for (const char* c : {"red", "green", "blue"}) text += std::string("property uchar ") + c + "\n";
  text += "property float quality\nelement face 2\nproperty list uchar int vertex_indices\n";
  text += "end_header\n";
  for (const char* corner : {"4512345.25 5401234.5", "4512346.25 5401234.5", "4512346.25 5401235.5",
                             "4512345.25 5401235.5"}) {
    text += std::string(corner) + " 7 0 0 2 10 20 30 0.5\n";
  }
  WriteText(folder.File("square.ply"), text + "3 0 1 2\n3 0 2 3\n");
  RunOk({"ingest", folder.File("square.ply"), folder.File("s.mtdb"), "--quiet"});
  const std::string output = folder.File("square.glb");
  const Json json = RunJson({"extract", folder.File("s.mtdb"), output});
  CHECK(json.at("triangles") == 2);
  const Json description = Description(output);
  const Json& attributes = description.at("meshes").at(0).at("primitives").at(0).at("attributes");
  for (const char* name : {"POSITION", "NORMAL", "COLOR_0", "_QUALITY"}) {
    INFO(name);
    CHECK(attributes.contains(name));
  }
  CHECK(attributes.size() == 4);
  const Json& translation = description.at("nodes").at(0).at("translation");
  CHECK(translation.at(0).get<double>() == Approx(4512345.75).margin(0.6));
  const Json& position = description.at("accessors").at(attributes.at("POSITION").get<size_t>());
  CHECK(position.at("count") == 4);
  CHECK(position.at("max").at(0).get<double>() - position.at("min").at(0).get<double>() ==
        Approx(1).margin(1e-4));
}

TEST_CASE("a .glb file of nothing is a scene without a mesh", "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  const std::string output = folder.File("nothing.glb");
  const Json json = RunJson({"extract", example.store, output, "--sphere", "1000,0,0,1", "--clip"});
  CHECK(json.at("triangles") == 0);
  CHECK_FALSE(Description(output).contains("meshes"));
  RunOk({"extract", example.store, output});
  CHECK(Description(output).at("meshes").size() == 1);
}

}  // namespace
}  // namespace mtdb::test
