#include "codecs/internal/rans.h"

#include <catch2/catch.hpp>
#include <random>

namespace mtdb {
namespace {

struct Decision {
  int kind;  // 0 bit, 1 symbol, 2 raw, 3 number, 4 fast symbol
  uint64_t value;
  int bits = 0;
};

std::vector<Decision> RandomDecisions(uint32_t seed, size_t count) {
  std::mt19937 random(seed);
  std::vector<Decision> decisions;
  for (size_t i = 0; i < count; ++i) {
    switch (random() % 5) {
      case 0: decisions.push_back({0, random() % 50 == 0}); break;
      case 1: decisions.push_back({1, random() % 4 == 0 ? random() % 16 : 15}); break;
      case 2: {
        const int bits = static_cast<int>(random() % 33);
        decisions.push_back({2, random() & ((uint64_t{1} << bits) - 1), bits});
        break;
      }
      case 3:
        decisions.push_back({3, (uint64_t{random()} << 31 | random()) >> random() % 63});
        break;
      default: decisions.push_back({4, random() % 16});
    }
  }
  return decisions;
}

struct Models {
  AdaptiveBit bit;
  AdaptiveSymbol symbol;
  FastAdaptiveSymbol fast;
};

template <typename Coder>
uint64_t Code(Coder& coder, Models& models, const Decision& d, uint64_t value) {
  const auto small = static_cast<uint32_t>(value);
  switch (d.kind) {
    case 0: return coder.Bit(models.bit, value != 0);
    case 1: return coder.Symbol(models.symbol, small);
    case 2: return coder.Raw(d.bits, small);
    case 3: return CodeRawNumber(coder, value);
    default: return coder.Symbol(models.fast, small);
  }
}

TEST_CASE("what the coder writes, it reads, and it ends where it began") {
  for (uint32_t seed = 0; seed < 20; ++seed) {
    const std::vector<Decision> decisions = RandomDecisions(seed, 1 + seed * 300);
    RansEncoder encoder;
    Models writing;
    for (const Decision& d : decisions) Code(encoder, writing, d, d.value);
    const Bytes bytes = encoder.Finish();
    RansDecoder decoder(bytes);
    Models reading;
    for (const Decision& d : decisions) REQUIRE(Code(decoder, reading, d, 0) == d.value);
    REQUIRE(decoder.Done());
    REQUIRE(encoder.Finish().empty());
  }
}

TEST_CASE("nothing coded is no bytes, and no bytes decode to nothing") {
  REQUIRE(RansEncoder().Finish().empty());
  REQUIRE(RansDecoder({}).Done());
}

TEST_CASE("a decoder that is out of bytes gives numbers and says so") {
  Models models;
  RansDecoder decoder(Bytes(4));
  for (int i = 0; i < 1000; ++i) {
    REQUIRE(decoder.Symbol(models.symbol) < 16);
    decoder.Raw(32);
  }
  REQUIRE(decoder.overrun());
  REQUIRE_FALSE(decoder.Done());
}

TEST_CASE("models stay within their bounds whatever they see") {
  AdaptiveBit bit;
  for (int i = 0; i < 10000; ++i) {
    bit.Update(i < 5000);
    REQUIRE(bit.one() >= 1);
    REQUIRE(bit.one() < kProbabilityOne);
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
