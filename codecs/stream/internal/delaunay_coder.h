// SPDX-License-Identifier: Apache-2.0
// What sender and client of a surface by the Delaunay rule share: where a vertex may lie, which
// triangles it takes away, and how high it is expected. Specified in codecs/FORMAT.md, "Updates by
// the Delaunay rule".
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

#include "codecs/stream/internal/replayed_mesh.h"
#include "codecs/stream/internal/update_coder.h"
#include "store/base/in_circle.h"
#include "store/base/lattice_polygon.h"

namespace mtdb::internal {

// Places beyond +-kMaxPlace are refused, so that the tests below are exact.
inline constexpr int32_t kMaxPlace = 1 << 29;
inline bool IsPlace(Vec3i p) {
  return p.x >= -kMaxPlace && p.x <= kMaxPlace && p.y >= -kMaxPlace && p.y <= kMaxPlace;
}

using LatticeTriangle = std::array<LatticePoint, 3>;

inline LatticeTriangle PlacesOf(const ReplayedMesh& mesh, uint32_t slot) {
  const auto& c = mesh.triangle(slot).corners;
  return {mesh.place(c[0]), mesh.place(c[1]), mesh.place(c[2])};
}

// Inside or on an edge.
inline bool Holds(const LatticeTriangle& t, LatticePoint p) {
  return Turn(t[0], t[1], p) >= 0 && Turn(t[1], t[2], p) >= 0 && Turn(t[2], t[0], p) >= 0;
}

inline bool IsCorner(const LatticeTriangle& t, LatticePoint p) {
  return p == t[0] || p == t[1] || p == t[2];
}

// Strictly between a and b.
inline bool IsBetween(LatticePoint a, LatticePoint p, LatticePoint b) {
  return p != a && p != b && Turn(a, p, b) == 0 && std::min(a.x, b.x) <= p.x &&
         p.x <= std::max(a.x, b.x) && std::min(a.y, b.y) <= p.y && p.y <= std::max(a.y, b.y);
}

// How many lattice points a triangle holds, but for its corners (G. Pick, 1899); 0 when it does not
// run counter-clockwise.
inline uint64_t CountPlaces(const LatticeTriangle& t) {
  const int64_t area = Turn(t[0], t[1], t[2]);
  if (area <= 0) return 0;
  const auto steps = [](LatticePoint a, LatticePoint b) { return std::gcd(b.x - a.x, b.y - a.y); };
  return static_cast<uint64_t>(
      (area + steps(t[0], t[1]) + steps(t[1], t[2]) + steps(t[2], t[0])) / 2 - 2);
}

// The square of three times the distance from the centre.
inline int64_t FromCentre(const LatticeTriangle& t, LatticePoint p) {
  const int64_t x = 3 * p.x - t[0].x - t[1].x - t[2].x;
  const int64_t y = 3 * p.y - t[0].y - t[1].y - t[2].y;
  return x * x + y * y;
}

// The places of a triangle with a small box, nearest to the centre first; nothing of a large one.
class NearPlaces {
 public:
  static constexpr int64_t kMaxBox = 256;

  bool Set(const LatticeTriangle& t) {
    const auto [left, right] = std::minmax({t[0].x, t[1].x, t[2].x});
    const auto [bottom, top] = std::minmax({t[0].y, t[1].y, t[2].y});
    places_.clear();
    if (right - left >= kMaxBox || top - bottom >= kMaxBox) return false;
    if ((right - left + 1) * (top - bottom + 1) > kMaxBox) return false;
    for (int64_t y = bottom; y <= top; ++y) {
      for (int64_t x = left; x <= right; ++x) {
        const LatticePoint p{x, y};
        if (Holds(t, p) && !IsCorner(t, p)) places_.push_back({FromCentre(t, p), y, x});
      }
    }
    std::sort(places_.begin(), places_.end());
    return true;
  }
  uint32_t count() const { return static_cast<uint32_t>(places_.size()); }
  LatticePoint place(uint32_t rank) const { return {places_[rank][2], places_[rank][1]}; }
  uint32_t RankOf(LatticePoint p) const {
    uint32_t rank = 0;
    while (rank + 1 < count() && place(rank) != p) ++rank;
    return rank;
  }

