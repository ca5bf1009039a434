// SPDX-License-Identifier: Apache-2.0
// What glTF files have besides plain accessors at plain nodes of one scene.
#include <catch2/catch.hpp>
#include <cmath>
#include <meshoptimizer.h>

#include "store/base/vertex_meaning.h"
#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using testing::AppendValue;
using testing::ReadGood;
using testing::ReadOutcome;
using testing::ReadText;
using testing::ValueInRow;

std::string Padded(std::string text, char with) {
  while (text.size() % 4 != 0) text += with;
  return text;
}

std::string Chunk(const std::string& type, const std::string& bytes) {
  std::string chunk;
  AppendValue(&chunk, static_cast<uint32_t>(bytes.size()));
  return chunk + type + bytes;
}

std::string GlbOf(const std::vector<std::string>& chunks) {
  std::string body;
  for (const std::string& chunk : chunks) body += chunk;
  std::string file = "glTF";
  AppendValue(&file, uint32_t{2});
  AppendValue(&file, static_cast<uint32_t>(12 + body.size()));
  return file + body;
}

const std::string kBin("BIN\0", 4);

// A file of buffer views and accessors, which are added one after the other.
class GltfBuilder {
 public:
  // Returns the view's number.
  size_t View(const std::string& bytes, const std::string& more = "") {
    views_ += (views_.empty() ? "" : ",") + std::string(R"({"buffer":0,"byteOffset":)") +
              std::to_string(binary_.size()) + R"(,"byteLength":)" + std::to_string(bytes.size()) +
              more + "}";
    binary_ += Padded(bytes, '\0');
    return view_count_++;
  }
  // `where`: its view and what else is in front of its type.
  size_t Accessor(const std::string& where, int component, size_t count, const char* type) {
    accessors_ += (accessors_.empty() ? "{" : ",{") + where + (where.empty() ? "" : ",") +
                  R"("componentType":)" + std::to_string(component) + R"(,"count":)" +
                  std::to_string(count) + R"(,"type":")" + type + "\"}";
    return accessor_count_++;
  }
  template <typename T>
  size_t Values(const std::vector<T>& values, int component, size_t count, const char* type,
                const std::string& more = "") {
    std::string bytes;
    for (const T& value : values) AppendValue(&bytes, value);
    return Accessor("\"bufferView\":" + std::to_string(View(bytes)) + more, component, count, type);
  }
  // `rest`: members behind buffers, views and accessors.
  std::string Json(const std::string& rest) const {
    return Padded(R"({"asset":{"version":"2.0"},"buffers":[{"byteLength":)" +
                      std::to_string(binary_.size()) + R"(}],"bufferViews":[)" + views_ +
                      R"(],"accessors":[)" + accessors_ + "]," + rest + "}",
                  ' ');
  }
  std::string Glb(const std::string& rest) const {
    return GlbOf({Chunk("JSON", Json(rest)), Chunk(kBin, binary_)});
  }
  const std::string& binary() const { return binary_; }

 private:
  std::string binary_, views_, accessors_;
  size_t view_count_ = 0, accessor_count_ = 0;
};

const std::vector<float> kTriangle{0, 0, 0, 1, 0, 0, 0, 1, 0};

std::string Mesh(const std::string& attributes) {
  return R"("meshes":[{"primitives":[{"attributes":{)" + attributes + "}}]}]";
}

bool Has(const ReadOutcome& outcome, const std::string& note) {
  return std::ranges::find(outcome.report.ignored, note) != outcome.report.ignored.end();
}

