// Predictors of a vertex from the ring of its hole. Integer arithmetic, or IEEE operations that are
// exact or correctly rounded, so that every machine predicts the same bits.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "store/base/attributes.h"
#include "store/base/bytes.h"
#include "store/base/geometry.h"

namespace mtdb {

constexpr uint32_t ZigZag(uint32_t v) { return (v << 1) ^ (0u - (v >> 31)); }
constexpr uint32_t UnZigZag(uint32_t v) { return (v >> 1) ^ (0u - (v & 1)); }

// The rounded mean of the ring's positions.
Vec3i PredictPosition(std::span<const uint32_t> ring, const std::vector<Vec3i>& positions);

// Residuals of attribute rows against the mean of the ring's rows, modulo the type's range; the
// residual of a row has the row's size.
class AttributePredictor {
 public:
  explicit AttributePredictor(const AttributeLayout& layout);
  size_t row_bytes() const { return row_bytes_; }
  // residual = row - prediction.
  void Encode(std::span<const uint32_t> ring, const Bytes& rows, const std::byte* row,
              std::byte* residual) const;
  // row = residual + prediction.
  void Decode(std::span<const uint32_t> ring, const Bytes& rows, const std::byte* residual,
              std::byte* row) const;

 private:
  template <typename Combine>
  void Apply(std::span<const uint32_t> ring, const Bytes& rows, const std::byte* in, std::byte* out,
             Combine combine) const;
  struct Field {
    ScalarType type;
    size_t offset;
  };
  std::vector<Field> fields_;
  size_t row_bytes_ = 0;
};

// Byte planes: rows of n records of `row_bytes` bytes <-> all first bytes, all second bytes, ...
Bytes SplitPlanes(ByteSpan rows, size_t row_bytes);
Bytes JoinPlanes(ByteSpan planes, size_t row_bytes);

}  // namespace mtdb
