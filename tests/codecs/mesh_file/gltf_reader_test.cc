// SPDX-License-Identifier: Apache-2.0
// Reading glTF: what mtdb's writer wrote, and files put together here.
#include <algorithm>
#include <cmath>
#include <draco/compression/encode.h>
#include <draco/mesh/mesh.h>
#include <meshoptimizer.h>
#include <random>

#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using testing::AppendValue;
using testing::ColouredTetrahedron;
using testing::ReadBytes;
using testing::ReadGood;
using testing::ReadOutcome;
using testing::ReadPath;
using testing::ReadText;
using testing::RequireBadInput;
using testing::ScratchFolder;
using testing::Tetrahedron;
using testing::WriteMesh;

std::string Glb(std::string json, const std::string& buffer) {
  while (json.size() % 4 != 0) json += ' ';
  std::string file = "glTF";
  AppendValue(&file, uint32_t{2});
  AppendValue(&file, static_cast<uint32_t>(28 + json.size() + buffer.size()));
  AppendValue(&file, static_cast<uint32_t>(json.size()));
  file += "JSON" + json;
  AppendValue(&file, static_cast<uint32_t>(buffer.size()));
  return file + std::string("BIN\0", 4) + buffer;
}

// A square of four corners and the indices 0 .. 3, as float32 and uint16.
std::string SquareBuffer() {
  std::string buffer;
  for (const float x : {0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 0.f, 1.f, 1.f, 0.f}) {
    AppendValue(&buffer, x);
  }
  for (const uint16_t i : {0, 1, 2, 3}) AppendValue(&buffer, i);
  return buffer;
}

// `primitive` and `more` are put into the JSON around the square's buffer.
std::string SquareJson(const std::string& primitive, const std::string& more) {
  return R"({"asset":{"version":"2.0"},"buffers":[{"byteLength":56}],"bufferViews":[)"
         R"({"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":8}],)"
         R"("accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"},)"
         R"({"bufferView":1,"componentType":5123,"count":4,"type":"SCALAR"}],)"
         R"("meshes":[{"primitives":[{"attributes":{"POSITION":0})" +
         primitive + "}]}]" + more + "}";
}

ReadOutcome ReadSquare(const std::string& primitive, const std::string& more = "") {
  return ReadGood("square.glb", Glb(SquareJson(primitive, more), SquareBuffer()));
}

TEST_CASE("A .glb of mtdb's own is read as it was written") {
  const ScratchFolder folder;
  for (const bool far : {false, true}) {
    TriangleMesh mesh = ColouredTetrahedron();
    for (Vec3d& p : mesh.positions) p = far ? p + Vec3d{4.5e6, 5e5, 100} : p;
    mesh.header.double_positions = far;
    const std::string path = folder.Path("a.glb");
    REQUIRE(WriteMesh(mesh, path).ok());
    const ReadOutcome outcome = ReadPath(path);
    INFO(outcome.status.message());
    REQUIRE(outcome.status.ok());
    CHECK(outcome.report.format == "glTF");
    CHECK(outcome.mesh.triangles == mesh.triangles);
    REQUIRE(outcome.mesh.positions.size() == mesh.positions.size());
    for (size_t v = 0; v < mesh.positions.size(); ++v) {
      CHECK(Length(outcome.mesh.positions[v] - mesh.positions[v]) <= (far ? 0.1 : 0));
    }
    for (const char* name : {"nx", "ny", "nz", "red", "green", "blue"}) {
      const auto& list = outcome.mesh.header.attributes.attributes;
      CHECK(std::any_of(list.begin(), list.end(), [&](const auto& a) { return a.name == name; }));
    }
  }
}

TEST_CASE("Triangles, strips, fans and meshes without indices are read") {
  using T = std::vector<TriangleVertices>;
  CHECK(ReadSquare(R"(,"indices":1,"mode":5)").mesh.triangles == T{{0, 1, 2}, {2, 1, 3}});
  CHECK(ReadSquare(R"(,"indices":1,"mode":6)").mesh.triangles == T{{0, 1, 2}, {0, 2, 3}});
  CHECK(ReadSquare(R"(,"mode":5)").mesh.triangles == T{{0, 1, 2}, {2, 1, 3}});
  CHECK(ReadSquare("").mesh.triangles == T{{0, 1, 2}});  // the last corner is one of none
  CHECK(ReadSquare(R"(,"indices":1,"mode":5)").report.ignored.empty());
  const std::vector<std::string> ignored = ReadSquare(R"(,"indices":1)").report.ignored;
  REQUIRE(ignored.size() == 1);
  CHECK_THAT(ignored[0], Catch::Contains("1 corner behind the last triangle"));
}

