// SPDX-License-Identifier: Apache-2.0
// ReplayedMesh: a client's mesh as the two ends of a stream work on it.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <set>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "codecs/stream/client_mesh.h"
#include "store/base/float4.h"
#include "store/base/in_circle.h"

namespace mtdb::internal {

// What readers of it need to know is in client_mesh.h.
class ReplayedMesh {
 public:
  struct Triangle {
    std::array<uint32_t, 3> corners{};   // vertex slots
    std::array<uint32_t, 3> opposite{};  // twin of each half-edge, or kNone32
    uint32_t fills = kNone32;            // the vertex whose removal made it, or kNone32
    // For the codec. Per half-edge: the exponent of its squared length, or kNoLength; how blunt the
    // corner is that faces it (see Patch).
    std::array<uint8_t, 3> exponents{};
    std::array<uint8_t, 3> bluntness{};
    std::array<uint16_t, 3> born_words{};  // see born()
    static constexpr uint8_t kNoLength = 255;

    // Grows with each new triangle; 0: none is here.
    uint64_t born() const { return last_word() >> 16; }
    // Words are written as they are read: a processor passes a value from a store to a load behind
    // it only when that holds all of it.
    void set_born(uint64_t born) { set_last_word(born << 16); }
    // The bytes of exponents and bluntness; behind set_born.
    void set_shape(uint64_t bytes) {
      const auto first = static_cast<uint32_t>(bytes);
      std::memcpy(reinterpret_cast<char*>(this) + 28, &first, sizeof(first));
      set_last_word((last_word() & ~uint64_t{0xffff}) | bytes >> 32);
    }

   private:
    uint64_t last_word() const {
      uint64_t word;
      std::memcpy(&word, reinterpret_cast<const char*>(this) + 32, sizeof(word));
      return word;
    }
    void set_last_word(uint64_t word) {
      std::memcpy(reinterpret_cast<char*>(this) + 32, &word, sizeof(word));
    }
  };
  static_assert(sizeof(Triangle) == 40 && offsetof(Triangle, born_words) == 34);
  using Range = ClientMesh::Range;
  using Changes = ClientMesh::Changes;

  const ClientMeshOptions& options() const { return options_; }
  uint32_t triangle_count() const { return triangle_count_; }
  uint32_t vertex_count() const { return vertex_count_; }  // without remembered ones
  uint32_t triangle_slots() const { return static_cast<uint32_t>(triangles_.size()); }
  uint32_t vertex_slots() const { return static_cast<uint32_t>(vertices_.size()); }
  bool has_triangle(uint32_t slot) const {
    return slot < triangles_.size() && triangles_[slot].born() != 0;
  }
  bool has_vertex(uint32_t slot) const {
    return slot < vertices_.size() && vertices_[slot].degree > 0;
  }
  const Triangle& triangle(uint32_t slot) const { return triangles_[slot]; }
  // Triangles at a vertex.
  uint32_t degree(uint32_t vertex) const { return vertices_[vertex].degree; }
  // The removed vertices that are remembered, in no order that has a meaning.
  std::span<const uint32_t> remembered() const { return remembered_; }
  bool is_remembered(uint32_t vertex) const {
    return vertex < vertices_.size() && vertices_[vertex].place < kNowhere;
  }
  // On the grid; Grid::Position makes model units of it.
  Vec3i position(uint32_t vertex) const {
    const Word4 p = vertices_[vertex].point;
    return {static_cast<int32_t>(p[0]), static_cast<int32_t>(p[1]), static_cast<int32_t>(p[2])};
  }
  ByteSpan row(uint32_t vertex) const {
    return ByteSpan(rows_).subspan(vertex * row_bytes_, row_bytes_);
  }

  // For a GPU: three indices a triangle slot, three floats a vertex slot, relative to origin().
  std::span<const uint32_t> indices() const { return indices_; }
  std::span<const float> positions() const { return floats_; }
  Vec3d origin() const { return origin_; }
  const Bytes& rows() const { return rows_; }
  // Memory, about.
  size_t memory_bytes() const;
  // The slots that were written since the last call, as ranges that do not touch each other.
  Changes TakeChanges();

 private:
  // A bit for each slot.
  class SlotSet {
   public:
    void Add(uint32_t slot) {
      if (slot / 64 >= words_.size())
        words_.resize(words_.size() + words_.size() / 4 + slot / 64 + 1);
      words_[slot / 64] |= uint64_t{1} << (slot % 64);
    }
    // Calls f(slot) for each, ascending, and leaves none.
    template <typename F>
    void TakeEach(F&& f) {
      for (size_t w = 0; w < words_.size(); ++w) {
        for (uint64_t left = std::exchange(words_[w], 0); left != 0; left &= left - 1) {
          f(static_cast<uint32_t>(64 * w) + static_cast<uint32_t>(std::countr_zero(left)));
        }
      }
    }
    size_t memory_bytes() const { return words_.capacity() * sizeof(uint64_t); }

