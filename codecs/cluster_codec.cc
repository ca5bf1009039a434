#include "codecs/cluster_codec.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <unordered_map>

#include "codecs/internal/patch.h"
#include "codecs/internal/predictor.h"
#include "codecs/internal/streams.h"

namespace mtdb {

namespace {

constexpr uint8_t kFlagBoundary = 1;  // some node is a boundary node
constexpr uint8_t kKnownFlags = kFlagBoundary;

// A hole's code: one bit per neighbour that could belong to it, in the order of Patch::WalkHole,
// low bits first, padded with zeros to whole bytes.
class BitWriter {
 public:
  void Put(bool bit) { bits_ |= static_cast<uint64_t>(bit) << count_++; }
  void FlushTo(ByteWriter& out) {
    for (int i = 0; i < count_; i += 8) out.Put<uint8_t>(static_cast<uint8_t>(bits_ >> i));
    bits_ = 0;
    count_ = 0;
  }

 private:
  uint64_t bits_ = 0;  // a ring of at most kMaxRing vertices has at most 2 * kMaxRing - 3 bits
  int count_ = 0;
};
static_assert(2 * kMaxRing - 3 <= 64);

class BitReader {
 public:
  explicit BitReader(ByteReader& in) : in_(in) {}
  bool Get() {
    if (count_ == 0) {
      bits_ = in_.Get<uint8_t>();
      count_ = 8;
    }
    const bool bit = bits_ & 1;
    bits_ >>= 1;
    --count_;
    return bit;
  }

 private:
  ByteReader& in_;
  uint32_t bits_ = 0;
  int count_ = 0;
};

struct Residual {
  uint32_t x, y, z;
};

void PutResiduals(const std::vector<Residual>& residuals, StreamWriter& streams) {
  ByteWriter& low = streams.stream(StreamTag::kResidualLow);
  ByteWriter& mid = streams.stream(StreamTag::kResidualMid);
  ByteWriter& high = streams.stream(StreamTag::kResidualHigh);
  bool any_high = false;
  for (const uint32_t Residual::*c : {&Residual::x, &Residual::y, &Residual::z}) {
    for (const Residual& r : residuals) {
      low.Put<uint8_t>(static_cast<uint8_t>(r.*c));
      mid.Put<uint8_t>(static_cast<uint8_t>(r.*c >> 8));
      any_high |= (r.*c >> 16) != 0;
    }
  }
  if (!any_high) return;
  for (const uint32_t Residual::*c : {&Residual::x, &Residual::y, &Residual::z})
    for (const Residual& r : residuals) high.Put<uint16_t>(static_cast<uint16_t>(r.*c >> 16));
}

// The three residual streams of `nodes` nodes; random access by node.
class ResidualReader {
 public:
  ResidualReader(const StreamReader& streams, uint32_t nodes) : nodes_(nodes) {
    ByteReader low = streams.stream(StreamTag::kResidualLow);
    ByteReader mid = streams.stream(StreamTag::kResidualMid);
    ByteReader high = streams.stream(StreamTag::kResidualHigh);
    const uint64_t n = 3ull * nodes;
    low_ = low.GetBytes(n);
    mid_ = mid.GetBytes(n);
    if (high.remaining() != 0) high_ = high.GetBytes(2 * n);
    ok_ = !low.failed() && !mid.failed() && !high.failed() && low.remaining() == 0 &&
          mid.remaining() == 0 && high.remaining() == 0;
  }
  bool ok() const { return ok_; }
  uint32_t Get(uint32_t node, uint32_t component) const {
    const size_t i = static_cast<size_t>(component) * nodes_ + node;
    uint32_t v = static_cast<uint32_t>(low_[i]) | (static_cast<uint32_t>(mid_[i]) << 8);
    if (!high_.empty()) {
      v |= static_cast<uint32_t>(high_[2 * i]) << 16 | static_cast<uint32_t>(high_[2 * i + 1])
                                                           << 24;
    }
    return v;
  }

