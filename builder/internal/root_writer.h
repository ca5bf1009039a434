// RootWriter: what the last round left becomes root pieces; the topology is counted on it.
#pragma once

#include <unordered_map>
#include <vector>

#include "builder/internal/tile.h"
#include "store/base/attributes.h"
#include "store/base/status.h"
#include "store/database.h"

namespace mtdb {

// What does not change under vertex removals, counted on the root.
struct RootTopology {
  uint64_t vertices = 0;
  uint64_t triangles = 0;
  uint64_t components = 0;    // connected by vertices
  uint64_t border_loops = 0;  // connected pieces of the border
  int64_t euler_characteristic = 0;
  uint32_t pieces = 0;
};

// Takes triangles in spatial order, a piece at a time. Keeps some 40 bytes a root triangle.
class RootWriter {
 public:
  static constexpr size_t kPieceTriangles = 8192;  // keeps a piece's payload far below 1 MiB

  RootWriter(const AttributeLayout& attributes, ObjectWriter& writer)
      : attributes_(attributes), writer_(writer) {}
  // At most kPieceTriangles; `rows` of their corners.
  Status AddPiece(const std::vector<TileTriangle>& triangles, const Bytes& rows);
  RootTopology Finish();

 private:
  const AttributeLayout& attributes_;
  ObjectWriter& writer_;
  std::unordered_map<uint32_t, uint32_t> root_vertex_;  // the input's number -> the root's
  std::vector<std::pair<uint32_t, uint32_t>> edges_;    // of root vertices, smaller first
  std::vector<std::pair<uint32_t, uint32_t>> border_;
  std::vector<uint32_t> parent_;  // of root vertices: union-find
  RootTopology topology_;

  uint32_t Find(uint32_t v);
  void Join(uint32_t a, uint32_t b);
};

}  // namespace mtdb
