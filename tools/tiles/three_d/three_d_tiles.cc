// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/three_d/three_d_tiles.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "store/metres_of_unit.h"
#include "tools/request/mesh_output.h"
#include "tools/tiles/json_reading.h"
#include "tools/tiles/places/tile_placement.h"
#include "tools/tiles/three_d/gltf_tile.h"
#include "tools/tiles/three_d/tile_mesh.h"
#include "tools/tiles/three_d/tile_tree.h"

namespace mtdb {

namespace {

constexpr double kClientPixels = 16;  // what clients have set
constexpr size_t kLevelsPerFile = 4;  // of a tileset.json and of those that it names
constexpr double kRoundingOfBound = 1.0 / 32;
constexpr double kLastStep = 0.6;  // a level of more of the triangles is the full one
constexpr double kHalfDiagonal = 0.8660254037844387;  // of a cube of side 1
// The longest tiles that a terrain in degrees may be cut into by planes: 30 degrees.
constexpr double kMostDegrees = 30;

class ThreeDTiles final : public TileFormat {
 public:
  ThreeDTiles(const ObjectRecord& record, const ThreeDTilesOptions& options,
              TilePlacement placement)
      : record_(record),
        options_(options),
        placement_(std::move(placement)),
        is_terrain_(record.error_measure == ErrorMeasure::kVertical),
        // Twice as many as are wished for, since cells are split in four.
        tree_(placement_.bounds(), is_terrain_, 2 * options.tile_triangles) {}

  std::string_view name() const override { return "3dtiles"; }
  Vec3d Place(Vec3d p) const override { return placement_.Place(p); }

  std::optional<Query> NextLevel() override {
    if (is_full_) return std::nullopt;
    Query query;
    const double all = static_cast<double>(record_.triangles);
    if (next_triangles_ == 0) {
      next_triangles_ = options_.tile_triangles;
      if (record_.root_triangles > next_triangles_) {
        query.threshold = CoarsestThreshold();
        next_triangles_ = record_.root_triangles;
      }
    } else {
      next_triangles_ *= 4;
    }
    is_full_ = static_cast<double>(next_triangles_) >= kLastStep * all;
    if (is_full_) {
      query.threshold = nullptr;
    } else if (query.threshold == nullptr) {
      query.max_triangles = next_triangles_;
    }
    return query;
  }

  Result<std::optional<uint32_t>> Plan(const LevelMesh& mesh, const ExtractStats& stats) override {
    LevelFrame level;
    const double bound = stats.error_bound * placement_.metres() + placement_.Bend(mesh);
    level.step = placement_.StepFor(bound * kRoundingOfBound);
    level.bound = bound + (placement_.IsExact(level.step) ? 0 : kHalfDiagonal * level.step);
    if (!frames_.empty() && level.bound >= frames_.back().bound) return std::optional<uint32_t>();
    level.skirt = frames_.empty() ? 0 : frames_.back().bound + level.bound;
    level.has_normals = true;
    level.has_colours = mesh.has_colours();
    frames_.push_back(level);
    tree_.AddLevel(mesh, level.skirt);
    return std::optional<uint32_t>(static_cast<uint32_t>(tree_.level(frames_.size() - 1).size()));
  }

  void TilesOf(const Triangle3d& corners, std::vector<uint32_t>* tiles) const override {
    tree_.TilesOf(corners, tiles);
  }

  // Tiles have a content where a triangle is left on the lattice.
  void Note(uint32_t tile, const Triangle3d& corners) override {
    const LevelFrame& frame = frames_.back();
    Box3d& content = tree_.level(frames_.size() - 1)[tile].content;
    if (content.Contains(corners[0]) && content.Contains(corners[1]) &&
        content.Contains(corners[2])) {
      return;
    }
    Triangle3d p;
    for (size_t c = 0; c < 3; ++c) {
      const Vec3i at = LatticePoint(corners[c], placement_.origin(), frame.step);
      p[c] = placement_.origin() + ToDouble(at) * frame.step;
    }
    if (p[0] == p[1] || p[1] == p[2] || p[2] == p[0]) return;
    for (const Vec3d& corner : p) content.Add(corner);
  }

  Result<TileFile> Encode(TileId id, std::span<const LevelTriangle> triangles,
                          const LevelMesh& mesh) override {
    const TreeTile& at = std::as_const(tree_).level(id.level)[id.tile];
    if (at.content.empty()) return TileFile{};
    const LevelFrame& frame = frames_[id.level];
    TileMeshOptions options;
    options.origin = placement_.origin();
    options.step = frame.step;
    options.colours = frame.has_colours;
    options.skirt = frame.skirt;
    options.skirt_is_vertical = is_terrain_;
    options.inside = tree_.CellOf(at);
    GltfTile gltf = MakeTileMesh(mesh, triangles, options);
    gltf.error_bound = frame.bound;
    TileFile file;
    file.path = PathOf(id.level, at) + ".glb";
    file.triangles = gltf.indices.size() / 3;
    file.bytes = EncodeGltfTile(std::move(gltf));
    return file;
  }

