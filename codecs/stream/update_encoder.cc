// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstring>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "codecs/stream/internal/clip_coder.h"
#include "codecs/stream/internal/key_table.h"
#include "codecs/stream/internal/memory_bytes.h"
#include "codecs/stream/internal/update_coder.h"
#include "codecs/stream/internal/whole_cut.h"
#include "codecs/stream/update_stream.h"
#include "store/base/attribute_layout.h"
#include "store/base/check.h"
#include "store/base/hash.h"

namespace mtdb {

using namespace internal;

namespace {

// Records end at the first batch after so many updates.
constexpr uint64_t kRecordUpdates = 4096;
// So many triangles are attached in a record.
constexpr uint64_t kRecordTriangles = 16384;
// What an update takes at most, its row not counted, and what a byte of a row takes.
constexpr uint64_t kMaxUpdateBytes = 512;
constexpr uint64_t kMaxBytesPerRowByte = 8;

}  // namespace

class UpdateEncoder::Impl {
 public:
  Impl(const ClientMeshOptions& options, const BaseMesh& base, const MeetsRegion& region);
  Bytes Encode(std::span<const UpdateBatch> batches, const MeetsRegion& region);
  size_t memory_bytes() const;

  const ClientMeshOptions options_;
  const size_t row_bytes_;
  // So many updates of a record stay well below kMaxRecordBytes.
  const uint64_t max_updates_;
  ReplayedMesh mesh_;
  UpdateModels models_;
  std::vector<Vec3i> ring_;  // positions around the vertex at hand
  Bytes start_;
  uint64_t listed_ = 0;
  uint64_t sent_ = 0;
  uint64_t recalled_ = 0;

 private:
  class AttachedSide;
  using Node = UpdateBatch::Node;
  using Follows = std::vector<bool>;  // which nodes of a batch the client follows; empty: all
  struct Target {
    const Node* node;
    uint32_t at;  // the anchor's slot, or the vertex's
  };

  void WriteStart(const BaseMesh& base, Vec3d origin);
  void StartWholeCut();
  void PutRecord(ByteWriter& out);
  void PutTriangle(TriangleKey key, uint32_t slot) {
    triangles_.Put(key, slot);
    if (whole_) whole_->Link(key, slot);
  }
  void EraseTriangle(uint32_t slot) {
    if (whole_) whole_->Unlink(slot);
    triangles_.Erase(slot);
  }
  void EncodeClip(ByteWriter& out);
  std::vector<uint32_t> Coming() const;
  void EncodeDrops(const std::vector<uint32_t>& leaving, std::vector<uint32_t>* left_over);
  uint32_t TriangleOf(TriangleKey key) const;
  uint32_t VertexOf(VertexIndex key) const;
  void EncodeBatch(const UpdateBatch& batch, const Follows& follows, ByteWriter& out);
  // Ends the record if there is no room in it for so many more.
  void MakeRoom(uint64_t updates, ByteWriter& out);
  // The nodes of a batch: those whose hole (star) the client finds by walking, in the order of
  // their places, and those that have to be listed.
  struct Sorted {
    std::vector<Target> targets;
    std::vector<const Node*> listed;
  };
  Sorted Sort(const UpdateBatch& batch, const Follows& follows,
              bool (Impl::*find)(const UpdateBatch&, const Node&, Target*));
  // True when the client can find the node's hole (star) by walking; *target says from where.
  bool FindHole(const UpdateBatch& batch, const Node& node, Target* target);
  bool FindStar(const UpdateBatch& batch, const Node& node, Target* target);
  uint32_t SplitEdge(const UpdateBatch& batch, const Node& node, const Patch::Hole& hole) const;
  void MarkHole(const Node& node);
  bool Marked(uint32_t slot) const { return slot < marks_.size() && marks_[slot] == mark_; }

