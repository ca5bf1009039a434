// SPDX-License-Identifier: Apache-2.0
#include "store/base/bytes.h"

#include <catch2/catch.hpp>
#include <cstdint>
#include <limits>
#include <random>

namespace mtdb {
namespace {

Bytes Raw(std::initializer_list<int> values) {
  Bytes bytes;
  for (const int v : values) bytes.push_back(static_cast<std::byte>(v));
  return bytes;
}

TEST_CASE("Numbers are written little-endian, or big-endian on demand") {
  ByteWriter writer;
  writer.bytes().reserve(64);
  writer.Put(uint32_t{0x01020304});
  writer.PutBigEndian(uint16_t{0x0506});
  writer.Put(-2.0f);
  writer.PutBigEndian(1.0);
  REQUIRE(writer.bytes() == Raw({4, 3, 2, 1, 5, 6, 0, 0, 0, 0xc0, 0x3f, 0xf0, 0, 0, 0, 0, 0, 0}));
  ByteReader reader(writer.bytes());
  REQUIRE(reader.Get<uint32_t>() == 0x01020304u);
  REQUIRE(reader.GetBigEndian<uint16_t>() == 0x0506);
  REQUIRE(reader.Get<float>() == -2.0f);
  REQUIRE(reader.GetBigEndian<double>() == 1.0);
  REQUIRE(reader.remaining() == 0);
  REQUIRE_FALSE(reader.failed());
}

TEST_CASE("Varints have 7 bits a byte, low bits first") {
  const auto encoded = [](uint64_t value) {
    ByteWriter writer;
    writer.PutVarint(value);
    return writer.Take();
  };
  REQUIRE(encoded(0) == Raw({0}));
  REQUIRE(encoded(127) == Raw({0x7f}));
  REQUIRE(encoded(128) == Raw({0x80, 0x01}));
  REQUIRE(encoded(300) == Raw({0xac, 0x02}));
  REQUIRE(encoded(~uint64_t{0}) ==
          Raw({0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01}));
}

TEST_CASE("Varints of both signs round trip over the whole range") {
  std::mt19937_64 random(1);
  ByteWriter writer;
  std::vector<uint64_t> values = {0, 1, 127, 128, ~uint64_t{0}, uint64_t{1} << 63};
  for (int i = 0; i < 2000; ++i) values.push_back(random() >> (i % 64));
  std::vector<int64_t> signed_values = {0, -1, 1, std::numeric_limits<int64_t>::min(),
                                        std::numeric_limits<int64_t>::max()};
  for (const uint64_t v : values) signed_values.push_back(static_cast<int64_t>(v));
  for (const uint64_t v : values) writer.PutVarint(v);
  for (const int64_t v : signed_values) writer.PutSignedVarint(v);
  ByteReader reader(writer.bytes());
  for (const uint64_t v : values) REQUIRE(reader.GetVarint() == v);
  for (const int64_t v : signed_values) REQUIRE(reader.GetSignedVarint() == v);
  REQUIRE(reader.remaining() == 0);
  REQUIRE_FALSE(reader.failed());
}

TEST_CASE("Small signed varints are one byte") {
  for (int v = -64; v < 64; ++v) {
    ByteWriter writer;
    writer.PutSignedVarint(v);
    REQUIRE(writer.size() == 1);
  }
}

TEST_CASE("A varint of more than 64 bits or without an end fails") {
  const auto fails = [](const Bytes& bytes) {
    ByteReader reader(bytes);
    const uint64_t value = reader.GetVarint();
    return reader.failed() && value == 0 && reader.remaining() == 0;
  };
  REQUIRE(fails(Raw({})));
  REQUIRE(fails(Raw({0x80})));
  REQUIRE(fails(Raw({0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x02})));
  REQUIRE(fails(Raw({0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x00})));
}

TEST_CASE("Strings and spans keep their bytes, NUL too") {
  using namespace std::string_view_literals;
  ByteWriter writer;
  writer.PutString("a\0b"sv);
  writer.PutString("");
  writer.PutBytes(AsBytes("xyz"));
  ByteReader reader(writer.bytes());
  REQUIRE(reader.GetString() == std::string("a\0b"sv));
  REQUIRE(reader.GetString().empty());
  REQUIRE(reader.position() == 5);
  REQUIRE(AsString(reader.GetBytes(3)) == "xyz");
  REQUIRE_FALSE(reader.failed());
}

TEST_CASE("Every prefix of a record fails, and reading on yields zeros") {
  ByteWriter writer;
  writer.Put(uint8_t{7});
  writer.PutVarint(1000000);
  writer.PutString("name");
  writer.PutBigEndian(int32_t{-5});
  writer.Put(2.5);
  const auto read = [](ByteSpan bytes) {
    ByteReader reader(bytes);
    (void)reader.Get<uint8_t>();
    (void)reader.GetVarint();
    (void)reader.GetString();
    (void)reader.GetBigEndian<int32_t>();
    const double last = reader.Get<double>();
    const bool zeros = !reader.failed() || (last == 0 && reader.Get<int>() == 0 &&
                                            reader.GetVarint() == 0 && reader.GetString().empty());
    return std::pair(reader.failed(), zeros);
  };
  for (size_t n = 0; n < writer.size(); ++n) {
    REQUIRE(read(ByteSpan(writer.bytes()).first(n)) == std::pair(true, true));
  }
  REQUIRE_FALSE(read(writer.bytes()).first);
}

TEST_CASE("A string longer than what remains takes no memory") {
  ByteWriter writer;
  writer.PutVarint(~uint64_t{0});
  writer.PutBytes(AsBytes("short"));
  ByteReader reader(writer.bytes());
  REQUIRE(reader.GetString().empty());
  REQUIRE(reader.failed());
  ByteReader spans(writer.bytes());
  REQUIRE(spans.GetBytes(~uint64_t{0} - 1).empty());
  REQUIRE(spans.failed());
}

}  // namespace
}  // namespace mtdb
