// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "codecs/stream/internal/clip_coder.h"
#include "codecs/stream/internal/delaunay_coder.h"
#include "codecs/stream/internal/update_coder.h"
#include "codecs/stream/update_stream.h"
#include "store/base/attribute_layout.h"
#include "store/base/hash.h"

namespace mtdb {

using namespace internal;

class UpdateDecoder::Impl {
 public:
  explicit Impl(const Limits& limits) : limits_(limits) {}

  Status Feed(ByteSpan bytes);
  bool started() const { return started_; }
  bool at_record() const { return started_ && buffer_.empty(); }

  ReplayedMesh mesh_;
  const ClientMesh shown_{mesh_};

 private:
  class AttachedSide;
  using Coder = RansDecoder<>::Lane<0>;

  Status Corrupted(const std::string& what) const {
    return Corrupt("update stream: offset " + std::to_string(offset_) + ": " + what);
  }
  // Takes the start or a record off `reader`; *complete is false when more bytes are needed.
  Status TakePart(ByteReader& reader, bool* complete);
  Status DecodeStart(ByteSpan body);
  Status TakeGrid(ByteReader& reader, ClientMeshOptions* options) const;
  Status DecodeRecord(ByteSpan record);
  // `count` slots, ascending; decode(slots, i) is called for each.
  template <typename Decode>
  Status DecodeAscending(Coder& coder, NumberModel& gap, uint32_t count, Decode&& decode);
  Status DecodeClip(Coder& coder);
  Status DecodeRemoval(Coder& coder, uint32_t vertex);
  Status DecodeInsertion(Coder& coder, uint32_t anchor);
  Status DecodeListed(Coder& coder, bool insert);
  Status DecodeLists(Coder& coder, bool insert, UpdateHole& update) const;
  Status DecodeListedVertex(Coder& coder, uint64_t more, uint32_t& vertex);
  Status DecodeCrumb(Coder& coder, bool insert);
  Status InsertCrumb(Coder& coder);
  Status CheckListed(bool insert, uint32_t vertex, UpdateHole& update) const;
  // By the Delaunay rule.
  Status DecodeRuled(Coder& coder);
  Status DecodeNamed(Coder& coder);
  Status DecodeAsked(Coder& coder);
  Status DecodeRuledInsertion(Coder& coder, uint32_t anchor);
  Status DecodeRuledRemoval(Coder& coder, uint32_t vertex);
  // Whether the record may do what was counted of it so far.
  bool MayGoOn() const { return !decoder_.overrun() && cost_.bytes() <= record_bytes_; }
  Status TooCostly() const {
    return Corrupted("the record is cut short, or does more than its bytes allow");
  }
  bool HasRoomForVertex() const {
    return mesh_.vertex_count() + mesh_.remembered().size() < limits_.vertices;
  }
  Status TakeVertex(uint64_t more, Vec3i position, uint32_t& vertex);
  Status FinishRemoval(Coder& coder, const UpdateHole& update, uint32_t vertex);
  // Whether the triangles are bounded by just these edges, which it sorts.
  bool BoundedBy(std::span<const uint32_t> slots,
                 std::vector<std::pair<uint32_t, uint32_t>>& edges) const;

  const Limits limits_;
  Status status_;
  bool started_ = false;
  Bytes buffer_;
  uint64_t offset_ = 0;  // in the stream, of what is decoded
  RansDecoder<> decoder_{{}};
  size_t record_bytes_ = 0;  // of the record at hand
  RecordCost cost_{0};       // likewise
  DropScratch drop_scratch_;
  DelaunaySweep sweep_;
  DelaunayWalk walk_;
  DelaunayHole hole_;
  NearPlaces near_places_;
  UpdateModels models_{{}};
  Bytes row_;
  std::vector<Vec3i> ring_;                          // positions around the vertex at hand
  UpdateHole update_;                                // the one at hand
  std::array<UpdateHole, kMostListedHoles> listed_;  // the holes of one that lists them
  FreshTriangles fresh_;
  FreshTriangles next_fresh_;
  std::vector<uint32_t> slots_;
  std::vector<std::array<uint32_t, 3>> places_;
};

Status UpdateDecoder::Impl::Feed(ByteSpan bytes) {
  MTDB_RETURN_IF_ERROR(status_);
  buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
  size_t taken = 0;
  bool changed = false;
  for (bool complete = true; complete && taken < buffer_.size();) {
    ByteReader reader(ByteSpan(buffer_).subspan(taken));
    status_ = TakePart(reader, &complete);
    changed |= complete;
    if (!status_.ok() || !complete) break;
    taken += reader.position();
    offset_ += reader.position();
  }
  if (changed) mesh_.Draw();
  MTDB_RETURN_IF_ERROR(status_);
  buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(taken));
  return Status::Ok();
}

