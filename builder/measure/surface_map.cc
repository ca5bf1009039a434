// SPDX-License-Identifier: Apache-2.0
#include "builder/measure/surface_map.h"

#include <algorithm>
#include <bit>
#include <tuple>
#include <utility>

namespace mtdb::internal {

namespace {
constexpr uint8_t kSpoke = 255;
// Of scans and sculptures the longest path crosses 15 edges. Where longer ones are many, a build
// would be spent with them: holes that they pass stay.
constexpr size_t kLongestPath = 128;
constexpr uint32_t Twin(uint32_t crossing) { return MeshCrossings::Twin(crossing); }

// The chords of an edge of S in a tile, in any order, and how they follow each other.
class ChordChain {
 public:
  struct Link {
    uint32_t in, out;  // crossings; kNone32: the path begins or ends here
    bool to_outside;   // what is left for is not of the tile
    uint32_t next = kNone32;
    bool follows = false, done = false;
  };

  void Add(const Link& link) { links_.push_back(link); }
  std::span<const Link> links() const { return links_; }

  // False when they do not follow each other in one way only.
  bool Connect() {
    bool plain = true;
    uint32_t begins = 0;
    uint32_t ends = 0;
    for (Link& link : links_) {
      begins += link.in == kNone32;
      ends += link.out == kNone32;
      for (uint32_t d = 0; d < links_.size() && link.out != kNone32; ++d) {
        if (links_[d].in != link.out) continue;
        plain &= link.next == kNone32 && !links_[d].follows;
        link.next = d;
        links_[d].follows = true;
      }
      if (link.out != kNone32) plain &= (link.next == kNone32) == link.to_outside;
    }
    return plain && begins <= 1 && ends <= 1;
  }

  // Their crossings, with `gap` where the path is outside; first what begins the path, last what
  // ends it. False when some form a ring.
  bool Run(uint32_t gap, std::vector<uint32_t>& path) {
    for (const uint32_t turn : {0u, 1u, 2u}) {
      for (Link& link : links_) {
        if (link.done || link.follows || turn != Turn(link)) continue;
        if (!path.empty()) path.push_back(gap);
        if (link.in != kNone32) path.push_back(link.in);
        for (Link* at = &link;; at = &links_[at->next]) {
          at->done = true;
          if (at->out != kNone32) path.push_back(at->out);
          if (at->next == kNone32) break;
        }
      }
    }
    return std::all_of(links_.begin(), links_.end(), [](const auto& link) { return link.done; });
  }

 private:
  // Of a run's first link.
  uint32_t Turn(const Link& first) const {
    if (first.in == kNone32) return 0;
    const Link* last = &first;
    while (last->next != kNone32) last = &links_[last->next];
    return last->out == kNone32 ? 2 : 1;
  }

