// SPDX-License-Identifier: Apache-2.0
// BlockWriter: collects vertices and triangles into blocks for a sink.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>
#include <span>
#include <vector>

#include "store/base/grid.h"
#include "store/base/mesh_sink.h"

namespace mtdb::internal {

// What one unit emits is written without looking at the sink; FlushBlocks then sends what fills a
// block, so that no unit is held while the sink works.
class BlockWriter {
 public:
  // `normals` of all vertices, in their order, follow the stored attributes; it may be empty.
  BlockWriter(MeshSink& sink, const Grid& grid, size_t stored_bytes, std::span<const Vec3f> normals)
      : sink_(sink),
        grid_(grid),
        stored_bytes_(stored_bytes),
        row_bytes_(stored_bytes + (normals.empty() ? 0 : sizeof(Vec3f))),
        normals_(normals) {}

  // Room for the unit that comes next.
  void ReserveVertices(size_t count) {
    positions_.resize(std::max(positions_.size(), vertices_ + count));
    rows_.resize(positions_.size() * row_bytes_);
  }
  // Where that unit's triangles go, at most `count` of them, and where they end.
  TriangleVertices* TriangleRoom(size_t count) {
    triangles_.resize(std::max(triangles_.size(), triangle_count_ + count));
    return triangles_.data() + triangle_count_;
  }
  void AddTriangles(const TriangleVertices* end) {
    triangle_count_ = static_cast<size_t>(end - triangles_.data());
  }
  // Of each of those triangles, when the mesh is textured.
  void AddCorners(const std::array<TextureCorner, 3>& corners) {
    corners_.insert(corners_.end(), corners.begin(), corners.end());
  }
  void AddVertex(Vec3i position, const std::byte* row) {
    positions_[vertices_] = grid_.Position(position);
    if (row_bytes_ > 0) {
      std::byte* to = rows_.data() + vertices_ * row_bytes_;
      if (stored_bytes_ > 0) std::memcpy(to, row, stored_bytes_);
      if (!normals_.empty()) std::memcpy(to + stored_bytes_, &normals_[vertices()], sizeof(Vec3f));
    }
    ++vertices_;
  }

  Status FlushBlocks() {
    if (vertices_ >= kBlock) MTDB_RETURN_IF_ERROR(FlushVertices());
    return triangle_count_ >= kBlock ? FlushTriangles() : Status::Ok();
  }
  Status FlushVertices() {
    for (size_t i = 0; i < vertices_; i += kLargestBlock) {
      const size_t n = std::min(kLargestBlock, vertices_ - i);
      MTDB_RETURN_IF_ERROR(
          sink_.AddVertices(std::span(positions_).subspan(i, n),
                            ByteSpan(rows_).subspan(i * row_bytes_, n * row_bytes_)));
    }
    vertices_sent_ += vertices_;
    vertices_ = 0;
    return Status::Ok();
  }
  Status FlushTriangles() {
    if (!corners_.empty() && corners_.size() != 3 * triangle_count_) {
      return Corrupt("triangles of a textured object without corners");
    }
    for (size_t i = 0; i < triangle_count_; i += kLargestBlock) {
      const size_t n = std::min(kLargestBlock, triangle_count_ - i);
      MTDB_RETURN_IF_ERROR(sink_.AddTriangles(std::span(triangles_).subspan(i, n)));
      if (corners_.empty()) continue;
      MTDB_RETURN_IF_ERROR(sink_.AddCorners(std::span(corners_).subspan(3 * i, 3 * n)));
    }
    corners_.clear();
    triangles_sent_ += triangle_count_;
    triangle_count_ = 0;
    return Status::Ok();
  }

  uint64_t vertices() const { return vertices_sent_ + vertices_; }
  uint64_t triangles() const { return triangles_sent_ + triangle_count_; }

 private:
  static constexpr size_t kBlock = 4096;  // with a unit's more: fits a core's second-level cache
  static constexpr size_t kLargestBlock = 65536;  // see MeshSink
  MeshSink& sink_;
  const Grid& grid_;
  const size_t stored_bytes_;  // of a row
  const size_t row_bytes_;
  const std::span<const Vec3f> normals_;
  std::vector<Vec3d> positions_;
  Bytes rows_;
  std::vector<TriangleVertices> triangles_;
  std::vector<TextureCorner> corners_;
  size_t vertices_ = 0;        // in the block
  size_t triangle_count_ = 0;  // likewise
  uint64_t vertices_sent_ = 0;
  uint64_t triangles_sent_ = 0;
};

}  // namespace mtdb::internal