Status UpdateDecoder::Impl::TakePart(ByteReader& reader, bool* complete) {
  constexpr size_t kLongestVarint = 10;
  *complete = false;
  if (!started_) {
    for (const char c : kUpdateMagic) {
      if (reader.remaining() == 0) return Status::Ok();
      if (reader.Get<char>() != c) return Corrupted("this is no update stream");
    }
    if (reader.remaining() == 0) return Status::Ok();
    if (const auto version = reader.Get<uint8_t>(); version != kUpdateVersion) {
      return Unsupported("update stream: version " + std::to_string(version) +
                         ", but this reader knows version " + std::to_string(kUpdateVersion));
    }
  }
  const bool enough = reader.remaining() >= kLongestVarint;
  const uint64_t length = reader.GetVarint();
  if (reader.failed()) return enough ? Corrupted("length of a record") : Status::Ok();
  if (length == 0 || length > kMaxRecordBytes) {
    return Corrupted("a record of " + std::to_string(length) + " bytes");
  }
  const auto checksum = reader.Get<uint32_t>();
  if (reader.failed() || reader.remaining() < length) return Status::Ok();
  const ByteSpan body = reader.GetBytes(length);
  if (static_cast<uint32_t>(Hash64(body)) != checksum) return Corrupted("checksum of a record");
  *complete = true;
  if (started_) return DecodeRecord(body);
  MTDB_RETURN_IF_ERROR(DecodeStart(body));
  started_ = true;
  return Status::Ok();
}

Status UpdateDecoder::Impl::TakeGrid(ByteReader& reader, ClientMeshOptions* options) const {
  const auto mode = reader.Get<uint8_t>();
  if (mode > static_cast<uint8_t>(PositionMode::kRaster)) return Corrupted("mode of positions");
  options->grid.mode = static_cast<PositionMode>(mode);
  for (int i = 0; i < 3; ++i) options->grid.origin[i] = reader.Get<double>();
  options->grid.step = reader.Get<double>();
  if (options->grid.mode == PositionMode::kRaster) {
    for (double& v : options->grid.plane) v = reader.Get<double>();
  }
  const auto rule = reader.Get<uint8_t>();
  if (rule > 1 || (rule == 1 && options->grid.mode != PositionMode::kRaster)) {
    return Corrupted("rule of triangulation");
  }
  options->delaunay = rule == 1;
  return Status::Ok();
}

Status UpdateDecoder::Impl::DecodeStart(ByteSpan body) {
  ByteReader reader(body);
  ClientMeshOptions options;
  MTDB_RETURN_IF_ERROR(TakeGrid(reader, &options));
  Vec3d origin;
  for (int i = 0; i < 3; ++i) origin[i] = reader.Get<double>();
  if (!std::isfinite(origin.x) || !std::isfinite(origin.y) || !std::isfinite(origin.z)) {
    return Corrupted("origin of the float positions");
  }
  Result<AttributeLayout> layout = GetAttributeLayout(&reader);
  if (!layout.ok()) return Corrupted(layout.status().message());
  options.attributes = *std::move(layout);
  const uint64_t remembered = reader.GetVarint();
  const uint64_t vertices = reader.GetVarint();
  const uint64_t triangles = reader.GetVarint();
  const size_t row_bytes = options.attributes.row_bytes();
  if (reader.failed() || remembered > limits_.vertices || vertices > limits_.vertices ||
      triangles > limits_.triangles || vertices > reader.remaining() / (3 + row_bytes) ||
      triangles > reader.remaining() / 3) {
    return Corrupted("counts of the base mesh");
  }
  options.remembered_vertices = static_cast<uint32_t>(remembered);
  std::vector<Vec3i> positions(vertices);
  Vec3i last{};
  for (Vec3i& p : positions) {
    for (int i = 0; i < 3; ++i) {
      const auto difference = UnZigZag(static_cast<uint32_t>(reader.GetVarint()));
      p[i] = static_cast<int32_t>(static_cast<uint32_t>(last[i]) + difference);
    }
    if (options.delaunay && !IsPlace(p)) return Corrupted("a vertex beyond the lattice");
    last = p;
  }
  std::vector<std::array<uint32_t, 3>> corners(triangles);
  uint32_t used = 0;
  for (auto& t : corners) {
    for (uint32_t& v : t) {
      const uint64_t back = reader.GetVarint();
      if (back > used || (back == 0 && used == vertices)) return Corrupted("corner of a triangle");
      v = back == 0 ? used++ : used - static_cast<uint32_t>(back);
    }
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) return Corrupted("degenerate triangle");
  }
  const ByteSpan planes = reader.GetBytes(vertices * row_bytes);
  if (reader.failed() || reader.remaining() != 0 || used != vertices) {
    return Corrupted("length of the base mesh");
  }
  mesh_ = ReplayedMesh(options, true);
  mesh_.Start(origin, positions, JoinPlanes(planes, row_bytes), corners);
  models_ = UpdateModels(options.attributes);
  models_.reference = UpdateReference(mesh_);
  row_.resize(row_bytes);
  return Status::Ok();
}

