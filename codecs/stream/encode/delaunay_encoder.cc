// SPDX-License-Identifier: Apache-2.0
#include "codecs/stream/encode/delaunay_encoder.h"

#include <algorithm>

#include "codecs/stream/encode/whole_cut.h"
#include "store/base/check.h"

namespace mtdb::internal {

DelaunayEncoder::Corners DelaunayEncoder::Rotated(Corners c) {
  std::rotate(c.begin(), std::min_element(c.begin(), c.end()), c.end());
  return c;
}

DelaunayEncoder::Corners DelaunayEncoder::CornersOf(uint32_t slot) const {
  const auto& c = s_.mesh.triangle(slot).corners;
  return Rotated({s_.vertices.key(c[0]), s_.vertices.key(c[1]), s_.vertices.key(c[2])});
}

bool DelaunayEncoder::IsMeshLawful() const {
  const ReplayedMesh& mesh = s_.mesh;
  for (uint32_t slot = 0; slot < mesh.triangle_slots(); ++slot) {
    if (!mesh.has_triangle(slot)) continue;
    const LatticeTriangle t = PlacesOf(mesh, slot);
    if (Turn(t[0], t[1], t[2]) <= 0) return false;
    for (const uint32_t o : mesh.triangle(slot).opposite) {
      if (o == kNone32) continue;
      const uint32_t apex = mesh.triangle(o >> 2).corners[Patch::Next(Patch::Next(o)) & 3];
      const LatticePoint p = mesh.place(apex);
      if (IsCorner(t, p) || IsInCircle(t[0], t[1], t[2], p)) return false;
    }
  }
  return true;
}

LatticePoint DelaunayEncoder::PlaceOf(VertexIndex vertex) const {
  if (const LatticePoint* const place = seen_.Find(vertex)) return *place;
  const uint32_t slot = s_.vertices.Find(vertex);
  MTDB_CHECK(slot != kNone32, "an update names a vertex that the client does not have");
  return s_.mesh.place(slot);
}

void DelaunayEncoder::NoteNode(const UpdateBatch& batch, const UpdateBatch::Node& node) {
  UpdateChange change;
  SetChange(change, batch, static_cast<size_t>(&node - batch.nodes.data()));
  for (const TriangleKey key : change.removed) {
    if (!created_.Erase(key)) gone_.Insert(key, {});
  }
  for (size_t i = 0; i < change.created.size(); ++i) {
    if (!gone_.Erase(change.created[i])) created_.Insert(change.created[i], change.corners[i]);
  }
  if (!batch.insert) {
    if (!coming_.Erase(node.vertex)) going_.Insert(node.vertex, {});
    return;
  }
  seen_.Insert(node.vertex, {node.position.x, node.position.y});
  if (going_.Erase(node.vertex)) return;
  const auto row = static_cast<size_t>(&node - batch.nodes.data()) * s_.row_bytes;
  const std::span<const VertexIndex> ring = batch.ring_of(node);
  coming_.Put(node.vertex, {node.vertex,
                            node.position,
                            batch.rows.data() + row,
                            {ring[0], ring[ring.size() / 2]},
                            kNone32});
}

bool DelaunayEncoder::Note(std::span<const UpdateBatch> batches, bool* keeps_border) {
  Clear();
  for (const UpdateBatch& batch : batches) {
    for (const UpdateBatch::Node& node : batch.nodes) NoteNode(batch, node);
  }
  *keeps_border = true;
  for (const UpdateBatch& batch : batches) {
    for (const UpdateBatch::Node& node : batch.nodes) {
      if (!node.boundary) continue;
      const std::span<const VertexIndex> ring = batch.ring_of(node);
      *keeps_border &= IsBetween(PlaceOf(ring.back()), PlaceOf(node.vertex), PlaceOf(ring.front()));
    }
  }
  return AreCreatedLawful();
}

// Edges between what is created, and between that and what stays, are locally Delaunay.
bool DelaunayEncoder::AreCreatedLawful() const {
  using Edge = std::array<VertexIndex, 2>;
  struct EdgeHash {
    uint64_t operator()(const Edge& e) const {
      const uint64_t h = NumberHash{}(e[0]);
      return NumberHash{}(h ^ h >> 32 ^ e[1]);
    }
  };
  // Of the sides that were met, what lies beyond the edge for the triangle that comes to it later.
  FlatMap<Edge, LatticePoint, EdgeHash> apexes;
  bool lawful = true;
  const auto meet = [&](Edge edge, LatticePoint apex) { apexes.Insert(edge, apex); };
  gone_.ForEach([&](TriangleKey key, Nothing) {
    const uint32_t slot = s_.triangles.Find(key);
    MTDB_CHECK(slot != kNone32, "an update names a triangle that the client does not have");
    for (const uint32_t o : s_.mesh.triangle(slot).opposite) {
      if (o == kNone32 || gone_.Has(s_.triangles.key(o >> 2))) continue;
      const auto& c = s_.mesh.triangle(o >> 2).corners;
      meet({s_.vertices.key(c[o & 3]), s_.vertices.key(c[Patch::Next(o) & 3])},
           s_.mesh.place(c[Patch::Next(Patch::Next(o)) & 3]));
    }
  });
  created_.ForEach([&](TriangleKey, const Corners& c) {
    if (!lawful) return;
    const LatticeTriangle t = {PlaceOf(c[0]), PlaceOf(c[1]), PlaceOf(c[2])};
    if (Turn(t[0], t[1], t[2]) <= 0) {
      lawful = false;
      return;
    }
    for (size_t i = 0; i < 3; ++i) {
      const Edge across{c[(i + 1) % 3], c[i]};
      const LatticePoint* const beyond = apexes.Find(across);
      if (beyond == nullptr) {
        meet({c[i], c[(i + 1) % 3]}, t[(i + 2) % 3]);
        continue;
      }
      lawful &= !IsCorner(t, *beyond) && !IsInCircle(t[0], t[1], t[2], *beyond);
      apexes.Erase(across);
    }
  });
  return lawful;
}

void DelaunayEncoder::Clear() {
  coming_ = {};
  going_ = {};
  seen_ = {};
  created_ = {};
  gone_ = {};
}

// The triangle goes, perhaps to come back before the end.
void DelaunayEncoder::Erase(uint32_t slot) {
  if (s_.mesh.triangle(slot).born() >= first_born_) return;
  const TriangleKey key = s_.triangles.key(slot);
  if (!gone_.Has(key)) keys_.Insert(CornersOf(slot), key);
  s_.triangles.Erase(slot);
}

void DelaunayEncoder::Encode(ByteWriter& out) {
  first_born_ = s_.mesh.next_born();
  keys_ = {};
  keys_.Reserve(created_.size());
  created_.ForEach([&](TriangleKey key, const Corners& c) { keys_.Insert(Rotated(c), key); });
  made_.clear();
  EncodeRemovals(out);
  EncodeInsertions(out);
  for (const auto& [slot, born] : made_) {
    if (s_.mesh.triangle(slot).born() != born) continue;
    const TriangleKey* const key = keys_.Find(CornersOf(slot));
    MTDB_CHECK(key != nullptr, "a cut is not the Delaunay triangulation of its vertices");
    s_.triangles.Put(*key, slot);
  }
  keys_ = {};
  Clear();
}

void DelaunayEncoder::BeginSection(bool insert, size_t left, ByteWriter& out) {
  s_.MakeRoomOrEnd(std::min<uint64_t>(left, section()), out);
  s_.coder.Bit(s_.models.more, true);
  s_.coder.Bit(s_.models.other, true);
  s_.coder.Bit(s_.models.clip, false);
  s_.coder.Bit(s_.models.delaunay.ruled, true);
  s_.coder.Bit(s_.models.delaunay.insert, insert);
}

void DelaunayEncoder::EncodeRemovals(ByteWriter& out) {
  DelaunayModels& models = s_.models.delaunay;
  std::vector<uint32_t> slots;
  going_.ForEach([&](VertexIndex vertex, Nothing) { slots.push_back(s_.vertices.Find(vertex)); });
  std::sort(slots.begin(), slots.end());
  for (size_t begin = 0; begin < slots.size(); begin += section()) {
    const size_t end = std::min<size_t>(begin + section(), slots.size());
    BeginSection(false, end - begin, out);
    uint32_t next = 0;
    for (size_t i = begin; i < end; ++i) {
      CodeNumber(s_.coder, models.vertex_gap, slots[i] - next);
      next = slots[i] + 1;
      EncodeRemoval(slots[i]);
      s_.coder.Bit(models.next, i + 1 < end);
    }
  }
}

void DelaunayEncoder::EncodeRemoval(uint32_t vertex) {
  bool good = walk_.FindStar(s_.mesh, vertex, hole_);
  const bool careful = good && !walk_.Fill(s_.mesh, hole_, false, filling_);
  good = good && (!careful || walk_.Fill(s_.mesh, hole_, true, filling_));
  MTDB_CHECK(good, "a vertex of a Delaunay triangulation cannot go");
  s_.coder.Bit(s_.models.delaunay.careful, careful);
  s_.cost.AddUpdates(CostOfStar(hole_, careful));
  for (const uint32_t slot : hole_.slots) Erase(slot);
  slots_.clear();
  s_.mesh.Replace(hole_.slots, filling_, kNone32, &slots_);
  for (const uint32_t slot : slots_) made_.emplace_back(slot, s_.mesh.triangle(slot).born());
  if (const uint32_t lost = s_.mesh.Forget(vertex, kNone32); lost != kNone32) {
    s_.vertices.Erase(lost);
  }
}

// The triangle that holds p, looked for from one that may be near, or from vertices that are there.
uint32_t DelaunayEncoder::TriangleAt(LatticePoint p, uint32_t start,
                                     std::array<VertexIndex, 2> near) {
  const ReplayedMesh& mesh = s_.mesh;
  std::vector<uint32_t> queue;
  FlatSet<uint32_t> seen;
  const auto visit = [&](uint32_t slot) {
    if (mesh.has_triangle(slot) && seen.Insert(slot, {})) queue.push_back(slot);
  };
  if (start != kNone32) visit(start);
  for (const VertexIndex v : near) {
    const uint32_t vertex = s_.vertices.Find(v);
    if (vertex != kNone32 && mesh.has_vertex(vertex)) visit(mesh.half_edge_of(vertex) >> 2);
  }
  // Straight to it, then all around.
  for (uint32_t at = queue.empty() ? kNone32 : queue[0]; at != kNone32;) {
    const LatticeTriangle t = PlacesOf(mesh, at);
    uint32_t next = kNone32;
    for (size_t i = 0; i < 3 && next == kNone32; ++i) {
      const uint32_t o = mesh.triangle(at).opposite[i];
      if (Turn(t[i], t[(i + 1) % 3], p) < 0 && o != kNone32) next = o >> 2;
    }
    if (next == kNone32 && Holds(t, p)) return at;
    visit(at);
    if (next != kNone32 && seen.Has(next)) break;
    at = next;
    if (at != kNone32) visit(at);
  }
  for (size_t i = 0; i < queue.size(); ++i) {
    if (Holds(PlacesOf(mesh, queue[i]), p)) return queue[i];
    for (const uint32_t o : mesh.triangle(queue[i]).opposite) {
      if (o != kNone32) visit(o >> 2);
    }
  }
  for (uint32_t slot = 0; slot < mesh.triangle_slots(); ++slot) {
    if (mesh.has_triangle(slot) && Holds(PlacesOf(mesh, slot), p)) return slot;
  }
  MTDB_CHECK(false, "a vertex lies beyond the border");
  return kNone32;
}

void DelaunayEncoder::Put(uint32_t slot, uint32_t coming) {
  if (first_.size() <= slot) first_.resize(slot + size_t{1}, kNone32);
  list_[coming].next = first_[slot];
  first_[slot] = coming;
}

// Puts each vertex that comes into the list of its triangle.
void DelaunayEncoder::Locate() {
  list_.clear();
  coming_.ForEach([&](VertexIndex, const Coming& coming) { list_.push_back(coming); });
  std::sort(list_.begin(), list_.end(), [](const Coming& a, const Coming& b) {
    return std::pair(a.position.y, a.position.x) < std::pair(b.position.y, b.position.x);
  });
  left_ = list_.size();
  uint32_t last = kNone32;
  for (uint32_t i = 0; i < list_.size(); ++i) {
    const LatticePoint p{list_[i].position.x, list_[i].position.y};
    last = TriangleAt(p, last, list_[i].near);
    Put(last, i);
  }
}

void DelaunayEncoder::EncodeInsertions(ByteWriter& out) {
  if (coming_.size() == 0) return;
  Locate();
  EncodeNamed(out);
  sweep_.NoMoreNames();
  EncodeAsked(out);
}

// Into triangles that were there, in the order of their slots.
void DelaunayEncoder::EncodeNamed(ByteWriter& out) {
  DelaunayModels& models = s_.models.delaunay;
  std::vector<std::pair<uint32_t, uint64_t>> named;
  for (uint32_t slot = 0; slot < first_.size(); ++slot) {
    if (first_[slot] != kNone32) named.emplace_back(slot, s_.mesh.triangle(slot).born());
  }
  size_t i = 0;
  bool begin = true;
  while (i < named.size()) {
    BeginSection(true, named.size() - i, out);
    s_.coder.Bit(models.fresh, false);
    if (s_.coder.Bit(models.begin, begin)) sweep_.Begin(s_.mesh);
    begin = false;
    for (uint64_t n = 1;; ++n) {
      const uint32_t slot = named[i].first;
      CodeNumber(s_.coder, models.anchor_gap, slot - sweep_.next_slot());
      sweep_.Named(slot);
      EncodeInsertion(slot);
      do {
        ++i;
      } while (i < named.size() && s_.mesh.triangle(named[i].first).born() != named[i].second);
      if (!s_.coder.Bit(models.next, i < named.size() && n < section())) break;
    }
  }
}

// Into triangles that were made meanwhile.
void DelaunayEncoder::EncodeAsked(ByteWriter& out) {
  DelaunayModels& models = s_.models.delaunay;
  while (left_ > 0) {
    BeginSection(true, left_, out);
    s_.coder.Bit(models.fresh, true);
    for (uint64_t n = 1;; ++n) {
      uint32_t slot = 0;
      bool near_none = false;
      for (;;) {
        MTDB_CHECK(sweep_.Next(s_.mesh, &slot, &near_none), "a vertex has no place");
        const uint64_t places = CountPlaces(PlacesOf(s_.mesh, slot));
        if (places == 0) continue;
        const bool splits = FirstOf(slot) != kNone32;
        if (s_.coder.Bit(SplitModel(models, places, near_none), splits)) break;
        sweep_.GetsNone(s_.mesh, slot);
      }
      EncodeInsertion(slot);
      if (!s_.coder.Bit(models.next, left_ > 0 && n < section())) break;
    }
  }
}

// Of the vertices that come into the triangle, the one nearest to its centre.
uint32_t DelaunayEncoder::Nearest(uint32_t slot, const LatticeTriangle& t) const {
  uint32_t chosen = kNone32;
  std::array<int64_t, 3> least{};
  for (uint32_t i = first_[slot]; i != kNone32; i = list_[i].next) {
    const LatticePoint p{list_[i].position.x, list_[i].position.y};
    const std::array<int64_t, 3> order = {FromCentre(t, p), p.y, p.x};
    if (chosen != kNone32 && least < order) continue;
    chosen = i;
    least = order;
  }
  return chosen;
}

void DelaunayEncoder::EncodeInsertion(uint32_t slot) {
  const LatticeTriangle t = PlacesOf(s_.mesh, slot);
  const uint32_t chosen = Nearest(slot, t);
  const Coming coming = list_[chosen];
  LatticePoint p{coming.position.x, coming.position.y};
  DelaunayModels& models = s_.models.delaunay;
  const bool good =
      CodePlace(s_.coder, models, t, near_places_, p) && walk_.FindHole(s_.mesh, slot, p, hole_);
  MTDB_CHECK(good, "a vertex does not fit a Delaunay triangulation");
  s_.cost.AddUpdates(CostOfHole(hole_));

  uint32_t vertex = s_.mesh.RememberedAt(p);
  if (vertex != kNone32) {
    s_.RecallVertex(vertex);
  } else {
    CodeHeight(s_.coder, models, GuessHeight(s_.mesh, hole_.ring, p), coming.position.z);
    if (s_.row_bytes != 0) {
      ring_.clear();
      for (const uint32_t v : hole_.ring) ring_.push_back(s_.mesh.position(v));
      s_.models.attribute_coder.Encode(s_.coder, {coming.position, hole_.ring, ring_},
                                       s_.mesh.rows(), coming.row);
    }
    vertex = s_.AddVertex(coming.vertex, coming.position, coming.row);
  }
  std::vector<uint32_t> moving;
  for (const uint32_t gone : hole_.slots) {
    for (uint32_t i = FirstOf(gone); i != kNone32; i = list_[i].next) {
      if (i != chosen) moving.push_back(i);
    }
    if (gone < first_.size()) first_[gone] = kNone32;
    Erase(gone);
  }
  --left_;
  sweep_.NoteHole(s_.mesh, hole_);
  slots_.clear();
  s_.mesh.ReplaceByStar(hole_.slots, hole_.ring, hole_.outer, vertex, hole_.boundary, &slots_);
  sweep_.AddStar(s_.mesh, slots_);
  for (const uint32_t made : slots_) made_.emplace_back(made, s_.mesh.triangle(made).born());
  // Between which spokes they lie.
  spokes_.clear();
  for (const uint32_t v : hole_.ring) spokes_.push_back(s_.mesh.place(v));
  if (!hole_.boundary) spokes_.push_back(spokes_[0]);
  for (const uint32_t i : moving) {
    const LatticePoint q{list_[i].position.x, list_[i].position.y};
    size_t j = 0;
    for (int64_t turn = Turn(p, spokes_[0], q); j < slots_.size(); ++j) {
      const int64_t next = Turn(p, spokes_[j + 1], q);
      if (turn >= 0 && next <= 0) break;
      turn = next;
    }
    MTDB_CHECK(j < slots_.size(), "a vertex lies in no triangle");
    Put(slots_[j], i);
  }
}

}  // namespace mtdb::internal
