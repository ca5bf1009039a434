#include "codecs/internal/predictor.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <type_traits>

namespace mtdb {

namespace {

int32_t RoundedMean(int64_t sum, int64_t count) {
  const int64_t numerator = 2 * sum + count;
  const int64_t denominator = 2 * count;
  int64_t q = numerator / denominator;
  if (numerator % denominator < 0) --q;
  return static_cast<int32_t>(q);
}

// A type's values as unsigned words in the same order, so that close values have small residuals.
template <typename T>
auto ToWord(T value) {
  if constexpr (std::is_floating_point_v<T>) {
    using Word = std::conditional_t<sizeof(T) == 4, uint32_t, uint64_t>;
    constexpr int kTop = sizeof(T) * 8 - 1;
    const auto bits = std::bit_cast<Word>(value);
    return (bits >> kTop) ? static_cast<Word>(~bits) : static_cast<Word>(bits | (Word{1} << kTop));
  } else {
    return static_cast<std::make_unsigned_t<T>>(value);
  }
}

template <typename T, typename Word>
T FromWord(Word word) {
  if constexpr (std::is_floating_point_v<T>) {
    constexpr int kTop = sizeof(T) * 8 - 1;
    return std::bit_cast<T>((word >> kTop) ? static_cast<Word>(word & ~(Word{1} << kTop))
                                           : static_cast<Word>(~word));
  } else {
    return static_cast<T>(word);
  }
}

template <typename T>
T Load(const std::byte* p) {
  T v;
  std::memcpy(&v, p, sizeof(T));
  return v;
}

template <typename T>
T MeanOfRing(std::span<const uint32_t> ring, const Bytes& rows, size_t row_bytes, size_t offset) {
  if constexpr (std::is_floating_point_v<T>) {
    double sum = 0;
    for (const uint32_t v : ring) sum += Load<T>(rows.data() + v * row_bytes + offset);
    const double mean = sum / static_cast<double>(ring.size());
    // A NaN's bits differ between machines; so does a float overflow's handling.
    if (!(std::abs(mean) <= 1e30)) return T{0};
    return static_cast<T>(mean);
  } else {
    int64_t sum = 0;
    for (const uint32_t v : ring) sum += Load<T>(rows.data() + v * row_bytes + offset);
    const auto n = static_cast<int64_t>(ring.size());
    int64_t q = sum / n;
    if (sum % n < 0) --q;
    return static_cast<T>(q);
  }
}

}  // namespace

Vec3i PredictPosition(std::span<const uint32_t> ring, const std::vector<Vec3i>& positions) {
  int64_t x = 0;
  int64_t y = 0;
  int64_t z = 0;
  for (const uint32_t v : ring) {
    x += positions[v].x;
    y += positions[v].y;
    z += positions[v].z;
  }
  const auto n = static_cast<int64_t>(ring.size());
  return {RoundedMean(x, n), RoundedMean(y, n), RoundedMean(z, n)};
}

AttributePredictor::AttributePredictor(const AttributeLayout& layout) {
  for (const VertexAttribute& a : layout.attributes) {
    fields_.push_back({a.type, row_bytes_});
    row_bytes_ += ScalarSize(a.type);
  }
}

template <typename Combine>
void AttributePredictor::Apply(std::span<const uint32_t> ring, const Bytes& rows,
                               const std::byte* in, std::byte* out, Combine combine) const {
  for (const Field& f : fields_) {
    const auto run = [&]<typename T>(T) {
      const T mean = MeanOfRing<T>(ring, rows, row_bytes_, f.offset);
      combine.template operator()<T>(mean, in + f.offset, out + f.offset);
    };
    switch (f.type) {
      case ScalarType::kInt8: run(int8_t{}); break;
      case ScalarType::kUint8: run(uint8_t{}); break;
      case ScalarType::kInt16: run(int16_t{}); break;
      case ScalarType::kUint16: run(uint16_t{}); break;
      case ScalarType::kInt32: run(int32_t{}); break;
      case ScalarType::kUint32: run(uint32_t{}); break;
      case ScalarType::kFloat32: run(float{}); break;
      case ScalarType::kFloat64: run(double{}); break;
    }
  }
}

void AttributePredictor::Encode(std::span<const uint32_t> ring, const Bytes& rows,
                                const std::byte* row, std::byte* residual) const {
  Apply(ring, rows, row, residual, []<typename T>(T mean, const std::byte* in, std::byte* out) {
    using Word = decltype(ToWord(T{}));
    const auto d = static_cast<Word>(ToWord(Load<T>(in)) - ToWord(mean));
    const auto zigzag = static_cast<Word>(
        static_cast<Word>(d << 1) ^ static_cast<Word>((d >> (sizeof(T) * 8 - 1)) ? ~Word{0} : 0));
    std::memcpy(out, &zigzag, sizeof(T));
  });
}

void AttributePredictor::Decode(std::span<const uint32_t> ring, const Bytes& rows,
                                const std::byte* residual, std::byte* row) const {
  Apply(ring, rows, residual, row, []<typename T>(T mean, const std::byte* in, std::byte* out) {
    using Word = decltype(ToWord(T{}));
    const auto zigzag = Load<Word>(in);
    const auto d = static_cast<Word>(static_cast<Word>(zigzag >> 1) ^
                                     static_cast<Word>((zigzag & 1) ? ~Word{0} : 0));
    const T value = FromWord<T>(static_cast<Word>(ToWord(mean) + d));
    std::memcpy(out, &value, sizeof(T));
  });
}

Bytes SplitPlanes(ByteSpan rows, size_t row_bytes) {
  Bytes planes(rows.size());
  const size_t n = row_bytes == 0 ? 0 : rows.size() / row_bytes;
  for (size_t i = 0; i < n; ++i)
    for (size_t b = 0; b < row_bytes; ++b) planes[b * n + i] = rows[i * row_bytes + b];
  return planes;
}

Bytes JoinPlanes(ByteSpan planes, size_t row_bytes) {
  Bytes rows(planes.size());
  const size_t n = row_bytes == 0 ? 0 : planes.size() / row_bytes;
  for (size_t i = 0; i < n; ++i)
    for (size_t b = 0; b < row_bytes; ++b) rows[i * row_bytes + b] = planes[b * n + i];
  return rows;
}

}  // namespace mtdb
