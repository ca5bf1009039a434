// SPDX-License-Identifier: Apache-2.0
// How a clipped client follows its region: triangles that leave it are dropped, and others are
// attached to those that are there, edge by edge, as in cut-border compression (S. Gumhold, W.
// Strasser, "Real time compression of triangle mesh connectivity", 1998). Templates on the coder
// and on the side, so that what is written is what is read. Specified in codecs/FORMAT.md.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "codecs/stream/internal/update_coder.h"

namespace mtdb::internal {

// ---- dropping ----

// What is decided of triangles and vertices. Lives longer than a walk, so that a walk costs what it
// visits and not what the mesh has.
struct DropScratch {
  enum State : uint8_t { kOpen, kStays, kGoes };
  std::vector<uint8_t> state;    // per triangle slot; kOpen outside a walk
  std::vector<uint8_t> touched;  // per vertex slot: 1: by one that stays, 2: by one that goes
  std::vector<uint32_t> decided;
};

// The triangles that go, found by walking from seeds on. Of one mesh: it ends before a slot that
// was dropped is used again.
class DropWalk {
 public:
  DropWalk(const ReplayedMesh& mesh, DropScratch& scratch) : mesh_(mesh), s_(scratch) {
    // The mesh has grown by what records before brought.
    s_.state.resize(std::max<size_t>(s_.state.size(), mesh.triangle_slots()));
    s_.touched.resize(std::max<size_t>(s_.touched.size(), mesh.vertex_slots()));
  }
  ~DropWalk() { Reset(); }
  DropWalk(const DropWalk&) = delete;
  DropWalk& operator=(const DropWalk&) = delete;

  // `goes(slot)`: the encoder's answer. `next_seed(slot)`: the encoder's first triangle from this
  // slot on that goes and is not decided, or kNone32. False when the bytes are wrong.
  template <typename Coder, typename Goes, typename NextSeed>
  bool Code(Coder& coder, ClipModels& models, Goes&& goes, NextSeed&& next_seed) {
    for (uint64_t next = 0;;) {
      const uint32_t seed = next_seed(static_cast<uint32_t>(next));
      if (!coder.Bit(models.more_drops, seed != kNone32)) return true;
      const uint64_t slot =
          next + CodeNumber(coder, models.drop_gap, seed - static_cast<uint32_t>(next));
      if (slot >= s_.state.size() || !mesh_.has_triangle(static_cast<uint32_t>(slot)) ||
          s_.state[slot] != DropScratch::kOpen) {
        return false;
      }
      next = slot + 1;
      Decide(static_cast<uint32_t>(slot), true);
      while (!stack_.empty()) {
        const ReplayedMesh::Triangle& t = mesh_.triangle(stack_.back());
        stack_.pop_back();
        for (const uint32_t o : t.opposite) {
          if (o == kNone32 || s_.state[o >> 2] != DropScratch::kOpen) continue;
          Decide(o >> 2, coder.Bit(models.drop[Context(o)], goes(o >> 2)));
        }
      }
    }
  }
  bool decided(uint32_t slot) const { return s_.state[slot] != DropScratch::kOpen; }
  // In the order of the walk.
  std::span<const uint32_t> dropped() const { return dropped_; }

 private:
  void Decide(uint32_t slot, bool goes) {
    s_.state[slot] = goes ? DropScratch::kGoes : DropScratch::kStays;
    s_.decided.push_back(slot);
    for (const uint32_t v : mesh_.triangle(slot).corners) s_.touched[v] |= goes ? 2 : 1;
    if (!goes) return;
    dropped_.push_back(slot);
    stack_.push_back(slot);
  }
  // What is known of the neighbours across the other edges, and at the third corner.
  size_t Context(uint32_t half_edge) const {
    const ReplayedMesh::Triangle& t = mesh_.triangle(half_edge >> 2);
    const auto beyond = [&](uint32_t h) {
      const uint32_t o = t.opposite[h & 3];
      return o == kNone32 ? size_t{3} : size_t{s_.state[o >> 2]};
    };
    const uint32_t next = Patch::Next(half_edge);
    const uint32_t third = Patch::Next(next);
    return (beyond(next) * 4 + beyond(third)) * 4 + s_.touched[t.corners[third & 3]];
  }
  // What a free slot was is still there.
  void Reset() {
    for (const uint32_t slot : s_.decided) {
      s_.state[slot] = DropScratch::kOpen;
      for (const uint32_t v : mesh_.triangle(slot).corners) s_.touched[v] = 0;
    }
    s_.decided.clear();
  }

