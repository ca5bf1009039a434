// SPDX-License-Identifier: Apache-2.0
// FaceEmitter: the faces of a file, with any number of corners, as triangles for the sink.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "codecs/mesh_file/polygons/left_out_vertices.h"
#include "codecs/mesh_file/polygons/mesh_emitter.h"
#include "codecs/mesh_file/polygons/polygon_triangulator.h"
#include "codecs/mesh_file/polygons/vertex_positions.h"

namespace mtdb::internal {

// Triangles go straight on. How a polygon is cut depends on where its corners lie, which a reader
// does not keep: polygons, and what comes behind them, are collected; when there are many, their
// corners' positions are looked up, block after block of the vertices that they need, and they go
// on in their order. A file without polygons never asks for positions.
//
// Corners are numbers of the file's vertices; what is emitted is without those that were left out,
// which no face may name. Memory: some 30 MiB where there are polygons.
class FaceEmitter {
 public:
  // Opens the positions of all vertices of the file, also of those that come later.
  using OpenPositions = std::function<Result<std::unique_ptr<VertexPositions>>()>;
  // All must outlive it.
  FaceEmitter(MeshEmitter& emitter, MeshReadReport* report, const LeftOutVertices& left_out,
              OpenPositions open)
      : emitter_(emitter), report_(report), left_out_(left_out), open_(std::move(open)) {}

  // `texture`: its texture coordinates, where the mesh has some.
  Status AddCorner(VertexIndex v, const TextureCorner& texture = kNoTexture) {
    corners_.push_back(v);
    if (emitter_.is_textured()) textures_.push_back(texture);
    const bool too_many = corners_.size() - face_ > PolygonTriangulator::kMostCorners;
    return is_fan_ || too_many ? ExtendFan() : Status::Ok();
  }
  // After the last corner of a face. Faces of fewer than three are dropped and counted.
  Status EndFace();
  Status AddTriangle(VertexIndex a, VertexIndex b, VertexIndex c);
  // Of a textured mesh.
  Status AddTriangle(const TriangleVertices& t, const std::array<TextureCorner, 3>& textures);
  Status AddTriangles(std::span<const TriangleVertices> triangles);
  // After the last face.
  Status End();

 private:
  static constexpr size_t kMostCollected = size_t{1} << 19;  // corners

  // The triangle of three places in corners_.
  Status Emit(size_t a, size_t b, size_t c) {
    TriangleVertices t{corners_[a], corners_[b], corners_[c]};
    if (left_out_.count() != 0) {
      for (VertexIndex& v : t) v = left_out_.NumberOf(v);
    }
    if (textures_.empty()) return emitter_.AddTriangle(t[0], t[1], t[2]);
    return emitter_.AddTriangle(t[0], t[1], t[2], {textures_[a], textures_[b], textures_[c]});
  }
  void Resize(size_t corners) {
    corners_.resize(corners);
    if (!textures_.empty()) textures_.resize(corners);
  }
  // The corners of a face with too many go on at once; the first and the last one stay.
  Status ExtendFan();
  // Sends on what was collected before the current face.
  Status Flush();
  Status LookUp();
  Status LookUpBlocks();
  // The polygon whose corners begin at a place in corners_.
  Status EmitPolygon(size_t first, std::span<const Vec3d> positions);

  MeshEmitter& emitter_;
  MeshReadReport* report_;
  const LeftOutVertices& left_out_;
  OpenPositions open_;
  std::unique_ptr<VertexPositions> positions_;
  PolygonTriangulator triangulator_;

  std::vector<VertexIndex> corners_;     // of the faces that were collected, and of the current one
  std::vector<TextureCorner> textures_;  // of these, where the mesh is textured
  std::vector<uint32_t> sizes_;          // of the faces that were collected
  size_t face_ = 0;                      // where the current face begins
  bool is_fan_ = false;                  // it has too many corners

  std::vector<Vec3d> found_;     // of corners of polygons, in their order
  std::vector<uint32_t> order_;  // of the corners of polygons, by blocks
  std::vector<uint32_t> begin_;  // of each block in order_
};

}  // namespace mtdb::internal