Status UpdateDecoder::Impl::DecodeRecord(ByteSpan record) {
  decoder_ = RansDecoder<>(record);
  record_bytes_ = record.size();
  cost_ = RecordCost(row_.size());
  Coder coder(decoder_);
  while (coder.Bit(models_.more)) {
    if (coder.Bit(models_.other)) {
      if (coder.Bit(models_.clip)) {
        MTDB_RETURN_IF_ERROR(DecodeClip(coder));
        break;
      }
      if (mesh_.options().delaunay && coder.Bit(models_.delaunay.ruled)) {
        MTDB_RETURN_IF_ERROR(DecodeRuled(coder));
        continue;
      }
      cost_.AddUpdates(1);
      if (!MayGoOn()) return TooCostly();
      MTDB_RETURN_IF_ERROR(DecodeListed(coder, coder.Bit(models_.insert)));
      continue;
    }
    const bool insert = coder.Bit(models_.insert);
    const bool fresh = insert && coder.Bit(models_.fresh);
    const uint32_t count = CodeNumber(coder, models_.count, 0);
    cost_.AddUpdates(count);
    if (count == 0 || !MayGoOn()) return TooCostly();
    if (!insert) {
      MTDB_RETURN_IF_ERROR(DecodeAscending(coder, models_.vertex_gap, count,
                                           [&](std::span<const uint32_t> vertices, size_t i) {
                                             PrefetchStars(mesh_, vertices, i);
                                             return DecodeRemoval(coder, vertices[i]);
                                           }));
      continue;
    }
    next_fresh_.Clear(mesh_);
    if (fresh) {
      uint32_t left = count;
      for (size_t i = 0; left > 0; ++i) {
        if (i == fresh_.size()) return Corrupted("fewer anchors than insertions");
        fresh_.Prefetch(mesh_, i);
        fresh_.PrefetchHole(mesh_, i);
        const uint32_t slot = fresh_.slot(i);
        if (!fresh_.IsThere(mesh_, i)) continue;
        const Patch::Triangle view = UpdateShapes(mesh_, models_).AnchorView(slot);
        if (!models_.topology.CodeAnchor(coder, view, 1, false)) continue;
        MTDB_RETURN_IF_ERROR(DecodeInsertion(coder, slot));
        --left;
      }
    } else {
      MTDB_RETURN_IF_ERROR(DecodeAscending(coder, models_.anchor_gap, count,
                                           [&](std::span<const uint32_t> anchors, size_t i) {
                                             PrefetchAnchors(mesh_, anchors, i);
                                             return DecodeInsertion(coder, anchors[i]);
                                           }));
    }
    std::swap(fresh_, next_fresh_);
  }
  if (!decoder_.DoneBeforeZeros()) return Corrupted("record does not end where it should");
  return Status::Ok();
}

