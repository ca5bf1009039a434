// SPDX-License-Identifier: Apache-2.0
#include "builder/disk/squeeze.h"

#include <cstdint>
#include <cstring>
#include <zstd.h>

#include "store/base/check.h"

namespace mtdb::internal {

namespace {

constexpr int kFast = 1;
constexpr size_t kWord = sizeof(uint32_t);

uint32_t WordAt(const std::byte* table, size_t i) {
  uint32_t word = 0;
  std::memcpy(&word, table + i * kWord, kWord);
  return word;
}

// Small differences of either sign as small numbers.
uint32_t Fold(uint32_t difference) {
  return difference << 1 ^ (difference >> 31 != 0 ? ~uint32_t{0} : 0);
}
uint32_t Unfold(uint32_t folded) { return folded >> 1 ^ ((folded & 1) != 0 ? ~uint32_t{0} : 0); }

Bytes SplitPlanes(ByteSpan table, size_t columns) {
  const size_t words = table.size() / kWord, rows = words / columns;
  Bytes planes(table.size());
  for (size_t c = 0; c < columns; ++c) {
    std::byte* const plane = planes.data() + c * rows * kWord;
    uint32_t above = 0;
    for (size_t r = 0; r < rows; ++r) {
      const uint32_t word = WordAt(table.data(), r * columns + c);
      const uint32_t folded = Fold(word - above);
      above = word;
      for (size_t b = 0; b < kWord; ++b) {
        plane[b * rows + r] = static_cast<std::byte>(folded >> (8 * b));
      }
    }
  }
  return planes;
}

Bytes JoinPlanes(ByteSpan planes, size_t columns) {
  const size_t words = planes.size() / kWord, rows = words / columns;
  Bytes table(planes.size());
  for (size_t c = 0; c < columns; ++c) {
    const std::byte* const plane = planes.data() + c * rows * kWord;
    uint32_t word = 0;
    for (size_t r = 0; r < rows; ++r) {
      uint32_t folded = 0;
      for (size_t b = 0; b < kWord; ++b) {
        folded |= static_cast<uint32_t>(plane[b * rows + r]) << (8 * b);
      }
      word += Unfold(folded);
      std::memcpy(table.data() + (r * columns + c) * kWord, &word, kWord);
    }
  }
  return table;
}

}  // namespace

Bytes SqueezeTable(ByteSpan table, size_t columns) {
  MTDB_CHECK(columns == 0 || table.size() % (columns * kWord) == 0, "a table has whole rows");
  const Bytes planes = columns == 0 ? Bytes() : SplitPlanes(table, columns);
  const ByteSpan from = columns == 0 ? table : ByteSpan(planes);
  ByteWriter head;
  head.PutVarint(table.size());
  Bytes squeezed = head.Take();
  const size_t at = squeezed.size();
  squeezed.resize(at + ZSTD_compressBound(from.size()));
  const size_t size =
      ZSTD_compress(squeezed.data() + at, squeezed.size() - at, from.data(), from.size(), kFast);
  if (ZSTD_isError(size)) throw std::bad_alloc();  // there is no other reason
  squeezed.resize(at + size);
  return squeezed;
}

std::optional<Bytes> UnsqueezeTable(ByteSpan squeezed, size_t columns, size_t most) {
  ByteReader reader(squeezed);
  const uint64_t size = reader.GetVarint();
  if (reader.failed() || size > most) return std::nullopt;
  if (columns != 0 && size % (columns * kWord) != 0) return std::nullopt;
  const ByteSpan body = squeezed.subspan(reader.position());
  Bytes table(size);
  if (ZSTD_decompress(table.data(), size, body.data(), body.size()) != size) return std::nullopt;
  return columns == 0 ? table : JoinPlanes(table, columns);
}

}  // namespace mtdb::internal
