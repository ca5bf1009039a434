// The models of a cluster's streams: which contexts each decision has, and how numbers are split
// into decisions. Templates on the coder (rans.h), so that what is written is what is read.
// Specified in codecs/FORMAT.md, with the same names.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "codecs/internal/hole_frame.h"
#include "codecs/internal/patch.h"
#include "codecs/internal/rans.h"

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
  explicit TopologyModel(int reference_length);

  // Is `slot` the anchor of a node? Every slot that is not beyond the last anchor is asked.
  template <typename Coder>
  [[gnu::always_inline]] bool CodeAnchor(Coder& coder, const Patch& patch, uint32_t slot,
                                         bool value) {
    return coder.Bit(anchor_[AnchorContext(patch.triangle(slot), slot)], value);
  }
  // Does the hole, of `taken` triangles by now, go on across half-edge i of its triangle t?
  template <typename Coder>
  [[gnu::always_inline]] bool CodeTake(Coder& coder, size_t taken, const Patch::Triangle& t,
                                       size_t i, bool value) {
    const size_t count = std::min<size_t>(taken - 1, kTakenClasses - 1);
    return coder.Bit(
        take_[(count * kLengthClasses + length_class_[t.length[i]]) * kSharpnessClasses +
              kSharpnessClass[t.both[i]]],
        value);
  }
  // The ring edge that a boundary node splits: kNone32 when the node is none, else its rank, the
  // `open` edges with nothing beyond them before the `closed` ones.
  template <typename Coder>
  [[gnu::always_inline]] uint32_t CodeSplit(Coder& coder, uint32_t open, uint32_t closed,
                                            uint32_t value) {
    if (!coder.Bit(boundary_[std::min<uint32_t>(open, 3)], value != kNone32)) return kNone32;
    const bool is_open = open > 0 && (closed == 0 || coder.Bit(open_, value < open));
    const uint32_t first = is_open ? 0 : open;
    const uint32_t count = is_open ? open : closed;
    return first + coder.Raw(std::bit_width(count - 1), value - first);
  }

  static constexpr size_t kLengthClasses = 8;
  static constexpr size_t kSharpnessClasses = 8;
  static constexpr size_t kTakenClasses = 6;
  static constexpr size_t kAnchorContexts = 4 * kSharpnessClasses * kLengthClasses;
  static constexpr size_t kTakeContexts = kTakenClasses * kLengthClasses * kSharpnessClasses;

 private:
  // Of Patch::Triangle::both: low when an edge is long and thin triangles lie on both sides, that
  // is, when it is far from Delaunay.
  static constexpr auto kSharpnessClass = [] {
    std::array<uint8_t, 256> classes{};
    for (int both = 0; both < 256; ++both) {
      const int value = (both - Patch::kBothZero) / 16 - (both < Patch::kBothZero ? 1 : 0) + 3;
      classes[static_cast<size_t>(both)] =
          static_cast<uint8_t>(std::clamp(value, 0, int{kSharpnessClasses} - 1));
    }
    return classes;
  }();
  size_t AnchorContext(const Patch::Triangle& t, uint32_t slot) const {
    const uint32_t v0 = t.opposite[0] >> 2 < slot;
    const uint32_t v1 = t.opposite[1] >> 2 < slot;
    const uint32_t v2 = t.opposite[2] >> 2 < slot;
    // Those not visited count as the sharpest.
    const uint32_t least =
        std::min(std::min(t.both[0] | ((v0 - 1) & 0xff), t.both[1] | ((v1 - 1) & 0xff)),
                 t.both[2] | ((v2 - 1) & 0xff));
    return ((v0 + v1 + v2) * kSharpnessClasses + kSharpnessClass[least]) * kLengthClasses +
           length_class_[t.longest];
  }

  std::array<uint8_t, 160> length_class_;  // of exponents
  std::array<AdaptiveBit, kAnchorContexts> anchor_;
  std::array<AdaptiveBit, kTakeContexts> take_;
  std::array<AdaptiveBit, 4> boundary_;
  AdaptiveBit open_;
};

// ---- errors ----

