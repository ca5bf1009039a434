// SPDX-License-Identifier: Apache-2.0
#include "store/records/page_parts.h"

#include <algorithm>

namespace mtdb::internal {

std::string TextureFileLabel(const ObjectRecord& record, uint32_t file) {
  if (file == record.texture->pages.size()) return "the tiles of its texture";
  return "page " + std::to_string(file) + " (" + record.texture->pages[file].name + ")";
}

Status CheckFileRange(const ObjectRecord& record, uint32_t file, uint64_t offset, uint64_t bytes,
                      const std::string& where) {
  const uint32_t files = record.texture ? record.texture->files() : 0;
  if (file >= files) {
    return InvalidArgument(where + ": no page " + std::to_string(file) +
                           " of its texture, it has " +
                           std::to_string(files - std::min(files, 1U)));
  }
  const uint64_t there = record.texture->file(file).bytes;
  if (offset > there || bytes > there - offset) {
    return InvalidArgument(where + ": " + TextureFileLabel(record, file) + ": no " +
                           std::to_string(bytes) + " bytes from byte " + std::to_string(offset) +
                           ", its file has " + std::to_string(there));
  }
  return Status::Ok();
}

Status CheckFileChecksum(const ObjectRecord& record, uint32_t file, uint64_t checksum,
                         const std::string& where) {
  const uint64_t expected = record.texture->file(file).checksum;
  if (checksum == expected) return Status::Ok();
  return Corrupt(where + ": " + TextureFileLabel(record, file) + ": checksum: expected " +
                 std::to_string(expected) + " of its record, found " + std::to_string(checksum) +
                 "; run verify, get the file anew or restore it from a copy");
}

}  // namespace mtdb::internal
