// SPDX-License-Identifier: Apache-2.0
#include "builder/write/root_writer.h"

#include <algorithm>
#include <cstring>

#include "codecs/cluster/root_codec.h"
#include "store/base/hash.h"

namespace mtdb::internal {

uint32_t RootNumbers::Add(uint32_t vertex) {
  if (size_ >= Room()) {
    constexpr size_t kFirst = 1024;
    table_.Resize(std::max(kFirst, 2 * table_.size()),
                  [](const Slot& slot) { return Mix64(slot.vertex); });
  }
  Slot& slot = table_.Find(Mix64(vertex), [&](const Slot& s) { return s.vertex == vertex; });
  if (slot.empty()) slot = {vertex, size_++};
  return slot.number;
}

uint64_t RootWriter::memory_bytes() const {
  const uint64_t more = 3 * PieceTriangles(row_bytes());
  return numbers_.bytes_with(more) + edges_.capacity() * sizeof(edges_[0]) +
         on_border_.capacity() / 8 + joined_.bytes_with(more);
}

// Of a triangle.
void RootWriter::AddCorners(const Bytes& rows, size_t triangle,
                            std::vector<TextureCorner>& corners) const {
  for (size_t c = 0; c < 3; ++c) {
    std::memcpy(&corners.emplace_back(),
                rows.data() + (3 * triangle + c + 1) * row_bytes() - sizeof(TextureCorner),
                sizeof(TextureCorner));
  }
}

Status RootWriter::AddPiece(const std::vector<TileTriangle>& triangles, const Bytes& rows) {
  const size_t row = attributes_.row_bytes();
  Cluster piece;
  UnitEntry entry;
  entry.round = kRootRound;
  for (const TileTriangle& t : triangles) {
    if (t.child != kNone32) piece.children.push_back(t.child);
  }
  std::sort(piece.children.begin(), piece.children.end());
  piece.children.erase(std::unique(piece.children.begin(), piece.children.end()),
                       piece.children.end());
  std::unordered_map<uint32_t, uint32_t> local;
  uint32_t sides = 0;  // triangles, their opposites counted
  for (size_t i = 0; i < triangles.size(); ++i) {
    const TileTriangle& t = triangles[i];
    auto& corners = piece.in.triangles.emplace_back();
    std::array<uint32_t, 3> root;
    for (size_t c = 0; c < 3; ++c) {
      root[c] = numbers_.Add(t.seat(c));
      if (root[c] == joined_.size()) joined_.Add();
      const auto [it, inserted] =
          local.try_emplace(t.seat(c), static_cast<uint32_t>(piece.in.positions.size()));
      if (inserted) {
        piece.in.positions.push_back(t.positions[c]);
        piece.in.vertices.push_back(root[c]);
        const auto at = rows.begin() + static_cast<std::ptrdiff_t>((3 * i + c) * row_bytes());
        piece.in.rows.insert(piece.in.rows.end(), at, at + static_cast<std::ptrdiff_t>(row));
        entry.bounds.Add(t.positions[c]);
      }
      corners[c] = it->second;
    }
    if (texture_) AddCorners(rows, i, piece.in.corners);
    for (size_t c = 0; c < 3; ++c) {
      const uint32_t a = root[c];
      const uint32_t b = root[(c + 1) % 3];
      edges_.emplace_back(std::min(a, b), std::max(a, b));
      on_border_.push_back(t.order(c) == 1 && !t.two_sided());
      joined_.Join(a, b);
    }
    if (t.two_sided()) piece.in.two_sided.resize(triangles.size());
    if (t.two_sided()) piece.in.two_sided[i] = 1;
    sides += t.sides();
    uint32_t remover = kDrain;
    if (t.child != kNone32) {
      const auto at = std::lower_bound(piece.children.begin(), piece.children.end(), t.child);
      remover = kChildFlag | static_cast<uint32_t>(at - piece.children.begin());
      if (t.explicit_arc()) {
        piece.explicit_arcs.push_back({static_cast<uint32_t>(i), t.child_slot, 0});
      }
    }
    piece.removers.push_back(remover);
  }
  entry.out_triangles = sides;
  entry.external_vertices = static_cast<uint32_t>(piece.in.positions.size());
  const Result<UnitId> id = writer_.Add(entry, piece.children, EncodeRootPiece(piece, attributes_));
  if (!id.ok()) return id.status();
  topology_.triangles += sides;
  ++topology_.pieces;
  return Status::Ok();
}

RootTopology RootWriter::Finish() {
  const auto vertices = static_cast<uint32_t>(joined_.size());
  topology_.vertices = vertices;
  for (uint32_t v = 0; v < vertices; ++v) topology_.components += joined_.Find(v) == v;
  // The border's pieces: its edges' ends, joined.
  joined_.Part();
  std::vector<bool> at_border(vertices, false);
  for (size_t e = 0; e < edges_.size(); ++e) {
    if (!on_border_[e]) continue;
    const auto [a, b] = edges_[e];
    joined_.Join(a, b);
    at_border[a] = at_border[b] = true;
  }
  for (uint32_t v = 0; v < vertices; ++v)
    topology_.border_loops += at_border[v] && joined_.Find(v) == v;
  return topology_;
}

}  // namespace mtdb::internal