TEST_CASE("Nodes place meshes, again and again; a mirror turns the triangles over") {
  const ReadOutcome outcome = ReadSquare(
      R"(,"mode":5)",
      R"(,"scene":0,"scenes":[{"nodes":[0,2]}],"nodes":[)"
      R"({"translation":[10,0,0],"children":[1]},)"
      R"({"mesh":0,"rotation":[0,0,0.70710678118654757,0.70710678118654757],"scale":[2,2,2]},)"
      R"({"mesh":0,"matrix":[-1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,5,1]}])");
  REQUIRE(outcome.mesh.positions.size() == 8);
  const auto near = [&](size_t v, Vec3d p) {
    return Length(outcome.mesh.positions[v] - p) < 1e-12;
  };
  CHECK(near(0, {10, 0, 0}));
  CHECK(near(1, {10, 2, 0}));  // x turned to y
  CHECK(near(2, {8, 0, 0}));
  CHECK(near(5, {-1, 0, 5}));
  CHECK(outcome.mesh.triangles ==
        std::vector<TriangleVertices>{{0, 1, 2}, {2, 1, 3}, {4, 6, 5}, {6, 7, 5}});
  CHECK(outcome.mesh.header.double_positions);
}

TEST_CASE("What glTF has and mtdb does not carry is counted") {
  const ReadOutcome outcome = ReadGood(
      "square.glb",
      Glb(SquareJson(R"(,"mode":5)",
                     R"(,"materials":[{},{}],"images":[{}],"skins":[{}],"animations":[{}])")
              .replace(SquareJson(R"(,"mode":5)", "").find(R"("POSITION":0)"), 12,
                       R"("POSITION":0,"TEXCOORD_0":0,"TANGENT":0)"),
          SquareBuffer()));
  CHECK(outcome.report.ignored == std::vector<std::string>{"4 texture coordinates", "2 materials",
                                                           "1 images", "1 skins", "1 animations",
                                                           "attribute TANGENT"});
}

TEST_CASE("glTF in JSON reads buffers beside it and in itself, and none from elsewhere") {
  const ScratchFolder folder;
  const auto with = [&](const std::string& uri) {
    std::string json = SquareJson(R"(,"mode":5)", "");
    json.replace(json.find(R"("byteLength":56)"), 15, R"("byteLength":56,"uri":")" + uri + "\"");
    return folder.Write("a.gltf", json);
  };
  folder.Write("my square.bin", SquareBuffer());
  CHECK(ReadPath(with("my%20square.bin")).mesh.triangles.size() == 2);
  const Status none = ReadPath(with("none.bin")).status;
  CHECK(none.code() == StatusCode::kNotFound);
  CHECK_THAT(none.message(), Catch::Contains("a.gltf: ") && Catch::Contains("none.bin"));
  CHECK_THAT(ReadPath(with("")).status.message(), Catch::Contains("a.gltf: "));
  for (const char* uri : {"../a.bin", "/etc/passwd", "file:///etc/passwd", "http://a/b.bin"}) {
    const ReadOutcome outcome = ReadPath(with(uri));
    INFO(uri << ": " << outcome.status.message());
    CHECK(outcome.status.code() == StatusCode::kBadInput);
    CHECK_THAT(outcome.status.message(), Catch::Contains("outside of"));
  }
  const ReadOutcome inside = ReadPath(
      with("data:application/octet-stream;base64,"
           "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAACAPwAAgD8AAAAAAAABAAIAAwA="));
  INFO(inside.status.message());
  REQUIRE(inside.status.ok());
  CHECK(inside.mesh.positions[3] == Vec3d{1, 1, 0});
}

