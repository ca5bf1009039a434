// SPDX-License-Identifier: Apache-2.0
// Binary glTF 2.0 (.glb). The file is a header, a chunk of JSON that describes the mesh, and a
// chunk of vertices and triangles. The JSON comes first but holds the smallest and largest
// position: room is left for it, and it is written at the end.
#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstring>
#include <set>
#include <utility>
#include <vector>

#include "codecs/mesh_file/draped_mesh_file.h"
#include "codecs/mesh_file/writers/gltf_pages.h"
#include "codecs/mesh_file/writers/mesh_writer.h"
#include "codecs/mesh_file/writers/text_format.h"

namespace mtdb::internal {
namespace {

constexpr uint32_t kMagic = 0x46546c67;      // "glTF"
constexpr uint32_t kJsonChunk = 0x4e4f534a;  // "JSON"
constexpr uint32_t kBinaryChunk = 0x004e4942;
constexpr size_t kHeaderBytes = 12;
constexpr size_t kChunkHeaderBytes = 8;
constexpr size_t kPositionBytes = sizeof(Vec3f);
constexpr size_t kTexturePlaceBytes = 2 * sizeof(float);
constexpr size_t kNumberBytes = 24;     // the longest double in decimals
constexpr size_t kLargestStride = 252;  // of a vertex, by the specification
constexpr uint64_t kLargestFile = 0xffffffffu;
constexpr uint64_t kTriangleBytes = 3 * sizeof(uint32_t);

// The standard's numbers of component types.
enum class Component : uint16_t {
  kByte = 5120,
  kUnsignedByte = 5121,
  kShort = 5122,
  kUnsignedShort = 5123,
  kUnsignedInt = 5125,  // not for vertices
  kFloat = 5126,
};

// The type that carries a scalar: glTF has neither 32-bit integers nor doubles at vertices.
Component ComponentOf(ScalarType type) {
  switch (type) {
    case ScalarType::kInt8: return Component::kByte;
    case ScalarType::kUint8: return Component::kUnsignedByte;
    case ScalarType::kInt16: return Component::kShort;
    case ScalarType::kUint16: return Component::kUnsignedShort;
    default: return Component::kFloat;
  }
}

// One vertex attribute of the file: some columns of a row.
enum class GltfKind { kNormal, kColour, kOther };
struct GltfColumns {
  GltfKind kind = GltfKind::kOther;
  std::string name;
  Component component = Component::kFloat;
  ScalarType type = ScalarType::kFloat32;  // of the columns
  std::vector<size_t> offsets;             // in a row
  std::vector<size_t> indices;             // in the layout
  size_t at = 0;                           // bytes from the start of a vertex; a multiple of 4
};

// "_QUALITY" for "quality"; what is neither a letter nor a digit becomes "_".
std::string CustomName(const std::string& name, const std::set<std::string>& taken) {
  std::string custom = "_";
  for (const char c : name) {
    const auto byte = static_cast<unsigned char>(c);
    const bool plain = byte < 0x80 && std::isalnum(byte) != 0;
    custom += plain ? static_cast<char>(std::toupper(byte)) : '_';
  }
  std::string unique = custom;
  for (int i = 2; taken.contains(unique); ++i) unique = custom + "_" + std::to_string(i);
  return unique;
}

bool IsPartOfColour(const AttributeLayout& layout, size_t index) {
  const ColourAttributes c = FindColours(layout);
  return std::find(c.indices.begin(), c.indices.begin() + c.count, index) !=
         c.indices.begin() + c.count;
}

// Normals, colours, then all others under names of their own, as far as a vertex has room. A
// texture has coordinates behind the position, and colours would tint it. Colours are linear in
// glTF: bytes of sRGB need 16 bits for that, and what has more becomes float.
std::vector<GltfColumns> PlanColumns(const AttributeLayout& layout, bool textured, size_t* stride) {
  std::vector<GltfColumns> plan;
  std::set<size_t> used;
  std::set<std::string> names;
  *stride = kPositionBytes + (textured ? kTexturePlaceBytes : 0);
  const auto add = [&](GltfColumns columns, size_t bytes) {
    if (*stride + bytes > kLargestStride) return;
    columns.at = *stride;
    *stride += bytes;
    used.insert(columns.indices.begin(), columns.indices.end());
    names.insert(columns.name);
    plan.push_back(std::move(columns));
  };
  if (const NormalAttributes n = FindNormals(layout); n.found) {
    add({GltfKind::kNormal,
         "NORMAL",
         Component::kFloat,
         n.type,
         {n.offsets.begin(), n.offsets.end()},
         {n.indices.begin(), n.indices.end()}},
        sizeof(Vec3f));
  }
  if (const ColourAttributes c = FindColours(layout); c.count > 0 && !textured) {
    const bool fine = c.type == ScalarType::kUint16 || c.type >= ScalarType::kFloat32;
    const size_t bytes = static_cast<size_t>(c.count) * (fine ? sizeof(float) : sizeof(uint16_t));
    add({GltfKind::kColour,
         "COLOR_0",
         fine ? Component::kFloat : Component::kUnsignedShort,
         c.type,
         {c.offsets.begin(), c.offsets.begin() + c.count},
         {c.indices.begin(), c.indices.begin() + c.count}},
        (bytes + 3) / 4 * 4);
  }
  size_t offset = 0;
  for (size_t i = 0; i < layout.attributes.size(); ++i) {
    const VertexAttribute& a = layout.attributes[i];
    const bool is_tint = textured && IsPartOfColour(layout, i);
    if (!used.contains(i) && !is_tint) {
      add({GltfKind::kOther, CustomName(a.name, names), ComponentOf(a.type), a.type, {offset}, {i}},
          sizeof(uint32_t));
    }
    offset += ScalarSize(a.type);
  }
  return plan;
}

std::string Numbers(Vec3d v) {
  std::string text = "[";
  for (int i = 0; i < 3; ++i) {
    AppendNumber(&text, v[i]);
    text += i < 2 ? ',' : ']';
  }
  return text;
}

std::string VectorType(size_t components) {
  return components == 1 ? "SCALAR" : "VEC" + std::to_string(components);
}

float FloatValue(const std::byte* value, ScalarType type) {
  const auto as = [&]<typename T>(T number) {
    std::memcpy(&number, value, sizeof(number));
    return static_cast<float>(number);
  };
  float number = 0;
  switch (type) {
    case ScalarType::kInt32: number = as(int32_t{}); break;
    case ScalarType::kUint32: number = as(uint32_t{}); break;
    case ScalarType::kFloat64: number = as(double{}); break;
    default: number = as(float{});
  }
  return std::isfinite(number) ? number : 0;  // the format has no other numbers
}

// Of length 1, which the format demands; upwards where there is none.
Vec3f UnitNormal(Vec3d d) {
  const double length = Length(d);
  if (!(length > 0) || !std::isfinite(length)) return {0, 0, 1};
  return {static_cast<float>(d.x / length), static_cast<float>(d.y / length),
          static_cast<float>(d.z / length)};
}

class GltfWriter final : public MeshWriter {
 public:
  explicit GltfWriter(const std::string& path, const MeshWriteOptions& options,
                      MeshTexture texture = {})
      : MeshWriter(path), up_frame_(options.up_frame), texture_(std::move(texture)) {
    for (size_t byte = 0; byte < linear_.size(); ++byte) {
      linear_[byte] =
          static_cast<uint16_t>(std::lround(65535 * LinearOfSrgb(static_cast<double>(byte) / 255)));
    }
  }