class ErrorModel {
 public:
  ErrorModel();
  // The error code of a node whose hole has `hole` triangles, made by nodes of this cluster whose
  // least code is `prediction` (`fallback`: by none, and the prediction is the previous code).
  template <typename Coder>
  [[gnu::always_inline]] uint8_t Code(Coder& coder, size_t hole, bool fallback, uint8_t prediction,
                                      uint8_t value) {
    const uint32_t difference = static_cast<uint32_t>(prediction) + kUp - value;
    const size_t context = std::min<size_t>(hole - 1, kHoleClasses - 1) * 2 + (fallback ? 1 : 0);
    const uint32_t high = coder.Symbol(high_[context], std::min(difference >> 2, kEscape));
    if (high == kEscape) return static_cast<uint8_t>(coder.Raw(8, value));
    AdaptiveBit* low = &low_[3 * high];
    const bool top = coder.Bit(low[0], difference & 2);
    const bool bottom = coder.Bit(low[top ? 2 : 1], difference & 1);
    return static_cast<uint8_t>(prediction + kUp -
                                (high << 2 | (top ? 2u : 0u) | (bottom ? 1u : 0u)));
  }

  static constexpr size_t kHoleClasses = 6;
  static constexpr uint32_t kEscape = 15;
  static constexpr uint32_t kUp = 24;  // codes may exceed the prediction by so much

 private:
  std::array<AdaptiveSymbol, 2 * kHoleClasses> high_;
  std::array<AdaptiveBit, 3 * 16> low_;
};

// ---- positions ----

class PositionModel {
 public:
  PositionModel();
  // The residual of coordinate `which` (0 u, 1 v, 2 n).
  template <typename Coder>
  [[gnu::always_inline]] int32_t CodeScaled(Coder& coder, size_t which, size_t ring_class,
                                            float variance, int32_t value) {
    const int exponent = ExponentOf(variance);
    const int shift = std::max(0, exponent / 2 - 4);
    const size_t scale = static_cast<size_t>(exponent < 8 ? exponent : 8 + (exponent & 1));
    AdaptiveSymbol& model = scaled_[(which * kRingClasses + ring_class) * kScales + scale];
    const uint32_t magnitude = Magnitude(value);
    const uint32_t quotient = magnitude >> shift;
    uint64_t q = coder.Symbol(model, std::min(quotient, kEscape));
    if (q == kEscape) q += CodeRawNumber(coder, quotient - kEscape);
    if (q == 0 && shift == 0) return 0;
    const uint32_t low =
        coder.Raw(shift + 1, (magnitude & ((1u << shift) - 1)) << 1 | (value < 0 ? 1u : 0u));
    return Signed(static_cast<uint32_t>(q << shift) | low >> 1, low & 1);
  }
  // The residual along n of a vertex that is hardly farther than `limit` from its hole.
  template <typename Coder>
  [[gnu::always_inline]] int32_t CodeWithin(Coder& coder, size_t ring_class, float limit,
                                            int32_t value) {
    const float width = limit + 1;
    const auto bound = [&](uint32_t q) {
      return static_cast<uint32_t>(width * (static_cast<float>(q) * 0.0625f));
    };
    const auto scale = static_cast<size_t>(std::min(ExponentOf(width), int{kLimits} - 1));
    const uint32_t magnitude = Magnitude(value);
    uint32_t bin = kEscape;
    while (bound(bin) > magnitude) --bin;
    bin = coder.Symbol(within_[ring_class * kLimits + scale], bin);
    uint32_t result = bound(bin);
    if (bin == kEscape && coder.Bit(beyond_[scale], magnitude >= bound(16))) {
      result = bound(16);
      result += static_cast<uint32_t>(CodeRawNumber(coder, magnitude - result));
    } else {
      result += CodeBelow(coder, bound(bin + 1) - result, magnitude - result);
    }
    if (result == 0) return 0;
    return Signed(result, coder.Raw(1, value < 0 ? 1 : 0));
  }

