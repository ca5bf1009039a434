// SPDX-License-Identifier: Apache-2.0
#include "builder/internal/tile_surface.h"

#include <algorithm>
#include <cstring>
#include <numeric>

#include "builder/internal/number_table.h"
#include "builder/internal/squeeze.h"

namespace mtdb::internal {

namespace {

// Calls f(list) for all of them, in the order of the bytes.
template <typename Surface, typename F>
void ForEachList(Surface& s, F&& f) {
  f(s.vertices);
  f(s.positions);
  f(s.triangles);
  f(s.errors);
  f(s.held);
  f(s.own);
  f(s.conservative);
  f(s.curve_errors);
}

// Puts the surfaces of several clusters together, as far as they lie beneath a tile.
class Gathering {
 public:
  explicit Gathering(std::span<const TileTriangle> tile)
      : in_tile_(tile.size()), numbers_(tile.size()) {
    const size_t n = tile.size();
    all_.own.assign(n, 1);
    all_.conservative.assign(n, 0);
    all_.curve_errors.resize(n);
    for (size_t t = 0; t < n; ++t) {
      all_.curve_errors[t].fill(tile[t].error);
      for (const uint32_t v : tile[t].vertices) in_tile_.Add(v, 0);
    }
  }

  // `triangles` of the tile are in-triangles of this surface's cluster.
  void Add(const TileSurface& surface, std::span<const TileTriangle> tile,
           std::span<const uint32_t> triangles) {
    std::vector<uint32_t> in_tile(surface.own.size(), kNone32);  // of in-triangles
    for (const uint32_t t : triangles) {
      const uint32_t slot = tile[t].child_slot;
      in_tile[slot] = t;
      all_.own[t] = 0;
      all_.conservative[t] = surface.conservative[slot];
      all_.curve_errors[t] = surface.curve_errors[slot];
    }
    // What lies around the vertices that the tile has or holds.
    const size_t count = surface.vertices.size();
    std::vector<uint8_t> wanted(count);
    for (size_t v = 0; v < count; ++v) {
      wanted[v] = in_tile_.Find(surface.vertices[v]) != kNone32;
    }
    for (const HeldVertex& held : surface.held) {
      if (in_tile[held.triangle] != kNone32) wanted[held.vertex] = 1;
    }
    std::vector<uint32_t> number(count, kNone32);
    const auto number_of = [&](uint32_t v) {
      if (number[v] == kNone32) number[v] = Number(surface.vertices[v], surface.positions[v]);
      return number[v];
    };
    for (const HeldVertex& held : surface.held) {
      if (in_tile[held.triangle] == kNone32) continue;
      all_.held.push_back({number_of(held.vertex), in_tile[held.triangle], held.edge});
    }
    for (size_t t = 0; t < surface.triangles.size(); ++t) {
      const auto [a, b, c] = surface.triangles[t];
      if (!wanted[a] && !wanted[b] && !wanted[c]) continue;
      all_.triangles.push_back({number_of(a), number_of(b), number_of(c)});
      all_.errors.push_back(surface.errors[t]);
    }
  }

  TileSurface Take() { return std::move(all_); }

 private:
  uint32_t Number(uint32_t vertex, Vec3i position) {
    const auto [number, fresh] = numbers_.Add(vertex, static_cast<uint32_t>(all_.vertices.size()));
    if (fresh) {
      all_.vertices.push_back(vertex);
      all_.positions.push_back(position);
    }
    return number;
  }

  NumberTable in_tile_;  // the tile's vertices; what it says of them is nothing
  NumberTable numbers_;
  TileSurface all_;
};

}  // namespace

Bytes EncodeTileSurface(const TileSurface& surface) {
  ByteWriter w;
  ForEachList(surface, [&](const auto& list) {
    const Bytes squeezed =
        SqueezeTable(std::as_bytes(std::span(list)), sizeof(list[0]) / sizeof(uint32_t));
    w.PutVarint(squeezed.size());
    w.PutBytes(squeezed);
  });
  return w.Take();
}

TileSurface DecodeTileSurface(ByteSpan bytes) {
  TileSurface surface;
  ByteReader r(bytes);
  ForEachList(surface, [&](auto& list) {
    constexpr size_t kMost = size_t{1} << 30;
    const std::optional<Bytes> raw =
        UnsqueezeTable(r.GetBytes(r.GetVarint()), sizeof(list[0]) / sizeof(uint32_t), kMost);
    if (!raw || raw->empty()) return;
    list.resize(raw->size() / sizeof(list[0]));
    std::memcpy(list.data(), raw->data(), raw->size());
  });
  return surface;
}

Status SurfaceSpool::Add(UnitId cluster, ByteSpan surface) {
  if (begin_.size() == 1) first_ = cluster;
  begin_.push_back(begin_.back() + surface.size());
  return spool_.Append(surface.data(), surface.size());
}

Result<TileSurface> SurfaceSpool::Read(UnitId cluster) const {
  const size_t i = cluster - first_;
  Bytes bytes(begin_[i + 1] - begin_[i]);
  MTDB_RETURN_IF_ERROR(spool_.Read(begin_[i], bytes.data(), bytes.size()));
  return DecodeTileSurface(bytes);
}

Result<TileSurface> SurfaceSpool::Gather(std::span<const TileTriangle> tile) const {
  std::vector<uint32_t> order(tile.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(),
                   [&](uint32_t a, uint32_t b) { return tile[a].child < tile[b].child; });
  Gathering gathering(tile);
  for (size_t begin = 0; begin < order.size();) {
    const UnitId child = tile[order[begin]].child;
    size_t end = begin;
    while (end < order.size() && tile[order[end]].child == child) ++end;
    if (Has(child)) {
      MTDB_ASSIGN_OR_RETURN(const TileSurface surface, Read(child));
      gathering.Add(surface, tile, std::span(order).subspan(begin, end - begin));
    }
    begin = end;
  }
  return gathering.Take();
}

}  // namespace mtdb::internal
