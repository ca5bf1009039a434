// SPDX-License-Identifier: Apache-2.0
// TileSurface: the surface that a tile's errors are measured against, when it is not the tile
// itself, and what of it each of the tile's triangles stands for.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "builder/disk/spool.h"
#include "builder/disk/tile.h"
#include "store/base/bytes.h"
#include "store/base/ids.h"
#include "store/base/status.h"
#include "store/base/texture.h"

namespace mtdb::internal {

// A vertex of the surface that is removed.
struct HeldVertex {
  uint32_t vertex = 0;    // of TileSurface::vertices
  uint32_t triangle = 0;  // of the tile, in whose part it lies ...
  uint32_t edge = 3;      // ... or on the curve of this border edge of it; 3: inside
};

// Rounds that go on are measured against the mesh that an earlier one began with (docs/design.md,
// section 3). A tile of them is given such a surface.
struct TileSurface {
  uint32_t round = 0;  // the one that began with the surface
  // The surface's triangles that are not triangles of the tile.
  std::vector<uint32_t> vertices;      // the input's numbering
  std::vector<Vec3i> positions;        // grid
  std::vector<TextureCorner> corners;  // of the vertices, when the object is textured
  std::vector<std::array<uint32_t, 3>> triangles;
  std::vector<float> errors;
  std::vector<HeldVertex> held;  // in no order that has a meaning
  std::vector<Chord> chords;     // ends: of `vertices`; triangles: the tile's
  // Of the tile's triangles.
  std::vector<uint8_t> own;                       // it is one of the surface's itself
  std::vector<std::array<float, 3>> edge_errors;  // work units

  bool empty() const { return triangles.empty(); }
};

// The surface's triangles that a tile may have beneath it.
constexpr size_t kMostSurface = size_t{1} << 18;
// Whether a tile is measured against the surface, or begins afresh: when there is none, or when it
// has too many triangles, or too many chords; those of height fields have too many triangles for
// each of the tile's earlier.
bool IsWorthGoingOn(const TileSurface& surface, bool is_height_field);

// Numbers the surface's vertices: those of the tile as there, the others behind them.
std::vector<uint32_t> NumberVertices(const TileSurface& surface,
                                     std::span<const uint32_t> tile_vertices);

// What a tile leaves for the next round: a surface whose triangles are those that lie beneath the
// tile's cluster; "the tile's triangles" are the cluster's in-triangles. An empty one, of round 0,
// says that no tile goes on from here.
Bytes EncodeTileSurface(const TileSurface& surface);
TileSurface DecodeTileSurface(ByteSpan bytes);

// The surfaces that the clusters of a round leave, by cluster. Add() from one thread, then
// Finish(), then GatherSurface() from any number of threads.
class SurfaceSpool {
 public:
  SurfaceSpool(uint32_t round, const SpoolSpace* space, size_t memory_bytes)
      : round_(round), spool_(space, memory_bytes) {}

  // Clusters in the order of their ids, which follow each other.
  Status Add(UnitId cluster, ByteSpan surface);
  Status Finish() { return spool_.Finish(); }

  uint32_t round() const { return round_; }
  bool Has(UnitId cluster) const {
    return cluster >= first_ && cluster - first_ + size_t{1} < begin_.size();
  }
  Result<TileSurface> Read(UnitId cluster) const;
  // TileSurface::round of what the cluster left.
  uint32_t SurfaceRound(UnitId cluster) const { return surface_rounds_[cluster - first_]; }

 private:
  uint32_t round_;
  Spool spool_;
  UnitId first_ = 0;
  std::vector<uint64_t> begin_{0};
  std::vector<uint32_t> surface_rounds_;
};

// The surface beneath `tile`, a tile of the round after the last of `rounds`, which follow each
// other. Empty when it has to begin afresh: its triangles stand for parts of different surfaces, or
// what lies beneath one of them was not left.
Result<TileSurface> GatherSurface(std::span<const std::unique_ptr<SurfaceSpool>> rounds,
                                  std::span<const TileTriangle> tile);

}  // namespace mtdb::internal