 private:
  std::vector<std::array<int64_t, 3>> places_;  // FromCentre, y, x
};

// Codes which place of the triangle, which has some, the next vertex takes. False when it is none.
template <typename Coder>
bool CodePlace(Coder& coder, DelaunayModels& models, const LatticeTriangle& t, NearPlaces& near,
               LatticePoint& p) {
  if (near.Set(t)) {
    const uint32_t n = near.count();
    uint32_t rank = near.RankOf(p);
    if (n > 1) {
      FastAdaptiveSymbol& model =
          models.rank[std::min<size_t>(static_cast<size_t>(std::bit_width(n)), 8) - 1];
      const uint32_t s = coder.Symbol(model, std::min(rank, 15u));
      rank = s < 15 ? s : 15 + coder.Raw(8, rank - 15);
    }
    if (rank >= n) return false;
    p = near.place(rank);
    return true;
  }
  const auto code = [&](NumberModel& model, int64_t sum, int64_t& value) {
    const int64_t centre = sum >= 0 ? sum / 3 : -((2 - sum) / 3);
    const auto from = static_cast<uint32_t>(value - centre);
    value = centre + static_cast<int32_t>(UnZigZag(CodeNumber(coder, model, ZigZag(from))));
  };
  code(models.across, t[0].x + t[1].x + t[2].x, p.x);
  code(models.up, t[0].y + t[1].y + t[2].y, p.y);
  return Holds(t, p) && !IsCorner(t, p);
}

// What an insertion takes away, or the star of a vertex that is removed. No bound on its size.
struct DelaunayHole {
  std::vector<uint32_t> slots, ring, outer;
  bool boundary = false;
};

class DelaunayWalk {
 public:
  // The hole of a vertex at p, which the anchor's triangle holds. False when the mesh is not what
  // the rule says: what is found is then no disc, or p does not see all of it.
  bool FindHole(const ReplayedMesh& mesh, uint32_t anchor, LatticePoint p, DelaunayHole& hole) {
    NewMarks(mesh);
    hole.slots.assign(1, anchor);
    hole.ring.clear();
    hole.outer.clear();
    triangle_marks_[anchor] = mark_;
    size_t split = SIZE_MAX;
    stack_.assign({4 * anchor + 2, 4 * anchor + 1, 4 * anchor});
    while (!stack_.empty()) {
      const uint32_t h = stack_.back();
      stack_.pop_back();
      const ReplayedMesh::Triangle& t = mesh.triangle(h >> 2);
      const uint32_t o = t.opposite[h & 3];
      const LatticePoint a = mesh.place(t.corners[h & 3]);
      const LatticePoint b = mesh.place(t.corners[Patch::Next(h) & 3]);
      const int64_t turn = Turn(a, b, p);
      const bool on = turn == 0 && h >> 2 == anchor;  // the anchor's edge has p on it
      if (o != kNone32 && (turn > 0 || on) && IsInCircleOf(mesh, o >> 2, p)) {
        if (triangle_marks_[o >> 2] == mark_) return false;
        triangle_marks_[o >> 2] = mark_;
        hole.slots.push_back(o >> 2);
        stack_.push_back(Patch::Next(Patch::Next(o)));
        stack_.push_back(Patch::Next(o));
        continue;
      }
      const bool splits = on && o == kNone32 && split == SIZE_MAX;
      if (splits) split = hole.ring.size();
      if (turn <= 0 && !splits) return false;
      const uint32_t v = t.corners[h & 3];
      if (vertex_marks_[v] == mark_) return false;
      vertex_marks_[v] = mark_;
      hole.ring.push_back(v);
      hole.outer.push_back(o);
    }
    for (const uint32_t o : hole.outer) {
      if (o != kNone32 && triangle_marks_[o >> 2] == mark_) return false;
    }
    hole.boundary = split != SIZE_MAX;
    if (hole.boundary) {
      const auto first = static_cast<std::ptrdiff_t>(split) + 1;
      std::rotate(hole.ring.begin(), hole.ring.begin() + first, hole.ring.end());
      std::rotate(hole.outer.begin(), hole.outer.begin() + first, hole.outer.end());
    }
    return hole.ring.size() >= 3;
  }

