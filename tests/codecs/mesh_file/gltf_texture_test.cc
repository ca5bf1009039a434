// SPDX-License-Identifier: Apache-2.0
// Textures of glTF files.
#include <algorithm>
#include <catch2/catch.hpp>

#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using testing::AppendValue;
using testing::ReadOutcome;
using testing::ReadPath;
using testing::ScratchFolder;

constexpr uint32_t kNoPage = TextureCorner::kNoPage;

// A JPEG of 48 x 32 pixels up to its frame, behind a segment that is longer than what is read at
// once.
std::string Jpeg() {
  std::string jpeg = "\xff\xd8";
  jpeg += std::string("\xff\xe1\x01\x00", 4) + std::string(254, 'x');
  jpeg += std::string("\xff\xff\xc2\x00\x11\x08\x00\x20\x00\x30\x03", 11);
  return jpeg + std::string(12, '\0');
}

std::string Padded(std::string text, char with) {
  while (text.size() % 4 != 0) text += with;
  return text;
}

std::string Glb(const std::string& json, const std::string& binary) {
  const std::string text = Padded(json, ' '), bytes = Padded(binary, '\0');
  std::string file = "glTF";
  for (const size_t n : {size_t{2}, 28 + text.size() + bytes.size(), text.size()}) {
    AppendValue(&file, static_cast<uint32_t>(n));
  }
  file += "JSON" + text;
  AppendValue(&file, static_cast<uint32_t>(bytes.size()));
  return file + std::string("BIN\0", 4) + bytes;
}

// Triangles of three vertices each; accessor 0 has positions, 1 coordinates as floats, 2 as bytes,
// 3 as 16 bits, 4 one number too few; view 5 is an image.
std::string File(const std::string& primitives, const std::string& rest) {
  std::string binary;
  std::string views, accessors;
  size_t views_count = 0;
  const auto view = [&](const std::string& bytes) {
    views += std::string(views.empty() ? "" : ",") + R"({"buffer":0,"byteOffset":)" +
             std::to_string(binary.size()) + R"(,"byteLength":)" + std::to_string(bytes.size()) +
             "}";
    binary += Padded(bytes, '\0');
    return views_count++;
  };
  const auto accessor = [&](const std::string& bytes, int component, const char* type,
                            const char* more) {
    accessors += std::string(accessors.empty() ? "" : ",") + R"({"bufferView":)" +
                 std::to_string(view(bytes)) + R"(,"componentType":)" + std::to_string(component) +
                 R"(,"count":3,"type":")" + type + "\"" + more + "}";
  };
  std::string positions, floats, bytes, shorts, few;
  for (const float v : {0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 0.f}) AppendValue(&positions, v);
  for (const float v : {0.f, 1.f, 0.5f, 0.25f, 2.f, -1.f}) AppendValue(&floats, v);
  for (const int v : {0, 255, 51, 0, 255, 255}) AppendValue(&bytes, static_cast<uint8_t>(v));
  for (const int v : {0, 65535, 13107, 0, 65535, 65535})
    AppendValue(&shorts, static_cast<uint16_t>(v));
  accessor(positions, 5126, "VEC3", "");
  accessor(floats, 5126, "VEC2", "");
  accessor(bytes, 5121, "VEC2", R"(,"normalized":true)");
  accessor(shorts, 5123, "VEC2", R"(,"normalized":true)");
  accessor(floats, 5126, "SCALAR", "");
  view(Jpeg());
  return Glb(R"({"asset":{"version":"2.0"},"buffers":[{"byteLength":)" +
                 std::to_string(binary.size()) + R"(}],"bufferViews":[)" + views +
                 R"(],"accessors":[)" + accessors + R"(],"meshes":[{"primitives":[)" + primitives +
                 "]}]" + rest + "}",
             binary);
}

std::string Primitive(const std::string& attributes, int material) {
  return R"({"attributes":{"POSITION":0)" + attributes + "}" +
         (material < 0 ? "" : R"(,"material":)" + std::to_string(material)) + "}";
}
std::string Material(const std::string& info) {
  return R"({"pbrMetallicRoughness":{"baseColorTexture":{)" + info + "}}}";
}

ReadOutcome ReadBack(const std::string& path) {
  ReadOutcome outcome = ReadPath(path);
  INFO(outcome.status.message());
  REQUIRE(outcome.status.ok());
  return outcome;
}
ReadOutcome ReadGoodFile(const std::string& file) {
  const ScratchFolder folder;
  return ReadBack(folder.Write("a.glb", file));
}
bool Mentions(const ReadOutcome& outcome, const std::string& what) {
  return std::ranges::any_of(outcome.report.ignored, [&](const std::string& line) {
    return line.find(what) != std::string::npos;
  });
}

