// SPDX-License-Identifier: Apache-2.0
// The images of a mesh's texture, as colours of places on it.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <shared_mutex>

#include "codecs/image_file/decode_image.h"
#include "store/base/mesh_sink.h"
#include "store/base/status.h"
#include "store/base/texture.h"
#include "store/texture_tiles.h"
#include "tools/render/internal/image_levels.h"

namespace mtdb::internal {

// Load first; then safe for many threads. Keeps the tiles that were used, up to 256 MiB.
class TextureImages {
 public:
  // `tiles`: of the object that the mesh is of. The mesh must outlive it. Errors: kInvalidArgument
  // (tiles of other pages).
  Status Load(const TriangleMesh& mesh, std::shared_ptr<const TextureTiles> tiles);

  // `under`, a linear colour, with the texture over it, at a place of the triangle, which has
  // barycentric coordinates b and c of corners 1 and 2. `size` is a sample's, and `area` the
  // triangle's, in the same unit and its square. Where there is no image it is `under`.
  Vec3f Over(Vec3f under, uint32_t triangle, double b, double c, double size, double area) const;

  // The first error that Over met: those of TextureTiles::Tile and of DecodeImage.
  Status status() const;

 private:
  using TilePixels = std::shared_ptr<const Pixels>;

  // At (x, y) in parts of the page from the upper left corner; `pixels` of its finest level are
  // from one sample to the next.
  Texel Sample(uint32_t page, double x, double y, double pixels) const;
  // Null when it cannot be read.
  TilePixels Tile(const TilePlace& place) const;

  const TriangleMesh* mesh_ = nullptr;
  std::shared_ptr<const TextureTiles> tiles_;

  mutable std::shared_mutex mutex_;
  mutable std::map<TilePlace, TilePixels> decoded_;
  mutable uint64_t decoded_bytes_ = 0;
  mutable Status status_;
};

}  // namespace mtdb::internal
