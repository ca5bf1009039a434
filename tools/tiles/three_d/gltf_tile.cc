// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/three_d/gltf_tile.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <meshoptimizer.h>
#include <string>
#include <utility>

#include "store/base/vertex_meaning.h"
#include "tools/tiles/json_reading.h"

namespace mtdb {

namespace {

constexpr uint32_t kMagic = 0x46546c67;      // "glTF"
constexpr uint32_t kJsonChunk = 0x4e4f534a;  // "JSON"
constexpr uint32_t kBinaryChunk = 0x004e4942;
constexpr int kByte = 5120, kUnsignedShort = 5123, kUnsignedInt = 5125, kFloat = 5126;
constexpr int kArrayBuffer = 34962, kElementBuffer = 34963;
constexpr int32_t kLargestShort = 65535;
constexpr uint32_t kNone = ~uint32_t{0};
constexpr size_t kMostElements = 1u << 30;
constexpr float kLargestFloat = 1 << 24;

const std::array<uint16_t, 256>& LinearBytes() {
  static const std::array<uint16_t, 256> kLinear = [] {
    std::array<uint16_t, 256> linear{};
    for (size_t i = 0; i < linear.size(); ++i) {
      linear[i] =
          static_cast<uint16_t>(std::lround(65535 * LinearOfSrgb(static_cast<double>(i) / 255)));
    }
    return linear;
  }();
  return kLinear;
}

// Triangles for the cache of vertices, then vertices as triangles want them first.
void Reorder(GltfTile* tile) {
  const size_t surface = tile->surface_triangles * 3;
  std::vector<uint32_t> sorted(tile->indices.size());
  meshopt_optimizeVertexCacheFifo(sorted.data(), tile->indices.data(), surface,
                                  tile->positions.size(), 16);
  std::copy(tile->indices.begin() + static_cast<ptrdiff_t>(surface), tile->indices.end(),
            sorted.begin() + static_cast<ptrdiff_t>(surface));
  std::vector<uint32_t> place(tile->positions.size(), kNone);
  uint32_t count = 0;
  for (uint32_t& v : sorted) {
    if (place[v] == kNone) place[v] = count++;
    v = place[v];
  }
  const auto move = [&](auto* values) {
    auto moved = *values;
    for (size_t i = 0; i < values->size(); ++i) {
      if (place[i] != kNone) moved[place[i]] = (*values)[i];
    }
    if (!values->empty()) moved.resize(count);
    *values = std::move(moved);
  };
  move(&tile->positions);
  move(&tile->normals);
  move(&tile->colours);
  tile->indices = std::move(sorted);
}

// The file: views of a buffer that is compressed, view by view, and of one that is not there, which
// says how large they are when they are not.
class GltfBuilder {
 public:
  explicit GltfBuilder(GltfTile tile) : tile_(std::move(tile)) {}

  Bytes Build() {
    const Json position = AddPositions();
    Json attributes = {{"POSITION", position}};
    if (!tile_.normals.empty()) attributes["NORMAL"] = AddNormals();
    if (!tile_.colours.empty()) attributes["COLOR_0"] = AddColours();
    const size_t indices = AddIndices();
    const Vec3d o = tile_.origin;
    const double s = tile_.step;
    // Columns: what x, y and z of the tile are where y is up, then the origin.
    const Json matrix = {s, 0, 0, 0, 0, 0, -s, 0, 0, s, 0, 0, o.x, o.z, -o.y, 1};
    const Json primitive = {
        {"attributes", attributes},
        {"indices", indices},
        {"material", 0},
        {"extras",
         {{"errorBound", tile_.error_bound}, {"surfaceTriangles", tile_.surface_triangles}}}};
    Json json = {{"asset", {{"version", "2.0"}, {"generator", "mtdb"}}},
                 {"extensionsUsed", {"KHR_mesh_quantization", "EXT_meshopt_compression"}},
                 {"extensionsRequired", {"KHR_mesh_quantization", "EXT_meshopt_compression"}},
                 {"scene", 0},
                 {"scenes", {{{"nodes", {0}}}}},
                 {"nodes", {{{"mesh", 0}, {"matrix", matrix}}}},
                 {"meshes", {{{"primitives", {primitive}}}}},
                 {"materials",
                  {{{"doubleSided", true},
                    {"pbrMetallicRoughness", {{"metallicFactor", 0}, {"roughnessFactor", 1}}}}}},
                 {"buffers",
                  {{{"byteLength", bytes_.size()}},
                   {{"byteLength", fallback_bytes_},
                    {"extensions", {{"EXT_meshopt_compression", {{"fallback", true}}}}}}}},
                 {"bufferViews", views_},
                 {"accessors", accessors_}};
    return File(json.Text());
  }

