// SPDX-License-Identifier: Apache-2.0
// What the writers, readers and checks of a texture's files share. See store/FORMAT.md, "Textures".
#pragma once

#include <cstdint>
#include <string>

#include "store/base/status.h"
#include "store/object_record.h"

namespace mtdb::internal {

// Of a file, in a value of the store; the last value of a file may have less. With the
// value's checksum and LMDB's header it fills 64 pages of 4096 bytes.
inline constexpr uint32_t kPagePartBytes = (uint32_t{256} << 10) - 24;

// How many values hold a file of so many bytes.
constexpr uint32_t PartsOfPage(uint64_t bytes) {
  return static_cast<uint32_t>((bytes + kPagePartBytes - 1) / kPagePartBytes);
}

// "page 3 (wood.jpg)", or "its tiles", for messages. The record has the file.
std::string TextureFileLabel(const ObjectRecord& record, uint32_t file);

// kInvalidArgument when the record has no such file, or it has not all of those bytes. `where`
// names the object.
Status CheckFileRange(const ObjectRecord& record, uint32_t file, uint64_t offset, uint64_t bytes,
                      const std::string& where);

// kCorrupt when the file has another checksum than the record says.
Status CheckFileChecksum(const ObjectRecord& record, uint32_t file, uint64_t checksum,
                         const std::string& where);

}  // namespace mtdb::internal