  // The star of a vertex, as WalkStar has it.
  bool FindStar(const ReplayedMesh& mesh, uint32_t vertex, DelaunayHole& star) {
    NewMarks(mesh);
    star.slots.clear();
    star.ring.clear();
    const auto leaves = [&](uint32_t h) {
      return mesh.has_triangle(h >> 2) && mesh.triangle(h >> 2).corners[h & 3] == vertex;
    };
    uint32_t h = mesh.half_edge_of(vertex);
    if (h == kNone32 || !leaves(h)) return false;
    const uint32_t start = h;
    star.boundary = false;
    for (uint32_t steps = 0;; ++steps) {
      const uint32_t o = mesh.triangle(h >> 2).opposite[h & 3];
      star.boundary = o == kNone32;
      if (star.boundary) break;
      h = Patch::Next(o);
      if (h == start) break;
      if (steps > mesh.degree(vertex) || !leaves(h)) return false;
    }
    const auto add = [&](uint32_t v) {
      const bool again = vertex_marks_[v] == mark_;
      vertex_marks_[v] = mark_;
      star.ring.push_back(v);
      return !again;
    };
    const uint32_t first = h;
    do {
      const ReplayedMesh::Triangle& t = mesh.triangle(h >> 2);
      const uint32_t toward = Patch::Next(Patch::Next(h));
      star.slots.push_back(h >> 2);
      if (!add(t.corners[Patch::Next(h) & 3])) return false;
      h = t.opposite[toward & 3];
      if (h == kNone32 && !add(t.corners[toward & 3])) return false;
      if (h != kNone32 && !leaves(h)) return false;
    } while (h != kNone32 && h != first);
    return star.ring.size() >= 3 && star.slots.size() == mesh.degree(vertex) &&
           star.boundary == (star.ring.size() > star.slots.size());
  }

  // The triangles that fill the star of a vertex that goes. False when there are none.
  bool Fill(const ReplayedMesh& mesh, const DelaunayHole& star, bool careful,
            std::vector<std::array<uint32_t, 3>>& triangles) {
    points_.clear();
    for (const uint32_t v : star.ring) points_.push_back(mesh.place(v));
    edges_.resize(star.ring.size());
    triangles.clear();
    return TriangulatePolygon(points_, careful, edges_, [&](uint32_t i, uint32_t m, uint32_t j) {
      triangles.push_back({star.ring[i], star.ring[m], star.ring[j]});
    });
  }

 private:
  static bool IsInCircleOf(const ReplayedMesh& mesh, uint32_t slot, LatticePoint p) {
    const LatticeTriangle t = PlacesOf(mesh, slot);
    return Turn(t[0], t[1], t[2]) > 0 && !IsCorner(t, p) && IsInCircle(t[0], t[1], t[2], p);
  }
  void NewMarks(const ReplayedMesh& mesh) {
    if (triangle_marks_.size() < mesh.triangle_slots()) {
      triangle_marks_.resize(mesh.triangle_slots());
    }
    if (vertex_marks_.size() < mesh.vertex_slots()) vertex_marks_.resize(mesh.vertex_slots());
    ++mark_;
  }

