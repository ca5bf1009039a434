// SPDX-License-Identifier: Apache-2.0
// AttributeSink: rounds attributes to what the build options ask for, on their way to the spool;
// and says to what texture coordinates are to be rounded.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "builder/build_options.h"
#include "store/base/mesh_sink.h"

namespace mtdb::internal {

// Everything behind it sees the rounded values, and a layout that says how they were rounded.
// Promises of the incoming layout are forgotten. Errors: kInvalidArgument (an option names what the
// input does not have, or not of that type), kBadInput (a value that is not finite, or too many
// steps from 0), and the sink's.
class AttributeSink final : public MeshSink {
 public:
  // What it is given must outlive it. `on_header` sees the rounded header before the sink does, and
  // may refuse it.
  AttributeSink(const BuildOptions* options, MeshSink* sink,
                std::function<Status(const MeshHeader&)> on_header = {})
      : options_(options), sink_(sink), on_header_(std::move(on_header)) {}

  Status Begin(const MeshHeader& header) override;
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override;
  Status AddTriangles(std::span<const TriangleVertices> triangles) override {
    return sink_->AddTriangles(triangles);
  }
  Status AddCorners(std::span<const TextureCorner> corners) override {
    return textured_ ? sink_->AddCorners(corners) : Status::Ok();
  }
  Status End() override { return sink_->End(); }
  bool joins_soup() const override { return sink_->joins_soup(); }

 private:
  struct Rounded {
    VertexAttribute attribute;
    size_t offset = 0;
  };
  Status Round(const Rounded& what, uint64_t vertex, std::byte* value) const;

  const BuildOptions* options_;
  MeshSink* sink_;
  std::function<Status(const MeshHeader&)> on_header_;
  std::vector<Rounded> rounded_;
  size_t row_bytes_ = 0;
  bool textured_ = false;
  uint64_t vertices_ = 0;  // before this block
  Bytes rows_;
};

}  // namespace mtdb::internal
