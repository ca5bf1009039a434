// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstring>
#include <set>

#include "codecs/mesh_file/writers/mesh_writer.h"

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

// Half a unit in the last place of a coordinate of less than so many steps is at most an eighth of
// a step.
constexpr double kMostFloatSteps = 0x1p21;

// Binary little endian: x y z, the attributes, then "3 a b c". Positions are float32 when they are
// float32 values, or lie on a grid whose points stay apart: no coordinate moves by more than an
// eighth of the grid's step, which is less than what the grid itself may have moved it by. Else,
// and where that is asked for, they are double. Triangles of a textured mesh have their coordinates
// behind them, "6 u v u v u v", and the number of their image where there are several.
class PlyWriter final : public MeshWriter {
 public:
  PlyWriter(const std::string& path, const MeshWriteOptions& options)
      : MeshWriter(path), wants_doubles_(options.double_positions) {}
  double LargestRounding(const MeshHeader& header) const override {
    return HasDoubles(header) ? 0 : MeshWriter::LargestRounding(header);
  }

 private:
  bool HasDoubles(const MeshHeader& header) const {
    if (wants_doubles_) return true;
    if (!header.double_positions) return false;
    const Box3d& b = header.bounds;
    double most = 0;
    for (int i = 0; i < 3; ++i) most = std::max({most, std::abs(b.min[i]), std::abs(b.max[i])});
    constexpr double kLargest = 1e30;  // below what float32 holds, and above the smallest denormals
    return header.position_step < 1 / kLargest || b.empty() || most > kLargest ||
           most > kMostFloatSteps * header.position_step;
  }

  Status WriteHeader() override {
    CarryAll();
    doubles_ = HasDoubles(header());
    constexpr uint64_t kMaxInt = uint64_t{1} << 31;
    constexpr uint64_t kMaxUint = uint64_t{1} << 32;
    if (vertex_count() > kMaxUint) {
      return InvalidArgument(path() + ": PLY holds at most 4294967296 vertices, but the mesh has " +
                             std::to_string(vertex_count()) + "; ask for a part of it");
    }
    std::string text = "ply\nformat binary_little_endian 1.0\n";
    // A single page that nobody has the bytes of is what readers make of no comment.
    const bool has_comments =
        is_textured() && (header().textures.size() > 1 || images().has_some());
    for (uint32_t page = 0; has_comments && page < header().textures.size(); ++page) {
      text += "comment TextureFile " + images().name(page) + "\n";
    }
    text += "element vertex " + std::to_string(vertex_count()) + "\n";
    const char* const position_type = doubles_ ? "double" : "float";
    for (const char* axis : {"x", "y", "z"}) {
      text += std::string("property ") + position_type + " " + axis + "\n";
    }
    std::set<std::string> names;
    for (const VertexAttribute& a : header().attributes.attributes) {
      text += std::string("property ") + PlyTypeName(a.type) + " " + PlyName(a.name, &names) + "\n";
    }
    text += "element face " + std::to_string(triangle_count()) + "\n";
    text += std::string("property list uchar ") + (vertex_count() > kMaxInt ? "uint" : "int") +
            " vertex_indices\n";
    if (is_textured()) text += "property list uchar float texcoord\nproperty int texnumber\n";
    text += "end_header\n";
    return file().Append(text);
  }

  // A name without spaces, which end one in PLY, and that none has yet.
  std::string PlyName(const std::string& name, std::set<std::string>* names) const {
    std::string plain = name;
    std::ranges::replace(plain, ' ', '_');
    std::string unique = plain;
    // Nor one that an attribute behind this one has.
    const auto is_taken = [&](const std::string& wanted) {
      return names->contains(wanted) ||
             (wanted != name &&
              std::ranges::find(header().attributes.attributes, wanted, &VertexAttribute::name) !=
                  header().attributes.attributes.end());
    };
    for (int i = 2; is_taken(unique); ++i) unique = plain + "_" + std::to_string(i);
    names->insert(unique);
    return unique;
  }

  Status WriteVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    const size_t row_bytes = header().attributes.row_bytes();
    const size_t position_bytes = doubles_ ? sizeof(Vec3d) : sizeof(Vec3f);
    const size_t stride = position_bytes + row_bytes;
    buffer_.resize(positions.size() * stride);
    std::byte* out = buffer_.data();
    for (size_t i = 0; i < positions.size(); ++i, out += stride) {
      const Vec3d p = positions[i];
      if (doubles_) {
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

  bool has_textures() const override { return true; }
  Status WriteTexturedTriangles(std::span<const TriangleVertices> triangles,
                                std::span<const TextureCorner> corners) override {
    constexpr size_t kTriangleBytes = 13 + 1 + 6 * sizeof(float) + sizeof(int32_t);
    buffer_.resize(triangles.size() * kTriangleBytes);
    std::byte* out = buffer_.data();
    const auto put = [&out](auto value) {
      std::memcpy(out, &value, sizeof(value));
      out += sizeof(value);
    };
    for (const TriangleVertices& t : triangles) {
      put(uint8_t{3});
      for (const VertexIndex v : t) put(static_cast<uint32_t>(v));
      put(uint8_t{6});
      const uint32_t page = corners.front().page;
      for (const TextureCorner& corner : corners.first(3)) {
        put(corner.u);
        put(corner.v);
      }
      put(page == TextureCorner::kNoPage ? int32_t{-1} : static_cast<int32_t>(page));
      corners = corners.subspan(3);
    }
    return file().Append(buffer_);
  }

  const char* position_type() const override { return doubles_ ? "float64" : "float32"; }
  void AddToReport(MeshWriteReport* report) const override {
    constexpr size_t kMostNamed = 40;
    std::set<std::string> names;
    size_t renamed = 0;
    for (const VertexAttribute& a : header().attributes.attributes) {
      const std::string name = PlyName(a.name, &names);
      if (name == a.name || ++renamed > kMostNamed) continue;
      report->notes.push_back("attribute '" + a.name + "' is named '" + name + "' in the file");
    }
    if (renamed > kMostNamed) {
      report->notes.push_back(std::to_string(renamed - kMostNamed) +
                              " more attributes have other names in the file");
    }
  }

  const bool wants_doubles_;
  bool doubles_ = false;
  Bytes buffer_;
};

}  // namespace

std::unique_ptr<MeshWriter> CreatePlyWriter(const std::string& path,
                                            const MeshWriteOptions& options) {
  return std::make_unique<PlyWriter>(path, options);
}

}  // namespace mtdb::internal