 private:
  ByteSpan low_, mid_, high_;
  uint32_t nodes_;
  bool ok_ = false;
};

// The smallest error code among the nodes of this cluster that created the hole's triangles, or
// `fallback` when all came from elsewhere.
uint8_t PredictError(const std::vector<uint32_t>& hole, const std::vector<uint32_t>& creators,
                     const std::vector<uint8_t>& codes, uint8_t fallback) {
  int best = 256;
  for (const uint32_t slot : hole) {
    if (creators[slot] != kNone32) best = std::min<int>(best, codes[creators[slot]]);
  }
  return best == 256 ? fallback : static_cast<uint8_t>(best);
}

uint32_t SubtractWords(int32_t a, int32_t b) {
  return ZigZag(static_cast<uint32_t>(a) - static_cast<uint32_t>(b));
}
int32_t AddWords(int32_t prediction, uint32_t residual) {
  return static_cast<int32_t>(static_cast<uint32_t>(prediction) + UnZigZag(residual));
}

}  // namespace

EncodedCluster EncodeCluster(const ClusterUpdates& updates, const AttributeLayout& attributes) {
  const auto node_count = static_cast<uint32_t>(updates.nodes.size());
  const size_t triangle_count = updates.triangles.size();
  MTDB_CHECK(node_count > 0, "a cluster needs nodes");
  EncodedCluster result;

  // Who removes and who creates each triangle.
  std::vector<uint32_t> remover(triangle_count, kNone32);
  std::vector<uint32_t> creator(triangle_count, kNone32);
  for (uint32_t i = 0; i < node_count; ++i) {
    const ClusterUpdates::Node& node = updates.nodes[i];
    for (uint32_t j = 0; j < node.hole_count; ++j) remover[updates.holes[node.hole_begin + j]] = i;
    for (uint32_t j = 0; j < node.star_count; ++j) creator[updates.stars[node.star_begin + j]] = i;
  }

  // In-triangles in canonical order. parent_slot carries the triangle, parent_vertices its corners.
  std::vector<InTriangle> in;
  for (uint32_t t = 0; t < triangle_count; ++t) {
    if (remover[t] == kNone32 || creator[t] != kNone32) continue;
    InTriangle& entry = in.emplace_back();
    for (size_t c = 0; c < 3; ++c) {
      entry.vertices[c] = updates.triangles[t][c];
      entry.positions[c] = updates.positions[updates.triangles[t][c]];
      entry.parent_vertices[c] = updates.triangles[t][c];
    }
    entry.parent_slot = t;
  }
  result.explicit_arcs = !SortCanonically(in);
  for (const InTriangle& t : in) {
    result.in_triangles.push_back(t.parent_slot);
    const auto& corners = updates.triangles[t.parent_slot];
    const auto first = std::find(corners.begin(), corners.end(), t.parent_vertices[0]);
    result.in_rotations.push_back(static_cast<uint8_t>(first - corners.begin()));
  }
  InPatch patch_in = MakeInPatch(in);
  result.external_vertices = static_cast<uint32_t>(patch_in.vertices.size());

  // Vertex numbers of the stored cluster; rows and positions in that numbering.
  const AttributePredictor predictor(attributes);
  const size_t row = predictor.row_bytes();
  std::vector<uint32_t> stored_vertex(updates.positions.size(), kNone32);
  std::vector<Vec3i> positions = patch_in.positions;
  Bytes rows;
  const auto append_row = [&](uint64_t vertex) {
    const auto begin = updates.rows.begin() + static_cast<std::ptrdiff_t>(vertex * row);
    rows.insert(rows.end(), begin, begin + static_cast<std::ptrdiff_t>(row));
  };
  for (uint32_t v = 0; v < result.external_vertices; ++v) {
    stored_vertex[patch_in.vertices[v]] = v;
    append_row(patch_in.vertices[v]);
  }

  // Replay, choosing the order of the nodes on the way.
  Patch patch(patch_in.triangles, triangle_count);
  std::vector<uint32_t> slot_triangle = result.in_triangles;
  std::vector<uint32_t> slot_creator(in.size(), kNone32);
  std::vector<uint32_t> waiting(node_count);  // hole triangles not visited yet
  for (uint32_t i = 0; i < node_count; ++i) waiting[i] = updates.nodes[i].hole_count;

  StreamWriter streams;
  ByteWriter& anchors = streams.stream(StreamTag::kAnchors);
  ByteWriter& holes = streams.stream(StreamTag::kHoles);
  ByteWriter& errors = streams.stream(StreamTag::kErrors);
  ByteWriter& boundary = streams.stream(StreamTag::kBoundary);
  std::vector<Residual> residuals;
  std::vector<uint8_t> codes;
  Bytes attribute_residuals;
  bool any_boundary = false;
  uint64_t gap = 0;
  BitWriter bits;
  for (uint32_t slot = 0; slot < patch.slots(); ++slot) {
    const uint32_t i = remover[slot_triangle[slot]];
    if (i == kNone32 || --waiting[i] != 0) {
      ++gap;
      continue;
    }
    const ClusterUpdates::Node& node = updates.nodes[i];
    const auto stored = static_cast<uint32_t>(codes.size());
    anchors.PutVarint(gap);
    gap = 0;
    const bool walked = patch.WalkHole(slot, stored, kMaxRing, [&](uint32_t neighbour) {
      const bool take = remover[slot_triangle[neighbour]] == i;
      bits.Put(take);
      return take;
    });
    MTDB_CHECK(walked && patch.hole().size() == node.hole_count, "a hole is not a disc");
    bits.FlushTo(holes);

    if (node.boundary) {
      // The split edge is the one whose ends are not joined by a star triangle.
      any_boundary = true;
      const std::vector<uint32_t>& ring = patch.ring();
      size_t split = ring.size();
      for (size_t j = 0; j < ring.size(); ++j) {
        const uint32_t a = ring[j];
        const uint32_t b = ring[j + 1 == ring.size() ? 0 : j + 1];
        bool found = false;
        for (uint32_t s = 0; s < node.star_count && !found; ++s) {
          const auto& t = updates.triangles[updates.stars[node.star_begin + s]];
          for (size_t c = 0; c < 3; ++c) {
            found |= stored_vertex[t[c]] == a && stored_vertex[t[(c + 1) % 3]] == b;
          }
        }
        if (!found) {
          MTDB_CHECK(split == ring.size(), "a boundary node splits one edge");
          split = j;
        }
      }
      MTDB_CHECK(split < ring.size(), "a boundary node splits an edge");
      boundary.PutVarint(split + 1);
      patch.RotateRing(split);
    } else {
      boundary.PutVarint(0);
    }

    const uint8_t fallback = codes.empty() ? 0 : codes.back();
    errors.Put<uint8_t>(static_cast<uint8_t>(
        node.error_code - PredictError(patch.hole(), slot_creator, codes, fallback)));
    codes.push_back(node.error_code);

    const Vec3i p = updates.positions[node.vertex];
    const Vec3i q = PredictPosition(patch.ring(), positions);
    residuals.push_back(
        {SubtractWords(p.x, q.x), SubtractWords(p.y, q.y), SubtractWords(p.z, q.z)});
    if (row != 0) {
      attribute_residuals.resize((stored + 1) * row);
      predictor.Encode(patch.ring(), rows, updates.rows.data() + node.vertex * row,
                       attribute_residuals.data() + stored * row);
      append_row(node.vertex);
    }
    const uint32_t vertex = result.external_vertices + stored;
    positions.push_back(p);
    stored_vertex[node.vertex] = vertex;
    result.node_order.push_back(i);

    // Which triangle of the builder is which star triangle: by its ring edge.
    patch.InsertStar(vertex, node.boundary);
    const std::vector<uint32_t>& ring = patch.ring();
    for (uint32_t j = 0; j < node.star_count; ++j) {
      const uint32_t a = ring[j];
      uint32_t match = kNone32;
      for (uint32_t s = 0; s < node.star_count; ++s) {
        const uint32_t t = updates.stars[node.star_begin + s];
        for (size_t c = 0; c < 3; ++c) {
          if (updates.triangles[t][c] == node.vertex &&
              stored_vertex[updates.triangles[t][(c + 1) % 3]] == a) {
            match = t;
          }
        }
      }
      MTDB_CHECK(match != kNone32, "the star does not fit its hole");
      slot_triangle.push_back(match);
      slot_creator.push_back(stored);
    }
  }
  MTDB_CHECK(codes.size() == node_count, "the updates of a cluster form a cycle");
  if (!any_boundary) boundary.bytes().clear();

  // Arcs: for each out-triangle, in slot order, 0 for the drain or the child's ordinal + 1.
  for (uint32_t slot = 0; slot < patch.slots(); ++slot) {
    if (patch.remover(slot) != kNone32) continue;
    const ClusterId child = updates.consumers[slot_triangle[slot]].child;
    if (child.value != kNone32) result.children.push_back(child);
  }
  std::sort(result.children.begin(), result.children.end());
  result.children.erase(std::unique(result.children.begin(), result.children.end()),
                        result.children.end());
  ByteWriter& arcs = streams.stream(StreamTag::kArcs);
  ByteWriter& explicit_arcs = streams.stream(StreamTag::kExplicitArcs);
  uint32_t last_explicit = 0;
  for (uint32_t slot = 0; slot < patch.slots(); ++slot) {
    if (patch.remover(slot) != kNone32) continue;
    ++result.out_triangles;
    const ClusterUpdates::Consumer& consumer = updates.consumers[slot_triangle[slot]];
    if (consumer.child.value == kNone32) {
      arcs.PutVarint(0);
      continue;
    }
    const auto at =
        std::lower_bound(result.children.begin(), result.children.end(), consumer.child);
    arcs.PutVarint(static_cast<uint64_t>(at - result.children.begin()) + 1);
    if (!consumer.explicit_arc) continue;
    // The builder's corner 0 is the child's first corner; find it among the star triangle's.
    const auto& t = updates.triangles[slot_triangle[slot]];
    const uint32_t vertex = updates.nodes[result.node_order[slot_creator[slot]]].vertex;
    const auto apex = std::find(t.begin(), t.end(), vertex) - t.begin();
    explicit_arcs.PutVarint(slot - last_explicit);
    explicit_arcs.PutVarint(consumer.child_slot);
    explicit_arcs.Put<uint8_t>(static_cast<uint8_t>((3 - apex) % 3));
    last_explicit = slot;
  }

  ByteWriter& head = streams.stream(StreamTag::kHead);
  head.Put<uint8_t>(any_boundary ? kFlagBoundary : 0);
  head.PutVarint(node_count);
  head.PutVarint(result.children.size());
  uint32_t previous = 0;
  for (const ClusterId child : result.children) {
    head.PutVarint(child.value - previous);
    previous = child.value;
  }
  PutResiduals(residuals, streams);
  if (row != 0) {
    streams.stream(StreamTag::kAttributes).PutBytes(SplitPlanes(attribute_residuals, row));
  }
  result.payload = streams.Finish();
  return result;
}

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
  const uint64_t node_count = head.GetVarint();
  const uint64_t child_count = head.GetVarint();
  if (head.failed() || child_count > head.remaining()) return corrupt("head: cut short");
  if (flags & ~kKnownFlags) return corrupt("head: unknown flags " + std::to_string(flags));
  if (node_count == 0 || node_count > node_limit) {
    return corrupt("head: " + std::to_string(node_count) + " nodes, but the index says " +
                   std::to_string(node_limit));
  }
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
  ByteReader anchors = streams.stream(StreamTag::kAnchors);
  ByteReader holes = streams.stream(StreamTag::kHoles);
  ByteReader errors = streams.stream(StreamTag::kErrors);
  ByteReader boundary = streams.stream(StreamTag::kBoundary);
  const ResidualReader residuals(streams, n);
  if (!residuals.ok()) return corrupt("residuals: wrong length");
  if (errors.remaining() != n) return corrupt("errors: wrong length");
  const AttributePredictor predictor(attributes);
  const size_t row = predictor.row_bytes();
  ByteReader attribute_stream = streams.stream(StreamTag::kAttributes);
  if (attribute_stream.remaining() != n * row) return corrupt("attributes: wrong length");
  const Bytes attribute_residuals = JoinPlanes(attribute_stream.GetBytes(n * row), row);
  if (in.rows.size() != in.positions.size() * row) return corrupt("rows of corners missing");

