// SPDX-License-Identifier: Apache-2.0
// Binary glTF, taken apart by the specification with another JSON parser. tools/validate_gltf holds
// such files against the Khronos validator.
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>

#include "store/base/vertex_meaning.h"
#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using nlohmann::json;
using testing::ColouredTetrahedron;
using testing::ReadBytes;
using testing::ScratchFolder;
using testing::Tetrahedron;
using testing::ValueInRow;
using testing::WriteMesh;

struct Glb {
  json description;
  std::string binary;

  // Component `c` of element `i`, as a double.
  double At(const json& accessor, size_t i, size_t c) const {
    const json& view = description.at("bufferViews").at(accessor.at("bufferView").get<size_t>());
    const int type = accessor.at("componentType");
    const size_t size = type <= 5121 ? 1 : type <= 5123 ? 2 : 4;
    const size_t components = Components(accessor);
    const size_t stride = view.value("byteStride", size * components);
    const size_t at = view.value("byteOffset", size_t{0}) +
                      accessor.value("byteOffset", size_t{0}) + i * stride + c * size;
    REQUIRE(at + size <= binary.size());
    const auto as = [&]<typename T>(T value) {
      std::memcpy(&value, binary.data() + at, sizeof(value));
      return static_cast<double>(value);
    };
    switch (type) {
      case 5120: return as(int8_t{});
      case 5121: return as(uint8_t{});
      case 5122: return as(int16_t{});
      case 5123: return as(uint16_t{});
      case 5125: return as(uint32_t{});
      default: REQUIRE(type == 5126); return as(float{});
    }
  }
  static size_t Components(const json& accessor) {
    const std::string type = accessor.at("type");
    return type == "SCALAR" ? 1 : static_cast<size_t>(type.at(3) - '0');
  }
  const json& primitive() const { return description.at("meshes").at(0).at("primitives").at(0); }
  const json& accessor(const char* name) const {
    return description.at("accessors").at(primitive().at("attributes").at(name).get<size_t>());
  }
  const json& indices() const {
    return description.at("accessors").at(primitive().at("indices").get<size_t>());
  }
};

uint32_t Word(const std::string& bytes, size_t at) {
  uint32_t word = 0;
  REQUIRE(at + sizeof(word) <= bytes.size());
  std::memcpy(&word, bytes.data() + at, sizeof(word));
  return word;
}

Glb Parse(const std::string& path) {
  const std::string bytes = ReadBytes(path);
  REQUIRE(bytes.substr(0, 4) == "glTF");
  REQUIRE(Word(bytes, 4) == 2);
  REQUIRE(Word(bytes, 8) == bytes.size());
  const uint32_t json_bytes = Word(bytes, 12);
  REQUIRE(json_bytes % 4 == 0);
  REQUIRE(bytes.substr(16, 4) == "JSON");
  Glb glb;
  glb.description = json::parse(bytes.substr(20, json_bytes));
  REQUIRE(glb.description.at("asset").at("version") == "2.0");
  const size_t binary = 20 + json_bytes;
  if (binary == bytes.size()) return glb;
  REQUIRE(Word(bytes, binary) == bytes.size() - binary - 8);
  REQUIRE(Word(bytes, binary) % 4 == 0);
  REQUIRE(bytes.substr(binary + 4, 4) == std::string("BIN\0", 4));
  glb.binary = bytes.substr(binary + 8);
  REQUIRE(glb.description.at("buffers").at(0).at("byteLength") == glb.binary.size());
  return glb;
}

