// BlockWriter: collects vertices and triangles into blocks for a sink.
#pragma once

#include <cstddef>
#include <cstring>
#include <vector>

#include "store/base/grid.h"
#include "store/base/mesh_sink.h"

namespace mtdb {

class BlockWriter {
 public:
  BlockWriter(MeshSink& sink, const Grid& grid, size_t row_bytes)
      : sink_(sink), grid_(grid), row_bytes_(row_bytes) {
    positions_.reserve(kBlock);
    rows_.reserve(kBlock * row_bytes);
    triangles_.resize(kBlock);
  }

  Status AddVertex(Vec3i position, const std::byte* row) {
    ++vertex_count_;
    positions_.push_back(grid_.Position(position));
    rows_.insert(rows_.end(), row, row + row_bytes_);
    return positions_.size() == kBlock ? FlushVertices() : Status::Ok();
  }
  Status AddTriangle(const TriangleVertices& t) {
    triangles_[triangle_count_++] = t;
    return triangle_count_ == kBlock ? FlushTriangles() : Status::Ok();
  }
  Status FlushVertices() {
    if (positions_.empty()) return Status::Ok();
    const Status status = sink_.AddVertices(positions_, rows_);
    positions_.clear();
    rows_.clear();
    return status;
  }
  Status FlushTriangles() {
    if (triangle_count_ == 0) return Status::Ok();
    const Status status = sink_.AddTriangles(std::span(triangles_).first(triangle_count_));
    triangles_sent_ += triangle_count_;
    triangle_count_ = 0;
    return status;
  }

  uint64_t vertices() const { return vertex_count_; }
  uint64_t triangles() const { return triangles_sent_ + triangle_count_; }

 private:
  static constexpr size_t kBlock = 8192;  // fits a core's second-level cache
  MeshSink& sink_;
  const Grid& grid_;
  const size_t row_bytes_;
  std::vector<Vec3d> positions_;
  Bytes rows_;
  std::vector<TriangleVertices> triangles_;
  size_t triangle_count_ = 0;  // in the block
  uint64_t triangles_sent_ = 0;
  uint64_t vertex_count_ = 0;
};

}  // namespace mtdb
