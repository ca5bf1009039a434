// SPDX-License-Identifier: Apache-2.0
#include "codecs/cluster/cluster_codec.h"

#include <algorithm>
#include <cstring>
#include <optional>

#include "codecs/cluster/cluster_limits.h"
#include "codecs/cluster/internal/cluster_payload.h"
#include "codecs/cluster/internal/corners.h"
#include "codecs/cluster/internal/crumbs.h"
#include "codecs/cluster/internal/explicit_arcs.h"
#include "codecs/cluster/internal/lattice.h"
#include "codecs/cluster/internal/streams.h"
#include "codecs/coding/attribute_coder.h"
#include "codecs/coding/bit_stream.h"
#include "codecs/coding/cluster_model.h"
#include "codecs/coding/hole_frame.h"
#include "codecs/coding/patch.h"
#include "codecs/coding/rans.h"

namespace mtdb {

using namespace internal;

namespace {

int32_t Sum(int32_t expected, int32_t residual) {
  return static_cast<int32_t>(static_cast<uint32_t>(expected) + static_cast<uint32_t>(residual));
}

// Makes `numbers` hold at least kHoleEntries behind the first `used`.
inline void MakeRoom(std::vector<uint32_t>& numbers, size_t used) {
  if (used + kHoleEntries > numbers.size()) [[unlikely]] {
    numbers.resize(numbers.size() + numbers.size() / 2 + kHoleEntries);
  }
}

// Decodes generation by generation (see Patch). The nodes of a generation are known first, then
// their errors, then their vertices, each in a loop of its own: what does not depend on each other
// is done side by side.
class ClusterDecoder {
 public:
  ClusterDecoder(const AttributeLayout& attributes, const std::string& where)
      : attribute_coder_(attributes), where_(where) {}

  // `corners`: decode those of a textured object, too.
  Result<Cluster> Decode(ByteSpan payload, InPatch in, uint32_t node_limit, bool corners);

 private:
  // What is known of a node's vertex before its position.
  struct Vertex {
    HoleFrame frame;
    float deviation;  // along n: slant(), or unevenness()
    uint32_t ring_class;
    uint32_t hole_size, least_code;
    int32_t residual[3];  // along u and v: coordinates, when the lattice has them
  };

  Status Corrupted(const std::string& what) const { return Corrupt(where_ + ": " + what); }
  void Open(const StreamReader& streams);
  Status DecodeHead(ByteReader head, uint32_t node_limit, size_t payload_bytes);
  Status DecodeGeneration();
  Status DecodeTopology(uint32_t generation_end);
  Status DecodeOtherFans(RansDecoder<2>& coder, uint32_t anchor, uint32_t node,
                         const Patch::Hole& first_hole, uint32_t& ring_end, uint32_t& hole_end);
  Status DecodeLattice(uint32_t generation_end);
  void KnowNode(const Patch::Hole& hole, bool boundary, uint32_t node);
  void DecodeVertices(std::span<Vertex> vertices, uint32_t first);
  void PlaceVertices(std::span<const Vertex> vertices, uint32_t first);
  void DecodeRow(uint32_t node);
  Status DecodeArcs(const StreamReader& streams);
  void InheritSides();
  Status AddCrumbs(const StreamReader& streams, uint32_t node_limit);

  bool scaled_by_error() const { return (flags_ & kFlagScaledByError) != 0; }
  bool flat() const { return (flags_ & kFlagFlat) != 0; }
  bool has_fans() const { return (flags_ & kFlagFans) != 0; }

  AttributeCoder attribute_coder_;
  std::vector<Vec3i> ring_positions_;
  const std::string& where_;
  Cluster cluster_;
  uint8_t flags_ = 0;
  uint8_t reference_length_ = 0;
  uint32_t node_count_ = 0;

  Bytes readable_bits_;  // with as many bytes behind them as a reader may touch
  RansDecoder<2> topology_{{}};
  RansDecoder<4> vertex_stream_{{}};
  BitReader bits_{{}};
  RansDecoder<> attribute_stream_{{}};
  ClusterModels models_;

