#include "codecs/cluster_codec.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "codecs/internal/attribute_coder.h"
#include "codecs/internal/cluster_model.h"
#include "codecs/internal/cluster_payload.h"
#include "codecs/internal/hole_frame.h"
#include "codecs/internal/patch.h"
#include "codecs/internal/rans.h"
#include "codecs/internal/streams.h"

namespace mtdb {

namespace {

int32_t Sum(int32_t expected, int32_t residual) {
  return static_cast<int32_t>(static_cast<uint32_t>(expected) + static_cast<uint32_t>(residual));
}

// No node takes less than an eighth of a bit; a bound on the memory that hostile bytes can ask for.
constexpr uint64_t kMaxNodesPerByte = 64;

[[gnu::always_inline]] inline Vec3i DecodeVertex(RansDecoder& coder, PositionModel& model,
                                                 const HoleFrame& frame, size_t ring_class,
                                                 bool scaled_by_error, uint8_t code) {
  Vec3i p;
  const Expectation u = frame.ExpectU();
  p[frame.axis_u()] = Sum(u.value, model.CodeScaled(coder, 0, ring_class, u.variance, 0));
  const Expectation v = frame.ExpectV(p[frame.axis_u()]);
  p[frame.axis_v()] = Sum(v.value, model.CodeScaled(coder, 1, ring_class, v.variance, 0));
  const int32_t n = frame.ExpectN(p[frame.axis_u()], p[frame.axis_v()]);
  const int32_t residual =
      scaled_by_error ? model.CodeWithin(coder, ring_class, kErrorInCells[code] * frame.slant(), 0)
                      : model.CodeScaled(coder, 2, ring_class, frame.unevenness(), 0);
  p[frame.axis_n()] = Sum(n, residual);
  return p;
}

// Appends ranges of at most kMaxRing numbers, by copying whole blocks.
class RangeAppender {
 public:
  RangeAppender(std::vector<uint32_t>& out, size_t expected) : out_(out) {
    out_.resize(expected + kMaxRing);
  }
  // `from` has kMaxRing readable entries. Returns how many were appended in all.
  uint32_t Append(const uint32_t* from, size_t count) {
    if (size_ + kMaxRing > out_.size()) out_.resize(out_.size() + out_.size() / 2 + kMaxRing);
    constexpr size_t kBlock = 12;
    std::memcpy(out_.data() + size_, from, kBlock * sizeof(uint32_t));
    if (count > kBlock) std::memcpy(out_.data() + size_, from, kMaxRing * sizeof(uint32_t));
    size_ += count;
    return static_cast<uint32_t>(size_);
  }
  void Finish() { out_.resize(size_); }

