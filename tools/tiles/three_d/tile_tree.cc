// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/three_d/tile_tree.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tools/tiles/json_reading.h"
namespace mtdb {

namespace {

constexpr uint32_t kNone = ~uint32_t{0};
constexpr uint32_t kTouched = 1u << 31;  // of a count: a triangle with its middle elsewhere is here
constexpr uint32_t kFewParts = 8;        // a box over more of them is larger than its triangle

// Without what is near its sides, where rounding could tell otherwise.
Box3d Shrunk(const Box3d& box, double margin) {
  const double by = margin + 1e-9 * Diagonal(box);
  return {box.min + Vec3d{by, by, by}, box.max - Vec3d{by, by, by}};
}

bool ContainsAll(const Box3d& box, const Triangle3d& corners) {
  return box.Contains(corners[0]) && box.Contains(corners[1]) && box.Contains(corners[2]);
}

}  // namespace

TileTree::TileTree(const Box3d& bounds, bool quad, uint64_t most_triangles)
    : quad_(quad), most_triangles_(std::max<uint64_t>(most_triangles, 1)) {
  const Vec3d extent = bounds.max - bounds.min;
  double size = std::max(extent.x, extent.y);
  if (!quad) size = std::max(size, extent.z);
  if (!(size > 0)) size = 1;
  size *= 1 + 1e-9;
  const Vec3d middle = (bounds.min + bounds.max) * 0.5, half = Vec3d{1, 1, 1} * (size / 2);
  cube_ = {middle - half, middle + half};
  if (quad) {
    cube_.min.z = bounds.min.z - size;
    cube_.max.z = bounds.max.z + size;
  }
}

Box3d TileTree::CellOf(const TreeTile& tile) const {
  Box3d box = cube_;
  const double parts = std::ldexp(1.0, static_cast<int>(tile.depth));
  for (int i = 0; i < axes(); ++i) {
    const double size = (cube_.max[i] - cube_.min[i]) / parts;
    box.min[i] = cube_.min[i] + size * tile.cell[static_cast<size_t>(i)];
    box.max[i] = box.min[i] + size;
  }
  return box;
}

TileTree::CellFrame TileTree::FrameOf(const TreeTile& tile) const {
  const Box3d cell = CellOf(tile);
  CellFrame frame{cell.min, {}};
  for (int i = 0; i < axes(); ++i) frame.parts[i] = parts_per_axis() / (cell.max[i] - cell.min[i]);
  return frame;
}

void TileTree::SetFrames(Level* level) const {
  level->frames.clear();
  for (const TreeTile& tile : level->tiles) level->frames.push_back(FrameOf(tile));
}

TileTree::PartRange TileTree::PartsIn(const CellFrame& cell, const Box3d& box) const {
  PartRange range;
  const double last = parts_per_axis() - 1.0;
  for (int i = 0; i < axes(); ++i) {
    // What is below the cell counts for its first part.
    const auto part = [&](double x) {
      return static_cast<uint32_t>(std::clamp((x - cell.corner[i]) * cell.parts[i], 0.0, last));
    };
    range.low[static_cast<size_t>(i)] = part(box.min[i]);
    range.high[static_cast<size_t>(i)] = part(box.max[i]);
  }
  return range;
}

Box3d TileTree::BoxOfPart(const TreeTile& tile, std::array<uint32_t, 3> at) const {
  Box3d box = CellOf(tile);
  const Vec3d extent = box.max - box.min;
  for (int i = 0; i < axes(); ++i) {
    const double size = extent[i] / parts_per_axis();
    box.min[i] += size * at[static_cast<size_t>(i)];
    box.max[i] = box.min[i] + size;
  }
  return box;
}

template <typename Visit>
void TileTree::DescendFrom(size_t from, uint32_t tile, size_t level, const Triangle3d& corners,
                           const Box3d& box, double margin, const Visit& visit) const {
  const TreeTile& here = levels_[from].tiles[tile];
  const PartRange range = PartsIn(levels_[from].frames[tile], box);
  uint32_t count = 1;
  for (size_t i = 0; i < 3; ++i) count *= range.high[i] - range.low[i] + 1;
  uint64_t seen = 0;  // children
  for (uint32_t z = range.low[2]; z <= range.high[2]; ++z) {
    for (uint32_t y = range.low[1]; y <= range.high[1]; ++y) {
      for (uint32_t x = range.low[0]; x <= range.high[0]; ++x) {
        const std::array<uint32_t, 3> at{x, y, z};
        if (count > kFewParts) {
          Box3d part = BoxOfPart(here, at);
          part.min = part.min - Vec3d{margin, margin, margin};
          part.max = part.max + Vec3d{margin, margin, margin};
          if (!TriangleMeetsBox(corners, part)) continue;
        }
        if (from == level) {
          visit(tile, PartAt(at));
          continue;
        }
        const uint32_t child = levels_[from + 1].tile_of_part[tile * size_t{kParts} + PartAt(at)];
        const uint64_t bit = uint64_t{1} << (child - here.first_child);
        if ((seen & bit) != 0) continue;
        seen |= bit;
        DescendFrom(from + 1, child, level, corners, box, margin, visit);
      }
    }
  }
}

template <typename Visit>
void TileTree::Descend(size_t level, const Triangle3d& corners, double margin,
                       const Visit& visit) const {
  Box3d box;
  for (const Vec3d& p : corners) box.Add(p);
  box.min = box.min - Vec3d{margin, margin, margin};
  box.max = box.max + Vec3d{margin, margin, margin};
  DescendFrom(0, 0, level, corners, box, margin, visit);
}

// For each part of each tile of the last level, how many triangles have their middle there.
std::vector<uint32_t> TileTree::CountTriangles(const LevelMesh& mesh, double margin) const {
  const size_t last = levels_.size() - 1;
  const std::vector<TreeTile>& parents = levels_[last].tiles;
  std::vector<uint32_t> counts(parents.size() * kParts, 0);
  size_t place = 0;  // of the triangle before; all in part_box are there, too
  Box3d part_box;
  const auto count = [&](const Triangle3d& corners) {
    if (ContainsAll(part_box, corners)) {
      ++counts[place];
      return;
    }
    uint32_t places = 0;
    Descend(last, corners, margin, [&](uint32_t tile, uint32_t part) {
      place = tile * size_t{kParts} + part;
      counts[place] |= kTouched;
      ++places;
    });
    part_box = {};
    if (places == 1) {
      part_box = Shrunk(BoxOfPart(parents[place / kParts], PlaceOf(place % kParts)), margin);
    } else {
      const Vec3d middle = (corners[0] + corners[1] + corners[2]) * (1.0 / 3);
      Descend(last, {middle, middle, middle}, 0,
              [&](uint32_t tile, uint32_t part) { place = tile * size_t{kParts} + part; });
    }
    ++counts[place];
  };
  const Status visited = mesh.Visit([&](std::span<const LevelTriangle> triangles) {
    for (const LevelTriangle& t : triangles) count(mesh.Corners(t));
    return Status::Ok();
  });
  MTDB_CHECK(visited.ok(), "counting does not fail");
  return counts;
}

void TileTree::AddLevel(const LevelMesh& mesh, double margin) {
  Level level;
  level.margin = margin;
  last_ = {};
  if (levels_.empty()) {
    level.tiles.emplace_back();
    SetFrames(&level);
    levels_.push_back(std::move(level));
    return;
  }
  const std::vector<uint32_t> counts = CountTriangles(mesh, margin);
  std::vector<TreeTile>& parents = levels_.back().tiles;
  level.tile_of_part.assign(counts.size(), kNone);
  for (uint32_t parent = 0; parent < parents.size(); ++parent) {
    parents[parent].first_child = static_cast<uint32_t>(level.tiles.size());
    SplitCell(counts, parent, 0, {}, &level);
    if (level.tiles.size() == parents[parent].first_child) {
      // Nothing of this level is here: a tile without triangles takes the parent's place.
      level.tiles.push_back({parents[parent].depth, parents[parent].cell, parent, 0, 0, {}});
      level.tile_of_part[parent * size_t{kParts}] = parents[parent].first_child;
    }
    parents[parent].children =
        static_cast<uint32_t>(level.tiles.size()) - parents[parent].first_child;
  }
  FillParts(&level);
  SetFrames(&level);
  levels_.push_back(std::move(level));
}

// The cell of the parent, `depth` levels below it, whose first part is `at`.
void TileTree::SplitCell(const std::vector<uint32_t>& counts, uint32_t parent, uint32_t depth,
                         std::array<uint32_t, 3> at, Level* level) const {
  const uint32_t size = parts_per_axis() >> depth, high = quad_ ? 1 : size;
  const auto for_each_part = [&](const auto& call) {
    for (uint32_t z = 0; z < high; ++z) {
      for (uint32_t y = 0; y < size; ++y) {
        for (uint32_t x = 0; x < size; ++x) {
          call(parent * size_t{kParts} + PartAt({at[0] + x, at[1] + y, at[2] + z}));
        }
      }
    }
  };
  uint64_t triangles = 0;
  bool is_touched = false;
  for_each_part([&](size_t part) {
    triangles += counts[part] & ~kTouched;
    is_touched = is_touched || counts[part] != 0;
  });
  if (!is_touched) return;
  if (triangles <= most_triangles_ || size == 1) {
    const TreeTile& above = levels_.back().tiles[parent];
    TreeTile tile{above.depth + depth, {}, parent, 0, 0, {}};
    for (size_t i = 0; i < static_cast<size_t>(axes()); ++i) {
      tile.cell[i] = (above.cell[i] << depth) + at[i] / size;
    }
    for_each_part([&](size_t part) {
      level->tile_of_part[part] = static_cast<uint32_t>(level->tiles.size());
    });
    level->tiles.push_back(tile);
    return;
  }
  const uint32_t half = size / 2;
  for (uint32_t octant = 0; octant < (quad_ ? 4u : 8u); ++octant) {
    const std::array<uint32_t, 3> corner{at[0] + (octant & 1) * half,
                                         at[1] + (octant >> 1 & 1) * half,
                                         at[2] + (octant >> 2) * half};
    SplitCell(counts, parent, depth + 1, corner, level);
  }
}

// What lies in a part that no tile has belongs to the nearest one: surfaces of two levels differ.
void TileTree::FillParts(Level* level) const {
  for (size_t first = 0; first < level->tile_of_part.size(); first += kParts) {
    const std::vector<uint32_t> found(
        level->tile_of_part.begin() + static_cast<ptrdiff_t>(first),
        level->tile_of_part.begin() + static_cast<ptrdiff_t>(first + kParts));
    for (uint32_t part = 0; part < kParts; ++part) {
      if (found[part] != kNone) continue;
      int32_t nearest = std::numeric_limits<int32_t>::max();
      for (uint32_t other = 0; other < kParts; ++other) {
        if (found[other] == kNone) continue;
        int32_t distance = 0;
        for (size_t i = 0; i < 3; ++i) {
          const auto d = static_cast<int32_t>(PlaceOf(part)[i] - PlaceOf(other)[i]);
          distance += d * d;
        }
        if (distance >= nearest) continue;
        nearest = distance;
        level->tile_of_part[first + part] = found[other];
      }
    }
  }
}

void TileTree::TilesOf(const Triangle3d& corners, std::vector<uint32_t>* tiles) const {
  tiles->clear();
  if (levels_.size() == 1) {
    tiles->push_back(0);
    return;
  }
  if (ContainsAll(last_.cell, corners)) {
    tiles->push_back(last_.tile);
    return;
  }
  const Level& level = levels_.back();
  const auto add = [&](uint32_t parent, uint32_t part) {
    const uint32_t tile = level.tile_of_part[parent * size_t{kParts} + part];
    if (std::find(tiles->begin(), tiles->end(), tile) == tiles->end()) tiles->push_back(tile);
  };
  Descend(levels_.size() - 2, corners, level.margin, add);
  if (tiles->size() == 1) {
    last_ = {Shrunk(CellOf(level.tiles[tiles->front()]), level.margin), tiles->front()};
  }
  if (!tiles->empty()) return;
  const Vec3d middle = (corners[0] + corners[1] + corners[2]) * (1.0 / 3);
  Descend(levels_.size() - 2, {middle, middle, middle}, 0, add);
}

Json TileTree::State() const {
  Json state(Json::Array{});
  for (const Level& level : levels_) {
    Json tiles(Json::Array{});
    for (const TreeTile& t : level.tiles) {
      const Box3d& b = t.content;
      Json tile = {t.depth, t.cell[0], t.cell[1], t.cell[2], t.parent, t.first_child, t.children};
      if (!b.empty()) {
        for (const Vec3d& p : {b.min, b.max}) {
          for (int i = 0; i < 3; ++i) tile.push_back(p[i]);
        }
      }
      tiles.push_back(std::move(tile));
    }
    state.push_back({{"margin", level.margin}, {"tiles", std::move(tiles)}});
  }
  return state;
}

bool TileTree::Restore(const Json& state) {
  levels_.clear();
  for (const Json& from : ElementsOf(state)) {
    Level level;
    level.margin = NumberOf(At(from, "margin"));
    for (const Json& t : ElementsOf(At(from, "tiles"))) {
      const auto number = [&](size_t i) { return static_cast<uint32_t>(CountOf(At(t, i))); };
      TreeTile tile{number(0), {number(1), number(2), number(3)}, number(4), number(5), number(6),
                    {}};
      if (t.size() == 13) {
        for (int i = 0; i < 3; ++i) {
          tile.content.min[i] = NumberOf(At(t, 7 + static_cast<size_t>(i)));
          tile.content.max[i] = NumberOf(At(t, 10 + static_cast<size_t>(i)));
        }
      }
      level.tiles.push_back(tile);
    }
    if (!IsSound(level)) return false;
    RestoreParts(&level);
    SetFrames(&level);
    levels_.push_back(std::move(level));
  }
  if (levels_.empty()) return false;
  for (const TreeTile& t : levels_.back().tiles) {
    if (t.children != 0) return false;
  }
  return true;
}

// Of a level that follows those there are: parents have their children in order, and no others.
bool TileTree::IsSound(const Level& level) const {
  if (level.tiles.empty() || (levels_.empty() && level.tiles.size() != 1)) return false;
  for (const TreeTile& t : level.tiles) {
    if (t.depth >= 32 || (!levels_.empty() && t.parent >= levels_.back().tiles.size())) {
      return false;
    }
  }
  if (levels_.empty()) return true;
  uint64_t next = 0;
  for (uint32_t p = 0; p < levels_.back().tiles.size(); ++p) {
    const TreeTile& parent = levels_.back().tiles[p];
    if (parent.first_child != next || parent.children == 0 || parent.children > kParts ||
        next + parent.children > level.tiles.size()) {
      return false;
    }
    for (uint32_t c = 0; c < parent.children; ++c, ++next) {
      if (level.tiles[next].parent != p) return false;
    }
  }
  return next == level.tiles.size();
}

// Which parts of its parent a tile has follows from the two cells.
void TileTree::RestoreParts(Level* level) const {
  if (levels_.empty()) return;
  const std::vector<TreeTile>& parents = levels_.back().tiles;
  level->tile_of_part.assign(parents.size() * kParts, kNone);
  for (uint32_t i = 0; i < level->tiles.size(); ++i) {
    const TreeTile& tile = level->tiles[i];
    Box3d cell = CellOf(tile);
    const Vec3d inset = (cell.max - cell.min) * 1e-3;
    const PartRange range =
        PartsIn(levels_.back().frames[tile.parent], {cell.min + inset, cell.max - inset});
    for (uint32_t z = range.low[2]; z <= range.high[2]; ++z) {
      for (uint32_t y = range.low[1]; y <= range.high[1]; ++y) {
        for (uint32_t x = range.low[0]; x <= range.high[0]; ++x) {
          level->tile_of_part[tile.parent * size_t{kParts} + PartAt({x, y, z})] = i;
        }
      }
    }
  }
  FillParts(level);
}

}  // namespace mtdb
