// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "codecs/mesh_file/writers/mesh_writer.h"
#include "codecs/mesh_file/writers/text_format.h"

namespace mtdb::internal {
namespace {

// OFF, with C where the mesh has colours, and with N where it has normals that are asked for: many
// programs know neither NOFF nor CNOFF. Other attributes have no place in OFF.
class OffWriter final : public MeshWriter {
 public:
  OffWriter(const std::string& path, const MeshWriteOptions& options)
      : MeshWriter(path), wants_normals_(options.off_normals) {}
  double LargestRounding(const MeshHeader&) const override { return 0; }

 private:
  Status WriteHeader() override {
    colours_ = ColourReader(FindColours(header().attributes));
    if (wants_normals_) normals_ = FindNormals(header().attributes);
    Carry(colours_.indices());
    if (normals_.found) Carry(normals_.indices);
    std::string text = colours_.count() > 0 ? "C" : "";
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
      if (normals_.found) AppendNormal(row.data());
      // COFF wants four components.
      for (int c = 0; c < 4 && colours_.count() > 0; ++c) {
        text_ += ' ';
        AppendNumber(&text_, c < colours_.count() ? int{colours_.Byte(row.data(), c)} : 255);
      }
      text_ += '\n';
    }
    return file().Append(text_);
  }

  void AppendNormal(const std::byte* row) {
    const Vec3d normal = NormalIn(row, normals_);
    for (int axis = 0; axis < 3; ++axis) {
      const auto value = static_cast<float>(normal[axis]);
      text_ += ' ';
      AppendNumber(&text_, std::isfinite(value) ? value : 0.0f);
    }
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

  const char* position_type() const override { return "decimal"; }
  void AddToReport(MeshWriteReport* report) const override {
    colours_.AddToReport("8 bits", report);
  }

  const bool wants_normals_;
  ColourReader colours_;
  NormalAttributes normals_;
  std::string text_;
};

}  // namespace

std::unique_ptr<MeshWriter> CreateOffWriter(const std::string& path,
                                            const MeshWriteOptions& options) {
  return std::make_unique<OffWriter>(path, options);
}

}  // namespace mtdb::internal
