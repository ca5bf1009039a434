// SPDX-License-Identifier: Apache-2.0
#include "codecs/coding/patch.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <memory>
#include <utility>

#include "store/base/hash.h"

namespace mtdb {

namespace {

constexpr int32_t kClasses = 8;

// Of the sum of two bluntnesses.
constexpr auto kSharpnessClass = [] {
  std::array<uint8_t, 256> classes{};
  for (int i = 0; i < 256; ++i) {
    classes[static_cast<size_t>(i)] =
        static_cast<uint8_t>(std::clamp((248 - i) / 16 - 5, 0, kClasses - 1));
  }
  return classes;
}();

// Sets the SharpnessClass of a half-edge and its opposite.
inline void ShareSharpness(Patch::Triangle* triangles, Patch::Triangle& t, uint32_t i) {
  const uint32_t o = t.opposite[i];
  if (o == kNone32) return;
  Patch::Triangle& other = triangles[o >> 2];
  const uint8_t sharpness = kSharpnessClass[t.bluntness[i] + other.bluntness[o & 3]];
  t.shape[i] = static_cast<uint8_t>((t.shape[i] & 0x38) | sharpness);
  other.shape[o & 3] = static_cast<uint8_t>((other.shape[o & 3] & 0x38) | sharpness);
}

// `facing`, `b` and `c` are squared lengths of a triangle's edges; the bluntness of the corner that
// the first of them faces. The fraction is at most 2, since the square of a sum is at most twice
// the sum of the squares; differences that wrap around may break that rule.
Int4 Bluntness(Float4 facing, Float4 b, Float4 c) {
  return ToInt(Min4(60 * facing / (b + c + 1e-30f), Float4{120, 120, 120, 120}));
}

Float4 SquaredLengths(Float4 a, Float4 b, Float4 c, Float4 d, float height) {
  const Columns4 columns = Transpose(a * a, b * b, c * c, d * d);
  return columns.x + columns.y + columns.z * height;
}

}  // namespace

void Patch::Hole::Rotate(size_t split) {
  const size_t middle = split + 1 == ring_count ? 0 : split + 1;
  std::rotate(ring, ring + middle, ring + ring_count);
  std::rotate(outer.begin(), outer.begin() + middle, outer.begin() + ring_count);
}

uint32_t Patch::Hole::EdgeBetween(uint32_t a, uint32_t b) const {
  for (uint32_t j = 0; j < ring_count; ++j) {
    const uint32_t from = ring[j];
    const uint32_t to = ring[j + 1 == ring_count ? 0 : j + 1];
    if ((from == a && to == b) || (from == b && to == a)) return j;
  }
  return kNone32;
}

Patch::Patch(std::span<const std::array<uint32_t, 3>> triangles, std::span<const Vec3i> positions,
             int reference_length, size_t expected_nodes, bool flat,
             std::span<const uint8_t> two_sided, const Seams& seams)
    : shortest_(static_cast<uint32_t>(127 + reference_length - 3)),
      first_apex_(static_cast<uint32_t>(positions.size())),
      height_(flat ? 0.0f : 1.0f) {
  Grow(triangles.size() + 6 * expected_nodes + kMaxRing);
  slots_ = static_cast<uint32_t>(triangles.size());
  for (size_t slot = 0; slot < triangles.size(); ++slot) {
    triangles_[slot].corners = triangles[slot];
    triangles_[slot].opposite = {kNone32, kNone32, kNone32};
  }
  points_.reserve(positions.size() + expected_nodes);
  for (const Vec3i p : positions) AddPoint(p);
  last_apex_.assign(positions.size() + expected_nodes, kNone32);
  PairEdges();
  PartSheets(two_sided, seams);
  Measure(0, slots());
  for (uint32_t slot = 0; slot < slots(); ++slot) {
    Triangle& t = triangles_[slot];
    t.error_code = kMadeElsewhere;
    for (uint32_t i = 0; i < 3; ++i) ShareSharpness(triangles_.get(), t, i);
  }
  shaped_ = slots();
}

// Pairs each directed edge with its reverse. An edge that occurs twice in one direction is
// non-manifold: it pairs with nothing.
void Patch::PairEdges() {
  const uint32_t n = slots();
  // By undirected edge: its first half-edge, and how often each direction occurs. Lists of those of
  // one hash, in the order of coming, so that little memory is touched.
  struct Edge {
    uint64_t ends;
    uint32_t half_edge;
    uint32_t next;
    uint8_t uses[2];
  };
  const auto edges = std::make_unique_for_overwrite<Edge[]>(3 * size_t{n});
  uint32_t edge_count = 0;
  const size_t capacity = std::bit_ceil(2 * size_t{n} + 2);
  const int shift = 64 - std::countr_zero(capacity);
  std::vector<uint32_t> lists(capacity, kNone32);
  const auto find = [&](uint64_t ends) -> Edge& {
    uint32_t& list = lists[ends * 0x9e3779b97f4a7c15ull >> shift];
    for (uint32_t e = list; e != kNone32; e = edges[e].next) {
      if (edges[e].ends == ends) return edges[e];
    }
    edges[edge_count] = {ends, kNone32, list, {0, 0}};
    list = edge_count;
    return edges[edge_count++];
  };
  const auto ends_of = [&](uint32_t slot, uint32_t i) {
    const auto& c = triangles_[slot].corners;
    const uint32_t from = c[i];
    const uint32_t to = c[i == 2 ? 0 : i + 1];
    return std::pair(uint64_t{std::max(from, to)} << 32 | std::min(from, to), from < to);
  };
  bool repeated = false;
  for (uint32_t slot = 0; slot < n; ++slot) {
    for (uint32_t i = 0; i < 3; ++i) {
      const auto [ends, forward] = ends_of(slot, i);
      Edge& e = find(ends);
      if (e.half_edge == kNone32) {
        e.half_edge = 4 * slot + i;
        e.uses[forward] = 1;
      } else if (++e.uses[forward] == 1) {
        triangles_[slot].opposite[i] = e.half_edge;
        triangles_[e.half_edge >> 2].opposite[e.half_edge & 3] = 4 * slot + i;
      } else {
        e.uses[forward] = 2;
        repeated = true;
      }
    }
  }
  if (!repeated) return;
  for (uint32_t slot = 0; slot < n; ++slot) {
    for (uint32_t i = 0; i < 3; ++i) {
      const Edge& e = find(ends_of(slot, i).first);
      if (e.uses[0] > 1 || e.uses[1] > 1) triangles_[slot].opposite[i] = kNone32;
    }
  }
}

void Patch::PartSheets(std::span<const uint8_t> two_sided, const Seams& seams) {
  for (uint32_t slot = 0; slot < two_sided.size(); ++slot) {
    for (uint32_t& o : triangles_[slot].opposite) {
      if (o != kNone32 && two_sided[o >> 2] != two_sided[slot]) o = kNone32;
    }
  }
  const auto part = [&](uint32_t slot, uint32_t i) {
    uint32_t& o = triangles_[slot].opposite[i];
    if (o == kNone32) return;
    triangles_[o >> 2].opposite[o & 3] = kNone32;
    o = kNone32;
  };
  for (uint32_t slot = 0; 3 * size_t{slot} < seams.corners.size(); ++slot) {
    for (uint32_t i = 0; i < 3; ++i) {
      const uint32_t o = triangles_[slot].opposite[i];
      if (o == kNone32) continue;
      const size_t here = 3 * size_t{slot}, there = 3 * size_t{o >> 2};
      const uint32_t next = i == 2 ? 0 : i + 1, other_next = (o & 3) == 2 ? 0 : (o & 3) + 1;
      if (seams.corners[here + i] != seams.corners[there + other_next] ||
          seams.corners[here + next] != seams.corners[there + (o & 3)]) {
        part(slot, i);
      }
    }
  }
  for (const uint32_t h : seams.hidden) part(h >> 2, h & 3);
}

void Patch::Grow(size_t slots) {
  auto larger = std::make_unique_for_overwrite<Triangle[]>(slots);
  std::copy_n(triangles_.get(), slots_, larger.get());
  triangles_ = std::move(larger);
  removers_.resize(slots, kNone32);
}

void Patch::OpenStar(const Hole& hole) {
  Triangle* const triangles = triangles_.get();
  const uint32_t count = hole.ring_count - 1;
  const uint32_t first = slots_ - hole.ring_count;
  const uint32_t apex = triangles[first].corners[0];
  slots_ = first + count;
  for (uint32_t j = 0; j < count; ++j) {
    AddStarTriangle(triangles, 4 * (first + j), apex, hole.ring[j], hole.outer[j]);
    triangles[first + j].corners[2] = hole.ring[j + 1];
  }
  triangles[first].opposite[0] = kNone32;
  triangles[first + count - 1].opposite[2] = kNone32;
  // A split edge's neighbour, if any, is a neighbour no more.
  if (const uint32_t o = hole.outer[count]; o != kNone32) {
    triangles[o >> 2].opposite[o & 3] = kNone32;
  }
}

namespace {
constexpr uint32_t kCreaseLists = 4096;

uint64_t EndsKey(uint32_t a, uint32_t b) { return uint64_t{std::max(a, b)} << 32 | std::min(a, b); }
size_t CreaseList(uint64_t ends) { return Mix64(ends) % kCreaseLists; }
}  // namespace

void Patch::NoteCrease(uint32_t half_edge) {
  const Triangle& t = triangles_[half_edge >> 2];
  const uint32_t i = half_edge & 3;
  if (t.opposite[i] != kNone32) return;
  const uint64_t ends = EndsKey(t.corners[i], t.corners[i == 2 ? 0 : i + 1]);
  uint32_t& list = crease_lists_[CreaseList(ends)];
  creases_.push_back({ends, half_edge, list});
  list = static_cast<uint32_t>(creases_.size() - 1);
}

void Patch::IndexCreases() {
  crease_lists_.assign(kCreaseLists, kNone32);
  for (uint32_t slot = 0; slot < slots_; ++slot) {
    for (uint32_t i = 0; i < 3; ++i) NoteCrease(4 * slot + i);
  }
}

void Patch::NoteCreases(const Hole& hole, bool boundary) {
  const uint32_t count = hole.ring_count - (boundary ? 1 : 0);
  const uint32_t first = slots_ - count;
  for (uint32_t slot = first; slot < slots_; ++slot) NoteCrease(4 * slot + 1);
  if (!boundary) return;
  NoteCrease(4 * first);
  NoteCrease(4 * (slots_ - 1) + 2);
  if (const uint32_t o = hole.outer[count]; o != kNone32) NoteCrease(o);
}

// What is gone leaves its list on the way.
std::span<const uint32_t> Patch::FindCrease(uint32_t a, uint32_t b) {
  crease_.clear();
  const uint64_t ends = EndsKey(a, b);
  for (uint32_t* link = &crease_lists_[CreaseList(ends)]; *link != kNone32;) {
    const Crease& c = creases_[*link];
    ++crease_steps_;
    const uint32_t h = c.half_edge;
    if (removers_[h >> 2] != kNone32 || triangles_[h >> 2].opposite[h & 3] != kNone32) {
      *link = c.next;
      continue;
    }
    if (c.ends == ends) crease_.push_back(h);
    link = &creases_[*link].next;
  }
  std::sort(crease_.begin(), crease_.end());
  return crease_;
}

// Lengths and bluntnesses of the triangles of slots begin .. end - 1; SharpnessClasses become 0.
void Patch::Measure(uint32_t begin, uint32_t end) {
  Triangle* const triangles = triangles_.get();
  const Word4* const points = points_.data();
  // A length class is a difference of exponents, of lengths that are clamped to eight octaves.
  const Float4 shortest = Float4{} + std::bit_cast<float>(shortest_ << 23);
  const Float4 longest = Float4{} + std::bit_cast<float>((shortest_ + kClasses - 1) << 23);
  const Int4 base = Int4{} + static_cast<int32_t>(shortest_ * 0x01010101);
  const auto exponent = [&](Float4 squared) {
    return reinterpret_cast<Word4>(Min4(Max4(squared, shortest), longest)) >> 23;
  };
  for (uint32_t slot = begin; slot < end; slot += 4) {
    Float4 edges[3][4];
    for (uint32_t i = 0; i < 4; ++i) {
      const auto& c = triangles[std::min(slot + i, end - 1)].corners;
      const Word4 p = points[c[0]];
      const Word4 q = points[c[1]];
      const Word4 r = points[c[2]];
      edges[0][i] = Offset4(q, p);
      edges[1][i] = Offset4(r, q);
      edges[2][i] = Offset4(p, r);
    }
    const Float4 a = SquaredLengths(edges[0][0], edges[0][1], edges[0][2], edges[0][3], height_);
    const Float4 b = SquaredLengths(edges[1][0], edges[1][1], edges[1][2], edges[1][3], height_);
    const Float4 c = SquaredLengths(edges[2][0], edges[2][1], edges[2][2], edges[2][3], height_);
    // Little-endian words of shape and longest, of bluntness and error_code.
    const Word4 classes =
        (exponent(a) | exponent(b) << 8 | exponent(c) << 16 | exponent(Max4(Max4(a, b), c)) << 24) -
        reinterpret_cast<Word4>(base);
    const Word4 shape = (classes & 0xff000000) | (classes & 0x00ffffff) << 3;
    const Int4 bluntness = Bluntness(a, b, c) | Bluntness(b, c, a) << 8 | Bluntness(c, a, b) << 16;
    for (uint32_t i = 0; i < std::min(4u, end - slot); ++i) {
      const uint32_t words[2] = {shape[i], static_cast<uint32_t>(bluntness[i])};
      std::memcpy(&triangles[slot + i].shape, words, sizeof(words));
    }
  }
}

void Patch::EndGeneration(std::span<const uint8_t> codes) {
  const uint32_t end = slots();
  if (shapes_) Measure(shaped_, end);
  Triangle* const triangles = triangles_.get();
  const uint8_t* const code_of_apex = codes.data() - first_apex_;
  for (uint32_t slot = shaped_; slot < end; ++slot) {
    Triangle& t = triangles[slot];
    t.error_code = code_of_apex[t.corners[0]];
    if (!shapes_) continue;
    // Half-edge 2 of a star's triangle lies opposite half-edge 0 of another one. Both had no class.
    if (const uint32_t o = t.opposite[0]; o != kNone32) {
      Triangle& before = triangles[o >> 2];
      const uint8_t sharpness = kSharpnessClass[t.bluntness[0] + before.bluntness[2]];
      t.shape[0] = static_cast<uint8_t>(t.shape[0] | sharpness);
      before.shape[2] = static_cast<uint8_t>(before.shape[2] | sharpness);
    }
    ShareSharpness(triangles, t, 1);
  }
  shaped_ = end;
}

}  // namespace mtdb