   private:
    std::vector<uint64_t> words_;
  };
  struct alignas(32) Vertex {
    Word4 point{};                 // x, y, z, 0
    uint32_t degree = 0;           // triangles at it
    uint32_t half_edge = kNone32;  // see half_edge_of
    uint32_t first_of_ring = kNone32;
    uint32_t place = kNone32;  // in remembered_; kNone32: not there; kNowhere: a free slot
  };

 public:
  ReplayedMesh() = default;
  // One that is not `drawn`, as a sender's, has no arrays for a GPU and notes no changes.
  ReplayedMesh(const ClientMeshOptions& options, bool drawn);

  LatticePoint place(uint32_t vertex) const {
    const Vec3i p = position(vertex);
    return {p.x, p.y};
  }
  // Where the Delaunay rule holds: the remembered vertex at a place, or kNone32.
  uint32_t RememberedAt(LatticePoint p) const {
    const auto at = remembered_at_.find(PlaceKey(p));
    return at == remembered_at_.end() ? kNone32 : at->second;
  }

  // By vertex slots: x, y, z, 0.
  class Points {
   public:
    explicit Points(const ReplayedMesh& mesh) : vertices_(mesh.vertices_.data()) {}
    Word4 operator[](size_t vertex) const { return vertices_[vertex].point; }

   private:
    const Vertex* vertices_;
  };
  Points points() const { return Points(*this); }
  // Ask for the memory of a vertex; of a triangle; of what lies beyond its edges; of its corners.
  // Always inline: GCC leaves out calls of functions that do nothing else. WebAssembly cannot ask:
  // there all that leads up to it is left out.
#ifdef __wasm__
  static constexpr bool kPrefetches = false;
#else
  static constexpr bool kPrefetches = true;
#endif
  [[gnu::always_inline]] void PrefetchVertex(uint32_t vertex) const {
    __builtin_prefetch(vertices_.data() + vertex);
  }
  [[gnu::always_inline]] void PrefetchTriangle(uint32_t slot) const {
    const char* const at = reinterpret_cast<const char*>(triangles_.data() + slot);
    __builtin_prefetch(at);
    __builtin_prefetch(at + sizeof(Triangle) - 1);
  }
  [[gnu::always_inline]] void PrefetchBeyond(uint32_t slot) const {
    if constexpr (!kPrefetches) return;
    for (const uint32_t o : triangles_[slot].opposite) {
      if (o != kNone32) PrefetchTriangle(o >> 2);
    }
  }
  [[gnu::always_inline]] void PrefetchCorners(uint32_t slot) const {
    if constexpr (!kPrefetches) return;
    for (const uint32_t v : triangles_[slot].corners) PrefetchVertex(v);
  }
  // What the next triangle's `born` will be.
  uint64_t next_born() const { return next_born_; }
  // A half-edge that leaves the vertex, which has triangles.
  uint32_t half_edge_of(uint32_t vertex) const { return vertices_[vertex].half_edge; }
  // Whether the slot holds a vertex, be it of the mesh, remembered, or left over by Drop.
  bool is_known(uint32_t vertex) const {
    return vertex < vertices_.size() && vertices_[vertex].place != kNowhere;
  }
  // Of a remembered boundary vertex: the first of its ring; kNone32 of any other.
  uint32_t first_of_ring(uint32_t vertex) const { return vertices_[vertex].first_of_ring; }

