// MeshSink: how a mesh travels through mtdb, block after block. File readers push into one, query
// results go to one, file writers and TriangleMesh are ones.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "store/base/attributes.h"
#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "store/base/ids.h"
#include "store/base/status.h"

namespace mtdb {

using TriangleVertices = std::array<VertexIndex, 3>;  // counter-clockwise from outside

// What is known before the first vertex.
struct MeshHeader {
  AttributeLayout attributes;
  bool double_positions = false;  // positions need more than float32
  // Positions were decimals, and are given in double. Where double_positions is false they have no
  // more digits than float32 values are written with: the nearest float32 may be what was meant.
  bool from_text = false;
  Box3d bounds;                            // that hold all positions; set by query results
  bool soup = false;                       // see MeshSink::joins_soup
  std::optional<uint64_t> vertex_count;    // always set by query results
  std::optional<uint64_t> triangle_count;  // likewise
};

// Calls come in the order Begin, AddVertices/AddTriangles in any mixture, End. A triangle may name
// a vertex that comes later, except from query results, which send all vertices first. Blocks are
// at most some 64 Ki elements. The first error stops the producer, which returns it. Single thread.
class MeshSink {
 public:
  virtual ~MeshSink() = default;
  virtual Status Begin(const MeshHeader& header) = 0;
  // `rows` holds positions.size() rows of header.attributes.row_bytes() bytes.
  virtual Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) = 0;
  virtual Status AddTriangles(std::span<const TriangleVertices> triangles) = 0;
  virtual Status End() = 0;
  // True when the sink gives vertices of equal position one number itself. Formats without shared
  // vertices are then sent with header.soup: three vertices for each triangle, in its order, and
  // the triangles (0, 1, 2), (3, 4, 5), ...; else their readers join the vertices in memory.
  virtual bool joins_soup() const { return false; }
  // For sinks that round positions, as files of float32 do. How far such a sink moves a vertex of
  // the mesh at most, in model units; asked before Begin, with the header's counts not set.
  virtual double LargestRounding(const MeshHeader& /*header*/) const { return 0; }
  // How far it has moved the farthest one so far.
  virtual double rounding() const { return 0; }
};

// A mesh in memory.
struct TriangleMesh {
  MeshHeader header;
  std::vector<Vec3d> positions;
  std::vector<TriangleVertices> triangles;
  Bytes rows;  // attributes, positions.size() * header.attributes.row_bytes() bytes
};

// Fills a TriangleMesh, which must outlive the sink.
class TriangleMeshSink final : public MeshSink {
 public:
  explicit TriangleMeshSink(TriangleMesh* mesh) : mesh_(mesh) {}
  Status Begin(const MeshHeader& header) override;
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override;
  Status AddTriangles(std::span<const TriangleVertices> triangles) override;
  Status End() override;

 private:
  TriangleMesh* mesh_;
};

// Sends `mesh` through `sink` in blocks.
Status SendMesh(const TriangleMesh& mesh, MeshSink& sink);

}  // namespace mtdb
