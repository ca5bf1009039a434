// SPDX-License-Identifier: Apache-2.0
// MeshSink: takes a mesh, block after block. File readers and queries push meshes into a sink; file
// writers are sinks, and TriangleMeshSink fills a mesh in memory.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "store/base/attributes.h"
#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "store/base/ids.h"
#include "store/base/status.h"
#include "store/base/texture.h"

namespace mtdb {

using TriangleVertices = std::array<VertexIndex, 3>;  // counter-clockwise from outside

// What is known before the first vertex.
struct MeshHeader {
  AttributeLayout attributes;
  bool double_positions = false;  // some position is not a float32 value
  // The positions were decimals in a text, and are given in double. When double_positions is false,
  // none has more digits than a float32 value is written with: the nearest float32 may be the
  // number that was meant.
  bool from_text = false;
  // Above 0: in each coordinate, different positions differ by at least about so much; set by
  // queries of objects on a grid.
  double position_step = 0;
  Box3d bounds;                   // around all positions; set by queries
  bool soup = false;              // see MeshSink::joins_soup
  bool textured = false;          // see MeshSink::AddCorners
  std::vector<Texture> textures;  // the pages, when it is
  // Above 0: u and v of corners are multiples of it, rounded to float32; set by queries.
  double texture_step = 0;
  std::optional<uint64_t> vertex_count;    // always set by queries
  std::optional<uint64_t> triangle_count;  // likewise
};

// The producer of a mesh calls Begin, then AddVertices and AddTriangles in any mixture, AddCorners
// after each of the latter when the mesh is textured, then End. A
// triangle may name a vertex that comes later; queries, however, send all vertices first. A block
// has at most some 64 Ki elements. When a call returns an error, the producer stops and returns it.
// Single thread.
class MeshSink {
 public:
  virtual ~MeshSink() = default;
  virtual Status Begin(const MeshHeader& header) = 0;
  // `rows` holds positions.size() rows of header.attributes.row_bytes() bytes.
  virtual Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) = 0;
  virtual Status AddTriangles(std::span<const TriangleVertices> triangles) = 0;
  // When header.textured: the corners of the triangles that AddTriangles got just before, three a
  // triangle. Sinks that have no use for them leave it as it is.
  virtual Status AddCorners(std::span<const TextureCorner> /*corners*/) { return Status::Ok(); }
  virtual Status End() = 0;
  // True when the sink itself joins vertices of equal position into one. Readers of formats without
  // shared vertices then set header.soup, and send three vertices for each triangle, in its order,
  // and the triangles (0, 1, 2), (3, 4, 5), ... When it is false, they join the vertices in memory.
  virtual bool joins_soup() const { return false; }
  // How much memory such a reader may take for that, in bytes.
  virtual uint64_t soup_bytes() const { return std::numeric_limits<uint64_t>::max(); }
  // For sinks that round positions, as writers of float32 do: the farthest that the sink will move
  // a vertex of a mesh with this header, in model units. Asked before Begin; the header's counts
  // are not set yet.
  virtual double LargestRounding(const MeshHeader& /*header*/) const { return 0; }
  // The farthest that the sink has moved a vertex so far, in model units.
  virtual double rounding() const { return 0; }
};

// A mesh in memory.
struct TriangleMesh {
  MeshHeader header;
  std::vector<Vec3d> positions;
  std::vector<TriangleVertices> triangles;
  Bytes rows;  // attributes, positions.size() * header.attributes.row_bytes() bytes
  std::vector<TextureCorner> corners;  // three a triangle when header.textured, else none
};

// Fills a TriangleMesh, which must outlive the sink.
class TriangleMeshSink final : public MeshSink {
 public:
  explicit TriangleMeshSink(TriangleMesh* mesh) : mesh_(mesh) {}
  Status Begin(const MeshHeader& header) override;
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override;
  Status AddTriangles(std::span<const TriangleVertices> triangles) override;
  Status AddCorners(std::span<const TextureCorner> corners) override;
  Status End() override;

 private:
  TriangleMesh* mesh_;
};

// Sends `mesh` through `sink` in blocks.
Status SendMesh(const TriangleMesh& mesh, MeshSink& sink);

}  // namespace mtdb
