// SPDX-License-Identifier: Apache-2.0
#include "codecs/coding/attribute_coder.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <type_traits>

#include "store/base/attribute_grid.h"

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

// floor(sum / n)
int64_t FloorMean(int64_t sum, size_t n) {
  const auto count = static_cast<int64_t>(n);
  return sum / count - (sum % count < 0 ? 1 : 0);
}

uint64_t Distance(uint64_t a, uint64_t b) { return a > b ? a - b : b - a; }
uint64_t Distance(int64_t a, int64_t b) {
  return a > b ? static_cast<uint64_t>(a) - static_cast<uint64_t>(b)
               : static_cast<uint64_t>(b) - static_cast<uint64_t>(a);
}

// The mean distance of the ring's values from their mean; of large ones without the lowest bits.
class Spread {
 public:
  void Add(uint64_t distance) { sum_ += std::min(distance, uint64_t{1} << 56); }
  uint64_t Mean(size_t n) const { return 2 * sum_ / n; }

 private:
  uint64_t sum_ = 0;
};

// Mirrors the half |s| + |t| >= c of the octahedron's square into the other one, and back.
OctahedralCode Mirror(OctahedralCode code, int32_t centre) {
  const int32_t s = centre - std::abs(code.t);
  const int32_t t = centre - std::abs(code.s);
  return {code.s < 0 ? -s : s, code.t < 0 ? -t : t};
}

// x modulo 2c + 1, in -c..c, for |x| <= 3c + 1.
int32_t WrapCentred(int32_t x, int32_t centre) {
  const int32_t range = 2 * centre + 1;
  return x > centre ? x - range : x < -centre ? x + range : x;
}

// Of length 1; (0, 0, 0) when it has none.
Vec3d Unit(const Vec3d& v) {
  const double length = Length(v);
  return length > 0 && std::isfinite(length) ? Vec3d{v.x / length, v.y / length, v.z / length}
                                             : Vec3d{0, 0, 0};
}

// Of the triangles between the vertex and its ring, each by its area.
Vec3d StarNormal(const AttributeCoder::Star& star) {
  const auto offset = [&](const Vec3i& q) {
    const Vec3i& p = star.position;
    return Vec3d{static_cast<double>(q.x) - p.x, static_cast<double>(q.y) - p.y,
                 static_cast<double>(q.z) - p.z};
  };
  Vec3d sum{0, 0, 0};
  Vec3d before = offset(star.ring_positions.back());
  for (const Vec3i& q : star.ring_positions) {
    const Vec3d next = offset(q);
    sum = sum + Cross(before, next);
    before = next;
  }
  return Unit(sum);
}

// Encoders read the row and give the residual; decoders write it and ignore what they give.
template <typename Row>
constexpr bool kDecodes = !std::is_const_v<Row>;

template <typename T, typename Row>
T LoadToEncode(Row* p) {
  if constexpr (kDecodes<Row>) {
    return T{};
  } else {
    return Load<T>(p);
  }
}

bool IsColour(std::span<const VertexAttribute> a) {
  static constexpr const char* kNames[] = {"red", "green", "blue"};
  for (size_t i = 0; i < 3; ++i) {
    if (i >= a.size() || a[i].name != kNames[i] || a[i].type != ScalarType::kUint8) return false;
  }
  return true;
}

}  // namespace

AttributeCoder::AttributeCoder(const AttributeLayout& layout) {
  const std::span<const VertexAttribute> all = layout.attributes;
  size_t components = 0;
  for (size_t i = 0; i < all.size();) {
    const VertexAttribute& a = all[i];
    Channel channel;
    channel.type = a.type;
    channel.attribute = i;
    channel.offset = row_bytes_;
    channel.component = components;
    size_t attributes = 1;
    if (a.normal_bits > 0) {
      channel.kind = Kind::kNormal;
      channel.normal_bits = a.normal_bits;
      attributes = 3;
      components += 2;
    } else if (IsColour(all.subspan(i))) {
      channel.kind = Kind::kColour;
      attributes = 3;
      components += 3;
    } else {
      if (a.step > 0) channel.kind = Kind::kStepped;
      channel.step = a.step;
      components += 1;
    }
    channels_.push_back(channel);
    for (; attributes > 0; --attributes) row_bytes_ += ScalarSize(all[i++].type);
  }
  components_.resize(components);
}

