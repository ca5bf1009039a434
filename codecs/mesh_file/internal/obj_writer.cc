#include "codecs/mesh_file/internal/mesh_writer.h"
#include "codecs/mesh_file/internal/text_format.h"

namespace mtdb::internal {
namespace {

// "v X Y Z" (with "R G B" from 0 to 1 where the mesh has colours), then "f A B C". Other attributes
// have no place in OBJ.
class ObjWriter final : public MeshWriter {
 public:
  using MeshWriter::MeshWriter;
  double LargestRounding(const MeshHeader&) const override { return 0; }

 private:
  Status WriteHeader() override {
    colours_ = FindColours(header().attributes);
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
    }
    return file().Append(text_);
  }

  Status WriteTriangles(std::span<const TriangleVertices> triangles) override {
    text_.clear();
    for (const TriangleVertices& t : triangles) {
      text_ += 'f';
      for (const VertexIndex v : t) {
        text_ += ' ';
        AppendNumber(&text_, v + 1);
      }
      text_ += '\n';
    }
    return file().Append(text_);
  }

  ColourColumns colours_;
  std::string text_;
};

}  // namespace

std::unique_ptr<MeshWriter> CreateObjWriter(const std::string& path) {
  return std::make_unique<ObjWriter>(path);
}

}  // namespace mtdb::internal
