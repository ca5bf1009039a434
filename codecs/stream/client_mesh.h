// SPDX-License-Identifier: Apache-2.0
// ClientMesh: the mesh that an update stream is replayed on, with arrays for a GPU. It uses no
// files and no threads, only standard C++ and store/base, so that it runs in a browser unchanged.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "store/base/attributes.h"
#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "store/base/grid.h"
#include "store/base/ids.h"

namespace mtdb {

namespace internal {
class ReplayedMesh;
}

// What sender and client agree on.
struct ClientMeshOptions {
  Grid grid;
  AttributeLayout attributes;
  // How many removed vertices the client keeps, so that they need not travel again.
  uint32_t remembered_vertices = 0;
  // Of a raster (PositionMode::kRaster) that was built by the Delaunay rule: the client computes
  // which triangles a vertex takes away, so that no connectivity travels. An encoder clears it when
  // the base mesh is none.
  bool delaunay = false;
};

// The mesh of a cut, or the part of it that meets the region of a clipped client, as it is at the
// moment: a view of what an encoder or a decoder keeps, and valid as long as that. Triangles and
// vertices lie in slots, which are used again; a slot without a triangle has the indices 0, 0, 0,
// which draw nothing. Sender and client hold the same mesh, slot for slot. One thread. Takes some
// 90 bytes a triangle. Half-edge 4 * slot + i leads from corner i to corner i + 1.
class ClientMesh {
 public:
  struct Triangle {
    std::array<uint32_t, 3> corners{};   // vertex slots
    std::array<uint32_t, 3> opposite{};  // twin of each half-edge, or kNone32
    uint64_t born = 0;                   // grows with each new triangle; 0: none is here
  };
  struct Range {
    uint32_t begin = 0, end = 0;  // slots
    friend bool operator==(const Range&, const Range&) = default;
  };
  struct Changes {
    std::vector<Range> triangles;  // ascending
    std::vector<Range> vertices;
  };

  explicit ClientMesh(const internal::ReplayedMesh& mesh) : mesh_(&mesh) {}

  const ClientMeshOptions& options() const;
  uint32_t triangle_count() const;
  uint32_t vertex_count() const;  // without remembered ones
  uint32_t triangle_slots() const;
  uint32_t vertex_slots() const;
  bool has_triangle(uint32_t slot) const;
  bool has_vertex(uint32_t slot) const;
  Triangle triangle(uint32_t slot) const;
  // Triangles at a vertex.
  uint32_t degree(uint32_t vertex) const;
  // The removed vertices that are remembered, in no order that has a meaning.
  std::span<const uint32_t> remembered() const;
  bool is_remembered(uint32_t vertex) const;
  // On the grid; Grid::Position makes model units of it.
  Vec3i position(uint32_t vertex) const;
  ByteSpan row(uint32_t vertex) const;

  // For a GPU: three indices a triangle slot, three floats a vertex slot, relative to origin(). A
  // sender has none.
  std::span<const uint32_t> indices() const;
  std::span<const float> positions() const;
  Vec3d origin() const;
  const Bytes& rows() const;
  // Memory, about.
  size_t memory_bytes() const;

 private:
  const internal::ReplayedMesh* mesh_;
};

}  // namespace mtdb
