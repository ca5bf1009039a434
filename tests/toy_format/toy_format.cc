// SPDX-License-Identifier: Apache-2.0
// A program that is linked with this file knows one mesh format more, the toy: text, "toy", the
// counts of vertices and triangles, and their numbers. This is all that a new format needs.
#include "codecs/mesh_file/input/text_reader.h"
#include "codecs/mesh_file/polygons/mesh_emitter.h"
#include "codecs/mesh_file/readers/mesh_format_table.h"
#include "codecs/mesh_file/readers/readers.h"
#include "codecs/mesh_file/writers/text_format.h"

namespace mtdb::internal {

namespace {

MeshFileFit RecogniseToy(const MeshFileStart& start) {
  return StartsWithWord(start.bytes, "toy") ? MeshFileFit::kContent : MeshFileFit::kNone;
}

Status ReadToy(const InputFile& file, const MeshFileStart&, MeshSink& sink,
               MeshReadReport* report) {
  report->format = "toy";
  TextReader text(file);
  std::string_view token;
  const auto number = [&](double* value) {
    return text.NextToken(&token) && ParseReal(token, value);
  };
  const auto wrong = [&] {
    return BadInput(file.path() + ": line " + std::to_string(text.line()) +
                    ": expected a number of a toy");
  };
  double vertices = 0, triangles = 0;
  if (!text.NextToken(&token) || !number(&vertices) || !number(&triangles)) return wrong();
  MeshHeader header;
  header.double_positions = true;
  MeshEmitter emitter(sink);
  MTDB_RETURN_IF_ERROR(emitter.Begin(header));
  for (double i = 0; i < vertices; ++i) {
    Vec3d p;
    if (!number(&p.x) || !number(&p.y) || !number(&p.z)) return wrong();
    MTDB_RETURN_IF_ERROR(emitter.AddVertex(p, {}));
  }
  for (double i = 0; i < triangles; ++i) {
    double corners[3];
    for (double& corner : corners) {
      if (!number(&corner) || !(corner >= 0 && corner < vertices)) return wrong();
    }
    MTDB_RETURN_IF_ERROR(emitter.AddTriangle(static_cast<VertexIndex>(corners[0]),
                                             static_cast<VertexIndex>(corners[1]),
                                             static_cast<VertexIndex>(corners[2])));
  }
  return emitter.End();
}

class ToyWriter final : public MeshWriter {
 public:
  using MeshWriter::MeshWriter;
  double LargestRounding(const MeshHeader&) const override { return 0; }

 private:
  const char* position_type() const override { return "decimal"; }
  Status WriteHeader() override {
    return file().Append("toy " + std::to_string(vertex_count()) + " " +
                         std::to_string(triangle_count()) + "\n");
  }
  Status WriteVertices(std::span<const Vec3d> positions, ByteSpan) override {
    std::string text;
    for (const Vec3d& p : positions) {
      for (int axis = 0; axis < 3; ++axis) {
        AppendNumber(&text, p[axis]);
        text += axis < 2 ? ' ' : '\n';
      }
    }
    return file().Append(text);
  }
  Status WriteTriangles(std::span<const TriangleVertices> triangles) override {
    std::string text;
    for (const TriangleVertices& t : triangles) {
      for (const VertexIndex v : t) text += std::to_string(v) + " ";
      text.back() = '\n';
    }
    return file().Append(text);
  }
};

Result<std::unique_ptr<MeshWriter>> CreateToyWriter(const std::string& path,
                                                    const MeshWriteOptions&) {
  return std::unique_ptr<MeshWriter>(std::make_unique<ToyWriter>(path));
}

}  // namespace

// In place of the library's.
const std::vector<MeshFormatRow>& MeshFormatTable() {
  static const std::vector<MeshFormatRow> kTable = [] {
    std::vector<MeshFormatRow> rows = OwnMeshFormats();
    rows.push_back({.format = {.name = "Toy",
                               .suffixes = {"toy", "toytown"},
                               .content_type = "model/toy",
                               .exact = true},
                    .recognise = RecogniseToy,
                    .read = ReadToy,
                    .create_writer = CreateToyWriter});
    return rows;
  }();
  return kTable;
}

}  // namespace mtdb::internal