 private:
  // Of the length of `count` elements of `stride` bytes.
  size_t AddView(const void* data, size_t count, size_t stride, bool triangles) {
    std::vector<unsigned char> packed;
    if (triangles) {
      const auto* const indices = static_cast<const uint32_t*>(data);
      packed.resize(meshopt_encodeIndexBufferBound(count, tile_.positions.size()));
      packed.resize(meshopt_encodeIndexBuffer(packed.data(), packed.size(), indices, count));
    } else {
      packed.resize(meshopt_encodeVertexBufferBound(count, stride));
      packed.resize(meshopt_encodeVertexBuffer(packed.data(), packed.size(), data, count, stride));
    }
    while (bytes_.size() % 4 != 0) bytes_.push_back(std::byte{0});
    Json view = {{"buffer", 1}, {"byteOffset", fallback_bytes_}, {"byteLength", count * stride}};
    if (!triangles) view["byteStride"] = stride;
    view["target"] = triangles ? kElementBuffer : kArrayBuffer;
    view["extensions"]["EXT_meshopt_compression"] = {
        {"buffer", 0},
        {"byteOffset", bytes_.size()},
        {"byteLength", packed.size()},
        {"byteStride", stride},
        {"count", count},
        {"mode", triangles ? "TRIANGLES" : "ATTRIBUTES"}};
    fallback_bytes_ += (count * stride + 3) / 4 * 4;
    const auto* const from = reinterpret_cast<const std::byte*>(packed.data());
    bytes_.insert(bytes_.end(), from, from + packed.size());
    views_.push_back(std::move(view));
    return views_.size() - 1;
  }

  size_t AddAccessor(size_t view, int component, size_t count, const char* type,
                     bool normalised = false) {
    Json accessor = {{"bufferView", view}, {"componentType", component}};
    if (normalised) accessor["normalized"] = true;
    accessor["count"] = count;
    accessor["type"] = type;
    accessors_.push_back(std::move(accessor));
    return accessors_.size() - 1;
  }

  size_t AddPositions() {
    Box3i box;
    for (const Vec3i& p : tile_.positions) box.Add(p);
    const size_t count = tile_.positions.size();
    const bool is_short = std::max({box.max.x, box.max.y, box.max.z}) <= kLargestShort;
    size_t view = 0;
    if (is_short) {
      std::vector<std::array<uint16_t, 4>> shorts(count);
      for (size_t i = 0; i < count; ++i) {
        for (int c = 0; c < 3; ++c) {
          shorts[i][static_cast<size_t>(c)] = static_cast<uint16_t>(tile_.positions[i][c]);
        }
      }
      view = AddView(shorts.data(), count, sizeof(shorts[0]), false);
    } else {
      std::vector<Vec3f> floats(count);
      for (size_t i = 0; i < count; ++i) {
        for (int c = 0; c < 3; ++c) floats[i][c] = static_cast<float>(tile_.positions[i][c]);
      }
      view = AddView(floats.data(), count, sizeof(floats[0]), false);
    }
    const size_t accessor = AddAccessor(view, is_short ? kUnsignedShort : kFloat, count, "VEC3");
    accessors_.elements()[accessor]["min"] = {box.min.x, box.min.y, box.min.z};
    accessors_.elements()[accessor]["max"] = {box.max.x, box.max.y, box.max.z};
    return accessor;
  }

