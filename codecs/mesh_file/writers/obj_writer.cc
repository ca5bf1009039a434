// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "codecs/mesh_file/writers/mesh_writer.h"
#include "codecs/mesh_file/writers/text_format.h"

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
    colours_ = ColourReader(FindColours(header().attributes));
    normals_ = FindNormals(header().attributes);
    Carry(colours_.indices(3));
    if (normals_.found) Carry(normals_.indices);
    return Status::Ok();
  }

  Status WriteVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    const size_t row_bytes = header().attributes.row_bytes();
    text_.clear();
    for (size_t i = 0; i < positions.size(); ++i) {
      text_ += "v ";
      if (!AppendPosition(&text_, positions[i])) return TooLarge();
      for (int c = 0; c < 3 && colours_.count() > 0; ++c) {
        text_ += ' ';
        AppendNumber(&text_, static_cast<float>(colours_.Part(rows.data() + i * row_bytes, c)));
      }
      text_ += '\n';
      if (normals_.found) AppendNormal(rows.data() + i * row_bytes);
    }
    return file().Append(text_);
  }

  void AppendNormal(const std::byte* row) {
    text_ += "vn";
    const Vec3d normal = NormalIn(row, normals_);
    for (int i = 0; i < 3; ++i) {
      const auto value = static_cast<float>(normal[i]);
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

  const char* position_type() const override { return "decimal"; }
  void AddToReport(MeshWriteReport* report) const override {
    colours_.AddToReport(nullptr, report);
  }

  ColourReader colours_;
  NormalAttributes normals_;
  std::string text_;
};

}  // namespace

std::unique_ptr<MeshWriter> CreateObjWriter(const std::string& path) {
  return std::make_unique<ObjWriter>(path);
}

}  // namespace mtdb::internal
