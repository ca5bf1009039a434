// SPDX-License-Identifier: Apache-2.0
// LookingSink: hands a mesh on and asks before each block whether to go on.
#pragma once

#include <functional>
#include <utility>

#include "store/base/mesh_sink.h"

namespace mtdb::internal {

class LookingSink final : public MeshSink {
 public:
  // `sink` must outlive it. An error of `look` is the block's.
  LookingSink(MeshSink* sink, std::function<Status()> look) : sink_(sink), look_(std::move(look)) {}

  Status Begin(const MeshHeader& header) override { return sink_->Begin(header); }
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    MTDB_RETURN_IF_ERROR(look_());
    return sink_->AddVertices(positions, rows);
  }
  Status AddTriangles(std::span<const TriangleVertices> triangles) override {
    MTDB_RETURN_IF_ERROR(look_());
    return sink_->AddTriangles(triangles);
  }
  Status End() override { return sink_->End(); }
  bool joins_soup() const override { return sink_->joins_soup(); }
  uint64_t soup_bytes() const override { return sink_->soup_bytes(); }
  double LargestRounding(const MeshHeader& header) const override {
    return sink_->LargestRounding(header);
  }
  double rounding() const override { return sink_->rounding(); }

 private:
  MeshSink* sink_;
  std::function<Status()> look_;
};

}  // namespace mtdb::internal
