// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "codecs/stream/encode/update_sender.h"
#include "codecs/stream/internal/memory_bytes.h"
#include "store/base/attribute_layout.h"
#include "store/base/check.h"
#include "store/base/hash.h"

namespace mtdb {

using namespace internal;

namespace {

// Records end at the first batch after so many updates.
constexpr uint64_t kRecordUpdates = 4096;
// By the Delaunay rule, so many are coded in one piece.
constexpr uint64_t kRuleSection = 1024;
// What an update takes at most, its row not counted, and what a byte of a row takes.
constexpr uint64_t kMaxUpdateBytes = 512;
constexpr uint64_t kMaxBytesPerRowByte = 8;

// Whether the Delaunay rule may be used, as IsPlace has it, with room for borders that move.
ClientMeshOptions Settled(ClientMeshOptions options, const BaseMesh& base) {
  const auto fits = [](Vec3i p) {
    return std::max(std::abs(int64_t{p.x}), std::abs(int64_t{p.y})) <= kMaxPlace / 2;
  };
  options.delaunay = options.delaunay && options.grid.mode == PositionMode::kRaster &&
                     std::all_of(base.positions.begin(), base.positions.end(), fits);
  return options;
}

// More than are removed.
size_t Inserted(std::span<const UpdateBatch> batches) {
  size_t inserted = 0;
  size_t removed = 0;
  for (const UpdateBatch& batch : batches) {
    (batch.insert ? inserted : removed) += batch.nodes.size();
  }
  return inserted > removed ? inserted - removed : 0;
}

}  // namespace

UpdateSender::UpdateSender(const ClientMeshOptions& options, const BaseMesh& base,
                           const MeetsRegion& region)
    : options_(Settled(options, base)),
      row_bytes_(options.attributes.row_bytes()),
      max_updates_(kMaxRecordBytes / 2 / (kMaxUpdateBytes + kMaxBytesPerRowByte * row_bytes_)),
      mesh_(options_, false),
      models_(options.attributes),
      rule_({mesh_, coder_, models_, triangles_, vertices_, cost_, row_bytes_,
             std::min(kRuleSection, max_updates_),
             [this](VertexIndex key, Vec3i position, const std::byte* row) {
               return AddVertex(key, position, row);
             },
             [this](uint32_t vertex) {
               mesh_.Recall(vertex);
               ++recalled_;
             },
             [this](uint64_t updates, ByteWriter& out) {
               if (record_updates_ + updates > kRecordUpdates) EndRecord(out);
               MakeRoom(updates, out);
             }}),
      cost_(row_bytes_) {
  MTDB_CHECK(base.positions.size() == base.vertices.size() &&
                 base.triangle_keys.size() == base.triangles.size() &&
                 base.rows.size() == base.vertices.size() * row_bytes_,
             "the parts of a base mesh have different lengths");
  Box3d box;
  for (const Vec3i p : base.positions) box.Add(options.grid.Position(p));
  const Vec3d origin = base.positions.empty() ? Vec3d{} : (box.min + box.max) * 0.5;
  if (!region) {
    WriteStart(base, origin);
    return;
  }
  // An empty mesh, to which what meets the region is attached.
  whole_.emplace(options, base);
  whole_->Choose(region);
  WriteStart({}, origin);
  ByteWriter attached;
  EncodeClip(attached);
  start_.insert(start_.end(), attached.bytes().begin(), attached.bytes().end());
}

static void PutGrid(const Grid& grid, ByteWriter* w) {
  w->Put<uint8_t>(static_cast<uint8_t>(grid.mode));
  for (int i = 0; i < 3; ++i) w->Put<double>(grid.origin[i]);
  w->Put<double>(grid.step);
  if (grid.mode != PositionMode::kRaster) return;
  for (const double v : grid.plane) w->Put<double>(v);
}

bool UpdateSender::EncodeByRule(std::span<const UpdateBatch> batches) {
  if (!lawful_) return false;
  bool keeps_border = false;
  lawful_ = rule_.Note(batches, &keeps_border);
  if (lawful_ && keeps_border) return true;
  rule_.Clear();
  return false;
}

// Vertices go in the order in which the triangles name them.
void UpdateSender::WriteStart(const BaseMesh& base, Vec3d origin) {
  std::vector<uint32_t> number(base.vertices.size(), kNone32);
  std::vector<Vec3i> positions;
  Bytes rows;
  std::vector<std::array<uint32_t, 3>> triangles;
  ByteWriter indices;
  for (const auto& t : base.triangles) {
    auto& corners = triangles.emplace_back();
    for (size_t c = 0; c < 3; ++c) {
      uint32_t& v = number[t[c]];
      const auto used = static_cast<uint32_t>(positions.size());
      indices.PutVarint(v == kNone32 ? 0 : used - v);
      if (v == kNone32) {
        v = used;
        positions.push_back(base.positions[t[c]]);
        const auto row = base.rows.begin() + static_cast<std::ptrdiff_t>(t[c] * row_bytes_);
        rows.insert(rows.end(), row, row + static_cast<std::ptrdiff_t>(row_bytes_));
        vertices_.Put(base.vertices[t[c]], v);
      }
      corners[c] = v;
    }
  }
  ByteWriter body;
  body.bytes().reserve(256 + 8 * positions.size() + indices.size() + rows.size());
  PutGrid(options_.grid, &body);
  body.Put<uint8_t>(options_.delaunay ? 1 : 0);
  for (int i = 0; i < 3; ++i) body.Put<double>(origin[i]);
  PutAttributeLayout(options_.attributes, &body);
  body.PutVarint(options_.remembered_vertices);
  body.PutVarint(positions.size());
  body.PutVarint(triangles.size());
  Vec3i last{};
  for (const Vec3i p : positions) {
    for (int i = 0; i < 3; ++i) {
      body.PutVarint(ZigZag(static_cast<uint32_t>(p[i]) - static_cast<uint32_t>(last[i])));
    }
    last = p;
  }
  body.PutBytes(indices.bytes());
  body.PutBytes(SplitPlanes(rows, row_bytes_));

  MTDB_CHECK(body.size() <= UpdateEncoder::kMaxStartBytes,
             "a base mesh is too long for a stream's start");
  ByteWriter start;
  for (const char c : kUpdateMagic) start.Put(c);
  start.Put<uint8_t>(kUpdateVersion);
  start.PutVarint(body.size());
  start.Put<uint32_t>(static_cast<uint32_t>(Hash64(body.bytes())));
  start.PutBytes(body.bytes());
  start_ = start.Take();

  mesh_.Start(origin, positions, rows, triangles);
  sent_ = positions.size();
  models_.reference = UpdateReference(mesh_);
  for (size_t t = 0; t < triangles.size(); ++t) {
    PutTriangle(base.triangle_keys[t], static_cast<uint32_t>(t));
  }
  lawful_ = options_.delaunay && !whole_ && rule_.IsMeshLawful();
}

// The client holds the whole cut.
void UpdateSender::StartWholeCut() {
  BaseMesh base;
  std::vector<uint32_t> number(mesh_.vertex_slots(), kNone32);
  for (uint32_t v = 0; v < mesh_.vertex_slots(); ++v) {
    if (!mesh_.has_vertex(v)) continue;
    number[v] = static_cast<uint32_t>(base.vertices.size());
    base.vertices.push_back(vertices_.key(v));
    base.positions.push_back(mesh_.position(v));
    base.rows.insert(base.rows.end(), mesh_.row(v).begin(), mesh_.row(v).end());
  }
  const std::vector<uint32_t> slots = triangles_.Slots();
  for (const uint32_t slot : slots) {
    const auto& c = mesh_.triangle(slot).corners;
    base.triangles.push_back({number[c[0]], number[c[1]], number[c[2]]});
    base.triangle_keys.push_back(triangles_.key(slot));
  }
  whole_.emplace(options_, base);
  for (const uint32_t slot : slots) whole_->Link(triangles_.key(slot), slot);
}

uint32_t UpdateSender::TriangleOf(TriangleKey key) const {
  const uint32_t slot = triangles_.Find(key);
  MTDB_CHECK(slot != kNone32, "an update names a triangle that the client does not have");
  return slot;
}

uint32_t UpdateSender::VertexOf(VertexIndex key) const {
  const uint32_t slot = vertices_.Find(key);
  MTDB_CHECK(slot != kNone32, "an update names a vertex that the client does not have");
  return slot;
}

uint32_t UpdateSender::SplitEdge(const UpdateBatch& batch, const Node& node,
                                 const Patch::Hole& hole) const {
  const std::span<const VertexIndex> ring = batch.ring_of(node);
  const uint32_t last = VertexOf(ring.back());
  const uint32_t first = VertexOf(ring.front());
  for (uint32_t j = 0; j < hole.ring_count; ++j) {
    if (hole.ring[j] == last && hole.ring[j + 1 == hole.ring_count ? 0 : j + 1] == first) return j;
  }
  return kNone32;
}

void UpdateSender::FindHoles(const UpdateBatch& batch, const Follows& follows) {
  constexpr size_t kAhead = 8;
  const size_t nodes = batch.nodes.size();
  const std::span<const UpdateBatch::HoleTriangle> holes = batch.holes;
  hole_slots_.resize(holes.size());
  for (size_t i = 0; i < holes.size(); ++i) {
    if (i + 2 * kAhead < holes.size()) triangles_.Prefetch(holes[i + 2 * kAhead].key);
    if (i + kAhead < holes.size()) triangles_.PrefetchPage(holes[i + kAhead].key);
    hole_slots_[i] = triangles_.Find(holes[i].key);
  }
  for (uint32_t n = 0; n < nodes; ++n) {
    if (n + kAhead < nodes) {
      for (const uint32_t slot : HoleSlots(batch.nodes[n + kAhead])) {
        if (slot != kNone32) mesh_.PrefetchTriangle(slot);
      }
    }
    if (!follows.empty() && !follows[n]) continue;
    uint32_t anchor = kNone32;
    uint64_t last_born = 0;
    for (const uint32_t slot : HoleSlots(batch.nodes[n])) {
      MTDB_CHECK(slot != kNone32, "an update names a triangle that the client does not have");
      const uint64_t born = mesh_.triangle(slot).born();
      anchor = born > last_born ? slot : anchor;
      last_born = std::max(last_born, born);
    }
    if (!CanWalkHole(batch, n, anchor)) {
      unwalked_.push_back(n);
      continue;
    }
    targets_.push_back({anchor, n});
  }
}

bool UpdateSender::CanWalkHole(const UpdateBatch& batch, uint32_t n, uint32_t anchor) {
  const Node& node = batch.nodes[n];
  const std::span<const uint32_t> slots = HoleSlots(node);
  if (!node.boundary) {
    // The triangles of a disc with all its vertices on the ring form a tree.
    SmallSet set;
    for (const uint32_t slot : slots) set.Add(slot);
    size_t links = 0;
    for (const uint32_t slot : slots) {
      for (const uint32_t o : mesh_.triangle(slot).opposite) {
        links += o != kNone32 && set.MayHave(o >> 2) && Has(slots, o >> 2) ? 1 : 0;
      }
    }
    return links == 2 * (slots.size() - 1) && node.ring_count <= kMaxRing;
  }
  UpdateHole& update = update_;
  return WalkHole(mesh_, anchor, update,
                  [&](uint32_t, uint32_t slot, uint32_t) { return Has(slots, slot); }) &&
         update.hole.ring_count == node.ring_count && update.hole.slot_count == slots.size() &&
         SplitEdge(batch, node, update.hole) != kNone32;
}

void UpdateSender::FindStars(const UpdateBatch& batch, const Follows& follows) {
  constexpr size_t kAhead = 8;
  const size_t nodes = batch.nodes.size();
  for (uint32_t n = 0; n < nodes; ++n) {
    if (n + 2 * kAhead < nodes) vertices_.Prefetch(batch.nodes[n + 2 * kAhead].vertex);
    if (n + kAhead < nodes) vertices_.PrefetchPage(batch.nodes[n + kAhead].vertex);
    if (!follows.empty() && !follows[n]) continue;
    targets_.push_back({VertexOf(batch.nodes[n].vertex), n});
  }
  std::sort(targets_.begin(), targets_.end());
  slots_.clear();
  for (const Target target : targets_) slots_.push_back(target.at);
  size_t walked = 0;
  for (size_t i = 0; i < slots_.size(); ++i) {
    PrefetchStars(mesh_, slots_, i);
    const Target target = targets_[i];
    const Node& node = batch.nodes[target.node];
    UpdateHole& update = update_;
    if (WalkStar(mesh_, target.at, update) && update.hole.ring_count == node.ring_count &&
        update.boundary == node.boundary) {
      targets_[walked++] = target;
    } else {
      unwalked_.push_back(target.node);
    }
  }
  targets_.resize(walked);
}

uint32_t UpdateSender::AddVertex(VertexIndex key, Vec3i position, const std::byte* row) {
  ++sent_;
  cost_.AddVertex();
  const uint32_t vertex = mesh_.AddVertex(position, row);
  vertices_.Put(key, vertex);
  return vertex;
}

uint32_t UpdateSender::PutVertex(const UpdateBatch& batch, const Node& node, uint32_t remembered) {
  if (remembered != kNone32) {
    mesh_.Recall(remembered);
    ++recalled_;
    return remembered;
  }
  return AddVertex(node.vertex, node.position, RowOf(batch, node));
}

void UpdateSender::FinishInsertion(const UpdateBatch& batch, const Node& node,
                                   const UpdateHole& update, uint32_t vertex) {
  for (const uint32_t slot : update.hole.slot_span()) EraseTriangle(slot);
  const size_t first = next_fresh_.size();
  InsertStar(mesh_, models_, update, vertex, &next_fresh_.slots());
  // The ring as it was walked is rotated.
  uint32_t place = PlaceInRing(batch, node, update.hole.ring[0]);
  for (size_t i = first; i < next_fresh_.size(); ++i) {
    PutTriangle(node.first_star + place, next_fresh_.slot(i));
    place = place + 1 == node.ring_count ? 0 : place + 1;
  }
}

uint32_t UpdateSender::PlaceInRing(const UpdateBatch& batch, const Node& node,
                                   uint32_t vertex) const {
  const std::span<const VertexIndex> ring = batch.ring_of(node);
  const auto at = std::find(ring.begin(), ring.end(), vertices_.key(vertex)) - ring.begin();
  MTDB_CHECK(static_cast<uint32_t>(at) < node.ring_count, "an update has another ring");
  return static_cast<uint32_t>(at);
}

void UpdateSender::EncodeInsertion(const UpdateBatch& batch, Target target) {
  const Node& node = batch.nodes[target.node];
  const std::span<const uint32_t> slots = HoleSlots(node);
  UpdateHole& update = update_;
  uint32_t remembered = RememberedSlot(node);
  bool again = false;
  if (const uint32_t fills = mesh_.triangle(target.at).fills; mesh_.is_remembered(fills)) {
    again = fills == remembered && WalkAgain(mesh_, target.at, fills, update) &&
            update.hole.ring_count == node.ring_count && update.boundary == node.boundary;
    for (const uint32_t slot : update.hole.slot_span()) again &= Has(slots, slot);
    coder_.Bit(models_.again, again);
  }
  if (!again) {
    const UpdateShapes shapes(mesh_, models_);
    const uint64_t born = mesh_.triangle(target.at).born();
    const bool walked =
        WalkHole(mesh_, target.at, update, [&](uint32_t count, uint32_t slot, uint32_t h) {
          if (mesh_.triangle(slot).born() > born) return false;
          return models_.topology.CodeTake(coder_, count, shapes.Shape(h), Has(slots, slot));
        });
    MTDB_CHECK(walked && update.hole.ring_count == node.ring_count, "an update has no hole");
    const uint32_t split = node.boundary ? SplitEdge(batch, node, update.hole) : kNone32;
    CodeSplitEdge(coder_, models_.topology, update.hole, split);
    update.boundary = node.boundary;
    if (node.boundary) update.hole.Rotate(split);
    const std::span<const uint32_t> all = mesh_.remembered();
    if (!all.empty() && coder_.Bit(models_.known, remembered != kNone32)) {
      const auto place = std::find(all.begin(), all.end(), remembered) - all.begin();
      coder_.Raw(std::bit_width(all.size() - 1), static_cast<uint32_t>(place));
    } else {
      Vec3i p = node.position;
      CodePosition(coder_, models_, mesh_, update, p);
      if (row_bytes_ != 0) {
        models_.attribute_coder.Encode(coder_, AttributeStar(mesh_, update, p, &ring_),
                                       mesh_.rows(), RowOf(batch, node));
      }
    }
  }
  FinishInsertion(batch, node, update, PutVertex(batch, node, remembered));
}

[[gnu::always_inline]] inline void UpdateSender::PrefetchHole(const UpdateBatch& batch,
                                                              uint32_t n) const {
  const Node& node = batch.nodes[n];
  for (const uint32_t slot : HoleSlots(node)) {
    mesh_.PrefetchTriangle(slot);
    triangles_.PrefetchPlace(slot);
  }
  triangles_.Prefetch(node.first_star);
  vertices_.Prefetch(node.vertex);
}

[[gnu::always_inline]] inline void UpdateSender::PrefetchAround(const UpdateBatch& batch,
                                                                uint32_t n) const {
  const Node& node = batch.nodes[n];
  __builtin_prefetch(&batch.ring[node.ring_begin]);
  for (const uint32_t slot : HoleSlots(node)) {
    mesh_.PrefetchBeyond(slot);
    mesh_.PrefetchCorners(slot);
    triangles_.PrefetchPlacePage(slot);
  }
  triangles_.PrefetchPage(node.first_star);
  vertices_.PrefetchPage(node.vertex);
}

// When all anchors of the batch are among the triangles that the last one made, at_fresh_ tells
// which ones; else it is empty.
void UpdateSender::FindFresh() {
  at_fresh_.clear();
  if (fresh_.size() >= 32 * targets_.size() || targets_.size() > max_updates_) return;
  at_fresh_.assign(fresh_.size(), kNone32);
  for (const Target target : targets_) {
    const uint64_t i = fresh_.NumberOf(mesh_.triangle(target.at).born());
    if (i >= fresh_.size()) {
      at_fresh_.clear();
      return;
    }
    at_fresh_[i] = target.node;
  }
}

template <typename Visit>
void UpdateSender::EncodeAscending(NumberModel& gap, std::span<const Target> targets,
                                   Visit&& visit) {
  std::array<uint32_t, kSlotGroup> slots{};
  uint64_t next = 0;
  for (; !targets.empty(); targets = targets.subspan(std::min(targets.size(), kSlotGroup))) {
    const auto group = targets.first(std::min(targets.size(), kSlotGroup));
    for (size_t i = 0; i < group.size(); ++i) slots[i] = group[i].at;
    CodeSlots(coder_, gap, next, std::span(slots).first(group.size()));
    for (size_t i = 0; i < group.size(); ++i) visit(group, i);
  }
}

void UpdateSender::EncodeInsertions(const UpdateBatch& batch, std::span<const Target> targets) {
  const bool fresh = !at_fresh_.empty();
  next_fresh_.Clear(mesh_);
  coder_.Bit(models_.more, true);
  coder_.Bit(models_.other, false);
  coder_.Bit(models_.insert, true);
  coder_.Bit(models_.fresh, fresh);
  CodeNumber(coder_, models_.count, static_cast<uint32_t>(targets.size()));
  if (fresh) {
    constexpr size_t kAhead = FreshTriangles::kAhead;
    const auto soon = [&](size_t i, auto&& prefetch) {
      if (i < at_fresh_.size() && at_fresh_[i] != kNone32) prefetch(at_fresh_[i]);
    };
    // The first of the ring.
    const auto first_corner = [&](size_t i) { return mesh_.triangle(fresh_.slot(i)).corners[0]; };
    size_t left = targets.size();
    for (size_t i = 0; left > 0; ++i) {
      fresh_.Prefetch(mesh_, i);
      soon(i + 4 * kAhead, [&](uint32_t n) { __builtin_prefetch(&batch.nodes[n]); });
      soon(i + 3 * kAhead,
           [&](uint32_t n) { __builtin_prefetch(hole_slots_.data() + batch.nodes[n].hole_begin); });
      soon(i + 2 * kAhead, [&](uint32_t n) { PrefetchHole(batch, n); });
      soon(i + kAhead, [&](uint32_t n) {
        PrefetchAround(batch, n);
        vertices_.PrefetchPlace(first_corner(i + kAhead));
      });
      soon(i + kAhead / 2,
           [&](uint32_t) { vertices_.PrefetchPlacePage(first_corner(i + kAhead / 2)); });
      const uint32_t slot = fresh_.slot(i);
      if (!fresh_.IsThere(mesh_, i)) continue;
      const Patch::Triangle view = UpdateShapes(mesh_, models_).AnchorView(slot);
      if (!models_.topology.CodeAnchor(coder_, view, 1, at_fresh_[i] != kNone32)) continue;
      EncodeInsertion(batch, {slot, at_fresh_[i]});
      --left;
    }
  } else {
    constexpr size_t kAhead = 4;
    EncodeAscending(models_.anchor_gap, targets, [&](std::span<const Target> group, size_t i) {
      if (i + 2 * kAhead < group.size()) PrefetchHole(batch, group[i + 2 * kAhead].node);
      if (i + kAhead < group.size()) PrefetchAround(batch, group[i + kAhead].node);
      EncodeInsertion(batch, group[i]);
    });
  }
  std::swap(fresh_, next_fresh_);
}

void UpdateSender::FinishRemoval(const UpdateBatch& batch, const Node& node,
                                 const UpdateHole& update, uint32_t vertex) {
  // Places in the ring as the client walks it -> the hole's triangles, by their outer corners.
  const std::span<const uint32_t> walked = update.hole.ring_span();
  std::array<uint32_t, kMaxRing> place;
  uint32_t i = PlaceInRing(batch, node, walked[0]);
  for (uint32_t j = 0; j < walked.size(); ++j) {
    place[i] = j;
    i = i + 1 == node.ring_count ? 0 : i + 1;
  }
  for (const auto& t : batch.hole_of(node)) {
    std::array<uint32_t, 3> c = {place[t.corners[0]], place[t.corners[1]], place[t.corners[2]]};
    std::sort(c.begin(), c.end());
    hole_at_[c[0]][c[2]] = {t.key, c[1]};
  }
  CodePolygon(
      coder_, models_, mesh_, walked, [&](uint32_t a, uint32_t b) { return hole_at_[a][b].apex; },
      places_);
  for (const uint32_t slot : update.hole.slot_span()) EraseTriangle(slot);
  slots_.clear();
  RemoveStar(mesh_, update, vertex, places_, &slots_);
  for (size_t t = 0; t < slots_.size(); ++t) {
    PutTriangle(hole_at_[places_[t][0]][places_[t][2]].key, slots_[t]);
  }
  const uint32_t first = update.boundary ? walked[0] : kNone32;
  if (const uint32_t lost = mesh_.Forget(vertex, first); lost != kNone32) {
    vertices_.Erase(lost);
  }
}

void UpdateSender::EncodeRemoval(const UpdateBatch& batch, Target target) {
  UpdateHole& update = update_;
  WalkStar(mesh_, target.at, update);
  FinishRemoval(batch, batch.nodes[target.node], update, target.at);
}

void UpdateSender::EncodeRemovals(const UpdateBatch& batch, std::span<const Target> targets) {
  coder_.Bit(models_.more, true);
  coder_.Bit(models_.other, false);
  coder_.Bit(models_.insert, false);
  CodeNumber(coder_, models_.count, static_cast<uint32_t>(targets.size()));
  EncodeAscending(models_.vertex_gap, targets,
                  [&](std::span<const Target> group, size_t i) { EncodeRemoval(batch, group[i]); });
}

void UpdateSender::EncodeBatch(const UpdateBatch& batch, const Follows& follows, ByteWriter& out) {
  targets_.clear();
  unwalked_.clear();
  if (batch.insert) {
    FindHoles(batch, follows);
    FindFresh();
    if (at_fresh_.empty()) std::sort(targets_.begin(), targets_.end());
  } else {
    FindStars(batch, follows);
  }
  for (std::span<const Target> left = targets_; !left.empty();) {
    const auto targets = left.first(std::min<size_t>(left.size(), max_updates_));
    left = left.subspan(targets.size());
    MakeRoom(targets.size(), out);
    cost_.AddUpdates(targets.size());
    if (batch.insert) {
      EncodeInsertions(batch, targets);
    } else {
      EncodeRemovals(batch, targets);
    }
  }
  for (const uint32_t node : unwalked_) {
    MakeRoom(1, out);
    cost_.AddUpdates(1);
    EncodeListed(batch, batch.nodes[node]);
  }
}

// An update whose triangles the client cannot find by walking: where edges are non-manifold.
void UpdateSender::EncodeListed(const UpdateBatch& batch, const Node& node) {
  ++listed_;
  coder_.Bit(models_.more, true);
  coder_.Bit(models_.other, true);
  coder_.Bit(models_.clip, false);
  if (options_.delaunay) coder_.Bit(models_.delaunay.ruled, false);
  coder_.Bit(models_.insert, batch.insert);
  UpdateHole& update = update_;
  Patch::Hole& hole = update.hole;
  hole.ring_count = hole.slot_count = 0;
  update.listed = true;
  update.boundary = node.boundary;
  for (const VertexIndex v : batch.ring_of(node)) hole.ring[hole.ring_count++] = VertexOf(v);
  if (batch.insert) {
    for (const auto& t : batch.hole_of(node)) hole.slots[hole.slot_count++] = TriangleOf(t.key);
  } else {
    for (uint32_t j = 0; j < UpdateBatch::StarCount(node); ++j) {
      hole.slots[hole.slot_count++] = TriangleOf(node.first_star + j);
    }
  }
  coder_.Raw(1, node.boundary ? 1 : 0);
  coder_.Raw(6, hole.ring_count);
  for (const uint32_t v : hole.ring_span()) coder_.Raw(32, v);
  for (const uint32_t slot : hole.slot_span()) coder_.Raw(32, slot);
  if (!batch.insert) {
    const uint32_t vertex = VertexOf(node.vertex);
    coder_.Raw(32, vertex);
    FinishRemoval(batch, node, update, vertex);
    return;
  }
  const uint32_t remembered = RememberedSlot(node);
  coder_.Raw(32, remembered);
  if (remembered == kNone32) {
    for (int i = 0; i < 3; ++i) coder_.Raw(32, static_cast<uint32_t>(node.position[i]));
    const std::byte* row = RowOf(batch, node);
    for (size_t i = 0; i < row_bytes_; ++i) coder_.Raw(8, static_cast<uint32_t>(row[i]));
  }
  FinishInsertion(batch, node, update, PutVertex(batch, node, remembered));
  next_fresh_.Clear(mesh_);
}

void UpdateSender::MakeRoom(uint64_t updates, ByteWriter& out) {
  if (record_updates_ + updates > max_updates_) EndRecord(out);
  record_updates_ += updates;
}

void UpdateSender::EndRecord(ByteWriter& out) {
  if (record_updates_ == 0) return;
  coder_.Bit(models_.more, false);
  PutRecord(out);
}

void UpdateSender::PutRecord(ByteWriter& out) {
  Bytes record = coder_.Finish();
  if (record.size() < cost_.bytes()) record.resize(cost_.bytes());
  MTDB_CHECK(record.size() <= kMaxRecordBytes, "a record is longer than max_updates_ allows");
  cost_ = RecordCost(row_bytes_);
  record_updates_ = 0;
  out.PutVarint(record.size());
  out.Put<uint32_t>(static_cast<uint32_t>(Hash64(record)));
  out.PutBytes(record);
}

Bytes UpdateSender::Encode(std::span<const UpdateBatch> batches, const MeetsRegion& region) {
  ByteWriter out;
  if (!region && !whole_ && EncodeByRule(batches)) {
    rule_.Encode(out);
    EndRecord(out);
    return out.Take();
  }
  if (region) lawful_ = false;
  if (region && !whole_) StartWholeCut();
  std::vector<Follows> plan(batches.size());
  if (whole_) {
    for (const UpdateBatch& batch : batches) whole_->Apply(batch);
    whole_->Choose(region);
    plan = whole_->Plan(batches, triangles_);
  }
  if (!whole_) mesh_.ExpectMore(Inserted(batches));
  const uint64_t enough = std::min(kRecordUpdates, max_updates_);
  for (size_t b = 0; b < batches.size(); ++b) {
    EncodeBatch(batches[b], plan[b], out);
    if (record_updates_ == 0) continue;
    if (record_updates_ < enough && (b + 1 < batches.size() || whole_)) continue;
    coder_.Bit(models_.more, false);
    PutRecord(out);
  }
  if (whole_) EncodeClip(out);
  if (!region && whole_) {
    whole_.reset();
    lawful_ = options_.delaunay && rule_.IsMeshLawful();
  }
  targets_ = {};
  hole_slots_ = {};
  at_fresh_ = {};
  return out.Take();
}

size_t UpdateSender::memory_bytes() const {
  return sizeof(*this) + mesh_.memory_bytes() + (whole_ ? whole_->memory_bytes() : 0) +
         triangles_.memory_bytes() + vertices_.memory_bytes() + CapacityBytes(start_) +
         fresh_.memory_bytes() + next_fresh_.memory_bytes() + CapacityBytes(slots_);
}

class UpdateEncoder::Impl : public UpdateSender {
 public:
  using UpdateSender::UpdateSender;
};

UpdateEncoder::UpdateEncoder(const ClientMeshOptions& options, const BaseMesh& base,
                             const MeetsRegion& region)
    : impl_(std::make_unique<Impl>(options, base, region)) {}
UpdateEncoder::~UpdateEncoder() = default;
uint64_t UpdateEncoder::StartBytes(const ClientMeshOptions& options, const BaseMesh& base) {
  constexpr uint64_t kLongestVarint = 5;
  uint64_t bytes =
      256 + base.rows.size() + 3 * kLongestVarint * (base.positions.size() + base.triangles.size());
  for (const VertexAttribute& a : options.attributes.attributes) bytes += a.name.size() + 24;
  return bytes;
}
const Bytes& UpdateEncoder::start() const { return impl_->start_; }
Bytes UpdateEncoder::Encode(std::span<const UpdateBatch> batches, const MeetsRegion& region) {
  return impl_->Encode(batches, region);
}
const ClientMesh& UpdateEncoder::mesh() const { return impl_->mesh_; }
uint64_t UpdateEncoder::listed_updates() const { return impl_->listed_; }
size_t UpdateEncoder::memory_bytes() const { return impl_->memory_bytes(); }
uint64_t UpdateEncoder::sent_vertices() const { return impl_->sent_; }
uint64_t UpdateEncoder::recalled_vertices() const { return impl_->recalled_; }

}  // namespace mtdb