  uint64_t mark_ = 0;
  std::vector<uint64_t> triangle_marks_, vertex_marks_;  // per slot
  std::vector<uint32_t> stack_;
  std::vector<LatticePoint> points_;
  std::vector<std::pair<uint32_t, uint32_t>> edges_;
};

// What the extra work of an update counts in the cost of its record.
inline uint64_t CostOfHole(const DelaunayHole& hole) { return 1 + hole.slots.size() / 16; }
inline uint64_t CostOfStar(const DelaunayHole& star, bool careful) {
  const uint64_t k = star.ring.size();
  return 1 + k * k / 1024 + (careful ? k * k * k / 1024 : 0);
}

// Which triangles are asked whether a vertex comes into them.
class DelaunaySweep {
 public:
  // All triangles that are there are asked in the order of their slots, by naming those that get a
  // vertex; those that are made from now on one by one.
  void Begin(const ReplayedMesh& mesh) {
    queue_.clear();
    front_ = 0;
    first_born_ = mesh.next_born();
    next_slot_ = 0;
  }
  uint32_t next_slot() const { return next_slot_; }
  void Named(uint32_t slot) { next_slot_ = slot + 1; }
  void NoMoreNames() { next_slot_ = kNone32; }
  // The next one that is asked; false when there is none. *near_none: where it lies, a triangle got
  // no vertex before.
  bool Next(const ReplayedMesh& mesh, uint32_t* slot, bool* near_none) {
    while (front_ < queue_.size()) {
      const Entry entry = queue_[front_++];
      if (mesh.triangle(entry.slot).born() != entry.born) continue;
      *slot = entry.slot;
      *near_none = entry.near_none;
      return true;
    }
    return false;
  }
  void GetsNone(const ReplayedMesh& mesh, uint32_t slot) {
    if (none_.size() <= slot) none_.resize(mesh.triangle_slots());
    none_[slot] = mesh.triangle(slot).born();
  }
  // Before a hole goes: what is to be known of it when its star is there.
  void NoteHole(const ReplayedMesh& mesh, const DelaunayHole& hole) {
    near_none_.clear();
    // Beyond ring edge j lies outer[j]; within, the hole's triangle that has this edge.
    for (size_t i = 0; i < hole.slots.size(); ++i) {
      const uint32_t slot = hole.slots[i];
      const ReplayedMesh::Triangle& t = mesh.triangle(slot);
      const bool none = (slot < none_.size() && none_[slot] == t.born()) ||
                        (t.born() < first_born_ && slot < next_slot_ && i > 0);
      if (none) near_none_.insert(near_none_.end(), t.corners.begin(), t.corners.end());
    }
    std::sort(near_none_.begin(), near_none_.end());
    near_none_.erase(std::unique(near_none_.begin(), near_none_.end()), near_none_.end());
  }
  void AddStar(const ReplayedMesh& mesh, std::span<const uint32_t> star) {
    const auto near = [&](uint32_t v) {
      return std::binary_search(near_none_.begin(), near_none_.end(), v);
    };
    for (const uint32_t slot : star) {
      const ReplayedMesh::Triangle& t = mesh.triangle(slot);
      queue_.push_back({slot, near(t.corners[1]) && near(t.corners[2]), t.born()});
    }
    if (queue_.size() <= 64 + 2 * size_t{mesh.triangle_count()} + front_) return;
    std::erase_if(queue_, [&](const Entry& e) { return mesh.triangle(e.slot).born() != e.born; });
    front_ = 0;
  }