 private:
  Status WriteHeader() override {
    columns_ = PlanColumns(header().attributes, is_draped() || is_textured(), &stride_);
    for (const GltfColumns& c : columns_) Carry(c.indices);
    colours_ = ColourReader(FindColours(header().attributes));
    normals_ = FindNormals(header().attributes);
    // A mesh in glTF has triangles.
    empty_ = triangle_count() == 0;
    if (header().double_positions && header().bounds.empty()) {
      origin_ = Vec3d{};
    } else if (float_positions().has_origin()) {
      origin_ = float_positions().origin();
    }
    if (is_textured() && !empty_) pages_ = std::make_unique<GltfPages>(stride_, kPositionBytes);
    json_bytes_ = (Json().size() + 15 * kNumberBytes + 3) / 4 * 4;
    const uint64_t besides =
        kHeaderBytes + 2 * kChunkHeaderBytes + json_bytes_ + padded_image_bytes();
    const uint64_t rest = kLargestFile - std::min(besides, kLargestFile);
    if (!empty_ && (vertex_count() > rest / stride_ ||
                    triangle_count() > (rest - vertex_count() * stride_) / kTriangleBytes)) {
      return TooLong();
    }
    if (pages_ != nullptr) return Status::Ok();  // all of it comes at the end
    binary_bytes_ = empty_ ? 0
                           : vertex_count() * stride_ + triangle_count() * kTriangleBytes +
                                 padded_image_bytes();
    return file().Append(Front());
  }

