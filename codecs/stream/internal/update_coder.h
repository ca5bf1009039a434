// SPDX-License-Identifier: Apache-2.0
// UpdateCoder: single updates of a client's mesh, as sender and client replay them. A template on
// the coder (rans.h), so that what is written is what is read. Specified in codecs/FORMAT.md.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <span>
#include <vector>

#include "codecs/coding/attribute_coder.h"
#include "codecs/coding/cluster_model.h"
#include "codecs/coding/hole_frame.h"
#include "codecs/coding/rans.h"
#include "codecs/stream/internal/memory_bytes.h"
#include "codecs/stream/internal/replayed_mesh.h"
#include "store/base/ids.h"

namespace mtdb::internal {

inline constexpr std::array<char, 4> kUpdateMagic = {'M', 'T', 'U', 'S'};
inline constexpr uint8_t kUpdateVersion = 8;
inline constexpr size_t kMostListedHoles = 30;  // of one vertex
inline constexpr uint64_t kMaxRecordBytes = uint64_t{1} << 28;

// What a record does, in 64ths of a byte. A record is padded with zeros until it is no shorter than
// its cost, and a longer cost is refused: a bound on the time and the memory that hostile bytes
// take.
class RecordCost {
 public:
  static constexpr uint64_t kPerByte = 64;
  explicit RecordCost(size_t row_bytes) : vertex_(kPerByte / 2 + row_bytes / 4) {}
  void AddUpdates(uint64_t count) { cost_ += count; }
  void AddVertex() { cost_ += vertex_; }  // one that travels, with its row
  void AddAttached() { cost_ += kPerByte / 4; }
  uint64_t bytes() const { return (cost_ + kPerByte - 1) / kPerByte; }

 private:
  uint64_t vertex_;
  uint64_t cost_ = 0;
};

struct NumberModel {
  FastAdaptiveSymbol length;
};

using ResidualModel = AdaptiveSymbolOfRate<6>;

// What clip_coder.h codes with.
struct ClipModels {
  AdaptiveBit more_drops, more_seeds, at_edge;
  NumberModel drop_gap, edge_gap, reference, coordinate;
  std::array<AdaptiveBit, 64> drop;  // see DropWalk::Context
  std::array<AdaptiveBit, 128>
      attach;  // two classes of ends; whether the last edge was attached to
  std::array<AdaptiveBit, 64> near_end, far_end, fresh;  // two classes of ends
  // By coordinate u, v, n; by the sharpest angle at the edge's ends, or the residual before.
  std::array<std::array<ResidualModel, 4>, 3> residual;
  // 256 times how many half octaves the residuals are larger than the longest edge.
  std::array<int32_t, 3> spread = {-512, -512, -1024};
};

// What delaunay_coder.h codes with.
struct DelaunayModels {
  AdaptiveBit ruled, insert, fresh, begin, next, careful;
  NumberModel vertex_gap, anchor_gap, across, up;
  std::array<std::array<AdaptiveBit, 2>, 12> split;  // places; whether one got none nearby
  std::array<FastAdaptiveSymbol, 8> rank;            // by how many places there are
  std::array<AdaptiveSymbolOfRate<6>, 32> height;    // by what is around
};

// Models that last as long as the stream.
struct UpdateModels {
  explicit UpdateModels(const AttributeLayout& attributes) : attribute_coder(attributes) {}
  TopologyModel topology;
  PositionModel positions;
  AttributeCoder attribute_coder;
  AdaptiveBit more, other, clip, insert, fresh;
  AdaptiveBit again;  // a remembered vertex comes back to the triangles that its removal left
  AdaptiveBit known;  // a remembered vertex comes back elsewhere
  NumberModel count, anchor_gap, vertex_gap;
  ClipModels clips;
  DelaunayModels delaunay;
  std::array<std::array<AdaptiveBit, 8>, 8> apex;  // candidates left, rank
  int32_t reference = 0;  // 256 times the typical exponent of a star's squared longest edge
};

// The triangles that the last batch of insertions made, which are born one after the other.
class FreshTriangles {
 public:
  size_t size() const { return slots_.size(); }
  uint32_t slot(size_t i) const { return slots_[i]; }
  // Which one was born then; any number of at least size() for none of them.
  uint64_t NumberOf(uint64_t born) const { return born - first_born_; }
  // Whether triangle i is still there.
  bool IsThere(const ReplayedMesh& mesh, size_t i) const {
    return mesh.triangle(slots_[i]).born() == first_born_ + i;
  }
  // Asks for the memory that will be needed soon, when triangle i is at hand. Beyond its edge 1 is
  // what is no triangle of its star.
  [[gnu::always_inline]] void Prefetch(const ReplayedMesh& mesh, size_t i) const {
    if constexpr (!ReplayedMesh::kPrefetches) return;
    if (i + 2 * kAhead < slots_.size()) mesh.PrefetchTriangle(slots_[i + 2 * kAhead]);
    if (i + kAhead >= slots_.size()) return;
    const uint32_t o = mesh.triangle(slots_[i + kAhead]).opposite[1];
    if (o != kNone32) mesh.PrefetchTriangle(o >> 2);
  }
  // Likewise of a hole there, for whoever does not know which of them are anchors.
  [[gnu::always_inline]] void PrefetchHole(const ReplayedMesh& mesh, size_t i) const {
    if constexpr (!ReplayedMesh::kPrefetches) return;
    if (i + kAhead / 2 >= slots_.size()) return;
    const uint32_t slot = slots_[i + kAhead / 2];
    mesh.PrefetchCorners(slot);
    const uint32_t o = mesh.triangle(slot).opposite[1];
    if (o == kNone32) return;
    mesh.PrefetchCorners(o >> 2);
    mesh.PrefetchBeyond(o >> 2);
  }
  static constexpr size_t kAhead = 16;
  // Of the batch that begins.
  void Clear(const ReplayedMesh& mesh) {
    slots_.clear();
    first_born_ = mesh.next_born();
  }
  std::vector<uint32_t>& slots() { return slots_; }
  size_t memory_bytes() const { return CapacityBytes(slots_); }

