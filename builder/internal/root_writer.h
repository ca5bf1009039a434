// RootWriter: what the last round left becomes root pieces; the topology is counted on it.
#pragma once

#include <algorithm>
#include <unordered_map>
#include <vector>

#include "builder/internal/tile.h"
#include "store/base/attributes.h"
#include "store/base/status.h"
#include "store/database.h"

namespace mtdb::internal {

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
  // Of a piece at most: keeps its payload below 1 MiB, also when rows of `row_bytes` do not become
  // shorter by coding.
  static constexpr size_t PieceTriangles(size_t row_bytes) {
    constexpr size_t kMost = 8192;
    constexpr size_t kRowsBytes = 96 * kMost;
    return row_bytes * 3 * kMost <= kRowsBytes ? kMost
                                               : std::max<size_t>(kRowsBytes / (3 * row_bytes), 1);
  }

  RootWriter(const AttributeLayout& attributes, ObjectWriter& writer)
      : attributes_(attributes), writer_(writer) {}
  // At most PieceTriangles(); `rows` of their corners.
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

}  // namespace mtdb::internal
