// SPDX-License-Identifier: Apache-2.0
#include "builder/tiles/tile_cutter.h"

#include <algorithm>
#include <span>

#include "builder/tiles/mesh_cut.h"
#include "store/base/hash.h"

namespace mtdb::internal {

namespace {

constexpr uint64_t kMostTiles = 16;  // of a window
constexpr uint64_t kMostBytes = uint64_t{16} << 20;

uint64_t TriangleBytes(size_t row_bytes) {
  constexpr uint64_t kCentre = 16;
  return sizeof(TileTriangle) + 3 * row_bytes + kCentre;
}

}  // namespace

uint64_t TileCutter::WindowTiles(uint64_t tile_triangles, size_t row_bytes) {
  return std::clamp<uint64_t>(kMostBytes / (tile_triangles * TriangleBytes(row_bytes)), 1,
                              kMostTiles);
}

uint64_t TileCutter::WindowBytes(uint64_t tile_triangles, size_t row_bytes) {
  // Tiles may have half as many triangles again as the options say.
  const uint64_t bytes = TriangleBytes(row_bytes) + MeshCut::kTriangleBytes;
  return WindowTiles(tile_triangles, row_bytes) * tile_triangles * bytes * 3 / 2;
}

TileCutter::TileCutter(TriangleSorter& sorter, const RoundCurve& curve, const Grid& grid,
                       const Options& options)
    : sorter_(sorter),
      curve_(curve),
      grid_(grid),
      options_(options),
      windows_((options.tiles - 1) / WindowTiles(options.tile_triangles, options.row_bytes) + 1) {}

Status TileCutter::Next(TriangleBlock* tile, uint64_t* code) {
  const auto [first, end] = TileRange(options_.tiles, windows_, window_);
  if (tile != nullptr) {
    if (!read_) MTDB_RETURN_IF_ERROR(ReadWindow());
    const Part& part = parts_[next_tile_ - first];
    const size_t row = 3 * options_.row_bytes;
    tile->triangles.reserve(part.end - part.begin);
    tile->rows.reserve((part.end - part.begin) * row);
    for (uint32_t i = part.begin; i < part.end; ++i) {
      const uint32_t t = centres_[i].triangle;
      tile->triangles.push_back(block_.triangles[t]);
      const auto at = block_.rows.begin() + static_cast<std::ptrdiff_t>(t * row);
      tile->rows.insert(tile->rows.end(), at, at + static_cast<std::ptrdiff_t>(row));
    }
    *code = tile->triangles.empty() ? 0 : curve_.Code(tile->triangles.front(), grid_);
  }
  if (++next_tile_ < end) return Status::Ok();
  uint64_t unused = 0;
  if (!read_) MTDB_RETURN_IF_ERROR(sorter_.Next(WindowTriangles(), nullptr, &unused));
  block_ = {};
  read_ = false;
  ++window_;
  return Status::Ok();
}

uint64_t TileCutter::WindowTriangles() const {
  const auto [first, end] = TileRange(options_.tiles, windows_, window_);
  return TileRange(sorter_.count(), options_.tiles, end - 1).second -
         TileRange(sorter_.count(), options_.tiles, first).first;
}

Status TileCutter::ReadWindow() {
  const auto [first, end] = TileRange(options_.tiles, windows_, window_);
  const uint64_t triangles = WindowTriangles();
  uint64_t unused = 0;
  MTDB_RETURN_IF_ERROR(sorter_.Next(triangles, &block_, &unused));
  MeasureCentres();
  Cut(static_cast<uint32_t>(end - first), nullptr);
  if (parts_.size() > 1 && PartsHaveLongSeams()) {
    std::ranges::sort(centres_, {}, &Centre::triangle);
    MeshCut mesh(block_.triangles);
    Cut(static_cast<uint32_t>(end - first), &mesh);
  }
  for (const Part& part : parts_) {
    std::ranges::sort(std::span(centres_).subspan(part.begin, part.end - part.begin), {},
                      &Centre::triangle);
  }
  std::ranges::sort(parts_, {}, [&](const Part& part) { return centres_[part.begin].triangle; });
  read_ = true;
  return Status::Ok();
}

void TileCutter::MeasureCentres() {
  std::array<int64_t, 3> base{};
  centres_.resize(block_.triangles.size());
  for (uint32_t i = 0; i < centres_.size(); ++i) {
    std::array<int64_t, 3> sum{};
    for (const Vec3i& p : block_.triangles[i].positions) {
      for (int axis = 0; axis < 3; ++axis) sum[static_cast<size_t>(axis)] += p[axis];
    }
    if (i == 0) base = sum;
    centres_[i].triangle = i;
    for (size_t axis = 0; axis < 3; ++axis) {
      centres_[i].at[axis] = static_cast<float>(sum[axis] - base[axis]);
    }
  }
}

void TileCutter::Cut(uint32_t tiles, MeshCut* mesh) {
  parts_ = {{0, static_cast<uint32_t>(centres_.size()), tiles}};
  for (size_t i = 0; i < parts_.size();) {
    const Part part = parts_[i];
    if (part.tiles == 1) {
      ++i;
      continue;
    }
    // Not in the middle, where the next round, of fewer tiles, may cut again.
    const uint32_t least = (part.tiles + 2) / 3;
    const uint64_t random = Mix64(options_.round ^ Mix64(window_ ^ Mix64(part.begin)));
    auto first = static_cast<uint32_t>(least + random % (part.tiles - 2 * least + 1));
    if (2 * first == part.tiles && first > least) --first;
    const uint32_t middle = Split(part, first);
    if (mesh != nullptr) MendSplit(part, middle, *mesh);
    parts_[i] = {part.begin, middle, first};
    parts_.push_back({middle, part.end, part.tiles - first});
  }
}

bool TileCutter::PartsHaveLongSeams() const {
  std::vector<uint32_t> tiles(centres_.size());
  for (uint32_t p = 0; p < parts_.size(); ++p) {
    for (uint32_t i = parts_[p].begin; i < parts_[p].end; ++i) tiles[centres_[i].triangle] = p;
  }
  return HasLongSeams(block_.triangles, tiles, static_cast<uint32_t>(parts_.size()));
}

void TileCutter::MendSplit(const Part& part, uint32_t middle, MeshCut& mesh) {
  const auto centres = std::span(centres_).subspan(part.begin, part.end - part.begin);
  const size_t first = middle - part.begin;
  std::vector<uint32_t> triangles;
  triangles.reserve(centres.size());
  for (const Centre& centre : centres) triangles.push_back(centre.triangle);
  const MeshCut::Seam seam = mesh.SeamOf(triangles, first);
  if (!seam.is_long()) return;
  std::ranges::sort(triangles);
  const std::vector<uint32_t> walk = mesh.Walk(triangles);
  if (mesh.SeamOf(walk, first).vertices >= seam.vertices) return;
  std::vector<uint32_t> places(block_.triangles.size());
  for (uint32_t i = 0; i < walk.size(); ++i) places[walk[i]] = i;
  std::ranges::sort(centres, {}, [&](const Centre& centre) { return places[centre.triangle]; });
}

uint32_t TileCutter::Split(const Part& part, uint32_t tiles) {
  const auto centres = std::span(centres_).subspan(part.begin, part.end - part.begin);
  std::array<double, 3> sums{};
  std::array<double, 3> squares{};
  for (const Centre& centre : centres) {
    for (size_t axis = 0; axis < 3; ++axis) {
      const double x = centre.at[axis];
      sums[axis] += x;
      squares[axis] += x * x;
    }
  }
  const auto count = static_cast<double>(centres.size());
  const auto variance = [&](size_t axis) {
    return squares[axis] - sums[axis] * sums[axis] / count;
  };
  size_t widest = 0;
  for (size_t axis = 1; axis < (options_.flat ? 2 : 3); ++axis) {
    if (variance(axis) > variance(widest)) widest = axis;
  }
  const auto middle = static_cast<uint32_t>(TileRange(centres.size(), part.tiles, tiles).first);
  std::ranges::nth_element(
      centres, centres.begin() + middle, [&](const Centre& a, const Centre& b) {
        return a.at[widest] != b.at[widest] ? a.at[widest] < b.at[widest] : a.triangle < b.triangle;
      });
  return part.begin + middle;
}

}  // namespace mtdb::internal