  const ReplayedMesh& mesh_;
  DropScratch& s_;
  std::vector<uint32_t> stack_;
  std::vector<uint32_t> dropped_;
};

// ---- attaching ----

// The size of a number in half octaves.
inline int HalfOctaves(uint32_t magnitude) {
  const int length = static_cast<int>(std::bit_width(magnitude));
  return 2 * length + (length < 2 ? 0 : static_cast<int>(magnitude >> (length - 2) & 1));
}

// Codes a residual: its size as a symbol, from some way below the expected size on, then the bits
// below, and the sign. *symbol becomes that symbol.
template <typename Coder>
int32_t CodeResidual(Coder& coder, ResidualModel& model, int expected, int32_t residual,
                     uint32_t* symbol) {
  constexpr int kEscape = 15;
  constexpr int kLargest = 65;  // of 32 bits
  uint32_t magnitude =
      residual < 0 ? 0u - static_cast<uint32_t>(residual) : static_cast<uint32_t>(residual);
  const int base = expected < 8 ? -1 : (expected - 8) | 1;  // odd; symbol 0: no more than that
  const int wanted = std::clamp(HalfOctaves(magnitude) - base, 0, kEscape);
  *symbol = coder.Symbol(model, static_cast<uint32_t>(wanted));
  if (*symbol == 0) {
    magnitude = coder.Raw(std::max(base / 2, 0), magnitude);
  } else {
    int size = base + static_cast<int>(*symbol);
    if (*symbol == kEscape) {
      size = static_cast<int>(coder.Raw(7, static_cast<uint32_t>(HalfOctaves(magnitude))));
    }
    size = std::min(size, kLargest);
    const int low = std::max(size / 2 - 2, 0);
    const uint32_t bits = coder.Raw(low, magnitude & ((1u << low) - 1));
    magnitude = size < 4 ? static_cast<uint32_t>(size / 2) : (2u | (size & 1)) << low | bits;
  }
  const bool negative = magnitude != 0 && coder.Raw(1, residual < 0 ? 1 : 0) != 0;
  return static_cast<int32_t>(negative ? 0u - magnitude : magnitude);
}

// Where the border goes on at an end of an edge without an opposite.
struct BorderEnd {
  uint32_t vertex = kNone32;  // the next one; none: not found
  uint32_t angle = 0;         // class of the angle in between, 7: the sharpest; 0: no vertex
};

// The edge h from a to b, and the border before a and after b.
class BorderView {
 public:
  BorderView(const ReplayedMesh& mesh, uint32_t h) : mesh_(mesh) {
    const ReplayedMesh::Triangle& t = mesh.triangle(h >> 2);
    const uint32_t next = Patch::Next(h);
    const uint32_t third = Patch::Next(next);
    a_ = t.corners[h & 3];
    b_ = t.corners[next & 3];
    inner_ = t.corners[third & 3];
    edge_ = Offset4(mesh.points()[b_], mesh.points()[a_]);
    inside_ = Offset4(mesh.points()[inner_], mesh.points()[a_]);
    const Float4 cross = edge_ * Turn(inside_) - Turn(edge_) * inside_;
    normal_ = Turn(cross);
    SetEnd(ends_[0], third, a_, false);
    SetEnd(ends_[1], next, b_, true);
    if (ends_[1].vertex == ends_[0].vertex) ends_[1] = {};
    near_ = ends_[1].angle > ends_[0].angle ? 1 : 0;
  }
  uint32_t a() const { return a_; }
  uint32_t b() const { return b_; }
  uint32_t inner() const { return inner_; }
  Float4 edge() const { return edge_; }      // from a to b
  Float4 inside() const { return inside_; }  // from a to the triangle's third corner
  Float4 normal() const { return normal_; }  // of the triangle, of any length
  // The end of the sharper angle, and the other one.
  const BorderEnd& near_end() const { return ends_[near_]; }
  const BorderEnd& far_end() const { return ends_[1 - near_]; }
  size_t context() const { return near_end().angle * 8 + far_end().angle; }