  Status TooLong() const {
    return InvalidArgument(path() + ": a .glb file holds at most 4 GiB, but the mesh of " +
                           std::to_string(vertex_count()) + " vertices and " +
                           std::to_string(triangle_count()) +
                           " triangles needs more; write PLY or ask for a part of it");
  }

  Status WriteVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    if (empty_ || positions.empty()) return Status::Ok();
    if (origin_ && bounds_.empty() && header().bounds.empty()) {
      origin_ = positions[0];
      float_positions().set_origin(positions[0]);
    }
    const size_t row_bytes = header().attributes.row_bytes();
    buffer_.assign(positions.size() * stride_, std::byte{0});
    std::byte* out = buffer_.data();
    for (size_t i = 0; i < positions.size(); ++i, out += stride_) {
      Vec3f f;
      if (!float_positions().Round(positions[i], &f)) return TooLarge();
      std::memcpy(out, &f, sizeof(f));
      bounds_.Add(Vec3d{f.x, f.y, f.z});
      if (is_draped()) PutTexturePlace(positions[i], out + kPositionBytes);
      for (const GltfColumns& c : columns_) PutValues(c, rows.data() + i * row_bytes, out + c.at);
    }
    if (pages_ != nullptr) {
      pages_->AddVertices(buffer_);
      return Status::Ok();
    }
    return file().Append(buffer_);
  }

  void PutValues(const GltfColumns& columns, const std::byte* row, std::byte* out) {
    if (columns.kind == GltfKind::kNormal) {
      const Vec3f unit = UnitNormal(NormalIn(row, normals_));
      std::memcpy(out, &unit, sizeof(unit));
    } else if (columns.kind == GltfKind::kColour) {
      PutColour(columns, row, out);
    } else if (columns.component == Component::kFloat) {
      const float value = FloatValue(row + columns.offsets[0], columns.type);
      std::memcpy(out, &value, sizeof(value));
    } else {
      std::memcpy(out, row + columns.offsets[0], ScalarSize(columns.type));
    }
  }

  // Alpha is linear as it is.
  void PutColour(const GltfColumns& columns, const std::byte* row, std::byte* out) {
    for (int c = 0; c < colours_.count(); ++c) {
      const bool alpha = c == 3;
      if (columns.component == Component::kFloat) {
        const double part = colours_.Part(row, c);
        const auto value = static_cast<float>(alpha ? part : LinearOfSrgb(part));
        std::memcpy(out + static_cast<size_t>(c) * sizeof(value), &value, sizeof(value));
      } else {
        const uint8_t byte = colours_.Byte(row, c);
        const auto value = alpha ? static_cast<uint16_t>(257 * byte) : linear_[byte];
        std::memcpy(out + static_cast<size_t>(c) * sizeof(value), &value, sizeof(value));
      }
    }
  }

  Status WriteTriangles(std::span<const TriangleVertices> triangles) override {
    buffer_.resize(triangles.size() * kTriangleBytes);
    std::byte* out = buffer_.data();
    for (const TriangleVertices& t : triangles) {
      const uint32_t v[3] = {static_cast<uint32_t>(t[0]), static_cast<uint32_t>(t[1]),
                             static_cast<uint32_t>(t[2])};
      std::memcpy(out, v, sizeof(v));
      out += kTriangleBytes;
    }
    return file().Append(buffer_);
  }

