// SPDX-License-Identifier: Apache-2.0
#include <cstring>

#include "codecs/mesh_file/internal/mesh_writer.h"

namespace mtdb::internal {
namespace {

const char* PlyTypeName(ScalarType type) {
  switch (type) {
    case ScalarType::kInt8: return "char";
    case ScalarType::kUint8: return "uchar";
    case ScalarType::kInt16: return "short";
    case ScalarType::kUint16: return "ushort";
    case ScalarType::kInt32: return "int";
    case ScalarType::kUint32: return "uint";
    case ScalarType::kFloat32: return "float";
    case ScalarType::kFloat64: return "double";
  }
  return "";
}

// Binary little endian: x y z, the attributes, then "3 a b c".
class PlyWriter final : public MeshWriter {
 public:
  using MeshWriter::MeshWriter;
  double LargestRounding(const MeshHeader&) const override { return 0; }

 private:
  Status WriteHeader() override {
    constexpr uint64_t kMaxInt = uint64_t{1} << 31;
    constexpr uint64_t kMaxUint = uint64_t{1} << 32;
    if (vertex_count() > kMaxUint) {
      return InvalidArgument(path() + ": PLY holds at most 4294967296 vertices, but the mesh has " +
                             std::to_string(vertex_count()) + "; ask for a part of it");
    }
    std::string text = "ply\nformat binary_little_endian 1.0\n";
    text += "element vertex " + std::to_string(vertex_count()) + "\n";
    const char* const position_type = header().double_positions ? "double" : "float";
    for (const char* axis : {"x", "y", "z"}) {
      text += std::string("property ") + position_type + " " + axis + "\n";
    }
    for (const VertexAttribute& a : header().attributes.attributes) {
      text += std::string("property ") + PlyTypeName(a.type) + " " + a.name + "\n";
    }
    text += "element face " + std::to_string(triangle_count()) + "\n";
    text += std::string("property list uchar ") + (vertex_count() > kMaxInt ? "uint" : "int") +
            " vertex_indices\nend_header\n";
    return file().Append(text);
  }

  Status WriteVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    const size_t row_bytes = header().attributes.row_bytes();
    const size_t position_bytes = header().double_positions ? sizeof(Vec3d) : sizeof(Vec3f);
    const size_t stride = position_bytes + row_bytes;
    buffer_.resize(positions.size() * stride);
    std::byte* out = buffer_.data();
    for (size_t i = 0; i < positions.size(); ++i, out += stride) {
      const Vec3d p = positions[i];
      if (header().double_positions) {
        std::memcpy(out, &p, sizeof(p));
      } else {
        Vec3f f;
        if (!float_positions().Round(p, &f)) return TooLarge();
        std::memcpy(out, &f, sizeof(f));
      }
      if (row_bytes > 0) std::memcpy(out + position_bytes, rows.data() + i * row_bytes, row_bytes);
    }
    return file().Append(buffer_);
  }

  Status WriteTriangles(std::span<const TriangleVertices> triangles) override {
    constexpr size_t kTriangleBytes = 13;
    buffer_.resize(triangles.size() * kTriangleBytes);
    std::byte* out = buffer_.data();
    for (const TriangleVertices& t : triangles) {
      const uint32_t v[3] = {static_cast<uint32_t>(t[0]), static_cast<uint32_t>(t[1]),
                             static_cast<uint32_t>(t[2])};
      out[0] = std::byte{3};
      std::memcpy(out + 1, v, sizeof(v));
      out += kTriangleBytes;
    }
    return file().Append(buffer_);
  }

  Bytes buffer_;
};

}  // namespace

std::unique_ptr<MeshWriter> CreatePlyWriter(const std::string& path) {
  return std::make_unique<PlyWriter>(path);
}

}  // namespace mtdb::internal