 private:
  static constexpr int kMaxSteps = 64;

  // Around the vertex from a half-edge that leaves it (enters it) on, to one without an opposite.
  void SetEnd(BorderEnd& end, uint32_t h, uint32_t vertex, bool leaves) {
    for (int step = 0; step < kMaxSteps; ++step) {
      const ReplayedMesh::Triangle& t = mesh_.triangle(h >> 2);
      const uint32_t o = t.opposite[h & 3];
      if (o == kNone32) {
        const uint32_t other = t.corners[(leaves ? Patch::Next(h) : h) & 3];
        if (other == a_ || other == b_) return;
        end = {other, AngleClass(vertex, other, leaves)};
        return;
      }
      h = leaves ? Patch::Next(o) : Patch::Next(Patch::Next(o));
    }
  }
  // Of the angle at the vertex between the edge and the border's next one.
  uint32_t AngleClass(uint32_t vertex, uint32_t other, bool at_b) const {
    const Float4 d = Offset4(mesh_.points()[other], mesh_.points()[vertex]);
    const Float4 e = at_b ? -edge_ : edge_;
    const Float4 side = Turn(d * Turn(edge_) - Turn(d) * edge_) * normal_;
    if (side[0] + side[1] + side[2] < 0) return 1;  // beyond 180 degrees
    const Float4 products = d * e;
    const Float4 squares = d * d;
    const Float4 lengths = e * e;
    const float dot = products[0] + products[1] + products[2];
    const float dd = squares[0] + squares[1] + squares[2];
    const float ee = lengths[0] + lengths[1] + lengths[2];
    const float cosine = dd > 0 && ee > 0 ? (dot / dd) * (dot / ee) : 1;  // squared
    if (dot < 0) return cosine > 0.25f ? 2 : 3;
    return cosine < 0.15f ? 4 : cosine < 0.4f ? 5 : cosine < 0.7f ? 6 : 7;
  }

