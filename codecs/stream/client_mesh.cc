// SPDX-License-Identifier: Apache-2.0
#include "codecs/stream/client_mesh.h"

#include <algorithm>
#include <cstring>
#include <tuple>

#include "codecs/coding/cluster_model.h"
#include "codecs/stream/internal/memory_bytes.h"
#include "store/base/float4.h"

namespace mtdb {

using namespace internal;

namespace {

std::vector<ClientMesh::Range> Ranges(std::vector<uint32_t>& slots) {
  std::sort(slots.begin(), slots.end());
  std::vector<ClientMesh::Range> ranges;
  for (const uint32_t slot : slots) {
    if (ranges.empty() || slot > ranges.back().end) {
      ranges.push_back({slot, slot + 1});
    } else {
      ranges.back().end = slot + 1;
    }
  }
  slots.clear();
  return ranges;
}

uint32_t NextCorner(uint32_t i) { return i == 2 ? 0 : i + 1; }

}  // namespace

ClientMesh::ClientMesh(const ClientMeshOptions& options, bool drawn)
    : options_(options), row_bytes_(options.attributes.row_bytes()), drawn_(drawn) {}

ClientMesh::Changes ClientMesh::TakeChanges() {
  return {Ranges(changed_triangles_), Ranges(changed_vertices_)};
}

void ClientMesh::Start(Vec3d origin, std::span<const Vec3i> positions, const Bytes& rows,
                       std::span<const std::array<uint32_t, 3>> triangles) {
  origin_ = origin;
  for (size_t v = 0; v < positions.size(); ++v) {
    AddVertex(positions[v], rows.data() + v * row_bytes_);
  }
  for (const auto& t : triangles) AddTriangle(t, kNone32);
  PairAll();
}

void ClientMesh::ExpectMore(size_t vertices) {
  const auto room = [](auto& values, size_t more, size_t reused) {
    if (more > reused) ReserveTight(values, values.size() + more - reused);
  };
  room(triangles_, 2 * vertices, free_triangles_.size());
  room(points_, vertices, free_vertices_.size());
  room(degree_, vertices, free_vertices_.size());
  room(half_edge_, vertices, free_vertices_.size());
  room(first_of_ring_, vertices, free_vertices_.size());
  room(place_, vertices, free_vertices_.size());
  room(rows_, vertices * row_bytes_, free_vertices_.size() * row_bytes_);
}

uint32_t ClientMesh::AddVertex(Vec3i position, const std::byte* row) {
  uint32_t vertex = vertex_slots();
  if (free_vertices_.empty()) {
    ResizeTight(points_, points_.size() + 1);
    if (drawn_) floats_.resize(floats_.size() + 3);
    ResizeTight(rows_, rows_.size() + row_bytes_);
    AppendTight(degree_, 0U);
    AppendTight(half_edge_, kNone32);
    AppendTight(first_of_ring_, kNone32);
    AppendTight(place_, kNone32);
  } else {
    vertex = free_vertices_.back();
    free_vertices_.pop_back();
    place_[vertex] = kNone32;
  }
  points_[vertex] = Word4{static_cast<uint32_t>(position.x), static_cast<uint32_t>(position.y),
                          static_cast<uint32_t>(position.z), 0};
  if (row_bytes_ != 0) std::memcpy(rows_.data() + vertex * row_bytes_, row, row_bytes_);
  ++vertex_count_;
  if (!drawn_) return vertex;
  const Vec3d p = options_.grid.Position(position) - origin_;
  for (int i = 0; i < 3; ++i)
    floats_[3 * size_t{vertex} + static_cast<size_t>(i)] = static_cast<float>(p[i]);
  changed_vertices_.push_back(vertex);
  return vertex;
}

void ClientMesh::Recall(uint32_t vertex) {
  const uint32_t last = remembered_.back();
  remembered_[place_[vertex]] = last;
  place_[last] = place_[vertex];
  place_[vertex] = kNone32;
  remembered_.pop_back();
  ++vertex_count_;
}

uint32_t ClientMesh::Forget(uint32_t vertex, uint32_t first_of_ring) {
  --vertex_count_;
  uint32_t lost = vertex;
  if (remembered_.size() < options_.remembered_vertices) {
    lost = kNone32;
    place_[vertex] = static_cast<uint32_t>(remembered_.size());
    remembered_.push_back(vertex);
  } else if (!remembered_.empty()) {
    oldest_ = oldest_ < remembered_.size() ? oldest_ : 0;
    lost = remembered_[oldest_];
    remembered_[oldest_] = vertex;
    place_[vertex] = oldest_++;
  }
  first_of_ring_[vertex] = first_of_ring;
  if (lost != kNone32) {
    place_[lost] = kNowhere;
    free_vertices_.push_back(lost);
  }
  return lost;
}

uint32_t ClientMesh::AddTriangle(const std::array<uint32_t, 3>& corners, uint32_t fills) {
  uint32_t slot = triangle_slots();
  if (free_triangles_.empty()) {
    ResizeTight(triangles_, triangles_.size() + 1);
    if (drawn_) indices_.resize(indices_.size() + 3);
  } else {
    slot = free_triangles_.back();
    free_triangles_.pop_back();
  }
  triangles_[slot] = {corners, {kNone32, kNone32, kNone32}, next_born_++, fills};
  Measure(triangles_[slot]);
  for (uint32_t i = 0; i < 3; ++i) {
    ++degree_[corners[i]];
    half_edge_[corners[i]] = 4 * slot + i;
  }
  ++triangle_count_;
  if (!drawn_) return slot;
  for (uint32_t i = 0; i < 3; ++i) indices_[3 * size_t{slot} + i] = corners[i];
  changed_triangles_.push_back(slot);
  return slot;
}

void ClientMesh::Measure(Triangle& t) const {
  const Word4 p = points_[t.corners[0]];
  const Word4 q = points_[t.corners[1]];
  const Word4 r = points_[t.corners[2]];
  const Float4 a = Offset4(q, p);
  const Float4 b = Offset4(r, q);
  const Float4 c = Offset4(p, r);
  const Columns4 squares = Transpose(a * a, b * b, c * c, Float4{});
  const Float4 lengths = squares.x + squares.y + squares.z;
  const Float4 others = Turn(lengths) + Turn(Turn(lengths));
  const Int4 bluntness = ToInt(Min4(60 * lengths / (others + 1e-30f), Splat4(120)));
  for (size_t i = 0; i < 3; ++i) {
    t.exponents[i] =
        lengths[i] < 1 ? Triangle::kNoLength : static_cast<uint8_t>(ExponentOf(lengths[i]));
    t.bluntness[i] = static_cast<uint8_t>(bluntness[i]);
  }
}

// An edge that occurs twice in one direction is non-manifold: it pairs with nothing.
void ClientMesh::PairAll() {
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

void ClientMesh::Replace(std::span<const uint32_t> removed,
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
      if (o == kNone32 || triangles_[o >> 2].born == 0) continue;
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

void ClientMesh::ReplaceByStar(std::span<const uint32_t> hole, std::span<const uint32_t> ring,
                               std::span<const uint32_t> outer, uint32_t vertex, bool boundary,
                               std::vector<uint32_t>* slots) {
  for (const uint32_t slot : hole) {
    const Triangle& t = triangles_[slot];
    for (uint32_t i = 0; i < 3; ++i) {
      if (t.opposite[i] != kNone32) continue;
      Close(t.corners[i], t.corners[NextCorner(i)], 4 * slot + i);
    }
  }
  GiveUp(hole);
  const size_t count = ring.size() - (boundary ? 1 : 0);
  uint32_t first = 0;
  uint32_t last = 0;
  for (size_t j = 0; j < count; ++j) {
    const uint32_t to = ring[j + 1 == ring.size() ? 0 : j + 1];
    const uint32_t slot = AddTriangle({vertex, ring[j], to}, kNone32);
    slots->push_back(slot);
    if (outer[j] != kNone32) {
      Join(4 * slot + 1, outer[j]);
    } else {
      Open(ring[j], to, 4 * slot + 1);
    }
    if (j == 0) {
      first = slot;
    } else {
      Join(4 * last + 2, 4 * slot);
    }
    last = slot;
  }
  if (!boundary) {
    Join(4 * last + 2, 4 * first);
    return;
  }
  Open(vertex, ring.front(), 4 * first);
  Open(ring.back(), vertex, 4 * last + 2);
  // What lay beyond the split edge has no opposite any more.
  if (const uint32_t o = outer[count]; o != kNone32) {
    triangles_[o >> 2].opposite[o & 3] = kNone32;
    Open(ring.front(), ring.back(), o);
  }
}

// The triangles are here no more, and give up their slots.
void ClientMesh::GiveUp(std::span<const uint32_t> triangles) {
  for (const uint32_t slot : triangles) {
    Triangle& t = triangles_[slot];
    t.born = 0;
    for (uint32_t i = 0; i < 3; ++i) --degree_[t.corners[i]];
    if (!drawn_) continue;
    for (uint32_t i = 0; i < 3; ++i) indices_[3 * size_t{slot} + i] = 0;
    changed_triangles_.push_back(slot);
  }
  triangle_count_ -= static_cast<uint32_t>(triangles.size());
  free_triangles_.insert(free_triangles_.end(), triangles.rbegin(), triangles.rend());
}

// Makes two half-edges opposite.
void ClientMesh::Join(uint32_t g, uint32_t h) {
  triangles_[g >> 2].opposite[g & 3] = h;
  triangles_[h >> 2].opposite[h & 3] = g;
}

void ClientMesh::Drop(std::span<const uint32_t> triangles, std::vector<uint32_t>* left_over) {
  Replace(triangles, {}, kNone32, nullptr);
  // What a free slot was is still there.
  const auto first = static_cast<std::ptrdiff_t>(left_over->size());
  for (const uint32_t slot : triangles) {
    for (const uint32_t v : triangles_[slot].corners) {
      if (degree_[v] == 0) left_over->push_back(v);
    }
  }
  std::sort(left_over->begin() + first, left_over->end());
  left_over->erase(std::unique(left_over->begin() + first, left_over->end()), left_over->end());
}

uint32_t ClientMesh::Attach(const std::array<uint32_t, 3>& corners) {
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

uint32_t ClientMesh::OpenHalfEdge(uint32_t from, uint32_t to) const {
  const uint64_t edge = uint64_t{from} << 32 | to;
  const auto at = open_.lower_bound({edge, 0});
  return at != open_.end() && at->first == edge ? at->second : kNone32;
}

void ClientMesh::Open(uint32_t from, uint32_t to, uint32_t half_edge) {
  open_.emplace(uint64_t{from} << 32 | to, half_edge);
}

void ClientMesh::Close(uint32_t from, uint32_t to, uint32_t half_edge) {
  open_.erase({uint64_t{from} << 32 | to, half_edge});
}

size_t ClientMesh::memory_bytes() const {
  constexpr size_t kOpenEdgeBytes = 64;  // a node of a tree
  return sizeof(*this) + CapacityBytes(triangles_) + CapacityBytes(indices_) +
         CapacityBytes(free_triangles_) + CapacityBytes(points_) + CapacityBytes(floats_) +
         CapacityBytes(rows_) + CapacityBytes(degree_) + CapacityBytes(half_edge_) +
         CapacityBytes(first_of_ring_) + CapacityBytes(place_) + CapacityBytes(remembered_) +
         CapacityBytes(free_vertices_) + CapacityBytes(outer_) + CapacityBytes(changed_triangles_) +
         CapacityBytes(changed_vertices_) + open_.size() * kOpenEdgeBytes;
}

}  // namespace mtdb
