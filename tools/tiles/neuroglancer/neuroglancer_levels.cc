// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/neuroglancer/neuroglancer_levels.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "tools/tiles/json_reading.h"
#include "tools/tiles/neuroglancer/draco_fragment.h"
#include "tools/tiles/places/terrain_clip.h"

namespace mtdb {

namespace {

constexpr double kHalfDiagonal = 0.8660254037844387;  // of a cube of side 1
constexpr double kWorthALevel = 1.5;  // times as many triangles as the coarsest mesh
constexpr uint32_t kMostDepth = 20;
constexpr double kSlack = 1e-6;  // of cells, so that no triangle is missed
constexpr size_t kFewCells = 4;  // a box over more of them is larger than its triangle

float RoundedDown(double v) {
  const auto f = static_cast<float>(v);
  return static_cast<double>(f) <= v ? f
                                     : std::nextafter(f, -std::numeric_limits<float>::infinity());
}
float RoundedUp(double v) { return -RoundedDown(-v); }

uint64_t KeyOf(const FragmentCell& cell) {
  return cell[0] | uint64_t{cell[1]} << 21 | uint64_t{cell[2]} << 42;
}

// A cell, and what its fragment came to.
struct CellRecord {
  FragmentCell cell{};
  uint32_t bytes = 0;
  uint32_t octants = 0;  // one bit for each part that has triangles
};

// The triangles of one cell, cut and rounded. Coordinates are in cells of the level.
class FragmentMaker {
 public:
  FragmentMaker(const FragmentCell& cell, uint32_t cells, int bits, bool halves)
      : cell_(cell), cells_(cells), most_((1 << bits) - 1), parts_(halves ? 2 : 1) {}

  void Add(const ClipPolygon& triangle) { Cut(triangle, 0); }
  const DracoFragment& fragment() const { return fragment_; }
  uint32_t octants() const { return octants_; }

 private:
  // A piece that is flat belongs to what lies above it.
  bool IsIn(double low, double high, double least, double most) const {
    if (least < most) return most > low && least < high;
    return least >= low && (least < high || (least == high && high == cells_));
  }

  void Cut(const ClipPolygon& polygon, int axis) {
    if (axis == 3) return AddPiece(polygon);
    double least = polygon.corners[0].position[axis], most = least;
    for (size_t i = 1; i < polygon.count; ++i) {
      least = std::min(least, polygon.corners[i].position[axis]);
      most = std::max(most, polygon.corners[i].position[axis]);
    }
    for (uint32_t part = 0; part < parts_; ++part) {
      const double size = 1.0 / parts_, low = cell_[static_cast<size_t>(axis)] + part * size;
      const double high = low + size;
      if (!IsIn(low, high, least, most)) continue;
      const ClipPolygon piece = ClipBetween(polygon, axis, low, high);
      if (piece.count >= 3) Cut(piece, axis + 1);
    }
  }

  void AddPiece(const ClipPolygon& piece) {
    std::array<uint32_t, ClipPolygon::kMost> v{};
    for (size_t i = 0; i < piece.count; ++i) v[i] = NumberOf(piece.corners[i].position);
    for (size_t i = 1; i + 1 < piece.count; ++i) {
      if (v[0] == v[i] || v[i] == v[i + 1] || v[i + 1] == v[0]) continue;
      fragment_.triangles.push_back({v[0], v[i], v[i + 1]});
      octants_ |= 1u << OctantOf({v[0], v[i], v[i + 1]});
    }
  }

  // As clients take it apart.
  uint32_t OctantOf(const std::array<uint32_t, 3>& triangle) const {
    uint32_t octant = 0;
    for (const uint32_t v : triangle) {
      for (size_t axis = 0; axis < 3; ++axis) {
        if (fragment_.positions[v][axis] > most_ / 2 + 1) octant |= 1u << axis;
      }
    }
    return octant;
  }

