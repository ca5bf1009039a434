// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/internal/mesh_writer.h"

#include <utility>

#include "codecs/mesh_file/internal/text_format.h"

namespace mtdb::internal {

Status MeshWriter::Begin(const MeshHeader& header) {
  MTDB_CHECK(file_ == nullptr && bytes_written_ == 0, "Begin is called once");
  header_ = header;
  if (!header.vertex_count || !header.triangle_count) {
    return InvalidArgument(path_ +
                           ": the format needs the counts of vertices and triangles up front, but "
                           "they are not known; read the mesh into memory first");
  }
  positions_ = FloatPositions(header);
  MTDB_ASSIGN_OR_RETURN(
      file_, descriptor_ < 0 ? AtomicFile::Create(path_) : AtomicFile::Into(descriptor_, path_));
  return WriteHeader();
}

Status MeshWriter::AddVertices(std::span<const Vec3d> positions, ByteSpan rows) {
  MTDB_CHECK(file_ != nullptr, "AddVertices outside Begin and End");
  MTDB_CHECK(rows.size() == positions.size() * header_.attributes.row_bytes(),
             "one row of attributes per position");
  if (positions.size() > vertex_count() - vertices_seen_) {
    return InvalidArgument(path_ + ": more vertices than the " + std::to_string(vertex_count()) +
                           " that were announced");
  }
  vertices_seen_ += positions.size();
  return WriteVertices(positions, rows);
}

Status MeshWriter::AddTriangles(std::span<const TriangleVertices> triangles) {
  MTDB_CHECK(file_ != nullptr, "AddTriangles outside Begin and End");
  if (triangles.empty()) return Status::Ok();
  if (vertices_seen_ != vertex_count()) {
    return InvalidArgument(path_ + ": a triangle after " + std::to_string(vertices_seen_) + " of " +
                           std::to_string(vertex_count()) +
                           " vertices; the format wants all vertices first");
  }
  if (triangles.size() > triangle_count() - triangles_seen_) {
    return InvalidArgument(path_ + ": more triangles than the " + std::to_string(triangle_count()) +
                           " that were announced");
  }
  VertexIndex largest = 0;
  for (const TriangleVertices& t : triangles) largest = std::max({largest, t[0], t[1], t[2]});
  if (largest >= vertex_count()) {
    for (size_t i = 0; i < triangles.size(); ++i) {
      for (const VertexIndex v : triangles[i]) {
        if (v < vertex_count()) continue;
        return InvalidArgument(path_ + ": triangle " + std::to_string(triangles_seen_ + i) +
                               ": vertex index " + std::to_string(v) + ", but the mesh has " +
                               std::to_string(vertex_count()) + " vertices");
      }
    }
  }
  triangles_seen_ += triangles.size();
  return WriteTriangles(triangles);
}

bool MeshWriter::AppendPosition(std::string* text, Vec3d p) {
  const bool single = !header_.double_positions;
  if (Vec3f f; single && !positions_.Round(p, &f)) return false;
  for (int axis = 0; axis < 3; ++axis) {
    if (axis > 0) *text += ' ';
    AppendCoordinate(text, p[axis], single);
  }
  return true;
}

Status MeshWriter::End() {
  MTDB_CHECK(file_ != nullptr, "End without Begin");
  if (vertices_seen_ != vertex_count() || triangles_seen_ != triangle_count()) {
    return InvalidArgument(path_ + ": announced " + std::to_string(vertex_count()) +
                           " vertices and " + std::to_string(triangle_count()) +
                           " triangles, but got " + std::to_string(vertices_seen_) + " and " +
                           std::to_string(triangles_seen_));
  }
  MTDB_RETURN_IF_ERROR(WriteEnd());
  MTDB_RETURN_IF_ERROR(file_->Commit());
  bytes_written_ = file_->bytes_written();
  file_.reset();
  return Status::Ok();
}

std::optional<AttributeColumn> FindAttribute(const AttributeLayout& layout, std::string_view name,
                                             ScalarType type) {
  size_t offset = 0;
  for (const VertexAttribute& a : layout.attributes) {
    if (a.name == name && a.type == type) return AttributeColumn{a.type, offset};
    offset += ScalarSize(a.type);
  }
  return std::nullopt;
}

ColourColumns FindColours(const AttributeLayout& layout) {
  ColourColumns colours;
  for (const char* name : {"red", "green", "blue", "alpha"}) {
    const auto column = FindAttribute(layout, name, ScalarType::kUint8);
    if (!column) break;
    colours.offsets[colours.count++] = column->offset;
  }
  if (colours.count < 3) colours.count = 0;
  return colours;
}

NormalColumns FindNormals(const AttributeLayout& layout) {
  NormalColumns normals;
  int count = 0;
  for (const char* name : {"nx", "ny", "nz"}) {
    const auto column = FindAttribute(layout, name, ScalarType::kFloat32);
    if (!column) break;
    normals.offsets[count++] = column->offset;
  }
  normals.found = count == 3;
  return normals;
}

}  // namespace mtdb::internal