  const ReplayedMesh& mesh_;
  uint32_t a_ = 0, b_ = 0, inner_ = 0;
  Float4 edge_{}, inside_{}, normal_{};
  BorderEnd ends_[2];
  int near_ = 0;
};

// Codes where the third corner of a triangle beyond an edge is: expected in the plane of the
// edge's triangle, opposite to its third corner.
template <typename Coder>
void CodeBeyond(Coder& coder, ClipModels& models, const ReplayedMesh& mesh, const BorderView& view,
                Vec3i& p) {
  const Float4 normal = view.normal();
  const Float4 size = normal < 0 ? -normal : normal;
  const int longer = size[0] > size[1] ? 0 : 1;
  const int n = size[longer] > size[2] ? longer : 2;
  const int u = n == 2 ? 0 : n + 1;
  const int v = u == 2 ? 0 : u + 1;
  const Float4 squares = view.edge() * view.edge();
  const Float4 inside = view.inside() * view.inside();
  const int longest =
      ExponentOf(std::max(squares[0] + squares[1] + squares[2], inside[0] + inside[1] + inside[2]));
  const Vec3i a = mesh.position(view.a());
  const Vec3i b = mesh.position(view.b());
  const Vec3i c = mesh.position(view.inner());
  const auto opposite = [&](int axis) {
    return static_cast<int32_t>(static_cast<uint32_t>(a[axis]) + static_cast<uint32_t>(b[axis]) -
                                static_cast<uint32_t>(c[axis]));
  };
  size_t context = view.near_end().angle / 2;
  const auto code = [&](size_t which, int axis, int32_t expected) {
    int32_t& spread = models.spread[which];
    const auto residual =
        static_cast<int32_t>(static_cast<uint32_t>(p[axis]) - static_cast<uint32_t>(expected));
    uint32_t symbol = 0;
    const int expected_size = std::clamp(longest + (spread >> 8), 0, kMaxExponent);
    const int32_t coded =
        CodeResidual(coder, models.residual[which][context], expected_size, residual, &symbol);
    context = symbol < 7 ? 0 : symbol < 9 ? 1 : symbol < 11 ? 2 : 3;
    p[axis] = Shift(expected, coded);
    const int found =
        HalfOctaves(coded < 0 ? 0u - static_cast<uint32_t>(coded) : static_cast<uint32_t>(coded));
    spread += ((found - longest) * 256 - spread) >> 5;
  };
  code(0, u, opposite(u));
  code(1, v, opposite(v));
  int32_t expected = opposite(n);
  if (normal[n] != 0) {
    const auto offset = [&](int axis) {
      return static_cast<float>(
          static_cast<int32_t>(static_cast<uint32_t>(p[axis]) - static_cast<uint32_t>(a[axis])));
    };
    const float rise = normal[u] * offset(u) + normal[v] * offset(v);
    expected = Shift(a[n], RoundCoordinate(0 - rise / normal[n]));
  }
  code(2, n, expected);
}

// Vertices that have no triangle are remembered or forgotten. `lost(vertex)` hears what goes.
template <typename Lost>
void ForgetLeftOver(ReplayedMesh& mesh, std::span<const uint32_t> left_over, Lost&& lost) {
  for (const uint32_t v : left_over) {
    if (mesh.degree(v) > 0 || mesh.is_remembered(v) || !mesh.is_known(v)) continue;
    if (const uint32_t gone = mesh.Forget(v, kNone32); gone != kNone32) lost(gone);
  }
}

// The triangles that come. A side has, for the encoder's answers and both ends' doings,
//   uint32_t NextSeed(): the half-edge that the next seed lies beyond; kNone32: it lies beyond none
//   bool done(): no seed is left
//   bool Across(h): is a triangle to be attached to the half-edge?
//   uint32_t Corner(i): that triangle's corner in the client's mesh, kNone32: a new one; i counts
//       from the edge's end on, for a seed beyond none from any corner on
//   Vec3i position(): of the corner that was asked for last
//   void CodeRow(star), void CodeRow(): its attributes, predicted or not
//   uint32_t PutVertex(p): a new one comes; kNone32: it is too much
//   bool MayPutTriangle(): likewise; void PutTriangle(slot): it came
template <typename Coder, typename Side>
class Attacher {
 public:
  // `left_over`: vertices that may have no triangle in the end.
  Attacher(Coder& coder, UpdateModels& models, ReplayedMesh& mesh, Side& side,
           std::vector<uint32_t>* left_over)
      : coder_(coder),
        models_(models),
        clips_(models.clips),
        mesh_(mesh),
        side_(side),
        left_over_(left_over) {}

  // False when the bytes are wrong, or too much came.
  bool Code() {
    for (uint64_t next = 0;;) {
      if (!coder_.Bit(clips_.more_seeds, !side_.done())) return true;
      const uint32_t seed = side_.NextSeed();
      if (coder_.Bit(clips_.at_edge, seed != kNone32)) {
        const uint64_t slot =
            next + CodeNumber(coder_, clips_.edge_gap, (seed >> 2) - static_cast<uint32_t>(next));
        const uint32_t edge = coder_.Raw(2, seed & 3);
        if (edge > 2 || slot >= mesh_.triangle_slots() ||
            !mesh_.has_triangle(static_cast<uint32_t>(slot)) ||
            mesh_.triangle(static_cast<uint32_t>(slot)).opposite[edge] != kNone32) {
          return false;
        }
        next = slot;
        const uint32_t h = 4 * static_cast<uint32_t>(slot) + edge;
        if (!AttachTo(BorderView(mesh_, h), h)) return false;
      } else if (!AttachAlone()) {
        return false;
      }
      // The oldest edge first, so that the border stays round and hardly meets itself.
      for (size_t i = 0; i < edges_.size(); ++i) {
        const uint32_t h = edges_[i];
        if (mesh_.triangle(h >> 2).opposite[h & 3] != kNone32) continue;
        const BorderView view(mesh_, h);
        AdaptiveBit& model = clips_.attach[2 * view.context() + (attached_ ? 1 : 0)];
        attached_ = coder_.Bit(model, side_.Across(h));
        if (attached_ && !AttachTo(view, h)) return false;
      }
      edges_.clear();
    }
  }