  cluster.in = std::move(in);
  const uint32_t external = cluster.external_vertices();
  const uint32_t in_count = cluster.in_triangles();
  cluster.in.positions.reserve(external + n);
  cluster.in.rows.reserve((external + n) * row);
  cluster.error_codes.reserve(n);
  for (auto* begins : {&cluster.ring_begin, &cluster.star_begin, &cluster.hole_begin}) {
    begins->reserve(n + 1);
  }
  cluster.ring_vertices.reserve(6ull * n);
  cluster.hole_slots.reserve(4ull * n);
  cluster.ring_begin.push_back(0);
  cluster.star_begin.push_back(in_count);
  cluster.hole_begin.push_back(0);

  Patch patch(cluster.in.triangles, in_count + 6ull * n);
  std::vector<uint32_t> slot_creator(in_count, kNone32);
  slot_creator.reserve(in_count + 6ull * n);
  uint64_t next_anchor = 0;
  for (uint32_t i = 0; i < n; ++i) {
    next_anchor += anchors.GetVarint();
    if (anchors.failed() || next_anchor >= patch.slots()) return corrupt("anchor beyond the patch");
    const auto anchor = static_cast<uint32_t>(next_anchor++);
    if (patch.remover(anchor) != kNone32) return corrupt("anchor is not alive");
    BitReader bits(holes);
    if (!patch.WalkHole(anchor, i, kMaxRing, [&](uint32_t) { return bits.Get(); }) ||
        holes.failed()) {
      return corrupt("hole of node " + std::to_string(i) + " too large or cut short");
    }
    bool is_boundary = false;
    if (flags & kFlagBoundary) {
      const uint64_t split = boundary.GetVarint();
      if (split > patch.ring().size() || boundary.failed()) return corrupt("split edge");
      is_boundary = split != 0;
      if (is_boundary) patch.RotateRing(split - 1);
    }
    const std::vector<uint32_t>& ring = patch.ring();
    const uint8_t fallback = i == 0 ? 0 : cluster.error_codes.back();
    cluster.error_codes.push_back(
        static_cast<uint8_t>(errors.Get<uint8_t>() + PredictError(patch.hole(), slot_creator,
                                                                  cluster.error_codes, fallback)));
    const Vec3i q = PredictPosition(ring, cluster.in.positions);
    cluster.in.positions.push_back({AddWords(q.x, residuals.Get(i, 0)),
                                    AddWords(q.y, residuals.Get(i, 1)),
                                    AddWords(q.z, residuals.Get(i, 2))});
    if (row != 0) {
      cluster.in.rows.resize((external + i + 1ull) * row);
      predictor.Decode(ring, cluster.in.rows, attribute_residuals.data() + i * row,
                       cluster.in.rows.data() + (external + i) * row);
    }
    patch.InsertStar(external + i, is_boundary);
    slot_creator.resize(patch.slots(), i);
    cluster.ring_vertices.insert(cluster.ring_vertices.end(), ring.begin(), ring.end());
    cluster.hole_slots.insert(cluster.hole_slots.end(), patch.hole().begin(), patch.hole().end());
    cluster.ring_begin.push_back(static_cast<uint32_t>(cluster.ring_vertices.size()));
    cluster.hole_begin.push_back(static_cast<uint32_t>(cluster.hole_slots.size()));
    cluster.star_begin.push_back(patch.slots());
  }
  if (anchors.remaining() != 0 || holes.remaining() != 0 || boundary.remaining() != 0) {
    return corrupt("bytes left over after the last node");
  }