  uint32_t NumberOf(Vec3d p) {
    std::array<int32_t, 3> q{};
    uint64_t key = 0;
    for (int i = 0; i < 3; ++i) {
      // Halves go up: the middle of a cell becomes the number at which clients take it apart.
      const auto axis = static_cast<size_t>(i);
      const double steps = std::floor(p[i] * most_ + 0.5) - 1.0 * cell_[axis] * most_;
      q[axis] = static_cast<int32_t>(std::clamp(steps, 0.0, 1.0 * most_));
      key = key << 16 | static_cast<uint64_t>(q[axis]);
    }
    const auto [at, is_new] =
        numbers_.emplace(key, static_cast<uint32_t>(fragment_.positions.size()));
    if (is_new) fragment_.positions.push_back(q);
    return at->second;
  }

  const FragmentCell cell_;
  const uint32_t cells_;  // along an axis
  const int most_;        // the largest number of a position
  const uint32_t parts_;
  DracoFragment fragment_;
  std::unordered_map<uint64_t, uint32_t> numbers_;
  uint32_t octants_ = 0;
};

class NeuroglancerLevels final : public TileFormat {
 public:
  NeuroglancerLevels(const ObjectRecord& record, const NeuroglancerOptions& options)
      : record_(record), options_(options) {
    ChooseLevels();
    ChooseGrid();
  }

  std::string_view name() const override { return "neuroglancer"; }
  bool has_normals() const override { return false; }

  // In cells of level 0.
  Vec3d Place(Vec3d p) const override {
    Vec3d placed;
    for (int i = 0; i < 3; ++i) {
      const double stored = p[i] * options_.resolution[i] - options_.moved[i];
      placed[i] = std::clamp((stored - origin_[i]) / chunk_, 0.0, std::ldexp(1.0, depth_));
    }
    return placed;
  }

  std::optional<Query> NextLevel() override {
    if (levels_.size() > most_level_) return std::nullopt;
    Query query;
    const uint32_t level = most_level_ - static_cast<uint32_t>(levels_.size());
    const uint64_t triangles = record_.triangles >> 2 * level;
    if (level > 0 && triangles > record_.root_triangles) {
      query.max_triangles = triangles;
    } else if (level > 0) {
      query.threshold = CoarsestThreshold();
    }
    return query;
  }

  Result<std::optional<uint32_t>> Plan(const LevelMesh& mesh, const ExtractStats& stats) override {
    level_ = most_level_ - static_cast<uint32_t>(levels_.size());
    const Vec3d& r = options_.resolution;
    const double step = std::ldexp(chunk_, static_cast<int>(level_)) / ((1 << options_.bits) - 1);
    levels_.push_back({});
    levels_.back().bound = stats.error_bound * std::max({r.x, r.y, r.z}) + kHalfDiagonal * step;
    numbers_.clear();
    std::vector<FragmentCell> cells;
    MTDB_RETURN_IF_ERROR(mesh.Visit([&](std::span<const LevelTriangle> triangles) {
      for (const LevelTriangle& t : triangles) {
        VisitCells(mesh.Corners(t), [&](const FragmentCell& cell) {
          if (numbers_.emplace(KeyOf(cell), 0).second) cells.push_back(cell);
        });
      }
      return Status::Ok();
    }));
    std::sort(cells.begin(), cells.end(), IsBeforeOnCurve);
    for (const FragmentCell& cell : cells) {
      numbers_[KeyOf(cell)] = static_cast<uint32_t>(levels_.back().cells.size());
      levels_.back().cells.push_back({cell, 0, 0});
    }
    return std::optional<uint32_t>(static_cast<uint32_t>(cells.size()));
  }

  void TilesOf(const Triangle3d& corners, std::vector<uint32_t>* tiles) const override {
    tiles->clear();
    VisitCells(corners,
               [&](const FragmentCell& cell) { tiles->push_back(numbers_.at(KeyOf(cell))); });
  }

