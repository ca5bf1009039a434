// Attribute rows: prediction from the ring of a hole, and coding of the residuals. Integer
// arithmetic, or IEEE operations that are correctly rounded, so that every machine predicts alike.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "codecs/internal/rans.h"
#include "store/base/attributes.h"
#include "store/base/bytes.h"

namespace mtdb {

constexpr uint32_t ZigZag(uint32_t v) { return (v << 1) ^ (0u - (v >> 31)); }
constexpr uint32_t UnZigZag(uint32_t v) { return (v >> 1) ^ (0u - (v & 1)); }

// Codes rows field by field: the difference to the mean of the ring's rows, modulo the type's
// range, as its length in bits and the bits themselves.
class AttributeCoder {
 public:
  explicit AttributeCoder(const AttributeLayout& layout);
  size_t row_bytes() const { return row_bytes_; }
  // Codes the row at `row` (encoding: read, decoding: written).
  void Encode(RansEncoder& coder, std::span<const uint32_t> ring, const Bytes& rows,
              const std::byte* row);
  void Decode(RansDecoder<>& coder, std::span<const uint32_t> ring, const Bytes& rows,
              std::byte* row);

 private:
  static constexpr size_t kPreviousClasses = 9;
  static constexpr size_t kLengthSymbols = 5;  // 15 and more to come, each
  struct Field {
    ScalarType type;
    size_t offset;
    std::array<std::array<FastAdaptiveSymbol, kLengthSymbols>, kPreviousClasses> length;
    std::array<std::array<AdaptiveBit, 3>, 65> top;
  };
  template <typename Coder>
  static uint64_t CodeWord(Coder& coder, Field& field, size_t& previous, uint64_t zigzag);
  template <typename Visit>
  void ForEachField(std::span<const uint32_t> ring, const Bytes& rows, Visit&& visit);
  std::vector<Field> fields_;
  size_t row_bytes_ = 0;
};

// Byte planes: rows of n records of `row_bytes` bytes <-> all first bytes, all second bytes, ...
Bytes SplitPlanes(ByteSpan rows, size_t row_bytes);
Bytes JoinPlanes(ByteSpan planes, size_t row_bytes);

}  // namespace mtdb
