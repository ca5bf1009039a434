// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <vector>

#include "query/compare.h"
#include "query/compare/check_options.h"
#include "query/compare/vertex_distances.h"
#include "store/base/out_of_memory.h"

namespace mtdb {

using namespace internal;

namespace {

// Adds intervals to the rows of vertices on their way.
class DistanceSink final : public MeshSink {
 public:
  DistanceSink(VertexDistances& distances, MeshSink& sink) : distances_(distances), sink_(sink) {}

  Status Begin(const MeshHeader& header) override {
    MeshHeader with = header;
    for (const char* const name : {kLowDistance, kHighDistance}) {
      for (const VertexAttribute& a : header.attributes.attributes) {
        if (a.name == name) {
          return InvalidArgument(a.name + ": the object has such an attribute; rename it first");
        }
      }
      with.attributes.attributes.push_back({.name = name, .type = ScalarType::kFloat32});
    }
    row_bytes_ = header.attributes.row_bytes();
    return sink_.Begin(with);
  }
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    MTDB_RETURN_IF_ERROR(distances_.Find(positions, &intervals_));
    rows_.clear();
    for (size_t i = 0; i < positions.size(); ++i) {
      const ByteSpan row = rows.subspan(i * row_bytes_, row_bytes_);
      rows_.insert(rows_.end(), row.begin(), row.end());
      Append(RoundedDown(intervals_[i].low));
      Append(-RoundedDown(-intervals_[i].high));
    }
    return sink_.AddVertices(positions, rows_);
  }
  Status AddTriangles(std::span<const TriangleVertices> triangles) override {
    return sink_.AddTriangles(triangles);
  }
  Status AddCorners(std::span<const TextureCorner> corners) override {
    return sink_.AddCorners(corners);
  }
  Status End() override { return sink_.End(); }

 private:
  // To the largest float32 that is not above.
  static float RoundedDown(double value) {
    const auto nearest = static_cast<float>(value);
    return nearest <= value ? nearest
                            : std::nextafter(nearest, -std::numeric_limits<float>::infinity());
  }
  void Append(float value) {
    const auto* const bytes = reinterpret_cast<const std::byte*>(&value);
    rows_.insert(rows_.end(), bytes, bytes + sizeof(value));
  }

  VertexDistances& distances_;
  MeshSink& sink_;
  size_t row_bytes_ = 0;
  std::vector<DistanceInterval> intervals_;
  Bytes rows_;
};

Status SendDistances(const Surface& a, const Surface& b, const CompareOptions& options,
                     MeshSink& sink) {
  MTDB_RETURN_IF_ERROR(CheckCompareOptions(a, b, options));
  if (&a == &b) {
    // Its queries would wait for the room that the one that asks them holds.
    MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> other, Surface::Open(b.source()));
    return SendDistances(a, *other, options, sink);
  }
  MTDB_ASSIGN_OR_RETURN(const Placement placement, Placement::Of(options.transform));
  const Side asking(a, {}, options.as_stored, options.control);
  const Side answering(b, placement, options.as_stored, options.control);
  const Goals goals(options.tolerance, std::nullopt, options.reach);
  const double width = options.width       ? *options.width
                       : options.tolerance ? *options.tolerance / 4
                                           : StandardWidth(asking, answering);
  VertexDistances distances(answering, asking.least_bound(), width, goals, asking.bounds());
  DistanceSink with(distances, sink);
  Query everything;
  everything.control = options.control;
  return a.Extract(everything, with).status();
}

}  // namespace

Status MapDistances(const Surface& a, const Surface& b, const CompareOptions& options,
                    MeshSink& sink) {
  return CatchOutOfMemory([&] { return SendDistances(a, b, options, sink); });
}

}  // namespace mtdb