 private:
  std::vector<uint32_t>& out_;
  size_t size_ = 0;
};

}  // namespace

InPatch MakeInPatch(std::span<const InTriangle> triangles) {
  InPatch patch;
  patch.triangles.reserve(triangles.size());
  // Open addressing: vertex -> local number.
  const size_t capacity = std::bit_ceil(6 * triangles.size() + 2);
  std::vector<std::pair<VertexIndex, uint32_t>> table(capacity, {~VertexIndex{0}, 0});
  for (const InTriangle& t : triangles) {
    auto& corners = patch.triangles.emplace_back();
    for (size_t c = 0; c < 3; ++c) {
      size_t i = (t.vertices[c] * 0x9e3779b97f4a7c15ull >> 20) & (capacity - 1);
      while (table[i].first != ~VertexIndex{0} && table[i].first != t.vertices[c]) {
        i = (i + 1) & (capacity - 1);
      }
      if (table[i].first == ~VertexIndex{0}) {
        table[i] = {t.vertices[c], static_cast<uint32_t>(patch.vertices.size())};
        patch.vertices.push_back(t.vertices[c]);
        patch.positions.push_back(t.positions[c]);
      }
      corners[c] = table[i].second;
    }
  }
  return patch;
}

Result<Cluster> DecodeCluster(ByteSpan payload, InPatch in, const AttributeLayout& attributes,
                              uint32_t node_limit, const std::string& where) {
  const auto corrupt = [&](const std::string& what) { return Corrupt(where + ": " + what); };
  MTDB_ASSIGN_OR_RETURN(const StreamReader streams, StreamReader::Open(payload, where));

  ByteReader head = streams.stream(StreamTag::kHead);
  const auto flags = head.Get<uint8_t>();
  const auto reference_length = head.Get<uint8_t>();
  const uint64_t node_count = head.GetVarint();
  const uint64_t child_count = head.GetVarint();
  if (head.failed() || child_count > head.remaining()) return corrupt("head: cut short");
  if (flags & ~kKnownFlags) return corrupt("head: unknown flags " + std::to_string(flags));
  if (node_count == 0 || node_count > node_limit) {
    return corrupt("head: " + std::to_string(node_count) + " nodes, but the index says " +
                   std::to_string(node_limit));
  }
  if (node_count / kMaxNodesPerByte > payload.size())
    return corrupt("head: nodes beyond the bytes");
  Cluster cluster;
  uint64_t child = 0;
  for (uint64_t i = 0; i < child_count; ++i) {
    const uint64_t delta = head.GetVarint();
    if (i > 0 && delta == 0) return corrupt("head: children not ascending");
    child += delta;
    if (child >= kChildFlag) return corrupt("head: child beyond any cluster");
    cluster.children.push_back(ClusterId(static_cast<uint32_t>(child)));
  }
  if (head.failed() || head.remaining() != 0) return corrupt("head: wrong length");

  const auto n = static_cast<uint32_t>(node_count);
  RansDecoder topology(streams.bytes(StreamTag::kTopology));
  RansDecoder errors(streams.bytes(StreamTag::kErrors));
  RansDecoder positions(streams.bytes(StreamTag::kPositions));
  RansDecoder attribute_stream(streams.bytes(StreamTag::kAttributes));
  TopologyModel topology_model(reference_length);
  ErrorModel error_model;
  PositionModel position_model;
  AttributeCoder attribute_coder(attributes);
  const size_t row = attribute_coder.row_bytes();
  if (in.rows.size() != in.positions.size() * row) return corrupt("rows of corners missing");

  cluster.in = std::move(in);
  const uint32_t external = cluster.external_vertices();
  const uint32_t in_count = cluster.in_triangles();
  cluster.in.positions.reserve(external + n);
  cluster.in.rows.reserve((external + n) * row);
  cluster.error_codes.reserve(n);
  cluster.ring_begin.resize(n + 1ull);
  cluster.star_begin.resize(n + 1ull);
  cluster.hole_begin.resize(n + 1ull);
  cluster.star_begin[0] = in_count;
  RangeAppender ring_vertices(cluster.ring_vertices, 6ull * n);
  RangeAppender hole_slots(cluster.hole_slots, 4ull * n);

  Patch patch(cluster.in.triangles, cluster.in.positions, in_count + 6ull * n);
  std::vector<uint32_t> last_ring(external + n, kNone32);  // per vertex: the last node around it
  uint32_t slot = 0;
  for (uint32_t i = 0; i < n; ++slot) {
    if (slot >= patch.slots()) return corrupt("fewer anchors than nodes");
    if (!topology_model.CodeAnchor(topology, patch, slot, false)) continue;
    if (patch.remover(slot) != kNone32) return corrupt("anchor is not alive");
    if (!patch.WalkHole(slot, i, [&](uint32_t count, const Patch::Triangle& t, uint32_t edge) {
          return topology_model.CodeTake(topology, count, t, edge, false);
        })) {
      return corrupt("hole of node " + std::to_string(i) + " is too large");
    }
    uint32_t split = kNone32;
    if (flags & kFlagBoundary) split = CodeSplitEdge(topology, topology_model, patch, kNone32);
    const bool is_boundary = split != kNone32;
    if (is_boundary && split >= patch.ring().size()) return corrupt("split edge beyond the ring");
    if (is_boundary) patch.RotateRing(split);
    const std::span<const uint32_t> ring = patch.ring();
    for (const uint32_t v : ring) {
      if (last_ring[v] == i) return corrupt("hole of node " + std::to_string(i) + " is no disc");
      last_ring[v] = i;
    }
    const PredictedError prediction = PredictError(patch, in_count, cluster.error_codes);
    const uint8_t code =
        error_model.Code(errors, patch.hole().size(), prediction.fallback, prediction.code, 0);
    cluster.error_codes.push_back(code);
    const HoleFrame frame(patch, cluster.in.positions, is_boundary);
    const Vec3i p = DecodeVertex(positions, position_model, frame,
                                 PositionModel::RingClass(ring.size(), is_boundary),
                                 flags & kFlagScaledByError, code);
    cluster.in.positions.push_back(p);
    if (row != 0) {
      cluster.in.rows.resize((external + i + 1ull) * row);
      attribute_coder.Decode(attribute_stream, ring, cluster.in.rows,
                             cluster.in.rows.data() + (external + i) * row);
    }
    patch.InsertStar(external + i, p, frame.ring(), is_boundary, code);
    cluster.ring_begin[i + 1] = ring_vertices.Append(patch.ring_data(), ring.size());
    cluster.hole_begin[i + 1] = hole_slots.Append(patch.hole_data(), patch.hole().size());
    cluster.star_begin[i + 1] = patch.slots();
    ++i;
    if (topology.overrun() || positions.overrun()) return corrupt("coded streams cut short");
  }
  ring_vertices.Finish();
  hole_slots.Finish();
  if (!topology.Done()) return corrupt("topology: does not end where it should");
  if (!errors.Done()) return corrupt("errors: do not end where they should");
  if (!positions.Done()) return corrupt("positions: do not end where they should");
  if (!attribute_stream.Done()) return corrupt("attributes: do not end where they should");

  for (uint32_t s = 0; s < in_count; ++s) {
    if (patch.remover(s) == kNone32) return corrupt("in-triangle that no node removes");
  }
  static_assert(kDrain == kNone32);
  cluster.removers = patch.removers();
  RansDecoder arcs(streams.bytes(StreamTag::kArcs));
  if (child_count > 0) {
    const bool listed = ArcModel().Code(
        arcs, patch, in_count, static_cast<uint32_t>(child_count), [](uint32_t) { return 0u; },
        [&](uint32_t s, uint32_t arc) {
          if (arc != child_count) cluster.removers[s] = kChildFlag | arc;
        });
    if (!listed) return corrupt("arc to a child that is not listed");
  }
  if (!arcs.Done()) return corrupt("arcs: do not end where they should");
  ByteReader explicit_arcs = streams.stream(StreamTag::kExplicitArcs);
  uint64_t explicit_slot = 0;
  while (explicit_arcs.remaining() != 0) {
    explicit_slot += explicit_arcs.GetVarint();
    const uint64_t child_slot = explicit_arcs.GetVarint();
    const auto rotation = explicit_arcs.Get<uint8_t>();
    if (explicit_arcs.failed() || explicit_slot >= cluster.slots() || child_slot >= kNone32 ||
        rotation > 2 || !RemovedByChild(cluster.removers[explicit_slot])) {
      return corrupt("explicit arc out of range");
    }
    cluster.explicit_arcs.push_back(
        {static_cast<uint32_t>(explicit_slot), static_cast<uint32_t>(child_slot), rotation});
  }
  return cluster;
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