template <typename Decode>
Status UpdateDecoder::Impl::DecodeAscending(Coder& coder, NumberModel& gap, uint32_t count,
                                            Decode&& decode) {
  std::array<uint32_t, kSlotGroup> room{};
  uint64_t next = 0;
  for (size_t left = count; left > 0;) {
    const auto slots = std::span(room).first(std::min(left, kSlotGroup));
    if (!CodeSlots(coder, gap, next, slots)) return Corrupted("an update of what is not there");
    for (size_t i = 0; i < slots.size(); ++i) MTDB_RETURN_IF_ERROR(decode(slots, i));
    left -= slots.size();
  }
  return Status::Ok();
}

Status UpdateDecoder::Impl::DecodeInsertion(Coder& coder, uint32_t anchor) {
  if (!mesh_.has_triangle(anchor)) return Corrupted("anchor is no triangle");
  UpdateHole& update = update_;
  uint32_t remembered = kNone32;
  Vec3i position{};
  const uint32_t fills = mesh_.triangle(anchor).fills;
  if (mesh_.is_remembered(fills) && coder.Bit(models_.again)) {
    if (!WalkAgain(mesh_, anchor, fills, update)) return Corrupted("hole of a remembered vertex");
    remembered = fills;
  } else {
    const UpdateShapes shapes(mesh_, models_);
    const uint64_t born = mesh_.triangle(anchor).born();
    if (!WalkHole(mesh_, anchor, update, [&](uint32_t count, uint32_t slot, uint32_t h) {
          if (mesh_.triangle(slot).born() > born) return false;
          return models_.topology.CodeTake(coder, count, shapes.Shape(h), false);
        })) {
      return Corrupted("a hole is too large, or no disc");
    }
    const uint32_t split = CodeSplitEdge(coder, models_.topology, update.hole, kNone32);
    update.boundary = split != kNone32;
    if (update.boundary) {
      if (split >= update.hole.ring_count) return Corrupted("split edge beyond the ring");
      update.hole.Rotate(split);
    }
    const std::span<const uint32_t> all = mesh_.remembered();
    if (!all.empty() && coder.Bit(models_.known)) {
      const uint32_t place = coder.Raw(std::bit_width(all.size() - 1));
      if (place >= all.size()) return Corrupted("no such remembered vertex");
      remembered = all[place];
    } else {
      CodePosition(coder, models_, mesh_, update, position);
      if (!row_.empty()) {
        models_.attribute_coder.Decode(decoder_, AttributeStar(mesh_, update, position, &ring_),
                                       mesh_.rows(), row_.data());
      }
    }
  }
  if (coder.overrun()) return Corrupted("record cut short");
  uint32_t vertex = remembered;
  MTDB_RETURN_IF_ERROR(TakeVertex(2, position, vertex));
  InsertStar(mesh_, models_, update, vertex, &next_fresh_.slots());
  return Status::Ok();
}

// Puts the vertex that is inserted into the mesh, where it makes so many triangles more; `vertex`:
// the one that is remembered, or kNone32.
Status UpdateDecoder::Impl::TakeVertex(uint64_t more, Vec3i position, uint32_t& vertex) {
  if (mesh_.triangle_count() + more > limits_.triangles || !HasRoomForVertex()) {
    return Corrupted("the mesh exceeds this client's limit");
  }
  if (mesh_.options().delaunay && !IsPlace(position)) {
    return Corrupted("a vertex beyond the lattice");
  }
  if (vertex == kNone32) {
    cost_.AddVertex();
    if (!MayGoOn()) return TooCostly();
    vertex = mesh_.AddVertex(position, row_.data());
  } else {
    mesh_.Recall(vertex);
  }
  return Status::Ok();
}

Status UpdateDecoder::Impl::DecodeRemoval(Coder& coder, uint32_t vertex) {
  if (!mesh_.has_vertex(vertex)) return Corrupted("removal of what is no vertex");
  UpdateHole& update = update_;
  if (!WalkStar(mesh_, vertex, update)) {
    return Corrupted("removal of a vertex whose triangles are no fan");
  }
  MTDB_RETURN_IF_ERROR(FinishRemoval(coder, update, vertex));
  mesh_.Forget(vertex, FirstOfRing(update));
  return Status::Ok();
}

Status UpdateDecoder::Impl::FinishRemoval(Coder& coder, const UpdateHole& update, uint32_t vertex) {
  const std::span<const uint32_t> ring = update.hole.ring_span();
  CodePolygon(
      coder, models_, mesh_, ring, [](uint32_t, uint32_t) { return kNone32; }, places_);
  if (coder.overrun()) return Corrupted("record cut short");
  slots_.clear();
  RemoveStar(mesh_, update, vertex, places_, &slots_);
  return Status::Ok();
}

