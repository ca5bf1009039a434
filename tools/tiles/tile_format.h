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

// A tile by its level, from 0 on in the order in which levels were planned, and its number there.
struct TileId {
  uint32_t level = 0, tile = 0;
};

// What a tile's file is.
struct TileFile {
  std::string path;  // in the folder of the tree
  Bytes bytes;
  uint64_t triangles = 0;
};

// Levels are made one after the other, coarse to fine: NextLevel(), then of the level's mesh
// Plan(), TilesOf() and Note() for each triangle, and Encode() for each tile, or later, for those
// that somebody asks for. All but Encode() by one thread, and nothing else beside it.
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
  // The tile of the level that was planned last has this triangle, too.
  virtual void Note(uint32_t /*tile*/, const Triangle3d& /*corners*/) {}
  // Of any level that this object has planned. Any thread; one at a time for one tile.
  virtual Result<TileFile> Encode(TileId id, std::span<const LevelTriangle> triangles,
                                  const LevelMesh& mesh) = 0;
  // The tile whose file it is; none: no tile's, or this kind's files are not asked for by name.
  virtual std::optional<TileId> Find(std::string_view /*path*/) const { return std::nullopt; }
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
