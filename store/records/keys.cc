// SPDX-License-Identifier: Apache-2.0
#include "store/records/keys.h"

namespace mtdb::internal {
namespace {

ByteWriter CatalogKey(CatalogKind kind) {
  ByteWriter w;
  w.Put(static_cast<uint8_t>(kind));
  return w;
}

}  // namespace

Bytes TreeKey(Table table, ByteSpan key) {
  ByteWriter w;
  w.bytes().reserve(1 + key.size());
  w.Put(static_cast<uint8_t>(table));
  w.PutBytes(key);
  return w.Take();
}

Bytes SuperblockKey() { return CatalogKey(CatalogKind::kSuperblock).Take(); }

Bytes BuildingKey(ObjectId id) {
  ByteWriter w = CatalogKey(CatalogKind::kBuilding);
  w.PutBigEndian(id.value);
  return w.Take();
}

Bytes GarbageKey(ObjectId id) {
  ByteWriter w = CatalogKey(CatalogKind::kGarbage);
  w.PutBigEndian(id.value);
  return w.Take();
}

Bytes ObjectKey(const std::string& name) {
  ByteWriter w = CatalogKey(CatalogKind::kObject);
  w.PutBytes(AsBytes(name));
  return w.Take();
}

Bytes UnitKey(ObjectId id, uint8_t round, uint64_t hilbert, uint32_t sequence) {
  ByteWriter w;
  w.PutBigEndian(id.value);
  w.Put(static_cast<uint8_t>(255 - round));
  w.PutBigEndian(hilbert);
  w.PutBigEndian(sequence);
  return w.Take();
}

Bytes IndexKey(ObjectId id, uint32_t first_row) {
  ByteWriter w;
  w.PutBigEndian(id.value);
  w.PutBigEndian(first_row);
  return w.Take();
}

Bytes TextureKey(ObjectId id, uint32_t file, uint32_t part) {
  ByteWriter w;
  w.PutBigEndian(id.value);
  w.PutBigEndian(file);
  w.PutBigEndian(part);
  return w.Take();
}

Bytes ObjectPrefix(ObjectId id) {
  ByteWriter w;
  w.PutBigEndian(id.value);
  return w.Take();
}

uint64_t UnitSeed(UnitId unit, uint8_t round, uint64_t hilbert) {
  return MixAll('C', unit, round, hilbert);
}

uint64_t ValueSeed(Table table, ByteSpan key) {
  const char letter = table == Table::kCatalog ? 'K' : table == Table::kTextures ? 'T' : 'I';
  return MixAll(letter, Hash64(key));
}

Bytes SealValue(Table table, ByteSpan key, ByteSpan body) {
  ByteWriter w;
  w.bytes().reserve(kChecksumBytes + body.size());
  w.Put(Hash64(body, ValueSeed(table, key)));
  w.PutBytes(body);
  return w.Take();
}

Result<ByteSpan> OpenValue(Table table, ByteSpan key, ByteSpan value, const std::string& where) {
  ByteReader r(value);
  const auto checksum = r.Get<uint64_t>();
  const ByteSpan body = r.GetBytes(r.remaining());
  const uint64_t expected = Hash64(body, ValueSeed(table, key));
  if (r.failed() || checksum != expected) {
    return Corrupt(where + ": checksum: expected " + std::to_string(expected) + ", found " +
                   std::to_string(checksum) + "; run verify, restore the file from a copy");
  }
  return body;
}

}  // namespace mtdb::internal