void CheckCorner(const TextureCorner& corner, double u, double v, uint32_t page) {
  CHECK(corner.u == Approx(u).margin(1e-6));
  CHECK(corner.v == Approx(v).margin(1e-6));
  CHECK(corner.page == page);
}

TEST_CASE("glTF: each primitive has its image and its coordinates, with v up") {
  const std::string rest =
      R"(,"materials":[)" + Material(R"("index":0)") + "," + Material(R"("index":1,"texCoord":1)") +
      R"(,{"name":"plain"},)" + Material(R"("index":0)") +
      R"(],"textures":[{"source":1},{"extensions":{"EXT_texture_webp":{"source":0}}}],"images":[)"
      R"({"bufferView":5,"mimeType":"image/jpeg","name":"photo"},)"
      R"({"uri":"data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAQAAAAG"},{"bufferView":5}])";
  const ReadOutcome read = ReadGoodFile(File(
      Primitive(R"(,"TEXCOORD_0":1)", 0) + "," + Primitive(R"(,"TEXCOORD_0":1,"TEXCOORD_1":2)", 1) +
          "," + Primitive(R"(,"TEXCOORD_0":3)", 2) + "," + Primitive("", 0) + "," +
          Primitive(R"(,"TEXCOORD_0":3)", 3) + "," + Primitive(R"(,"TEXCOORD_0":4)", 0),
      rest));
  const auto& corners = read.mesh.corners;
  REQUIRE(corners.size() == 18);
  CheckCorner(corners[0], 0, 0, 0);
  CheckCorner(corners[1], 0.5, 0.75, 0);
  CheckCorner(corners[2], 2, 2, 0);
  CheckCorner(corners[4], 0.2, 1, 1);
  CheckCorner(corners[7], 0.2, 1, kNoPage);
  CheckCorner(corners[10], 0, 0, kNoPage);
  CheckCorner(corners[13], 0.2, 1, 0);
  CheckCorner(corners[16], 0, 0, kNoPage);
  const auto& pages = read.mesh.header.textures;
  REQUIRE(pages.size() == 2);
  CHECK(pages[0].name == "image_1.png");
  CHECK(pages[0].media_type == "image/png");
  CHECK(pages[0].width == 4);
  CHECK(pages[0].height == 6);
  CHECK(pages[1].name == "photo.jpg");
  CHECK(pages[1].width == 48);
  CHECK(pages[1].height == 32);
  CHECK(AsString(*pages[1].load()) == Jpeg());
  CHECK(read.mesh.header.attributes.empty());
  CHECK(Mentions(read, "6 texture coordinates"));
  CHECK(Mentions(read, "1 materials"));
  CHECK(Mentions(read, "1 images"));
}

TEST_CASE("glTF: KHR_texture_transform scales, turns and moves coordinates") {
  const auto with = [](const std::string& transform) {
    return File(
        Primitive(R"(,"TEXCOORD_0":1,"TEXCOORD_1":3)", 0),
        R"(,"materials":[)" +
            Material(R"("index":0,"extensions":{"KHR_texture_transform":{)" + transform + "}}") +
            R"(],"textures":[{"source":0}],"images":[{"bufferView":5}],)"
            R"("extensionsRequired":["KHR_texture_transform"])");
  };
  const auto corners = ReadGoodFile(with(R"("offset":[0.25,0.5],"scale":[2,3])")).mesh.corners;
  CheckCorner(corners[1], 0.25 + 2 * 0.5, 1 - (0.5 + 3 * 0.25), 0);
  // A quarter of a turn, counter-clockwise as it is seen with v down: (1, 0) goes up to (0, -1).
  const auto turned =
      ReadGoodFile(with(R"("rotation":1.5707963267948966,"scale":[2,3],"offset":[7,0])"))
          .mesh.corners;
  CheckCorner(turned[1], 7 + 3 * 0.25, 1 + 2 * 0.5, 0);
  CheckCorner(ReadGoodFile(with(R"("texCoord":1)")).mesh.corners[1], 0.2, 1, 0);
  for (const char* wrong : {R"("offset":[1])", R"("scale":["a",1])", R"("rotation":{})"}) {
    const ScratchFolder folder;
    CHECK(ReadPath(folder.Write("a.glb", with(wrong))).status.code() == StatusCode::kBadInput);
  }
  // Numbers beyond those of coordinates are those of no place.
  CHECK(ReadGoodFile(with(R"("scale":[1e300,1e300])")).mesh.corners[1] ==
        TextureCorner{0, 0, kNoPage});
}

