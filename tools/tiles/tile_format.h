// SPDX-License-Identifier: Apache-2.0
// TileFormat: what a kind of tiles is: its levels, the tiles of a level, and their bytes.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "query/query.h"
#include "query/surface.h"
#include "store/base/bytes.h"
#include "store/base/json.h"
#include "store/base/status.h"
#include "tools/tiles/level/level_mesh.h"

namespace mtdb {

// One level of a tree of tiles, as it was written.
struct TileLevel {
  double error_bound = 0;  // metres, or nanometres, as places have: no point of a tile is farther
                           // from the input, nor the input from the level
  uint64_t triangles = 0;  // of the level's mesh
  uint64_t tiles = 0;
  uint64_t written_triangles = 0;  // of all tiles: with those that several have, and with skirts
  uint64_t bytes = 0;              // likewise
};

// What a tile's file is.
struct TileFile {
  std::string path;  // in the folder of the tree
  Bytes bytes;
  uint64_t triangles = 0;
};

// Levels are made one after the other, coarse to fine: NextLevel(), then of the level's mesh
// Plan(), TilesOf() for each triangle, and Encode() for each tile. All but Encode() by one thread.
//
// All tiles of a level are parts of one conforming mesh, and Encode() puts a vertex at the same
// place in all of them: so tiles of a level meet without cracks.
class TileFormat {
 public:
  virtual ~TileFormat() = default;
  virtual std::string_view name() const = 0;
  // The next level's accuracy; none: all levels are there.
  virtual std::optional<Query> NextLevel() = 0;
  // Where tiles want a position of the object.
  virtual Vec3d Place(Vec3d position) const = 0;
  // How many metres units of x, y and z are there: by them normals are weighed.
  virtual Vec3d MetresAt(Vec3d /*placed*/) const { return {1, 1, 1}; }
  // The number of tiles of the level; none: it is no better than the last one and is passed over.
  virtual Result<std::optional<uint32_t>> Plan(const LevelMesh& mesh,
                                               const ExtractStats& stats) = 0;
  // The tiles that the triangle, or a part of it, belongs to.
  virtual void TilesOf(const Triangle3d& corners, std::vector<uint32_t>* tiles) const = 0;
  // Any thread; one at a time for one tile.
  virtual Result<TileFile> Encode(uint32_t tile, std::span<const LevelTriangle> triangles,
                                  const LevelMesh& mesh) = 0;
  // Whether tiles have vertices whose normals are wanted.
  virtual bool has_normals() const { return true; }
  // The level is written. Its record, but for what the writer counts.
  virtual TileLevel EndLevel() = 0;
  // The files beside the tiles; the one that makes the tree known to its readers last.
  virtual Result<std::vector<std::pair<std::string, std::string>>> Finish() = 0;
  // What the levels that are written leave, for a later run that goes on after them.
  virtual Json State() const = 0;
  // False, or UnexpectedJson, where it is damaged or not of so many levels.
  virtual bool Restore(const Json& state, size_t levels) = 0;
};

}  // namespace mtdb
