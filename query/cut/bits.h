// SPDX-License-Identifier: Apache-2.0
// Bits: a fixed number of flags, packed.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <span>
#include <vector>

#include "store/base/ids.h"

namespace mtdb::internal {

// In line: without -mpopcnt std::popcount is a call.
constexpr uint32_t PopCount(uint64_t bits) {
  bits -= (bits >> 1) & 0x5555555555555555u;
  bits = (bits & 0x3333333333333333u) + ((bits >> 2) & 0x3333333333333333u);
  bits = (bits + (bits >> 4)) & 0x0f0f0f0f0f0f0f0fu;
  return static_cast<uint32_t>((bits * 0x0101010101010101u) >> 56);
}

// The `count` (at most 64) flags from `first` on.
inline uint64_t BitsAt(std::span<const uint64_t> words, uint32_t first, uint32_t count) {
  const uint32_t shift = first & 63;
  uint64_t bits = words[first >> 6] >> shift;
  if (shift + count > 64) bits |= words[(first >> 6) + 1] << (64 - shift);
  return bits & (~uint64_t{0} >> (64 - count));
}

class Bits {
 public:
  Bits() = default;
  explicit Bits(uint32_t size) : words_((size + 63) / 64, 0) {}

  // The number of flags, rounded up to whole words.
  uint32_t size() const { return static_cast<uint32_t>(words_.size() * 64); }
  bool empty() const { return words_.empty(); }
  std::span<const uint64_t> words() const { return words_; }

  bool Test(uint32_t i) const { return (words_[i >> 6] >> (i & 63)) & 1; }
  void Set(uint32_t i) { words_[i >> 6] |= uint64_t{1} << (i & 63); }
  void Clear(uint32_t i) { words_[i >> 6] &= ~(uint64_t{1} << (i & 63)); }
  void Put(uint32_t i, bool flag) { flag ? Set(i) : Clear(i); }
  // Clears the flag unless `keep`.
  void Keep(uint32_t i, bool keep) { words_[i >> 6] &= ~(uint64_t{!keep} << (i & 63)); }
  // 64 flags from bytes that are 0 or 1.
  static uint64_t PackWord(const uint8_t* bytes) {
    uint64_t word = 0;
    for (int i = 0; i < 64; i += 8, bytes += 8) {
      uint64_t eight = 0;
      for (int b = 0; b < 8; ++b) eight |= uint64_t{bytes[b]} << (8 * b);
      word |= (eight * 0x0102040810204080u >> 56) << i;
    }
    return word;
  }
  // Takes all flags from such bytes, size() of them.
  void Pack(const uint8_t* bytes) {
    for (uint64_t& word : words_) {
      word = PackWord(bytes);
      bytes += 64;
    }
  }
  void ClearAll() { std::fill(words_.begin(), words_.end(), 0); }
  // Sets the flags that are set in both, which are as long; returns their number.
  uint32_t AddBoth(std::span<const uint64_t> a, std::span<const uint64_t> b) {
    uint32_t n = 0;
    for (size_t w = 0; w < words_.size(); ++w) {
      words_[w] |= a[w] & b[w];
      n += PopCount(a[w] & b[w]);
    }
    return n;
  }
  // The number of flags that are set in both.
  uint32_t CountBoth(std::span<const uint64_t> other) const {
    uint32_t n = 0;
    for (size_t w = 0; w < words_.size(); ++w) n += PopCount(words_[w] & other[w]);
    return n;
  }
  // Clears the flags that are set in `other`, which is as long.
  void RemoveAll(std::span<const uint64_t> other) {
    for (size_t w = 0; w < words_.size(); ++w) words_[w] &= ~other[w];
  }
  // The number of flags that are set here and not in `other`, which is as long.
  uint32_t CountWithout(std::span<const uint64_t> other) const {
    uint32_t n = 0;
    for (size_t w = 0; w < words_.size(); ++w) n += PopCount(words_[w] & ~other[w]);
    return n;
  }
  void ClearRange(uint32_t begin, uint32_t end) {
    for (uint32_t i = begin; i < end;) {
      const uint32_t n = std::min(end - i, 64 - (i & 63));
      words_[i >> 6] &= ~((~uint64_t{0} >> (64 - n)) << (i & 63));
      i += n;
    }
  }
  uint32_t CountRange(uint32_t begin, uint32_t end) const {
    uint32_t count = 0;
    for (uint32_t i = begin; i < end;) {
      const uint32_t n = std::min(end - i, 64 - (i & 63));
      count += PopCount(words_[i >> 6] >> (i & 63) & (~uint64_t{0} >> (64 - n)));
      i += n;
    }
    return count;
  }
  void SetRange(uint32_t begin, uint32_t end) {
    for (uint32_t i = begin; i < end;) {
      const uint32_t n = std::min(end - i, 64 - (i & 63));
      words_[i >> 6] |= (~uint64_t{0} >> (64 - n)) << (i & 63);
      i += n;
    }
  }
  // The first set flag at or after `i`, or kNone32.
  uint32_t FirstFrom(uint32_t i) const {
    uint32_t w = i >> 6;
    if (w >= words_.size()) return kNone32;
    uint64_t rest = words_[w] & (~uint64_t{0} << (i & 63));
    while (rest == 0) {
      if (++w == words_.size()) return kNone32;
      rest = words_[w];
    }
    return w * 64 + static_cast<uint32_t>(std::countr_zero(rest));
  }
  uint32_t Count() const {
    uint32_t n = 0;
    for (const uint64_t w : words_) n += PopCount(w);
    return n;
  }
  // The number of set flags before each word, for Rank.
  std::vector<uint32_t> Ranks() const {
    std::vector<uint32_t> ranks;
    ranks.reserve(words_.size());
    uint32_t n = 0;
    for (const uint64_t w : words_) {
      ranks.push_back(n);
      n += PopCount(w);
    }
    return ranks;
  }
  // Calls f(i) for each set flag, ascending.
  template <typename F>
  void ForEach(F&& f) const {
    ForEachWithout({}, f);
  }
  // Likewise for those that are not set in `other`, which is as long or empty.
  template <typename F>
  void ForEachWithout(std::span<const uint64_t> other, F&& f) const {
    for (uint32_t w = 0; w < words_.size(); ++w) {
      uint64_t rest = words_[w];
      if (!other.empty()) rest &= ~other[w];
      for (; rest != 0; rest &= rest - 1) {
        f(w * 64 + static_cast<uint32_t>(std::countr_zero(rest)));
      }
    }
  }

 private:
  std::vector<uint64_t> words_;
};

// Of 64 values: those of which `is` says so, as bits.
template <typename T, typename Is>
uint64_t BitsWhere(const T* values, Is&& is) {
  std::array<uint8_t, 64> flags;
  for (size_t i = 0; i < 64; ++i) flags[i] = is(values[i]) ? 1 : 0;
  return Bits::PackWord(flags.data());
}

}  // namespace mtdb::internal