  Result<TileFile> Encode(TileId id, std::span<const LevelTriangle> triangles,
                          const LevelMesh& mesh) override {
    CellRecord& at = levels_[id.level].cells[id.tile];
    const uint32_t level = most_level_ - id.level;
    FragmentMaker maker(at.cell, CellsAt(level), options_.bits, level > 0);
    const double scale = std::ldexp(1.0, -static_cast<int>(level));
    for (const LevelTriangle& t : triangles) {
      ClipPolygon polygon;
      for (const uint32_t v : t) polygon.Add({mesh.vertex(v).position * scale, {}});
      maker.Add(polygon);
    }
    TileFile file;
    if (maker.fragment().triangles.empty()) return file;
    file.path = FragmentPath(level, at.cell);
    file.triangles = maker.fragment().triangles.size();
    MTDB_ASSIGN_OR_RETURN(file.bytes, EncodeDracoFragment(maker.fragment()));
    at.bytes = static_cast<uint32_t>(file.bytes.size());
    at.octants = maker.octants();
    return file;
  }

  TileLevel EndLevel() override {
    TileLevel level;
    level.error_bound = levels_.back().bound;
    return level;
  }

  Result<std::vector<std::pair<std::string, std::string>>> Finish() override {
    FragmentManifest manifest;
    manifest.chunk.fill(static_cast<float>(chunk_));
    for (int i = 0; i < 3; ++i) {
      manifest.origin[static_cast<size_t>(i)] = static_cast<float>(origin_[i]);
    }
    manifest.levels.resize(levels_.size());
    std::vector<std::vector<FragmentCell>> parts(levels_.size());
    float scale = 0;
    for (size_t level = 0; level < levels_.size(); ++level) {
      const Level& from = levels_[levels_.size() - 1 - level];
      scale = std::max(scale, RoundedUp(from.bound));
      manifest.levels[level].scale = scale;
      for (const CellRecord& c : from.cells) {
        if (c.bytes == 0) continue;
        manifest.levels[level].fragments.push_back({c.cell, c.bytes});
        for (uint32_t octant = 0; level > 0 && octant < 8; ++octant) {
          if ((c.octants >> octant & 1) == 0) continue;
          parts[level - 1].push_back({2 * c.cell[0] + (octant & 1),
                                      2 * c.cell[1] + (octant >> 1 & 1),
                                      2 * c.cell[2] + (octant >> 2)});
        }
      }
    }
    CompleteManifest(&manifest, parts);
    return std::vector<std::pair<std::string, std::string>>{
        {kFragmentManifest, std::string(AsString(EncodeManifest(manifest)))}};
  }

  Json State() const override {
    Json levels(Json::Array{});
    for (const Level& level : levels_) {
      Json cells(Json::Array{});
      for (const CellRecord& c : level.cells) {
        if (c.bytes == 0) continue;
        cells.push_back(Json(Json::Array{c.cell[0], c.cell[1], c.cell[2], c.bytes, c.octants}));
      }
      levels.push_back({{"bound", level.bound}, {"cells", std::move(cells)}});
    }
    return {{"levels", std::move(levels)}};
  }

  bool Restore(const Json& state, size_t levels) override {
    const auto number = [](const Json& list, size_t i) {
      return static_cast<uint32_t>(CountOf(At(list, i)));
    };
    for (const Json& l : ElementsOf(At(state, "levels"))) {
      Level& level = levels_.emplace_back();
      level.bound = NumberOf(At(l, "bound"));
      for (const Json& c : ElementsOf(At(l, "cells"))) {
        level.cells.push_back(
            {{number(c, 0), number(c, 1), number(c, 2)}, number(c, 3), number(c, 4)});
      }
    }
    return levels_.size() == levels && levels <= most_level_ + size_t{1};
  }

 private:
  struct Level {
    double bound = 0;
    std::vector<CellRecord> cells;
  };

