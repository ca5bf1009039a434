// SPDX-License-Identifier: Apache-2.0
// The models of a cluster's streams: which contexts each decision has, and how numbers are split
// into decisions. Templates on the coder (rans.h), so that what is written is what is read.
// Specified in codecs/FORMAT.md, with the same names.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "codecs/coding/bit_stream.h"
#include "codecs/coding/patch.h"
#include "codecs/coding/rans.h"

namespace mtdb {

// floor(log2(x)) for x >= 1, and 0 below; at most kMaxExponent, whatever hostile positions give.
inline constexpr int kMaxExponent = 70;
inline int ExponentOf(float x) {
  const int exponent = static_cast<int>(std::bit_cast<uint32_t>(x) >> 23 & 0xff) - 127;
  return std::min(std::max(exponent, 0), kMaxExponent);
}

// ---- topology: anchors, holes, split edges ----

class TopologyModel {
 public:
  TopologyModel();

  // Is `slot` the anchor of a node? Every slot that is not beyond the last anchor is asked.
  template <typename Coder>
  [[gnu::always_inline]] bool CodeAnchor(Coder&& coder, const Patch& patch, uint32_t slot,
                                         bool value) {
    return CodeAnchor(coder, patch.triangle(slot), slot, value);
  }
  template <typename Coder>
  [[gnu::always_inline]] bool CodeAnchor(Coder&& coder, const Patch::Triangle& t, uint32_t slot,
                                         bool value) {
    return coder.Bit(anchor_[AnchorContext(t, slot)], value);
  }
  // Does the hole, of `taken` triangles by now, go on across a half-edge of that shape?
  template <typename Coder>
  [[gnu::always_inline]] bool CodeTake(Coder&& coder, uint32_t taken, uint32_t shape, bool value) {
    return coder.Bit(Take(taken, shape), value);
  }
  // Likewise; it does not, and nothing is coded, unless it is `possible`.
  template <typename Coder>
  [[gnu::always_inline]] bool CodeTakeIf(Coder&& coder, bool possible, uint32_t taken,
                                         uint32_t shape, bool value) {
    return coder.BitIf(possible, Take(taken, shape), value);
  }
  // The ring edge that a boundary node splits: kNone32 when the node is none, else its rank, the
  // `open` edges with nothing beyond them before the `closed` ones.
  template <typename Coder>
  uint32_t CodeSplit(Coder&& coder, uint32_t open, uint32_t closed, uint32_t value) {
    if (!coder.Bit(boundary_[std::min<uint32_t>(open, 3)], value != kNone32)) return kNone32;
    const bool is_open = open > 0 && (closed == 0 || coder.Bit(open_, value < open));
    const uint32_t first = is_open ? 0 : open;
    const uint32_t count = is_open ? open : closed;
    return first + coder.Raw(std::bit_width(count - 1), value - first);
  }

  template <typename Visit>
  void ForEachTable(Visit&& visit) {
    visit("kAnchorPriors", std::span(anchor_));
    visit("kTakePriors", std::span(take_));
    visit("kBoundaryPriors", std::span(boundary_));
  }

  static constexpr uint32_t kShapes = 64;
  static constexpr uint32_t kTakenClasses = 6;
  static constexpr size_t kAnchorContexts = 4 * 64;
  static constexpr size_t kTakeContexts = kTakenClasses * kShapes;

 private:
  AdaptiveBit& Take(uint32_t taken, uint32_t shape) {
    return take_[std::min(taken - 1, kTakenClasses - 1) * kShapes + shape];
  }
  // By how many neighbours were visited, the least SharpnessClass of the edges to them (those to
  // others count as the sharpest), and the longest edge.
  static size_t AnchorContext(const Patch::Triangle& t, uint32_t slot) {
    const uint32_t v0 = t.opposite[0] < 4 * slot;
    const uint32_t v1 = t.opposite[1] < 4 * slot;
    const uint32_t v2 = t.opposite[2] < 4 * slot;
    const uint32_t least =
        std::min(std::min((t.shape[0] | (v0 - 1)) & 7, (t.shape[1] | (v1 - 1)) & 7),
                 (t.shape[2] | (v2 - 1)) & 7);
    return ((v0 + v1 + v2) * 8 + least) * 8 + t.longest;
  }

