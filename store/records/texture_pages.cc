// SPDX-License-Identifier: Apache-2.0
#include "store/texture_pages.h"

#include <algorithm>
#include <utility>

#include "store/base/hash.h"
#include "store/base/out_of_memory.h"
#include "store/base/running_hash.h"
#include "store/records/page_parts.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr uint64_t kBytesAtOnce = 16 << 20;

}  // namespace

Result<Bytes> ClusterSource::ReadTextureFile(uint32_t file, uint64_t offset, uint64_t bytes) {
  const std::string where = "object " + record().name;
  MTDB_RETURN_IF_ERROR(CheckFileRange(record(), file, offset, bytes, where));
  if (bytes == 0) return Bytes();
  return Unsupported(where + ": " + TextureFileLabel(record(), file) +
                     ": its bytes cannot be had from here; open the store or the packed file");
}

uint64_t TextureBytes(const ObjectRecord& record) {
  uint64_t bytes = 0;
  if (!record.texture) return bytes;
  for (uint32_t i = 0; i < record.texture->files(); ++i) bytes += record.texture->file(i).bytes;
  return bytes;
}

Status ReadTextureFile(ClusterSource& source, uint32_t file,
                       const std::function<Status(ByteSpan)>& take) {
  return CatchOutOfMemory([&]() -> Status {
    const ObjectRecord& record = source.record();
    const std::string where = "object " + record.name;
    MTDB_RETURN_IF_ERROR(CheckFileRange(record, file, 0, 0, where));
    const uint64_t size = record.texture->file(file).bytes;
    RunningHash hash;
    for (uint64_t at = 0; at < size;) {
      MTDB_ASSIGN_OR_RETURN(const Bytes part,
                            source.ReadTextureFile(file, at, std::min(kBytesAtOnce, size - at)));
      hash.Add(part);
      MTDB_RETURN_IF_ERROR(take(part));
      at += part.size();
    }
    return size == 0 ? Status::Ok() : CheckFileChecksum(record, file, hash.value(), where);
  });
}

std::vector<Texture> TexturesOf(const ObjectRecord& record, std::shared_ptr<ClusterSource> source) {
  std::vector<Texture> textures;
  if (!record.texture) return textures;
  for (uint32_t i = 0; i < record.texture->pages.size(); ++i) {
    const TextureRecord::Page& page = record.texture->pages[i];
    Texture& texture = textures.emplace_back();
    texture.name = page.name;
    texture.media_type = page.media_type;
    texture.width = page.width;
    texture.height = page.height;
    if (page.bytes == 0) continue;
    texture.load = [source, i, bytes = page.bytes] { return source->ReadTextureFile(i, 0, bytes); };
  }
  return textures;
}

}  // namespace mtdb
