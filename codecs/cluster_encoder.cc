#include <algorithm>
#include <limits>

#include "codecs/cluster_codec.h"
#include "codecs/internal/attribute_coder.h"
#include "codecs/internal/cluster_model.h"
#include "codecs/internal/cluster_payload.h"
#include "codecs/internal/hole_frame.h"
#include "codecs/internal/patch.h"
#include "codecs/internal/rans.h"
#include "codecs/internal/streams.h"

namespace mtdb {

namespace {

// What is coded about a node's vertex, kept until it is known how to code n.
struct VertexResidual {
  int32_t u, v, n;
  float variance_u, variance_v, variance_n, slant;
  uint32_t ring_class;
};

int32_t Difference(int32_t value, int32_t expected) {
  return static_cast<int32_t>(static_cast<uint32_t>(value) - static_cast<uint32_t>(expected));
}

VertexResidual MeasureVertex(const HoleFrame& frame, Vec3i p) {
  const Expectation u = frame.ExpectU();
  const Expectation v = frame.ExpectV(p[frame.axis_u()]);
  const int32_t n = frame.ExpectN(p[frame.axis_u()], p[frame.axis_v()]);
  return {Difference(p[frame.axis_u()], u.value),
          Difference(p[frame.axis_v()], v.value),
          Difference(p[frame.axis_n()], n),
          u.variance,
          v.variance,
          frame.unevenness(),
          frame.slant(),
          0};
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

// The typical exponent of the squared longest edge of the triangles that stay.
int ReferenceLength(const ClusterUpdates& updates, const std::vector<uint32_t>& remover) {
  uint64_t sum = 0;
  uint64_t count = 0;
  for (size_t t = 0; t < updates.triangles.size(); ++t) {
    if (remover[t] != kNone32) continue;
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
  AttributeCoder attribute_coder(attributes);
  const size_t row = attribute_coder.row_bytes();
  std::vector<uint32_t> stored_vertex(updates.positions.size(), kNone32);
  std::vector<Vec3i> positions = patch_in.positions;
  positions.reserve(result.external_vertices + node_count);
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
  Patch patch(patch_in.triangles, positions, triangle_count);
  std::vector<uint32_t> slot_triangle = result.in_triangles;
  std::vector<uint32_t> slot_creator(in.size(), kNone32);
  std::vector<uint32_t> waiting(node_count);  // hole triangles not visited yet
  for (uint32_t i = 0; i < node_count; ++i) waiting[i] = updates.nodes[i].hole_count;

  const int reference_length = ReferenceLength(updates, remover);
  TopologyModel topology_model(reference_length);
  RansEncoder topology;
  RansEncoder attribute_stream;
  ErrorModel error_model;
  RansEncoder errors;
  std::vector<VertexResidual> residuals;
  std::vector<uint8_t> codes;
  residuals.reserve(node_count);
  codes.reserve(node_count);
  const bool any_boundary = std::any_of(updates.nodes.begin(), updates.nodes.end(),
                                        [](const auto& node) { return node.boundary; });
  for (uint32_t slot = 0; codes.size() < node_count; ++slot) {
    MTDB_CHECK(slot < patch.slots(), "the updates of a cluster form a cycle");
    const uint32_t i = remover[slot_triangle[slot]];
    const bool is_anchor = i != kNone32 && --waiting[i] == 0;
    topology_model.CodeAnchor(topology, patch, slot, is_anchor);
    if (!is_anchor) continue;
    const ClusterUpdates::Node& node = updates.nodes[i];
    const auto stored = static_cast<uint32_t>(codes.size());
    const bool walked = patch.WalkHole(
        slot, stored, [&](uint32_t count, const Patch::Triangle& t, uint32_t i_edge) {
          const bool take = remover[slot_triangle[t.opposite[i_edge] >> 2]] == i;
          return topology_model.CodeTake(topology, count, t, i_edge, take);
        });
    MTDB_CHECK(walked && patch.hole().size() == node.hole_count, "a hole is not a disc");

    uint32_t split_edge = kNone32;
    if (node.boundary) {
      // The split edge is the one whose ends are not joined by a star triangle.
      const std::span<const uint32_t> ring = patch.ring();
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
    if (any_boundary) CodeSplitEdge(topology, topology_model, patch, split_edge);
    if (node.boundary) patch.RotateRing(split_edge);

    const PredictedError prediction = PredictError(patch, static_cast<uint32_t>(in.size()), codes);
    error_model.Code(errors, patch.hole().size(), prediction.fallback, prediction.code,
                     node.error_code);
    codes.push_back(node.error_code);

    const Vec3i p = updates.positions[node.vertex];
    const HoleFrame frame(patch, positions, node.boundary);
    residuals.push_back(MeasureVertex(frame, p));
    residuals.back().ring_class =
        static_cast<uint32_t>(PositionModel::RingClass(patch.ring().size(), node.boundary));
    if (row != 0) {
      attribute_coder.Encode(attribute_stream, patch.ring(), rows,
                             updates.rows.data() + node.vertex * row);
      append_row(node.vertex);
    }
    const uint32_t vertex = result.external_vertices + stored;
    positions.push_back(p);
    stored_vertex[node.vertex] = vertex;
    result.node_order.push_back(i);

    // Which triangle of the builder is which star triangle: by its ring edge.
    patch.InsertStar(vertex, p, frame.ring(), node.boundary, node.error_code);
    const std::span<const uint32_t> ring = patch.ring();
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
  for (uint32_t slot = 0; slot < patch.slots(); ++slot) {
    if (patch.remover(slot) != kNone32) continue;
    const ClusterId child = updates.consumers[slot_triangle[slot]].child;
    if (child.value != kNone32) result.children.push_back(child);
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
    if (consumer.child.value == kNone32) continue;
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

  RansEncoder arc_stream;
  if (child_count > 0) {
    ArcModel().Code(
        arc_stream, patch, static_cast<uint32_t>(in.size()), child_count,
        [&](uint32_t slot) { return arcs[slot]; }, [](uint32_t, uint32_t) {});
  }

  const bool scaled_by_error = ErrorsBoundHeights(residuals, codes);
  PositionModel position_model;
  RansEncoder position_stream;
  for (uint32_t i = 0; i < node_count; ++i) {
    const VertexResidual& r = residuals[i];
    position_model.CodeScaled(position_stream, 0, r.ring_class, r.variance_u, r.u);
    position_model.CodeScaled(position_stream, 1, r.ring_class, r.variance_v, r.v);
    if (scaled_by_error) {
      position_model.CodeWithin(position_stream, r.ring_class, kErrorInCells[codes[i]] * r.slant,
                                r.n);
    } else {
      position_model.CodeScaled(position_stream, 2, r.ring_class, r.variance_n, r.n);
    }
  }

  ByteWriter& head = streams.stream(StreamTag::kHead);
  head.Put<uint8_t>(static_cast<uint8_t>((any_boundary ? kFlagBoundary : 0) |
                                         (scaled_by_error ? kFlagScaledByError : 0)));
  head.Put<uint8_t>(static_cast<uint8_t>(reference_length));
  head.PutVarint(node_count);
  head.PutVarint(child_count);
  uint32_t previous = 0;
  for (const ClusterId child : result.children) {
    head.PutVarint(child.value - previous);
    previous = child.value;
  }
  streams.AddCoded(StreamTag::kTopology, topology.Finish());
  streams.AddCoded(StreamTag::kErrors, errors.Finish());
  streams.AddCoded(StreamTag::kPositions, position_stream.Finish());
  streams.AddCoded(StreamTag::kArcs, arc_stream.Finish());
  streams.AddCoded(StreamTag::kAttributes, attribute_stream.Finish());
  result.payload = streams.Finish();
  return result;
}

}  // namespace mtdb