  std::optional<TileId> Find(std::string_view path) const override {
    const auto [level, tile] = TileIn(path);
    if (level >= frames_.size() || path != PathOf(level, tile) + ".glb") return std::nullopt;
    const std::vector<TreeTile>& tiles = tree_.level(level);
    const auto at = std::find_if(tiles.begin(), tiles.end(), [&, &asked = tile](const TreeTile& t) {
      return t.depth == asked.depth && t.cell == asked.cell && !t.content.empty();
    });
    if (at == tiles.end()) return std::nullopt;
    return TileId{level, static_cast<uint32_t>(at - tiles.begin())};
  }

  TileLevel EndLevel() override {
    TileLevel level;
    level.error_bound = frames_.back().bound;
    return level;
  }

  Result<std::vector<std::pair<std::string, std::string>>> Finish() override {
    SetBoxes();
    Files files;
    Json root = NodeOf(0, 0, "", &files);
    if (const std::optional<Json> transform = placement_.Transform()) {
      root["transform"] = *transform;
    }
    // So that nothing vanishes from afar.
    const double largest = std::max(Diagonal(boxes_[0][0]), 2 * ErrorOf(0));
    files.emplace_back("tileset.json", TilesetOf(std::move(root), largest));
    return files;
  }

  Json State() const override {
    Json frames(Json::Array{});
    for (const LevelFrame& f : frames_) {
      frames.push_back(
          {{"bound", f.bound}, {"step", f.step}, {"skirt", f.skirt}, {"colours", f.has_colours}});
    }
    return {
        {"next", next_triangles_}, {"full", is_full_}, {"frames", frames}, {"tree", tree_.State()}};
  }

  bool Restore(const Json& state, size_t levels) override {
    next_triangles_ = CountOf(At(state, "next"));
    is_full_ = FlagOf(At(state, "full"));
    for (const Json& f : ElementsOf(At(state, "frames"))) {
      frames_.push_back({NumberOf(At(f, "bound")), NumberOf(At(f, "step")),
                         NumberOf(At(f, "skirt")), true, FlagOf(At(f, "colours"))});
    }
    return tree_.Restore(At(state, "tree")) && tree_.levels() == levels && frames_.size() == levels;
  }

 private:
  using Files = std::vector<std::pair<std::string, std::string>>;
  struct LevelFrame {
    double bound = 0;  // metres
    double step = 1;   // of the lattice
    double skirt = 0;  // how deep
    bool has_normals = true;
    bool has_colours = false;
  };

  std::string PathOf(size_t level, const TreeTile& tile) const {
    std::string path = std::to_string(level) + "/" + std::to_string(tile.depth);
    for (size_t i = 0; i < (is_terrain_ ? 2u : 3u); ++i) path += "_" + std::to_string(tile.cell[i]);
    return path;
  }

  // The level and tile whose path begins like this; of another text it is any.
  static std::pair<uint32_t, TreeTile> TileIn(std::string_view path) {
    std::array<uint32_t, 5> numbers{};
    const char* at = path.data();
    for (uint32_t& number : numbers) {
      const auto [end, error] = std::from_chars(at, path.data() + path.size(), number);
      if (error != std::errc() || end == path.data() + path.size()) break;
      at = end + 1;
    }
    TreeTile tile;
    tile.depth = numbers[1];
    tile.cell = {numbers[2], numbers[3], numbers[4]};
    return {numbers[0], tile};
  }

  // What clients are told: 0 where there is nothing better.
  double ErrorOf(size_t level) const {
    if (level + 1 == frames_.size()) return 0;
    return frames_[level].bound * kClientPixels / options_.pixels;
  }

  // Skirts reach so far from the triangles that they hang from.
  Box3d WithSkirts(Box3d box, const LevelFrame& frame) const {
    if (box.empty() || frame.skirt == 0) return box;
    const double by = frame.skirt + frame.step;
    box.min = box.min - (is_terrain_ ? Vec3d{0, 0, by} : Vec3d{by, by, by});
    if (!is_terrain_) box.max = box.max + Vec3d{by, by, by};
    return box;
  }

