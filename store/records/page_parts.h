// SPDX-License-Identifier: Apache-2.0
// What the writers, readers and checks of pages' files share. See store/FORMAT.md, "Textures".
#pragma once

#include <cstdint>
#include <string>

#include "store/base/status.h"
#include "store/object_record.h"

namespace mtdb::internal {

// Of a page's file, in a value of the store; the last value of a page may have less. With the
// value's checksum and LMDB's header it fills 64 pages of 4096 bytes.
inline constexpr uint32_t kPagePartBytes = (uint32_t{256} << 10) - 24;

// How many values hold a file of so many bytes.
constexpr uint32_t PartsOfPage(uint64_t bytes) {
  return static_cast<uint32_t>((bytes + kPagePartBytes - 1) / kPagePartBytes);
}

// "page 3 (wood.jpg)", for messages. The page is in the record.
std::string PageLabel(const ObjectRecord& record, uint32_t page);

// kInvalidArgument when the record has no such page, or its file not all of those bytes. `where`
// names the object.
Status CheckPageRange(const ObjectRecord& record, uint32_t page, uint64_t offset, uint64_t bytes,
                      const std::string& where);

// kCorrupt when the file has another checksum than the record says.
Status CheckPageChecksum(const ObjectRecord& record, uint32_t page, uint64_t checksum,
                         const std::string& where);

}  // namespace mtdb::internal