  cluster.removers = std::move(patch.removers());
  ByteReader arcs = streams.stream(StreamTag::kArcs);
  for (uint32_t slot = 0; slot < cluster.slots(); ++slot) {
    if (cluster.removers[slot] != kNone32) continue;
    if (slot < in_count) return corrupt("in-triangle that no node removes");
    const uint64_t arc = arcs.GetVarint();
    if (arc > child_count) return corrupt("arc to a child that is not listed");
    cluster.removers[slot] = arc == 0 ? kDrain : kChildFlag | static_cast<uint32_t>(arc - 1);
  }
  if (arcs.failed() || arcs.remaining() != 0) return corrupt("arcs: wrong length");
  ByteReader explicit_arcs = streams.stream(StreamTag::kExplicitArcs);
  uint64_t slot = 0;
  while (explicit_arcs.remaining() != 0) {
    slot += explicit_arcs.GetVarint();
    const uint64_t child_slot = explicit_arcs.GetVarint();
    const auto rotation = explicit_arcs.Get<uint8_t>();
    if (explicit_arcs.failed() || slot >= cluster.slots() || child_slot >= kNone32 ||
        rotation > 2 || !RemovedByChild(cluster.removers[slot])) {
      return corrupt("explicit arc out of range");
    }
    cluster.explicit_arcs.push_back(
        {static_cast<uint32_t>(slot), static_cast<uint32_t>(child_slot), rotation});
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