 private:
  std::vector<uint32_t> slots_;
  uint64_t first_born_ = 0;
};

// The corners that an update is made of, with room for the largest.
struct UpdateHole {
  uint32_t slot_room[kHoleEntries];
  uint32_t ring_room[kHoleEntries];
  Patch::Hole hole{slot_room, ring_room};
  bool boundary = false;
  bool listed = false;  // hole.outer is not known

  UpdateHole() = default;
  UpdateHole(const UpdateHole&) = delete;
  UpdateHole& operator=(const UpdateHole&) = delete;
};

// A number, mostly small, as its length and its bits below the top one.
template <typename Coder>
uint32_t CodeNumber(Coder& coder, NumberModel& model, uint32_t value) {
  uint32_t length = static_cast<uint32_t>(std::bit_width(value));
  if (const uint32_t s = coder.Symbol(model.length, std::min(length, 15u)); s < 15) {
    length = s;
  } else {
    length = 15 + coder.Raw(5, length - 15);
  }
  if (length <= 1) return length;
  if (length > 32) length = 32;
  const int low = static_cast<int>(length) - 1;
  return 1u << low | coder.Raw(low, value & ((1u << low) - 1));
}

// ---- slots ----

// The slots of updates travel before the updates, so many at a time, so that a reader can ask for
// the memory of some while it works on those before.
inline constexpr size_t kSlotGroup = 256;

// Codes ascending slots; `next`: the least that may come. False on what can be none.
template <typename Coder>
bool CodeSlots(Coder& coder, NumberModel& gap, uint64_t& next, std::span<uint32_t> slots) {
  for (uint32_t& slot : slots) {
    const uint64_t coded = next + CodeNumber(coder, gap, slot - static_cast<uint32_t>(next));
    if (coded >= kNone32) return false;
    slot = static_cast<uint32_t>(coded);
    next = coded + 1;
  }
  return true;
}

// Asks for the memory that the update at slot i of a group needs, for some slots behind i: those
// of anchors, or of vertices to be removed. The slots may be hostile.
[[gnu::always_inline]] inline void PrefetchAnchors(const ReplayedMesh& mesh,
                                                   std::span<const uint32_t> slots, size_t i) {
  if constexpr (!ReplayedMesh::kPrefetches) return;
  constexpr size_t kAhead = 4;
  const auto is_slot = [&](size_t k) {
    return k < slots.size() && slots[k] < mesh.triangle_slots();
  };
  if (is_slot(i + 2 * kAhead)) mesh.PrefetchTriangle(slots[i + 2 * kAhead]);
  if (!is_slot(i + kAhead)) return;
  mesh.PrefetchBeyond(slots[i + kAhead]);
  mesh.PrefetchCorners(slots[i + kAhead]);
}
[[gnu::always_inline]] inline void PrefetchStars(const ReplayedMesh& mesh,
                                                 std::span<const uint32_t> vertices, size_t i) {
  if constexpr (!ReplayedMesh::kPrefetches) return;
  constexpr size_t kAhead = 4;
  const auto is_vertex = [&](size_t k) {
    return k < vertices.size() && vertices[k] < mesh.vertex_slots();
  };
  const auto triangle_at = [&](size_t k) {
    const uint32_t slot = is_vertex(k) ? mesh.half_edge_of(vertices[k]) >> 2 : kNone32;
    return slot < mesh.triangle_slots() ? slot : kNone32;
  };
  if (is_vertex(i + 3 * kAhead)) mesh.PrefetchVertex(vertices[i + 3 * kAhead]);
  if (const uint32_t t = triangle_at(i + 2 * kAhead); t != kNone32) mesh.PrefetchTriangle(t);
  if (const uint32_t t = triangle_at(i + kAhead); t != kNone32) {
    mesh.PrefetchBeyond(t);
    mesh.PrefetchCorners(t);
  }
}

// ---- walks ----

// Whether numbers occur twice, as far as their last bits tell.
class SmallSet {
 public:
  bool MayHave(uint32_t number) const { return (bits_ >> (number & 63) & 1) != 0; }
  void Add(uint32_t number) { bits_ |= uint64_t{1} << (number & 63); }

