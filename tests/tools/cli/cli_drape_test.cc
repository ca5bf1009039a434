// SPDX-License-Identifier: Apache-2.0
// Images over terrains.
#include <cstring>

#include "tests/tools/terrain_testing.h"

namespace mtdb::test {
namespace {

struct Glb {
  Json json;
  std::string binary;
  explicit Glb(const std::string& path) {
    const std::string file = ReadText(path);
    uint32_t json_bytes = 0;
    std::memcpy(&json_bytes, &file.at(12), 4);
    json = ParseJson(file.substr(20, json_bytes));
    binary = file.substr(28 + json_bytes);
    CHECK(json.at("buffers").at(0).at("byteLength") == binary.size());
  }
  std::string View(int i) const {
    const Json& view = json.at("bufferViews").at(i);
    return binary.substr(view.value("byteOffset", 0), view.at("byteLength"));
  }
  float At(const std::string& name, size_t vertex, size_t component) const {
    const Json& attributes = json.at("meshes").at(0).at("primitives").at(0).at("attributes");
    const Json& accessor = json.at("accessors").at(attributes.at(name).get<size_t>());
    const size_t stride = json.at("bufferViews").at(1).at("byteStride");
    float value = 0;
    const std::string vertices = View(1);
    std::memcpy(&value,
                &vertices.at(vertex * stride + accessor.at("byteOffset").get<size_t>() +
                             component * sizeof(float)),
                sizeof(value));
    return value;
  }
};

TEST_CASE("an image with a world file is draped over a terrain", "[cli]") {
  const Folder folder;
  constexpr uint32_t kSide = 30;
  WriteGrid(folder.File("dem.asc"),
            "ncols 30\nnrows 30\nxllcenter 500000\nyllcenter 5100000\ncellsize 2\n", kSide,
            MakeHeights(kSide, kSide, 4));
  const std::string store = folder.File("s.mtdb"), image = folder.File("photo.png"),
                    out = folder.File("out.glb");
  RunOk({"ingest", folder.File("dem.asc"), store, "--name", "t"});
  RunOk({"render", store, image, "--size", "40x20"});
  CHECK(Run({"extract", store, out, "--drape", image}).exit_code != 0);  // it has no place
  // 40 x 20 pixels of 1.5 by 3 metres, turned by nothing, from 499999, 5100060 on.
  WriteText(folder.File("photo.pgw"), "1.5\n0\n0\n-3\n499999.75\n5100058.5\n");
  RunOk({"extract", store, out, "--drape", image, "--error", "5"});
  const Glb glb(out);
  CHECK(glb.View(2) == ReadText(image));
  CHECK(glb.json.at("images").at(0).at("mimeType") == "image/png");
  CHECK(glb.json.at("materials")
            .at(0)
            .at("pbrMetallicRoughness")
            .at("baseColorTexture")
            .at("index") == 0);
  const Json translation = glb.json.at("nodes").at(0).at("extras").at("origin");
  const size_t vertices = glb.json.at("accessors").at(1).at("count");
  REQUIRE(vertices > 10);
  for (size_t v = 0; v < vertices; ++v) {
    const double x = translation.at(0).get<double>() + glb.At("POSITION", v, 0);
    const double y = translation.at(1).get<double>() + glb.At("POSITION", v, 1);
    CHECK(glb.At("TEXCOORD_0", v, 0) == Approx((x - 499999) / 60).margin(1e-5));
    CHECK(glb.At("TEXCOORD_0", v, 1) == Approx((5100060 - y) / 60).margin(1e-5));
  }
  // It is a mesh as any other to those who read it.
  CHECK(ReadMesh(out).positions.size() == vertices);
  CHECK_THAT(Run({"extract", store, folder.File("out.ply"), "--drape", image}).err,
             Catch::Contains("only .glb"));
  WriteText(folder.File("photo.pgw"), "1.5\n0\n0\n-3\n99999.75\n5100058.5\n");
  CHECK_THAT(Run({"extract", store, out, "--drape", image}).err, Catch::Contains("elsewhere"));
  // Numbers that would make no, or no finite, texture coordinates.
  for (const char* numbers :
       {"1e-160 0 0 -1e-160 0 2", "1e-300 0 0 -1e300 0 2", "1e300 0 0 -1e-300 0 2",
        "1e200 0 0 1e200 0 2", "1e-9 0 0 -1e-9 500000 5100060"}) {
    INFO(numbers);
    WriteText(folder.File("photo.pgw"), numbers);
    std::filesystem::remove(out);
    const Outcome outcome = Run({"extract", store, out, "--drape", image});
    CHECK(outcome.exit_code == 1);
    CHECK(!std::filesystem::exists(out));
  }
  WriteText(folder.File("photo.pgw"), "1.5\n0\n0\n");
  CHECK_THAT(Run({"extract", store, out, "--drape", image}).err, Catch::Contains("six numbers"));
}

TEST_CASE("a GeoTIFF is draped as PNG", "[cli]") {
  if (MTDB_TEST_GDAL == 0 || std::system("gdal_translate --version > /dev/null 2>&1") != 0) {
    WARN("skipped: without GDAL or gdal-bin");
    return;
  }
  const Folder folder;
  WriteGrid(folder.File("dem.asc"),
            "ncols 30\nnrows 30\nxllcenter 500000\nyllcenter 5100000\ncellsize 2\n", 30,
            MakeHeights(30, 30, 4));
  const std::string store = folder.File("s.mtdb"), image = folder.File("photo.png"),
                    tif = folder.File("photo.tif"), out = folder.File("out.glb");
  RunOk({"ingest", folder.File("dem.asc"), store, "--name", "t"});
  RunOk({"render", store, image, "--size", "40x20"});
  REQUIRE(std::system(("gdal_translate -q -a_ullr 499999 5100060 500059 5100000 '" + image + "' '" +
                       tif + "' > /dev/null 2>&1")
                          .c_str()) == 0);
  RunOk({"extract", store, out, "--drape", tif});
  const Glb glb(out);
  CHECK(glb.View(2).starts_with("\x89PNG"));
  const Json translation = glb.json.at("nodes").at(0).at("extras").at("origin");
  const double x = translation.at(0).get<double>() + glb.At("POSITION", 7, 0);
  CHECK(glb.At("TEXCOORD_0", 7, 0) == Approx((x - 499999) / 60).margin(1e-5));
}

}  // namespace
}  // namespace mtdb::test
