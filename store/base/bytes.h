// SPDX-License-Identifier: Apache-2.0
// Bounds-checked little-endian readers and writers for every format of mtdb.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace mtdb {

static_assert(std::endian::native == std::endian::little, "mtdb runs on little-endian machines");

using Bytes = std::vector<std::byte>;
using ByteSpan = std::span<const std::byte>;

inline ByteSpan AsBytes(std::string_view s) {
  return {reinterpret_cast<const std::byte*>(s.data()), s.size()};
}
inline std::string_view AsString(ByteSpan b) {
  return {reinterpret_cast<const char*>(b.data()), b.size()};
}

// Appends numbers to a growing buffer.
class ByteWriter {
 public:
  template <typename T>
  requires std::is_arithmetic_v<T>
  void Put(T value) {
    const size_t at = bytes_.size();
    bytes_.resize(at + sizeof(T));
    std::memcpy(bytes_.data() + at, &value, sizeof(T));
  }
  template <typename T>
  requires std::is_arithmetic_v<T>
  void PutBigEndian(T value) {
    std::byte b[sizeof(T)];
    std::memcpy(b, &value, sizeof(T));
    for (size_t i = sizeof(T); i-- > 0;) bytes_.push_back(b[i]);
  }
  // LEB128: 7 bits a byte, low bits first, at most 10 bytes.
  void PutVarint(uint64_t value) {
    while (value >= 0x80) {
      bytes_.push_back(static_cast<std::byte>(value | 0x80));
      value >>= 7;
    }
    bytes_.push_back(static_cast<std::byte>(value));
  }
  void PutSignedVarint(int64_t value) {
    PutVarint((static_cast<uint64_t>(value) << 1) ^ static_cast<uint64_t>(value >> 63));
  }
  void PutBytes(ByteSpan b) { bytes_.insert(bytes_.end(), b.begin(), b.end()); }
  // Length as varint, then the bytes.
  void PutString(std::string_view s) {
    PutVarint(s.size());
    PutBytes(AsBytes(s));
  }

  size_t size() const { return bytes_.size(); }
  Bytes& bytes() { return bytes_; }
  const Bytes& bytes() const { return bytes_; }
  Bytes Take() { return std::move(bytes_); }

 private:
  Bytes bytes_;
};

// Reads numbers from untrusted bytes. Reading past the end sets failed() and yields zeros; check
// failed() once after a group of reads, and before any count is used to take memory.
class ByteReader {
 public:
  explicit ByteReader(ByteSpan bytes) : bytes_(bytes) {}

  template <typename T>
  requires std::is_arithmetic_v<T> T Get() {
    T value{};
    if (remaining() < sizeof(T)) {
      Fail();
      return value;
    }
    std::memcpy(&value, bytes_.data() + at_, sizeof(T));
    at_ += sizeof(T);
    return value;
  }
  template <typename T>
  requires std::is_arithmetic_v<T> T GetBigEndian() {
    T value{};
    if (remaining() < sizeof(T)) {
      Fail();
      return value;
    }
    std::byte b[sizeof(T)];
    for (size_t i = 0; i < sizeof(T); ++i) b[sizeof(T) - 1 - i] = bytes_[at_ + i];
    std::memcpy(&value, b, sizeof(T));
    at_ += sizeof(T);
    return value;
  }
  uint64_t GetVarint() {
    uint64_t value = 0;
    for (unsigned shift = 0; shift < 64; shift += 7) {
      if (at_ >= bytes_.size()) break;
      const auto b = static_cast<uint64_t>(bytes_[at_++]);
      if (shift == 63 && b > 1) break;
      value |= (b & 0x7f) << shift;
      if (b < 0x80) return value;
    }
    Fail();
    return 0;
  }
  int64_t GetSignedVarint() {
    const uint64_t v = GetVarint();
    return static_cast<int64_t>(v >> 1) ^ -static_cast<int64_t>(v & 1);
  }
  ByteSpan GetBytes(uint64_t count) {
    if (remaining() < count) {
      Fail();
      return {};
    }
    const ByteSpan b = bytes_.subspan(at_, count);
    at_ += count;
    return b;
  }
  std::string GetString() { return std::string(AsString(GetBytes(GetVarint()))); }

  bool failed() const { return failed_; }
  size_t remaining() const { return bytes_.size() - at_; }
  size_t position() const { return at_; }

 private:
  void Fail() {
    failed_ = true;
    at_ = bytes_.size();
  }
  ByteSpan bytes_;
  size_t at_ = 0;
  bool failed_ = false;
};

}  // namespace mtdb
