// SPDX-License-Identifier: Apache-2.0
#include "builder/measure/tile_surface.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <utility>

#include "builder/disk/number_table.h"
#include "builder/disk/squeeze.h"
#include "store/base/hash.h"

namespace mtdb::internal {

namespace {

// Of a height field's triangles, for each of the tile's: longer curves are dear, and the longest
// are not found (docs/notes/2026-11-heights-as-errors.md).
constexpr size_t kMostField = 24;
// For each of the surface's triangles. Where there are more, paths are long, and those that are too
// long stand in the way of removals.
constexpr size_t kMostChords = 16;

// Calls f(list) for all of them, in the order of the bytes.
template <typename Surface, typename F>
void ForEachList(Surface& s, F&& f) {
  f(s.vertices);
  f(s.positions);
  f(s.corners);
  f(s.triangles);
  f(s.errors);
  f(s.held);
  f(s.chords);
  f(s.own);
  f(s.edge_errors);
}

// Puts the surfaces of several clusters together, as far as they lie beneath a tile.
class Gathering {
 public:
  Gathering(std::span<const TileTriangle> tile, uint32_t round)
      : in_tile_(tile.size()), numbers_(tile.size()) {
    all_.round = round;
    const size_t n = tile.size();
    all_.own.assign(n, 1);
    all_.edge_errors.resize(n);
    for (size_t t = 0; t < n; ++t) {
      all_.edge_errors[t].fill(tile[t].error);
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
      all_.own[t] = surface.own[slot];
      all_.edge_errors[t] = surface.edge_errors[slot];
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
      if (number[v] == kNone32) number[v] = Number(surface, v);
      return number[v];
    };
    for (const HeldVertex& held : surface.held) {
      if (in_tile[held.triangle] == kNone32) continue;
      all_.held.push_back({number_of(held.vertex), in_tile[held.triangle], held.edge});
    }
    for (const Chord& chord : surface.chords) {
      if (in_tile[chord.triangle] == kNone32) continue;
      Chord& added = all_.chords.emplace_back(chord);
      added.from = number_of(chord.from);
      added.to = number_of(chord.to);
      added.triangle = in_tile[chord.triangle];
    }
    for (size_t t = 0; t < surface.triangles.size(); ++t) {
      const auto [a, b, c] = surface.triangles[t];
      if (!wanted[a] && !wanted[b] && !wanted[c]) continue;
      all_.triangles.push_back({number_of(a), number_of(b), number_of(c)});
      all_.errors.push_back(surface.errors[t]);
    }
  }

  TileSurface Take(bool may_have_twins) {
    if (may_have_twins) DropTwins();
    return std::move(all_);
  }

 private:
  // Clusters of a later round than the surface's leave all that lies around what they hold, which
  // those beside them may leave too.
  void DropTwins() {
    std::vector<uint32_t> last(std::bit_ceil(all_.triangles.size()), kNone32);  // kept, by hash
    std::vector<uint32_t> before;                                               // of a kept one
    before.reserve(all_.triangles.size());
    for (size_t t = 0; t < all_.triangles.size(); ++t) {
      std::array<uint32_t, 3> turned = all_.triangles[t];
      std::rotate(turned.begin(), std::min_element(turned.begin(), turned.end()), turned.end());
      const auto [a, b, c] = turned;
      uint32_t& head = last[Mix64(Mix64(uint64_t{a} << 32 | b) ^ c) & (last.size() - 1)];
      uint32_t twin = head;
      while (twin != kNone32 && all_.triangles[twin] != turned) twin = before[twin];
      if (twin != kNone32) continue;
      const size_t kept = before.size();
      before.push_back(std::exchange(head, static_cast<uint32_t>(kept)));
      all_.triangles[kept] = turned;
      all_.errors[kept] = all_.errors[t];
    }
    all_.triangles.resize(before.size());
    all_.errors.resize(before.size());
  }