bool UpdateDecoder::Impl::BoundedBy(std::span<const uint32_t> slots,
                                    std::vector<std::pair<uint32_t, uint32_t>>& edges) const {
  std::vector<std::pair<uint32_t, uint32_t>> open;
  for (const uint32_t slot : slots) {
    const auto& c = mesh_.triangle(slot).corners;
    for (size_t i = 0; i < 3; ++i) {
      const std::pair edge(c[i], c[i == 2 ? 0 : i + 1]);
      const auto twin = std::find(open.begin(), open.end(), std::pair(edge.second, edge.first));
      if (twin == open.end()) {
        open.push_back(edge);
      } else {
        open.erase(twin);
      }
    }
  }
  std::sort(open.begin(), open.end());
  std::sort(edges.begin(), edges.end());
  return open == edges;
}

// The ring and the triangles of one hole, which are there; update.boundary is set.
Status UpdateDecoder::Impl::DecodeLists(Coder& coder, bool insert, UpdateHole& update) const {
  Patch::Hole& hole = update.hole;
  update.listed = true;
  hole.ring_count = coder.Raw(6);
  if (hole.ring_count < 3 || hole.ring_count > kMaxRing) return Corrupted("listed ring");
  hole.slot_count = insert ? hole.ring_count - 2 : hole.ring_count - (update.boundary ? 1 : 0);
  for (uint32_t i = 0; i < hole.ring_count; ++i) hole.ring[i] = coder.Raw(32);
  for (uint32_t i = 0; i < hole.slot_count; ++i) hole.slots[i] = coder.Raw(32);
  if (coder.overrun()) return Corrupted("record cut short");
  const auto distinct = [](std::span<const uint32_t> numbers) {
    std::vector<uint32_t> sorted(numbers.begin(), numbers.end());
    std::sort(sorted.begin(), sorted.end());
    return std::adjacent_find(sorted.begin(), sorted.end()) == sorted.end();
  };
  bool right = distinct(hole.ring_span()) && distinct(hole.slot_span());
  for (const uint32_t v : hole.ring_span()) right &= mesh_.has_vertex(v);
  for (const uint32_t slot : hole.slot_span()) right &= mesh_.has_triangle(slot);
  return right ? Status::Ok() : Corrupted("listed update of what is not there");
}

// That the triangles are a hole with that ring, or a star of the vertex.
Status UpdateDecoder::Impl::CheckListed(bool insert, uint32_t vertex, UpdateHole& update) const {
  const Patch::Hole& hole = update.hole;
  std::vector<std::pair<uint32_t, uint32_t>> edges;
  for (uint32_t j = 0; j + 1 < hole.ring_count; ++j) {
    edges.emplace_back(hole.ring[j], hole.ring[j + 1]);
  }
  const uint32_t first = hole.ring[0];
  const uint32_t last = hole.ring[hole.ring_count - 1];
  if (insert || !update.boundary) {
    edges.emplace_back(last, first);
  } else {
    edges.emplace_back(vertex, first);
    edges.emplace_back(last, vertex);
  }
  if (!BoundedBy(hole.slot_span(), edges)) return Corrupted("listed ring is not the hole's");
  if (insert) return Status::Ok();
  if (Has(hole.ring_span(), vertex)) return Corrupted("listed removal of what is no vertex");
  for (const uint32_t slot : hole.slot_span()) {
    if (!Has(mesh_.triangle(slot).corners, vertex)) return Corrupted("listed star");
  }
  return Status::Ok();
}