  // Brings the indices for a GPU up to date: many triangles come and go in one update.
  void Draw();
  // Makes a mesh of what has neither triangles nor vertices. `triangles` name existing vertices.
  void Start(Vec3d origin, std::span<const Vec3i> positions, const Bytes& rows,
             std::span<const std::array<uint32_t, 3>> triangles);
  // So many vertices are about to come, each with two triangles more: makes room at once.
  void ExpectMore(size_t vertices);
  // Puts a new vertex in a slot. `row`: row_bytes bytes.
  uint32_t AddVertex(Vec3i position, const std::byte* row);
  // A remembered vertex is one of the mesh again.
  void Recall(uint32_t vertex);
  // The first of the half-edges from `from` to `to` that have no opposite, or kNone32.
  uint32_t OpenHalfEdge(uint32_t from, uint32_t to) const;
  // Takes triangles away. Vertices that have none any more are appended to `left_over`: they are to
  // be used by Attach, or forgotten.
  void Drop(std::span<const uint32_t> triangles, std::vector<uint32_t>* left_over);
  // Adds a triangle beside those that are there; returns its slot.
  uint32_t Attach(const std::array<uint32_t, 3>& corners);
  // The vertex, which has no triangles any more, is remembered, if there is room for any; returns
  // the vertex that has to go for it (perhaps itself), or kNone32.
  uint32_t Forget(uint32_t vertex, uint32_t first_of_ring);
  // Replaces triangles by others with the same boundary. Appends the slots of the new ones, in
  // their order, to `slots` unless null.
  void Replace(std::span<const uint32_t> removed, std::span<const std::array<uint32_t, 3>> created,
               uint32_t fills, std::vector<uint32_t>* slots);
  // Likewise a hole that is a disc, by the star of a vertex that has no triangles. Beyond ring edge
  // j, from ring[j] to ring[j+1], lies half-edge outer[j]. A boundary vertex splits the last edge.
  void ReplaceByStar(std::span<const uint32_t> hole, std::span<const uint32_t> ring,
                     std::span<const uint32_t> outer, uint32_t vertex, bool boundary,
                     std::vector<uint32_t>* slots);
  // Likewise the star of a vertex by triangles of its ring, three ascending places each. Star
  // triangle j lies at ring edge j; a boundary vertex has none at the last edge. A triangle comes
  // after the one beyond the edge between its first place and its last. The ring has at most
  // kMaxRing vertices, all different.
  void ReplaceStar(std::span<const uint32_t> star, std::span<const uint32_t> ring,
                   std::span<const std::array<uint32_t, 3>> places, uint32_t vertex, bool boundary,
                   std::vector<uint32_t>* slots);

 private:
  // The directed edge that a new triangle must have to lie across `half_edge`.
  struct Edge {
    uint32_t from, to, half_edge;
  };
  uint32_t AddTriangle(const std::array<uint32_t, 3>& corners, uint32_t fills);
  // Appends slots for new triangles.
  void AddSlots(size_t count, std::vector<uint32_t>& slots);
  // Everything of a new triangle but its shape. The caller links it, and measures it at the end.
  Triangle& PutTriangle(uint32_t slot, const std::array<uint32_t, 3>& corners, uint32_t fills);
  // Sets the shapes of new triangles, which are to be drawn.
  void Measure(std::span<const uint32_t> slots);
  void GiveUp(std::span<const uint32_t> triangles);
  // The slots that `count` new triangles take which replace others: those of the old ones first.
  // Appends them to `slots`. The old ones are here no more, but can still be read.
  void Exchange(std::span<const uint32_t> removed, size_t count, std::vector<uint32_t>& slots);
  void CloseAll(std::span<const uint32_t> triangles);
  // Room for `more` values. What is drawn grows by halves, a sender by quarters, if ExpectMore did
  // not say by how much.
  template <typename T>
  void MakeRoom(std::vector<T>& values, size_t more) const {
    const size_t size = values.size() + more;
    if (size > values.capacity()) {
      values.reserve(std::max(size, values.size() + values.size() / (drawn_ ? 2 : 4) + 16));
    }
  }
  void Join(uint32_t g, uint32_t h);
  void PairAll();
  void Open(uint32_t from, uint32_t to, uint32_t half_edge);
  void Close(uint32_t from, uint32_t to, uint32_t half_edge);

  static uint64_t PlaceKey(LatticePoint p) {
    return static_cast<uint64_t>(p.x) << 32 | static_cast<uint32_t>(p.y);
  }
  // Of a vertex that is not remembered any more: forgets its place.
  void Unlist(uint32_t vertex);

  static constexpr uint32_t kNowhere = kNone32 - 1;

  ClientMeshOptions options_;
  size_t row_bytes_ = 0;
  bool drawn_ = true;
  Vec3d origin_;
  uint32_t triangle_count_ = 0;
  uint32_t vertex_count_ = 0;
  uint64_t next_born_ = 1;
  std::vector<Triangle> triangles_;
  std::vector<uint32_t> indices_;
  std::vector<uint32_t> free_triangles_;
  std::vector<Vertex> vertices_;
  std::vector<float> floats_;
  Bytes rows_;
  std::vector<uint32_t> remembered_;
  uint32_t oldest_ = 0;                                   // of remembered_: the next one to go
  std::unordered_map<uint64_t, uint32_t> remembered_at_;  // by PlaceKey
  std::vector<uint32_t> free_vertices_;
  std::set<std::pair<uint64_t, uint32_t>> open_;  // (from, to) of half-edges without an opposite
  std::vector<Edge> outer_;                       // scratch of Replace
  std::vector<uint32_t> scratch_;
  SlotSet undrawn_;  // triangles that were written since the last Draw
  SlotSet changed_triangles_;
  SlotSet changed_vertices_;
};

}  // namespace mtdb::internal