 private:
  bool AttachTo(const BorderView& view, uint32_t h) {
    side_.Across(h);
    const uint32_t wanted = side_.Corner(2);
    uint32_t corner = kNone32;
    const size_t context = view.context();
    const BorderEnd& near = view.near_end();
    const BorderEnd& far = view.far_end();
    if (near.angle != 0 && coder_.Bit(clips_.near_end[context], wanted == near.vertex)) {
      corner = near.vertex;
    } else if (far.angle != 0 && coder_.Bit(clips_.far_end[context], wanted == far.vertex)) {
      corner = far.vertex;
    } else if (coder_.Bit(clips_.fresh[context], wanted == kNone32)) {
      Vec3i p = side_.position();
      CodeBeyond(coder_, clips_, mesh_, view, p);
      const uint32_t around[3] = {view.b(), view.a(), view.inner()};
      const Vec3i positions[3] = {mesh_.position(around[0]), mesh_.position(around[1]),
                                  mesh_.position(around[2])};
      side_.CodeRow({p, around, positions});
      last_ = p;
      corner = PutVertex();
    } else {
      corner = CodeReference(wanted);
    }
    return Put({view.b(), view.a(), corner});
  }
  // A triangle that lies beyond no edge.
  bool AttachAlone() {
    std::array<uint32_t, 3> corners{};
    for (uint32_t i = 0; i < 3; ++i) {
      const uint32_t wanted = side_.Corner(i);
      if (!coder_.Bit(clips_.fresh[0], wanted == kNone32)) {
        corners[i] = CodeReference(wanted);
        if (corners[i] == kNone32) return false;
        last_ = mesh_.position(corners[i]);
        continue;
      }
      const Vec3i p = side_.position();
      for (int axis = 0; axis < 3; ++axis) {
        const auto from = static_cast<uint32_t>(last_[axis]);
        const uint32_t coded =
            CodeNumber(coder_, clips_.coordinate, ZigZag(static_cast<uint32_t>(p[axis]) - from));
        last_[axis] = static_cast<int32_t>(from + UnZigZag(coded));
      }
      side_.CodeRow();
      corners[i] = PutVertex();
      if (corners[i] == kNone32) return false;
    }
    return Put(corners);
  }
  uint32_t PutVertex() {
    const uint32_t vertex = side_.PutVertex(last_);
    if (vertex != kNone32) left_over_->push_back(vertex);
    return vertex;
  }
  uint32_t CodeReference(uint32_t wanted) {
    const uint32_t coded = CodeNumber(coder_, clips_.reference, ZigZag(wanted - reference_));
    const uint32_t vertex = reference_ + UnZigZag(coded);
    if (!mesh_.is_known(vertex)) return kNone32;
    reference_ = vertex;
    if (mesh_.is_remembered(vertex)) {
      mesh_.Recall(vertex);
      side_.Recalled();
      left_over_->push_back(vertex);
    }
    return vertex;
  }
  bool Put(const std::array<uint32_t, 3>& corners) {
    const auto [a, b, c] = corners;
    if (c == kNone32 || a == b || b == c || c == a) return false;
    if (!side_.MayPutTriangle()) return false;
    const uint32_t slot = mesh_.Attach(corners);
    AdaptReference(models_, UpdateShapes(mesh_, models_).LongestExponent(slot));
    side_.PutTriangle(slot);
    for (uint32_t i = 0; i < 3; ++i) edges_.push_back(4 * slot + i);
    return true;
  }

  Coder& coder_;
  UpdateModels& models_;
  ClipModels& clips_;
  ReplayedMesh& mesh_;
  Side& side_;
  std::vector<uint32_t>* const left_over_;
  std::vector<uint32_t> edges_;  // half-edges that triangles may lie beyond
  bool attached_ = true;
  uint32_t reference_ = 0;
  Vec3i last_{};
};

}  // namespace mtdb::internal