template <typename Coder>
uint64_t AttributeCoder::CodeWord(Coder& coder, Component& models, uint64_t spread,
                                  Context& context, uint64_t zigzag) {
  const auto width = static_cast<uint32_t>(std::bit_width(spread));
  const uint32_t spread_class = width < 8 ? width : std::min(15u, 8 + (width - 8) / 4);
  auto left = static_cast<uint32_t>(std::bit_width(zigzag));
  uint32_t length =
      coder.Symbol(models.length[context.previous][spread_class], std::min(left, 15u));
  bool more = length == 15;
  for (size_t i = 0; more && i < kMoreLengths; ++i) {
    left -= 15;
    const uint32_t s = coder.Symbol(models.more[i], std::min(left, 15u));
    length += s;
    more = s == 15;
  }
  length = std::min(length, 64u);
  context.previous = length + 1 < width ? 1 : length <= width ? 2 : 3;
  if (length <= 1) return length;
  // The two bits below the top one have models, since short differences are likelier.
  auto low = static_cast<int>(length) - 1;
  uint64_t word = 1;
  for (int i = 0; i < 2 && low > 0; ++i) {
    --low;
    AdaptiveBit& model = models.top[length][word - 1];
    word = word << 1 | (coder.Bit(model, zigzag >> low & 1) ? 1 : 0);
  }
  for (; low > 32; low -= 32) {
    word = word << 32 | coder.Raw(32, static_cast<uint32_t>(zigzag >> (low - 32)));
  }
  const uint64_t mask = (uint64_t{1} << low) - 1;
  return word << low | coder.Raw(low, static_cast<uint32_t>(zigzag & mask));
}

template <typename T, typename Coder, typename Row>
void AttributeCoder::CodeScalar(Coder& coder, const Channel& channel,
                                std::span<const uint32_t> ring, const Bytes& rows, Row* row,
                                Context& context) {
  using Word = decltype(ToWord(T{}));
  const Word mean = ToWord(MeanOfRing<T>(ring, rows, row_bytes_, channel.offset));
  // Signed integers have their words in two ascending halves.
  constexpr Word kFlip = std::is_signed_v<T> && !std::is_floating_point_v<T>
                             ? static_cast<Word>(Word{1} << (sizeof(Word) * 8 - 1))
                             : Word{0};
  Spread spread;
  for (const uint32_t v : ring) {
    const Word word = ToWord(Load<T>(rows.data() + v * row_bytes_ + channel.offset));
    spread.Add(Distance(uint64_t{static_cast<Word>(word ^ kFlip)},
                        uint64_t{static_cast<Word>(mean ^ kFlip)}));
  }
  const Word actual = ToWord(LoadToEncode<T>(row));
  const auto zigzag =
      static_cast<Word>(CodeWord(coder, components_[channel.component], spread.Mean(ring.size()),
                                 context, ZigZag(static_cast<Word>(actual - mean))));
  if constexpr (kDecodes<Row>) {
    const T value = FromWord<T>(static_cast<Word>(mean + UnZigZag(zigzag)));
    std::memcpy(row, &value, sizeof(T));
  }
}

template <typename T, typename Coder, typename Row>
void AttributeCoder::CodeStepped(Coder& coder, const Channel& channel,
                                 std::span<const uint32_t> ring, const Bytes& rows, Row* row,
                                 Context& context) {
  const auto code_of = [&](uint32_t v) {
    return ScalarCode(Load<T>(rows.data() + v * row_bytes_ + channel.offset), channel.step);
  };
  int64_t sum = 0;  // of codes below 2^52
  for (const uint32_t v : ring) sum += code_of(v);
  const int64_t mean = FloorMean(sum, ring.size());
  Spread spread;
  for (const uint32_t v : ring) spread.Add(Distance(code_of(v), mean));
  const int64_t actual = ScalarCode(LoadToEncode<T>(row), channel.step);
  const uint64_t zigzag =
      CodeWord(coder, components_[channel.component], spread.Mean(ring.size()), context,
               ZigZag(static_cast<uint64_t>(actual) - static_cast<uint64_t>(mean)));
  if constexpr (kDecodes<Row>) {
    const auto code = static_cast<int64_t>(static_cast<uint64_t>(mean) + UnZigZag(zigzag));
    T value;
    if constexpr (sizeof(T) == sizeof(float)) {
      value = Float32OfCode(code, channel.step);
    } else {
      value = Float64OfCode(code, channel.step);
    }
    std::memcpy(row, &value, sizeof(T));
  }
}

