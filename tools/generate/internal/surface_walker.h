// SPDX-License-Identifier: Apache-2.0
// Marching cubes over a SculptureField, slab by slab of 8 cells, in memory proportional to the
// length of the surface's section. Only blocks of 8 x 8 x 8 cells that the surface may enter are
// looked at.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "store/base/mesh_sink.h"
#include "store/base/status.h"
#include "tools/generate/internal/sculpture_field.h"

namespace mtdb::internal {

class SurfaceWalker {
 public:
  // `sink` must outlive the walker; one that only estimates has none.
  SurfaceWalker(uint64_t seed, double cell_size, MeshSink* sink);

  // Walks the whole surface, once; calls neither Begin nor End of the sink.
  Status Walk();
  // The number of triangles, counted in one of `sampling` blocks.
  double EstimateTriangles(uint32_t sampling);

 private:
  static constexpr int kBlock = 8;          // cells along a block's edge
  static constexpr int kSide = kBlock + 1;  // samples along it
  static constexpr int kLayer = kSide * kSide;
  static constexpr int kSamples = kSide * kLayer;
  static constexpr size_t kLevels = 3;  // a block, its eighths, theirs; then cells
  static constexpr std::array<int, 3> kStride = {1, kSide, kLayer};
  // From a cube's first sample to its corners, for an edge of 1.
  static constexpr std::array<int, 8> kCornerOffset = {
      0, 1, kSide, kSide + 1, kLayer, kLayer + 1, kLayer + kSide, kLayer + kSide + 1};

  struct BlockIndex {
    int32_t y = 0, x = 0;
    friend auto operator<=>(const BlockIndex&, const BlockIndex&) = default;
  };
  // Vertex ids on the two directions of edges in a face of a block.
  using FaceIds = std::array<uint64_t, 2 * kLayer>;
  struct KeptFace {
    BlockIndex block;
    FaceIds ids;
  };
  // Faces in block order, read once in that order.
  struct KeptFaces {
    std::vector<KeptFace> faces;
    size_t next = 0;
    const FaceIds* Find(BlockIndex block);
    void StartOver(KeptFaces* fresh);
  };

  Vec3d PointAt(double i, double j, double k) const {
    return {low_.x + i * cell_size_, low_.y + j * cell_size_, low_.z + k * cell_size_};
  }
  // The blocks of slab `z` that the surface may enter, sorted.
  void FindBlocks(int32_t z, std::vector<BlockIndex>* blocks);
  Status WalkBlock(BlockIndex block, int32_t z);
  // Fills cubes_ with the cells that the surface may enter, and samples_ at their corners.
  void FindCubes(BlockIndex block, int32_t z);
  // Evaluates the corners of cubes_, cubes of this edge, as far as that is not done.
  void SampleCubes(BlockIndex block, int32_t z, int edge, double margin);
  void AddToBatch(BlockIndex block, int32_t z, int sample);
  // Lists the cells with a crossing, and completes the values beside crossings.
  void FindCells(BlockIndex block, int32_t z);
  Status EmitCells(BlockIndex block, int32_t z);
  uint64_t NewVertex(int edge_axis, int sample, BlockIndex block, int32_t z);
  void KeepFaces(BlockIndex block);
  Status Flush();

  SculptureField field_;
  double cell_size_;
  std::array<double, kLevels> deviation_{};  // of the function within a cube from its corners
  Vec3d low_;
  std::array<int32_t, 3> block_count_{};
  MeshSink* sink_;

  uint64_t vertex_count_ = 0;
  uint64_t triangle_count_ = 0;
  uint64_t crossing_uses_ = 0;  // of crossed edges by cells
  std::vector<Vec3d> vertices_;
  std::vector<TriangleVertices> triangles_;

  // The faces through which this slab, row and block see the ids of the ones before.
  KeptFaces below_, above_;
  KeptFaces row_before_, row_;
  BlockIndex left_block_{-1, -1};
  FaceIds left_{};

  // Of the current block.
  FieldBatch batch_;
  std::vector<uint16_t> batch_samples_;
  std::vector<uint16_t> cubes_, split_cubes_;  // by their first sample
  std::array<float, kSamples> samples_{};
  std::array<uint8_t, kSamples> complete_{};
  struct Cell {
    uint16_t sample;
    uint8_t inside;
  };
  std::vector<Cell> cells_;
  std::array<std::array<uint64_t, kSamples>, 3> edge_ids_{};
};

}  // namespace mtdb::internal
