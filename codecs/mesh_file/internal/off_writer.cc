// SPDX-License-Identifier: Apache-2.0
#include <cstring>

#include "codecs/mesh_file/internal/mesh_writer.h"
#include "codecs/mesh_file/internal/text_format.h"

namespace mtdb::internal {
namespace {

// OFF, with C and N as the mesh has colours and normals. Other attributes have no place in OFF.
class OffWriter final : public MeshWriter {
 public:
  using MeshWriter::MeshWriter;
  double LargestRounding(const MeshHeader&) const override { return 0; }

 private:
  Status WriteHeader() override {
    colours_ = FindColours(header().attributes);
    normals_ = FindNormals(header().attributes);
    std::string text = colours_.count > 0 ? "C" : "";
    if (normals_.found) text += "N";
    return file().Append(text + "OFF\n" + std::to_string(vertex_count()) + " " +
                         std::to_string(triangle_count()) + " 0\n");
  }

  Status WriteVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    const size_t row_bytes = header().attributes.row_bytes();
    text_.clear();
    for (size_t i = 0; i < positions.size(); ++i) {
      const ByteSpan row = rows.subspan(i * row_bytes, row_bytes);
      if (!AppendPosition(&text_, positions[i])) return TooLarge();
      for (int axis = 0; axis < 3 && normals_.found; ++axis) {
        float value = 0;
        std::memcpy(&value, row.data() + normals_.offsets[axis], sizeof(value));
        text_ += ' ';
        AppendNumber(&text_, value);
      }
      // COFF wants four components.
      for (int c = 0; c < 4 && colours_.count > 0; ++c) {
        text_ += ' ';
        AppendNumber(&text_, c < colours_.count ? static_cast<int>(row[colours_.offsets[c]]) : 255);
      }
      text_ += '\n';
    }
    return file().Append(text_);
  }

  Status WriteTriangles(std::span<const TriangleVertices> triangles) override {
    text_.clear();
    for (const TriangleVertices& t : triangles) {
      text_ += '3';
      for (const VertexIndex v : t) {
        text_ += ' ';
        AppendNumber(&text_, v);
      }
      text_ += '\n';
    }
    return file().Append(text_);
  }

  ColourColumns colours_;
  NormalColumns normals_;
  std::string text_;
};

}  // namespace

std::unique_ptr<MeshWriter> CreateOffWriter(const std::string& path) {
  return std::make_unique<OffWriter>(path);
}

}  // namespace mtdb::internal
