#include "codecs/cluster/root_codec.h"

#include <algorithm>
#include <string>
#include <vector>

#include "codecs/cluster/internal/streams.h"
#include "codecs/coding/attribute_coder.h"

namespace mtdb {

using namespace internal;

// Vertices come in the order of first use by a triangle, so that
// triangles code well; their global numbers are coded as differences.
Bytes EncodeRootPiece(const Cluster& piece, const AttributeLayout& attributes) {
  StreamWriter streams;
  ByteWriter& head = streams.stream(StreamTag::kHead);
  head.PutVarint(piece.in.positions.size());
  head.PutVarint(piece.in.triangles.size());
  head.PutVarint(piece.children.size());
  uint32_t previous_child = 0;
  for (const UnitId child : piece.children) {
    head.PutVarint(child - previous_child);
    previous_child = child;
  }
  ByteWriter& vertices = streams.stream(StreamTag::kRootVertices);
  Vec3i last{};
  int64_t last_vertex = -1;
  for (size_t i = 0; i < piece.in.positions.size(); ++i) {
    const auto vertex = static_cast<int64_t>(piece.in.vertices[i]);
    vertices.PutSignedVarint(vertex - last_vertex - 1);
    last_vertex = vertex;
    for (int c = 0; c < 3; ++c) {
      vertices.PutVarint(
          ZigZag(static_cast<uint32_t>(piece.in.positions[i][c]) - static_cast<uint32_t>(last[c])));
    }
    last = piece.in.positions[i];
  }
  // A corner is 0 for the next new vertex, else 1 + how many vertices back.
  ByteWriter& triangles = streams.stream(StreamTag::kRootTriangles);
  ByteWriter& arcs = streams.stream(StreamTag::kArcs);
  uint32_t seen = 0;
  for (size_t t = 0; t < piece.in.triangles.size(); ++t) {
    for (const uint32_t v : piece.in.triangles[t]) {
      MTDB_CHECK(v <= seen, "root vertices are not in order of first use");
      triangles.PutVarint(seen - v);
      if (v == seen) ++seen;
    }
    const uint32_t remover = piece.removers[t];
    arcs.PutVarint(remover == kDrain ? 0 : ChildOrdinal(remover) + 1ull);
  }
  MTDB_CHECK(seen == piece.in.positions.size(), "a root vertex without a triangle");
  ByteWriter& explicit_arcs = streams.stream(StreamTag::kExplicitArcs);
  uint32_t last_slot = 0;
  for (const ExplicitArc& arc : piece.explicit_arcs) {
    explicit_arcs.PutVarint(arc.slot - last_slot);
    explicit_arcs.PutVarint(arc.child_slot);
    explicit_arcs.Put<uint8_t>(arc.rotation);
    last_slot = arc.slot;
  }
  const size_t row = attributes.row_bytes();
  if (row != 0) streams.stream(StreamTag::kAttributes).PutBytes(SplitPlanes(piece.in.rows, row));
  return streams.Finish();
}

Result<Cluster> DecodeRootPiece(ByteSpan payload, const AttributeLayout& attributes,
                                uint64_t root_vertices, const std::string& where) {
  const auto corrupt = [&](const std::string& what) { return Corrupt(where + ": " + what); };
  MTDB_ASSIGN_OR_RETURN(const StreamReader streams, StreamReader::Open(payload, where));
  ByteReader head = streams.stream(StreamTag::kHead);
  const uint64_t vertex_count = head.GetVarint();
  const uint64_t triangle_count = head.GetVarint();
  const uint64_t child_count = head.GetVarint();
  ByteReader vertices = streams.stream(StreamTag::kRootVertices);
  ByteReader triangles = streams.stream(StreamTag::kRootTriangles);
  ByteReader arcs = streams.stream(StreamTag::kArcs);
  if (head.failed() || child_count > head.remaining() || vertex_count > vertices.remaining() / 4 ||
      triangle_count > triangles.remaining() / 3 || triangle_count > arcs.remaining()) {
    return corrupt("head: counts beyond the payload");
  }
  Cluster piece;
  uint64_t child = 0;
  for (uint64_t i = 0; i < child_count; ++i) {
    const uint64_t delta = head.GetVarint();
    child += delta;
    if ((i > 0 && delta == 0) || child >= kChildFlag) return corrupt("head: children");
    piece.children.push_back(static_cast<UnitId>(child));
  }
  if (head.failed() || head.remaining() != 0) return corrupt("head: wrong length");
  Vec3i last{};
  int64_t last_vertex = -1;
  for (uint64_t i = 0; i < vertex_count; ++i) {
    const auto delta = static_cast<uint64_t>(vertices.GetSignedVarint());
    last_vertex = static_cast<int64_t>(static_cast<uint64_t>(last_vertex) + 1 + delta);
    if (last_vertex < 0 || static_cast<uint64_t>(last_vertex) >= root_vertices) {
      return corrupt("vertex beyond the root's");
    }
    for (int c = 0; c < 3; ++c) {
      last[c] = static_cast<int32_t>(static_cast<uint32_t>(last[c]) +
                                     UnZigZag(static_cast<uint32_t>(vertices.GetVarint())));
    }
    piece.in.vertices.push_back(static_cast<VertexIndex>(last_vertex));
    piece.in.positions.push_back(last);
  }
  if (vertices.failed() || vertices.remaining() != 0) return corrupt("vertices: wrong length");
  std::vector<VertexIndex> sorted = piece.in.vertices;
  std::sort(sorted.begin(), sorted.end());
  if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) {
    return corrupt("a vertex occurs twice");
  }
  uint64_t seen = 0;
  for (uint64_t t = 0; t < triangle_count; ++t) {
    auto& corners = piece.in.triangles.emplace_back();
    for (uint32_t& v : corners) {
      const uint64_t back = triangles.GetVarint();
      if (back > seen || (back == 0 && seen == vertex_count)) return corrupt("corner out of range");
      v = static_cast<uint32_t>(seen - back);
      if (back == 0) ++seen;
    }
    if (corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0]) {
      return corrupt("triangle " + std::to_string(t) + " has a corner twice");
    }
    const uint64_t arc = arcs.GetVarint();
    if (arc > child_count) return corrupt("arc to a child that is not listed");
    piece.removers.push_back(arc == 0 ? kDrain : kChildFlag | static_cast<uint32_t>(arc - 1));
  }
  if (triangles.failed() || triangles.remaining() != 0 || arcs.failed() || arcs.remaining() != 0 ||
      seen != vertex_count) {
    return corrupt("triangles: wrong length");
  }
  ByteReader explicit_arcs = streams.stream(StreamTag::kExplicitArcs);
  uint64_t slot = 0;
  while (explicit_arcs.remaining() != 0) {
    slot += explicit_arcs.GetVarint();
    const uint64_t child_slot = explicit_arcs.GetVarint();
    const auto rotation = explicit_arcs.Get<uint8_t>();
    if (explicit_arcs.failed() || slot >= triangle_count || child_slot >= kNone32 || rotation > 2 ||
        !RemovedByChild(piece.removers[slot])) {
      return corrupt("explicit arc out of range");
    }
    piece.explicit_arcs.push_back(
        {static_cast<uint32_t>(slot), static_cast<uint32_t>(child_slot), rotation});
  }
  const size_t row = attributes.row_bytes();
  ByteReader rows = streams.stream(StreamTag::kAttributes);
  if (rows.remaining() != vertex_count * row) return corrupt("attributes: wrong length");
  piece.in.rows = JoinPlanes(rows.GetBytes(vertex_count * row), row);
  return piece;
}

}  // namespace mtdb