  static constexpr size_t kRingClasses = 4;
  static constexpr size_t kScales = 10;
  static constexpr size_t kLimits = 6;
  static constexpr uint32_t kEscape = 15;
  static size_t RingClass(size_t k, bool boundary) {
    return boundary ? 3 : k <= 4 ? 0 : k <= 6 ? 1 : 2;
  }

 private:
  static uint32_t Magnitude(int32_t v) {
    return v < 0 ? 0u - static_cast<uint32_t>(v) : static_cast<uint32_t>(v);
  }
  static int32_t Signed(uint32_t magnitude, uint32_t negative) {
    return static_cast<int32_t>(negative ? 0u - magnitude : magnitude);
  }
  // A number below `count`, all equally likely: the first ones in one bit less than the others.
  template <typename Coder>
  static uint32_t CodeBelow(Coder& coder, uint32_t count, uint32_t value) {
    if (count <= 1) return 0;
    const int bits = std::bit_width(count) - 1;
    const uint32_t cheap = (2u << bits) - count;
    uint32_t x = coder.Raw(bits, value < cheap ? value : (value + cheap) >> 1);
    if (x < cheap) return x;
    x = x << 1 | coder.Raw(1, (value + cheap) & 1);
    return x - cheap;
  }

  std::array<AdaptiveSymbol, 3 * kRingClasses * kScales> scaled_;
  std::array<AdaptiveSymbol, kRingClasses * kLimits> within_;
  std::array<AdaptiveBit, kLimits> beyond_;
};

// ---- arcs ----

class ArcModel {
 public:
  ArcModel();
  // Visits each out-triangle (alive, not below `first_own`) once, breadth first across edges from
  // the lowest slot that is left, and codes which child removes it: get(slot) is an ordinal, or
  // `children` for the drain; put(slot, ordinal) gets it back. Returns false on a number beyond.
  template <typename Coder, typename Get, typename Put>
  bool Code(Coder& coder, const Patch& patch, uint32_t first_own, uint32_t children, Get&& get,
            Put&& put);

 private:
  std::array<AdaptiveBit, 6> first_;  // same as the first neighbour's
  std::array<AdaptiveBit, 6> second_;
};

template <typename Coder, typename Get, typename Put>
bool ArcModel::Code(Coder& coder, const Patch& patch, uint32_t first_own, uint32_t children,
                    Get&& get, Put&& put) {
  constexpr uint32_t kUnseen = kNone32;
  constexpr uint32_t kQueued = kNone32 - 1;
  std::vector<uint32_t> arcs(patch.slots(), kUnseen);
  std::vector<uint32_t> queue;
  for (uint32_t seed = first_own; seed < patch.slots(); ++seed) {
    if (patch.remover(seed) != kNone32 || arcs[seed] != kUnseen) continue;
    queue.assign(1, seed);
    arcs[seed] = kQueued;
    for (size_t at = 0; at < queue.size(); ++at) {
      const uint32_t slot = queue[at];
      size_t known = 0;
      uint32_t candidates[2] = {kNone32, kNone32};
      for (const uint32_t o : patch.triangle(slot).opposite) {
        if (o == kNone32 || o >> 2 < first_own) continue;
        uint32_t& arc = arcs[o >> 2];
        if (arc == kUnseen) {
          arc = kQueued;
          queue.push_back(o >> 2);
        } else if (arc != kQueued) {
          ++known;
          if (candidates[0] == kNone32)
            candidates[0] = arc;
          else if (arc != candidates[0])
            candidates[1] = arc;
        }
      }
      const uint32_t value = get(slot);
      const size_t context = known == 0 ? 0 : 2 * (known - 1) + (candidates[1] != kNone32 ? 1 : 0);
      uint32_t arc = kNone32;
      if (known > 0 && coder.Bit(first_[context], value == candidates[0])) {
        arc = candidates[0];
      } else if (candidates[1] != kNone32 && coder.Bit(second_[context], value == candidates[1])) {
        arc = candidates[1];
      } else {
        arc = coder.Raw(std::bit_width(children), value);
        if (arc > children) return false;
      }
      arcs[slot] = arc;
      put(slot, arc);
    }
  }
  return true;
}

}  // namespace mtdb
