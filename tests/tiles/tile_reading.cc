// SPDX-License-Identifier: Apache-2.0
#include "tests/tiles/tile_reading.h"

#include <cmath>
#include <cstring>
#include <meshoptimizer.h>

#include "store/base/bytes.h"

namespace mtdb::test {

namespace {

std::string FolderOf(const std::string& path) {
  const size_t slash = path.rfind('/');
  return slash == std::string::npos ? "" : path.substr(0, slash + 1);
}

// Without "a/../".
std::string Plain(std::string path) {
  for (size_t at = path.find("/../"); at != std::string::npos; at = path.find("/../")) {
    const size_t begin = path.rfind('/', at - 1);
    path.erase(begin == std::string::npos ? 0 : begin + 1,
               at + 4 - (begin == std::string::npos ? 0 : begin + 1));
  }
  return path;
}

bool Inside(const std::array<double, 12>& inner, const std::array<double, 12>& outer) {
  const double slack = 1e-9 * (outer[3] + outer[7] + outer[11]);
  for (size_t i = 0; i < 3; ++i) {
    const double in = inner[3 + 4 * i], out = outer[3 + 4 * i];
    if (std::abs(inner[i] - outer[i]) + in > out + slack) return false;
  }
  return true;
}

ReadTile ReadNode(const Json& node, const std::string& folder, const std::string& file) {
  ReadTile tile;
  tile.error = node.at("geometricError");
  for (size_t i = 0; i < 12; ++i) tile.box[i] = node.at("boundingVolume").at("box").at(i);
  if (node.contains("content")) {
    tile.uri = Plain(FolderOf(file) + node.at("content").at("uri").get<std::string>());
    if (tile.uri.ends_with(".json")) {
      const Json tileset = ParseJson(ReadText(folder + "/" + tile.uri));
      const ReadTile root = ReadNode(tileset.at("root"), folder, tile.uri);
      CHECK(root.error == tile.error);
      CHECK(root.box == tile.box);
      return root;
    }
    tile.bound = node.at("metadata").at("properties").at("errorBound");
  }
  if (!node.contains("children")) {
    CHECK(tile.error == 0);
    return tile;
  }
  for (const Json& child : node.at("children")) {
    tile.children.push_back(ReadNode(child, folder, file));
    CHECK(tile.children.back().error < tile.error);
    CHECK(Inside(tile.children.back().box, tile.box));
  }
  return tile;
}

}  // namespace

ReadTile ReadTileset(const std::string& folder) {
  const Json tileset = ParseJson(ReadText(folder + "/tileset.json"));
  CHECK(tileset.at("asset").at("version") == "1.1");
  const ReadTile root = ReadNode(tileset.at("root"), folder, "tileset.json");
  CHECK(tileset.at("geometricError").get<double>() > root.error);
  return root;
}

CornerTriangle Sorted(CornerTriangle t) {
  while (t[1] < t[0] || t[2] < t[0]) t = {t[1], t[2], t[0]};
  return t;
}

void TilesByLevel(const ReadTile& tile, std::map<int, std::vector<const ReadTile*>>* levels) {
  if (!tile.uri.empty()) (*levels)[std::stoi(tile.uri)].push_back(&tile);
  for (const ReadTile& child : tile.children) TilesByLevel(child, levels);
}

ReadGltf ReadGlb(const std::string& path) {
  const std::string bytes = ReadText(path);
  REQUIRE(bytes.starts_with("glTF"));
  uint32_t length = 0;
  std::memcpy(&length, bytes.data() + 12, sizeof(length));
  const Json json = ParseJson(bytes.substr(20, length));
  const auto* const binary = reinterpret_cast<const unsigned char*>(bytes.data()) + 28 + length;
  const auto decode = [&](size_t accessor) {
    const Json& a = json.at("accessors").at(accessor);
    const Json& packed = json.at("bufferViews")
                             .at(a.at("bufferView").get<size_t>())
                             .at("extensions")
                             .at("EXT_meshopt_compression");
    const size_t count = packed.at("count"), stride = packed.at("byteStride");
    std::vector<unsigned char> out(count * stride);
    const unsigned char* const from = binary + packed.at("byteOffset").get<size_t>();
    const size_t size = packed.at("byteLength");
    const int failed = packed.at("mode") == "TRIANGLES"
                           ? meshopt_decodeIndexBuffer(out.data(), count, stride, from, size)
                           : meshopt_decodeVertexBuffer(out.data(), count, stride, from, size);
    REQUIRE(failed == 0);
    return out;
  };
  const Json& primitive = json.at("meshes").at(0).at("primitives").at(0);
  const size_t positions = primitive.at("attributes").at("POSITION");
  const size_t count = json.at("accessors").at(positions).at("count");
  const bool is_short = json.at("accessors").at(positions).at("componentType") == 5123;
  const Json& matrix = json.at("nodes").at(0).at("matrix");
  ReadGltf gltf;
  gltf.step = matrix.at(0);
  gltf.bound = primitive.at("extras").at("errorBound");
  const Vec3d origin{matrix.at(12), -matrix.at(14).get<double>(), matrix.at(13)};
  const std::vector<unsigned char> p = decode(positions);
  for (size_t i = 0; i < count; ++i) {
    Vec3d at;
    for (int c = 0; c < 3; ++c) {
      if (is_short) {
        uint16_t value = 0;
        std::memcpy(&value, p.data() + 8 * i + 2 * static_cast<size_t>(c), sizeof(value));
        at[c] = value;
      } else {
        float value = 0;
        std::memcpy(&value, p.data() + 12 * i + 4 * static_cast<size_t>(c), sizeof(value));
        at[c] = value;
      }
    }
    gltf.positions.push_back(origin + at * gltf.step);
    Corner corner;
    for (int c = 0; c < 3; ++c) {
      const double lattice = origin[c] / gltf.step;
      corner[static_cast<size_t>(c)] = std::llround(lattice + at[c]);
    }
    gltf.corners.push_back(corner);
  }
  const std::vector<unsigned char> n = decode(primitive.at("attributes").at("NORMAL"));
  for (size_t i = 0; i < count; ++i) {
    Vec3d at;
    for (int c = 0; c < 3; ++c) {
      at[c] = static_cast<signed char>(n[4 * i + static_cast<size_t>(c)]) / 127.0;
    }
    gltf.normals.push_back(at);
  }
  const size_t indices = primitive.at("indices");
  const bool is_short_index = json.at("accessors").at(indices).at("componentType") == 5123;
  const std::vector<unsigned char> t = decode(indices);
  const size_t corners = json.at("accessors").at(indices).at("count");
  const uint64_t surface = primitive.at("extras").at("surfaceTriangles");
  std::array<uint32_t, 3> triangle{};
  for (size_t i = 0; i < corners; ++i) {
    uint32_t v = 0;
    std::memcpy(&v, t.data() + i * (is_short_index ? 2 : 4), is_short_index ? 2 : 4);
    REQUIRE(v < count);
    triangle[i % 3] = v;
    if (i % 3 == 2) (i / 3 < surface ? gltf.surface : gltf.skirts).push_back(triangle);
  }
  return gltf;
}

ReadTerrain ReadQuantizedMesh(const std::string& path) {
  const std::string text = ReadText(path);
  ByteReader in(AsBytes(text));
  ReadTerrain terrain;
  const auto point = [&] {
    Vec3d p;
    for (int i = 0; i < 3; ++i) p[i] = in.Get<double>();
    return p;
  };
  terrain.centre = point();
  terrain.low = in.Get<float>();
  terrain.high = in.Get<float>();
  terrain.sphere = point();
  terrain.radius = in.Get<double>();
  terrain.horizon = point();
  terrain.vertices.resize(in.Get<uint32_t>());
  REQUIRE(terrain.vertices.size() <= in.remaining() / 6);
  for (size_t c = 0; c < 3; ++c) {
    int32_t value = 0;
    for (auto& vertex : terrain.vertices) {
      const auto coded = in.Get<uint16_t>();
      value += coded >> 1 ^ -(coded & 1);
      REQUIRE((value >= 0 && value <= 32767));
      vertex[c] = static_cast<uint16_t>(value);
    }
  }
  const bool is_long = terrain.vertices.size() > 65536;
  while (is_long && in.position() % 4 != 0) in.Get<uint8_t>();
  const auto index = [&] { return is_long ? in.Get<uint32_t>() : in.Get<uint16_t>(); };
  terrain.triangles.resize(in.Get<uint32_t>());
  uint32_t highest = 0;
  for (auto& triangle : terrain.triangles) {
    for (uint32_t& v : triangle) {
      const uint32_t code = index();
      v = highest - code;
      if (code == 0) ++highest;
      REQUIRE(v < terrain.vertices.size());
    }
  }
  for (auto& side : terrain.sides) {
    side.resize(in.Get<uint32_t>());
    for (uint32_t& v : side) v = index();
  }
  while (in.remaining() > 0) {
    const int id = in.Get<uint8_t>();
    terrain.extensions[id] = std::string(AsString(in.GetBytes(in.Get<uint32_t>())));
  }
  REQUIRE_FALSE(in.failed());
  return terrain;
}

}  // namespace mtdb::test