TEST_CASE("Meshes that meshoptimizer and Draco have compressed are read") {
  constexpr size_t kSide = 60;
  std::vector<Vec3f> positions;
  std::vector<uint32_t> indices;
  for (size_t y = 0; y < kSide; ++y) {
    for (size_t x = 0; x < kSide; ++x) {
      positions.push_back(
          {static_cast<float>(x), static_cast<float>(y), static_cast<float>(x * y % 7)});
    }
  }
  for (uint32_t y = 0; y + 1 < kSide; ++y) {
    for (uint32_t x = 0; x + 1 < kSide; ++x) {
      const uint32_t v = y * kSide + x;
      for (const uint32_t i : {v, v + 1, v + 60, v + 1, v + 61, v + 60}) indices.push_back(i);
    }
  }
  const auto number = [](size_t n) { return std::to_string(n); };
  const auto check = [&](const std::string& file) {
    const ReadOutcome outcome = ReadGood("a.glb", file);
    REQUIRE(outcome.mesh.positions.size() == positions.size());
    REQUIRE(outcome.mesh.triangles.size() == indices.size() / 3);
    // Compressors turn triangles and renumber vertices.
    std::vector<std::vector<std::array<double, 3>>> found, expected;
    const auto add = [](auto* list, Vec3d a, Vec3d b, Vec3d c) {
      std::vector<std::array<double, 3>> t{{a.x, a.y, a.z}, {b.x, b.y, b.z}, {c.x, c.y, c.z}};
      std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
      list->push_back(t);
    };
    const auto at = [&](size_t i) {
      const Vec3f p = positions[indices[i]];
      return Vec3d{p.x, p.y, p.z};
    };
    for (const TriangleVertices& t : outcome.mesh.triangles) {
      add(&found, outcome.mesh.positions[t[0]], outcome.mesh.positions[t[1]],
          outcome.mesh.positions[t[2]]);
    }
    for (size_t i = 0; i < indices.size(); i += 3) add(&expected, at(i), at(i + 1), at(i + 2));
    std::sort(found.begin(), found.end());
    std::sort(expected.begin(), expected.end());
    CHECK(found == expected);
  };

  std::string packed(meshopt_encodeVertexBufferBound(positions.size(), 12), '\0');
  packed.resize(meshopt_encodeVertexBuffer(reinterpret_cast<unsigned char*>(packed.data()),
                                           packed.size(), positions.data(), positions.size(), 12));
  std::string packed_indices(meshopt_encodeIndexBufferBound(indices.size(), positions.size()),
                             '\0');
  packed_indices.resize(
      meshopt_encodeIndexBuffer(reinterpret_cast<unsigned char*>(packed_indices.data()),
                                packed_indices.size(), indices.data(), indices.size()));
  const auto view = [&](size_t offset, size_t size, size_t stride, size_t count, const char* mode) {
    return R"({"buffer":0,"byteLength":0,"extensions":{"EXT_meshopt_compression":{"buffer":0,)"
           R"("byteOffset":)" +
           number(offset) + ",\"byteLength\":" + number(size) +
           ",\"byteStride\":" + number(stride) + ",\"count\":" + number(count) + ",\"mode\":\"" +
           mode + "\"}}}";
  };
  const std::string accessors =
      R"("accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","count":)" +
      number(positions.size()) +
      R"(},{"bufferView":1,"componentType":5125,"type":"SCALAR","count":)" +
      number(indices.size()) + "}]";
  const std::string meshopt =
      R"({"asset":{"version":"2.0"},"extensionsRequired":["EXT_meshopt_compression"],)"
      R"("buffers":[{"byteLength":1}],"bufferViews":[)" +
      view(0, packed.size(), 12, positions.size(), "ATTRIBUTES") + "," +
      view(packed.size(), packed_indices.size(), 4, indices.size(), "TRIANGLES") + "]," +
      accessors + R"(,"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}]})";
  check(Glb(meshopt, packed + packed_indices));

  draco::Mesh mesh;
  mesh.set_num_points(static_cast<uint32_t>(positions.size()));
  mesh.SetNumFaces(indices.size() / 3);
  draco::GeometryAttribute attribute;
  attribute.Init(draco::GeometryAttribute::POSITION, nullptr, 3, draco::DT_FLOAT32, false, 12, 0);
  const int id = mesh.AddAttribute(attribute, true, static_cast<uint32_t>(positions.size()));
  for (uint32_t v = 0; v < positions.size(); ++v) {
    mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(v), &positions[v]);
  }
  for (uint32_t t = 0; t < indices.size() / 3; ++t) {
    draco::Mesh::Face face;
    for (size_t c = 0; c < 3; ++c) face[c] = draco::PointIndex(indices[3 * t + c]);
    mesh.SetFace(draco::FaceIndex(t), face);
  }
  draco::Encoder encoder;
  draco::EncoderBuffer buffer;
  REQUIRE(encoder.EncodeMeshToBuffer(mesh, &buffer).ok());
  const std::string draco_json =
      R"({"asset":{"version":"2.0"},"extensionsRequired":["KHR_draco_mesh_compression"],)"
      R"("buffers":[{"byteLength":)" +
      number(buffer.size()) + R"(}],"bufferViews":[{"buffer":0,"byteLength":)" +
      number(buffer.size()) + R"(}],"accessors":[{"componentType":5126,"type":"VEC3","count":)" +
      number(positions.size()) + R"(},{"componentType":5125,"type":"SCALAR","count":)" +
      number(indices.size()) +
      R"(}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"extensions":)"
      R"({"KHR_draco_mesh_compression":{"bufferView":0,"attributes":{"POSITION":0}}}}]}]})";
  check(Glb(draco_json, std::string(buffer.data(), buffer.size())));
}

