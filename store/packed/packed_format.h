// SPDX-License-Identifier: Apache-2.0
// Header, directory and pages of a packed file as bytes. Layout in store/FORMAT.md, "The packed
// file".
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "store/base/status.h"
#include "store/cluster_index.h"
#include "store/object_record.h"

namespace mtdb::internal {

inline constexpr size_t kPackedHeaderBytes = 72;
// A file without blocks may claim any directory; a reader has it in memory.
inline constexpr uint64_t kMaxDirectoryBytes = uint64_t{1} << 28;

struct PackedHeader {
  uint64_t file_bytes = 0;
  uint64_t directory_bytes = 0;
  uint64_t first_bytes = 0;
  uint64_t hash_low = 0;
  uint64_t hash_high = 0;
};

// Whether a file that begins so is meant to be a packed one.
bool IsPackedMagic(ByteSpan bytes);
Bytes EncodePackedHeader(const PackedHeader& header);
// `where` names the file.
Result<PackedHeader> DecodePackedHeader(ByteSpan bytes, uint64_t file_bytes,
                                        const std::string& where);
void SetContentHash(ByteSpan directory, PackedHeader* header);

struct PackedPage {
  uint64_t offset = 0;  // in the file
  uint32_t bytes = 0;
  uint64_t checksum = 0;
  uint64_t nodes = 0;
  uint8_t error_code_min = 0;
  uint8_t error_code_max = 0;
  Box3i bounds;
  VertexIndex first_vertex = 0;  // of its first unit; derived
};

// The i-th of so many files of a texture, in the order of a packed file: the tiles, then the pages.
constexpr uint32_t TextureFileAt(uint32_t files, uint32_t i) { return i == 0 ? files - 1 : i - 1; }

struct PackedObject {
  ObjectRecord record;
  uint64_t start = 0;
  uint64_t end = 0;       // derived
  uint64_t textures = 0;  // derived: where pages and payloads end, and files of its texture begin
  uint64_t first_bytes = 0;
  uint32_t rows_per_page = 1;
  std::vector<PackedPage> pages;

  uint32_t units() const { return record.clusters + record.root_pieces; }
  // Where a file of its texture begins.
  uint64_t texture_file(uint32_t file) const;
  uint32_t page_of(UnitId unit) const { return unit / rows_per_page; }
  uint32_t first_unit(uint32_t page) const { return page * rows_per_page; }
  uint32_t rows(uint32_t page) const { return std::min(rows_per_page, units() - first_unit(page)); }
};

Bytes EncodePackedDirectory(const std::vector<PackedObject>& objects);
Result<std::vector<PackedObject>> DecodePackedDirectory(ByteSpan bytes, const PackedHeader& header,
                                                        const std::string& where);

struct PackedRow {
  UnitEntry entry;
  uint64_t offset = 0;  // of the payload in the file
  uint32_t bytes = 0;
  uint64_t checksum = 0;
  std::vector<UnitId> children;
  std::vector<UnitId> parents;
  uint8_t error_code_below = 0;  // the largest error code of the children
};

uint64_t PageSeed(const PackedObject& object, uint32_t page);
// Where a payload of 64-bit offset is, in the fields that a store has for it.
inline PayloadLocation PackedLocation(uint64_t offset, uint32_t bytes, uint64_t checksum) {
  return {static_cast<uint32_t>(offset >> 32), static_cast<uint32_t>(offset), bytes, checksum};
}
inline uint64_t PackedOffset(const PayloadLocation& location) {
  return uint64_t{location.value} << 32 | location.offset;
}

// `gap_before`: the unit's payload does not follow that of the unit before it. `offset_of` says
// where it then lies; the page's size does not depend on that.
Bytes EncodePackedPage(const ClusterIndex& index, const PackedObject& object, uint32_t page,
                       const std::function<bool(UnitId)>& gap_before,
                       const std::function<uint64_t(UnitId)>& offset_of);
// Checks all that the page and the directory's entry say of each other.
Result<std::vector<PackedRow>> DecodePackedPage(ByteSpan bytes, const PackedObject& object,
                                                uint32_t page, const std::string& where);

}  // namespace mtdb::internal
