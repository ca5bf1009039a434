// SPDX-License-Identifier: Apache-2.0
// SeatIndex: the corners of a tile's triangles, vertex by vertex.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "builder/disk/tile.h"

namespace mtdb::internal {

// A vertex is one here whatever fans it has: its seat (TileTriangle::seat), numbered by first
// occurrence. Corners are 3 * triangle + corner. Reads the tile when asked, so that orders and
// numbers may change meanwhile, but not which vertices triangles have.
class SeatIndex {
 public:
  explicit SeatIndex(std::span<TileTriangle> tile);

  uint32_t seats() const { return static_cast<uint32_t>(begin_.size() - 1); }
  uint32_t seat(uint32_t triangle, uint32_t corner) const {
    return corner_seats_[3 * size_t{triangle} + corner];
  }
  void Remove(uint32_t triangle) { gone_[triangle] = 1; }
  bool gone(uint32_t triangle) const { return gone_[triangle] != 0; }
  // Calls f(triangle, corner) for those that are there.
  template <typename F>
  void ForEachCorner(uint32_t seat, F&& f) const {
    for (uint32_t i = begin_[seat]; i < begin_[seat + 1]; ++i) {
      if (!gone(corners_[i] / 3)) f(corners_[i] / 3, corners_[i] % 3);
    }
  }
  // Likewise for the triangles at an edge, with the edge's number in them.
  template <typename F>
  void ForEachAtEdge(uint32_t a, uint32_t b, F&& f) const {
    ForEachCorner(a, [&](uint32_t t, uint32_t c) {
      if (seat(t, (c + 1) % 3) == b) f(t, c);
      if (seat(t, (c + 2) % 3) == b) f(t, (c + 2) % 3);
    });
  }
  // All triangles of the surface at the vertex are in the tile, so far as its fans tell.
  bool IsWhole(uint32_t seat) const;
  // True when the vertex is inside of a sheet or on a chain, so that it may be removed. Of a whole
  // one.
  bool IsFree(uint32_t seat) const;

  // Numbers the vertex's fans in a row, in the order of their groups; those of one group become
  // one.
  using FanGroups = std::array<uint32_t, kMostOrder>;  // of fans, each below kMostOrder
  void NumberFans(uint32_t seat, const FanGroups& groups);
  // The vertex stays unless it is free.
  void SetFixed(uint32_t seat);

 private:
  bool IsPaired(uint32_t seat, uint32_t t, uint32_t c, bool out) const;

  std::span<TileTriangle> tile_;
  std::vector<uint32_t> corner_seats_;
  std::vector<uint32_t> begin_, corners_;
  std::vector<uint8_t> gone_;
};

}  // namespace mtdb::internal