TEST_CASE("Sparse accessors are read, over values and over nothing") {
  for (const bool over_nothing : {false, true}) {
    GltfBuilder g;
    std::string indices, values;
    AppendValue(&indices, uint8_t{1});
    AppendValue(&indices, uint8_t{2});
    for (const float v : {5.f, 6.f, 7.f, 8.f, 9.f, 10.f}) AppendValue(&values, v);
    std::string base;
    for (const float v : kTriangle) AppendValue(&base, v);
    const size_t view = g.View(base), index_view = g.View(indices), value_view = g.View(values);
    g.Accessor((over_nothing ? "" : "\"bufferView\":" + std::to_string(view) + ",") +
                   R"("sparse":{"count":2,"indices":{"bufferView":)" + std::to_string(index_view) +
                   R"(,"componentType":5121},"values":{"bufferView":)" +
                   std::to_string(value_view) + "}}",
               5126, 3, "VEC3");
    const ReadOutcome outcome = ReadGood("a.glb", g.Glb(Mesh(R"("POSITION":0)")));
    CHECK(outcome.mesh.positions == std::vector<Vec3d>{{0, 0, 0}, {5, 6, 7}, {8, 9, 10}});
  }
}

TEST_CASE("An accessor without a bufferView has zeros") {
  GltfBuilder g;
  g.Values(kTriangle, 5126, 3, "VEC3");
  g.Accessor("", 5126, 3, "VEC3");
  const ReadOutcome outcome = ReadGood("a.glb", g.Glb(Mesh(R"("POSITION":0,"NORMAL":1)")));
  CHECK(outcome.mesh.header.attributes.attributes.size() == 3);
  CHECK(outcome.mesh.rows == Bytes(36));
}

TEST_CASE("Positions of double, as KHR_accessor_float64 has them") {
  GltfBuilder g;
  g.Values(std::vector<double>{0, 0, 0.1, 1, 0, 0, 0, 1, 0}, 5130, 3, "VEC3");
  const ReadOutcome outcome = ReadGood(
      "a.glb", g.Glb(R"("extensionsRequired":["KHR_accessor_float64"],)" + Mesh("\"POSITION\":0")));
  CHECK(outcome.mesh.positions[0].z == 0.1);
  CHECK(outcome.mesh.header.double_positions);
}

TEST_CASE("What other scenes and nodes outside of the scene have is counted") {
  GltfBuilder g;
  g.Values(kTriangle, 5126, 3, "VEC3");
  const auto read = [&](const std::string& rest) {
    return ReadGood("a.glb", g.Glb(rest + "," + Mesh(R"("POSITION":0)")));
  };
  const std::string nodes = R"("nodes":[{"mesh":0},{"mesh":0},{"name":"light"}])";
  const ReadOutcome two = read(R"("scenes":[{"nodes":[0]},{"nodes":[1,2]}],)" + nodes);
  CHECK(two.mesh.triangles.size() == 1);
  CHECK(Has(two, "1 other scene"));
  CHECK(Has(two, "1 node outside of the scene with its mesh"));
  const ReadOutcome one = read(R"("scenes":[{"nodes":[0]}],)" + nodes);
  CHECK(one.report.ignored ==
        std::vector<std::string>{"1 node outside of the scene with its mesh"});
  CHECK(read(R"("scenes":[{"nodes":[0,1]}],)" + nodes).report.ignored.empty());
  CHECK(read(nodes).mesh.triangles.size() == 2);
}

TEST_CASE("Extensions that move no triangle are no reason to refuse; others are, or are said") {
  GltfBuilder g;
  g.Values(kTriangle, 5126, 3, "VEC3");
  const auto with = [&](const std::string& list, const std::string& name) {
    return ReadText("a.glb",
                    g.Glb("\"" + list + "\":[\"" + name + "\"]," + Mesh("\"POSITION\":0")));
  };
  for (const char* name :
       {"KHR_lights_punctual", "KHR_xmp_json_ld", "KHR_animation_pointer", "KHR_node_visibility",
        "EXT_texture_avif", "KHR_texture_basisu", "KHR_materials_anything", "EXT_lights_ies",
        "EXT_structural_metadata", "KHR_mesh_quantization", "KHR_meshopt_compression"}) {
    CAPTURE(name);
    CHECK(with("extensionsRequired", name).status.ok());
    CHECK(with("extensionsUsed", name).report.ignored.empty());
  }
  for (const char* name : {"KHR_gaussian_splatting", "CESIUM_RTC", "EXT_other"}) {
    CAPTURE(name);
    CHECK_THAT(with("extensionsRequired", name).status.message(), Catch::Contains(name));
    const ReadOutcome used = with("extensionsUsed", name);
    CHECK(used.status.ok());
    CHECK(Has(used, std::string("extension ") + name));
  }
}

