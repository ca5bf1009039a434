// SPDX-License-Identifier: Apache-2.0
#include "codecs/stream/internal/replayed_mesh.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <tuple>

#include "codecs/coding/cluster_model.h"
#include "codecs/stream/internal/memory_bytes.h"

namespace mtdb::internal {
namespace {

uint32_t NextCorner(uint32_t i) { return i == 2 ? 0 : i + 1; }

}  // namespace

ReplayedMesh::ReplayedMesh(const ClientMeshOptions& options, bool drawn)
    : options_(options), row_bytes_(options.attributes.row_bytes()), drawn_(drawn) {}

ReplayedMesh::Changes ReplayedMesh::TakeChanges() {
  const auto ranges = [](SlotSet& slots) {
    std::vector<Range> result;
    slots.TakeEach([&](uint32_t slot) {
      if (result.empty() || slot > result.back().end) {
        result.push_back({slot, slot + 1});
      } else {
        result.back().end = slot + 1;
      }
    });
    return result;
  };
  return {ranges(changed_triangles_), ranges(changed_vertices_)};
}

void ReplayedMesh::Draw() {
  indices_.resize(3 * triangles_.size());
  undrawn_.TakeEach([&](uint32_t slot) {
    const Triangle& t = triangles_[slot];
    const bool here = t.born() != 0;
    for (size_t i = 0; i < 3; ++i) indices_[3 * size_t{slot} + i] = here ? t.corners[i] : 0;
    changed_triangles_.Add(slot);
  });
}

void ReplayedMesh::Start(Vec3d origin, std::span<const Vec3i> positions, const Bytes& rows,
                         std::span<const std::array<uint32_t, 3>> triangles) {
  origin_ = origin;
  for (size_t v = 0; v < positions.size(); ++v) {
    AddVertex(positions[v], rows.data() + v * row_bytes_);
  }
  std::vector<uint32_t> slots;
  AddSlots(triangles.size(), slots);
  for (size_t t = 0; t < triangles.size(); ++t) PutTriangle(slots[t], triangles[t], kNone32);
  Measure(slots);
  PairAll();
}

void ReplayedMesh::ExpectMore(size_t vertices) {
  const auto room = [](auto& values, size_t more, size_t reused) {
    if (more > reused) ReserveTight(values, values.size() + more - reused);
  };
  room(triangles_, 2 * vertices, free_triangles_.size());
  room(vertices_, vertices, free_vertices_.size());
  room(rows_, vertices * row_bytes_, free_vertices_.size() * row_bytes_);
}

uint32_t ReplayedMesh::AddVertex(Vec3i position, const std::byte* row) {
  uint32_t vertex = vertex_slots();
  if (free_vertices_.empty()) {
    if (drawn_) floats_.resize(floats_.size() + 3);
    MakeRoom(rows_, row_bytes_);
    rows_.resize(rows_.size() + row_bytes_);
    MakeRoom(vertices_, 1);
    vertices_.emplace_back();
  } else {
    vertex = free_vertices_.back();
    free_vertices_.pop_back();
    vertices_[vertex].place = kNone32;
  }
  vertices_[vertex].point =
      Word4{static_cast<uint32_t>(position.x), static_cast<uint32_t>(position.y),
            static_cast<uint32_t>(position.z), 0};
  if (row_bytes_ != 0) std::memcpy(rows_.data() + vertex * row_bytes_, row, row_bytes_);
  ++vertex_count_;
  if (!drawn_) return vertex;
  const Vec3d p = options_.grid.Position(position) - origin_;
  for (int i = 0; i < 3; ++i)
    floats_[3 * size_t{vertex} + static_cast<size_t>(i)] = static_cast<float>(p[i]);
  changed_vertices_.Add(vertex);
  return vertex;
}

void ReplayedMesh::Unlist(uint32_t vertex) {
  const auto at = remembered_at_.find(PlaceKey(place(vertex)));
  if (at != remembered_at_.end() && at->second == vertex) remembered_at_.erase(at);
}

void ReplayedMesh::Recall(uint32_t vertex) {
  Unlist(vertex);
  const uint32_t last = remembered_.back();
  remembered_[vertices_[vertex].place] = last;
  vertices_[last].place = vertices_[vertex].place;
  vertices_[vertex].place = kNone32;
  remembered_.pop_back();
  ++vertex_count_;
}

uint32_t ReplayedMesh::Forget(uint32_t vertex, uint32_t first_of_ring) {
  --vertex_count_;
  uint32_t lost = vertex;
  if (remembered_.size() < options_.remembered_vertices) {
    lost = kNone32;
    vertices_[vertex].place = static_cast<uint32_t>(remembered_.size());
    remembered_.push_back(vertex);
  } else if (!remembered_.empty()) {
    oldest_ = oldest_ < remembered_.size() ? oldest_ : 0;
    lost = remembered_[oldest_];
    remembered_[oldest_] = vertex;
    vertices_[vertex].place = oldest_++;
  }
  vertices_[vertex].first_of_ring = first_of_ring;
  if (lost != kNone32) {
    vertices_[lost].place = kNowhere;
    free_vertices_.push_back(lost);
  }
  if (lost == vertex) return lost;
  if (lost != kNone32) Unlist(lost);
  if (options_.delaunay) remembered_at_[PlaceKey(place(vertex))] = vertex;
  return lost;
}

void ReplayedMesh::AddSlots(size_t count, std::vector<uint32_t>& slots) {
  const size_t reused = std::min(count, free_triangles_.size());
  slots.insert(slots.end(), free_triangles_.rbegin(),
               free_triangles_.rbegin() + static_cast<std::ptrdiff_t>(reused));
  free_triangles_.resize(free_triangles_.size() - reused);
  if (reused == count) return;
  uint32_t next = triangle_slots();
  MakeRoom(triangles_, count - reused);
  triangles_.resize(triangles_.size() + count - reused);
  while (next < triangle_slots()) slots.push_back(next++);
}

ReplayedMesh::Triangle& ReplayedMesh::PutTriangle(uint32_t slot,
                                                  const std::array<uint32_t, 3>& corners,
                                                  uint32_t fills) {
  Triangle& t = triangles_[slot];
  t.corners = corners;
  t.opposite = {kNone32, kNone32, kNone32};
  t.fills = fills;
  t.set_born(next_born_++);
  for (uint32_t i = 0; i < 3; ++i) {
    Vertex& v = vertices_[corners[i]];
    ++v.degree;
    v.half_edge = 4 * slot + i;
  }
  ++triangle_count_;
  return t;
}

uint32_t ReplayedMesh::AddTriangle(const std::array<uint32_t, 3>& corners, uint32_t fills) {
  scratch_.clear();
  AddSlots(1, scratch_);
  PutTriangle(scratch_[0], corners, fills);
  Measure(scratch_);
  return scratch_[0];
}

// Four at a time, the last one again where there are fewer.
void ReplayedMesh::Measure(std::span<const uint32_t> slots) {
  const auto squared = [](const Float4(&edges)[4]) {
    const Columns4 columns = Transpose(edges[0] * edges[0], edges[1] * edges[1],
                                       edges[2] * edges[2], edges[3] * edges[3]);
    return columns.x + columns.y + columns.z;
  };
  const auto exponent = [](Float4 length) {
    const Int4 of_float = (std::bit_cast<Int4>(length) >> 23) - 127;
    const Int4 most = Int4{} + kMaxExponent;
    const Int4 clamped = of_float < most ? of_float : most;
    return std::bit_cast<Word4>(length < 1 ? Int4{} + Triangle::kNoLength : clamped);
  };
  const auto bluntness = [](Float4 facing, Float4 b, Float4 c) {
    return std::bit_cast<Word4>(ToInt(Min4(60 * facing / (b + c + 1e-30f), Splat4(120))));
  };
  if (drawn_) {
    for (const uint32_t slot : slots) undrawn_.Add(slot);
  }
  for (size_t first = 0; first < slots.size(); first += 4) {
    const size_t count = std::min<size_t>(slots.size() - first, 4);
    Float4 edges[3][4];
    for (size_t i = 0; i < 4; ++i) {
      const auto& c = triangles_[slots[first + std::min(i, count - 1)]].corners;
      const Word4 p = vertices_[c[0]].point;
      const Word4 q = vertices_[c[1]].point;
      const Word4 r = vertices_[c[2]].point;
      edges[0][i] = Offset4(q, p);
      edges[1][i] = Offset4(r, q);
      edges[2][i] = Offset4(p, r);
    }
    const Float4 a = squared(edges[0]);
    const Float4 b = squared(edges[1]);
    const Float4 c = squared(edges[2]);
    const Word4 exponents = exponent(a) | exponent(b) << 8 | exponent(c) << 16;
    const Word4 blunt = bluntness(a, b, c) | bluntness(b, c, a) << 8 | bluntness(c, a, b) << 16;
    for (size_t i = 0; i < count; ++i) {
      triangles_[slots[first + i]].set_shape(uint64_t{blunt[i]} << 24 | exponents[i]);
    }
  }
}

// An edge that occurs twice in one direction is non-manifold: it pairs with nothing.
void ReplayedMesh::PairAll() {
  std::vector<std::tuple<uint32_t, uint32_t, bool, uint32_t>> edges;  // low, high, forward
  edges.reserve(3 * triangles_.size());
  for (uint32_t slot = 0; slot < triangle_slots(); ++slot) {
    for (uint32_t i = 0; i < 3; ++i) {
      const uint32_t a = triangles_[slot].corners[i];
      const uint32_t b = triangles_[slot].corners[NextCorner(i)];
      edges.emplace_back(std::min(a, b), std::max(a, b), a < b, 4 * slot + i);
    }
  }
  std::sort(edges.begin(), edges.end());
  for (size_t begin = 0, end; begin < edges.size(); begin = end) {
    const auto same = [&](size_t i) {
      return std::get<0>(edges[i]) == std::get<0>(edges[begin]) &&
             std::get<1>(edges[i]) == std::get<1>(edges[begin]);
    };
    for (end = begin + 1; end < edges.size() && same(end);) ++end;
    if (end - begin != 2 || std::get<2>(edges[begin]) == std::get<2>(edges[begin + 1])) {
      for (size_t i = begin; i < end; ++i) {
        const auto& [low, high, forward, half_edge] = edges[i];
        Open(forward ? low : high, forward ? high : low, half_edge);
      }
      continue;
    }
    Join(std::get<3>(edges[begin]), std::get<3>(edges[begin + 1]));
  }
}

void ReplayedMesh::Replace(std::span<const uint32_t> removed,
                           std::span<const std::array<uint32_t, 3>> created, uint32_t fills,
                           std::vector<uint32_t>* slots) {
  // What lies beyond the edges around the removed triangles.
  std::vector<Edge>& outer = outer_;
  outer.clear();
  GiveUp(removed);
  for (const uint32_t slot : removed) {
    const Triangle& t = triangles_[slot];
    for (uint32_t i = 0; i < 3; ++i) {
      const uint32_t o = t.opposite[i];
      if (o == kNone32) Close(t.corners[i], t.corners[NextCorner(i)], 4 * slot + i);
      if (o == kNone32 || triangles_[o >> 2].born() == 0) continue;
      triangles_[o >> 2].opposite[o & 3] = kNone32;
      outer.push_back({t.corners[i], t.corners[NextCorner(i)], o});
    }
  }
  // An edge finds its twin among those before it, and takes it off the list.
  for (const auto& corners : created) {
    const uint32_t slot = AddTriangle(corners, fills);
    if (slots != nullptr) slots->push_back(slot);
    for (uint32_t i = 0; i < 3; ++i) {
      const uint32_t from = corners[i];
      const uint32_t to = corners[NextCorner(i)];
      const auto twin = std::find_if(outer.begin(), outer.end(),
                                     [&](const Edge& e) { return e.from == from && e.to == to; });
      if (twin == outer.end()) {
        outer.push_back({to, from, 4 * slot + i});
        continue;
      }
      Join(4 * slot + i, twin->half_edge);
      outer.erase(twin);
    }
  }
  for (const Edge& e : outer) Open(e.to, e.from, e.half_edge);
}

void ReplayedMesh::ReplaceByStar(std::span<const uint32_t> hole, std::span<const uint32_t> ring,
                                 std::span<const uint32_t> outer, uint32_t vertex, bool boundary,
                                 std::vector<uint32_t>* slots) {
  const size_t count = ring.size() - (boundary ? 1 : 0);
  const size_t first = slots->size();
  CloseAll(hole);
  Exchange(hole, count, *slots);
  const auto star = std::span<const uint32_t>(*slots).subspan(first);
  uint32_t last = star[count - 1];
  for (size_t j = 0; j < count; ++j) {
    const uint32_t slot = star[j];
    const uint32_t o = outer[j];
    const uint32_t to = ring[j + 1 == ring.size() ? 0 : j + 1];
    Triangle& t = triangles_[slot];
    t.corners = {vertex, ring[j], to};
    t.opposite = {4 * last + 2, o, 4 * star[j + 1 == count ? 0 : j + 1]};
    t.fills = kNone32;
    t.set_born(next_born_ + j);
    Vertex& from = vertices_[ring[j]];
    from.degree += 2;
    from.half_edge = 4 * slot + 1;
    if (o != kNone32) {
      triangles_[o >> 2].opposite[o & 3] = 4 * slot + 1;
    } else {
      Open(ring[j], to, 4 * slot + 1);
    }
    last = slot;
  }
  next_born_ += count;
  triangle_count_ += static_cast<uint32_t>(count);
  vertices_[vertex].degree += static_cast<uint32_t>(count);
  vertices_[vertex].half_edge = 4 * last;
  vertices_[ring[boundary ? count : 0]].half_edge = 4 * last + 2;
  Measure(star);
  if (!boundary) return;
  --vertices_[ring.front()].degree;
  ++vertices_[ring.back()].degree;
  triangles_[star.front()].opposite[0] = kNone32;
  triangles_[star.back()].opposite[2] = kNone32;
  Open(vertex, ring.front(), 4 * star.front());
  Open(ring.back(), vertex, 4 * star.back() + 2);
  // What lay beyond the split edge has no opposite any more.
  if (const uint32_t o = outer[count]; o != kNone32) {
    triangles_[o >> 2].opposite[o & 3] = kNone32;
    Open(ring.front(), ring.back(), o);
  }
}

void ReplayedMesh::ReplaceStar(std::span<const uint32_t> star, std::span<const uint32_t> ring,
                               std::span<const std::array<uint32_t, 3>> places, uint32_t vertex,
                               bool boundary, std::vector<uint32_t>* slots) {
  // What lies beyond each ring edge, and between two places the half-edge of the triangle that was
  // made there.
  uint32_t inner[kMaxRing][kMaxRing];
  const auto k = static_cast<uint32_t>(ring.size());
  CloseAll(star);
  for (uint32_t j = 0; j < star.size(); ++j) {
    const Triangle& t = triangles_[star[j]];
    const uint32_t at = t.corners[0] == vertex ? 1 : t.corners[1] == vertex ? 2 : 0;
    inner[j + 1 == k ? 0 : j][j + 1 == k ? j : j + 1] = t.opposite[at];
  }
  if (boundary) inner[0][k - 1] = kNone32;
  const size_t first = slots->size();
  Exchange(star, places.size(), *slots);
  for (size_t i = 0; i < places.size(); ++i) {
    const uint32_t slot = (*slots)[first + i];
    const auto [a, b, c] = places[i];
    Triangle& t = PutTriangle(slot, {ring[a], ring[b], ring[c]}, vertex);
    // An edge of the ring, or one that a later triangle will lie at.
    const auto link = [&](uint32_t side, uint32_t from, uint32_t to, bool outer) {
      uint32_t& beyond = inner[from][to];
      if (!outer) {
        beyond = 4 * slot + side;
        return;
      }
      t.opposite[side] = beyond;
      if (beyond != kNone32) {
        triangles_[beyond >> 2].opposite[beyond & 3] = 4 * slot + side;
      } else {
        Open(t.corners[side], t.corners[NextCorner(side)], 4 * slot + side);
      }
    };
    link(0, a, b, b == a + 1);
    link(1, b, c, c == b + 1);
    link(2, a, c, true);
  }
  Measure(std::span<const uint32_t>(*slots).subspan(first));
}

// The triangles are here no more, and give up their slots.
void ReplayedMesh::GiveUp(std::span<const uint32_t> triangles) {
  for (const uint32_t slot : triangles) {
    Triangle& t = triangles_[slot];
    t.set_born(0);
    for (const uint32_t v : t.corners) --vertices_[v].degree;
    if (drawn_) undrawn_.Add(slot);
  }
  triangle_count_ -= static_cast<uint32_t>(triangles.size());
  free_triangles_.insert(free_triangles_.end(), triangles.rbegin(), triangles.rend());
}

void ReplayedMesh::Exchange(std::span<const uint32_t> removed, size_t count,
                            std::vector<uint32_t>& slots) {
  const size_t kept = std::min(removed.size(), count);
  for (const uint32_t slot : removed.first(kept)) {
    for (const uint32_t v : triangles_[slot].corners) --vertices_[v].degree;
  }
  triangle_count_ -= static_cast<uint32_t>(kept);
  GiveUp(removed.subspan(kept));
  slots.insert(slots.end(), removed.begin(), removed.begin() + static_cast<std::ptrdiff_t>(kept));
  AddSlots(count - kept, slots);
}

// Edges of the triangles without anything beyond them are none of the mesh any more.
void ReplayedMesh::CloseAll(std::span<const uint32_t> triangles) {
  if (open_.empty()) return;
  for (const uint32_t slot : triangles) {
    const Triangle& t = triangles_[slot];
    for (uint32_t i = 0; i < 3; ++i) {
      if (t.opposite[i] == kNone32) Close(t.corners[i], t.corners[NextCorner(i)], 4 * slot + i);
    }
  }
}

// Makes two half-edges opposite.
void ReplayedMesh::Join(uint32_t g, uint32_t h) {
  triangles_[g >> 2].opposite[g & 3] = h;
  triangles_[h >> 2].opposite[h & 3] = g;
}

void ReplayedMesh::Drop(std::span<const uint32_t> triangles, std::vector<uint32_t>* left_over) {
  Replace(triangles, {}, kNone32, nullptr);
  // What a free slot was is still there.
  const auto first = static_cast<std::ptrdiff_t>(left_over->size());
  for (const uint32_t slot : triangles) {
    for (const uint32_t v : triangles_[slot].corners) {
      if (vertices_[v].degree == 0) left_over->push_back(v);
    }
  }
  std::sort(left_over->begin() + first, left_over->end());
  left_over->erase(std::unique(left_over->begin() + first, left_over->end()), left_over->end());
}

uint32_t ReplayedMesh::Attach(const std::array<uint32_t, 3>& corners) {
  const uint32_t slot = AddTriangle(corners, kNone32);
  for (uint32_t i = 0; i < 3; ++i) {
    const uint32_t from = corners[i];
    const uint32_t to = corners[NextCorner(i)];
    const uint32_t o = OpenHalfEdge(to, from);
    if (o == kNone32) {
      Open(from, to, 4 * slot + i);
      continue;
    }
    Close(to, from, o);
    Join(4 * slot + i, o);
  }
  return slot;
}

uint32_t ReplayedMesh::OpenHalfEdge(uint32_t from, uint32_t to) const {
  const uint64_t edge = uint64_t{from} << 32 | to;
  const auto at = open_.lower_bound({edge, 0});
  return at != open_.end() && at->first == edge ? at->second : kNone32;
}

void ReplayedMesh::Open(uint32_t from, uint32_t to, uint32_t half_edge) {
  open_.emplace(uint64_t{from} << 32 | to, half_edge);
}

void ReplayedMesh::Close(uint32_t from, uint32_t to, uint32_t half_edge) {
  open_.erase({uint64_t{from} << 32 | to, half_edge});
}

size_t ReplayedMesh::memory_bytes() const {
  constexpr size_t kOpenEdgeBytes = 64;  // a node of a tree
  constexpr size_t kPlaceBytes = 48;
  return sizeof(*this) + CapacityBytes(triangles_) + CapacityBytes(indices_) +
         CapacityBytes(free_triangles_) + CapacityBytes(floats_) + CapacityBytes(rows_) +
         CapacityBytes(vertices_) + CapacityBytes(remembered_) + CapacityBytes(free_vertices_) +
         CapacityBytes(outer_) + undrawn_.memory_bytes() + changed_triangles_.memory_bytes() +
         changed_vertices_.memory_bytes() + open_.size() * kOpenEdgeBytes +
         remembered_at_.size() * kPlaceBytes;
}

}  // namespace mtdb::internal