  std::array<AdaptiveBit, kAnchorContexts> anchor_;
  std::array<AdaptiveBit, kTakeContexts> take_;
  std::array<AdaptiveBit, 4> boundary_;
  AdaptiveBit open_;
};

// Codes which ring edge a node splits; kNone32: none, the node is interior. A result beyond the
// ring is an error of the bytes. Edges with nothing beyond them come first.
template <typename Coder>
uint32_t CodeSplitEdge(Coder&& coder, TopologyModel& model, const Patch::Hole& hole,
                       uint32_t edge) {
  const uint32_t k = hole.ring_count;
  const uint32_t open = hole.open_edges();
  uint32_t rank = kNone32;
  if (edge != kNone32) {
    rank = hole.open_edge(edge) ? 0 : open;
    for (uint32_t j = 0; j < edge; ++j) rank += hole.open_edge(j) == hole.open_edge(edge);
  }
  rank = model.CodeSplit(coder, open, k - open, rank);
  if (rank >= k) return rank;
  const bool wants_open = rank < open;
  uint32_t left = wants_open ? rank : rank - open;
  for (uint32_t j = 0; j < k; ++j) {
    if (hole.open_edge(j) == wants_open && left-- == 0) return j;
  }
  return k;
}

// ---- topology and places of vertices on a lattice ----

class LatticeModel {
 public:
  LatticeModel();

  // Is a triangle the anchor of a node, when `count` points may be its vertex? `later`: how many of
  // its neighbours were not visited yet.
  template <typename Coder>
  bool CodeAnchor(Coder&& coder, uint32_t later, uint32_t count, bool value) {
    if (count == 0) return false;
    return coder.Bit(anchor_[later * kCounts + CountClass(count)], value);
  }
  // Does the hole take a triangle in whose circle `inside` of `count` > 0 points lie?
  template <typename Coder>
  bool CodeTake(Coder&& coder, uint32_t inside, uint32_t count, bool value) {
    if (inside == 0) return false;
    if (inside == count) return true;
    return coder.Bit(take_[std::min(CountClass(count) - 1, kTakeCounts - 1) * kShares +
                           inside * kShares / count],
                     value);
  }
  // A number < count, phased in.
  template <typename Coder>
  uint32_t CodeIndex(Coder&& coder, uint32_t count, uint32_t value) {
    const int bits = std::bit_width(count) - 1;
    const uint32_t cheap = (2u << bits) - count;
    const uint32_t coded = value < cheap ? value : (value + cheap) >> 1;
    const uint32_t high = coder.Raw(bits, coded);
    return high < cheap ? high : (high << 1 | coder.Raw(1, (value + cheap) & 1)) - cheap;
  }

  template <typename Visit>
  void ForEachTable(Visit&& visit) {
    visit("kLatticeAnchorPriors", std::span(anchor_));
    visit("kLatticeTakePriors", std::span(take_));
  }

  static constexpr uint32_t kCounts = 16;
  static constexpr uint32_t kTakeCounts = 4;
  static constexpr uint32_t kShares = 16;

 private:
  // 1 .. 8, then by octaves.
  static uint32_t CountClass(uint32_t count) {
    return std::min(count <= 8 ? count : static_cast<uint32_t>(std::bit_width(count)) + 5,
                    kCounts - 1);
  }

