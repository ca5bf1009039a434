// SPDX-License-Identifier: Apache-2.0
// MeshEmitter: collects single vertices and triangles, with their corners where the mesh is
// textured, into blocks for a MeshSink.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "codecs/mesh_file/mesh_file.h"
#include "store/base/mesh_sink.h"

namespace mtdb::internal {

// Of a triangle without texture coordinates.
inline constexpr TextureCorner kNoTexture{0, 0, TextureCorner::kNoPage};
// Beyond it, float32 has no places inside of an image.
inline constexpr float kMaxTextureCoordinate = 0x1p24f;

// Blocks are small enough to stay in the processor's cache on their way through the sink.
class MeshEmitter {
 public:
  static constexpr size_t kBlock = 16384;

  explicit MeshEmitter(MeshSink& sink) : sink_(sink) {
    positions_.reserve(kBlock);
    triangles_.reserve(kBlock);
  }

  Status Begin(const MeshHeader& header) {
    // Long rows make short blocks.
    constexpr size_t kMaxRowsBytes = size_t{1} << 23;
    const size_t row_bytes = header.attributes.row_bytes();
    vertices_per_block_ =
        std::clamp(kMaxRowsBytes / std::max<size_t>(row_bytes, 1), size_t{1}, kBlock);
    rows_.reserve(row_bytes * vertices_per_block_);
    is_textured_ = header.textured;
    if (is_textured_) corners_.reserve(3 * kBlock);
    return sink_.Begin(header);
  }
  // At most kBlock. After Begin().
  size_t vertices_per_block() const { return vertices_per_block_; }

  Status AddVertex(Vec3d position, ByteSpan row) {
    positions_.push_back(position);
    rows_.insert(rows_.end(), row.begin(), row.end());
    return positions_.size() < vertices_per_block_ ? Status::Ok() : FlushVertices();
  }
  Status AddTriangle(VertexIndex a, VertexIndex b, VertexIndex c) {
    triangles_.push_back({a, b, c});
    if (is_textured_) corners_.insert(corners_.end(), 3, kNoTexture);
    return triangles_.size() < kBlock ? Status::Ok() : FlushTriangles();
  }
  // Of a textured mesh. Coordinates that are no numbers, or above kMaxTextureCoordinate, and pages
  // that differ are those of a file that is wrong: the triangle then has none.
  Status AddTriangle(VertexIndex a, VertexIndex b, VertexIndex c,
                     const std::array<TextureCorner, 3>& corners) {
    triangles_.push_back({a, b, c});
    if (AreGood(corners)) {
      corners_.insert(corners_.end(), corners.begin(), corners.end());
    } else {
      ++wrong_;
      corners_.insert(corners_.end(), 3, kNoTexture);
    }
    return triangles_.size() < kBlock ? Status::Ok() : FlushTriangles();
  }
  // A whole block of the caller's, after what was collected before.
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) {
    MTDB_RETURN_IF_ERROR(FlushVertices());
    return sink_.AddVertices(positions, rows);
  }
  Status AddTriangles(std::span<const TriangleVertices> triangles) {
    MTDB_RETURN_IF_ERROR(FlushTriangles());
    MTDB_RETURN_IF_ERROR(sink_.AddTriangles(triangles));
    if (!is_textured_) return Status::Ok();
    const std::vector<TextureCorner> corners(3 * triangles.size(), kNoTexture);
    return sink_.AddCorners(corners);
  }
  bool is_textured() const { return is_textured_; }
  // Triangles whose texture coordinates were wrong.
  uint64_t wrong_corners() const { return wrong_; }
  Status End() {
    MTDB_RETURN_IF_ERROR(FlushVertices());
    MTDB_RETURN_IF_ERROR(FlushTriangles());
    return sink_.End();
  }

 private:
  Status FlushVertices() {
    if (positions_.empty()) return Status::Ok();
    Status status = sink_.AddVertices(positions_, rows_);
    positions_.clear();
    rows_.clear();
    return status;
  }
  Status FlushTriangles() {
    if (triangles_.empty()) return Status::Ok();
    Status status = sink_.AddTriangles(triangles_);
    if (status.ok() && is_textured_) status = sink_.AddCorners(corners_);
    triangles_.clear();
    corners_.clear();
    return status;
  }
  static bool AreGood(const std::array<TextureCorner, 3>& corners) {
    return std::ranges::all_of(corners, [&](const TextureCorner& c) {
      return std::abs(c.u) <= kMaxTextureCoordinate && std::abs(c.v) <= kMaxTextureCoordinate &&
             c.page == corners[0].page;
    });
  }

  MeshSink& sink_;
  size_t vertices_per_block_ = kBlock;
  std::vector<Vec3d> positions_;
  Bytes rows_;
  std::vector<TriangleVertices> triangles_;
  std::vector<TextureCorner> corners_;  // of a textured mesh: three a triangle
  bool is_textured_ = false;
  uint64_t wrong_ = 0;
};

}  // namespace mtdb::internal