// Long, since the one description of a normal serves writer and reader step by step.
template <typename Coder, typename Row>
void AttributeCoder::CodeNormal(Coder& coder, const Channel& channel, const Star& star,
                                const Bytes& rows, Row* row, Context& context) {
  const int bits = channel.normal_bits;
  const int32_t centre = OctahedralCentre(bits);
  const std::span<const uint32_t> ring = star.ring;
  const auto normal_at = [](const std::byte* p) {
    return Vec3d{Load<float>(p), Load<float>(p + 4), Load<float>(p + 8)};
  };
  const auto ring_normal = [&](uint32_t v) {
    return normal_at(rows.data() + v * row_bytes_ + channel.offset);
  };
  Vec3d sum{0, 0, 0};
  for (const uint32_t v : ring) sum = sum + ring_normal(v);
  const Vec3d of_ring = Unit(sum);
  const Vec3d of_star = StarNormal(star);
  const std::array<Vec3d, kPredictions> predictions{of_ring, of_star, of_ring + of_star};
  const auto best =
      static_cast<size_t>(std::min_element(costs_.begin(), costs_.end()) - costs_.begin());

  OctahedralCode mean = EncodeOctahedral(predictions[best], bits);
  // In the half around z = 1 neighbours of a normal are neighbours in the square.
  const bool mirrored = std::abs(mean.s) + std::abs(mean.t) > centre;
  if (mirrored) mean = Mirror(mean, centre);
  const auto difference = [&](OctahedralCode code, OctahedralCode from) {
    return OctahedralCode{WrapCentred(code.s - from.s, centre),
                          WrapCentred(code.t - from.t, centre)};
  };
  const auto code_of = [&](const Vec3d& normal) {
    const OctahedralCode code = EncodeOctahedral(normal, bits);
    return mirrored ? Mirror(code, centre) : code;
  };
  const auto length = [](OctahedralCode d) {
    return static_cast<uint32_t>(std::abs(d.s) + std::abs(d.t));
  };
  Spread spread;
  for (const uint32_t v : ring) spread.Add(length(difference(code_of(ring_normal(v)), mean)));
  OctahedralCode residual;
  if constexpr (!kDecodes<Row>) residual = difference(code_of(normal_at(row)), mean);
  const auto code_component = [&](size_t i, int32_t d) {
    const uint64_t z =
        CodeWord(coder, components_[channel.component + i], spread.Mean(2 * ring.size()), context,
                 ZigZag(static_cast<uint32_t>(d)));
    // Hostile ones are clamped; others lie in the range.
    return std::clamp(static_cast<int32_t>(UnZigZag(static_cast<uint32_t>(z))), -centre, centre);
  };
  residual.s = code_component(0, residual.s);
  residual.t = code_component(1, residual.t);
  const OctahedralCode code{WrapCentred(mean.s + residual.s, centre),
                            WrapCentred(mean.t + residual.t, centre)};
  for (size_t i = 0; i < kPredictions; ++i) {
    const uint32_t cost =
        i == best ? length(residual) : length(difference(code, code_of(predictions[i])));
    costs_[i] = costs_[i] - (costs_[i] >> 4) + std::min(cost, 1u << 18);
  }
  if constexpr (kDecodes<Row>) {
    const Vec3d normal = DecodeOctahedral(mirrored ? Mirror(code, centre) : code, bits);
    for (int i = 0; i < 3; ++i) {
      const auto c = static_cast<float>(normal[i]);
      std::memcpy(row + sizeof(float) * static_cast<size_t>(i), &c, sizeof(float));
    }
  }
}