  std::array<AdaptiveBit, 4 * kCounts> anchor_;
  std::array<AdaptiveBit, kTakeCounts * kShares> take_;
};

// ---- errors ----

class ErrorModel {
 public:
  ErrorModel();
  // The error code of a node whose hole has `hole` triangles. `least`: of the codes of the nodes
  // that made them, in-triangles counting as kMadeElsewhere; `last`: the code of the node before.
  template <typename Coder, typename BitCoder>
  [[gnu::always_inline]] uint8_t Code(Coder&& coder, BitCoder& bits, size_t hole, uint32_t least,
                                      uint8_t last, uint8_t value) {
    const bool fallback = least == Patch::kMadeElsewhere;
    const uint32_t prediction = fallback ? last : least;
    const uint32_t difference = prediction + kUp - value;
    const size_t context = std::min<size_t>(hole - 1, kHoleClasses - 1) * 2 + (fallback ? 1 : 0);
    const uint32_t high = coder.Symbol(high_[context], std::min(difference >> 2, kEscape));
    if (high == kEscape) [[unlikely]] {
      return static_cast<uint8_t>(bits.Raw(8, value));
    }
    return static_cast<uint8_t>(prediction + kUp - (high << 2 | bits.Raw(2, difference & 3)));
  }

  // Likewise, on a lattice. Errors there are often whole or simple fractions of cells, which only
  // some codes stand for: groups of four codes are coded by their distance from the group that is
  // predicted, then which one it is in its group.
  template <typename Coder, typename BitCoder>
  [[gnu::always_inline]] uint8_t CodeOnLattice(Coder&& coder, BitCoder& bits, uint32_t least,
                                               uint8_t last, uint8_t value) {
    const bool fallback = least == Patch::kMadeElsewhere;
    const uint32_t prediction = fallback ? last : least;
    const uint32_t group = prediction >> 2;
    const size_t context = 2 * std::min<size_t>(group, kGroups - 1) + (fallback ? 1 : 0);
    const uint32_t difference = group + kGroupsUp - (uint32_t{value} >> 2);
    const uint32_t high = coder.Symbol(lattice_high_[context], std::min(difference, kEscape));
    if (high == kEscape) [[unlikely]] {
      return static_cast<uint8_t>(bits.Raw(8, value));
    }
    const uint32_t found = (group + kGroupsUp - high) & 63;
    const uint32_t where = found == group ? prediction & 3 : found > group ? 4 : 5;
    AdaptiveBit* low = &lattice_low_[3 * (kWheres * std::min<size_t>(found, kGroups - 1) + where)];
    const bool upper = coder.Bit(low[0], (value & 2) != 0);
    const bool odd = coder.Bit(low[upper ? 2 : 1], (value & 1) != 0);
    return static_cast<uint8_t>(found << 2 | (upper ? 2 : 0) | (odd ? 1 : 0));
  }

  template <typename Visit>
  void ForEachTable(Visit&& visit) {
    visit("kErrorPriors", std::span(high_));
    visit("kLatticeErrorPriors", std::span(lattice_high_));
    visit("kLatticeErrorLowPriors", std::span(lattice_low_));
  }

  static constexpr size_t kHoleClasses = 6;
  static constexpr uint32_t kEscape = 15;
  static constexpr uint32_t kUp = 24;  // codes may exceed the prediction by so much
  static constexpr uint32_t kGroupsUp = kUp / 4;
  static constexpr size_t kGroups = 19;  // with contexts of their own; of less than 32 cells
  static constexpr size_t kWheres = 6;

