// SPDX-License-Identifier: Apache-2.0
// InputSpool: takes a mesh in, block after block, and keeps it on disk for the passes to come.
#pragma once

#include <optional>
#include <string>

#include "builder/disk/spool.h"
#include "builder/intake/decimals.h"
#include "store/base/grid.h"
#include "store/base/mesh_sink.h"
#include "store/object_record.h"

namespace mtdb::internal {

// The input's vertices and triangles as they came; degenerate triangles are dropped and counted.
// Errors: kBadInput (no vertex or triangle, a coordinate that is not finite, or does not fit
// float32 when `lossless`, an index out of range), and those of Spool.
class InputSpool final : public MeshSink {
 public:
  InputSpool(const SpoolSpace* space, size_t memory_bytes, bool lossless);
  // Before Begin(): other than the constructor said.
  void SetMemory(size_t memory_bytes) { memory_bytes_ = memory_bytes; }
  // Before End(): vertices that are at most so far apart become one, the first of them; 0: those of
  // equal positions. Triangles of which two corners become one are dropped as degenerate.
  void Weld(double tolerance) { weld_ = tolerance; }
  // Before End(), instead: vertices of a mesh that was cut along edges become one (seam_join.h).
  void JoinSeams() { join_seams_ = true; }

  Status Begin(const MeshHeader& header) override;
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override;
  Status AddTriangles(std::span<const TriangleVertices> triangles) override;
  Status End() override;
  bool joins_soup() const override { return true; }

  // After End(): turns all triangles over.
  Status TurnOver();

  const MeshHeader& header() const { return header_; }
  uint64_t vertices() const { return vertices_; }  // less those that were welded
  uint64_t triangles() const { return triangle_spool_.size() / kTriangleBytes; }
  const InputReport& report() const { return report_; }
  uint64_t welded_vertices() const { return report_.vertices - vertices_; }
  // After JoinSeams(): those that are left where others are, and whether some of them are for their
  // attributes only.
  uint64_t equal_vertices() const { return equal_vertices_; }
  bool attributes_differ() const { return attributes_differ_; }
  // Model units: the farthest that a vertex was moved to be float32, or by welding.
  double rounding() const override { return rounding_; }
  const Box3d& bounds() const { return bounds_; }  // of the vertices that kept triangles use
  // Of the same vertices; unless lossless.
  const Decimals& decimals() const { return decimals_; }
  bool is_single() const { return !doubles_; }  // positions are float32
  // Whether all positions are float32 values, or text that may mean some: reads them.
  Result<bool> FitsSingle() const;
  size_t row_bytes() const { return row_bytes_; }
  size_t position_bytes() const { return position_bytes_; }
  // A vertex: position (3 float32 or 3 float64), then its row.
  size_t vertex_bytes() const { return position_bytes_ + row_bytes_; }
  const Spool& vertex_spool() const { return vertex_spool_; }
  Vec3d Position(const std::byte* vertex) const;
  const std::byte* Row(const std::byte* vertex) const { return vertex + position_bytes_; }
  // A triangle: 3 uint32.
  const Spool& triangle_spool() const { return triangle_spool_; }
  static constexpr size_t kTriangleBytes = 12;

  // Each once, when they are not read again: their room on the disk goes back.
  void DropVertices() { vertex_spool_ = Spool(nullptr, 0); }
  SpoolReader TakeTriangles() { return SpoolReader::Consuming(&triangle_spool_); }

 private:
  // `p`, read from text, may be how a program has written `f`.
  bool MayMean(Vec3d p, Vec3f f) const;
  Status AppendTriangle(const std::array<uint32_t, 3>& t);
  Status FindBounds();
  Status WeldEqual();
  Status WeldNear();
  Status WeldSeams();
  // Gives the triangles' corners these numbers.
  Status Renumber(Spool& numbers);

  MeshHeader header_;
  const SpoolSpace* space_;
  size_t memory_bytes_;
  Spool soup_spool_;  // positions of a soup's corners
  Spool vertex_spool_;
  Spool triangle_spool_;
  InputReport report_;
  Box3d bounds_;
  Decimals decimals_;
  uint64_t vertices_ = 0;
  std::optional<double> weld_;
  bool join_seams_ = false;
  uint64_t equal_vertices_ = 0;
  bool attributes_differ_ = false;
  bool lossless_;
  bool begun_ = false;
  bool doubles_ = false;  // positions are kept as float64
  double rounding_ = 0;
  size_t position_bytes_ = 12;
  size_t row_bytes_ = 0;
  VertexIndex largest_index_ = 0;
  uint64_t largest_at_ = 0;
};

}  // namespace mtdb::internal
