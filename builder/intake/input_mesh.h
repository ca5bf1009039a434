// SPDX-License-Identifier: Apache-2.0
// InputMesh: the input as it was taken in, on disk for the passes to come.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

#include "builder/disk/spool.h"
#include "builder/intake/corner_spool.h"
#include "builder/intake/decimals.h"
#include "store/base/geometry.h"
#include "store/base/mesh_sink.h"
#include "store/base/status.h"
#include "store/object_record.h"

namespace mtdb::internal {

// Vertices and triangles as they came, but for those that were welded or dropped. InputSpool makes
// one.
class InputMesh {
 public:
  const MeshHeader& header() const { return header_; }
  uint64_t vertices() const { return vertices_; }  // less those that were welded
  uint64_t triangles() const { return triangle_spool_.size() / kTriangleBytes; }
  const InputReport& report() const { return report_; }
  uint64_t welded_vertices() const { return report_.vertices - vertices_; }
  // After InputSpool::JoinSeams(): those that are left where others are, and whether some of them
  // are for their attributes only.
  uint64_t equal_vertices() const { return equal_vertices_; }
  bool attributes_differ() const { return attributes_differ_; }
  // Model units: the farthest that a vertex was moved to be float32, or by welding.
  double rounding() const { return rounding_; }
  const Box3d& bounds() const { return bounds_; }  // of the vertices that kept triangles use
  // Of the same vertices; unless lossless.
  const Decimals& decimals() const { return decimals_; }
  bool is_single() const { return !doubles_; }  // positions are float32
  // Whether all positions are float32 values, or text that may mean some: reads them.
  Result<bool> FitsSingle() const;
  size_t row_bytes() const { return row_bytes_; }
  size_t position_bytes() const { return doubles_ ? sizeof(Vec3d) : sizeof(Vec3f); }
  // A vertex: position (3 float32 or 3 float64), then its row.
  size_t vertex_bytes() const { return position_bytes() + row_bytes_; }
  const Spool& vertex_spool() const { return vertex_spool_; }
  Vec3d Position(const std::byte* vertex) const;
  const std::byte* Row(const std::byte* vertex) const { return vertex + position_bytes(); }
  // A triangle: 3 uint32.
  const Spool& triangle_spool() const { return triangle_spool_; }
  static constexpr size_t kTriangleBytes = 12;

  // Whether triangles have texture coordinates; these, in the order of the triangles.
  bool textured() const { return header_.textured; }
  const CornerSpool& corners() const { return corners_; }

  // Turns triangles over: those of which `turned` says so, which is asked in their order.
  Status TurnOver(const SpoolSpace* space, size_t memory_bytes,
                  const std::function<Result<bool>()>& turned);
  // Each once, when they are not read again: their room on the disk goes back.
  void DropVertices() { vertex_spool_ = Spool(nullptr, 0); }
  SpoolReader TakeTriangles() { return SpoolReader::Consuming(&triangle_spool_); }

 protected:
  // `p`, read from text, may be how a program has written `f`.
  bool MayMean(Vec3d p, Vec3f f) const;

  MeshHeader header_;
  Spool vertex_spool_{nullptr, 0};
  Spool triangle_spool_{nullptr, 0};
  CornerSpool corners_;
  InputReport report_;
  Box3d bounds_;
  Decimals decimals_;
  uint64_t vertices_ = 0;
  uint64_t equal_vertices_ = 0;
  bool attributes_differ_ = false;
  bool doubles_ = false;  // positions are kept as float64
  double rounding_ = 0;
  size_t row_bytes_ = 0;
};

// What a tile has for a corner: the vertex's row and, of textured meshes, a TextureCorner.
inline size_t CornerRowBytes(const InputMesh& mesh) {
  return mesh.row_bytes() + (mesh.textured() ? sizeof(TextureCorner) : 0);
}

}  // namespace mtdb::internal
