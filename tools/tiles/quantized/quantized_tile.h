// SPDX-License-Identifier: Apache-2.0
// EncodeQuantizedTile: a piece of terrain in the format quantized-mesh 1.0.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/open_table.h"
#include "store/base/status.h"
#include "tools/tiles/places/globe_grid.h"
#include "tools/tiles/places/terrain_clip.h"

namespace mtdb {

inline constexpr int32_t kTileUnits = 32767;  // from one side of a tile to the other

// Takes the polygons of a tile, and makes its file. Positions are longitude, latitude and metres;
// they become units of the tile, and heights multiples of a step.
class QuantizedTile {
 public:
  struct Vertex {
    std::array<uint16_t, 3> units{};  // u, v and height
    Vec3d normal;                     // east, north and up, of any length
  };

  // `low_height` is a multiple of `height_step`, and no height is above low_height + kTileUnits *
  // height_step.
  QuantizedTile(const GlobeRectangle& rectangle, double low_height, double height_step)
      : rectangle_(rectangle), low_(low_height), step_(height_step) {}

  // As a fan; what rounding makes a line is left out.
  void Add(const ClipPolygon& polygon);
  // For who adds vertices in many triangles: where one is, its number, which a vertex has when a
  // triangle names it first, and a triangle of numbers.
  std::array<uint16_t, 3> UnitsAt(Vec3d p) const;
  uint32_t NumberOf(const Vertex& vertex);
  void AddTriangle(const std::array<uint32_t, 3>& triangle) { triangles_.push_back(triangle); }
  uint64_t triangle_count() const { return triangles_.size(); }
  // With octvertexnormals. The extension "metadata" is for trees whose tiles say which tiles there
  // are; in others CesiumJS fails at it.
  Bytes Encode() const;

 private:
  uint64_t HashOf(uint32_t number) const;
  void PutIndices(ByteWriter* to) const;
  GlobeRectangle rectangle_;
  double low_, step_;
  std::vector<Vertex> vertices_;  // in the order in which triangles name them
  std::vector<std::array<uint32_t, 3>> triangles_;
  internal::OpenTable<uint32_t> numbers_;  // of vertices, by their units
};

// The tile's triangles: longitude, latitude, metres. kCorrupt.
Result<std::vector<Triangle3d>> DecodeQuantizedTile(ByteSpan bytes,
                                                    const GlobeRectangle& rectangle);

}  // namespace mtdb
