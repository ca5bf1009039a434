// SPDX-License-Identifier: Apache-2.0
// Keys of the four tables, which share one tree, and the checksum seeds that tie a value to its
// key. See store/FORMAT.md.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "store/base/bytes.h"
#include "store/base/hash.h"
#include "store/base/ids.h"
#include "store/base/status.h"

namespace mtdb::internal {

enum class Table : uint8_t { kCatalog = 0, kUnits = 1, kIndex = 2, kTextures = 3 };
inline constexpr std::array<const char*, 4> kTableNames = {"catalog", "units", "index", "textures"};
// Those whose keys begin with an object's id.
inline constexpr std::array kObjectTables = {Table::kUnits, Table::kIndex, Table::kTextures};
inline constexpr size_t kTables = kTableNames.size();

enum class CatalogKind : uint8_t { kSuperblock = 0, kBuilding = 1, kGarbage = 2, kObject = 3 };

inline constexpr size_t kChecksumBytes = 8;
inline constexpr size_t kMaxNameBytes = 500;
inline constexpr uint32_t kIndexRowsPerValue = 512;

inline constexpr size_t kUnitKeyBytes = 21;
inline constexpr size_t kIndexKeyBytes = 12;
inline constexpr size_t kTextureKeyBytes = 16;

// The key in the tree: the table's byte, then the key in the table.
Bytes TreeKey(Table table, ByteSpan key);

Bytes SuperblockKey();
Bytes BuildingKey(ObjectId id);
Bytes GarbageKey(ObjectId id);
Bytes ObjectKey(const std::string& name);
Bytes UnitKey(ObjectId id, uint8_t round, uint64_t hilbert, uint32_t sequence);
Bytes IndexKey(ObjectId id, uint32_t first_row);
Bytes TextureKey(ObjectId id, uint32_t file, uint32_t part);
// The first 8 bytes of an object's keys in kObjectTables.
Bytes ObjectPrefix(ObjectId id);

// Mix(a, b, c, ...) of the format.
template <typename... Rest>
constexpr uint64_t MixAll(uint64_t first, Rest... rest) {
  uint64_t m = Mix64(first);
  ((m = Mix64(m ^ static_cast<uint64_t>(rest))), ...);
  return m;
}

// Of payloads. Free of the object's id, as the whole index is.
uint64_t UnitSeed(UnitId unit, uint8_t round, uint64_t hilbert);
// Values of the tables catalog, index and textures.
uint64_t ValueSeed(Table table, ByteSpan key);

// checksum, body.
Bytes SealValue(Table table, ByteSpan key, ByteSpan body);
// The body of a sealed value; kCorrupt when the checksum is wrong. `where` names file and value.
Result<ByteSpan> OpenValue(Table table, ByteSpan key, ByteSpan value, const std::string& where);

}  // namespace mtdb::internal
