// SPDX-License-Identifier: Apache-2.0
#include "codecs/coding/rans.h"

#include <catch2/catch.hpp>
#include <random>

#include "codecs/coding/bit_stream.h"

namespace mtdb {
namespace {

struct Decision {
  int kind;  // 0 bit, 1 symbol, 2 raw, 3 fast symbol
  uint32_t value;
  int bits = 0;
  size_t lane = 0;
};

std::vector<Decision> RandomDecisions(uint32_t seed, size_t count, size_t lanes) {
  std::mt19937 random(seed);
  std::vector<Decision> decisions;
  for (size_t i = 0; i < count; ++i) {
    switch (random() % 4) {
      case 0: decisions.push_back({0, random() % 50 == 0 ? 1u : 0u}); break;
      case 1:
        decisions.push_back({1, random() % 4 == 0 ? static_cast<uint32_t>(random() % 16) : 15});
        break;
      case 2: {
        const int bits = static_cast<int>(random() % 33);
        const auto mask = static_cast<uint32_t>((uint64_t{1} << bits) - 1);
        decisions.push_back({2, static_cast<uint32_t>(random()) & mask, bits});
        break;
      }
      default: decisions.push_back({3, static_cast<uint32_t>(random() % 16)});
    }
    decisions.back().lane = random() % lanes;
  }
  return decisions;
}

struct Models {
  AdaptiveBit bit;
  AdaptiveSymbol symbol;
  FastAdaptiveSymbol fast;
};

template <typename Coder>
uint32_t Code(Coder&& coder, Models& models, const Decision& d, uint32_t value) {
  switch (d.kind) {
    case 0: return coder.Bit(models.bit, value != 0);
    case 1: return coder.Symbol(models.symbol, value);
    case 2: return coder.Raw(d.bits, value);
    default: return coder.Symbol(models.fast, value);
  }
}

// No encoder leaves such a state, and what follows of it would differ by whether bits that are
// certain are counted as decisions.
TEST_CASE("a stream whose state begins below 2^31 is refused") {
  ByteWriter w;
  for (const uint32_t word : {0u, 5u, 0x80000000u}) w.Put(word);
  RansDecoder<> decoder(w.bytes());
  REQUIRE(decoder.overrun());
  REQUIRE(decoder.lane().Raw(16) == 5);
  REQUIRE_FALSE(decoder.Done());
  REQUIRE_FALSE(decoder.DoneBeforeZeros());
}

TEST_CASE("what the coder writes on three lanes, it reads, and it ends where it began") {
  for (uint32_t seed = 0; seed < 20; ++seed) {
    const std::vector<Decision> decisions = RandomDecisions(seed, 1 + seed * 300, 3);
    RansEncoder encoder;
    Models writing;
    for (const Decision& d : decisions) Code(encoder.lane(d.lane), writing, d, d.value);
    const Bytes bytes = encoder.Finish(3);
    RansDecoder<3> decoder(bytes);
    Models reading;
    for (const Decision& d : decisions) {
      const uint32_t value = d.lane == 0   ? Code(decoder.lane<0>(), reading, d, 0)
                             : d.lane == 1 ? Code(decoder.lane<1>(), reading, d, 0)
                                           : Code(decoder.lane<2>(), reading, d, 0);
      REQUIRE(value == d.value);
      REQUIRE_FALSE(decoder.overrun());
    }
    REQUIRE(decoder.Done());
    REQUIRE(encoder.Finish().empty());
  }
}

TEST_CASE("nothing coded is no bytes, and no bytes decode to nothing") {
  REQUIRE(RansEncoder().Finish(2).empty());
  REQUIRE(RansDecoder<2>({}).Done());
  REQUIRE(BitWriter().Finish().empty());
  REQUIRE(BitReader({}).Done());
}

TEST_CASE("a decoder that is out of bytes gives numbers and says so") {
  for (const size_t size : {size_t{4}, size_t{8}, size_t{16}}) {
    const Bytes bytes(size);
    Models models;
    RansDecoder<2> decoder(bytes);
    for (int i = 0; i < 1000; ++i) {
      REQUIRE(decoder.lane<1>().Symbol(models.symbol) < 16);
      decoder.lane<0>().Raw(32);
    }
    REQUIRE(decoder.overrun());
    REQUIRE_FALSE(decoder.Done());
  }
}

TEST_CASE("bits, phased-in numbers and numbers of any length come back") {
  std::mt19937 random(4);
  struct Item {
    uint32_t kind, limit;
    uint64_t value;
  };
  std::vector<Item> items;
  BitWriter writer;
  for (int i = 0; i < 5000; ++i) {
    Item item{static_cast<uint32_t>(random() % 3), 0, 0};
    switch (item.kind) {
      case 0:
        item.limit = static_cast<uint32_t>(random() % 33);
        item.value = random() & ((uint64_t{1} << item.limit) - 1);
        writer.Raw(static_cast<int>(item.limit), static_cast<uint32_t>(item.value));
        break;
      case 1:
        item.limit = 1 + static_cast<uint32_t>(random() >> random() % 32) % 0x7fffffff;
        item.value = random() % item.limit;
        writer.Below(item.limit, static_cast<uint32_t>(item.value));
        break;
      default:
        item.value = (uint64_t{random()} << 31 | random()) >> random() % 63;
        CodeRawNumber(writer, item.value);
    }
    items.push_back(item);
  }
  const Bytes bytes = writer.Finish();
  Bytes readable = bytes;
  readable.resize(bytes.size() + BitReader::kReadableBytes);
  BitReader reader(ByteSpan(readable).first(bytes.size()));
  for (const Item& item : items) {
    const uint64_t value = item.kind == 0   ? reader.Raw(static_cast<int>(item.limit))
                           : item.kind == 1 ? reader.Below(item.limit)
                                            : CodeRawNumber(reader, 0);
    REQUIRE(value == item.value);
  }
  REQUIRE(reader.Done());
  reader.Raw(16);
  REQUIRE(reader.overrun());
  REQUIRE_FALSE(reader.Done());
}

TEST_CASE("models stay within their bounds whatever they see") {
  AdaptiveBit bit;
  for (int i = 0; i < 10000; ++i) {
    bit.Update(i < 5000);
    REQUIRE(bit.probability >= 1);
  }
  AdaptiveSymbol symbol;
  std::mt19937 random(3);
  for (int i = 0; i < 20000; ++i) {
    symbol.Update(i < 5000 ? 0 : i < 10000 ? 15 : random() % 16);
    for (uint32_t s = 0; s < 16; ++s) {
      REQUIRE(symbol.begin(s) < symbol.end(s));
      REQUIRE(symbol.Find(symbol.begin(s)) == s);
      REQUIRE(symbol.Find(symbol.end(s) - 1) == s);
    }
  }
}

TEST_CASE("the coded length is near the entropy of the decisions") {
  std::mt19937 random(9);
  RansEncoder encoder;
  AdaptiveBit model;
  constexpr int kCount = 100000;
  for (int i = 0; i < kCount; ++i) encoder.Bit(model, random() % 10 == 0);
  const double bits = 8.0 * static_cast<double>(encoder.Finish().size()) / kCount;
  REQUIRE(bits > 0.469);  // the entropy of one in ten
  REQUIRE(bits < 0.485);
}

}  // namespace
}  // namespace mtdb
