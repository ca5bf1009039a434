// SPDX-License-Identifier: Apache-2.0
// The files of textured objects: the images of their pages, which a store keeps byte for byte, and
// the tiles that are made of them (store/texture_tiles.h).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/base/texture.h"
#include "store/cluster_source.h"
#include "store/object_record.h"

namespace mtdb {

// A page's file has at most so many.
inline constexpr uint64_t kMostPageBytes = uint64_t{1} << 30;
// And the file of the tiles.
inline constexpr uint64_t kMostTileBytes = uint64_t{1} << 40;

// Of all files of the texture. 0 for objects without texture.
uint64_t TextureBytes(const ObjectRecord& record);

// Reads a file of the texture (TextureRecord::file) from its beginning to its end. `take` gets it
// in parts of at most 16 MiB, and nothing when the store has no bytes of it. The checksum is
// compared at the end: what was taken counts only when no error is returned. Errors: those of
// ClusterSource::ReadTextureFile and of `take`.
Status ReadTextureFile(ClusterSource& source, uint32_t file,
                       const std::function<Status(ByteSpan)>& take);

// The record's pages as a mesh has them (MeshHeader::textures), in their order. Each reads its file
// from `source`, which they hold, and checks it; pages of which the store has no bytes have no
// `load`.
std::vector<Texture> TexturesOf(const ObjectRecord& record, std::shared_ptr<ClusterSource> source);

}  // namespace mtdb
