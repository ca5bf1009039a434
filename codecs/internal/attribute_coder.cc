#include "codecs/internal/attribute_coder.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <type_traits>

namespace mtdb {

namespace {

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

AttributeCoder::AttributeCoder(const AttributeLayout& layout) {
  for (const VertexAttribute& a : layout.attributes) {
    fields_.push_back({a.type, row_bytes_, {}, {}});
    row_bytes_ += ScalarSize(a.type);
  }
}

// Visits each field with the mean of the ring's values, of the field's type.
template <typename Visit>
void AttributeCoder::ForEachField(std::span<const uint32_t> ring, const Bytes& rows,
                                  Visit&& visit) {
  for (Field& f : fields_) {
    const auto run = [&]<typename T>(T) {
      visit(f, MeanOfRing<T>(ring, rows, row_bytes_, f.offset));
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

// `previous` is the class of the residual before this one in the row: its length, at most 7, and 8
// at the start of the row.
template <typename Coder>
uint64_t AttributeCoder::CodeWord(Coder& coder, Field& field, size_t& previous, uint64_t zigzag) {
  auto& models = field.length[previous];
  auto left = static_cast<uint32_t>(std::bit_width(zigzag));
  uint32_t length = 0;
  for (size_t i = 0; i < kLengthSymbols; ++i) {
    const uint32_t s = coder.Symbol(models[i], std::min(left, 15u));
    length += s;
    left -= s;
    if (s < 15) break;
  }
  length = std::min(length, 64u);
  previous = std::min(length, 7u);
  if (length <= 1) return length;
  // The two bits below the top one have models, since short differences are likelier.
  auto low = static_cast<int>(length) - 1;
  uint64_t word = 1;
  for (int i = 0; i < 2 && low > 0; ++i) {
    --low;
    AdaptiveBit& model = field.top[length][word - 1];
    word = word << 1 | (coder.Bit(model, zigzag >> low & 1) ? 1 : 0);
  }
  for (; low > 32; low -= 32) {
    word = word << 32 | coder.Raw(32, static_cast<uint32_t>(zigzag >> (low - 32)));
  }
  const uint64_t mask = (uint64_t{1} << low) - 1;
  return word << low | coder.Raw(low, static_cast<uint32_t>(zigzag & mask));
}

void AttributeCoder::Encode(RansEncoder& coder, std::span<const uint32_t> ring, const Bytes& rows,
                            const std::byte* row) {
  size_t previous = kPreviousClasses - 1;
  ForEachField(ring, rows, [&]<typename T>(Field& f, T mean) {
    using Word = decltype(ToWord(T{}));
    const auto d = static_cast<Word>(ToWord(Load<T>(row + f.offset)) - ToWord(mean));
    const auto zigzag = static_cast<Word>(
        static_cast<Word>(d << 1) ^ static_cast<Word>((d >> (sizeof(T) * 8 - 1)) ? ~Word{0} : 0));
    CodeWord(coder, f, previous, zigzag);
  });
}

void AttributeCoder::Decode(RansDecoder<>& decoder, std::span<const uint32_t> ring,
                            const Bytes& rows, std::byte* row) {
  size_t previous = kPreviousClasses - 1;
  auto coder = decoder.lane();
  ForEachField(ring, rows, [&]<typename T>(Field& f, T mean) {
    using Word = decltype(ToWord(T{}));
    const auto zigzag = static_cast<Word>(CodeWord(coder, f, previous, 0));
    const auto d = static_cast<Word>(static_cast<Word>(zigzag >> 1) ^
                                     static_cast<Word>((zigzag & 1) ? ~Word{0} : 0));
    const T value = FromWord<T>(static_cast<Word>(ToWord(mean) + d));
    std::memcpy(row + f.offset, &value, sizeof(T));
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
