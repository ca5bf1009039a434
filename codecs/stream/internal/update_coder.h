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
#include "codecs/stream/internal/replayed_mesh.h"
#include "store/base/ids.h"

namespace mtdb::internal {

inline constexpr std::array<char, 4> kUpdateMagic = {'M', 'T', 'U', 'S'};
inline constexpr uint8_t kUpdateVersion = 4;
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

// The corners that an update is made of, with room for the largest.
struct UpdateHole {
  uint32_t slot_room[kHoleEntries];
  uint32_t ring_room[kHoleEntries];
  Patch::Hole hole{slot_room, ring_room};
  bool boundary = false;
  bool listed = false;  // hole.outer is not known
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

// ---- walks ----

// As Patch::WalkHole: the hole of the anchor across the edges that `take(count, slot, half_edge)`
// says. False when it is no disc, or too large.
template <typename Take>
bool WalkHole(const ReplayedMesh& mesh, uint32_t anchor, UpdateHole& out, Take&& take) {
  Patch::Hole& hole = out.hole;
  uint32_t stack[kMaxRing + 2] = {4 * anchor + 2, 4 * anchor + 1, 4 * anchor};
  uint32_t depth = 3;
  hole.slots[0] = anchor;
  hole.slot_count = 1;
  hole.ring_count = 0;
  const auto has = [&](uint32_t slot) {
    return std::find(hole.slots, hole.slots + hole.slot_count, slot) !=
           hole.slots + hole.slot_count;
  };
  while (depth > 0) {
    const uint32_t h = stack[--depth];
    const ClientMesh::Triangle& t = mesh.triangle(h >> 2);
    const uint32_t o = t.opposite[h & 3];
    if (o != kNone32 && take(hole.slot_count, o >> 2, h)) {
      if (hole.slot_count + 2 >= kMaxRing || has(o >> 2)) return false;
      hole.slots[hole.slot_count++] = o >> 2;
      stack[depth++] = Patch::Next(Patch::Next(o));
      stack[depth++] = Patch::Next(o);
      continue;
    }
    hole.ring[hole.ring_count] = t.corners[h & 3];
    hole.outer[hole.ring_count++] = o;
  }
  for (uint32_t j = 0; j < hole.ring_count; ++j) {
    if (hole.outer[j] != kNone32 && has(hole.outer[j] >> 2)) return false;
    for (uint32_t i = 0; i < j; ++i) {
      if (hole.ring[i] == hole.ring[j]) return false;
    }
  }
  return true;
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
  out.boundary = false;
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
    const ClientMesh::Triangle& t = mesh.triangle(h >> 2);
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
    return LengthClass(mesh_.triangle(h >> 2).exponents[h & 3]) << 3 | SharpnessClass(h);
  }
  // What an anchor's context is made of: opposites that are older than the slot are 0.
  Patch::Triangle AnchorView(uint32_t slot) const {
    const ClientMesh::Triangle& t = mesh_.triangle(slot);
    Patch::Triangle view{};
    for (uint32_t i = 0; i < 3; ++i) {
      view.longest = std::max(view.longest, static_cast<uint8_t>(LengthClass(t.exponents[i])));
      const uint32_t o = t.opposite[i];
      const bool older = o != kNone32 && mesh_.triangle(o >> 2).born < t.born;
      view.opposite[i] = older ? 0 : kNone32;
      if (older) view.shape[i] = static_cast<uint8_t>(SharpnessClass(4 * slot + i));
    }
    return view;
  }
  // The exponent of the squared longest edge.
  int LongestExponent(uint32_t slot) const {
    int longest = 0;
    for (const uint8_t e : mesh_.triangle(slot).exponents) {
      longest = std::max<int>(longest, e == ClientMesh::Triangle::kNoLength ? 0 : e);
    }
    return longest;
  }

 private:
  uint32_t LengthClass(uint8_t exponent) const {
    return exponent == ClientMesh::Triangle::kNoLength
               ? 0
               : static_cast<uint32_t>(std::clamp(exponent - shortest_, 0, 7));
  }
  uint32_t SharpnessClass(uint32_t h) const {
    const ClientMesh::Triangle& t = mesh_.triangle(h >> 2);
    const uint32_t o = t.opposite[h & 3];
    const int sum = t.bluntness[h & 3] + mesh_.triangle(o >> 2).bluntness[o & 3];
    return static_cast<uint32_t>(std::clamp((248 - sum) / 16 - 5, 0, 7));
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

// The candidates for the third corner of edge (i, j), of which the one that sees it under the
// largest angle is the likeliest, as in a Delaunay triangulation.
inline void RankApexes(const ReplayedMesh& mesh, std::span<const uint32_t> ring, uint32_t i,
                       uint32_t j, std::vector<std::pair<float, uint32_t>>& ranked) {
  ranked.clear();
  for (uint32_t m = i + 1; m < j; ++m) {
    const Float4 a = Offset4(mesh.points()[ring[i]], mesh.points()[ring[m]]);
    const Float4 b = Offset4(mesh.points()[ring[j]], mesh.points()[ring[m]]);
    const float dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const float aa = a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
    const float bb = b[0] * b[0] + b[1] * b[1] + b[2] * b[2];
    const float cosine = aa > 0 && bb > 0 ? (dot / aa) * (dot / bb) : 1;
    ranked.emplace_back(dot < 0 ? 0 - cosine : cosine, m);
  }
  std::sort(ranked.begin(), ranked.end());
}

// The triangles of the polygon's part from corner i to corner j. `apex_of(i, j)`: the encoder's
// third corner of the edge.
template <typename Coder, typename ApexOf>
void CodePolygon(Coder& coder, UpdateModels& models, const ReplayedMesh& mesh,
                 std::span<const uint32_t> ring, ApexOf&& apex_of,
                 std::vector<std::array<uint32_t, 3>>& places) {
  std::vector<std::pair<uint32_t, uint32_t>> open{{0, static_cast<uint32_t>(ring.size()) - 1}};
  std::vector<std::pair<float, uint32_t>> ranked;
  places.clear();
  while (!open.empty()) {
    const auto [i, j] = open.back();
    open.pop_back();
    if (j - i < 2) continue;
    RankApexes(mesh, ring, i, j, ranked);
    const uint32_t apex = apex_of(i, j);
    const auto count = static_cast<uint32_t>(ranked.size());
    uint32_t rank = 0;
    while (rank + 1 < count) {
      AdaptiveBit& model = models.apex[std::min(count, 7u)][std::min(rank, 7u)];
      if (coder.Bit(model, ranked[rank].second == apex)) break;
      ++rank;
    }
    const uint32_t m = ranked[rank].second;
    places.push_back({i, m, j});
    open.emplace_back(m, j);
    open.emplace_back(i, m);
  }
}

// Cuts the star's polygon into the triangles that `places` names by places in the ring.
inline void RemoveStar(ReplayedMesh& mesh, const UpdateHole& update, uint32_t vertex,
                       std::span<const std::array<uint32_t, 3>> places,
                       std::vector<uint32_t>* slots) {
  std::vector<std::array<uint32_t, 3>> triangles;
  triangles.reserve(places.size());
  const uint32_t* const ring = update.hole.ring;
  for (const auto& p : places) triangles.push_back({ring[p[0]], ring[p[1]], ring[p[2]]});
  mesh.Replace(update.hole.slot_span(), triangles, vertex, slots);
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

// Puts the star in the place of the hole. `slots`: those of the star's triangles, in ring order.
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