// What the specification says of every mesh.
void CheckRules(const Glb& glb, const TriangleMesh& mesh) {
  const json& positions = glb.accessor("POSITION");
  REQUIRE(positions.at("count") == mesh.positions.size());
  REQUIRE(positions.at("type") == "VEC3");
  for (size_t c = 0; c < 3; ++c) {
    double smallest = std::numeric_limits<double>::infinity();
    double largest = -smallest;
    for (size_t i = 0; i < mesh.positions.size(); ++i) {
      smallest = std::min(smallest, glb.At(positions, i, c));
      largest = std::max(largest, glb.At(positions, i, c));
    }
    REQUIRE(positions.at("min").at(c).get<double>() == smallest);
    REQUIRE(positions.at("max").at(c).get<double>() == largest);
  }
  for (const auto& [name, number] : glb.primitive().at("attributes").items()) {
    const json& accessor = glb.description.at("accessors").at(number.get<size_t>());
    const json& view =
        glb.description.at("bufferViews").at(accessor.at("bufferView").get<size_t>());
    CAPTURE(name);
    REQUIRE(view.at("byteStride").get<size_t>() % 4 == 0);
    REQUIRE(view.at("byteStride").get<size_t>() <= 252);
    REQUIRE(accessor.at("byteOffset").get<size_t>() % 4 == 0);
    REQUIRE(accessor.at("count") == mesh.positions.size());
    REQUIRE(accessor.at("componentType") != 5125);
    REQUIRE((name[0] == '_' || name == "POSITION" || name == "NORMAL" || name == "COLOR_0"));
  }
  REQUIRE(glb.indices().at("count") == mesh.triangles.size() * 3);
  for (size_t i = 0; i < mesh.triangles.size() * 3; ++i) {
    REQUIRE(glb.At(glb.indices(), i, 0) == static_cast<double>(mesh.triangles[i / 3][i % 3]));
  }
}

TEST_CASE("A .glb file has the positions and triangles, nothing moved") {
  const ScratchFolder folder;
  const TriangleMesh mesh = Tetrahedron();
  REQUIRE(WriteMesh(mesh, folder.Path("a.glb")).ok());
  const Glb glb = Parse(folder.Path("a.glb"));
  CheckRules(glb, mesh);
  REQUIRE_FALSE(glb.description.at("nodes").at(0).contains("translation"));
  for (size_t i = 0; i < mesh.positions.size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      REQUIRE(glb.At(glb.accessor("POSITION"), i, static_cast<size_t>(c)) == mesh.positions[i][c]);
    }
  }
}

TEST_CASE(".glb carries unit normals, colours, and scalars under names of their own") {
  const ScratchFolder folder;
  TriangleMesh mesh = ColouredTetrahedron();
  mesh.header.attributes.attributes.push_back({"QUALITY", ScalarType::kInt16});
  mesh.header.attributes.attributes.push_back({"Qu\"al\xc3\xa9", ScalarType::kInt8});
  const size_t old_row = mesh.rows.size() / 4;
  ByteWriter rows;
  for (size_t i = 0; i < 4; ++i) {
    rows.PutBytes(ByteSpan(mesh.rows).subspan(i * old_row, old_row));
    rows.Put(static_cast<int16_t>(-1000 - static_cast<int>(i)));
    rows.Put(static_cast<int8_t>(-7));
  }
  mesh.rows = rows.Take();
  std::memset(mesh.rows.data(), 0, 12);                            // no normal
  std::memset(mesh.rows.data() + mesh.rows.size() / 4, 0xff, 12);  // nan
  REQUIRE(WriteMesh(mesh, folder.Path("a.glb")).ok());
  const Glb glb = Parse(folder.Path("a.glb"));
  CheckRules(glb, mesh);
  REQUIRE(glb.primitive().at("attributes").size() == 6);
  const json& normal = glb.accessor("NORMAL");
  const json& colour = glb.accessor("COLOR_0");
  REQUIRE(normal.at("type") == "VEC3");
  REQUIRE(colour.at("type") == "VEC4");
  REQUIRE(colour.at("componentType") == 5123);
  REQUIRE(colour.at("normalized") == true);
  for (size_t i = 0; i < 4; ++i) {
    double length2 = 0;
    for (size_t c = 0; c < 3; ++c) length2 += std::pow(glb.At(normal, i, c), 2);
    REQUIRE(length2 == Approx(1).epsilon(1e-6));
    for (size_t c = 0; c < 4; ++c) {
      const double part = ValueInRow<uint8_t>(mesh, i, 12 + c) / 255.0;
      REQUIRE(glb.At(colour, i, c) == std::round(65535 * (c < 3 ? LinearOfSrgb(part) : part)));
    }
    REQUIRE(glb.At(glb.accessor("_QUALITY"), i, 0) == static_cast<float>(1.0 / (1.0 + double(i))));
    REQUIRE(glb.At(glb.accessor("_QUALITY_2"), i, 0) == -1000 - double(i));
    REQUIRE(glb.At(glb.accessor("_QU_AL__"), i, 0) == -7);
  }
  const float expected = 0.2f / std::sqrt(0.2f * 0.2f + 0.5f * 0.5f + 0.3f * 0.3f);
  REQUIRE(glb.At(normal, 2, 0) == Approx(expected).epsilon(1e-6));
  REQUIRE(glb.At(normal, 0, 2) == 1);
}

