// SPDX-License-Identifier: Apache-2.0
#include "codecs/cluster/root_codec.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "codecs/cluster/internal/explicit_arcs.h"
#include "codecs/cluster/internal/streams.h"
#include "codecs/coding/attribute_coder.h"
#include "store/base/coordinate_limit.h"

namespace mtdb {

using namespace internal;

namespace {

// The corners that each vertex has had, in the order of first use.
using VertexCorners = std::vector<std::vector<TextureCorner>>;

void PutCorners(const InPatch& in, ByteWriter& out) {
  VertexCorners known(in.positions.size());
  std::vector<TextureCorner> fresh;
  ByteWriter numbers;
  for (size_t i = 0; i < in.corners.size(); ++i) {
    std::vector<TextureCorner>& there = known[in.triangles[i / 3][i % 3]];
    const auto at = std::find(there.begin(), there.end(), in.corners[i]);
    numbers.PutVarint(static_cast<uint64_t>(there.end() - at));
    if (at != there.end()) continue;
    there.push_back(in.corners[i]);
    fresh.push_back(in.corners[i]);
  }
  out.PutVarint(fresh.size());
  out.PutBytes(SplitPlanes(std::as_bytes(std::span(fresh)), sizeof(TextureCorner)));
  out.PutBytes(numbers.bytes());
}

}  // namespace

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
  EncodeExplicitArcs(piece.explicit_arcs, streams);
  if (!piece.in.two_sided.empty()) {
    Bytes bits((piece.in.two_sided.size() + 7) / 8);
    for (size_t t = 0; t < piece.in.two_sided.size(); ++t) {
      bits[t / 8] |= static_cast<std::byte>((piece.in.two_sided[t] != 0 ? 1 : 0) << t % 8);
    }
    streams.stream(StreamTag::kTwoSided).PutBytes(bits);
  }
  if (!piece.in.corners.empty()) PutCorners(piece.in, streams.stream(StreamTag::kCorners));
  const size_t row = attributes.row_bytes();
  if (row != 0) streams.stream(StreamTag::kAttributes).PutBytes(SplitPlanes(piece.in.rows, row));
  return streams.Finish();
}

namespace {

// Reads one piece. The counts have been compared with the bytes that they are read from.
class RootPieceDecoder {
 public:
  RootPieceDecoder(const StreamReader& streams, const std::string& where)
      : streams_(streams), where_(where) {}

  Result<Cluster> Decode(const AttributeLayout& attributes, uint64_t root_vertices,
                         std::optional<double> corner_step) {
    MTDB_RETURN_IF_ERROR(DecodeHead());
    MTDB_RETURN_IF_ERROR(DecodeVertices(root_vertices));
    MTDB_RETURN_IF_ERROR(DecodeTriangles());
    MTDB_RETURN_IF_ERROR(DecodeSides());
    if (!DecodeExplicitArcs(streams_, &piece_)) return Corrupted("explicit arc out of range");
    const size_t row = attributes.row_bytes();
    ByteReader rows = streams_.stream(StreamTag::kAttributes);
    if (rows.remaining() != vertex_count_ * row) return Corrupted("attributes: wrong length");
    MTDB_RETURN_IF_ERROR(DecodeCorners(corner_step));
    piece_.in.rows = JoinPlanes(rows.GetBytes(vertex_count_ * row), row);
    return std::move(piece_);
  }

 private:
  Status Corrupted(const std::string& what) const { return Corrupt(where_ + ": " + what); }
  Status DecodeHead();
  Status DecodeVertices(uint64_t root_vertices);
  Status DecodeTriangles();
  Status DecodeSides();
  Status DecodeCorners(std::optional<double> corner_step);

  const StreamReader& streams_;
  const std::string& where_;
  uint64_t vertex_count_ = 0;
  uint64_t triangle_count_ = 0;
  Cluster piece_;
};

Status RootPieceDecoder::DecodeHead() {
  ByteReader head = streams_.stream(StreamTag::kHead);
  vertex_count_ = head.GetVarint();
  triangle_count_ = head.GetVarint();
  const uint64_t child_count = head.GetVarint();
  if (head.failed() || child_count > head.remaining() ||
      vertex_count_ > streams_.bytes(StreamTag::kRootVertices).size() / 4 ||
      triangle_count_ > streams_.bytes(StreamTag::kRootTriangles).size() / 3 ||
      triangle_count_ > streams_.bytes(StreamTag::kArcs).size()) {
    return Corrupted("head: counts beyond the payload");
  }
  uint64_t child = 0;
  for (uint64_t i = 0; i < child_count; ++i) {
    const uint64_t delta = head.GetVarint();
    child += delta;
    if ((i > 0 && delta == 0) || child >= kChildFlag) return Corrupted("head: children");
    piece_.children.push_back(static_cast<UnitId>(child));
  }
  if (head.failed() || head.remaining() != 0) return Corrupted("head: wrong length");
  return Status::Ok();
}

Status RootPieceDecoder::DecodeVertices(uint64_t root_vertices) {
  ByteReader vertices = streams_.stream(StreamTag::kRootVertices);
  Vec3i last{};
  int64_t last_vertex = -1;
  for (uint64_t i = 0; i < vertex_count_; ++i) {
    const auto delta = static_cast<uint64_t>(vertices.GetSignedVarint());
    last_vertex = static_cast<int64_t>(static_cast<uint64_t>(last_vertex) + 1 + delta);
    if (last_vertex < 0 || static_cast<uint64_t>(last_vertex) >= root_vertices) {
      return Corrupted("vertex beyond the root's");
    }
    for (int c = 0; c < 3; ++c) {
      last[c] = static_cast<int32_t>(static_cast<uint32_t>(last[c]) +
                                     UnZigZag(static_cast<uint32_t>(vertices.GetVarint())));
    }
    piece_.in.vertices.push_back(static_cast<VertexIndex>(last_vertex));
    piece_.in.positions.push_back(last);
  }
  if (vertices.failed() || vertices.remaining() != 0) return Corrupted("vertices: wrong length");
  std::vector<VertexIndex> sorted = piece_.in.vertices;
  std::sort(sorted.begin(), sorted.end());
  if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) {
    return Corrupted("a vertex occurs twice");
  }
  return Status::Ok();
}

