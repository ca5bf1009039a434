// SPDX-License-Identifier: Apache-2.0
// Where the values of a PLY body come from: binary of either byte order, or text. Both classes have
// the same members, so that what reads elements is written once.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>

#include "codecs/mesh_file/input/file_io.h"
#include "codecs/mesh_file/input/text_reader.h"
#include "store/base/attributes.h"
#include "store/base/bytes.h"

namespace mtdb::internal {

// One value in its declared type, in the machine's byte order.
struct PlyValue {
  std::byte bytes[8] = {};

  template <typename T>
  T As() const {
    T v;
    std::memcpy(&v, bytes, sizeof(T));
    return v;
  }
  template <typename T>
  void Set(T v) {
    std::memcpy(bytes, &v, sizeof(T));
  }
  // Calls f with the value as its own type.
  template <typename F>
  auto Visit(ScalarType type, F f) const {
    switch (type) {
      case ScalarType::kInt8: return f(As<int8_t>());
      case ScalarType::kUint8: return f(As<uint8_t>());
      case ScalarType::kInt16: return f(As<int16_t>());
      case ScalarType::kUint16: return f(As<uint16_t>());
      case ScalarType::kInt32: return f(As<int32_t>());
      case ScalarType::kUint32: return f(As<uint32_t>());
      case ScalarType::kFloat32: return f(As<float>());
      case ScalarType::kFloat64: break;
    }
    return f(As<double>());
  }
  double ToReal(ScalarType type) const {
    return Visit(type, [](auto v) { return static_cast<double>(v); });
  }
  // Of an integer type.
  int64_t ToInteger(ScalarType type) const {
    return Visit(type, [](auto v) { return static_cast<int64_t>(v); });
  }
};

class PlyBinarySource {
 public:
  static constexpr bool kBinary = true;

  PlyBinarySource(const InputFile& file, uint64_t offset, bool big_endian)
      : reader_(file, offset), big_endian_(big_endian) {}

  // False when there is no such value: Problem() says why.
  bool Get(ScalarType type, PlyValue* value) {
    const size_t n = ScalarSize(type);
    if (!reader_.Ensure(n)) return false;
    if (big_endian_) {
      std::reverse_copy(reader_.data(), reader_.data() + n, value->bytes);
    } else {
      std::memcpy(value->bytes, reader_.data(), n);
    }
    reader_.Consume(n);
    return true;
  }
  bool Skip(ScalarType type, uint64_t count) {
    // Division: the product may overflow.
    return count <= reader_.remaining() / ScalarSize(type) &&
           reader_.Skip(count * ScalarSize(type));
  }
  // Whether a list of so many items can still be in the file.
  bool Fits(ScalarType type, uint64_t count) const {
    return count <= reader_.remaining() / ScalarSize(type);
  }
  void EndInstance() {}
  uint64_t remaining() { return reader_.remaining(); }
  bool NumberFollows() { return false; }
  std::string Doubt() const { return ""; }
  const Status& status() const { return reader_.status(); }
  std::string Place() const { return ""; }
  std::string Problem() const {
    return "the file ends at byte " + std::to_string(reader_.offset() + reader_.remaining()) +
           " in the middle of it; the file is cut short";
  }

  BlockReader& reader() { return reader_; }
  bool big_endian() const { return big_endian_; }

 private:
  BlockReader reader_;
  bool big_endian_;
};

class PlyTextSource {
 public:
  static constexpr bool kBinary = false;

  PlyTextSource(const InputFile& file, uint64_t offset, uint64_t lines_before)
      : reader_(file, offset, lines_before) {}

  bool Get(ScalarType type, PlyValue* value);
  bool Skip(ScalarType type, uint64_t count);
  bool Fits(ScalarType, uint64_t count) const { return count <= reader_.remaining() / 2 + 1; }
  // After the last value of an element's instance. Lines may be broken anywhere; but when values
  // begin behind another instance's in a line and end in another line, lines may have other numbers
  // of values than the header says, so that all is shifted.
  void EndInstance();
  // For the message of an error: the first such line, if there is one.
  std::string Doubt() const {
    if (doubtful_line_ == 0) return "";
    return "; line " + std::to_string(doubtful_line_) +
           " has other numbers of values than the header's properties";
  }
  uint64_t remaining() { return reader_.AtEnd() ? 0 : reader_.remaining(); }
  // Takes the next token; whether it is a number, which Problem() tells of.
  bool NumberFollows();
  const Status& status() const { return reader_.status(); }
  std::string Place() const { return " (line " + std::to_string(reader_.line()) + ")"; }
  std::string Problem() const { return problem_; }

 private:
  TextReader reader_;
  std::string problem_;
  uint64_t first_line_ = 0;  // of this instance; 0: it has no value yet
  uint64_t doubtful_line_ = 0;
  uint64_t before_line_ = 0;  // in which the instance before ended
};

}  // namespace mtdb::internal