  // Around each tile's content and that of all tiles that replace it.
  void SetBoxes() {
    boxes_.resize(tree_.levels());
    for (size_t level = tree_.levels(); level-- > 0;) {
      const std::vector<TreeTile>& tiles = tree_.level(level);
      boxes_[level].resize(tiles.size());
      for (size_t i = 0; i < tiles.size(); ++i) {
        Box3d& box = boxes_[level][i];
        box = WithSkirts(tiles[i].content, frames_[level]);
        for (uint32_t c = 0; c < tiles[i].children; ++c) {
          box.Add(boxes_[level + 1][tiles[i].first_child + c]);
        }
      }
    }
  }

  static Json VolumeOf(const Box3d& box) {
    const Vec3d middle = (box.min + box.max) * 0.5;
    const Vec3d half = box.max - middle;
    return {{"box", {middle.x, middle.y, middle.z, half.x, 0, 0, 0, half.y, 0, 0, 0, half.z}}};
  }

  // The tile as its parent's file has it, at the path `up` from the folder of the tree.
  Json NodeOf(size_t level, uint32_t index, const std::string& up, Files* files) const {
    const TreeTile& tile = tree_.level(level)[index];
    const bool is_root_of_file = level > 0 && level % kLevelsPerFile == 0 && tile.children > 0;
    if (!is_root_of_file) return TileOf(level, index, up, files);
    const std::string path = PathOf(level, tile) + ".json";
    files->emplace_back(path, TilesetOf(TileOf(level, index, "../", files), ErrorOf(level)));
    return {{"boundingVolume", VolumeOf(boxes_[level][index])},
            {"geometricError", ErrorOf(level)},
            {"content", {{"uri", up + path}}}};
  }

  Json TileOf(size_t level, uint32_t index, const std::string& up, Files* files) const {
    const TreeTile& tile = tree_.level(level)[index];
    const Box3d& box = boxes_[level][index];
    Json node = {{"boundingVolume", VolumeOf(box)}, {"geometricError", ErrorOf(level)}};
    if (level == 0) node["refine"] = "REPLACE";
    if (!tile.content.empty()) {
      node["content"] = {{"uri", up + PathOf(level, tile) + ".glb"}};
      node["metadata"] = {{"class", "tile"},
                          {"properties", {{"errorBound", frames_[level].bound}}}};
    }
    Json children(Json::Array{});
    for (uint32_t c = 0; c < tile.children; ++c) {
      const uint32_t child = tile.first_child + c;
      if (!boxes_[level + 1][child].empty()) {
        children.push_back(NodeOf(level + 1, child, up, files));
      } else if (tile.children == 1) {
        // The next level has nothing here: nothing takes the tile's place.
        children.push_back({{"boundingVolume", VolumeOf(box)}, {"geometricError", 0}});
      }
    }
    if (children.size() > 0) node["children"] = std::move(children);
    return node;
  }

  std::string TilesetOf(Json root, double error) const {
    const Json bound = {{"type", "SCALAR"},
                        {"componentType", "FLOAT64"},
                        {"description",
                         "No point of the tile is farther from the full-resolution input, nor this "
                         "from the level of the tile: in metres, proven."}};
    const Json schema = {{"id", "mtdb"},
                         {"classes", {{"tile", {{"properties", {{"errorBound", bound}}}}}}}};
    const Json extras = {{"object", record_.name},
                         {"digest", record_.digest_hex()},
                         {"pixels", options_.pixels},
                         {"geometricErrorPerErrorBound", kClientPixels / options_.pixels}};
    const Json tileset = {
        {"asset", {{"version", "1.1"}, {"generator", "mtdb"}, {"extras", extras}}},
        {"schema", schema},
        {"geometricError", error},
        {"root", std::move(root)}};
    return tileset.Text() + "\n";
  }

  const ObjectRecord record_;
  const ThreeDTilesOptions options_;
  const TilePlacement placement_;
  const bool is_terrain_;
  TileTree tree_;
  std::vector<LevelFrame> frames_;
  std::vector<std::vector<Box3d>> boxes_;
  uint64_t next_triangles_ = 0;
  bool is_full_ = false;
};

}  // namespace

Result<std::unique_ptr<TileFormat>> MakeThreeDTiles(const ObjectRecord& record,
                                                    const ThreeDTilesOptions& options) {
  const bool in_degrees = IsInDegrees(record);
  if (in_degrees && options.at) {
    return InvalidArgument(
        "--at: the terrain is in degrees and lies on the globe by itself; leave it out");
  }
  if (in_degrees && std::max(record.bounds.max.x - record.bounds.min.x,
                             record.bounds.max.y - record.bounds.min.y) > kMostDegrees) {
    return InvalidArgument(
        "a terrain of more than 30 degrees is no 3D tile set of one local "
        "frame; --as quantized-mesh covers the globe");
  }
  return std::unique_ptr<TileFormat>(
      std::make_unique<ThreeDTiles>(record, options, TilePlacement(record, options.at)));
}

}  // namespace mtdb
