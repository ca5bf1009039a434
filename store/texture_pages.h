// SPDX-License-Identifier: Apache-2.0
// The pages of textured objects: image files that a store keeps byte for byte.
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

// Of the files of all pages. 0 for objects without texture.
uint64_t TextureBytes(const ObjectRecord& record);

// Reads a page's file from its beginning to its end. `take` gets it in parts of at most 16 MiB, and
// nothing when the store has no bytes of it. The checksum is compared at the end: what was taken
// counts only when no error is returned. Errors: those of ClusterSource::ReadTexturePage and of
// `take`.
Status ReadTexturePage(ClusterSource& source, uint32_t page,
                       const std::function<Status(ByteSpan)>& take);

// The record's pages as a mesh has them (MeshHeader::textures), in their order. Each reads its file
// from `source`, which they hold, and checks it; pages of which the store has no bytes have no
// `load`.
std::vector<Texture> TexturesOf(const ObjectRecord& record, std::shared_ptr<ClusterSource> source);

}  // namespace mtdb