 private:
  std::array<AdaptiveSymbol, 2 * kGroups> lattice_high_;
  std::array<AdaptiveBit, 3 * kWheres * kGroups> lattice_low_;
  std::array<AdaptiveSymbol, 2 * kHoleClasses> high_;
};

// ---- positions ----

// Numbers as a symbol, coded by a model, and bits without one.
class PositionModel {
 public:
  PositionModel();
  // The residual of coordinate `which` (0 u, 1 v, 2 n).
  template <typename Coder, typename BitCoder>
  [[gnu::always_inline]] int32_t CodeScaled(Coder&& coder, BitCoder& bits, size_t which,
                                            size_t ring_class, float variance, int32_t value) {
    const int exponent = ExponentOf(variance);
    // A symbol stands for about an eighth of the deviation, or for a half of it along n, where
    // tails are long: few residuals are beyond the symbols.
    const int shift = std::max(0, exponent / 2 - (which == 2 ? 1 : 3));
    const size_t scale = static_cast<size_t>(exponent < 8 ? exponent : 8 + (exponent & 1));
    AdaptiveSymbol& model = scaled_[(which * kRingClasses + ring_class) * kScales + scale];
    const uint32_t magnitude = Magnitude(value);
    const uint32_t quotient = magnitude >> shift;
    uint64_t q = coder.Symbol(model, std::min(quotient, kEscape));
    if (q == kEscape) q += CodeRawNumber(bits, quotient - kEscape);
    if (shift == 0 && q == 0) return 0;
    const uint32_t low =
        bits.Raw(shift + 1, (magnitude & ((1u << shift) - 1)) << 1 | (value < 0 ? 1u : 0u));
    return Signed(static_cast<uint32_t>(q << shift) | low >> 1, low & 1);
  }
  // Of the residual along n of a vertex that is hardly farther than a limit from its hole: which
  // part of the limit, and whether it is farther.
  struct Within {
    AdaptiveSymbol* bins;
    AdaptiveBit* beyond;
  };
  Within WithinOf(size_t ring_class, float limit) {
    const auto scale = static_cast<size_t>(std::min(ExponentOf(limit + 1), int{kLimits} - 1));
    return {&within_[ring_class * kLimits + scale], &beyond_[scale]};
  }
  // Of a vertex on a lattice, whose error has this code. Errors of few cells are often whole or
  // simple fractions, and a residual is often as large as the error.
  Within HeightOf(uint8_t code) {
    const size_t i = std::clamp<size_t>(code, kLeastHeightCode, kMostHeightCode) - kLeastHeightCode;
    return {&heights_[i], &heights_beyond_[i]};
  }
  template <typename Coder, typename BitCoder>
  [[gnu::always_inline]] static int32_t CodeWithin(Coder&& coder, BitCoder& bits, Within models,
                                                   float limit, int32_t value) {
    const float width = limit + 1;
    const auto bound = [&](uint32_t q) {
      return static_cast<uint32_t>(static_cast<int32_t>(width * (static_cast<float>(q) * 0.0625f)));
    };
    const uint32_t magnitude = Magnitude(value);
    uint32_t bin = kEscape;
    while (bound(bin) > magnitude) --bin;
    bin = coder.Symbol(*models.bins, bin);
    uint32_t result = bound(bin);
    if (bin == kEscape && coder.Bit(*models.beyond, magnitude >= bound(16))) {
      result = bound(16);
      result += static_cast<uint32_t>(CodeRawNumber(bits, magnitude - result));
    } else {
      result += bits.Below(bound(bin + 1) - result, magnitude - result);
    }
    return Signed(result, bits.Raw(result == 0 ? 0 : 1, value < 0 ? 1 : 0));
  }

  template <typename Visit>
  void ForEachTable(Visit&& visit) {
    visit("kScaledPriors", std::span(scaled_));
    visit("kWithinPriors", std::span(within_));
    visit("kBeyondPriors", std::span(beyond_));
    visit("kLatticeHeightPriors", std::span(heights_));
    visit("kLatticeBeyondPriors", std::span(heights_beyond_));
  }

  static constexpr size_t kRingClasses = 4;
  static constexpr size_t kScales = 10;
  static constexpr size_t kLimits = 6;
  // Of half a cell, and of 29; what is below and beyond has no contexts of its own.
  static constexpr size_t kLeastHeightCode = 25;
  static constexpr size_t kMostHeightCode = 72;
  static constexpr size_t kHeightCodes = kMostHeightCode - kLeastHeightCode + 1;
  static constexpr uint32_t kEscape = 15;
  static size_t RingClass(size_t k, bool boundary) {
    static constexpr uint8_t kClass[] = {0, 0, 0, 0, 0, 1, 1, 2};
    return boundary ? 3 : kClass[std::min<size_t>(k, 7)];
  }

 private:
  static uint32_t Magnitude(int32_t v) {
    return v < 0 ? 0u - static_cast<uint32_t>(v) : static_cast<uint32_t>(v);
  }
  static int32_t Signed(uint32_t magnitude, uint32_t negative) {
    return static_cast<int32_t>((magnitude ^ (0u - negative)) + negative);
  }

