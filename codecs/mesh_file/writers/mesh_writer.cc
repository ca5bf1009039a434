// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/writers/mesh_writer.h"

#include <utility>

#include "codecs/mesh_file/writers/text_format.h"
#include "store/base/attribute_layout.h"
#include "store/base/scalar_names.h"

namespace mtdb::internal {

Status MeshWriter::Begin(const MeshHeader& header) {
  MTDB_CHECK(file_ == nullptr && bytes_written_ == 0, "Begin is called once");
  header_ = header;
  if (!header.vertex_count || !header.triangle_count) {
    return InvalidArgument(path_ +
                           ": the format needs the counts of vertices and triangles up front, but "
                           "they are not known; read the mesh into memory first");
  }
  if (const std::string fault = AttributeNamesFault(header.attributes); !fault.empty()) {
    return InvalidArgument(path_ + ": " + fault + "; give it another name");
  }
  carried_.assign(header.attributes.attributes.size(), false);
  positions_ = FloatPositions(header, origin_kind());
  MTDB_ASSIGN_OR_RETURN(
      file_, descriptor_ < 0 ? AtomicFile::Create(path_) : AtomicFile::Into(descriptor_, path_));
  if (is_textured()) {
    images_ = std::make_unique<ImageFiles>(header_, path_, has_folder() && has_image_files());
  }
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
  if (!is_textured()) return WriteTriangles(triangles);
  if (!pending_.empty()) return NoCorners();
  pending_.assign(triangles.begin(), triangles.end());
  return Status::Ok();
}

Status MeshWriter::NoCorners() const {
  return InvalidArgument(path_ + ": the mesh is textured, but the corners of " +
                         std::to_string(pending_.size()) + " triangles did not follow them");
}

Status MeshWriter::AddCorners(std::span<const TextureCorner> corners) {
  MTDB_CHECK(file_ != nullptr, "AddCorners outside Begin and End");
  if (!is_textured()) return Status::Ok();
  if (corners.size() != 3 * pending_.size()) return NoCorners();
  MTDB_RETURN_IF_ERROR(images_->Use(corners));
  MTDB_RETURN_IF_ERROR(WriteTexturedTriangles(pending_, corners));
  pending_.clear();
  return Status::Ok();
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
  if (!pending_.empty()) return NoCorners();
  MTDB_RETURN_IF_ERROR(WriteEnd());
  if (images_ != nullptr && has_image_files()) MTDB_RETURN_IF_ERROR(images_->Write());
  MTDB_RETURN_IF_ERROR(file_->Commit());
  if (images_ != nullptr) images_->Keep();
  bytes_written_ = file_->bytes_written();
  file_.reset();
  return Status::Ok();
}

MeshWriteReport MeshWriter::report() const {
  constexpr size_t kMostNamed = 40;
  MeshWriteReport report;
  report.positions = position_type();
  if (positions_.has_origin()) report.origin = positions_.origin();
  const auto& all = header_.attributes.attributes;
  std::optional<ScalarType> type;  // of the last line's
  size_t named = 0;
  for (size_t i = 0; i < all.size(); ++i) {
    if (carried_[i] || named++ >= kMostNamed) continue;
    if (type == all[i].type) {
      report.not_written.back() += ", " + all[i].name;
    } else {
      if (type) report.not_written.back() += std::string(" (") + ScalarName(*type) + ")";
      report.not_written.push_back(all[i].name);
      type = all[i].type;
    }
  }
  if (type) report.not_written.back() += std::string(" (") + ScalarName(*type) + ")";
  if (named > kMostNamed) {
    report.not_written.push_back(std::to_string(named - kMostNamed) + " more");
  }
  if (header_.textured && !has_textures()) report.not_written.push_back("texture coordinates");
  if (images_ != nullptr && has_image_files() && images_->left_out() > 0) {
    report.not_written.push_back(std::to_string(images_->left_out()) +
                                 " images, which are files beside one that has a name");
  }
  AddToReport(&report);
  return report;
}

void ColourReader::AddToReport(const char* bits, MeshWriteReport* report) const {
  if (count() == 0) return;
  if (bits != nullptr && type() != ScalarType::kUint8) {
    report->notes.push_back(std::string("colours of ") + ScalarName(type()) + " are rounded to " +
                            bits);
  }
  if (cut_ > 0) {
    report->notes.push_back(std::to_string(cut_) + " components of colours lay outside of " +
                            (is_float()                      ? "0 to 1"
                             : type() == ScalarType::kUint16 ? "0 to 65535"
                                                             : "0 to 255") +
                            " and were cut");
  }
}

}  // namespace mtdb::internal
