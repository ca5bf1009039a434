// SPDX-License-Identifier: Apache-2.0
#include "tools/render/internal/texture_images.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <string>
#include <utility>

namespace mtdb::internal {

namespace {

constexpr uint64_t kMostDecoded = uint64_t{256} << 20;

// A coordinate that repeats itself, in parts of the page.
// The edge at 1 is not the one at 0.
double Wrapped(double x) { return x >= 0 && x <= 1 ? x : x - std::floor(x); }

}  // namespace

Status TextureImages::Load(const TriangleMesh& mesh, std::shared_ptr<const TextureTiles> tiles) {
  mesh_ = &mesh;
  tiles_ = std::move(tiles);
  const size_t pages = mesh.header.textures.size();
  if (tiles_->pages().size() == pages && mesh.corners.size() == 3 * mesh.triangles.size()) {
    return Status::Ok();
  }
  return InvalidArgument("the mesh has " + std::to_string(pages) +
                         " images of its texture, the tiles are of " +
                         std::to_string(tiles_->pages().size()));
}

Status TextureImages::status() const {
  const std::shared_lock lock(mutex_);
  return status_;
}

TextureImages::TilePixels TextureImages::Tile(const TilePlace& place) const {
  {
    const std::shared_lock lock(mutex_);
    if (const auto at = decoded_.find(place); at != decoded_.end()) return at->second;
  }
  const auto read = [&]() -> Result<Pixels> {
    MTDB_ASSIGN_OR_RETURN(const Bytes tile, tiles_->Tile(place));
    return DecodeImage(tile);
  };
  Result<Pixels> pixels = read();
  TilePixels tile;
  if (pixels.ok()) tile = std::make_shared<const Pixels>(*std::move(pixels));
  const std::lock_guard lock(mutex_);
  if (status_.ok()) status_ = pixels.status();
  const uint64_t bytes = tile == nullptr ? 0 : tile->rgba.size();
  // Rays of a picture go from row to row, and come back to few tiles.
  if (decoded_bytes_ + bytes > kMostDecoded) {
    decoded_.clear();
    decoded_bytes_ = 0;
  }
  if (decoded_.emplace(place, tile).second) decoded_bytes_ += bytes;
  return tile;
}

Texel TextureImages::Sample(uint32_t page, double x, double y, double pixels) const {
  const TiledPage& p = tiles_->pages()[page];
  if (p.levels == 0) return {};
  const double wanted = pixels > 1 ? std::floor(std::log2(pixels)) : 0;
  const auto level = static_cast<uint32_t>(std::min<double>(wanted, p.levels - 1));
  const double scale = std::ldexp(1.0, -static_cast<int>(level));
  const double px = x * p.width * scale, py = y * p.height * scale;
  const auto square = [](double at, uint32_t count) {
    return static_cast<uint32_t>(std::clamp(std::floor(at / kTileSide), 0.0, count - 1.0));
  };
  const TilePlace place{page, level, square(px, p.columns_of(level)), square(py, p.rows_of(level))};
  const TilePixels tile = Tile(place);
  if (tile == nullptr) return {};
  const auto inside = [](double at, uint32_t n) {
    return at - static_cast<double>(n) * kTileSide + kTileMargin;
  };
  return TexelAt(*tile, inside(px, place.column), inside(py, place.row));
}

Vec3f TextureImages::Over(Vec3f under, uint32_t triangle, double b, double c, double size,
                          double area) const {
  const TextureCorner* const corners = &mesh_->corners[size_t{triangle} * 3];
  const uint32_t page = corners[0].page;
  if (page >= mesh_->header.textures.size()) return under;
  const double a = 1 - b - c;
  const double u = a * corners[0].u + b * corners[1].u + c * corners[2].u;
  const double v = a * corners[0].v + b * corners[1].v + c * corners[2].v;
  const TiledPage& size_of = tiles_->pages()[page];
  // Texels of the triangle, for the area of one sample.
  const double du1 = double{corners[1].u} - corners[0].u, dv1 = double{corners[1].v} - corners[0].v;
  const double du2 = double{corners[2].u} - corners[0].u, dv2 = double{corners[2].v} - corners[0].v;
  const double texels = std::fabs(du1 * dv2 - du2 * dv1) / 2 * size_of.width * size_of.height;
  const double pixels = area > 0 ? std::sqrt(texels / area) * size : 0;
  return Sample(page, Wrapped(u), 1 - Wrapped(v), pixels).Over(under);
}

}  // namespace mtdb::internal