  std::array<AdaptiveSymbol, 3 * kRingClasses * kScales> scaled_;
  std::array<AdaptiveSymbol, kRingClasses * kLimits> within_;
  std::array<AdaptiveBit, kLimits> beyond_;
  std::array<AdaptiveSymbol, kHeightCodes> heights_;
  std::array<AdaptiveBit, kHeightCodes> heights_beyond_;
};

// ---- arcs ----

class ArcModel {
 public:
  ArcModel();
  // Visits each out-triangle (alive) in ascending order, and codes which child removes it:
  // get(slot) is an ordinal, or `children` for the drain; put(slot, ordinal) gets it back, and ends
  // it all by false. Returns false then, and on a number beyond.
  template <typename Coder, typename Get, typename Put>
  bool Code(Coder&& coder, const Patch& patch, uint32_t children, Get&& get, Put&& put);

  template <typename Visit>
  void ForEachTable(Visit&& visit) {
    visit("kFirstArcPriors", std::span(first_));
    visit("kSecondArcPriors", std::span(second_));
  }

 private:
  // By how many neighbours were coded, and whether their arcs differ.
  std::array<AdaptiveBit, 8> first_;  // same as the first neighbour's; without one, as the last arc
  std::array<AdaptiveBit, 8> second_;  // same as the one that differs
};

template <typename Coder, typename Get, typename Put>
bool ArcModel::Code(Coder&& coder, const Patch& patch, uint32_t children, Get&& get, Put&& put) {
  // Without a branch, which would be hard to predict.
  std::vector<uint32_t> alive(patch.slots() + size_t{1});
  size_t count = 0;
  for (uint32_t slot = 0; slot < patch.slots(); ++slot) {
    alive[count] = slot;
    count += static_cast<size_t>(patch.remover(slot) == kNone32);
  }
  alive.resize(count);
  std::vector<uint32_t> arcs(patch.slots());
  uint32_t last = 0;
  for (const uint32_t slot : alive) {
    uint32_t known = 0;
    uint32_t first = last;
    uint32_t second = kNone32;
    for (const uint32_t o : patch.triangle(slot).opposite) {
      // Without a branch, which would be hard to predict: of one that is not lower, arcs[slot].
      const auto lower = static_cast<uint32_t>(o < 4 * slot);
      const uint32_t mask = 0u - lower;
      const uint32_t arc = arcs[(o >> 2 & mask) | (slot & ~mask)];
      const uint32_t is_first = mask & (0u - static_cast<uint32_t>(known == 0));
      first = (arc & is_first) | (first & ~is_first);
      const uint32_t differs = mask & (0u - static_cast<uint32_t>(arc != first));
      second = (arc & differs) | (second & ~differs);
      known += lower;
    }
    const uint32_t value = get(slot);
    const bool two = second != kNone32;
    const size_t context = 2 * known + (two ? 1 : 0);
    uint32_t arc = first;
    if (!coder.Bit(first_[context], value == first)) {
      if (two && coder.Bit(second_[context], value == second)) {
        arc = second;
      } else {
        arc = coder.Raw(std::bit_width(children), value);
        if (arc > children) return false;
      }
    }
    last = arc;
    arcs[slot] = arc;
    if (!put(slot, arc)) return false;
  }
  return true;
}

// All models of a cluster that start from priors.
struct ClusterModels {
  TopologyModel topology;
  LatticeModel lattice;
  ErrorModel errors;
  PositionModel positions;
  ArcModel arcs;

  // visit(name of the table of priors, span of AdaptiveBit or AdaptiveSymbol)
  template <typename Visit>
  void ForEachTable(Visit&& visit) {
    topology.ForEachTable(visit);
    lattice.ForEachTable(visit);
    errors.ForEachTable(visit);
    positions.ForEachTable(visit);
    arcs.ForEachTable(visit);
  }
};

}  // namespace mtdb