  uint32_t Number(const TileSurface& from, size_t v) {
    const auto [number, fresh] =
        numbers_.Add(from.vertices[v], static_cast<uint32_t>(all_.vertices.size()));
    if (fresh) {
      all_.vertices.push_back(from.vertices[v]);
      all_.positions.push_back(from.positions[v]);
      if (!from.corners.empty()) all_.corners.push_back(from.corners[v]);
    }
    return number;
  }

  NumberTable in_tile_;  // the tile's vertices; what it says of them is nothing
  NumberTable numbers_;
  TileSurface all_;
};

}  // namespace

std::vector<uint32_t> NumberVertices(const TileSurface& surface,
                                     std::span<const uint32_t> tile_vertices) {
  NumberTable in_tile(tile_vertices.size());
  for (uint32_t v = 0; v < tile_vertices.size(); ++v) in_tile.Add(tile_vertices[v], v);
  std::vector<uint32_t> numbers(surface.vertices.size());
  auto next = static_cast<uint32_t>(tile_vertices.size());
  for (size_t v = 0; v < numbers.size(); ++v) {
    const uint32_t found = in_tile.Find(surface.vertices[v]);
    numbers[v] = found != kNone32 ? found : next++;
  }
  return numbers;
}

bool IsWorthGoingOn(const TileSurface& surface, bool is_height_field) {
  const size_t count = surface.triangles.size();
  return count > 0 && count <= kMostSurface && surface.chords.size() <= kMostChords * count &&
         !(is_height_field && count > kMostField * surface.own.size());
}

Bytes EncodeTileSurface(const TileSurface& surface) {
  ByteWriter w;
  w.Put(surface.round);
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
  surface.round = r.Get<uint32_t>();
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
  surface_rounds_.push_back(ByteReader(surface).Get<uint32_t>());
  return spool_.Append(surface.data(), surface.size());
}

Result<TileSurface> SurfaceSpool::Read(UnitId cluster) const {
  const size_t i = cluster - first_;
  Bytes bytes(begin_[i + 1] - begin_[i]);
  MTDB_RETURN_IF_ERROR(spool_.Read(begin_[i], bytes.data(), bytes.size()));
  return DecodeTileSurface(bytes);
}

Result<TileSurface> GatherSurface(std::span<const std::unique_ptr<SurfaceSpool>> rounds,
                                  std::span<const TileTriangle> tile) {
  if (rounds.empty()) return TileSurface{};
  // The round that began with the surface, the latest that a triangle's part lies on. Triangles
  // made before it are the surface's own; those made since must all stand for parts of it.
  uint32_t round = 0;
  std::vector<uint32_t> order;
  std::vector<const SurfaceSpool*> left_by(tile.size(), nullptr);
  for (uint32_t t = 0; t < tile.size(); ++t) {
    const UnitId child = tile[t].child;
    if (child == kNone32) continue;
    for (const auto& spool : rounds) {
      if (spool->Has(child)) left_by[t] = spool.get();
    }
    if (left_by[t] == nullptr) continue;
    order.push_back(t);
    round = std::max(round, left_by[t]->SurfaceRound(child));
  }
  if (round < rounds.front()->round()) return TileSurface{};
  std::erase_if(order, [&](uint32_t t) { return left_by[t]->round() < round; });
  for (const uint32_t t : order) {
    if (left_by[t]->SurfaceRound(tile[t].child) != round) return TileSurface{};
  }
  std::stable_sort(order.begin(), order.end(),
                   [&](uint32_t a, uint32_t b) { return tile[a].child < tile[b].child; });
  Gathering gathering(tile, round);
  bool went_on = false;
  for (size_t begin = 0; begin < order.size();) {
    const UnitId child = tile[order[begin]].child;
    size_t end = begin;
    while (end < order.size() && tile[order[end]].child == child) ++end;
    MTDB_ASSIGN_OR_RETURN(const TileSurface surface, left_by[order[begin]]->Read(child));
    went_on |= left_by[order[begin]]->round() > round;
    gathering.Add(surface, tile, std::span(order).subspan(begin, end - begin));
    begin = end;
  }
  return gathering.Take(went_on);
}

}  // namespace mtdb::internal