  // An image that is draped over the mesh takes the place of its own.
  bool has_textures() const override { return !is_draped(); }
  bool has_image_files() const override { return false; }
  Status WriteTexturedTriangles(std::span<const TriangleVertices> triangles,
                                std::span<const TextureCorner> corners) override {
    pages_->AddTriangles(triangles, corners);
    const uint64_t bytes = pages_->vertex_bytes() + pages_->index_bytes();
    return bytes > kLargestFile ? TooLong() : Status::Ok();
  }

  Status WritePages() {
    json_bytes_ = (Json().size() + 15 * kNumberBytes + pages_->JsonRoom() + 3) / 4 * 4;
    MTDB_RETURN_IF_ERROR(file().Append(Front()));
    MTDB_RETURN_IF_ERROR(pages_->WriteMesh(&file()));
    MTDB_RETURN_IF_ERROR(pages_->WriteImages(header(), images(), &file()));
    binary_bytes_ = pages_->vertex_bytes() + pages_->index_bytes() + pages_->image_bytes();
    if (file().bytes_written() > kLargestFile) return TooLong();
    return file().Overwrite(0, AsBytes(Front()));
  }

  Status WriteEnd() override {
    if (pages_ != nullptr) return WritePages();
    if (!empty_ && is_draped()) {
      MTDB_RETURN_IF_ERROR(file().Append(texture_.image));
      MTDB_RETURN_IF_ERROR(
          file().Append(std::string(padded_image_bytes() - texture_.image.size(), '\0')));
    }
    return file().Overwrite(0, AsBytes(Front()));
  }

  bool is_draped() const { return !texture_.image.empty(); }
  uint64_t padded_image_bytes() const { return (texture_.image.size() + 3) / 4 * 4; }
  void PutTexturePlace(Vec3d p, std::byte* out) const {
    const std::array<double, 6>& place = texture_.place;
    const float uv[2] = {static_cast<float>(place[0] + place[1] * p.x + place[2] * p.y),
                         static_cast<float>(place[3] + place[4] * p.x + place[5] * p.y)};
    std::memcpy(out, uv, sizeof(uv));
  }

  // Everything up to the vertices.
  std::string Front() const {
    const auto u32 = [](uint64_t value) {
      const auto word = static_cast<uint32_t>(value);
      return std::string(reinterpret_cast<const char*>(&word), sizeof(word));
    };
    std::string json = Json();
    json.resize(json_bytes_, ' ');
    const std::string binary = empty_ ? "" : u32(binary_bytes_) + u32(kBinaryChunk);
    const uint64_t total =
        kHeaderBytes + kChunkHeaderBytes + json_bytes_ + binary.size() + binary_bytes_;
    return u32(kMagic) + u32(2) + u32(total) + u32(json_bytes_) + u32(kJsonChunk) + json + binary;
  }

  std::string Json() const {
    std::string json = R"({"asset":{"version":"2.0","generator":"mtdb"},"scene":0,"scenes":[)";
    if (empty_) return json + "{}]}";
    json += R"({"nodes":[0]}],"nodes":[{"mesh":0)";
    json += up_frame_ ? UpMatrix() : origin_ ? ",\"translation\":" + Numbers(*origin_) : "";
    json += "}]" + (pages_ != nullptr ? pages_->MaterialsJson(2) : MaterialJson());
    std::string accessors, primitives;
    PutPrimitives(&primitives, &accessors);
    const uint64_t vertex_bytes =
        pages_ != nullptr ? pages_->vertex_bytes() : vertex_count() * stride_;
    const uint64_t index_bytes = triangle_count() * kTriangleBytes;
    std::string image;
    if (is_draped()) {
      image = ",{\"buffer\":0,\"byteOffset\":" + std::to_string(vertex_bytes + index_bytes) +
              ",\"byteLength\":" + std::to_string(texture_.image.size()) + "}";
    }
    if (pages_ != nullptr) image = pages_->ViewsJson(vertex_bytes + index_bytes);
    const uint64_t image_bytes = pages_ != nullptr ? pages_->image_bytes() : padded_image_bytes();
    return json + R"(,"meshes":[{"primitives":[)" + primitives + R"(]}],"accessors":[)" +
           accessors + R"(],"bufferViews":[{"buffer":0,"byteOffset":)" +
           std::to_string(vertex_bytes) + ",\"byteLength\":" + std::to_string(index_bytes) +
           R"(,"target":34963},{"buffer":0,"byteLength":)" + std::to_string(vertex_bytes) +
           ",\"byteStride\":" + std::to_string(stride_) + R"(,"target":34962})" + image +
           R"(],"buffers":[{"byteLength":)" +
           std::to_string(vertex_bytes + index_bytes + image_bytes) + "}]}";
  }