Status UpdateDecoder::Impl::DecodeListed(Coder& coder, bool insert) {
  const uint32_t count = coder.Raw(5);
  if (count == 0) return DecodeCrumb(coder, insert);
  const bool open = coder.Raw(1) != 0;
  // Two of a vertex inside of the surface are the two sides of the same triangles.
  if (count > (open ? kMostListedHoles : 2)) return Corrupted("listed holes");
  const auto holes = std::span(listed_).first(count);
  cost_.AddUpdates(holes.size() - 1);
  std::vector<uint32_t> slots;
  for (UpdateHole& update : holes) {
    update.boundary = open;
    MTDB_RETURN_IF_ERROR(DecodeLists(coder, insert, update));
    slots.insert(slots.end(), update.hole.slot_span().begin(), update.hole.slot_span().end());
  }
  std::sort(slots.begin(), slots.end());
  if (std::adjacent_find(slots.begin(), slots.end()) != slots.end()) {
    return Corrupted("listed holes that overlap");
  }
  uint32_t vertex = kNone32;
  if (!insert) {
    vertex = coder.Raw(32);
    if (coder.overrun()) return Corrupted("record cut short");
    if (!mesh_.has_vertex(vertex) || mesh_.degree(vertex) != slots.size()) {
      return Corrupted("listed removal of what is no vertex");
    }
  }
  const auto ends = [](const UpdateHole& update) {
    const std::span<const uint32_t> ring = update.hole.ring_span();
    return std::minmax({ring.front(), ring.back()});
  };
  for (UpdateHole& update : holes) {
    MTDB_RETURN_IF_ERROR(CheckListed(insert, vertex, update));
    if (open && ends(update) != ends(holes[0])) return Corrupted("listed holes of different edges");
  }
  if (!open && count == 2 &&
      !std::ranges::is_permutation(holes[0].hole.ring_span(), holes[1].hole.ring_span())) {
    return Corrupted("listed holes of different rings");
  }
  if (!insert) {
    for (const UpdateHole& update : holes) {
      MTDB_RETURN_IF_ERROR(FinishRemoval(coder, update, vertex));
    }
    mesh_.Forget(vertex, count == 1 ? FirstOfRing(holes[0]) : kNone32);
    return Status::Ok();
  }
  MTDB_RETURN_IF_ERROR(DecodeListedVertex(coder, 1 + holes.size(), vertex));
  for (const UpdateHole& update : holes) {
    InsertStar(mesh_, models_, update, vertex, &next_fresh_.slots());
  }
  next_fresh_.Clear(mesh_);
  return Status::Ok();
}

// One that is remembered, or a new one; it makes so many triangles more.
Status UpdateDecoder::Impl::DecodeListedVertex(Coder& coder, uint64_t more, uint32_t& vertex) {
  Vec3i position{};
  vertex = coder.Raw(32);
  if (vertex == kNone32) {
    for (int i = 0; i < 3; ++i) position[i] = static_cast<int32_t>(coder.Raw(32));
    for (std::byte& b : row_) b = static_cast<std::byte>(coder.Raw(8));
  } else if (!mesh_.is_remembered(vertex)) {
    return Corrupted("no such remembered vertex");
  }
  if (coder.overrun()) return Corrupted("record cut short");
  return TakeVertex(more, position, vertex);
}

Status UpdateDecoder::Impl::DecodeCrumb(Coder& coder, bool insert) {
  if (insert) return InsertCrumb(coder);
  const uint32_t count = coder.Raw(6);
  if (count == 0) return Corrupted("a crumb without triangles");
  slots_.clear();
  for (uint32_t t = 0; t < count; ++t) {
    slots_.push_back(coder.Raw(32));
    cost_.AddAttached();
    if (coder.overrun() || !mesh_.has_triangle(slots_.back())) {
      return Corrupted("a crumb whose triangles are not there");
    }
  }
  if (!MayGoOn()) return TooCostly();
  std::vector<uint32_t> sorted = slots_;
  std::sort(sorted.begin(), sorted.end());
  if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) {
    return Corrupted("a crumb with a triangle twice");
  }
  std::vector<uint32_t> left_over;
  mesh_.Drop(slots_, &left_over);
  for (const uint32_t vertex : left_over) mesh_.Forget(vertex, kNone32);
  return Status::Ok();
}

Status UpdateDecoder::Impl::InsertCrumb(Coder& coder) {
  const uint32_t vertices = coder.Raw(7);
  std::vector<uint32_t> own(vertices);
  for (uint32_t& vertex : own) MTDB_RETURN_IF_ERROR(DecodeListedVertex(coder, 0, vertex));
  const uint32_t count = coder.Raw(6);
  if (count == 0) return Corrupted("a crumb without triangles");
  if (mesh_.triangle_count() + count > limits_.triangles) {
    return Corrupted("the mesh exceeds this client's limit");
  }
  const auto is_there = [&](uint32_t v) { return mesh_.has_vertex(v) || Has(own, v); };
  for (uint32_t t = 0; t < count; ++t) {
    std::array<uint32_t, 3> corners;
    for (uint32_t& v : corners) v = coder.Raw(32);
    cost_.AddAttached();
    if (!MayGoOn()) return TooCostly();
    if (!std::ranges::all_of(corners, is_there) || corners[0] == corners[1] ||
        corners[1] == corners[2] || corners[2] == corners[0]) {
      return Corrupted("a crumb's corner that is not there");
    }
    mesh_.Attach(corners);
  }
  if (!std::ranges::all_of(own, [&](uint32_t v) { return mesh_.has_vertex(v); })) {
    return Corrupted("a crumb's vertex without triangles");
  }
  return Status::Ok();
}

