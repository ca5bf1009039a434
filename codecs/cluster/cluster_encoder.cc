#include <algorithm>
#include <limits>

#include "codecs/cluster/cluster_codec.h"
#include "codecs/cluster/internal/cluster_payload.h"
#include "codecs/cluster/internal/streams.h"
#include "codecs/coding/attribute_coder.h"
#include "codecs/coding/cluster_model.h"
#include "codecs/coding/hole_frame.h"
#include "codecs/coding/patch.h"
#include "codecs/coding/rans.h"

namespace mtdb {

namespace {

// What is coded about a node's vertex, kept until it is known how to code n.
struct VertexResidual {
  int32_t u, v, n;
  float variance_u, variance_v, variance_n, slant;
  uint32_t ring_class;
  uint32_t hole_size, least_code;
};

int32_t Difference(int32_t value, int32_t expected) {
  return static_cast<int32_t>(static_cast<uint32_t>(value) - static_cast<uint32_t>(expected));
}

VertexResidual MeasureVertex(const Patch& patch, const Patch::Hole& hole, bool boundary, Vec3i p) {
  HoleFrame frame;
  frame.Set(patch, hole.slot_span(), hole.ring_span(), boundary);
  const int32_t u = p[frame.axis_u()];
  const int32_t v = p[frame.axis_v()];
  const int32_t n = p[frame.axis_n()];
  return {Difference(u, frame.ExpectU()),
          Difference(v, frame.ExpectV(u)),
          Difference(n, frame.ExpectN(patch, hole.slot_span(), u, v)),
          frame.variance_u(),
          frame.variance_v(),
          frame.unevenness(patch, hole.ring_span()),
          frame.slant(),
          static_cast<uint32_t>(PositionModel::RingClass(hole.ring_count, boundary)),
          hole.slot_count,
          hole.least_code};
}

// True when the errors bound the heights of nearly all vertices above their holes, in grid cells;
// false when errors and positions have different units (PositionMode::kLossless).
bool ErrorsBoundHeights(const std::vector<VertexResidual>& residuals,
                        const std::vector<uint8_t>& codes) {
  size_t within = 0;
  for (size_t i = 0; i < residuals.size(); ++i) {
    const VertexResidual& r = residuals[i];
    within += std::abs(static_cast<float>(r.n)) <= kErrorInCells[codes[i]] * r.slant + 1;
  }
  return within * 10 >= residuals.size() * 9;
}

// The typical exponent of the squared longest edge of the out-triangles.
int ReferenceLength(const ClusterUpdates& updates, const std::vector<uint32_t>& creator,
                    const std::vector<uint32_t>& remover) {
  uint64_t sum = 0;
  uint64_t count = 0;
  for (size_t t = 0; t < updates.triangles.size(); ++t) {
    if (creator[t] == kNone32 || remover[t] != kNone32) continue;
    const auto& c = updates.triangles[t];
    double longest = 0;
    for (size_t i = 0; i < 3; ++i) {
      longest = std::max(longest, SquaredLength(ToDouble(updates.positions[c[(i + 1) % 3]]) -
                                                ToDouble(updates.positions[c[i]])));
    }
    sum += static_cast<uint64_t>(ExponentOf(static_cast<float>(longest)));
    ++count;
  }
  return count == 0 ? 0 : static_cast<int>((sum + count / 2) / count);
}

}  // namespace

EncodedCluster EncodeCluster(const ClusterUpdates& updates, const AttributeLayout& attributes) {
  ClusterModels models;
  return EncodeCluster(updates, attributes, models, nullptr);
}

EncodedCluster EncodeCluster(const ClusterUpdates& updates, const AttributeLayout& attributes,
                             ClusterModels& models, ModelObserver* observer) {
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

  // In-triangles in canonical order. origin carries the triangle, parent_vertices its corners.
  std::vector<InTriangle> in;
  for (uint32_t t = 0; t < triangle_count; ++t) {
    if (remover[t] == kNone32 || creator[t] != kNone32) continue;
    InTriangle& entry = in.emplace_back();
    for (size_t c = 0; c < 3; ++c) {
      entry.vertices[c] = updates.triangles[t][c];
      entry.positions[c] = updates.positions[updates.triangles[t][c]];
      entry.parent_vertices[c] = updates.triangles[t][c];
    }
    entry.origin = t;
  }
  result.explicit_arcs = !SortCanonically(in);
  for (const InTriangle& t : in) {
    result.in_triangles.push_back(t.origin);
    const auto& corners = updates.triangles[t.origin];
    const auto first = std::find(corners.begin(), corners.end(), t.parent_vertices[0]);
    result.in_rotations.push_back(static_cast<uint8_t>(first - corners.begin()));
  }
  InPatch patch_in = MakeInPatch(in);
  result.external_vertices = static_cast<uint32_t>(patch_in.vertices.size());

  // Vertex numbers of the stored cluster; rows in that numbering.
  AttributeCoder attribute_coder(attributes);
  std::vector<Vec3i> ring_positions;
  const size_t row = attribute_coder.row_bytes();
  std::vector<uint32_t> stored_vertex(updates.positions.size(), kNone32);
  Bytes rows;
  rows.reserve(updates.rows.size());
  std::vector<Vec3i> positions;  // of vertices that have rows
  const auto append_row = [&](uint64_t vertex) {
    const auto begin = updates.rows.begin() + static_cast<std::ptrdiff_t>(vertex * row);
    rows.insert(rows.end(), begin, begin + static_cast<std::ptrdiff_t>(row));
  };
  for (uint32_t v = 0; v < result.external_vertices; ++v) {
    stored_vertex[patch_in.vertices[v]] = v;
    append_row(patch_in.vertices[v]);
    positions.push_back(updates.positions[patch_in.vertices[v]]);
  }

  // Replay, choosing the order of the nodes on the way.
  const int reference_length = ReferenceLength(updates, creator, remover);
  Patch patch(patch_in.triangles, patch_in.positions, reference_length, node_count);
  std::vector<uint32_t> slot_triangle = result.in_triangles;
  std::vector<uint32_t> slot_creator(in.size(), kNone32);
  std::vector<uint32_t> waiting(node_count);  // hole triangles not visited yet
  for (uint32_t i = 0; i < node_count; ++i) waiting[i] = updates.nodes[i].hole_count;

  RansEncoder topology(observer);
  RansEncoder attribute_stream;
  std::vector<VertexResidual> residuals;
  std::vector<uint8_t> codes;
  residuals.reserve(node_count);
  codes.reserve(node_count);
  const bool any_boundary = std::any_of(updates.nodes.begin(), updates.nodes.end(),
                                        [](const auto& node) { return node.boundary; });
  uint32_t hole_slots[kHoleEntries];
  uint32_t ring_vertices[kHoleEntries];
  Patch::Hole hole{hole_slots, ring_vertices};
  uint32_t generation_end = patch.slots();
  for (uint32_t slot = 0; codes.size() < node_count; ++slot) {
    if (slot == generation_end) {
      patch.EndGeneration(codes);
      generation_end = patch.slots();
    }
    MTDB_CHECK(slot < generation_end, "the updates of a cluster form a cycle");
    const uint32_t i = remover[slot_triangle[slot]];
    const bool is_anchor = i != kNone32 && --waiting[i] == 0;
    models.topology.CodeAnchor(topology.lane(0), patch, slot, is_anchor);
    if (!is_anchor) continue;
    const ClusterUpdates::Node& node = updates.nodes[i];
    const auto stored = static_cast<uint32_t>(codes.size());
    const bool walked =
        patch.WalkHole(slot, stored, hole, [&](uint32_t count, uint32_t other, uint32_t shape) {
          const bool take = remover[slot_triangle[other]] == i;
          return models.topology.CodeTake(topology.lane(1), count, shape, take);
        });
    MTDB_CHECK(walked && hole.slot_count == node.hole_count, "a hole is not a disc");

    uint32_t split_edge = kNone32;
    if (node.boundary) {
      // The split edge is the one whose ends are not joined by a star triangle.
      const std::span<const uint32_t> ring = hole.ring_span();
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
      split_edge = static_cast<uint32_t>(split);
    }
    if (any_boundary) CodeSplitEdge(topology.lane(1), models.topology, hole, split_edge);
    if (node.boundary) {
      hole.Rotate(split_edge);
      patch.OpenStar(hole);
    }

    codes.push_back(node.error_code);

    const Vec3i p = updates.positions[node.vertex];
    residuals.push_back(MeasureVertex(patch, hole, node.boundary, p));
    if (row != 0) {
      ring_positions.clear();
      for (const uint32_t v : hole.ring_span()) ring_positions.push_back(positions[v]);
      attribute_coder.Encode(attribute_stream, {p, hole.ring_span(), ring_positions}, rows,
                             updates.rows.data() + node.vertex * row, observer);
      append_row(node.vertex);
      positions.push_back(p);
    }
    const uint32_t vertex = result.external_vertices + stored;
    stored_vertex[node.vertex] = vertex;
    result.node_order.push_back(i);
    patch.AddPoint(p);

    // Which triangle of the builder is which star triangle: by its ring edge.
    for (uint32_t j = 0; j < node.star_count; ++j) {
      const uint32_t a = hole.ring[j];
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
  for (uint32_t slot = 0; slot < patch.slots(); ++slot) {
    if (patch.remover(slot) != kNone32) continue;
    const UnitId child = updates.consumers[slot_triangle[slot]].child;
    if (child != kNone32) result.children.push_back(child);
  }
  std::sort(result.children.begin(), result.children.end());
  result.children.erase(std::unique(result.children.begin(), result.children.end()),
                        result.children.end());
  const auto child_count = static_cast<uint32_t>(result.children.size());
  std::vector<uint32_t> arcs(patch.slots(), child_count);
  StreamWriter streams;
  ByteWriter& explicit_arcs = streams.stream(StreamTag::kExplicitArcs);
  uint32_t last_explicit = 0;
  for (uint32_t slot = 0; slot < patch.slots(); ++slot) {
    if (patch.remover(slot) != kNone32) continue;
    ++result.out_triangles;
    const ClusterUpdates::Consumer& consumer = updates.consumers[slot_triangle[slot]];
    if (consumer.child == kNone32) continue;
    const auto at =
        std::lower_bound(result.children.begin(), result.children.end(), consumer.child);
    arcs[slot] = static_cast<uint32_t>(at - result.children.begin());
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

  RansEncoder arc_stream(observer);
  if (child_count > 0) {
    models.arcs.Code(
        arc_stream, patch, static_cast<uint32_t>(in.size()), child_count,
        [&](uint32_t slot) { return arcs[slot]; }, [](uint32_t, uint32_t) { return true; });
  }

  const bool scaled_by_error = ErrorsBoundHeights(residuals, codes);
  RansEncoder vertices(observer);
  BitWriter bits;
  for (uint32_t i = 0; i < node_count; ++i) {
    const VertexResidual& r = residuals[i];
    models.errors.Code(vertices.lane(0), bits, r.hole_size, r.least_code, i == 0 ? 0 : codes[i - 1],
                       codes[i]);
    models.positions.CodeScaled(vertices.lane(1), bits, 0, r.ring_class, r.variance_u, r.u);
    models.positions.CodeScaled(vertices.lane(2), bits, 1, r.ring_class, r.variance_v, r.v);
    if (scaled_by_error) {
      models.positions.CodeWithin(vertices.lane(3), bits, r.ring_class,
                                  kErrorInCells[codes[i]] * r.slant, r.n);
    } else {
      models.positions.CodeScaled(vertices.lane(3), bits, 2, r.ring_class, r.variance_n, r.n);
    }
  }

  ByteWriter& head = streams.stream(StreamTag::kHead);
  head.Put<uint8_t>(static_cast<uint8_t>((any_boundary ? kFlagBoundary : 0) |
                                         (scaled_by_error ? kFlagScaledByError : 0)));
  head.Put<uint8_t>(static_cast<uint8_t>(reference_length));
  head.PutVarint(node_count);
  head.PutVarint(child_count);
  uint32_t previous = 0;
  for (const UnitId child : result.children) {
    head.PutVarint(child - previous);
    previous = child;
  }
  streams.AddCoded(StreamTag::kTopology, topology.Finish(2));
  streams.AddCoded(StreamTag::kVertices, vertices.Finish(4));
  streams.AddCoded(StreamTag::kBits, bits.Finish());
  streams.AddCoded(StreamTag::kArcs, arc_stream.Finish());
  streams.AddCoded(StreamTag::kAttributes, attribute_stream.Finish());
  result.payload = streams.Finish();
  if (const uint64_t least = LeastPayloadBytes(node_count, attributes.row_bytes());
      result.payload.size() < least) {
    streams.AddCoded(StreamTag::kPadding, Bytes(least - result.payload.size()));
    result.payload = streams.Finish();
  }
  return result;
}

ClusterUpdates UpdatesOf(const Cluster& cluster) {
  ClusterUpdates updates;
  updates.positions = cluster.in.positions;
  updates.rows = cluster.in.rows;
  updates.triangles = cluster.in.triangles;
  for (NodeIndex i = 0; i < cluster.nodes(); ++i) {
    ClusterUpdates::Node node;
    node.vertex = cluster.external_vertices() + i;
    node.boundary = cluster.boundary(i);
    node.error_code = cluster.error_codes[i];
    node.hole_begin = static_cast<uint32_t>(updates.holes.size());
    node.hole_count = static_cast<uint32_t>(cluster.hole(i).size());
    updates.holes.insert(updates.holes.end(), cluster.hole(i).begin(), cluster.hole(i).end());
    node.star_begin = static_cast<uint32_t>(updates.stars.size());
    node.star_count = cluster.star_begin[i + 1] - cluster.star_begin[i];
    for (uint32_t s = cluster.star_begin[i]; s < cluster.star_begin[i + 1]; ++s) {
      updates.stars.push_back(s);
      updates.triangles.push_back(cluster.star_triangle(i, s));
    }
    updates.nodes.push_back(node);
  }
  updates.consumers.resize(cluster.slots());
  for (uint32_t s = 0; s < cluster.slots(); ++s) {
    if (!RemovedByChild(cluster.removers[s])) continue;
    updates.consumers[s].child = cluster.children[ChildOrdinal(cluster.removers[s])];
  }
  for (const ExplicitArc& arc : cluster.explicit_arcs) {
    updates.consumers[arc.slot].explicit_arc = true;
    updates.consumers[arc.slot].child_slot = arc.child_slot;
  }
  return updates;
}

}  // namespace mtdb
