// SPDX-License-Identifier: Apache-2.0
// MeshEmitter: collects single vertices and triangles into blocks for a MeshSink.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

#include "codecs/mesh_file/mesh_file.h"
#include "store/base/mesh_sink.h"

namespace mtdb::internal {

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
    return triangles_.size() < kBlock ? Status::Ok() : FlushTriangles();
  }
  // A whole block of the caller's, after what was collected before.
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) {
    MTDB_RETURN_IF_ERROR(FlushVertices());
    return sink_.AddVertices(positions, rows);
  }
  Status AddTriangles(std::span<const TriangleVertices> triangles) {
    MTDB_RETURN_IF_ERROR(FlushTriangles());
    return sink_.AddTriangles(triangles);
  }
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
    triangles_.clear();
    return status;
  }

  MeshSink& sink_;
  size_t vertices_per_block_ = kBlock;
  std::vector<Vec3d> positions_;
  Bytes rows_;
  std::vector<TriangleVertices> triangles_;
};

}  // namespace mtdb::internal
