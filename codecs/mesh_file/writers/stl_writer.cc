// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstring>
#include <vector>

#include "codecs/mesh_file/readers/readers.h"
#include "codecs/mesh_file/writers/mesh_writer.h"
#include "codecs/mesh_file/writers/text_format.h"

namespace mtdb::internal {
namespace {

// Binary STL. Keeps the positions, as float32: 12 bytes a vertex.
class StlWriter final : public MeshWriter {
 public:
  using MeshWriter::MeshWriter;

 private:
  Status WriteHeader() override {
    constexpr uint64_t kMaxTriangles = 0xffffffffu;
    if (triangle_count() > kMaxTriangles) {
      return InvalidArgument(
          path() + ": STL holds at most 4294967295 triangles, but the mesh has " +
          std::to_string(triangle_count()) + "; write PLY or ask for a part of it");
    }
    // Spaces, as a reader might take a line end for text.
    std::string text = "binary STL by mtdb";
    if (const FloatPositions& positions = float_positions(); positions.has_origin()) {
      text += kStlOriginWord;
      for (int i = 0; i < 3; ++i) {
        text += ' ';
        AppendNumber(&text, positions.origin()[i]);
      }
    }
    MTDB_CHECK(text.size() <= 80, "the header of an STL has 80 bytes");
    text.resize(80, ' ');
    const auto count = static_cast<uint32_t>(triangle_count());
    text.append(reinterpret_cast<const char*>(&count), sizeof(count));
    return file().Append(text);
  }

  Status WriteVertices(std::span<const Vec3d> positions, ByteSpan) override {
    for (const Vec3d& p : positions) {
      Vec3f f;
      if (!float_positions().Round(p, &f)) return TooLarge();
      positions_.push_back(f);
    }
    return Status::Ok();
  }

  Status WriteTriangles(std::span<const TriangleVertices> triangles) override {
    constexpr size_t kTriangleBytes = 50;
    buffer_.assign(triangles.size() * kTriangleBytes, std::byte{0});
    std::byte* out = buffer_.data();
    for (const TriangleVertices& t : triangles) {
      const Vec3f corners[3] = {positions_[t[0]], positions_[t[1]], positions_[t[2]]};
      const Vec3f normal = Normal(corners);
      std::memcpy(out, &normal, sizeof(normal));
      std::memcpy(out + sizeof(normal), corners, sizeof(corners));
      out += kTriangleBytes;
    }
    return file().Append(buffer_);
  }

  // Of length 1; zero for a triangle without area.
  static Vec3f Normal(const Vec3f (&corners)[3]) {
    const auto at = [&](int i) { return Vec3d{corners[i].x, corners[i].y, corners[i].z}; };
    const Vec3d n = Cross(at(1) - at(0), at(2) - at(0));
    const double length = Length(n);
    if (!(length > 0) || !std::isfinite(length)) return {};
    return {static_cast<float>(n.x / length), static_cast<float>(n.y / length),
            static_cast<float>(n.z / length)};
  }

  FloatOrigin origin_kind() const override { return FloatOrigin::kDecimals; }
  const char* position_type() const override { return "float32"; }

  std::vector<Vec3f> positions_;
  Bytes buffer_;
};

}  // namespace

std::unique_ptr<MeshWriter> CreateStlWriter(const std::string& path) {
  return std::make_unique<StlWriter>(path);
}

}  // namespace mtdb::internal