 private:
  uint64_t bits_ = 0;
};

inline bool Has(std::span<const uint32_t> numbers, uint32_t number) {
  return std::find(numbers.begin(), numbers.end(), number) != numbers.end();
}

// Whether a hole that was walked is a disc.
inline bool IsDisc(const Patch::Hole& hole) {
  for (uint32_t j = 0; j < hole.ring_count; ++j) {
    const uint32_t o = hole.outer[j];
    if (o != kNone32 && Has(hole.slot_span(), o >> 2)) return false;
    if (Has(hole.ring_span().first(j), hole.ring[j])) return false;
  }
  return true;
}

// As Patch::WalkHole: the hole of the anchor across the edges that `take(count, slot, half_edge)`
// says. False when it is no disc, or too large.
template <typename Take>
[[gnu::always_inline]] inline bool WalkHole(const ReplayedMesh& mesh, uint32_t anchor,
                                            UpdateHole& out, Take&& take) {
  Patch::Hole& hole = out.hole;
  uint32_t stack[kMaxRing];
  uint32_t depth = 2;
  stack[0] = 4 * anchor + 2;
  stack[1] = 4 * anchor + 1;
  hole.slots[0] = anchor;
  hole.slot_count = 1;
  hole.ring_count = 0;
  out.boundary = out.listed = false;
  SmallSet slots;
  SmallSet corners;
  slots.Add(anchor);
  bool repeats = false;
  for (uint32_t h = 4 * anchor;;) {
    const ReplayedMesh::Triangle& t = mesh.triangle(h >> 2);
    const uint32_t o = t.opposite[h & 3];
    if (o != kNone32 && take(hole.slot_count, o >> 2, h)) {
      if (hole.slot_count + 2 >= kMaxRing || Has(hole.slot_span(), o >> 2)) return false;
      hole.slots[hole.slot_count++] = o >> 2;
      slots.Add(o >> 2);
      h = Patch::Next(o);
      stack[depth++] = Patch::Next(h);
      continue;
    }
    const uint32_t corner = t.corners[h & 3];
    repeats |= corners.MayHave(corner);
    corners.Add(corner);
    hole.ring[hole.ring_count] = corner;
    hole.outer[hole.ring_count++] = o;
    if (depth == 0) break;
    h = stack[--depth];
  }
  for (uint32_t j = 0; j < hole.ring_count; ++j) repeats |= slots.MayHave(hole.outer[j] >> 2);
  return !repeats || IsDisc(hole);
}

// The star of a vertex and its ring, from the half-edge that the mesh names; of a boundary vertex
// from the border on. False when the triangles at the vertex are not one fan of some that fit.
inline bool WalkStar(const ReplayedMesh& mesh, uint32_t vertex, UpdateHole& out) {
  Patch::Hole& star = out.hole;
  uint32_t h = mesh.half_edge_of(vertex);
  const auto leaves = [&](uint32_t half_edge) {
    return mesh.has_triangle(half_edge >> 2) &&
           mesh.triangle(half_edge >> 2).corners[half_edge & 3] == vertex;
  };
  if (h == kNone32 || !leaves(h) || mesh.degree(vertex) > kMaxRing) return false;
  const uint32_t start = h;
  uint32_t steps = 0;
  out.boundary = out.listed = false;
  for (;; ++steps) {
    const uint32_t o = mesh.triangle(h >> 2).opposite[h & 3];
    if (o == kNone32) {
      out.boundary = true;
      break;
    }
    h = Patch::Next(o);
    if (h == start) break;
    if (steps > kMaxRing || !leaves(h)) return false;
  }
  star.slot_count = star.ring_count = 0;
  const uint32_t first = h;
  for (;;) {
    if (star.ring_count + 2 > kMaxRing + 1) return false;
    const ReplayedMesh::Triangle& t = mesh.triangle(h >> 2);
    const uint32_t toward = Patch::Next(Patch::Next(h));
    star.slots[star.slot_count++] = h >> 2;
    star.ring[star.ring_count++] = t.corners[Patch::Next(h) & 3];
    h = t.opposite[toward & 3];
    if (h == kNone32) {
      star.ring[star.ring_count++] = t.corners[toward & 3];
      break;
    }
    if (h == first) break;
    if (!leaves(h)) return false;
  }
  if (star.ring_count > kMaxRing || star.ring_count < 3 || star.slot_count != mesh.degree(vertex) ||
      out.boundary != (star.ring_count > star.slot_count)) {
    return false;
  }
  for (uint32_t j = 0; j < star.ring_count; ++j) {
    for (uint32_t i = 0; i < j; ++i) {
      if (star.ring[i] == star.ring[j]) return false;
    }
  }
  return true;
}

// ---- shapes: the contexts of a Patch ----

class UpdateShapes {
 public:
  UpdateShapes(const ReplayedMesh& mesh, const UpdateModels& models)
      : mesh_(mesh), shortest_((models.reference >> 8) - 3) {}