  // Without a texture, or with the one that is draped.
  std::string MaterialJson() const {
    std::string json = R"(,"materials":[{"pbrMetallicRoughness":{"metallicFactor":0)";
    if (is_draped()) json += R"(,"baseColorTexture":{"index":0})";
    json += R"(},"doubleSided":true}])";
    if (!is_draped()) return json;
    json += R"(,"textures":[{"sampler":0,"source":0}],"samplers":[{"wrapS":33071,"wrapT":33071}])";
    return json + R"(,"images":[{"bufferView":2,"mimeType":")" + texture_.mime_type + "\"}]";
  }

  // A primitive, and where it is in the file.
  struct Place {
    uint64_t vertices = 0, corners = 0;  // counts
    uint64_t first_vertex = 0, first_corner = 0;
    Box3d bounds;
  };
  void PutPrimitives(std::string* primitives, std::string* accessors) const {
    size_t accessor = 0, material = 0;
    if (pages_ == nullptr) {
      const Place all{vertex_count(), triangle_count() * 3, 0, 0, bounds_};
      return PutPrimitive(all, 0, &accessor, primitives, accessors);
    }
    Place place;
    for (const auto& [page, part] : pages_->parts()) {
      place.vertices = part.vertices.size();
      place.corners = part.indices.size();
      place.bounds = part.bounds;
      PutPrimitive(place, material++, &accessor, primitives, accessors);
      place.first_vertex += place.vertices;
      place.first_corner += place.corners;
    }
  }

  // Accessors are numbered from *accessor on: the indices first.
  void PutPrimitive(const Place& place, size_t material, size_t* accessor, std::string* primitives,
                    std::string* accessors) const {
    const char* const comma = *accessor == 0 ? "" : ",";
    const uint64_t begin = place.first_vertex * stride_;
    const Box3d& b = place.bounds;
    const std::string indices = std::to_string((*accessor)++);
    std::string attributes = "\"POSITION\":" + std::to_string((*accessor)++);
    std::string own = Accessor(0, place.first_corner * sizeof(uint32_t), Component::kUnsignedInt,
                               place.corners, 1) +
                      "}," + Accessor(1, begin, Component::kFloat, place.vertices, 3) +
                      ",\"min\":" + Numbers(b.empty() ? Vec3d{} : b.min) +
                      ",\"max\":" + Numbers(b.empty() ? Vec3d{} : b.max) + "}";
    for (const GltfColumns& c : columns_) {
      attributes += ",\"" + c.name + "\":" + std::to_string((*accessor)++);
      own += "," + Accessor(1, begin + c.at, c.component, place.vertices, c.offsets.size()) +
             (c.component == Component::kUnsignedShort && c.kind == GltfKind::kColour
                  ? ",\"normalized\":true}"
                  : "}");
    }
    if (is_draped() || pages_ != nullptr) {
      attributes += ",\"TEXCOORD_0\":" + std::to_string((*accessor)++);
      own += "," + Accessor(1, begin + kPositionBytes, Component::kFloat, place.vertices, 2) + "}";
    }
    *accessors += comma + own;
    *primitives += comma + std::string("{\"attributes\":{") + attributes +
                   "},\"indices\":" + indices + ",\"material\":" + std::to_string(material) + "}";
  }

