// SPDX-License-Identifier: Apache-2.0
// Attribute rows: prediction from the ring of a hole, and coding of the residuals
// (codecs/FORMAT.md). Integer arithmetic, or IEEE operations that are correctly rounded, so that
// every machine predicts alike.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

#include "codecs/coding/rans.h"
#include "store/base/attributes.h"
#include "store/base/bytes.h"
#include "store/base/geometry.h"

namespace mtdb {

// 0, -1, 1, -2, ... modulo the word as 0, 1, 2, 3, ..., and back.
template <typename Word>
requires std::is_unsigned_v<Word>
constexpr Word ZigZag(Word d) {
  constexpr int kTop = sizeof(Word) * 8 - 1;
  return static_cast<Word>(static_cast<Word>(d << 1) ^
                           static_cast<Word>((d >> kTop) ? ~Word{0} : 0));
}
template <typename Word>
requires std::is_unsigned_v<Word>
constexpr Word UnZigZag(Word z) {
  return static_cast<Word>(static_cast<Word>(z >> 1) ^ static_cast<Word>((z & 1) ? ~Word{0} : 0));
}

// Codes rows channel by channel: the difference to the mean of the ring's values, modulo the
// channel's range, as its length in bits and the bits themselves. A channel is an attribute, a
// normal on the octahedron (two components), or a colour (green, then red and blue by how they
// differ from it). The layout must be valid (IsValidLayout).
class AttributeCoder {
 public:
  // A node's star: the vertex, and the ring of those around it.
  struct Star {
    Vec3i position;
    std::span<const uint32_t> ring;
    std::span<const Vec3i> ring_positions;
  };
  explicit AttributeCoder(const AttributeLayout& layout);
  size_t row_bytes() const { return row_bytes_; }
  // Codes the row at `row` (encoding: read, decoding: written). `observer`, when given, sees the
  // bits of each channel.
  void Encode(RansEncoder& coder, const Star& star, const Bytes& rows, const std::byte* row,
              ModelObserver* observer = nullptr);
  void Decode(RansDecoder<>& coder, const Star& star, const Bytes& rows, std::byte* row);

 private:
  static constexpr size_t kSpreads = 16;    // classes of how far the ring's values lie apart
  static constexpr size_t kPreviouses = 4;  // classes of the residual before in the row
  static constexpr size_t kMoreLengths = 4;
  // The models of one component's residuals.
  struct Component {
    std::array<std::array<FastAdaptiveSymbol, kSpreads>, kPreviouses> length;
    std::array<FastAdaptiveSymbol, kMoreLengths> more;  // after 15, and 15 again
    std::array<std::array<AdaptiveBit, 3>, 65> top;
  };
  enum class Kind : uint8_t { kScalar, kStepped, kNormal, kColour };
  struct Channel {
    Kind kind = Kind::kScalar;
    ScalarType type = ScalarType::kFloat32;
    uint8_t normal_bits = 0;
    double step = 0;
    size_t attribute = 0;  // the first one of the layout
    size_t offset = 0;     // in the row
    size_t component = 0;  // the first one
  };
  // What a row's values have told so far: the class of the residual before.
  struct Context {
    uint32_t previous = 0;
  };

  template <typename Coder>
  static uint64_t CodeWord(Coder& coder, Component& models, uint64_t spread, Context& context,
                           uint64_t zigzag);
  template <typename Coder, typename Row>
  void CodeChannel(Coder& coder, const Channel& channel, const Star& star, const Bytes& rows,
                   Row* row, Context& context);
  template <typename T, typename Coder, typename Row>
  void CodeScalar(Coder& coder, const Channel& channel, std::span<const uint32_t> ring,
                  const Bytes& rows, Row* row, Context& context);
  template <typename T, typename Coder, typename Row>
  void CodeStepped(Coder& coder, const Channel& channel, std::span<const uint32_t> ring,
                   const Bytes& rows, Row* row, Context& context);
  template <typename Coder, typename Row>
  void CodeNormal(Coder& coder, const Channel& channel, const Star& star, const Bytes& rows,
                  Row* row, Context& context);
  template <typename Coder, typename Row>
  void CodeColour(Coder& coder, const Channel& channel, std::span<const uint32_t> ring,
                  const Bytes& rows, Row* row, Context& context);

  // What a normal can be predicted from: the ring's normals, the star's own, both.
  static constexpr size_t kPredictions = 3;
  std::vector<Channel> channels_;
  std::array<uint32_t, kPredictions> costs_{};  // of late
  std::vector<Component> components_;
  size_t row_bytes_ = 0;
};

// Byte planes: rows of n records of `row_bytes` bytes <-> all first bytes, all second bytes, ...
Bytes SplitPlanes(ByteSpan rows, size_t row_bytes);
Bytes JoinPlanes(ByteSpan planes, size_t row_bytes);

}  // namespace mtdb