  size_t AddNormals() {
    std::vector<std::array<int8_t, 4>> bytes(tile_.normals.size());
    for (size_t i = 0; i < bytes.size(); ++i) {
      for (int c = 0; c < 3; ++c) {
        bytes[i][static_cast<size_t>(c)] =
            static_cast<int8_t>(std::lround(127 * tile_.normals[i][c]));
      }
    }
    const size_t view = AddView(bytes.data(), bytes.size(), sizeof(bytes[0]), false);
    return AddAccessor(view, kByte, bytes.size(), "VEC3", true);
  }

  // Linear, as glTF has them.
  size_t AddColours() {
    const std::array<uint16_t, 256>& linear = LinearBytes();
    std::vector<std::array<uint16_t, 4>> shorts(tile_.colours.size());
    for (size_t i = 0; i < shorts.size(); ++i) {
      const std::array<uint8_t, 4>& c = tile_.colours[i];
      shorts[i] = {linear[c[0]], linear[c[1]], linear[c[2]], static_cast<uint16_t>(257 * c[3])};
    }
    const size_t view = AddView(shorts.data(), shorts.size(), sizeof(shorts[0]), false);
    return AddAccessor(view, kUnsignedShort, shorts.size(), "VEC4", true);
  }

  size_t AddIndices() {
    const size_t count = tile_.indices.size();
    // 65,535 itself would restart a strip.
    const bool is_short = tile_.positions.size() <= kLargestShort;
    const size_t view =
        AddView(tile_.indices.data(), count, is_short ? sizeof(uint16_t) : sizeof(uint32_t), true);
    return AddAccessor(view, is_short ? kUnsignedShort : kUnsignedInt, count, "SCALAR");
  }

  Bytes File(std::string json) {
    while (json.size() % 4 != 0) json += ' ';
    while (bytes_.size() % 4 != 0) bytes_.push_back(std::byte{0});
    ByteWriter out;
    out.Put(kMagic);
    out.Put(uint32_t{2});
    out.Put(static_cast<uint32_t>(12 + 8 + json.size() + 8 + bytes_.size()));
    out.Put(static_cast<uint32_t>(json.size()));
    out.Put(kJsonChunk);
    out.PutBytes(AsBytes(json));
    out.Put(static_cast<uint32_t>(bytes_.size()));
    out.Put(kBinaryChunk);
    out.PutBytes(bytes_);
    return out.Take();
  }

