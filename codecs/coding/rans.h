// SPDX-License-Identifier: Apache-2.0
// The entropy coder: adaptive models of bits and of 16 symbols, coded by a range variant of
// asymmetric numeral systems (J. Duda, "Asymmetric numeral systems", 2013; F. Giesen, "Interleaved
// entropy coders", 2014; adaptive 16-symbol models as in F. Giesen's "rANS notes"). Specified in
// codecs/FORMAT.md.
//
// Encoder and decoder have the same member functions, so that one template writes a stream and
// reads it: each takes the value to code and returns the coded one; the decoder ignores the former.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <memory>
#include <type_traits>
#include <vector>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

#include "store/base/bytes.h"

namespace mtdb {

inline constexpr int kProbabilityBits = 15;
inline constexpr uint32_t kProbabilityOne = 1u << kProbabilityBits;

// The probability of a one, in 1/65536; never 0.
struct AdaptiveBit {
  static constexpr int kBits = 16;
  static constexpr uint32_t kOne = 1u << kBits;
  static constexpr int kRate = 6;
  uint16_t probability = 0x8000;

  // Towards 0xffff or 2^kRate - 1, so that neither value becomes impossible. Without a branch: bits
  // that are hard to predict are what an entropy coder sees.
  // `mask`: 0 for no update at all.
  void Update(bool bit, uint32_t mask = ~0u) {
    const int32_t target = (0xffff & -static_cast<int32_t>(bit)) | ((1 << kRate) - 1);
    const auto step = static_cast<uint32_t>((target - probability) >> kRate);
    probability = static_cast<uint16_t>(probability + (step & mask));
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

// The cumulative distribution of symbols 0..15: symbol s has the interval [below[s], below[s + 1]).
// Never empty, whatever the updates.
template <int kRate>
struct AdaptiveSymbolOfRate {
  static constexpr uint32_t kSymbols = 16;
  std::array<int16_t, 17> below = {0,
                                   2048,
                                   4096,
                                   6144,
                                   8192,
                                   10240,
                                   12288,
                                   14336,
                                   16384,
                                   18432,
                                   20480,
                                   22528,
                                   24576,
                                   26624,
                                   28672,
                                   30720,
                                   static_cast<int16_t>(kProbabilityOne)};

  uint32_t begin(uint32_t s) const { return static_cast<uint16_t>(below[s]); }
  uint32_t end(uint32_t s) const { return static_cast<uint16_t>(below[s + 1]); }
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

// Sees what an encoder codes, for statistics and for fitting priors.
class ModelObserver {
 public:
  virtual ~ModelObserver() = default;
  virtual void Saw(const AdaptiveBit& model, bool bit) = 0;
  virtual void Saw(const AdaptiveSymbol& model, uint32_t symbol) = 0;
  // What a vertex takes for the channel whose first attribute is this one of the layout.
  virtual void SawAttribute(size_t attribute, double bits) = 0;
};

inline constexpr uint64_t kRansLow = uint64_t{1} << 31;

// Several coders' states take part in one stream (lanes), so that a decoder can work on decisions
// that do not depend on each other at the same time.
inline constexpr size_t kMaxRansLanes = 4;

// Collects what is to be coded; Finish() codes it backwards.
class RansEncoder {
 public:
  // `observer`, when given, sees every decision.
  explicit RansEncoder(ModelObserver* observer = nullptr) : observer_(observer) {}

  bool Bit(AdaptiveBit& model, bool bit) {
    const uint32_t one = model.probability;
    if (observer_ != nullptr) observer_->Saw(model, bit);
    Add(bit ? 0 : one, bit ? one : AdaptiveBit::kOne - one, AdaptiveBit::kBits);
    model.Update(bit);
    return bit;
  }
  template <typename Model>
  uint32_t Symbol(Model& model, uint32_t s) {
    if constexpr (std::is_same_v<Model, AdaptiveSymbol>) {
      if (observer_ != nullptr) observer_->Saw(model, s);
    }
    Add(model.begin(s), model.end(s) - model.begin(s), kProbabilityBits);
    model.Update(s);
    return s;
  }
  // `count` <= 32 bits without a model.
  uint32_t Raw(int count, uint32_t bits) {
    uint32_t rest = bits;
    for (int left = count; left > 0; left -= 16) {
      const int n = left < 16 ? left : 16;
      log_.Append(
          {static_cast<uint16_t>(rest & ((1u << n) - 1)), 1, static_cast<uint8_t>(n), lane_});
      rest >>= 16;
    }
    return bits;
  }
  // Codes on another lane from now on.
  RansEncoder& lane(size_t lane) {
    lane_ = static_cast<uint8_t>(lane);
    return *this;
  }
  // For statistics: how many were collected, and what those from one on will take.
  size_t decisions() const { return log_.size(); }
  double BitsSince(size_t decision) const;
  // Forgets what was collected. Nothing, when nothing was.
  Bytes Finish(size_t lanes = 1);

 private:
  // An interval of a distribution over 2^bits; of one of 2^bits equal ones, when it is raw.
  struct Entry {
    uint16_t begin;
    uint16_t size;
    uint8_t bits;
    uint8_t lane;
  };
  void Add(uint32_t begin, uint32_t size, int bits) {
    log_.Append({static_cast<uint16_t>(begin), static_cast<uint16_t>(size),
                 static_cast<uint8_t>(bits), lane_});
  }
  // Entries in chunks: a log grows to many times its stream, and must not be there twice while it
  // does.
  class Log {
   public:
    [[gnu::always_inline]] void Append(Entry entry) {
      if (left_ == 0) [[unlikely]]
        AddChunk();
      *next_++ = entry;
      --left_;
    }
    size_t size() const { return chunks_.size() * kChunk - left_; }
    bool empty() const { return chunks_.empty(); }
    Entry operator[](size_t i) const { return chunks_[i / kChunk][i % kChunk]; }
    void clear() {
      chunks_.clear();
      left_ = 0;
    }

   private:
    static constexpr size_t kChunk = 4096;
    [[gnu::noinline]] void AddChunk() {
      chunks_.push_back(std::make_unique_for_overwrite<Entry[]>(kChunk));
      next_ = chunks_.back().get();
      left_ = kChunk;
    }
    std::vector<std::unique_ptr<Entry[]>> chunks_;
    Entry* next_ = nullptr;
    size_t left_ = 0;  // places in the last chunk
  };
  ModelObserver* observer_;
  Log log_;
  uint8_t lane_ = 0;
};

// Decodes untrusted bytes: behind their end come zeros, and Done() tells.
template <size_t kLanes = 1>
class RansDecoder {
 public:
  explicit RansDecoder(ByteSpan bytes) : next_(bytes.data()), end_(bytes.data() + bytes.size()) {
    state_.fill(kRansLow);
    if (bytes.empty()) return;
    for (uint64_t& state : state_) {
      state = static_cast<uint64_t>(Word()) << 32;
      state |= Word();
      overrun_ |= state < kRansLow;
    }
  }

  // One of the states as a coder.
  template <size_t kLane>
  class Lane {
   public:
    explicit Lane(RansDecoder& decoder) : d_(decoder) {}
    // With a branch, since who asks will branch on it: a processor that guesses it has the next
    // state early.
    [[gnu::always_inline]] bool Bit(AdaptiveBit& model, bool = false) { return BitIf(true, model); }
    // A bit that is zero and not coded unless it is `possible`. One branch in all, where two would
    // both be hard to predict: a zero that is certain leaves the state as it is.
    [[gnu::always_inline]] bool BitIf(bool possible, AdaptiveBit& model, bool = false) {
      constexpr int kBits = AdaptiveBit::kBits;
      const uint32_t mask = 0u - static_cast<uint32_t>(possible);
      const uint32_t one = model.probability & mask;
      const uint32_t at = static_cast<uint32_t>(state()) & (AdaptiveBit::kOne - 1);
      if (at < one) {
        Take<kBits>(0, one, at);
        model.Update(true);
        return true;
      }
      Take<kBits>(one, AdaptiveBit::kOne - one, at);
      model.Update(false, mask);
      return false;
    }
    template <typename Model>
    [[gnu::always_inline]] uint32_t Symbol(Model& model, uint32_t = 0) {
      const uint32_t at = static_cast<uint32_t>(state()) & (kProbabilityOne - 1);
      const uint32_t s = model.Find(at);
      const uint32_t begin = model.begin(s);
      Take<kProbabilityBits>(begin, model.end(s) - begin, at);
      model.Update(s);
      return s;
    }
    uint32_t Raw(int count, uint32_t = 0) {
      if (count <= 16) return RawBits(count);
      const uint32_t low = RawBits(16);
      return low | RawBits(count - 16) << 16;
    }
    bool overrun() const { return d_.overrun(); }

   private:
    uint64_t& state() { return d_.state_[kLane]; }
    uint32_t RawBits(int count) {
      const uint32_t bits = static_cast<uint32_t>(state()) & ((1u << count) - 1);
      state() >>= count;
      Refill();
      return bits;
    }
    template <int kBits>
    [[gnu::always_inline]] void Take(uint32_t begin, uint32_t size, uint32_t at) {
      state() = size * (state() >> kBits) + at - begin;
      Refill();
    }
    [[gnu::always_inline]] void Refill() {
      if (state() >= kRansLow) [[likely]]
        return;
      state() = state() << 32 | d_.Word();
    }
    RansDecoder& d_;
  };
  template <size_t kLane = 0>
  [[gnu::always_inline]] Lane<kLane> lane() {
    static_assert(kLane < kLanes);
    return Lane<kLane>(*this);
  }

  // True when everything was read and the decoder is back where the encoder began.
  bool Done() const { return AtEnd() && next_ == end_; }
  // Likewise, but for zeros behind what the encoder wrote.
  bool DoneBeforeZeros() const {
    return AtEnd() && std::all_of(next_, end_, [](std::byte b) { return b == std::byte{0}; });
  }
  // It has read beyond the end, or began where no encoder ends: no use to go on.
  bool overrun() const { return overrun_; }

 private:
  bool AtEnd() const {
    return !overrun_ && std::all_of(state_.begin(), state_.end(),
                                    [](uint64_t state) { return state == kRansLow; });
  }
  uint32_t Word() {
    uint32_t word = 0;
    if (end_ - next_ >= 4) [[likely]] {
      std::memcpy(&word, next_, 4);
      next_ += 4;
    } else {
      overrun_ = true;
    }
    return word;
  }

  std::array<uint64_t, kLanes> state_;
  const std::byte* next_;
  const std::byte* end_;
  bool overrun_ = false;
};

}  // namespace mtdb
