// SPDX-License-Identifier: Apache-2.0
#include "store/records/page_parts.h"

namespace mtdb::internal {

std::string PageLabel(const ObjectRecord& record, uint32_t page) {
  return "page " + std::to_string(page) + " (" + record.texture->pages[page].name + ")";
}

Status CheckPageRange(const ObjectRecord& record, uint32_t page, uint64_t offset, uint64_t bytes,
                      const std::string& where) {
  const size_t pages = record.texture ? record.texture->pages.size() : 0;
  if (page >= pages) {
    return InvalidArgument(where + ": no page " + std::to_string(page) +
                           " of its texture, it has " + std::to_string(pages));
  }
  const uint64_t there = record.texture->pages[page].bytes;
  if (offset > there || bytes > there - offset) {
    return InvalidArgument(where + ": " + PageLabel(record, page) + ": no " +
                           std::to_string(bytes) + " bytes from byte " + std::to_string(offset) +
                           ", its file has " + std::to_string(there));
  }
  return Status::Ok();
}

Status CheckPageChecksum(const ObjectRecord& record, uint32_t page, uint64_t checksum,
                         const std::string& where) {
  const uint64_t expected = record.texture->pages[page].checksum;
  if (checksum == expected) return Status::Ok();
  return Corrupt(where + ": " + PageLabel(record, page) + ": checksum: expected " +
                 std::to_string(expected) + " of its record, found " + std::to_string(checksum) +
                 "; run verify, get the file anew or restore it from a copy");
}

}  // namespace mtdb::internal