Status UpdateDecoder::Impl::DecodeRuled(Coder& coder) {
  DelaunayModels& models = models_.delaunay;
  if (coder.Bit(models.insert)) {
    return coder.Bit(models.fresh) ? DecodeAsked(coder) : DecodeNamed(coder);
  }
  uint64_t next = 0;
  do {
    const uint64_t vertex = next + CodeNumber(coder, models.vertex_gap, 0);
    if (vertex >= kNone32) return Corrupted("removal of what is no vertex");
    MTDB_RETURN_IF_ERROR(DecodeRuledRemoval(coder, static_cast<uint32_t>(vertex)));
    next = vertex + 1;
  } while (coder.Bit(models.next));
  return Status::Ok();
}

Status UpdateDecoder::Impl::DecodeNamed(Coder& coder) {
  DelaunayModels& models = models_.delaunay;
  if (coder.Bit(models.begin)) sweep_.Begin(mesh_);
  do {
    const uint64_t slot = uint64_t{sweep_.next_slot()} + CodeNumber(coder, models.anchor_gap, 0);
    if (slot >= kNone32 || !mesh_.has_triangle(static_cast<uint32_t>(slot))) {
      return Corrupted("anchor is no triangle");
    }
    sweep_.Named(static_cast<uint32_t>(slot));
    MTDB_RETURN_IF_ERROR(DecodeRuledInsertion(coder, static_cast<uint32_t>(slot)));
  } while (coder.Bit(models.next));
  return Status::Ok();
}

Status UpdateDecoder::Impl::DecodeAsked(Coder& coder) {
  DelaunayModels& models = models_.delaunay;
  sweep_.NoMoreNames();
  do {
    uint32_t slot = 0;
    bool near_none = false;
    for (bool found = false; !found;) {
      if (!sweep_.Next(mesh_, &slot, &near_none)) return Corrupted("a vertex has no place");
      const uint64_t places = CountPlaces(PlacesOf(mesh_, slot));
      if (places == 0) continue;
      found = coder.Bit(SplitModel(models, places, near_none));
      if (!found) sweep_.GetsNone(mesh_, slot);
    }
    MTDB_RETURN_IF_ERROR(DecodeRuledInsertion(coder, slot));
  } while (coder.Bit(models.next));
  return Status::Ok();
}

Status UpdateDecoder::Impl::DecodeRuledInsertion(Coder& coder, uint32_t anchor) {
  DelaunayModels& models = models_.delaunay;
  const LatticeTriangle t = PlacesOf(mesh_, anchor);
  LatticePoint p;
  if (CountPlaces(t) == 0 || !CodePlace(coder, models, t, near_places_, p) ||
      !walk_.FindHole(mesh_, anchor, p, hole_)) {
    return Corrupted("a vertex that does not fit a Delaunay triangulation");
  }
  cost_.AddUpdates(CostOfHole(hole_));
  if (uint64_t{mesh_.triangle_count()} + 2 > limits_.triangles || !HasRoomForVertex()) {
    return Corrupted("the mesh exceeds this client's limit");
  }
  uint32_t vertex = mesh_.RememberedAt(p);
  if (vertex == kNone32) {
    Vec3i position{static_cast<int32_t>(p.x), static_cast<int32_t>(p.y), 0};
    position.z = CodeHeight(coder, models, GuessHeight(mesh_, hole_.ring, p), 0);
    if (!row_.empty()) {
      ring_.clear();
      for (const uint32_t v : hole_.ring) ring_.push_back(mesh_.position(v));
      models_.attribute_coder.Decode(decoder_, {position, hole_.ring, ring_}, mesh_.rows(),
                                     row_.data());
    }
    cost_.AddVertex();
    if (!MayGoOn()) return TooCostly();
    vertex = mesh_.AddVertex(position, row_.data());
  } else {
    if (!MayGoOn()) return TooCostly();
    mesh_.Recall(vertex);
  }
  sweep_.NoteHole(mesh_, hole_);
  slots_.clear();
  mesh_.ReplaceByStar(hole_.slots, hole_.ring, hole_.outer, vertex, hole_.boundary, &slots_);
  sweep_.AddStar(mesh_, slots_);
  return Status::Ok();
}