TEST_CASE("glTF that is damaged or asks for what mtdb cannot do is refused, and says where") {
  const std::string buffer = SquareBuffer();
  const auto refused = [&](const std::string& from, const std::string& to, const char* words) {
    std::string json = SquareJson(R"(,"indices":1,"mode":5)", R"(,"x":0)");
    REQUIRE(json.find(from) != std::string::npos);
    json.replace(json.find(from), from.size(), to);
    const ReadOutcome outcome = ReadText("a.glb", Glb(json, buffer));
    INFO(to << ": " << outcome.status.message());
    CHECK(!outcome.status.ok());
    CHECK_THAT(outcome.status.message(), Catch::Contains("a.glb: ") && Catch::Contains(words));
  };
  refused(R"("count":4,"type":"VEC3")", R"("count":5,"type":"VEC3")", "5 values of 12 bytes");
  refused(R"("count":4,"type":"VEC3")", R"("count":9007199254740992,"type":"VEC3")", "values");
  refused(R"("count":4,"type":"VEC3")", R"("count":-1,"type":"VEC3")", "wrong number");
  refused(R"({"bufferView":0,"componentType":5126,"count":4)",
          R"({"componentType":5126,"count":4000000)", "without a bufferView");
  refused(R"("byteOffset":48)", R"("byteOffset":40)", "vertex index");
  refused(R"("byteLength":48)", R"("byteLength":480)", "cut short");
  refused(R"("POSITION":0)", R"("POSITION":7)", "no accessor 7");
  refused(R"("POSITION":0)", R"("NORMAL":0)", "POSITION");
  refused(R"("mode":5)", R"("mode":9)", "mode");
  refused(R"("mode":5)", R"("mode":1)", "no triangles");
  refused(R"("type":"VEC3")", R"("type":"MAT4")", "unknown type");
  refused(R"("type":"VEC3")", R"("sparse":{},"type":"VEC3")", "sparse");
  const auto sparse = [&](const std::string& count, const std::string& offset, const char* words) {
    refused(R"("type":"VEC3")",
            R"("sparse":{"count":)" + count +
                R"(,"indices":{"bufferView":1,"componentType":5123,"byteOffset":)" + offset +
                R"(},"values":{"bufferView":0}},"type":"VEC3")",
            words);
  };
  sparse("5", "0", "wrong number");
  sparse("4", "2", "cut short");
  sparse("2", "9007199254740992", "cut short");
  refused(R"("type":"VEC3")",
          R"("sparse":{"count":2,"indices":{"bufferView":0,"componentType":5121},)"
          R"("values":{"bufferView":0}},"type":"VEC3")",
          "sparse value 1");
  refused(R"("x":0)", R"("extensionsRequired":["EXT_other"])", "EXT_other");
  refused(R"("x":0)", R"("scenes":[{"nodes":[0]}],"nodes":[{"children":[0]}])", "twice");
  refused(R"("x":0)", R"("scenes":[{"nodes":[5]}],"nodes":[{"mesh":0}])", "no node 5");
  refused(R"("x":0)", R"("nodes":[{"mesh":0,"scale":[1,2]}])", "scale");
  refused(R"("x":0)", R"("x":)" + std::string(100, '[') + std::string(100, ']'), "damaged");
  refused(R"("x":0)", R"("x":)", "damaged");

  const std::string good = Glb(SquareJson(R"(,"indices":1,"mode":5)", ""), buffer);
  for (size_t size = 4; size < good.size(); ++size) {
    const ReadOutcome outcome = ReadText("a.glb", good.substr(0, size));
    INFO("the first " << size << " bytes");
    REQUIRE(!outcome.status.ok());
  }
  std::mt19937 random(5);
  for (int i = 0; i < 2000; ++i) {
    std::string bytes = good;
    for (uint32_t n = 1 + random() % 3; n > 0; --n) {
      bytes[random() % bytes.size()] = static_cast<char>(random());
    }
    const ReadOutcome outcome = ReadText("a.glb", bytes);
    if (outcome.status.ok()) {
      for (const TriangleVertices& t : outcome.mesh.triangles) {
        for (const VertexIndex v : t) REQUIRE(v < outcome.mesh.positions.size());
      }
    } else {
      REQUIRE(!outcome.status.message().empty());
    }
  }
}

std::string Repeated(const std::string& text, int times) {
  std::string all;
  for (int i = 0; i < times; ++i) all += (i == 0 ? "" : ",") + text;
  return all;
}