  // LengthClass << 3 | SharpnessClass; the half-edge has an opposite.
  uint32_t Shape(uint32_t h) const {
    const ReplayedMesh::Triangle& t = mesh_.triangle(h >> 2);
    return LengthClass(t.exponents[h & 3]) << 3 | SharpnessClass(t, h & 3);
  }
  // What an anchor's context is made of: opposites that are older than the slot are 0.
  Patch::Triangle AnchorView(uint32_t slot) const {
    const ReplayedMesh::Triangle& t = mesh_.triangle(slot);
    const uint64_t born = t.born();
    Patch::Triangle view;
    uint32_t longest = 0;
    for (uint32_t i = 0; i < 3; ++i) {
      longest = std::max(longest, LengthClass(t.exponents[i]));
      view.opposite[i] = kNone32;
      view.shape[i] = 0;
      if (t.opposite[i] == kNone32) continue;
      if (mesh_.triangle(t.opposite[i] >> 2).born() < born) view.opposite[i] = 0;
      view.shape[i] = SharpnessClass(t, i);
    }
    view.longest = static_cast<uint8_t>(longest);
    return view;
  }
  // The exponent of the squared longest edge.
  int LongestExponent(uint32_t slot) const {
    int longest = 0;
    for (const uint8_t e : mesh_.triangle(slot).exponents) {
      longest = std::max<int>(longest, e == ReplayedMesh::Triangle::kNoLength ? 0 : e);
    }
    return longest;
  }

