// SPDX-License-Identifier: Apache-2.0
// RootWriter: what the last round left becomes root pieces; the topology is counted on it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "builder/disk/disjoint_sets.h"
#include "builder/disk/tile.h"
#include "store/base/attributes.h"
#include "store/base/open_table.h"
#include "store/base/status.h"
#include "store/object_writer.h"

namespace mtdb::internal {

// What does not change under vertex removals, counted on the root.
struct RootTopology {
  uint64_t vertices = 0;
  uint64_t triangles = 0;
  uint64_t components = 0;    // connected by vertices
  uint64_t border_loops = 0;  // connected pieces of the border
  uint32_t pieces = 0;
};

// A number for each of the input's vertices, in the order of first sight. 11 to 22 bytes a vertex.
class RootNumbers {
 public:
  uint32_t Add(uint32_t vertex);
  uint32_t size() const { return size_; }
  // What so many more vertices make it take, at most and for a moment.
  uint64_t bytes_with(uint64_t more) const {
    return table_.size() * sizeof(Slot) * (size_ + more > Room() ? 3 : 1);
  }

 private:
  struct Slot {
    uint32_t vertex = kNone32, number = kNone32;
    bool empty() const { return number == kNone32; }
  };
  size_t Room() const { return table_.size() / 4 * 3; }
  OpenTable<Slot> table_;
  uint32_t size_ = 0;
};

// Takes triangles in spatial order, a piece at a time. Keeps 25 bytes a root triangle, and some 15
// to 45 for each of its vertices, of which a surface has half as many, and loose triangles three
// times as many.
class RootWriter {
 public:
  static constexpr uint64_t kTriangleBytes = 25;  // less those of its vertices
  // Of a piece at most: keeps its payload below 1 MiB, also when rows of `row_bytes` do not become
  // shorter by coding.
  static constexpr size_t PieceTriangles(size_t row_bytes) {
    constexpr size_t kMost = 8192;
    constexpr size_t kRowsBytes = 96 * kMost;
    return row_bytes * 3 * kMost <= kRowsBytes ? kMost
                                               : std::max<size_t>(kRowsBytes / (3 * row_bytes), 1);
  }

  // Of so many triangles. `texture`: none without.
  RootWriter(const AttributeLayout& attributes, const std::optional<TileTexture>& texture,
             uint64_t triangles, ObjectWriter& writer)
      : attributes_(attributes), texture_(texture), writer_(writer) {
    edges_.reserve(3 * triangles);
    on_border_.reserve(3 * triangles);
  }
  // At most PieceTriangles(); `rows` of their corners.
  Status AddPiece(const std::vector<TileTriangle>& triangles, const Bytes& rows);
  RootTopology Finish();
  // What it keeps, and takes for the next piece.
  uint64_t memory_bytes() const;

 private:
  void AddCorners(const Bytes& rows, size_t triangle, std::vector<TextureCorner>& corners) const;
  size_t row_bytes() const {
    return attributes_.row_bytes() + (texture_ ? sizeof(TextureCorner) : 0);
  }

  const AttributeLayout& attributes_;
  const std::optional<TileTexture> texture_;
  ObjectWriter& writer_;
  RootNumbers numbers_;
  std::vector<std::pair<uint32_t, uint32_t>> edges_;  // of root vertices, smaller first
  std::vector<bool> on_border_;                       // of each edge
  DisjointSets joined_;                               // of root vertices, by edges
  RootTopology topology_;
};

}  // namespace mtdb::internal
