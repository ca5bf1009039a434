// SPDX-License-Identifier: Apache-2.0
// InputSpool: takes a mesh in, block after block, and makes an InputMesh of it.
#pragma once

#include <optional>
#include <vector>

#include "builder/disk/spool.h"
#include "builder/intake/input_mesh.h"
#include "store/base/mesh_sink.h"
#include "store/object_record.h"

namespace mtdb::internal {

// The input's vertices and triangles as they came; degenerate triangles are dropped and counted.
// Errors: kBadInput (no vertex or triangle, a coordinate that is not finite, or does not fit
// float32 when `lossless`, an index out of range), and those of Spool.
class InputSpool final : public MeshSink, public InputMesh {
 public:
  InputSpool(const SpoolSpace* space, size_t memory_bytes, bool lossless);
  // Before Begin(): other than the constructor said.
  void SetMemory(size_t memory_bytes) { memory_bytes_ = memory_bytes; }
  // Before End(): the step of texture coordinates does not grow where they need that.
  void KeepTextureStep() { texture_step_given_ = true; }
  // Before End(): vertices that are at most so far apart become one, the first of them; 0: those of
  // equal positions. Triangles of which two corners become one are dropped as degenerate.
  void Weld(double tolerance) { weld_ = tolerance; }
  // Before End(), instead: vertices of a mesh that was cut along edges become one (seam_join.h).
  void JoinSeams() { join_seams_ = true; }

  Status Begin(const MeshHeader& header) override;
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override;
  Status AddTriangles(std::span<const TriangleVertices> triangles) override;
  Status AddCorners(std::span<const TextureCorner> corners) override;
  Status End() override;
  bool joins_soup() const override { return true; }
  double rounding() const override { return rounding_; }

 private:
  // Returns whether the triangle stays.
  Result<bool> AppendTriangle(const std::array<uint32_t, 3>& t);
  Status FindBounds();
  Status WeldEqual();
  Status WeldNear();
  Status WeldSeams();
  // Gives the triangles' corners these numbers.
  Status Renumber(Spool& numbers);

  const SpoolSpace* space_;
  size_t memory_bytes_;
  Spool soup_spool_;  // positions of a soup's corners
  std::optional<double> weld_;
  bool join_seams_ = false;
  bool texture_step_given_ = false;
  bool lossless_;
  bool begun_ = false;
  std::vector<bool> appended_;  // of the last block of triangles, when textured
  VertexIndex largest_index_ = 0;
  uint64_t largest_at_ = 0;
};

}  // namespace mtdb::internal