  // As many halvings that a fragment of a surface through all cells has about as many triangles as
  // are wanted; and as many levels, as long as the coarsest mesh is smaller.
  void ChooseLevels() {
    const double all = static_cast<double>(std::max<uint64_t>(record_.triangles, 1));
    const double fragments = all / static_cast<double>(options_.tile_triangles);
    const double depth = std::round(std::log2(std::max(fragments, 1.0)) / 2);
    depth_ = static_cast<int>(std::min(depth, double{kMostDepth}));
    const double least =
        kWorthALevel * static_cast<double>(std::max<uint64_t>(record_.root_triangles, 1));
    while (most_level_ < static_cast<uint32_t>(depth_) &&
           std::ldexp(all, -2 * static_cast<int>(most_level_)) > least) {
      ++most_level_;
    }
  }

  // Numbers that float32 has, which is what the manifest says.
  void ChooseGrid() {
    Vec3d high;
    double longest = std::numeric_limits<float>::min();
    for (int i = 0; i < 3; ++i) {
      const double low = record_.bounds.min[i] * options_.resolution[i] - options_.moved[i];
      high[i] = record_.bounds.max[i] * options_.resolution[i] - options_.moved[i];
      origin_[i] = static_cast<double>(RoundedDown(low));
      longest = std::max(longest, high[i] - origin_[i]);
    }
    float chunk = RoundedUp(std::ldexp(longest, -depth_));
    while (std::ldexp(static_cast<double>(chunk), depth_) < longest) {
      chunk = std::nextafter(chunk, std::numeric_limits<float>::infinity());
    }
    chunk_ = static_cast<double>(chunk);
  }

  uint32_t CellsAt(uint32_t level) const { return 1u << (static_cast<uint32_t>(depth_) - level); }

  // Calls visit(cell) for cells that the triangle reaches into, and maybe some that it touches.
  template <typename Visit>
  void VisitCells(const Triangle3d& corners, const Visit& visit) const {
    const double scale = std::ldexp(1.0, -static_cast<int>(level_));
    Box3d box;
    for (const Vec3d& p : corners) box.Add(p * scale);
    const double end = CellsAt(level_) - 1.0;
    FragmentCell first{}, last{};
    size_t count = 1;
    for (int i = 0; i < 3; ++i) {
      const double low = std::floor(box.min[i]), high = std::ceil(box.max[i]) - 1;
      const auto axis = static_cast<size_t>(i);
      first[axis] = static_cast<uint32_t>(std::clamp(low, 0.0, end));
      last[axis] = static_cast<uint32_t>(std::clamp(std::max(low, high), 0.0, end));
      count *= last[axis] - first[axis] + 1;
    }
    const Triangle3d scaled{corners[0] * scale, corners[1] * scale, corners[2] * scale};
    for (uint32_t z = first[2]; z <= last[2]; ++z) {
      for (uint32_t y = first[1]; y <= last[1]; ++y) {
        for (uint32_t x = first[0]; x <= last[0]; ++x) {
          const Box3d cell{{x - kSlack, y - kSlack, z - kSlack},
                           {x + 1 + kSlack, y + 1 + kSlack, z + 1 + kSlack}};
          if (count > kFewCells && !TriangleMeetsBox(scaled, cell)) continue;
          visit(FragmentCell{x, y, z});
        }
      }
    }
  }

  const ObjectRecord record_;
  const NeuroglancerOptions options_;
  int depth_ = 0;  // of the grid of level 0: it has 2^depth cells along an axis
  uint32_t most_level_ = 0;
  Vec3d origin_;
  double chunk_ = 1;
  std::vector<Level> levels_;  // so far, coarse to fine
  // Of the level that is written.
  uint32_t level_ = 0;
  std::unordered_map<uint64_t, uint32_t> numbers_;  // of cells
};

}  // namespace

std::string FragmentPath(size_t level, const FragmentCell& cell) {
  return std::to_string(level) + "/" + std::to_string(cell[0]) + "_" + std::to_string(cell[1]) +
         "_" + std::to_string(cell[2]) + ".drc";
}

std::unique_ptr<TileFormat> MakeNeuroglancerLevels(const ObjectRecord& record,
                                                   const NeuroglancerOptions& options) {
  return std::make_unique<NeuroglancerLevels>(record, options);
}

}  // namespace mtdb
