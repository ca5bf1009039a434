// The entropy coder: adaptive models of bits and of 16 symbols, coded by a range variant of
// asymmetric numeral systems (J. Duda, "Asymmetric numeral systems", 2013; F. Giesen, "Interleaved
// entropy coders", 2014; adaptive 16-symbol models as in F. Giesen's "rANS notes"). Specified in
// codecs/FORMAT.md.
//
// Encoder and decoder have the same member functions, so that one template writes a stream and
// reads it: each takes the value to code and returns the coded one; the decoder ignores the former.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <vector>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

#include "store/base/bytes.h"

namespace mtdb {

inline constexpr int kProbabilityBits = 15;
inline constexpr uint32_t kProbabilityOne = 1u << kProbabilityBits;

// The probability of a one, in 1/65536.
struct AdaptiveBit {
  static constexpr int kRate = 6;
  uint16_t probability = 0x8000;

  // In 1 .. kProbabilityOne - 1.
  uint32_t one() const { return probability >> 1; }
  // Towards 0xffff or 2^kRate - 1, so that neither value becomes impossible. Without a branch: bits
  // that are hard to predict are what an entropy coder sees.
  void Update(bool bit) {
    const int32_t target = (0xffff & -static_cast<int32_t>(bit)) | ((1 << kRate) - 1);
    probability = static_cast<uint16_t>(probability + ((target - probability) >> kRate));
  }
};

// The targets that an update moves towards: nearly all probability on one symbol, and 1 /
// kProbabilityOne on each other, so that no interval ever vanishes.
inline constexpr auto kSymbolTargets = [] {
  std::array<std::array<int16_t, 16>, 16> t{};
  for (size_t s = 0; s < 16; ++s) {
    for (size_t i = 0; i < 16; ++i) {
      t[s][i] = static_cast<int16_t>(i <= s ? i : kProbabilityOne - 16 + i);
    }
  }
  return t;
}();

// The cumulative distribution of symbols 0..15: symbol s has the interval [below[s], below[s + 1]),
// where below[16] stands for kProbabilityOne. Never empty, whatever the updates.
template <int kRate>
struct AdaptiveSymbolOfRate {
  static constexpr uint32_t kSymbols = 16;
  std::array<int16_t, 16> below = {0,     2048,  4096,  6144,  8192,  10240, 12288, 14336,
                                   16384, 18432, 20480, 22528, 24576, 26624, 28672, 30720};

  uint32_t begin(uint32_t s) const { return static_cast<uint32_t>(below[s]); }
  uint32_t end(uint32_t s) const {
    return s + 1 == kSymbols ? kProbabilityOne : static_cast<uint32_t>(below[s + 1]);
  }
#ifdef __SSE2__
  // The symbol whose interval holds `at`.
  uint32_t Find(uint32_t at) const {
    const __m128i value = _mm_set1_epi16(static_cast<int16_t>(at));
    const __m128i above =
        _mm_packs_epi16(_mm_cmpgt_epi16(Lanes(0), value), _mm_cmpgt_epi16(Lanes(8), value));
    const auto mask = static_cast<uint32_t>(_mm_movemask_epi8(above)) | 0x10000u;
    return static_cast<uint32_t>(std::countr_zero(mask)) - 1;
  }
  void Update(uint32_t s) {
    for (const size_t half : {0, 8}) {
      const auto* target = reinterpret_cast<const __m128i*>(kSymbolTargets[s].data() + half);
      const __m128i old = Lanes(half);
      const __m128i step = _mm_srai_epi16(_mm_sub_epi16(_mm_loadu_si128(target), old), kRate);
      _mm_storeu_si128(reinterpret_cast<__m128i*>(below.data() + half), _mm_add_epi16(old, step));
    }
  }

 private:
  __m128i Lanes(size_t first) const {
    return _mm_loadu_si128(reinterpret_cast<const __m128i*>(below.data() + first));
  }
#else
  uint32_t Find(uint32_t at) const {
    uint32_t s = kSymbols - 1;
    while (begin(s) > at) --s;
    return s;
  }
  void Update(uint32_t s) {
    for (size_t i = 0; i < kSymbols; ++i) {
      below[i] = static_cast<int16_t>(below[i] + ((kSymbolTargets[s][i] - below[i]) >> kRate));
    }
  }
#endif
};

using AdaptiveSymbol = AdaptiveSymbolOfRate<7>;      // with good priors
using FastAdaptiveSymbol = AdaptiveSymbolOfRate<5>;  // without

inline constexpr uint64_t kRansLow = uint64_t{1} << 31;

// Collects what is to be coded; Finish() codes it backwards.
class RansEncoder {
 public:
  bool Bit(AdaptiveBit& model, bool bit) {
    const uint32_t one = model.one();
    Add(bit ? 0 : one, bit ? one : kProbabilityOne - one);
    model.Update(bit);
    return bit;
  }
  template <typename Model>
  uint32_t Symbol(Model& model, uint32_t s) {
    Add(model.begin(s), model.end(s) - model.begin(s));
    model.Update(s);
    return s;
  }
  // `count` <= 32 bits without a model.
  uint32_t Raw(int count, uint32_t bits) {
    uint32_t rest = bits;
    for (int left = count; left > 0; left -= 16) {
      const int n = left < 16 ? left : 16;
      log_.push_back(
          {static_cast<uint16_t>(rest & ((1u << n) - 1)), static_cast<uint16_t>(kRawFlag | n)});
      rest >>= 16;
    }
    return bits;
  }
  bool empty() const { return log_.empty(); }
  // Forgets what was collected. Nothing, when nothing was.
  Bytes Finish();

