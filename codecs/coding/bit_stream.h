// SPDX-License-Identifier: Apache-2.0
// Bits without a model, low bits first: what an entropy coder could not make shorter. Reader and
// writer have the same member functions, as the coders of rans.h do.
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <utility>

#include "store/base/bytes.h"

namespace mtdb {

class BitWriter {
 public:
  // `count` <= 32.
  uint32_t Raw(int count, uint32_t bits) {
    pending_ |= static_cast<uint64_t>(bits) << used_;
    for (used_ += count; used_ >= 8; used_ -= 8, pending_ >>= 8) {
      bytes_.push_back(static_cast<std::byte>(pending_));
    }
    return bits;
  }
  // A number below `count`, all equally likely: the first ones in one bit less than the others.
  uint32_t Below(uint32_t count, uint32_t value) {
    const int bits = std::bit_width(count | 1) - 1;
    const uint32_t cheap = (2u << bits) - count;
    if (value < cheap) return Raw(bits, value);
    Raw(bits, (value + cheap) >> 1);
    Raw(1, (value + cheap) & 1);
    return value;
  }
  Bytes Finish() {
    if (used_ > 0) bytes_.push_back(static_cast<std::byte>(pending_));
    used_ = 0;
    pending_ = 0;
    return std::move(bytes_);
  }

 private:
  Bytes bytes_;
  uint64_t pending_ = 0;
  int used_ = 0;
};

// Reads untrusted bytes. It does not look where they end: kReadableBytes must be readable behind
// them, and who reads asks overrun() at least once in kMaxReads.
class BitReader {
 public:
  static constexpr size_t kMaxReads = 200;
  static constexpr size_t kReadableBytes = 4 * kMaxReads + 8;

  explicit BitReader(ByteSpan bytes) : bytes_(bytes.data()), end_(8 * bytes.size()) {}
  [[gnu::always_inline]] uint32_t Raw(int count, uint32_t = 0) {
    const auto bits = static_cast<uint32_t>(Window() & ((uint64_t{1} << count) - 1));
    at_ += static_cast<uint32_t>(count);
    return bits;
  }
  // Without a branch, which would be hard to predict.
  [[gnu::always_inline]] uint32_t Below(uint32_t count, uint32_t = 0) {
    const int bits = std::bit_width(count | 1) - 1;
    const uint32_t cheap = (2u << bits) - count;
    const auto window = static_cast<uint64_t>(Window());
    const auto low = static_cast<uint32_t>(window & ((uint64_t{1} << bits) - 1));
    const uint32_t longer = (low << 1 | static_cast<uint32_t>(window >> bits & 1)) - cheap;
    const bool is_cheap = low < cheap;
    at_ += static_cast<uint32_t>(bits) + static_cast<uint32_t>(!is_cheap);
    return is_cheap ? low : longer;
  }
  bool overrun() const { return at_ > end_; }
  // True when everything was read, but for the bits that fill the last byte, which are zeros.
  bool Done() const {
    if (at_ > end_ || end_ - at_ >= 8) return false;
    return at_ == end_ || static_cast<uint8_t>(bytes_[at_ / 8]) >> (at_ % 8) == 0;
  }

 private:
  uint64_t Window() const {
    uint64_t window;
    std::memcpy(&window, bytes_ + at_ / 8, sizeof(window));
    return window >> (at_ % 8);
  }
  const std::byte* bytes_;
  uint64_t end_;
  uint64_t at_ = 0;
};

// A non-negative number without a model: 6 bits of length, then the bits below the top one.
template <typename Coder>
[[gnu::always_inline]] inline uint64_t CodeRawNumber(Coder& coder, uint64_t value) {
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