  std::optional<Patch> patch_;
  std::optional<Lattice> lattice_;
  uint32_t slot_ = 0;             // the next one to visit
  uint32_t nodes_ = 0;            // with known holes
  std::vector<Vertex> vertices_;  // of the generation, and more
};

Status ClusterDecoder::DecodeHead(ByteReader head, uint32_t node_limit, size_t payload_bytes) {
  flags_ = head.Get<uint8_t>();
  reference_length_ = head.Get<uint8_t>();
  const uint64_t node_count = head.GetVarint();
  const uint64_t child_count = head.GetVarint();
  if (head.failed() || child_count > head.remaining()) return Corrupted("head: cut short");
  if ((flags_ & kFlagLattice) && !flat()) return Corrupted("head: a lattice, but no height field");
  if (has_fans() && (flat() || !(flags_ & kFlagBoundary))) {
    return Corrupted("head: nodes of several fans where none can be");
  }
  if (flags_ & ~kKnownFlags) return Corrupted("head: unknown flags " + std::to_string(flags_));
  if (reference_length_ > kMaxExponent) {
    return Corrupted("head: reference length " + std::to_string(reference_length_) +
                     ", but the greatest is " + std::to_string(kMaxExponent));
  }
  if (node_count > node_limit) {
    return Corrupted("head: " + std::to_string(node_count) + " nodes, but the index says " +
                     std::to_string(node_limit));
  }
  if (LeastPayloadBytes(node_count, attribute_coder_.row_bytes()) > payload_bytes) {
    return Corrupted("head: nodes beyond the bytes");
  }
  node_count_ = static_cast<uint32_t>(node_count);
  uint64_t child = 0;
  for (uint64_t i = 0; i < child_count; ++i) {
    const uint64_t delta = head.GetVarint();
    if (i > 0 && delta == 0) return Corrupted("head: children not ascending");
    child += delta;
    if (child >= kChildFlag) return Corrupted("head: child beyond any cluster");
    cluster_.children.push_back(static_cast<UnitId>(child));
  }
  if (head.failed() || head.remaining() != 0) return Corrupted("head: wrong length");
  return Status::Ok();
}

// Keeps what is known of node `node`'s vertex before its position.
[[gnu::always_inline]] inline void ClusterDecoder::KnowNode(const Patch::Hole& hole, bool boundary,
                                                            uint32_t node) {
  if (node - nodes_ == vertices_.size()) [[unlikely]] {
    vertices_.resize(2 * vertices_.size() + 64);
  }
  Vertex& v = vertices_[node - nodes_];
  v.frame.Set(*patch_, hole.slot_span(), hole.ring_span(), boundary, flat());
  v.ring_class = static_cast<uint32_t>(PositionModel::RingClass(hole.ring_count, boundary));
  v.deviation = scaled_by_error() ? v.frame.slant() : v.frame.unevenness(*patch_, hole.ring_span());
  v.hole_size = hole.slot_count;
  v.least_code = hole.least_code;
}

// Finds the nodes that are anchored below `generation_end`.
Status ClusterDecoder::DecodeTopology(uint32_t generation_end) {
  RansDecoder<2> coder = topology_;
  Patch& patch = *patch_;
  Cluster& c = cluster_;
  uint32_t slot = slot_;
  uint32_t i = nodes_;
  uint32_t ring_begin = c.ring_begin[i];
  uint32_t hole_begin = c.hole_begin[i];
  Patch::Hole hole{};
  for (; slot < generation_end && i < node_count_; ++slot) {
    if (!models_.topology.CodeAnchor(coder.lane<0>(), patch, slot, false)) continue;
    if (coder.overrun()) return Corrupted("topology: cut short");
    if (patch.remover(slot) != kNone32) return Corrupted("anchor is not alive");
    MakeRoom(c.ring_vertices, ring_begin);
    MakeRoom(c.hole_slots, hole_begin);
    hole.ring = c.ring_vertices.data() + ring_begin;
    hole.slots = c.hole_slots.data() + hole_begin;
    if (!patch.WalkHole(
            slot, i, hole, [&](bool possible, uint32_t count, uint32_t, uint32_t shape) {
              return models_.topology.CodeTakeIf(coder.lane<1>(), possible, count, shape, false);
            })) {
      return Corrupted("hole of node " + std::to_string(i) + " is too large, or no disc");
    }
    uint32_t split = kNone32;
    if (flags_ & kFlagBoundary) {
      // On a copy, so that `coder` itself may stay in registers.
      RansDecoder<2> copy = coder;
      split = CodeSplitEdge(copy.lane<1>(), models_.topology, hole, kNone32);
      coder = copy;
    }
    const bool boundary = split != kNone32;
    if (boundary) {
      if (split >= hole.ring_count) return Corrupted("split edge beyond the ring");
      hole.Rotate(split);
      patch.OpenStar(hole);
    }
    // Here, where the processor waits for bits that are hard to guess, arithmetic costs least.
    KnowNode(hole, boundary, i);
    ring_begin += hole.ring_count;
    hole_begin += hole.slot_count;
    if (flags_ & kFlagFans) [[unlikely]] {
      c.fans[i] = boundary ? 1 : 0;
      patch.NoteCreases(hole, boundary);
      if (boundary && hole.open_edge(hole.ring_count - 1)) {
        RansDecoder<2> copy = coder;
        MTDB_RETURN_IF_ERROR(DecodeOtherFans(copy, slot, i, hole, ring_begin, hole_begin));
        coder = copy;
      }
    }
    c.ring_begin[i + 1] = ring_begin;
    c.hole_begin[i + 1] = hole_begin;
    c.star_begin[i + 1] = patch.slots();
    ++i;
  }
  slot_ = slot;
  nodes_ = i;
  topology_ = coder;
  return Status::Ok();
}

// The holes of a node that begin at the other triangles of the edge which its vertex splits.
Status ClusterDecoder::DecodeOtherFans(RansDecoder<2>& coder, uint32_t anchor, uint32_t node,
                                       const Patch::Hole& first_hole, uint32_t& ring_end,
                                       uint32_t& hole_end) {
  Patch& patch = *patch_;
  Cluster& c = cluster_;
  const uint32_t a = first_hole.ring[first_hole.ring_count - 1];
  const uint32_t b = first_hole.ring[0];
  const std::span<const uint32_t> found = patch.FindCrease(a, b);
  if (patch.crease_search_is_hostile()) return Corrupted("creases that are too hard to find");
  if (found.empty()) return Status::Ok();
  if (found.size() >= kMostFans || found.back() >> 2 >= anchor) {
    return Corrupted("node " + std::to_string(node) + " has too many fans, or newer ones");
  }
  const std::vector<uint32_t> faces(found.begin(), found.end());
  c.fans[node] = static_cast<uint8_t>(1 + faces.size());
  const uint32_t ring_begin = ring_end - first_hole.ring_count;
  uint32_t corners = first_hole.ring_count;
  patch.AllowInNextRing(first_hole);
  uint32_t ring_room[kHoleEntries];
  for (const uint32_t face : faces) {
    MakeRoom(c.ring_vertices, ring_end);
    MakeRoom(c.hole_slots, hole_end);
    Patch::Hole hole{c.hole_slots.data() + hole_end, ring_room};
    if (patch.remover(face >> 2) != kNone32 ||
        !patch.WalkHole(face >> 2, anchor, node, hole,
                        [&](bool possible, uint32_t count, uint32_t, uint32_t shape) {
                          return models_.topology.CodeTakeIf(coder.lane<1>(), possible, count,
                                                             shape, false);
                        })) {
      return Corrupted("hole of node " + std::to_string(node) + " is too large, or no disc");
    }
    c.later_fans.push_back(patch.slots() - hole.ring_count);
    const uint32_t split = hole.EdgeBetween(a, b);
    if (split == kNone32 || !hole.open_edge(split) ||
        (corners += hole.ring_count) > kMostFanCorners) {
      return Corrupted("hole of node " + std::to_string(node) + " beyond its edge");
    }
    hole.Rotate(split);
    patch.OpenStar(hole);
    patch.NoteCreases(hole, true);
    patch.AllowInNextRing(hole);
    for (const uint32_t v : hole.ring_span()) {
      const auto begin = c.ring_vertices.begin() + ring_begin;
      const auto end = c.ring_vertices.begin() + ring_end;
      if (std::find(begin, end, v) == end) c.ring_vertices[ring_end++] = v;
    }
    hole_end += hole.slot_count;
  }
  return Status::Ok();
}

// As DecodeTopology, and where the vertices lie on the lattice.
Status ClusterDecoder::DecodeLattice(uint32_t generation_end) {
  Patch& patch = *patch_;
  Cluster& c = cluster_;
  uint32_t i = nodes_;
  Patch::Hole hole{};
  for (; slot_ < generation_end && i < node_count_; ++slot_) {
    if (patch.remover(slot_) != kNone32)
      return Corrupted("a triangle is visited after its removal");
    if (!CodeLatticeAnchor(topology_.lane<0>(), models_.lattice, patch, *lattice_, slot_, false)) {
      if (lattice_->exhausted()) return Corrupted("lattice: more points than nodes allow");
      continue;
    }
    if (topology_.overrun()) return Corrupted("topology: cut short");
    MakeRoom(c.ring_vertices, c.ring_begin[i]);
    MakeRoom(c.hole_slots, c.hole_begin[i]);
    hole.ring = c.ring_vertices.data() + c.ring_begin[i];
    hole.slots = c.hole_slots.data() + c.hole_begin[i];
    if (!patch.WalkHole(slot_, i, hole, [&](bool possible, uint32_t, uint32_t other, uint32_t) {
          if (!possible) return false;
          const uint32_t inside = lattice_->CountInside(patch, other);
          const bool take =
              models_.lattice.CodeTake(topology_.lane<1>(), inside, lattice_->count(), false);
          lattice_->Keep(take);
          return take;
        })) {
      return Corrupted("hole of node " + std::to_string(i) + " is too large, or no disc");
    }
    lattice_->Exclude(patch, hole, slot_);
    if (lattice_->count() == 0) {
      return Corrupted("no point of the lattice fits node " + std::to_string(i));
    }
    const LatticePoint p =
        lattice_->candidate(models_.lattice.CodeIndex(topology_.lane<1>(), lattice_->count(), 0));
    const uint32_t split = (flags_ & kFlagBoundary) ? lattice_->SplitEdge(hole, p) : kNone32;
    if (split != kNone32) {
      hole.Rotate(split);
      patch.OpenStar(hole);
    }
    lattice_->AddVertex(patch, p);
    KnowNode(hole, split != kNone32, i);
    const LatticePoint at = lattice_->ToGrid(p);
    vertices_[i - nodes_].residual[0] = static_cast<int32_t>(at.x);
    vertices_[i - nodes_].residual[1] = static_cast<int32_t>(at.y);
    c.ring_begin[i + 1] = c.ring_begin[i] + hole.ring_count;
    c.hole_begin[i + 1] = c.hole_begin[i] + hole.slot_count;
    c.star_begin[i + 1] = patch.slots();
    ++i;
  }
  nodes_ = i;
  return Status::Ok();
}

void ClusterDecoder::DecodeVertices(std::span<Vertex> vertices, uint32_t first) {
  RansDecoder<4> coder = vertex_stream_;
  BitReader bits = bits_;
  const bool within = scaled_by_error();
  const bool on_lattice = lattice_.has_value();
  uint8_t code = first == 0 ? 0 : cluster_.error_codes[first - 1];
  uint8_t* codes = cluster_.error_codes.data() + first;
  for (Vertex& v : vertices) {
    if (coder.overrun() || bits.overrun()) break;
    code = on_lattice
               ? models_.errors.CodeOnLattice(coder.lane<0>(), bits, v.least_code, code, 0)
               : models_.errors.Code(coder.lane<0>(), bits, v.hole_size, v.least_code, code, 0);
    *codes++ = code;
    const uint32_t ring_class = v.ring_class;
    if (!on_lattice) {
      v.residual[0] = models_.positions.CodeScaled(coder.lane<1>(), bits, 0, ring_class,
                                                   v.frame.variance_u(), 0);
      v.residual[1] = models_.positions.CodeScaled(coder.lane<2>(), bits, 1, ring_class,
                                                   v.frame.variance_v(), 0);
    }
    if (within) {
      const float limit = kErrorInCells[code] * v.deviation;
      v.residual[2] =
          PositionModel::CodeWithin(coder.lane<3>(), bits,
                                    on_lattice ? models_.positions.HeightOf(code)
                                               : models_.positions.WithinOf(ring_class, limit),
                                    limit, 0);
    } else {
      v.residual[2] =
          models_.positions.CodeScaled(coder.lane<3>(), bits, 2, ring_class, v.deviation, 0);
    }
  }
  vertex_stream_ = coder;
  bits_ = bits;
}

void ClusterDecoder::PlaceVertices(std::span<const Vertex> vertices, uint32_t first) {
  uint32_t i = first;
  for (const Vertex& vertex : vertices) {
    const HoleFrame& f = vertex.frame;
    const bool known = lattice_.has_value();
    const int32_t u = known ? vertex.residual[0] : Sum(f.ExpectU(), vertex.residual[0]);
    const int32_t v = known ? vertex.residual[1] : Sum(f.ExpectV(u), vertex.residual[1]);
    const std::span<const uint32_t> hole = cluster_.hole(i++).first(vertex.hole_size);
    const int32_t n = Sum(f.ExpectN(*patch_, hole, u, v), vertex.residual[2]);
    int32_t p[3];
    p[f.axis_u()] = u;
    p[f.axis_v()] = v;
    p[f.axis_n()] = n;
    cluster_.in.positions.push_back({p[0], p[1], p[2]});
  }
}

void ClusterDecoder::DecodeRow(uint32_t node) {
  Bytes& rows = cluster_.in.rows;
  const size_t at = rows.size();
  rows.resize(at + attribute_coder_.row_bytes());
  const std::span<const Vec3i> positions = cluster_.in.positions;
  const uint32_t vertex = cluster_.external_vertices() + node;
  const std::span<const uint32_t> ring = cluster_.ring(node);
  ring_positions_.clear();
  for (const uint32_t v : ring) ring_positions_.push_back(positions[v]);
  attribute_coder_.Decode(attribute_stream_, {positions[vertex], ring, ring_positions_}, rows,
                          rows.data() + at);
}

Status ClusterDecoder::DecodeGeneration() {
  const uint32_t first = nodes_;
  const uint32_t generation_end = patch_->slots();
  if (slot_ == generation_end) return Corrupted("fewer anchors than nodes");
  MTDB_RETURN_IF_ERROR(lattice_ ? DecodeLattice(generation_end) : DecodeTopology(generation_end));
  // In blocks that stay in the processor's nearest cache.
  constexpr uint32_t kBlock = 64;
  for (uint32_t begin = first; begin < nodes_; begin += kBlock) {
    const uint32_t end = std::min(begin + kBlock, nodes_);
    DecodeVertices(std::span(vertices_).subspan(begin - first, end - begin), begin);
    PlaceVertices(std::span(vertices_).subspan(begin - first, end - begin), begin);
  }
  // Only now, since holes are older than the generation.
  const uint32_t external = cluster_.external_vertices();
  for (uint32_t i = first; i < nodes_; ++i) patch_->AddPoint(cluster_.position(external + i));
  if (attribute_coder_.row_bytes() != 0) {
    for (uint32_t i = first; i < nodes_; ++i) DecodeRow(i);
  }
  if (vertex_stream_.overrun() || bits_.overrun() || attribute_stream_.overrun()) {
    return Corrupted("coded streams cut short");
  }
  if (nodes_ < node_count_) patch_->EndGeneration(cluster_.error_codes);
  return Status::Ok();
}

Status ClusterDecoder::DecodeArcs(const StreamReader& streams) {
  const auto children = static_cast<uint32_t>(cluster_.children.size());
  static_assert(kDrain == kNone32);
  RansDecoder<> arcs(streams.bytes(StreamTag::kArcs));
  if (children > 0) {
    const std::span<uint32_t> removers = patch_->removers();
    const bool listed = models_.arcs.Code(
        arcs.lane(), *patch_, children, [](uint32_t) { return 0u; },
        [&](uint32_t s, uint32_t arc) {
          if (arc != children) removers[s] = kChildFlag | arc;
          return !arcs.overrun();
        });
    if (!listed) return Corrupted("arcs: cut short, or to a child that is not listed");
  }
  if (!arcs.Done()) return Corrupted("arcs: do not end where they should");
  cluster_.removers = patch_->TakeRemovers();
  if (!DecodeExplicitArcs(streams, &cluster_)) return Corrupted("explicit arc out of range");
  return Status::Ok();
}

// A hole is two-sided as a whole or nowhere, and so is the star that takes its place.
void ClusterDecoder::InheritSides() {
  Cluster& c = cluster_;
  std::vector<uint8_t>& two_sided = c.in.two_sided;
  two_sided.resize(c.slots());
  size_t next_fan = 0;
  for (NodeIndex i = 0; i < c.nodes(); ++i) {
    const uint32_t end = c.star_begin[i + 1];
    const uint32_t* hole = c.hole(i).data();
    for (uint32_t begin = c.star_begin[i]; begin < end;) {
      const bool more = next_fan < c.later_fans.size() && c.later_fans[next_fan] < end;
      const uint32_t fan_end = more ? c.later_fans[next_fan++] : end;
      std::fill(two_sided.begin() + begin, two_sided.begin() + fan_end, two_sided[*hole]);
      hole += fan_end - begin - 1;  // the hole of a fan of several has one triangle less
      begin = fan_end;
    }
  }
}

// After which all nodes are known.
Status ClusterDecoder::AddCrumbs(const StreamReader& streams, uint32_t node_limit) {
  Cluster& c = cluster_;
  if (!streams.bytes(StreamTag::kCrumbs).empty()) {
    if (flat()) return Corrupted("a height field with crumbs");
    MTDB_RETURN_IF_ERROR(
        DecodeCrumbs(streams, attribute_coder_.row_bytes(), node_limit, where_, &c));
  }
  if (c.nodes() == 0) return Corrupted("head: no nodes");
  const std::span<const uint32_t> incoming = std::span(c.removers).first(c.in_triangles());
  if (!std::ranges::all_of(incoming, RemovedByNode)) {
    return Corrupted("in-triangle that no node removes");
  }
  return Status::Ok();
}

void ClusterDecoder::Open(const StreamReader& streams) {
  topology_ = RansDecoder<2>(streams.bytes(StreamTag::kTopology));
  vertex_stream_ = RansDecoder<4>(streams.bytes(StreamTag::kVertices));
  const ByteSpan bits = streams.bytes(StreamTag::kBits);
  readable_bits_.assign(bits.begin(), bits.end());
  readable_bits_.resize(bits.size() + BitReader::kReadableBytes);
  bits_ = BitReader(ByteSpan(readable_bits_).first(bits.size()));
  attribute_stream_ = RansDecoder<>(streams.bytes(StreamTag::kAttributes));
}

Result<Cluster> ClusterDecoder::Decode(ByteSpan payload, InPatch in, uint32_t node_limit,
                                       bool corners) {
  MTDB_ASSIGN_OR_RETURN(const StreamReader streams, StreamReader::Open(payload, where_));
  MTDB_RETURN_IF_ERROR(DecodeHead(streams.stream(StreamTag::kHead), node_limit, payload.size()));
  const size_t row = attribute_coder_.row_bytes();
  if (in.rows.size() != in.positions.size() * row) return Corrupted("rows of corners missing");
  if (flat() && !in.two_sided.empty()) return Corrupted("a height field with two-sided triangles");
  Open(streams);
  Cluster& c = cluster_;
  const size_t n = node_count_;
  c.in = std::move(in);
  c.first_own_slot = c.listed();
  c.in.positions.reserve(c.external_vertices() + n);
  c.in.rows.reserve((c.external_vertices() + n) * row);
  c.error_codes.resize(n);
  c.ring_begin.resize(n + 1);
  c.star_begin.resize(n + 1);
  c.hole_begin.resize(n + 1);
  c.star_begin[0] = c.first_own_slot;
  c.ring_vertices.resize(6 * n + kHoleEntries);
  c.hole_slots.resize(4 * n + kHoleEntries);
  std::vector<uint32_t> hidden_seams;
  MTDB_RETURN_IF_ERROR(DecodeSeams(streams, c.listed(), where_, &hidden_seams));
  patch_.emplace(c.in.triangles, c.in.positions, reference_length_, n, flat(), c.in.two_sided,
                 Patch::Seams{c.in.corners, hidden_seams});
  if (has_fans()) {
    c.fans.resize(n);
    patch_->IndexCreases();
  }
  if (flags_ & kFlagLattice) {
    lattice_ = Lattice::Make(*patch_, c.in.positions, n, (flags_ & kFlagBoundary) != 0);
    if (!lattice_ || lattice_->exhausted()) {
      return Corrupted("head: a lattice that is too large for its nodes");
    }
    patch_->LeaveOutShapes();
  }

  while (nodes_ < node_count_) MTDB_RETURN_IF_ERROR(DecodeGeneration());
  c.ring_vertices.resize(c.ring_begin[n]);
  c.hole_slots.resize(c.hole_begin[n]);
  if (!topology_.Done()) return Corrupted("topology: does not end where it should");
  if (!vertex_stream_.Done()) return Corrupted("vertices: do not end where they should");
  if (!bits_.Done()) return Corrupted("bits: do not end where they should");
  if (!attribute_stream_.Done()) return Corrupted("attributes: do not end where they should");
  if (has_fans()) {
    c.created_corners.reserve(patch_->slots() - c.listed());
    for (uint32_t s = c.listed(); s < patch_->slots(); ++s) {
      c.created_corners.push_back(patch_->triangle(s).corners);
    }
  }
  MTDB_RETURN_IF_ERROR(DecodeArcs(streams));
  if (!c.in.two_sided.empty()) InheritSides();
  MTDB_RETURN_IF_ERROR(AddCrumbs(streams, node_limit));
  if (!c.in.corners.empty() && corners) {
    MarkSeams(hidden_seams, c.in);
    MTDB_RETURN_IF_ERROR(DecodeCorners(streams, where_, &c));
  }
  return std::move(cluster_);
}

}  // namespace

Result<Cluster> DecodeCluster(ByteSpan payload, InPatch in, const AttributeLayout& attributes,
                              uint32_t node_limit, const std::string& where) {
  return ClusterDecoder(attributes, where).Decode(payload, std::move(in), node_limit, true);
}

Result<Cluster> internal::DecodeWithoutCorners(ByteSpan payload, InPatch in,
                                               const AttributeLayout& attributes,
                                               uint32_t node_limit) {
  return ClusterDecoder(attributes, "cluster").Decode(payload, std::move(in), node_limit, false);
}

std::vector<StreamSize> ClusterStreamSizes(ByteSpan payload) {
  std::vector<StreamSize> sizes;
  const Result<StreamReader> streams = StreamReader::Open(payload, "payload");
  if (!streams.ok()) return sizes;
  for (const StreamReader::Size& s : streams->sizes()) {
    sizes.push_back({StreamTagName(s.tag), s.raw_bytes, s.coded_bytes});
  }
  return sizes;
}

}  // namespace mtdb