TEST_CASE("The chunk of vertices is found among unknown ones, and missed by its name") {
  GltfBuilder g;
  g.Values(kTriangle, 5126, 3, "VEC3");
  const std::string json = Chunk("JSON", g.Json(Mesh(R"("POSITION":0)")));
  const std::string bin = Chunk(kBin, g.binary()), odd = Chunk("ODD ", "1234");
  CHECK(ReadText("a.glb", GlbOf({json, odd, bin})).status.ok());
  CHECK(ReadText("a.glb", GlbOf({json, bin, odd})).status.ok());
  CHECK_THAT(ReadText("a.glb", GlbOf({json, odd})).status.message(),
             Catch::Contains("nor a chunk of type BIN"));
}

TEST_CASE("Instances are placed by translation, rotation and scale within their node") {
  GltfBuilder g;
  g.Values(kTriangle, 5126, 3, "VEC3");
  g.Values(std::vector<float>{10, 0, 0, 20, 0, 0}, 5126, 2, "VEC3");
  g.Values(std::vector<int8_t>{0, 0, 0, 127, 0, 0, 127, 0}, 5120, 2, "VEC4",
           ",\"normalized\":true");
  g.Values(std::vector<float>{1, 1, 1, 2, 2, 2}, 5126, 2, "VEC3");
  const auto node = [](const std::string& attributes) {
    return R"("nodes":[{"mesh":0,"translation":[0,0,5],"extensions":{"EXT_mesh_gpu_instancing":)"
           R"({"attributes":{)" +
           attributes + "}}}}],";
  };
  const ReadOutcome outcome = ReadGood(
      "a.glb", g.Glb(node(R"("TRANSLATION":1,"ROTATION":2,"SCALE":3)") + Mesh(R"("POSITION":0)")));
  REQUIRE(outcome.mesh.positions.size() == 6);
  CHECK(Length(outcome.mesh.positions[1] - Vec3d{11, 0, 5}) < 1e-12);
  CHECK(Length(outcome.mesh.positions[4] - Vec3d{18, 0, 5}) < 1e-12);
  CHECK(outcome.mesh.triangles.size() == 2);
  const ReadOutcome wrong =
      ReadText("a.glb", g.Glb(node(R"("TRANSLATION":1,"SCALE":0)") + Mesh(R"("POSITION":0)")));
  CHECK_THAT(wrong.status.message(), Catch::Contains("SCALE"));
}

TEST_CASE("Attributes of glTF whose names none may have get others, which is said") {
  GltfBuilder g;
  g.Values(kTriangle, 5126, 3, "VEC3");
  g.Values(std::vector<float>{1, 2, 3}, 5126, 3, "SCALAR");
  const ReadOutcome outcome = ReadGood(
      "a.glb", g.Glb(Mesh(R"("POSITION":0,"_x":1,"_a\nproperty float b":1,"_A":1,"_a":1)")));
  std::vector<std::string> names;
  for (const auto& a : outcome.mesh.header.attributes.attributes) names.push_back(a.name);
  std::ranges::sort(names);
  CHECK(names == std::vector<std::string>{"a", "a_2", "a_property float b", "x_2"});
  CHECK(Has(outcome, "the name of attribute _x, which is x_2"));
  for (const std::string& note : outcome.report.ignored)
    CHECK(note.find('\n') == std::string::npos);
}

