// SPDX-License-Identifier: Apache-2.0
// PlyTextures: how a PLY file has texture coordinates.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "codecs/mesh_file/input/ply_header.h"
#include "codecs/mesh_file/input/ply_source.h"
#include "codecs/mesh_file/polygons/face_emitter.h"
#include "codecs/mesh_file/textures/corner_table.h"
#include "codecs/mesh_file/textures/texture_pages.h"
#include "store/base/mesh_sink.h"

namespace mtdb::internal {

// Faces have a list "texcoord" of two numbers a corner, and maybe the number of their image,
// "texnumber"; or vertices have two properties of one of the pairs of names that are in use.
// Comment lines "TextureFile NAME" name the images.
class PlyTextures {
 public:
  explicit PlyTextures(const ReaderSpace& tmp) : table_(tmp) {}

  // kUnsupported: too many images.
  Status Plan(const std::string& path, const PlyHeader& header, MeshReadReport* report);
  void PutInto(MeshHeader* header) const;
  bool are_used() const { return of_faces_ || of_vertices_; }

  // Of faces: what a property of them is for.
  bool IsCoordinates(const PlyProperty& p) const {
    return of_faces_ && p.is_list && p.name == "texcoord";
  }
  bool IsPage(const PlyProperty& p) const {
    return are_used() && !p.is_list && p.name == "texnumber";
  }

  // Of vertices: 0 of the property that is u, 1 of v; else -1.
  int PartOf(const PlyProperty& p) const;
  bool of_vertices() const { return of_vertices_; }
  // In the order of the file's vertices; what came before is left as it is.
  Status SetVertex(uint64_t vertex, TexturePlace place) {
    return vertex == table_.size() ? table_.Append(place) : Status::Ok();
  }

  // The face that is being read: its corners come first, then these in any order.
  void BeginFace();
  void AddCorner(VertexIndex v) { corners_.push_back(v); }
  void AddNumber(double number) { numbers_.push_back(static_cast<float>(number)); }
  void SetPage(int64_t number);
  // Sends it on.
  Status EndFace(FaceEmitter* faces);
  Status AddTriangle(const TriangleVertices& t, FaceEmitter* faces);
  uint64_t temporary_bytes() const { return table_.temporary_bytes(); }

 private:
  Status CornerOf(VertexIndex v, TextureCorner* corner);

  bool of_faces_ = false;
  bool of_vertices_ = false;
  std::array<std::string, 2> names_;  // of the vertices' properties
  std::vector<Texture> pages_;
  CornerTable table_;
  std::vector<VertexIndex> corners_;  // of a face
  std::vector<float> numbers_;
  uint32_t page_ = 0;
  bool is_page_wrong_ = false;
};

}  // namespace mtdb::internal