 private:
  uint32_t LengthClass(uint8_t exponent) const {
    return exponent == ReplayedMesh::Triangle::kNoLength
               ? 0
               : static_cast<uint32_t>(std::clamp(exponent - shortest_, 0, 7));
  }
  uint8_t SharpnessClass(const ReplayedMesh::Triangle& t, uint32_t i) const {
    // Of the sum of two bluntnesses.
    static constexpr auto kClasses = [] {
      std::array<uint8_t, 256> classes{};
      for (int sum = 0; sum < 256; ++sum) {
        classes[static_cast<size_t>(sum)] =
            static_cast<uint8_t>(std::clamp((248 - sum) / 16 - 5, 0, 7));
      }
      return classes;
    }();
    const uint32_t o = t.opposite[i];
    return kClasses[t.bluntness[i] + mesh_.triangle(o >> 2).bluntness[o & 3]];
  }

  const ReplayedMesh& mesh_;
  const int shortest_;
};

// The length at hand changes the typical one.
inline void AdaptReference(UpdateModels& models, int exponent) {
  models.reference += (exponent * 256 - models.reference) >> 6;
}

// UpdateModels::reference for a base mesh.
inline int32_t UpdateReference(const ReplayedMesh& mesh) {
  const UpdateModels models{{}};
  const UpdateShapes shapes(mesh, models);
  int64_t sum = 0;
  for (uint32_t slot = 0; slot < mesh.triangle_slots(); ++slot) {
    sum += shapes.LongestExponent(slot);
  }
  return mesh.triangle_slots() == 0 ? 0 : static_cast<int32_t>(sum * 256 / mesh.triangle_slots());
}

// ---- removals: how a star's polygon is cut into triangles ----

struct RankedApexes {
  std::array<std::pair<float, uint32_t>, kMaxRing> at;  // measures and places
  uint32_t count = 0;
};

// The candidates for the third corner of edge (i, j), of which the one that sees it under the
// largest angle is the likeliest, as in a Delaunay triangulation.
inline void RankApexes(const ReplayedMesh& mesh, std::span<const uint32_t> ring, uint32_t i,
                       uint32_t j, RankedApexes& ranked) {
  ranked.count = 0;
  for (uint32_t m = i + 1; m < j; ++m) {
    const Float4 a = Offset4(mesh.points()[ring[i]], mesh.points()[ring[m]]);
    const Float4 b = Offset4(mesh.points()[ring[j]], mesh.points()[ring[m]]);
    const float dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const float aa = a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
    const float bb = b[0] * b[0] + b[1] * b[1] + b[2] * b[2];
    const float cosine = aa > 0 && bb > 0 ? (dot / aa) * (dot / bb) : 1;
    ranked.at[ranked.count++] = {dot < 0 ? 0 - cosine : cosine, m};
  }
  std::sort(ranked.at.begin(), ranked.at.begin() + ranked.count);
}

// The triangles of the polygon's part from corner i to corner j. `apex_of(i, j)`: the encoder's
// third corner of the edge.
template <typename Coder, typename ApexOf>
void CodePolygon(Coder& coder, UpdateModels& models, const ReplayedMesh& mesh,
                 std::span<const uint32_t> ring, ApexOf&& apex_of,
                 std::vector<std::array<uint32_t, 3>>& places) {
  std::array<std::pair<uint32_t, uint32_t>, kMaxRing> open;
  open[0] = {0, static_cast<uint32_t>(ring.size()) - 1};
  RankedApexes ranked;
  places.clear();
  for (uint32_t depth = 1; depth > 0;) {
    const auto [i, j] = open[--depth];
    if (j - i < 2) continue;
    RankApexes(mesh, ring, i, j, ranked);
    const uint32_t apex = apex_of(i, j);
    const uint32_t count = ranked.count;
    uint32_t rank = 0;
    while (rank + 1 < count) {
      AdaptiveBit& model = models.apex[std::min(count, 7u)][std::min(rank, 7u)];
      if (coder.Bit(model, ranked.at[rank].second == apex)) break;
      ++rank;
    }
    const uint32_t m = ranked.at[rank].second;
    places.push_back({i, m, j});
    open[depth++] = {m, j};
    open[depth++] = {i, m};
  }
}

// Cuts the star's polygon into the triangles that `places` names by places in the ring. Appends
// their slots.
inline void RemoveStar(ReplayedMesh& mesh, const UpdateHole& update, uint32_t vertex,
                       std::span<const std::array<uint32_t, 3>> places,
                       std::vector<uint32_t>* slots) {
  const std::span<const uint32_t> ring = update.hole.ring_span();
  if (!update.listed) {
    mesh.ReplaceStar(update.hole.slot_span(), ring, places, vertex, update.boundary, slots);
    return;
  }
  std::vector<std::array<uint32_t, 3>> triangles;
  for (const auto& p : places) triangles.push_back({ring[p[0]], ring[p[1]], ring[p[2]]});
  mesh.Replace(update.hole.slot_span(), triangles, vertex, slots);
}

// What is remembered of a removed vertex: where the ring begins of one at the border.
inline uint32_t FirstOfRing(const UpdateHole& update) {
  return update.boundary ? update.hole.ring[0] : kNone32;
}

// ---- insertions ----

// Codes the residuals of the vertex against its hole.
template <typename Coder>
void CodePosition(Coder& coder, UpdateModels& models, const ReplayedMesh& mesh,
                  const UpdateHole& update, Vec3i& p) {
  const Patch::Hole& hole = update.hole;
  HoleFrame frame;
  frame.Set(mesh, hole.slot_span(), hole.ring_span(), update.boundary);
  const size_t ring_class = PositionModel::RingClass(hole.ring_count, update.boundary);
  const auto code = [&](size_t which, int axis, int32_t expected, float variance) {
    const auto base = static_cast<uint32_t>(expected);
    const auto residual = static_cast<int32_t>(static_cast<uint32_t>(p[axis]) - base);
    const int32_t coded =
        models.positions.CodeScaled(coder, coder, which, ring_class, variance, residual);
    p[axis] = static_cast<int32_t>(base + static_cast<uint32_t>(coded));
  };
  code(0, frame.axis_u(), frame.ExpectU(), frame.variance_u());
  code(1, frame.axis_v(), frame.ExpectV(p[frame.axis_u()]), frame.variance_v());
  code(2, frame.axis_n(),
       frame.ExpectN(mesh, hole.slot_span(), p[frame.axis_u()], p[frame.axis_v()]),
       frame.unevenness(mesh, hole.ring_span()));
}

// What attributes are predicted from; fills `positions`, which the result names.
inline AttributeCoder::Star AttributeStar(const ReplayedMesh& mesh, const UpdateHole& update,
                                          Vec3i p, std::vector<Vec3i>* positions) {
  positions->clear();
  for (const uint32_t v : update.hole.ring_span()) positions->push_back(mesh.position(v));
  return {p, update.hole.ring_span(), *positions};
}

// Puts the star in the place of the hole. Appends the slots of its triangles, in ring order.
inline void InsertStar(ReplayedMesh& mesh, UpdateModels& models, const UpdateHole& update,
                       uint32_t vertex, std::vector<uint32_t>* slots) {
  const std::span<const uint32_t> ring = update.hole.ring_span();
  if (!update.listed) {
    mesh.ReplaceByStar(update.hole.slot_span(), ring, update.hole.outer, vertex, update.boundary,
                       slots);
  } else {
    std::vector<std::array<uint32_t, 3>> star;
    for (size_t j = 0; j < ring.size() - (update.boundary ? 1 : 0); ++j) {
      star.push_back({vertex, ring[j], ring[j + 1 == ring.size() ? 0 : j + 1]});
    }
    mesh.Replace(update.hole.slot_span(), star, kNone32, slots);
  }
  AdaptReference(models, UpdateShapes(mesh, models).LongestExponent(slots->back()));
}

// The hole of a remembered vertex that comes back to the triangles that its removal left.
inline bool WalkAgain(const ReplayedMesh& mesh, uint32_t anchor, uint32_t vertex,
                      UpdateHole& update) {
  if (!WalkHole(mesh, anchor, update, [&](uint32_t, uint32_t slot, uint32_t) {
        return mesh.triangle(slot).fills == vertex;
      })) {
    return false;
  }
  const uint32_t first = mesh.first_of_ring(vertex);
  update.boundary = first != kNone32;
  if (!update.boundary) return true;
  const std::span<const uint32_t> ring = update.hole.ring_span();
  const auto at = static_cast<size_t>(std::find(ring.begin(), ring.end(), first) - ring.begin());
  if (at == ring.size()) return false;
  update.hole.Rotate(at == 0 ? ring.size() - 1 : at - 1);
  return true;
}

}  // namespace mtdb::internal