TEST_CASE("Colours are linear in glTF, in all the types that it has for them") {
  const auto read = [](auto values, int component, const char* more) {
    GltfBuilder g;
    g.Values(kTriangle, 5126, 3, "VEC3");
    g.Values(values, component, 3, "VEC3", more);
    return ReadGood("a.glb", g.Glb(Mesh(R"("POSITION":0,"COLOR_0":1)"))).mesh;
  };
  const auto check = [](const TriangleMesh& mesh) {
    CHECK(ValueInRow<uint8_t>(mesh, 0, 0) == 0);
    CHECK(ValueInRow<uint8_t>(mesh, 0, 1) == 188);  // half the light
    CHECK(ValueInRow<uint8_t>(mesh, 0, 2) == 255);
  };
  const std::vector<uint8_t> bytes{0, 128, 255, 0, 0, 0, 0, 0, 0};
  const std::vector<uint16_t> shorts{0, 32768, 65535, 0, 0, 0, 0, 0, 0};
  check(read(bytes, 5121, ",\"normalized\":true"));
  check(read(bytes, 5121, ""));
  check(read(shorts, 5123, ",\"normalized\":true"));
  check(read(std::vector<float>{0, 0.5f, 1, 0, 0, 0, 0, 0, 0}, 5126, ""));
}

// A view that meshoptimizer has compressed, under the name of either extension.
template <typename T>
size_t MeshoptView(GltfBuilder* g, const char* extension, const std::vector<T>& values,
                   size_t count, const char* filter) {
  const size_t stride = values.size() * sizeof(T) / count;
  std::vector<unsigned char> packed(meshopt_encodeVertexBufferBound(count, stride));
  packed.resize(
      meshopt_encodeVertexBuffer(packed.data(), packed.size(), values.data(), count, stride));
  const size_t raw = g->View(std::string(packed.begin(), packed.end()));
  CHECK(raw % 2 == 0);
  // The raw bytes lie in front of the view that stands for them.
  const size_t offset =
      g->binary().size() - Padded(std::string(packed.begin(), packed.end()), '\0').size();
  return g->View("", R"(,"extensions":{")" + std::string(extension) +
                         R"(":{"buffer":0,"byteOffset":)" + std::to_string(offset) +
                         R"(,"byteLength":)" + std::to_string(packed.size()) + R"(,"byteStride":)" +
                         std::to_string(stride) + R"(,"count":)" + std::to_string(count) +
                         R"(,"mode":"ATTRIBUTES","filter":")" + filter + "\"}}");
}

TEST_CASE("Views are decompressed by meshoptimizer under both names, colours by their filter") {
  for (const char* extension : {"EXT_meshopt_compression", "KHR_meshopt_compression"}) {
    GltfBuilder g;
    const size_t positions = MeshoptView(&g, extension, kTriangle, 3, "NONE");
    // Luma, orange, green, alpha: white, red and half of blue, of 8 bits; opaque.
    const std::vector<uint8_t> coded{255, 0, 0, 255, 64, 127, 192, 255, 32, 192, 224, 255};
    const size_t colours = MeshoptView(&g, extension, coded, 3, "COLOR");
    g.Accessor("\"bufferView\":" + std::to_string(positions), 5126, 3, "VEC3");
    g.Accessor("\"bufferView\":" + std::to_string(colours) + ",\"normalized\":true", 5121, 3,
               "VEC4");
    const TriangleMesh mesh =
        ReadGood("a.glb", g.Glb(R"("extensionsRequired":[")" + std::string(extension) + "\"]," +
                                Mesh(R"("POSITION":0,"COLOR_0":1)")))
            .mesh;
    CHECK(mesh.positions == std::vector<Vec3d>{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
    const auto colour = [&](size_t v) {
      std::array<int, 4> c{};
      for (size_t i = 0; i < 4; ++i) c[i] = ValueInRow<uint8_t>(mesh, v, i);
      return c;
    };
    CHECK(colour(0) == std::array<int, 4>{255, 255, 255, 255});
    CHECK(colour(1) == std::array<int, 4>{255, 0, 13, 255});  // blue of 1 in 255 of light
    CHECK(colour(2) == std::array<int, 4>{0, 0, 188, 255});
  }
}

}  // namespace
}  // namespace mtdb