  void EncodeInsertions(const UpdateBatch& batch, std::span<const Target> targets);
  void EncodeRemovals(const UpdateBatch& batch, std::span<const Target> targets);
  void EncodeInsertion(const UpdateBatch& batch, const Target& target);
  void EncodeRemoval(const UpdateBatch& batch, const Target& target);
  void EncodeListed(const UpdateBatch& batch, const Node& node);
  const std::byte* RowOf(const UpdateBatch& batch, const Node& node) const {
    return batch.rows.data() + static_cast<size_t>(&node - batch.nodes.data()) * row_bytes_;
  }
  // Which remembered vertex the node's is, or kNone32.
  uint32_t RememberedSlot(const Node& node) const { return vertices_.Find(node.vertex); }
  std::span<uint32_t> HoleSlots(const Node& node) {
    return std::span(hole_slots_).subspan(node.hole_begin, node.ring_count - 2);
  }
  uint32_t PutVertex(const UpdateBatch& batch, const Node& node, uint32_t remembered);
  uint32_t AddVertex(VertexIndex key, Vec3i position, const std::byte* row);
  void FinishInsertion(const UpdateBatch& batch, const Node& node, const UpdateHole& update,
                       uint32_t vertex);
  void FinishRemoval(const UpdateBatch& batch, const Node& node, const UpdateHole& update,
                     uint32_t vertex);

