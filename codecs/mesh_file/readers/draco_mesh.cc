// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/readers/draco_mesh.h"

#include <cmath>
#include <cstring>
#include <draco/compression/decode.h>
#include <draco/mesh/mesh.h>
#include <new>
#include <utility>
#include <vector>

namespace mtdb::internal {

namespace {

// The counts that a file promises, read as Draco reads them, before Draco takes memory for them.
class Promise {
 public:
  explicit Promise(ByteSpan bytes) : bytes_(bytes) {}

  // False where the bytes end before.
  bool Read(uint64_t* faces, uint64_t* points) {
    constexpr size_t kMagicBytes = 5;
    constexpr uint16_t kHasMetadata = 0x8000;
    at_ = kMagicBytes;
    uint8_t major = 0, minor = 0, geometry = 0, method = 0, low = 0, high = 0;
    for (uint8_t* byte : {&major, &minor, &geometry, &method, &low, &high}) {
      if (!Byte(byte)) return false;
    }
    version_ = static_cast<uint16_t>(major << 8 | minor);
    if (((high << 8 | low) & kHasMetadata) != 0 && !SkipAllMetadata()) return false;
    constexpr uint8_t kEdgebreaker = 1;
    if (method == kEdgebreaker) {
      uint8_t traversal = 0;
      if (!Byte(&traversal)) return false;
      if (version_ < 0x0202 && !Number(points)) return false;  // new vertices
      return Number(points) && Number(faces);
    }
    return Number(faces) && Number(points);
  }

 private:
  bool Byte(uint8_t* value) {
    if (at_ >= bytes_.size()) return false;
    *value = std::to_integer<uint8_t>(bytes_[at_++]);
    return true;
  }
  // 32 bits before version 2.2, else seven bits a byte.
  bool Number(uint64_t* value) {
    if (version_ >= 0x0202) return Variable(value);
    *value = 0;
    for (int shift = 0; shift < 32; shift += 8) {
      uint8_t byte = 0;
      if (!Byte(&byte)) return false;
      *value |= uint64_t{byte} << shift;
    }
    return true;
  }
  bool Variable(uint64_t* value) {
    *value = 0;
    for (int shift = 0; shift < 63; shift += 7) {
      uint8_t byte = 0;
      if (!Byte(&byte)) return false;
      *value |= uint64_t{byte & 0x7fu} << shift;
      if ((byte & 0x80) == 0) return true;
    }
    return false;
  }
  bool Skip(uint64_t bytes) {
    if (bytes > bytes_.size() - at_) return false;
    at_ += bytes;
    return true;
  }
  bool SkipName() {
    uint8_t size = 0;
    return Byte(&size) && Skip(size);
  }
  bool SkipMetadata(int depth) {
    constexpr int kMostDepth = 16;
    uint64_t entries = 0, children = 0;
    if (depth > kMostDepth || !Variable(&entries)) return false;
    for (uint64_t i = 0; i < entries; ++i) {
      uint64_t size = 0;
      if (!SkipName() || !Variable(&size) || !Skip(size)) return false;
    }
    if (!Variable(&children)) return false;
    for (uint64_t i = 0; i < children; ++i) {
      if (!SkipName() || !SkipMetadata(depth + 1)) return false;
    }
    return true;
  }
  bool SkipAllMetadata() {
    uint64_t attributes = 0;
    if (!Variable(&attributes)) return false;
    for (uint64_t i = 0; i < attributes; ++i) {
      uint64_t id = 0;
      if (!Variable(&id) || !SkipMetadata(0)) return false;
    }
    return SkipMetadata(0);
  }

  ByteSpan bytes_;
  size_t at_ = 0;
  uint16_t version_ = 0;
};

ScalarType TypeOf(draco::DataType type) {
  switch (type) {
    case draco::DT_INT8: return ScalarType::kInt8;
    case draco::DT_BOOL:
    case draco::DT_UINT8: return ScalarType::kUint8;
    case draco::DT_INT16: return ScalarType::kInt16;
    case draco::DT_UINT16: return ScalarType::kUint16;
    case draco::DT_INT32: return ScalarType::kInt32;
    case draco::DT_UINT32: return ScalarType::kUint32;
    case draco::DT_FLOAT32: return ScalarType::kFloat32;
    default: return ScalarType::kFloat64;
  }
}

DracoKind KindOf(draco::GeometryAttribute::Type type) {
  switch (type) {
    case draco::GeometryAttribute::POSITION: return DracoKind::kPosition;
    case draco::GeometryAttribute::NORMAL: return DracoKind::kNormal;
    case draco::GeometryAttribute::COLOR: return DracoKind::kColour;
    case draco::GeometryAttribute::TEX_COORD: return DracoKind::kTexture;
    default: return DracoKind::kGeneric;
  }
}

class Decoded final : public DracoMesh {
 public:
  explicit Decoded(std::unique_ptr<draco::Mesh> mesh) : mesh_(std::move(mesh)) {
    std::vector<double> origin;
    if (mesh_->GetMetadata() != nullptr &&
        mesh_->GetMetadata()->GetEntryDoubleArray("origin", &origin) && origin.size() == 3) {
      const Vec3d o{origin[0], origin[1], origin[2]};
      if (std::isfinite(o.x) && std::isfinite(o.y) && std::isfinite(o.z)) origin_ = o;
    }
  }