  GltfTile tile_;
  Bytes bytes_;
  size_t fallback_bytes_ = 0;
  Json views_ = Json(Json::Array{}), accessors_ = Json(Json::Array{});
};

// The bytes of a view, decompressed; empty where they are damaged.
std::vector<unsigned char> Unpacked(const Json& json, ByteSpan binary, const Json& accessor) {
  const Json& view = At(At(json, "bufferViews"), CountOf(At(accessor, "bufferView")));
  const Json& packed = At(At(view, "extensions"), "EXT_meshopt_compression");
  const size_t count = CountOf(At(packed, "count")), stride = CountOf(At(packed, "byteStride"));
  const size_t begin = CountOf(At(packed, "byteOffset")), size = CountOf(At(packed, "byteLength"));
  const bool is_index = At(packed, "mode") == Json("TRIANGLES");
  const bool is_sound = begin <= binary.size() && size <= binary.size() - begin &&
                        count == CountOf(At(accessor, "count")) && count <= kMostElements &&
                        (is_index ? stride == 2 || stride == 4 : stride % 4 == 0 && stride <= 256);
  // The codecs need a byte for a triangle, and one for 64 bytes of vertices, at least.
  const bool is_large_enough = is_index ? count / 3 <= size : count * stride / 64 <= size + stride;
  if (!is_sound || !is_large_enough || stride == 0 || (is_index && count % 3 != 0)) return {};
  std::vector<unsigned char> bytes(count * stride);
  const auto* const from = reinterpret_cast<const unsigned char*>(binary.data()) + begin;
  const int failed = is_index ? meshopt_decodeIndexBuffer(bytes.data(), count, stride, from, size)
                              : meshopt_decodeVertexBuffer(bytes.data(), count, stride, from, size);
  return failed == 0 ? bytes : std::vector<unsigned char>();
}

template <typename T>
T NumberAt(const std::vector<unsigned char>& bytes, size_t offset) {
  T number{};
  if (offset + sizeof(T) <= bytes.size()) std::memcpy(&number, bytes.data() + offset, sizeof(T));
  return number;
}

// Throws UnexpectedJson where a member is missing.
Result<GltfTile> DecodeChunks(const Json& json, ByteSpan binary) {
  const Json& primitive = At(At(At(At(json, "meshes"), 0), "primitives"), 0);
  const Json& matrix = At(At(At(json, "nodes"), 0), "matrix");
  const auto accessor = [&](const Json& index) -> const Json& {
    return At(At(json, "accessors"), CountOf(index));
  };
  GltfTile tile;
  tile.step = NumberOf(At(matrix, 0));
  tile.origin = {NumberOf(At(matrix, 12)), -NumberOf(At(matrix, 14)), NumberOf(At(matrix, 13))};
  tile.error_bound = NumberOf(At(At(primitive, "extras"), "errorBound"));
  tile.surface_triangles = CountOf(At(At(primitive, "extras"), "surfaceTriangles"));
  const Json& positions = accessor(At(At(primitive, "attributes"), "POSITION"));
  const Json& indices = accessor(At(primitive, "indices"));
  const std::vector<unsigned char> p = Unpacked(json, binary, positions);
  const std::vector<unsigned char> t = Unpacked(json, binary, indices);
  const bool is_short = At(positions, "componentType") == Json(kUnsignedShort);
  const size_t stride = is_short ? 4 * sizeof(uint16_t) : sizeof(Vec3f);
  for (size_t at = 0; at + stride <= p.size(); at += stride) {
    Vec3i q;
    for (int c = 0; c < 3; ++c) {
      const auto i = static_cast<size_t>(c);
      if (!is_short && std::isnan(NumberAt<float>(p, at + i * sizeof(float)))) {
        return Corrupt("a position is not a number");
      }
      q[c] = is_short ? NumberAt<uint16_t>(p, at + i * sizeof(uint16_t))
                      : static_cast<int32_t>(std::clamp(NumberAt<float>(p, at + i * sizeof(float)),
                                                        0.0f, kLargestFloat));
    }
    tile.positions.push_back(q);
  }
  const bool is_short_index = At(indices, "componentType") == Json(kUnsignedShort);
  const size_t index_bytes = is_short_index ? sizeof(uint16_t) : sizeof(uint32_t);
  for (size_t at = 0; at < t.size(); at += index_bytes) {
    const uint32_t v = is_short_index ? NumberAt<uint16_t>(t, at) : NumberAt<uint32_t>(t, at);
    if (v >= tile.positions.size()) return Corrupt("an index is beyond the vertices");
    tile.indices.push_back(v);
  }
  if (tile.indices.empty() || tile.surface_triangles > tile.indices.size() / 3) {
    return Corrupt("vertices or triangles are damaged");
  }
  return tile;
}

}  // namespace

Result<GltfTile> DecodeGltfTile(ByteSpan bytes) {
  ByteReader in(bytes);
  const bool is_gltf = in.Get<uint32_t>() == kMagic && in.Get<uint32_t>() == 2;
  in.Get<uint32_t>();
  const auto json_bytes = in.Get<uint32_t>();
  in.Get<uint32_t>();
  const ByteSpan text = in.GetBytes(json_bytes);
  const auto binary_bytes = in.Get<uint32_t>();
  in.Get<uint32_t>();
  const ByteSpan binary = in.GetBytes(binary_bytes);
  const Json json = Json::ParseObject(AsString(text));
  if (!is_gltf || in.failed() || !json.is_object()) return Corrupt("no glTF as mtdb writes it");
  try {
    return DecodeChunks(json, binary);
  } catch (const UnexpectedJson& error) {
    return Corrupt(std::string("a tile's description: ") + error.what());
  }
}

Bytes EncodeGltfTile(GltfTile tile) {
  Reorder(&tile);
  return GltfBuilder(std::move(tile)).Build();
}

}  // namespace mtdb