template <typename Coder, typename Row>
void AttributeCoder::CodeColour(Coder& coder, const Channel& channel,
                                std::span<const uint32_t> ring, const Bytes& rows, Row* row,
                                Context& context) {
  // Green, and red and blue minus green.
  const auto components_of = [](const std::byte* p) {
    const auto r = static_cast<int64_t>(p[0]);
    const auto g = static_cast<int64_t>(p[1]);
    const auto b = static_cast<int64_t>(p[2]);
    return std::array<int64_t, 3>{g, r - g, b - g};
  };
  std::array<int64_t, 3> mean{};
  for (const uint32_t v : ring) {
    const auto c = components_of(rows.data() + v * row_bytes_ + channel.offset);
    for (size_t i = 0; i < 3; ++i) mean[i] += c[i];
  }
  for (int64_t& m : mean) m = FloorMean(m, ring.size());
  std::array<Spread, 3> spread;
  for (const uint32_t v : ring) {
    const auto c = components_of(rows.data() + v * row_bytes_ + channel.offset);
    for (size_t i = 0; i < 3; ++i) spread[i].Add(Distance(c[i], mean[i]));
  }
  std::array<int64_t, 3> actual{};
  if constexpr (!kDecodes<Row>) actual = components_of(row);
  std::array<uint8_t, 3> decoded{};
  for (size_t i = 0; i < 3; ++i) {
    const uint64_t zigzag =
        CodeWord(coder, components_[channel.component + i], spread[i].Mean(ring.size()), context,
                 ZigZag(static_cast<uint8_t>(actual[i] - mean[i])));
    decoded[i] = static_cast<uint8_t>(static_cast<uint8_t>(mean[i]) +
                                      UnZigZag(static_cast<uint8_t>(zigzag)));
  }
  if constexpr (kDecodes<Row>) {
    row[0] = static_cast<std::byte>(decoded[0] + decoded[1]);
    row[1] = static_cast<std::byte>(decoded[0]);
    row[2] = static_cast<std::byte>(decoded[0] + decoded[2]);
  }
}

template <typename Coder, typename Row>
void AttributeCoder::CodeChannel(Coder& coder, const Channel& channel, const Star& star,
                                 const Bytes& rows, Row* row, Context& context) {
  const std::span<const uint32_t> ring = star.ring;
  const auto scalar = [&]<typename T>(T) {
    if constexpr (std::is_floating_point_v<T>) {
      if (channel.kind == Kind::kStepped) {
        CodeStepped<T>(coder, channel, ring, rows, row, context);
        return;
      }
    }
    CodeScalar<T>(coder, channel, ring, rows, row, context);
  };
  if (channel.kind == Kind::kNormal) {
    CodeNormal(coder, channel, star, rows, row, context);
    return;
  }
  if (channel.kind == Kind::kColour) {
    CodeColour(coder, channel, ring, rows, row, context);
    return;
  }
  switch (channel.type) {
    case ScalarType::kInt8: scalar(int8_t{}); break;
    case ScalarType::kUint8: scalar(uint8_t{}); break;
    case ScalarType::kInt16: scalar(int16_t{}); break;
    case ScalarType::kUint16: scalar(uint16_t{}); break;
    case ScalarType::kInt32: scalar(int32_t{}); break;
    case ScalarType::kUint32: scalar(uint32_t{}); break;
    case ScalarType::kFloat32: scalar(float{}); break;
    case ScalarType::kFloat64: scalar(double{}); break;
  }
}

void AttributeCoder::Encode(RansEncoder& coder, const Star& star, const Bytes& rows,
                            const std::byte* row, ModelObserver* observer) {
  Context context;
  for (const Channel& channel : channels_) {
    const size_t before = coder.decisions();
    CodeChannel(coder, channel, star, rows, row + channel.offset, context);
    if (observer != nullptr) observer->SawAttribute(channel.attribute, coder.BitsSince(before));
  }
}

void AttributeCoder::Decode(RansDecoder<>& decoder, const Star& star, const Bytes& rows,
                            std::byte* row) {
  Context context;
  auto coder = decoder.lane();
  for (const Channel& channel : channels_) {
    CodeChannel(coder, channel, star, rows, row + channel.offset, context);
  }
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