 private:
  struct Entry {
    uint32_t slot;
    bool near_none;
    uint64_t born;
  };
  std::vector<Entry> queue_;
  size_t front_ = 0;
  uint64_t first_born_ = 0;
  uint32_t next_slot_ = 0;
  std::vector<uint64_t> none_;  // per slot: when the triangle that got none was born
  std::vector<uint32_t> near_none_;
};

inline AdaptiveBit& SplitModel(DelaunayModels& models, uint64_t places, bool near_none) {
  return models.split[std::min<size_t>(static_cast<size_t>(std::bit_width(places)), 11)][near_none];
}

// Heights around a vertex: the plane that lies nearest to them, the nearer ones most.
struct HeightGuess {
  int32_t expected = 0;
  uint32_t spread = 0;  // class of the deviation
};

inline HeightGuess GuessHeight(const ReplayedMesh& mesh, std::span<const uint32_t> ring,
                               LatticePoint p) {
  const int32_t base = mesh.position(ring[0]).z;
  double s = 0, sx = 0, sy = 0, sz = 0, sxx = 0, sxy = 0, syy = 0, sxz = 0, syz = 0, szz = 0;
  for (const uint32_t v : ring) {
    const Vec3i q = mesh.position(v);
    const auto x = static_cast<double>(q.x - p.x);
    const auto y = static_cast<double>(q.y - p.y);
    const double z = static_cast<double>(q.z) - static_cast<double>(base);
    const double squared = x * x + y * y;
    const double w = 1 / (squared * squared);
    s += w;
    sx += w * x;
    sy += w * y;
    sz += w * z;
    sxx += w * x * x;
    sxy += w * x * y;
    syy += w * y * y;
    sxz += w * x * z;
    syz += w * y * z;
    szz += w * z * z;
  }
  const double mx = sx / s, my = sy / s, mz = sz / s;
  const double xx = sxx - sx * mx, xy = sxy - sx * my, yy = syy - sy * my;
  const double xz = sxz - sx * mz, yz = syz - sy * mz, zz = szz - sz * mz;
  const double det = xx * yy - xy * xy;
  double b = 0, c = 0;
  if (det > 1e-9 * xx * yy) {
    b = (xz * yy - yz * xy) / det;
    c = (yz * xx - xz * xy) / det;
  }
  const double z = std::clamp(mz - b * mx - c * my, -4294967296.0, 4294967296.0);
  const double variance = std::max((zz - b * xz - c * yz) / s, 0.0);
  HeightGuess guess;
  guess.expected =
      static_cast<int32_t>(static_cast<uint32_t>(base) +
                           static_cast<uint32_t>(static_cast<int64_t>(std::floor(z + 0.5))));
  const auto scaled = static_cast<uint64_t>(std::min(4 * variance, 4294967296.0));
  guess.spread = std::min(static_cast<uint32_t>(std::bit_width(scaled)), 31u);
  return guess;
}

// The size of a number: itself up to 3, then in half octaves.
inline uint32_t SizeOf(uint32_t m) {
  if (m < 4) return m;
  const auto l = static_cast<uint32_t>(std::bit_width(m));
  return 2 * l - 2 + (m >> (l - 2) & 1);
}

template <typename Coder>
int32_t CodeHeight(Coder& coder, DelaunayModels& models, const HeightGuess& guess, int32_t z) {
  const auto residual =
      static_cast<int32_t>(static_cast<uint32_t>(z) - static_cast<uint32_t>(guess.expected));
  const uint32_t m =
      residual < 0 ? 0 - static_cast<uint32_t>(residual) : static_cast<uint32_t>(residual);
  const uint32_t base = guess.spread <= 11 ? 0 : (guess.spread - 11) | 1;
  const uint32_t size = SizeOf(m);
  const uint32_t s =
      coder.Symbol(models.height[guess.spread], size <= base ? 0 : std::min(size - base, 15u));
  uint32_t found;
  if (s == 0 && base > 0) {
    found = coder.Raw(static_cast<int>((base + 1) / 2), m);
  } else {
    uint32_t g = base + s;
    if (s == 15) g = std::min(g + coder.Raw(6, size - g), 63u);
    found = g;
    if (g >= 4) {
      const uint32_t low = g / 2 - 1;
      found = (2 | (g & 1)) << low | coder.Raw(static_cast<int>(low), m & ((1u << low) - 1));
    }
  }
  if (found != 0 && coder.Raw(1, residual < 0 ? 1 : 0) != 0) found = 0 - found;
  return static_cast<int32_t>(static_cast<uint32_t>(guess.expected) + found);
}

}  // namespace mtdb::internal