  uint32_t points() const override { return mesh_->num_points(); }
  uint32_t triangles() const override { return mesh_->num_faces(); }
  TriangleVertices triangle(uint32_t index) const override {
    const draco::Mesh::Face& face = mesh_->face(draco::FaceIndex(index));
    return {face[0].value(), face[1].value(), face[2].value()};
  }
  std::vector<DracoAttribute> attributes() const override {
    std::vector<DracoAttribute> list;
    for (int i = 0; i < mesh_->num_attributes(); ++i) {
      const draco::PointAttribute& a = *mesh_->attribute(i);
      DracoAttribute attribute{
          i, a.unique_id(), KindOf(a.attribute_type()), TypeOf(a.data_type()), a.num_components(),
          ""};
      const draco::AttributeMetadata* metadata = mesh_->GetAttributeMetadataByAttributeId(i);
      if (metadata != nullptr) metadata->GetEntryString("name", &attribute.name);
      list.push_back(std::move(attribute));
    }
    return list;
  }
  std::array<double, 4> Value(int attribute, uint32_t point) const override {
    const draco::PointAttribute& a = *mesh_->attribute(attribute);
    std::array<double, 4> value{};
    const draco::AttributeValueIndex index = a.mapped_index(draco::PointIndex(point));
    if (index.value() >= a.size()) return value;
    // Not ConvertValue, which takes normalized integers for parts of one.
    const size_t size = ScalarSize(TypeOf(a.data_type()));
    const uint8_t* bytes = a.GetAddress(index);
    for (int c = 0; c < std::min<int>(a.num_components(), 4); ++c) {
      value[static_cast<size_t>(c)] =
          ScalarValue(reinterpret_cast<const std::byte*>(bytes) + static_cast<size_t>(c) * size,
                      TypeOf(a.data_type()));
    }
    return value;
  }
  Vec3d origin() const override { return origin_; }

 private:
  static double ScalarValue(const std::byte* bytes, ScalarType type) {
    const auto as = [&]<typename T>(T number) {
      std::memcpy(&number, bytes, sizeof(number));
      return static_cast<double>(number);
    };
    switch (type) {
      case ScalarType::kInt8: return as(int8_t{});
      case ScalarType::kUint8: return as(uint8_t{});
      case ScalarType::kInt16: return as(int16_t{});
      case ScalarType::kUint16: return as(uint16_t{});
      case ScalarType::kInt32: return as(int32_t{});
      case ScalarType::kUint32: return as(uint32_t{});
      case ScalarType::kFloat32: return as(float{});
      case ScalarType::kFloat64: return as(double{});
    }
    return 0;
  }

  std::unique_ptr<draco::Mesh> mesh_;
  Vec3d origin_;
};

}  // namespace

Result<std::unique_ptr<DracoMesh>> DracoMesh::Decode(ByteSpan bytes, const std::string& where) {
  uint64_t faces = 0, points = 0;
  if (!Promise(bytes).Read(&faces, &points)) {
    return BadInput(where + ": Draco: the data is cut short");
  }
  if (std::max(faces, points) / kMostPerByte > bytes.size()) {
    return BadInput(where + ": Draco: " + std::to_string(bytes.size()) + " bytes promise " +
                    std::to_string(faces) + " triangles and " + std::to_string(points) +
                    " vertices; the data is damaged");
  }
  try {
    draco::DecoderBuffer buffer;
    buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    draco::Decoder decoder;
    auto mesh = decoder.DecodeMeshFromBuffer(&buffer);
    if (!mesh.ok()) {
      return BadInput(where + ": Draco cannot decode it: " + mesh.status().error_msg_string());
    }
    return std::unique_ptr<DracoMesh>(std::make_unique<Decoded>(std::move(mesh).value()));
  } catch (const std::bad_alloc&) {
    return Status(StatusCode::kNoSpace, where + ": not enough memory to decode " +
                                            std::to_string(faces) + " triangles with Draco");
  }
}

}  // namespace mtdb::internal