TEST_CASE("glTF: coordinates of all primitives are kept without an image, those of some are not") {
  const ReadOutcome all = ReadGoodFile(
      File(Primitive(R"(,"TEXCOORD_0":1)", -1) + "," + Primitive(R"(,"TEXCOORD_0":2)", 0),
           R"(,"materials":[{}])"));
  REQUIRE(all.mesh.header.textured);
  REQUIRE(all.mesh.header.textures.size() == 1);
  CHECK(all.mesh.header.textures[0].load == nullptr);
  CheckCorner(all.mesh.corners[4], 0.2, 1, 0);
  const ReadOutcome some =
      ReadGoodFile(File(Primitive(R"(,"TEXCOORD_0":1)", -1) + "," + Primitive("", -1), ""));
  CHECK_FALSE(some.mesh.header.textured);
  CHECK(some.mesh.corners.empty());
  CHECK(Mentions(some, "3 texture coordinates"));
}

TEST_CASE("glTF: images that are nowhere, or not where they should be, refuse nothing") {
  const ScratchFolder folder;
  for (const char* image :
       {R"({"uri":"gone.png"})", R"({"uri":"../a.png"})", R"({"uri":"data:image/png,x"})",
        R"({"bufferView":99})", R"({"bufferView":-1})", "{}", R"({"uri":7})", "7",
        R"({"bufferView":5,"name":7})",
        R"({"uri":"data:;base64,AAAA","name":"../a/b\u0000.png"})"}) {
    INFO(image);
    const ReadOutcome read = ReadBack(
        folder.Write("a.glb", File(Primitive(R"(,"TEXCOORD_0":1)", 0),
                                   R"(,"materials":[)" + Material(R"("index":0)") +
                                       R"(],"textures":[{"source":0}],"images":[)" + image + "]")));
    REQUIRE(read.mesh.header.textures.size() == 1);
    CHECK(read.mesh.corners[0].page == 0);
    const Texture& page = read.mesh.header.textures[0];
    REQUIRE(page.load != nullptr);
    (void)page.load();
    CHECK(page.name.find_first_of(std::string("/\\\0", 3)) == std::string::npos);
  }
  for (const char* wrong : {R"("index":9)", R"("index":"x")", "", R"("index":0,"texCoord":99)",
                            R"("index":0,"texCoord":-1)"}) {
    INFO(wrong);
    ReadBack(folder.Write("a.glb", File(Primitive(R"(,"TEXCOORD_0":1)", 0),
                                        R"(,"materials":[)" + Material(wrong) +
                                            R"(],"textures":[{"source":7}],"images":[])")));
  }
}

TEST_CASE("Sizes of images of all kinds are found, and garbage has none") {
  const ScratchFolder folder;
  const auto page_of = [&](const std::string& bytes) {
    folder.Write("a.img", bytes);
    const ReadOutcome read = ReadBack(
        folder.Write("a.ply",
                     "ply\nformat ascii 1.0\ncomment TextureFile a.img\nelement vertex 1\n"
                     "property float x\nproperty float y\nproperty float z\nproperty float s\n"
                     "property float t\nend_header\n0 0 0 0 0\n"));
    return read.mesh.header.textures.at(0);
  };
  const auto check = [&](const std::string& bytes, const char* type, uint32_t w, uint32_t h) {
    const Texture page = page_of(bytes);
    CHECK(page.media_type == type);
    CHECK(page.width == w);
    CHECK(page.height == h);
    for (size_t size = 0; size < bytes.size(); ++size) (void)page_of(bytes.substr(0, size));
  };
  check(std::string("RIFF....WEBPVP8X....\0\0\0\0\x0f\x01\0\x1f\0\0", 30), "image/webp", 272, 32);
  check(std::string("RIFF....WEBPVP8L....\x2f\x0f\xc0\x07\0\0", 26), "image/webp", 16, 32);
  check(std::string("RIFF....WEBPVP8 .......\x9d\x01\x2a\x10\0\x20\0", 30), "image/webp", 16, 32);
  check(std::string("II*\0\x08\0\0\0\x02\0\0\x01\x03\0\x01\0\0\0\x10\0\xff\xff"
                    "\x01\x01\x04\0\x01\0\0\0\x20\0\0\0",
                    34),
        "image/tiff", 16, 32);
  check(std::string("MM\0*\0\0\0\x08\0\x02\x01\0\0\x03\0\0\0\x01\0\x10\xff\xff"
                    "\x01\x01\0\x04\0\0\0\x01\0\0\0\x20",
                    34),
        "image/tiff", 16, 32);
  check(Jpeg().substr(0, 2) + Jpeg().substr(260), "image/jpeg", 48, 32);
  uint32_t state = 3;
  for (int i = 0; i < 300; ++i) {
    std::string bytes = i % 4 == 0   ? "\xff\xd8\xff"
                        : i % 4 == 1 ? std::string("II*\0", 4)
                        : i % 4 == 2 ? "RIFF....WEBPVP8 "
                                     : std::string("MM\0*", 4);
    for (int k = 0; k < 200; ++k) {
      state = state * 1664525 + 1013904223;
      bytes += static_cast<char>(state >> 24);
    }
    (void)page_of(bytes);
  }
}

}  // namespace
}  // namespace mtdb
