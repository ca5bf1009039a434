// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstring>

#include "codecs/mesh_file/internal/mesh_writer.h"
#include "codecs/mesh_file/internal/text_format.h"

namespace mtdb::internal {
namespace {

// "v X Y Z" (with "R G B" from 0 to 1 where the mesh has colours), and "vn X Y Z" where it has
// normals, then "f A B C", or "f A//A B//B C//C". Other attributes have no place in OBJ.
class ObjWriter final : public MeshWriter {
 public:
  using MeshWriter::MeshWriter;
  double LargestRounding(const MeshHeader&) const override { return 0; }

 private:
  Status WriteHeader() override {
    colours_ = FindColours(header().attributes);
    normals_ = FindNormals(header().attributes);
    return Status::Ok();
  }

  Status WriteVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    const size_t row_bytes = header().attributes.row_bytes();
    text_.clear();
    for (size_t i = 0; i < positions.size(); ++i) {
      text_ += "v ";
      if (!AppendPosition(&text_, positions[i])) return TooLarge();
      for (int c = 0; c < 3 && colours_.count > 0; ++c) {
        text_ += ' ';
        AppendNumber(&text_,
                     std::to_integer<int>(rows[i * row_bytes + colours_.offsets[c]]) / 255.0f);
      }
      text_ += '\n';
      if (normals_.found) AppendNormal(rows.data() + i * row_bytes);
    }
    return file().Append(text_);
  }

  void AppendNormal(const std::byte* row) {
    text_ += "vn";
    for (const size_t offset : normals_.offsets) {
      float value = 0;
      std::memcpy(&value, row + offset, sizeof(value));
      text_ += ' ';
      AppendNumber(&text_, std::isfinite(value) ? value : 0.0f);
    }
    text_ += '\n';
  }

  Status WriteTriangles(std::span<const TriangleVertices> triangles) override {
    text_.clear();
    for (const TriangleVertices& t : triangles) {
      text_ += 'f';
      for (const VertexIndex v : t) {
        text_ += ' ';
        AppendNumber(&text_, v + 1);
        if (!normals_.found) continue;
        text_ += "//";
        AppendNumber(&text_, v + 1);
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

std::unique_ptr<MeshWriter> CreateObjWriter(const std::string& path) {
  return std::make_unique<ObjWriter>(path);
}

}  // namespace mtdb::internal
