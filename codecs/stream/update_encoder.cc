// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "codecs/stream/internal/memory_bytes.h"
#include "codecs/stream/internal/update_sender.h"
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

void UpdateSender::MarkHole(const Node& node) {
  if (++mark_ == 0) {
    std::fill(marks_.begin(), marks_.end(), 0);
    mark_ = 1;
  }
  ResizeTight(marks_, mesh_.triangle_slots());
  for (const uint32_t slot : HoleSlots(node)) marks_[slot] = mark_;
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

UpdateSender::Sorted UpdateSender::Sort(const UpdateBatch& batch, const Follows& follows,
                                        bool (UpdateSender::*find)(const UpdateBatch&, const Node&,
                                                                   Target*)) {
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

bool UpdateSender::FindHole(const UpdateBatch& batch, const Node& node, Target* target) {
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

bool UpdateSender::FindStar(const UpdateBatch& batch, const Node& node, Target* target) {
  static_cast<void>(batch);
  const uint32_t vertex = VertexOf(node.vertex);
  *target = {&node, vertex};
  UpdateHole update;
  return WalkStar(mesh_, vertex, update) && update.hole.ring_count == node.ring_count &&
         update.boundary == node.boundary;
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

void UpdateSender::EncodeInsertion(const UpdateBatch& batch, const Target& target) {
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

void UpdateSender::EncodeInsertions(const UpdateBatch& batch, std::span<const Target> targets) {
  ResizeTight(target_at_, mesh_.triangle_slots(), kNone32);
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

void UpdateSender::FinishRemoval(const UpdateBatch& batch, const Node& node,
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

void UpdateSender::EncodeRemoval(const UpdateBatch& batch, const Target& target) {
  UpdateHole update;
  WalkStar(mesh_, target.at, update);
  FinishRemoval(batch, *target.node, update, target.at);
}

void UpdateSender::EncodeRemovals(const UpdateBatch& batch, std::span<const Target> targets) {
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

void UpdateSender::EncodeBatch(const UpdateBatch& batch, const Follows& follows, ByteWriter& out) {
  if (batch.insert) hole_slots_.resize(batch.holes.size());
  const Sorted sorted =
      Sort(batch, follows, batch.insert ? &UpdateSender::FindHole : &UpdateSender::FindStar);
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
void UpdateSender::EncodeListed(const UpdateBatch& batch, const Node& node) {
  ++listed_;
  coder_.Bit(models_.more, true);
  coder_.Bit(models_.other, true);
  coder_.Bit(models_.clip, false);
  if (options_.delaunay) coder_.Bit(models_.delaunay.ruled, false);
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
  hole_slots_ = {};
  return out.Take();
}

size_t UpdateSender::memory_bytes() const {
  return sizeof(*this) + mesh_.memory_bytes() + (whole_ ? whole_->memory_bytes() : 0) +
         triangles_.memory_bytes() + vertices_.memory_bytes() + CapacityBytes(start_) +
         CapacityBytes(fresh_) + CapacityBytes(next_fresh_) + CapacityBytes(marks_) +
         CapacityBytes(slots_) + CapacityBytes(hole_slots_) + CapacityBytes(target_at_);
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