TEST_CASE(
    "glTF that names a few bytes again and again is read, or refused, without a copy of each") {
  // A thousand primitives share a buffer of 3 MB in the JSON; decoded by each, they are minutes.
  std::string json = SquareJson(R"(,"mode":5)", "");
  const std::string primitive = R"({"attributes":{"POSITION":0},"mode":5})";
  json.replace(json.find(primitive), primitive.size(), Repeated(primitive, 1000));
  json.replace(json.find(R"("byteLength":56)"), 15,
               R"("uri":"data:;base64,)" + std::string(4 << 20, 'A') + "\"");
  const ReadOutcome shared = ReadGood("a.gltf", json);
  CHECK(shared.mesh.positions.size() == 4000);

  // Nodes times primitives: 10^10 from half a megabyte.
  const ReadOutcome many =
      ReadText("a.glb", Glb(R"({"meshes":[{"primitives":[)" + Repeated("{}", 100000) +
                                R"(]}],"nodes":[)" + Repeated(R"({"mesh":0})", 100000) + "]}",
                            ""));
  CHECK(many.status.code() == StatusCode::kUnsupported);
  CHECK_THAT(many.status.message(), Catch::Contains("a.glb: ") && Catch::Contains("in parts"));
}

TEST_CASE("A .drc of mtdb's own is read as it was written, far from 0 too") {
  const ScratchFolder folder;
  for (const bool far : {false, true}) {
    TriangleMesh mesh = ColouredTetrahedron();
    for (Vec3d& p : mesh.positions) {
      if (std::abs(p.z) > 1e5) p.z = 2;
      if (far) p = p + Vec3d{4.5e6, 5e5, 100};
    }
    mesh.header.double_positions = far;
    for (const Vec3d p : mesh.positions) mesh.header.bounds.Add(p);
    const std::string path = folder.Path("a.drc");
    REQUIRE(WriteMesh(mesh, path).ok());
    const ReadOutcome outcome = ReadPath(path);
    INFO(outcome.status.message());
    REQUIRE(outcome.status.ok());
    CHECK(outcome.report.format == "Draco");
    CHECK(outcome.mesh.triangles.size() == mesh.triangles.size());
    // In whatever order.
    for (const Vec3d p : mesh.positions) {
      double nearest = 1e9;
      for (const Vec3d q : outcome.mesh.positions) nearest = std::min(nearest, Length(p - q));
      CHECK(nearest < 1e-5);
    }
    for (const VertexAttribute& a : mesh.header.attributes.attributes) {
      const auto& list = outcome.mesh.header.attributes.attributes;
      INFO(a.name);
      CHECK(std::any_of(list.begin(), list.end(), [&](const VertexAttribute& b) {
        return a.name == b.name && a.type == b.type;
      }));
    }
    // Cut short anywhere, and with bytes changed.
    const std::string good = ReadBytes(path);
    for (size_t size = 1; size < good.size(); ++size) {
      CHECK(!ReadText("a.drc", good.substr(0, size)).status.ok());
    }
    std::mt19937 random(6);
    for (int i = 0; i < 500; ++i) {
      std::string bytes = good;
      bytes[5 + random() % (bytes.size() - 5)] = static_cast<char>(random());
      const ReadOutcome changed = ReadText("a.drc", bytes);
      CHECK((changed.status.ok() || !changed.status.message().empty()));
    }
  }
}

TEST_CASE(
    "A Draco file that promises more than its bytes can hold is refused before it is decoded") {
  std::string bytes = "DRACO";
  for (const char c : {2, 2, 1, 1, 0, 0, 0}) bytes += c;
  for (int i = 0; i < 2; ++i) bytes += "\xff\xff\xff\xff\x07";
  RequireBadInput("a.drc", bytes + std::string(100, 'x'), {"promise", "damaged"});
}

TEST_CASE("Normals go into OBJ beside the vertices, and faces name them") {
  const ScratchFolder folder;
  const std::string path = folder.Path("a.obj");
  REQUIRE(WriteMesh(ColouredTetrahedron(), path).ok());
  const std::string text = ReadBytes(path);
  CHECK(std::count(text.begin(), text.end(), '\n') == 4 + 4 + 4);
  CHECK_THAT(text, Catch::Contains("\nvn ") && Catch::Contains("f 1//1 3//3 2//2\n"));
  REQUIRE(WriteMesh(Tetrahedron(), path).ok());
  CHECK_THAT(ReadBytes(path), !Catch::Contains("vn") && Catch::Contains("f 1 3 2\n"));
}

}  // namespace
}  // namespace mtdb