Status UpdateDecoder::Impl::DecodeRuledRemoval(Coder& coder, uint32_t vertex) {
  if (!mesh_.has_vertex(vertex) || !walk_.FindStar(mesh_, vertex, hole_)) {
    return Corrupted("removal of a vertex whose triangles are no fan");
  }
  const bool careful = coder.Bit(models_.delaunay.careful);
  cost_.AddUpdates(CostOfStar(hole_, careful));
  if (!MayGoOn()) return TooCostly();
  if (!walk_.Fill(mesh_, hole_, careful, places_)) {
    return Corrupted("removal of a vertex whose star the rule does not fill");
  }
  mesh_.Replace(hole_.slots, places_, kNone32, nullptr);
  mesh_.Forget(vertex, kNone32);
  return Status::Ok();
}

// The client has no answers of its own to what clip_coder.h asks.
class UpdateDecoder::Impl::AttachedSide {
 public:
  explicit AttachedSide(Impl& decoder) : d_(decoder) {}

  uint32_t NextSeed() const { return 0; }
  bool done() const { return false; }
  bool Across(uint32_t) const { return false; }
  uint32_t Corner(uint32_t) const { return 0; }
  Vec3i position() const { return {}; }
  void CodeRow(const AttributeCoder::Star& star) {
    if (d_.row_.empty()) return;
    d_.models_.attribute_coder.Decode(d_.decoder_, star, d_.mesh_.rows(), d_.row_.data());
  }
  void CodeRow() {
    for (std::byte& b : d_.row_) b = static_cast<std::byte>(d_.decoder_.lane().Raw(8));
  }
  uint32_t PutVertex(Vec3i p) {
    d_.cost_.AddVertex();
    if (!d_.MayGoOn() || !d_.HasRoomForVertex()) return kNone32;
    if (d_.mesh_.options().delaunay && !IsPlace(p)) return kNone32;
    return d_.mesh_.AddVertex(p, d_.row_.data());
  }
  void Recalled() const {}
  bool MayPutTriangle() {
    d_.cost_.AddAttached();
    return d_.MayGoOn() && d_.mesh_.triangle_count() < d_.limits_.triangles;
  }
  void PutTriangle(uint32_t) const {}

 private:
  Impl& d_;
};

Status UpdateDecoder::Impl::DecodeClip(Coder& coder) {
  std::vector<uint32_t> left_over;
  {
    DropWalk walk(mesh_, drop_scratch_);
    const auto no_answer = [](uint32_t) { return 0; };
    if (!walk.Code(coder, models_.clips, no_answer, no_answer) || coder.overrun()) {
      return Corrupted("dropping of what is no triangle");
    }
    mesh_.Drop(walk.dropped(), &left_over);
  }
  AttachedSide side(*this);
  const bool good = Attacher(coder, models_, mesh_, side, &left_over).Code();
  ForgetLeftOver(mesh_, left_over, [](uint32_t) {});
  if (!MayGoOn()) return TooCostly();
  return good ? Status::Ok() : Corrupted("triangles that cannot be attached");
}

UpdateDecoder::UpdateDecoder() : UpdateDecoder(Limits{}) {}
UpdateDecoder::UpdateDecoder(const Limits& limits) : impl_(std::make_unique<Impl>(limits)) {}
UpdateDecoder::~UpdateDecoder() = default;
Status UpdateDecoder::Feed(ByteSpan bytes) { return impl_->Feed(bytes); }
bool UpdateDecoder::started() const { return impl_->started(); }
bool UpdateDecoder::at_record() const { return impl_->at_record(); }
const ClientMesh& UpdateDecoder::mesh() const { return impl_->shown_; }
ClientMesh::Changes UpdateDecoder::TakeChanges() { return impl_->mesh_.TakeChanges(); }

}  // namespace mtdb