Status RootPieceDecoder::DecodeSides() {
  const ByteSpan bits = streams_.bytes(StreamTag::kTwoSided);
  if (bits.empty()) return Status::Ok();
  if (bits.size() != (triangle_count_ + 7) / 8) return Corrupted("two-sided: wrong length");
  const auto bit = [&](uint64_t i) { return std::to_integer<uint8_t>(bits[i / 8]) >> i % 8 & 1; };
  for (uint64_t t = 0; t < triangle_count_; ++t) {
    piece_.in.two_sided.push_back(static_cast<uint8_t>(bit(t)));
  }
  for (uint64_t i = triangle_count_; i < 8 * bits.size(); ++i) {
    if (bit(i)) return Corrupted("two-sided: bits of no triangle");
  }
  return Status::Ok();
}

Status RootPieceDecoder::DecodeCorners(std::optional<double> corner_step) {
  ByteReader in = streams_.stream(StreamTag::kCorners);
  if (!corner_step) {
    return in.remaining() == 0 ? Status::Ok() : Corrupted("corners, but no texture");
  }
  constexpr size_t kRow = sizeof(TextureCorner);
  const uint64_t count = in.GetVarint();
  if (in.failed() || count > in.remaining() / kRow) return Corrupted("corners: cut short");
  const Bytes rows = JoinPlanes(in.GetBytes(count * kRow), kRow);
  piece_.in.corner_step = *corner_step;
  VertexCorners known(vertex_count_);
  uint64_t taken = 0;
  for (uint64_t i = 0; i < 3 * triangle_count_; ++i) {
    std::vector<TextureCorner>& there = known[piece_.in.triangles[i / 3][i % 3]];
    const uint64_t back = in.GetVarint();
    if (in.failed() || back > there.size() || (back == 0 && taken == count)) {
      return Corrupted("corners: one that is not there");
    }
    if (back == 0) std::memcpy(&there.emplace_back(), rows.data() + kRow * taken++, kRow);
    const TextureCorner& corner = back == 0 ? there.back() : there[there.size() - back];
    if (!(std::abs(corner.u) <= kMostTextureCoordinate &&
          std::abs(corner.v) <= kMostTextureCoordinate)) {
      return Corrupted("corners: no numbers, or too large ones");
    }
    if (i % 3 != 0 && corner.page != piece_.in.corners.back().page) {
      return Corrupted("corners: a triangle on two pages");
    }
    piece_.in.corners.push_back(corner);
  }
  if (in.remaining() != 0 || taken != count) return Corrupted("corners: wrong length");
  for (uint32_t slot = 0; slot < triangle_count_; ++slot) {
    piece_.in.corner_places.push_back({3 * slot, 3 * slot + 1, 3 * slot + 2});
  }
  return Status::Ok();
}

Status RootPieceDecoder::DecodeTriangles() {
  ByteReader triangles = streams_.stream(StreamTag::kRootTriangles);
  ByteReader arcs = streams_.stream(StreamTag::kArcs);
  uint64_t seen = 0;
  for (uint64_t t = 0; t < triangle_count_; ++t) {
    auto& corners = piece_.in.triangles.emplace_back();
    for (uint32_t& v : corners) {
      const uint64_t back = triangles.GetVarint();
      if (back > seen || (back == 0 && seen == vertex_count_)) {
        return Corrupted("corner out of range");
      }
      v = static_cast<uint32_t>(seen - back);
      if (back == 0) ++seen;
    }
    if (corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0]) {
      return Corrupted("triangle " + std::to_string(t) + " has a corner twice");
    }
    const uint64_t arc = arcs.GetVarint();
    if (arc > piece_.children.size()) return Corrupted("arc to a child that is not listed");
    piece_.removers.push_back(arc == 0 ? kDrain : kChildFlag | static_cast<uint32_t>(arc - 1));
  }
  if (triangles.failed() || triangles.remaining() != 0 || arcs.failed() || arcs.remaining() != 0 ||
      seen != vertex_count_) {
    return Corrupted("triangles: wrong length");
  }
  return Status::Ok();
}

}  // namespace

Result<Cluster> DecodeRootPiece(ByteSpan payload, const AttributeLayout& attributes,
                                uint64_t root_vertices, const std::string& where,
                                std::optional<double> corner_step) {
  MTDB_ASSIGN_OR_RETURN(const StreamReader streams, StreamReader::Open(payload, where));
  return RootPieceDecoder(streams, where).Decode(attributes, root_vertices, corner_step);
}

}  // namespace mtdb