 private:
  static constexpr uint16_t kRawFlag = 0x8000;
  struct Entry {
    uint16_t begin;  // or the raw bits
    uint16_t size;   // or kRawFlag | how many
  };
  void Add(uint32_t begin, uint32_t size) {
    log_.push_back({static_cast<uint16_t>(begin), static_cast<uint16_t>(size)});
  }
  std::vector<Entry> log_;
};

// Decodes untrusted bytes: behind their end come zeros, and Done() tells.
class RansDecoder {
 public:
  explicit RansDecoder(ByteSpan bytes) : next_(bytes.data()), end_(bytes.data() + bytes.size()) {
    if (bytes.empty()) return;
    state_ = static_cast<uint64_t>(Word()) << 32;
    state_ |= Word();
  }
  [[gnu::always_inline]] bool Bit(AdaptiveBit& model, bool = false) {
    const uint32_t one = model.one();
    const uint32_t at = static_cast<uint32_t>(state_) & (kProbabilityOne - 1);
    const bool bit = at < one;
    const uint32_t zero = static_cast<uint32_t>(bit) - 1;  // all ones when the bit is 0
    const uint32_t begin = one & zero;
    Take(begin, one + ((kProbabilityOne - 2 * one) & zero), at);
    model.Update(bit);
    return bit;
  }
  template <typename Model>
  [[gnu::always_inline]] uint32_t Symbol(Model& model, uint32_t = 0) {
    const uint32_t at = static_cast<uint32_t>(state_) & (kProbabilityOne - 1);
    const uint32_t s = model.Find(at);
    const uint32_t begin = model.begin(s);
    Take(begin, model.end(s) - begin, at);
    model.Update(s);
    return s;
  }
  [[gnu::always_inline]] uint32_t Raw(int count, uint32_t = 0) {
    if (count <= 16) return RawBits(count);
    const uint32_t low = RawBits(16);
    return low | RawBits(count - 16) << 16;
  }
  // True when everything was read and the decoder is back where the encoder began.
  bool Done() const { return !overrun_ && next_ == end_ && state_ == kRansLow; }
  // Reading beyond the end: no use to go on.
  bool overrun() const { return overrun_; }

 private:
  uint32_t RawBits(int count) {
    const uint32_t bits = static_cast<uint32_t>(state_) & ((1u << count) - 1);
    state_ >>= count;
    Refill();
    return bits;
  }
  void Take(uint32_t begin, uint32_t size, uint32_t at) {
    state_ = size * (state_ >> kProbabilityBits) + at - begin;
    Refill();
  }
  void Refill() {
    if (state_ < kRansLow) state_ = state_ << 32 | Word();
  }
  uint32_t Word() {
    uint32_t word = 0;
    if (end_ - next_ >= 4) {
      std::memcpy(&word, next_, 4);
      next_ += 4;
    } else {
      overrun_ = true;
    }
    return word;
  }

  uint64_t state_ = kRansLow;
  const std::byte* next_;
  const std::byte* end_;
  bool overrun_ = false;
};

// A non-negative number without a model: 6 bits of length, then the bits below the top one.
template <typename Coder>
uint64_t CodeRawNumber(Coder& coder, uint64_t value) {
  const int length = static_cast<int>(coder.Raw(6, static_cast<uint32_t>(std::bit_width(value))));
  if (length <= 1) return static_cast<uint64_t>(length);
  const int low = length - 1 < 32 ? length - 1 : 32;
  uint64_t bits = coder.Raw(low, static_cast<uint32_t>(value & ((uint64_t{1} << low) - 1)));
  if (length - 1 > 32) {
    const int high = length - 1 - 32;
    const auto top = static_cast<uint32_t>((value >> 32) & ((uint64_t{1} << high) - 1));
    bits |= static_cast<uint64_t>(coder.Raw(high, top)) << 32;
  }
  return bits | uint64_t{1} << (length - 1);
}

}  // namespace mtdb