  // x, y and z, in metres, become x, -z and y. Exact but for the products.
  std::string UpMatrix() const {
    const Vec3d m = up_frame_->metres;
    const Vec3d o = origin_.value_or(Vec3d{}) - up_frame_->metres_from;
    std::string text = ",\"matrix\":[";
    const std::array<double, 16> columns{m.x, 0,   0, 0, 0,         0,         -m.y,       0,
                                         0,   m.z, 0, 0, m.x * o.x, m.z * o.z, -m.y * o.y, 1};
    for (size_t i = 0; i < columns.size(); ++i) {
      if (i > 0) text += ',';
      AppendNumber(&text, columns[i] + 0.0);  // no -0
    }
    text += "],\"extras\":{\"origin\":" + Numbers(origin_.value_or(Vec3d{})) + "}";
    return text;
  }

  FloatOrigin origin_kind() const override { return FloatOrigin::kFloat32; }
  const char* position_type() const override { return "float32"; }
  void AddToReport(MeshWriteReport* report) const override {
    report->origin.reset();
    if (pages_ != nullptr) {
      for (const std::string& name : pages_->left_out()) {
        report->not_written.push_back("image " + name + ", which is neither JPEG, PNG nor WebP");
      }
    }
    if (!is_draped() && pages_ == nullptr) {
      colours_.AddToReport(nullptr, report);
      const bool integers = colours_.count() > 0 && colours_.type() != ScalarType::kUint8 &&
                            colours_.type() != ScalarType::kUint16 && !colours_.is_float();
      if (integers) report->notes.push_back("colours are rounded to 8 bits");
    }
    if (empty_) return;
    if (!up_frame_) {
      if (float_positions().has_origin()) report->node_origin = float_positions().origin();
      return;
    }
    report->notes.push_back("z is up, and y is in glTF: the file's node turns the mesh");
    const UpFrame& f = *up_frame_;
    if (f.metres == Vec3d{1, 1, 1} && f.metres_from == Vec3d{}) return;
    std::string note = "the node makes local metres of the units: 1 of x is ";
    AppendNumber(&note, f.metres.x);
    note += " m, 1 of y is ";
    AppendNumber(&note, f.metres.y);
    note += " m, 1 of z is ";
    AppendNumber(&note, f.metres.z);
    note += " m, from ";
    AppendNumber(&note, f.metres_from.x);
    note += ' ';
    AppendNumber(&note, f.metres_from.y);
    report->notes.push_back(note);
  }

  // Open at its end.
  static std::string Accessor(int view, uint64_t offset, Component component, uint64_t count,
                              size_t components) {
    return "{\"bufferView\":" + std::to_string(view) + ",\"byteOffset\":" + std::to_string(offset) +
           ",\"componentType\":" + std::to_string(static_cast<int>(component)) +
           ",\"count\":" + std::to_string(count) + ",\"type\":\"" + VectorType(components) + "\"";
  }

  using UpFrame = MeshWriteOptions::UpFrame;
  const std::optional<UpFrame> up_frame_;
  const MeshTexture texture_;         // without an image: none
  std::unique_ptr<GltfPages> pages_;  // of a textured mesh
  std::array<uint16_t, 256> linear_{};
  ColourReader colours_;
  NormalAttributes normals_;
  std::vector<GltfColumns> columns_;
  size_t stride_ = 0;  // bytes of a vertex
  bool empty_ = false;
  size_t json_bytes_ = 0;  // with the spaces after it
  uint64_t binary_bytes_ = 0;
  // Float32 positions are offsets from here, the node's translation; the first vertex where the
  // mesh's bounds are not known.
  std::optional<Vec3d> origin_;
  Box3d bounds_;  // of the float32 positions
  Bytes buffer_;
};

}  // namespace

std::unique_ptr<MeshWriter> CreateGltfWriter(const std::string& path,
                                             const MeshWriteOptions& options) {
  return std::make_unique<GltfWriter>(path, options);
}

}  // namespace mtdb::internal

namespace mtdb {

Result<std::unique_ptr<MeshFileWriter>> CreateDrapedMeshFileWriter(
    const std::string& path, MeshTexture texture, const MeshWriteOptions& options) {
  MTDB_ASSIGN_OR_RETURN(const MeshFormat format, WrittenMeshFormatOf(path));
  if (format.suffixes.front() != "glb") {
    return Unsupported(path + ": only .glb carries an image that is draped");
  }
  return std::unique_ptr<MeshFileWriter>(
      new internal::GltfWriter(path, options, std::move(texture)));
}

}  // namespace mtdb