  std::optional<WholeCut> whole_;  // while the client is clipped
  KeyTable triangles_;
  KeyTable vertices_;  // remembered ones included
  RansEncoder coder_;
  uint64_t record_updates_ = 0;  // in the record that is begun
  RecordCost cost_;              // likewise
  DropScratch drop_scratch_;
  // The triangles that the last batch made: slots and when they were born.
  std::vector<std::pair<uint32_t, uint64_t>> fresh_;
  std::vector<std::pair<uint32_t, uint64_t>> next_fresh_;
  std::vector<uint32_t> marks_;  // per triangle slot
  uint32_t mark_ = 0;
  std::vector<uint32_t> hole_slots_;  // of the batch at hand, as its holes
  std::vector<uint32_t> target_at_;   // per triangle slot, of the insertions at hand; kNone32: none
  std::vector<uint32_t> slots_;
  std::vector<std::array<uint32_t, 3>> places_;
  // Of the removal at hand: the hole's triangle on the side of the least and the greatest corner.
  struct HoleAt {
    TriangleKey key = 0;
    uint32_t apex = 0;
  };
  std::array<std::array<HoleAt, kMaxRing>, kMaxRing> hole_at_;
};

UpdateEncoder::Impl::Impl(const ClientMeshOptions& options, const BaseMesh& base,
                          const MeetsRegion& region)
    : options_(options),
      row_bytes_(options.attributes.row_bytes()),
      max_updates_(kMaxRecordBytes / 2 / (kMaxUpdateBytes + kMaxBytesPerRowByte * row_bytes_)),
      mesh_(options, false),
      models_(options.attributes),
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

// Vertices go in the order in which the triangles name them.
void UpdateEncoder::Impl::WriteStart(const BaseMesh& base, Vec3d origin) {
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

  MTDB_CHECK(body.size() <= kMaxStartBytes, "a base mesh is too long for a stream's start");
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
}

// The client holds the whole cut.
void UpdateEncoder::Impl::StartWholeCut() {
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

uint32_t UpdateEncoder::Impl::TriangleOf(TriangleKey key) const {
  const uint32_t slot = triangles_.Find(key);
  MTDB_CHECK(slot != kNone32, "an update names a triangle that the client does not have");
  return slot;
}

uint32_t UpdateEncoder::Impl::VertexOf(VertexIndex key) const {
  const uint32_t slot = vertices_.Find(key);
  MTDB_CHECK(slot != kNone32, "an update names a vertex that the client does not have");
  return slot;
}

void UpdateEncoder::Impl::MarkHole(const Node& node) {
  if (++mark_ == 0) {
    std::fill(marks_.begin(), marks_.end(), 0);
    mark_ = 1;
  }
  marks_.resize(mesh_.triangle_slots());
  for (const uint32_t slot : HoleSlots(node)) marks_[slot] = mark_;
}

uint32_t UpdateEncoder::Impl::SplitEdge(const UpdateBatch& batch, const Node& node,
                                        const Patch::Hole& hole) const {
  const std::span<const VertexIndex> ring = batch.ring_of(node);
  const uint32_t last = VertexOf(ring.back());
  const uint32_t first = VertexOf(ring.front());
  for (uint32_t j = 0; j < hole.ring_count; ++j) {
    if (hole.ring[j] == last && hole.ring[j + 1 == hole.ring_count ? 0 : j + 1] == first) return j;
  }
  return kNone32;
}

UpdateEncoder::Impl::Sorted UpdateEncoder::Impl::Sort(const UpdateBatch& batch,
                                                      const Follows& follows,
                                                      bool (Impl::*find)(const UpdateBatch&,
                                                                         const Node&, Target*)) {
  Sorted sorted;
  for (size_t i = 0; i < batch.nodes.size(); ++i) {
    if (!follows.empty() && !follows[i]) continue;
    const Node& node = batch.nodes[i];
    Target target;
    if ((this->*find)(batch, node, &target)) {
      sorted.targets.push_back(target);
    } else {
      sorted.listed.push_back(&node);
    }
  }
  std::sort(sorted.targets.begin(), sorted.targets.end(),
            [](const Target& a, const Target& b) { return a.at < b.at; });
  return sorted;
}

bool UpdateEncoder::Impl::FindHole(const UpdateBatch& batch, const Node& node, Target* target) {
  const std::span<uint32_t> slots = HoleSlots(node);
  const std::span<const UpdateBatch::HoleTriangle> hole = batch.hole_of(node);
  for (size_t i = 0; i < hole.size(); ++i) slots[i] = TriangleOf(hole[i].key);
  MarkHole(node);
  uint32_t anchor = kNone32;
  for (const uint32_t slot : slots) {
    if (anchor == kNone32 || mesh_.triangle(slot).born > mesh_.triangle(anchor).born) {
      anchor = slot;
    }
  }
  *target = {&node, anchor};
  UpdateHole update;
  return WalkHole(mesh_, anchor, update,
                  [&](uint32_t, uint32_t slot, uint32_t) { return Marked(slot); }) &&
         update.hole.ring_count == node.ring_count &&
         update.hole.slot_count == node.ring_count - 2 &&
         (!node.boundary || SplitEdge(batch, node, update.hole) != kNone32);
}

bool UpdateEncoder::Impl::FindStar(const UpdateBatch& batch, const Node& node, Target* target) {
  static_cast<void>(batch);
  const uint32_t vertex = VertexOf(node.vertex);
  *target = {&node, vertex};
  UpdateHole update;
  return WalkStar(mesh_, vertex, update) && update.hole.ring_count == node.ring_count &&
         update.boundary == node.boundary;
}

uint32_t UpdateEncoder::Impl::AddVertex(VertexIndex key, Vec3i position, const std::byte* row) {
  ++sent_;
  cost_.AddVertex();
  const uint32_t vertex = mesh_.AddVertex(position, row);
  vertices_.Put(key, vertex);
  return vertex;
}

uint32_t UpdateEncoder::Impl::PutVertex(const UpdateBatch& batch, const Node& node,
                                        uint32_t remembered) {
  if (remembered != kNone32) {
    mesh_.Recall(remembered);
    ++recalled_;
    return remembered;
  }
  return AddVertex(node.vertex, node.position, RowOf(batch, node));
}

void UpdateEncoder::Impl::FinishInsertion(const UpdateBatch& batch, const Node& node,
                                          const UpdateHole& update, uint32_t vertex) {
  for (const uint32_t slot : update.hole.slot_span()) EraseTriangle(slot);
  slots_.clear();
  InsertStar(mesh_, models_, update, vertex, &slots_);
  const std::span<const VertexIndex> ring = batch.ring_of(node);
  for (size_t j = 0; j < slots_.size(); ++j) {
    const VertexIndex key = vertices_.key(update.hole.ring[j]);
    const auto place = std::find(ring.begin(), ring.end(), key) - ring.begin();
    PutTriangle(node.first_star + static_cast<uint64_t>(place), slots_[j]);
    next_fresh_.emplace_back(slots_[j], mesh_.triangle(slots_[j]).born);
  }
}

void UpdateEncoder::Impl::EncodeInsertion(const UpdateBatch& batch, const Target& target) {
  const Node& node = *target.node;
  MarkHole(node);
  UpdateHole update;
  uint32_t remembered = RememberedSlot(node);
  bool again = false;
  if (const uint32_t fills = mesh_.triangle(target.at).fills; mesh_.is_remembered(fills)) {
    again = fills == remembered && WalkAgain(mesh_, target.at, fills, update) &&
            update.hole.ring_count == node.ring_count && update.boundary == node.boundary;
    for (const uint32_t slot : update.hole.slot_span()) again &= Marked(slot);
    coder_.Bit(models_.again, again);
  }
  if (!again) {
    const UpdateShapes shapes(mesh_, models_);
    const uint64_t born = mesh_.triangle(target.at).born;
    WalkHole(mesh_, target.at, update, [&](uint32_t count, uint32_t slot, uint32_t h) {
      if (mesh_.triangle(slot).born > born) return false;
      return models_.topology.CodeTake(coder_, count, shapes.Shape(h), Marked(slot));
    });
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

void UpdateEncoder::Impl::EncodeInsertions(const UpdateBatch& batch,
                                           std::span<const Target> targets) {
  target_at_.resize(mesh_.triangle_slots(), kNone32);
  for (uint32_t i = 0; i < targets.size(); ++i) target_at_[targets[i].at] = i;
  // The last batch made nothing but fresh ones.
  const auto is_fresh = [&](const Target& target) {
    const uint64_t born = mesh_.triangle(target.at).born;
    return !fresh_.empty() && born >= fresh_.front().second && born <= fresh_.back().second;
  };
  const bool all_fresh = std::all_of(targets.begin(), targets.end(), is_fresh);
  coder_.Bit(models_.more, true);
  coder_.Bit(models_.other, false);
  coder_.Bit(models_.insert, true);
  const bool fresh = all_fresh && fresh_.size() < 32 * targets.size();
  coder_.Bit(models_.fresh, fresh);
  CodeNumber(coder_, models_.count, static_cast<uint32_t>(targets.size()));
  if (fresh) {
    size_t left = targets.size();
    for (size_t i = 0; left > 0; ++i) {
      const auto [slot, born] = fresh_[i];
      if (mesh_.triangle(slot).born != born) continue;
      const Patch::Triangle view = UpdateShapes(mesh_, models_).AnchorView(slot);
      const uint32_t target = target_at_[slot];
      if (!models_.topology.CodeAnchor(coder_, view, 1, target != kNone32)) continue;
      EncodeInsertion(batch, targets[target]);
      --left;
    }
  } else {
    uint32_t next = 0;
    for (const Target& target : targets) {
      CodeNumber(coder_, models_.anchor_gap, target.at - next);
      next = target.at + 1;
      EncodeInsertion(batch, target);
    }
  }
  for (const Target& target : targets) target_at_[target.at] = kNone32;
  fresh_.swap(next_fresh_);
  next_fresh_.clear();
}

void UpdateEncoder::Impl::FinishRemoval(const UpdateBatch& batch, const Node& node,
                                        const UpdateHole& update, uint32_t vertex) {
  // Places in the ring as the client walks it -> the hole's triangles, by their outer corners.
  const std::span<const VertexIndex> ring = batch.ring_of(node);
  const std::span<const uint32_t> walked = update.hole.ring_span();
  std::array<uint32_t, kMaxRing + 1> place{};
  for (uint32_t j = 0; j < walked.size(); ++j) {
    const auto i = std::find(ring.begin(), ring.end(), vertices_.key(walked[j])) - ring.begin();
    place[static_cast<size_t>(i)] = j;
  }
  for (const auto& t : batch.hole_of(node)) {
    std::array<uint32_t, 3> c = {place[t.corners[0]], place[t.corners[1]], place[t.corners[2]]};
    std::sort(c.begin(), c.end());
    hole_at_[c[0]][c[2]] = {t.key, c[1]};
  }
  CodePolygon(
      coder_, models_, mesh_, walked, [&](uint32_t i, uint32_t j) { return hole_at_[i][j].apex; },
      places_);
  for (const uint32_t slot : update.hole.slot_span()) EraseTriangle(slot);
  slots_.clear();
  RemoveStar(mesh_, update, vertex, places_, &slots_);
  for (size_t i = 0; i < slots_.size(); ++i) {
    PutTriangle(hole_at_[places_[i][0]][places_[i][2]].key, slots_[i]);
  }
  const uint32_t first = update.boundary ? walked[0] : kNone32;
  if (const uint32_t lost = mesh_.Forget(vertex, first); lost != kNone32) {
    vertices_.Erase(lost);
  }
}

void UpdateEncoder::Impl::EncodeRemoval(const UpdateBatch& batch, const Target& target) {
  UpdateHole update;
  WalkStar(mesh_, target.at, update);
  FinishRemoval(batch, *target.node, update, target.at);
}

void UpdateEncoder::Impl::EncodeRemovals(const UpdateBatch& batch,
                                         std::span<const Target> targets) {
  coder_.Bit(models_.more, true);
  coder_.Bit(models_.other, false);
  coder_.Bit(models_.insert, false);
  CodeNumber(coder_, models_.count, static_cast<uint32_t>(targets.size()));
  uint32_t next = 0;
  for (const Target& target : targets) {
    CodeNumber(coder_, models_.vertex_gap, target.at - next);
    next = target.at + 1;
    EncodeRemoval(batch, target);
  }
}

void UpdateEncoder::Impl::EncodeBatch(const UpdateBatch& batch, const Follows& follows,
                                      ByteWriter& out) {
  if (batch.insert) hole_slots_.resize(batch.holes.size());
  const Sorted sorted = Sort(batch, follows, batch.insert ? &Impl::FindHole : &Impl::FindStar);
  for (std::span<const Target> left = sorted.targets; !left.empty();) {
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
  for (const Node* node : sorted.listed) {
    MakeRoom(1, out);
    cost_.AddUpdates(1);
    EncodeListed(batch, *node);
  }
}

// An update whose triangles the client cannot find by walking: where edges are non-manifold.
void UpdateEncoder::Impl::EncodeListed(const UpdateBatch& batch, const Node& node) {
  ++listed_;
  coder_.Bit(models_.more, true);
  coder_.Bit(models_.other, true);
  coder_.Bit(models_.clip, false);
  coder_.Bit(models_.insert, batch.insert);
  UpdateHole update;
  Patch::Hole& hole = update.hole;
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
  next_fresh_.clear();
}

void UpdateEncoder::Impl::MakeRoom(uint64_t updates, ByteWriter& out) {
  if (record_updates_ > 0 && record_updates_ + updates > max_updates_) {
    coder_.Bit(models_.more, false);
    PutRecord(out);
  }
  record_updates_ += updates;
}

void UpdateEncoder::Impl::PutRecord(ByteWriter& out) {
  Bytes record = coder_.Finish();
  if (record.size() < cost_.bytes()) record.resize(cost_.bytes());
  MTDB_CHECK(record.size() <= kMaxRecordBytes, "a record is longer than max_updates_ allows");
  cost_ = RecordCost(row_bytes_);
  record_updates_ = 0;
  out.PutVarint(record.size());
  out.Put<uint32_t>(static_cast<uint32_t>(Hash64(record)));
  out.PutBytes(record);
}

Bytes UpdateEncoder::Impl::Encode(std::span<const UpdateBatch> batches, const MeetsRegion& region) {
  ByteWriter out;
  if (region && !whole_) StartWholeCut();
  std::vector<Follows> plan(batches.size());
  if (whole_) {
    for (const UpdateBatch& batch : batches) whole_->Apply(batch);
    whole_->Choose(region);
    plan = whole_->Plan(batches, triangles_);
  }
  const uint64_t enough = std::min(kRecordUpdates, max_updates_);
  for (size_t b = 0; b < batches.size(); ++b) {
    EncodeBatch(batches[b], plan[b], out);
    if (record_updates_ == 0) continue;
    if (record_updates_ < enough && (b + 1 < batches.size() || whole_)) continue;
    coder_.Bit(models_.more, false);
    PutRecord(out);
  }
  if (whole_) EncodeClip(out);
  if (!region) whole_.reset();
  hole_slots_ = {};
  return out.Take();
}

size_t UpdateEncoder::Impl::memory_bytes() const {
  return sizeof(*this) + mesh_.memory_bytes() + (whole_ ? whole_->memory_bytes() : 0) +
         triangles_.memory_bytes() + vertices_.memory_bytes() + CapacityBytes(start_) +
         CapacityBytes(fresh_) + CapacityBytes(next_fresh_) + CapacityBytes(marks_) +
         CapacityBytes(slots_) + CapacityBytes(hole_slots_) + CapacityBytes(target_at_);
}

// The client's answers to what clip_coder.h asks, out of the whole cut.
class UpdateEncoder::Impl::AttachedSide {
 public:
  // `slots`: the triangles of the whole cut that are to be attached.
  AttachedSide(Impl& encoder, std::span<const uint32_t> slots)
      : e_(encoder),
        whole_(*encoder.whole_),
        slots_(slots),
        pending_(whole_.mesh().triangle_slots()) {
    for (const uint32_t slot : slots) pending_[slot] = true;
    for (const uint32_t slot : slots) {
      for (const uint32_t o : whole_.mesh().triangle(slot).opposite) {
        if (o == kNone32 || whole_.client_slot(o >> 2) == kNone32) continue;
        if (const uint32_t h = ClientHalfEdge(o); h != kNone32) seeds_.emplace_back(h, slot);
      }
    }
    std::sort(seeds_.begin(), seeds_.end());
  }

  uint32_t NextSeed() {
    for (; seed_ < seeds_.size(); ++seed_) {
      const auto [h, slot] = seeds_[seed_];
      if (!pending_[slot] || e_.mesh_.triangle(h >> 2).opposite[h & 3] != kNone32) continue;
      return h;
    }
    target_ = slots_[alone_];
    first_corner_ = 0;
    return kNone32;
  }
  bool done() {
    while (alone_ < slots_.size() && !pending_[slots_[alone_]]) ++alone_;
    return alone_ == slots_.size();
  }
  bool Across(uint32_t h) {
    const uint32_t o = WholeOpposite(h);
    if (o == kNone32 || !pending_[o >> 2]) return false;
    target_ = o >> 2;
    first_corner_ = o & 3;
    return true;
  }
  uint32_t Corner(uint32_t i) {
    corner_ = whole_.mesh().triangle(target_).corners[(first_corner_ + i) % 3];
    return e_.vertices_.Find(whole_.vertex_key(corner_));
  }
  Vec3i position() const { return whole_.mesh().position(corner_); }
  void CodeRow(const AttributeCoder::Star& star) {
    if (e_.row_bytes_ == 0) return;
    e_.models_.attribute_coder.Encode(e_.coder_, star, e_.mesh_.rows(), row());
  }
  void CodeRow() {
    for (size_t i = 0; i < e_.row_bytes_; ++i) e_.coder_.Raw(8, static_cast<uint32_t>(row()[i]));
  }
  uint32_t PutVertex(Vec3i p) { return e_.AddVertex(whole_.vertex_key(corner_), p, row()); }
  void Recalled() { ++e_.recalled_; }
  bool MayPutTriangle() {
    e_.cost_.AddAttached();
    return true;
  }
  void PutTriangle(uint32_t slot) {
    pending_[target_] = false;
    e_.PutTriangle(whole_.key(target_), slot);
  }

 private:
  const std::byte* row() const { return whole_.mesh().row(corner_).data(); }
  // The half-edge of the client's triangle that is the whole cut's half-edge.
  uint32_t ClientHalfEdge(uint32_t half_edge) const {
    const VertexIndex from =
        whole_.vertex_key(whole_.mesh().triangle(half_edge >> 2).corners[half_edge & 3]);
    const uint32_t slot = whole_.client_slot(half_edge >> 2);
    const auto& corners = e_.mesh_.triangle(slot).corners;
    for (uint32_t i = 0; i < 3; ++i) {
      if (e_.vertices_.key(corners[i]) == from) return 4 * slot + i;
    }
    return kNone32;
  }
  // What lies beyond the client's half-edge in the whole cut.
  uint32_t WholeOpposite(uint32_t half_edge) const {
    const VertexIndex from =
        e_.vertices_.key(e_.mesh_.triangle(half_edge >> 2).corners[half_edge & 3]);
    const ClientMesh::Triangle& t = whole_.mesh().triangle(whole_.held(half_edge >> 2).whole);
    for (size_t i = 0; i < 3; ++i) {
      if (whole_.vertex_key(t.corners[i]) == from) return t.opposite[i];
    }
    return kNone32;
  }

  Impl& e_;
  const WholeCut& whole_;
  const std::span<const uint32_t> slots_;
  std::vector<bool> pending_;
  std::vector<std::pair<uint32_t, uint32_t>> seeds_;  // half-edges of the client; what lies beyond
  size_t seed_ = 0;
  size_t alone_ = 0;
  uint32_t target_ = 0, first_corner_ = 0, corner_ = 0;  // of the whole cut
};

// The triangles of the whole cut that the client is to have and has not, neighbours by neighbours.
std::vector<uint32_t> UpdateEncoder::Impl::Coming() const {
  const ReplayedMesh& mesh = whole_->mesh();
  std::vector<uint32_t> coming;
  std::vector<bool> seen(mesh.triangle_slots());
  const auto visit = [&](uint32_t slot) {
    if (seen[slot] || !whole_->chosen(slot) || whole_->client_slot(slot) != kNone32) return;
    seen[slot] = true;
    coming.push_back(slot);
  };
  for (uint32_t slot = 0; slot < mesh.triangle_slots(); ++slot) {
    const size_t first = coming.size();
    visit(slot);
    for (size_t i = first; i < coming.size(); ++i) {
      for (const uint32_t o : mesh.triangle(coming[i]).opposite) {
        if (o != kNone32) visit(o >> 2);
      }
    }
  }
  return coming;
}

void UpdateEncoder::Impl::EncodeDrops(const std::vector<uint32_t>& leaving,
                                      std::vector<uint32_t>* left_over) {
  std::vector<bool> leaves(mesh_.triangle_slots());
  for (const uint32_t slot : leaving) leaves[slot] = true;
  DropWalk walk(mesh_, drop_scratch_);
  size_t next = 0;
  walk.Code(
      coder_, models_.clips, [&](uint32_t slot) { return leaves[slot]; },
      [&](uint32_t) {
        while (next < leaving.size() && walk.decided(leaving[next])) ++next;
        return next == leaving.size() ? kNone32 : leaving[next];
      });
  for (const uint32_t slot : walk.dropped()) EraseTriangle(slot);
  mesh_.Drop(walk.dropped(), left_over);
}

// Drops what is not chosen, and attaches what is.
void UpdateEncoder::Impl::EncodeClip(ByteWriter& out) {
  std::vector<uint32_t> leaving;
  for (uint32_t slot = 0; slot < mesh_.triangle_slots(); ++slot) {
    if (!mesh_.has_triangle(slot)) continue;
    const uint32_t whole = whole_->held(slot).whole;
    if (whole == kNone32 || !whole_->chosen(whole)) leaving.push_back(slot);
  }
  std::vector<uint32_t> coming = Coming();
  if (leaving.empty() && coming.empty()) {
    if (record_updates_ == 0) return;
    coder_.Bit(models_.more, false);
    PutRecord(out);
    return;
  }
  // A triangle brings up to three vertices.
  const uint64_t most = std::clamp<uint64_t>(max_updates_ / 4, 1, kRecordTriangles);
  for (size_t begin = 0; begin == 0 || begin < coming.size(); begin += most) {
    const size_t end = std::min<size_t>(begin + most, coming.size());
    MakeRoom(3 * most, out);
    const auto slots = std::span<const uint32_t>(coming).subspan(begin, end - begin);
    coder_.Bit(models_.more, true);
    coder_.Bit(models_.other, true);
    coder_.Bit(models_.clip, true);
    std::vector<uint32_t> left_over;
    EncodeDrops(leaving, &left_over);
    leaving.clear();
    AttachedSide side(*this, slots);
    const bool good = Attacher(coder_, models_, mesh_, side, &left_over).Code();
    MTDB_CHECK(good, "a triangle of the cut has equal corners");
    ForgetLeftOver(mesh_, left_over, [&](uint32_t vertex) { vertices_.Erase(vertex); });
    PutRecord(out);
  }
}

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