  std::vector<Link> links_;
};
}  // namespace

void SurfaceMap::Masks::Set(const Hole& hole, const Hole::Triangles& triangles,
                            std::span<const uint32_t> homes) {
  ends_.assign(Sample(0), {});
  std::array<uint32_t, Hole::kMaxRing> behind{};  // of the triangles
  for (uint32_t t = 1; t + 2 < hole.k; ++t) {
    const auto [i, m, j] = triangles[t];
    const uint32_t bit = 1u << t;
    for (uint32_t r = i; r < j; ++r) ends_[RingEdge(r)].behind |= bit;
    for (uint32_t r = i + 1u; r < j; ++r) ends_[RingVertex(r)].behind |= bit;
    ends_[RingVertex(i)].on |= bit;
    ends_[RingVertex(j)].on |= bit;
    for (uint32_t s = t; s + 2 < hole.k; ++s) {
      if (triangles[s][0] >= i && triangles[s][2] <= j) behind[s] |= bit;
    }
  }
  for (const uint32_t home : homes) ends_.push_back({behind[home], 0});
}

void SurfaceMap::Build(const TileMesh& mesh, std::span<const std::array<uint32_t, 3>> triangles,
                       std::span<const uint32_t> opposites, std::span<const float> errors,
                       std::span<const uint32_t> numbers) {
  edges_.Build(triangles, opposites, errors, numbers);
  crossings_.Build(mesh);
  opened_ = 0;
  places_.assign(numbers.size(), {});
}

void SurfaceMap::AddChords(std::vector<Chord> chords, const TileMesh& mesh,
                           std::span<const uint32_t> numbers) {
  const auto key = [&](const Chord& c) {
    return std::tuple(numbers[c.from], numbers[c.to], c.triangle, c.enters, c.leaves);
  };
  std::sort(chords.begin(), chords.end(),
            [&](const Chord& a, const Chord& b) { return key(a) < key(b); });
  for (size_t begin = 0; begin < chords.size();) {
    size_t end = begin;
    const auto [from, to] = std::pair(chords[begin].from, chords[begin].to);
    while (end < chords.size() && chords[end].from == from && chords[end].to == to) ++end;
    uint32_t edge = edges_.Find(from, to);
    // One that only passes through the tile: none of its ends will go.
    if (edge == kNone32) edge = edges_.Add(from, to);
    JoinChords(edge, std::span(chords).subspan(begin, end - begin), mesh);
    begin = end;
  }
}

// A path that is not plain gets a gap between any two crossings, so that no hole that it passes
// through will be filled.
void SurfaceMap::JoinChords(uint32_t edge, std::span<const Chord> chords, const TileMesh& mesh) {
  ChordChain chain;
  for (const Chord& chord : chords) {
    edges_[edge].error = std::max(edges_[edge].error, chord.error);
    uint32_t in = kNone32;
    uint32_t out = kNone32;
    bool to_outside = false;
    if (chord.enters < 3) in = Twin(crossings_.Of(3 * chord.triangle + chord.enters));
    if (chord.leaves < 3) {
      const uint32_t h = 3 * chord.triangle + chord.leaves;
      out = crossings_.Of(h);
      to_outside = mesh.input_opposites()[h] == kNone32;
    }
    chain.Add({in, out, to_outside});
  }
  std::vector<uint32_t> path;
  if (!chain.Connect() || !chain.Run(kGap, path)) {
    path.assign(1, kGap);
    for (const auto& link : chain.links()) {
      for (const uint32_t x : {link.in, link.out}) {
        if (x != kNone32) path.insert(path.end(), {x, kGap});
      }
    }
  }
  edges_.SetPath(edge, path);
  for (const uint32_t x : path) {
    if (x != kGap) crossings_.AddCrosser(x, edge);
  }
}

void SurfaceMap::Hold(std::span<const uint8_t> alive, std::vector<Chord>& chords) const {
  std::vector<uint32_t> half_edges(2 * crossings_.edges(), kNone32);
  for (uint32_t h = 0; h < crossings_.half_edges(); ++h) {
    if (alive[h / 3] != 0) half_edges[crossings_.Of(h)] = h;
  }
  for (uint32_t e = 0; e < edges_.size(); ++e) {
    const SurfaceEdges::Edge& edge = edges_[e];
    const std::span<const uint32_t> path = edges_.path(edge);
    if (path.empty()) continue;
    for (size_t i = 0; i <= path.size(); ++i) {
      // Between two crossings.
      const uint32_t in = i > 0 && path[i - 1] != kGap ? half_edges[Twin(path[i - 1])] : kNone32;
      const uint32_t out = i < path.size() && path[i] != kGap ? half_edges[path[i]] : kNone32;
      if (in == kNone32 && out == kNone32) continue;
      const auto side = [](uint32_t h) { return static_cast<uint8_t>(h == kNone32 ? 3 : h % 3); };
      const uint32_t triangle = (in != kNone32 ? in : out) / 3;
      const Chord chord{edge.from, edge.to, edge.error, triangle, side(in), side(out)};
      chords.push_back(chord);
      // A path that was not plain stays so.
      const bool lost =
          in == kNone32 ? i > 0 && path[i - 1] == kGap : out == kNone32 && i < path.size();
      if (lost) chords.push_back(chord);
    }
  }
}

void SurfaceMap::Open(const Hole& hole) {
  ++opened_;
  marked_.clear();
  star_edges_.clear();
  parts_.clear();
  inner_edge_count_ = 0;
  known_ = true;
  for (uint32_t r = 0; r < hole.k; ++r) {
    Place& place = places_[hole.ring[r]];
    known_ &= place.opened != opened_;
    place = {opened_, RingVertex(r)};
  }
  for (uint32_t r = 0; r < hole.ring_edges.size(); ++r) {
    leaving_[r] = crossings_.Of(hole.ring_edges[r]);
    MarkMeshEdge(hole.ring_edges[r], static_cast<uint8_t>(r));
    MarkMeshEdge(Previous(hole.ring_edges[r]), kSpoke);
  }
  if (hole.boundary) MarkMeshEdge(hole.border_in, kSpoke);
}

void SurfaceMap::MarkMeshEdge(uint32_t half_edge, uint8_t code) {
  const uint32_t edge = crossings_.Of(half_edge) / 2;
  crossings_[edge].coded_in = opened_;
  crossings_[edge].code = code;
  star_edges_.push_back(edge);
}

// What is looked at lies anywhere in the tile: it is fetched before it is needed.
bool SurfaceMap::FindParts() {
  found_.clear();
  for (const uint32_t mesh_edge : star_edges_) {
    crossings_.ForEachCrosser(mesh_edge, [&](uint32_t e) {
      __builtin_prefetch(&edges_[e], 1);
      found_.push_back(e);
    });
  }
  FindInnerEdges();
  for (const uint32_t e : found_) {
    SurfaceEdges::Edge& edge = edges_[e];
    if (std::exchange(edge.looked_at_in, opened_) == opened_ || edge.length == 0) continue;
    known_ &= FindParts(e);
  }
  return known_;
}

// An edge between two vertices that are marked is seen from where it begins.
void SurfaceMap::FindInnerEdges() {
  for (const uint32_t v : marked_) __builtin_prefetch(edges_.At(v).data());
  size_t count = 0;
  for (const uint32_t v : marked_) {
    const End here = places_[v].end;
    const std::span<const SurfaceEdges::EdgeAt> edges = edges_.At(v);
    if (inner_edges_.size() < count + edges.size()) inner_edges_.resize(2 * (count + edges.size()));
    for (const SurfaceEdges::EdgeAt& at : edges) {
      const End other = EndOf(at.other_end);
      inner_edges_[count] = {at.edge, at.begins_here ? here : other, at.begins_here ? other : here};
      // Half of them are none; no branch could be foretold.
      count += static_cast<size_t>(other != kOutside) &
               (static_cast<size_t>(!IsInside(other)) | at.begins_here);
    }
  }
  inner_edge_count_ = count;
}

// The parts of an edge's path that lie in the star. It enters and leaves through the ring.
bool SurfaceMap::FindParts(uint32_t e) {
  const SurfaceEdges::Edge& edge = edges_[e];
  if (edge.length > kLongestPath) return false;
  const std::span<const uint32_t> path = edges_.path(edge);
  const End first = EndOf(edge.from);
  const End last = EndOf(edge.to);
  constexpr uint32_t kElsewhere = 256;
  const auto code_of = [&](uint32_t crossing) -> uint32_t {
    if (crossing == kGap) return kElsewhere;
    const MeshCrossings::MeshEdge& mesh_edge = crossings_[crossing / 2];
    return mesh_edge.coded_in == opened_ ? mesh_edge.code : kElsewhere;
  };
  bool inside = IsInside(first);
  if (!inside && first != kOutside) {
    const uint32_t code = code_of(path[0]);
    inside = code == kSpoke || (code != kElsewhere && path[0] == leaving_[code]);
  }
  Part part{e, first, kOutside, 0, 0};
  for (uint32_t i = 0; i < path.size(); ++i) {
    const uint32_t code = code_of(path[i]);
    if (code == kElsewhere || code == kSpoke) {
      if (inside != (code == kSpoke)) return false;
      continue;
    }
    if (inside != (path[i] == leaving_[code])) return false;
    if (inside) {
      part.to = RingEdge(code);
      part.end = i;
      parts_.push_back(part);
    } else {
      part.from = RingEdge(code);
      part.begin = i + 1;
    }
    inside = !inside;
  }
  if (!inside) return !IsInside(last);
  part.to = last;
  part.end = static_cast<uint32_t>(path.size());
  parts_.push_back(part);
  return last != kOutside;
}

// Takes out where the path crosses an edge there and back. Not of edges that triangles have which
// the tile began with: others have noted down what crosses these.
void SurfaceMap::Reduce(std::vector<uint32_t>& path) const {
  size_t n = 0;
  for (const uint32_t x : path) {
    if (n > 0 && x != kGap && path[n - 1] == Twin(x) && x / 2 >= crossings_.first_made()) {
      --n;
    } else {
      path[n++] = x;
    }
  }
  path.resize(n);
}

// Sets the path of an edge of S to changed_; edges of the mesh from `made` on are new to it.
void SurfaceMap::Change(uint32_t edge, uint32_t made) {
  edges_.SetPath(edge, changed_);
  for (const uint32_t x : changed_) {
    if (x != kGap && x / 2 >= made) crossings_.AddCrosser(x, edge);
  }
}

void SurfaceMap::HandOn(const Hole& hole, const Hole::Triangles& triangles, const Masks& masks,
                        uint32_t first) {
  const uint32_t made = crossings_.edges();
  const auto diagonals = crossings_.NumberFilling(hole, triangles, leaving_, first);
  for (const uint32_t edge : star_edges_) {
    if (crossings_[edge].code == kSpoke) crossings_.FreeCrossers(edge);
  }
  const auto append = [&](End a, End b) {
    const Behind from = masks.Of(a);
    const Behind to = masks.Of(b);
    uint32_t up = from.behind & ~to.behind & ~to.on;
    for (; up != 0; up &= ~std::bit_floor(up)) {
      changed_.push_back(diagonals[static_cast<uint32_t>(std::bit_width(up)) - 1]);
    }
    uint32_t down = to.behind & ~from.behind & ~from.on;
    for (; down != 0; down &= down - 1) {
      changed_.push_back(Twin(diagonals[static_cast<uint32_t>(std::countr_zero(down))]));
    }
  };
  for (const InnerEdge& inner : inner_edges()) {
    if (masks.Between(inner.from, inner.to) == 0) continue;
    if (HasPath(inner.edge)) continue;
    changed_.clear();
    append(inner.from, inner.to);
    Change(inner.edge, made);
  }
  for (size_t p = 0; p < parts_.size();) {
    const uint32_t edge = parts_[p].edge;
    const std::span<const uint32_t> old = edges_.path(edges_[edge]);
    changed_.clear();
    uint32_t from = 0;
    for (; p < parts_.size() && parts_[p].edge == edge; ++p) {
      const Part& part = parts_[p];
      changed_.insert(changed_.end(), old.begin() + from, old.begin() + part.begin);
      append(part.from, part.to);
      from = part.end;
    }
    changed_.insert(changed_.end(), old.begin() + from, old.end());
    Reduce(changed_);
    Change(edge, made);
  }
  edges_.DropUnused();
}

}  // namespace mtdb::internal