TEST_CASE(".glb keeps georeferenced positions by the node's translation") {
  const ScratchFolder folder;
  std::mt19937 random(3);
  TriangleMesh mesh;
  mesh.header.double_positions = true;
  for (size_t i = 0; i < 300; ++i) {
    const auto offset = [&] { return 1e-3 * static_cast<double>(random() % 1'000'000); };
    mesh.positions.push_back(
        {4'512'345.678 + offset(), 5'401'234.5 + offset(), -812.25 + offset()});
    if (i % 3 == 2) mesh.triangles.push_back({i - 2, i - 1, i});
  }
  REQUIRE(WriteMesh(mesh, folder.Path("a.glb")).ok());
  const Glb glb = Parse(folder.Path("a.glb"));
  CheckRules(glb, mesh);
  const json& translation = glb.description.at("nodes").at(0).at("translation");
  for (size_t i = 0; i < mesh.positions.size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      const double position = translation.at(static_cast<size_t>(c)).get<double>() +
                              glb.At(glb.accessor("POSITION"), i, static_cast<size_t>(c));
      REQUIRE(std::abs(position - mesh.positions[i][c]) < 1000.0 * std::ldexp(1.0, -24));
    }
  }
}

TEST_CASE("A .glb file of no triangles has a scene without a mesh") {
  const ScratchFolder folder;
  TriangleMesh mesh = ColouredTetrahedron();
  mesh.triangles.clear();
  REQUIRE(WriteMesh(mesh, folder.Path("a.glb")).ok());
  const Glb glb = Parse(folder.Path("a.glb"));
  REQUIRE_FALSE(glb.description.contains("meshes"));
  REQUIRE(glb.description.at("scenes").size() == 1);
  REQUIRE(glb.binary.empty());
}

TEST_CASE(".glb leaves out the attributes that a vertex has no room for") {
  const ScratchFolder folder;
  TriangleMesh mesh = Tetrahedron();
  for (int i = 0; i < 100; ++i) {
    mesh.header.attributes.attributes.push_back({"a" + std::to_string(i), ScalarType::kUint8});
  }
  mesh.rows.assign(400, std::byte{1});
  REQUIRE(WriteMesh(mesh, folder.Path("a.glb")).ok());
  const Glb glb = Parse(folder.Path("a.glb"));
  CheckRules(glb, mesh);
  REQUIRE(glb.primitive().at("attributes").size() == 1 + (252 - 12) / 4);
}

TEST_CASE(".glb refuses positions beyond float32, and numbers of any length fit") {
  const ScratchFolder folder;
  TriangleMesh mesh = Tetrahedron();
  mesh.header.double_positions = true;
  mesh.positions[2].y = 1e300;
  const Status status = WriteMesh(mesh, folder.Path("a.glb"));
  REQUIRE(status.code() == StatusCode::kInvalidArgument);
  REQUIRE(status.message().find("too large for float32") != std::string::npos);
  REQUIRE(folder.file_count() == 0);
  mesh.positions = {{-1.2345678901234567e-300, -1.2345678901234567e-301, -2.2345678901234567e-302},
                    {-1.1754944e-38, -1.1754944e-38, -1.1754944e-38},
                    {1.17549435e-38, 1.5754944e-38, 1.9754944e-38},
                    {0, 0, 0}};
  REQUIRE(WriteMesh(mesh, folder.Path("a.glb")).ok());
  CheckRules(Parse(folder.Path("a.glb")), mesh);
}

}  // namespace
}  // namespace mtdb
