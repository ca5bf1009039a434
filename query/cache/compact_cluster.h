// SPDX-License-Identifier: Apache-2.0
// CompactCluster: a decoded cluster as the cache keeps it, in half of the memory of a Cluster.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "codecs/cluster/cluster.h"
#include "codecs/cluster/cluster_limits.h"
#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "store/base/ids.h"
#include "store/base/status.h"

namespace mtdb::internal {

// A number inside a unit: of a slot, a node, a local vertex.
using LocalNumber = uint16_t;

// Who removes the triangle in a slot, in 16 bits: a node, or with this bit the ordinal of a child;
// with all bits nobody does.
inline constexpr LocalNumber kLocalChildFlag = 0x8000;
inline constexpr LocalNumber kLocalDrain = 0xffff;
constexpr LocalNumber ToLocalRemover(uint32_t remover) {
  if (remover == kDrain) return kLocalDrain;
  const uint32_t flag = RemovedByChild(remover) ? kLocalChildFlag : 0;
  return static_cast<LocalNumber>(flag | ChildOrdinal(remover));
}
// Without a branch, which would be hard to predict.
constexpr uint32_t FromLocalRemover(LocalNumber remover) {
  const uint32_t r = remover;
  const uint32_t steps = (r >> 15) + static_cast<uint32_t>(r == kLocalDrain);
  return r + steps * (kChildFlag - kLocalChildFlag);
}
static_assert(FromLocalRemover(kLocalDrain) == kDrain);
static_assert(FromLocalRemover(kLocalChildFlag | 5) == (kChildFlag | 5));
static_assert(FromLocalRemover(5) == 5);

// Per slot. Reads as Cluster::removers does.
class LocalRemovers {
 public:
  LocalRemovers() = default;
  explicit LocalRemovers(std::span<const uint32_t> removers);
  size_t size() const { return codes_.size(); }
  uint32_t operator[](size_t slot) const { return FromLocalRemover(codes_[slot]); }
  const std::vector<LocalNumber>& codes() const { return codes_; }  // as ToLocalRemover
  std::vector<LocalNumber>& codes() { return codes_; }
  friend bool operator==(const LocalRemovers&, const LocalRemovers&) = default;

 private:
  std::vector<LocalNumber> codes_;
};

// Positions of a unit's vertices, in 6 bytes each where they lie within 65,535 steps of a corner.
class LocalPositions {
 public:
  struct Parts {
    Vec3i base{};
    std::vector<std::array<uint16_t, 3>> near;
    std::vector<Vec3i> far;  // in place of `near` where these do not fit
  };
  LocalPositions() = default;
  explicit LocalPositions(std::span<const Vec3i> positions);

  size_t size() const { return parts_.far.empty() ? parts_.near.size() : parts_.far.size(); }
  Vec3i operator[](size_t i) const {
    if (!parts_.far.empty()) [[unlikely]]
      return parts_.far[i];
    const std::array<uint16_t, 3>& p = parts_.near[i];
    return {parts_.base.x + p[0], parts_.base.y + p[1], parts_.base.z + p[2]};
  }
  void Prefetch(size_t i) const {
    if (parts_.far.empty()) __builtin_prefetch(&parts_.near[i]);
  }
  std::vector<Vec3i> All() const;
  size_t memory_bytes() const;
  const Parts& parts() const { return parts_; }
  Parts& parts() { return parts_; }

 private:
  Parts parts_;
};

// What Cluster says holds for the members of its names.
struct CompactCluster {
  std::vector<std::array<LocalNumber, 3>> triangles;  // the listed ones
  LocalPositions positions;
  std::vector<VertexIndex> vertices;  // of external ones
  Bytes rows;
  uint32_t first_own_slot = 0;
  std::vector<uint8_t> error_codes;
  std::vector<LocalNumber> ring_begin;
  std::vector<LocalNumber> ring_vertices;
  std::vector<LocalNumber> star_begin;
  std::vector<LocalNumber> hole_begin;
  std::vector<LocalNumber> hole_slots;
  LocalRemovers removers;
  std::vector<UnitId> children;
  std::vector<ExplicitArc> explicit_arcs;
  std::vector<uint32_t> vertex_begin;
  std::vector<std::array<uint32_t, 3>> created_corners;
  std::vector<uint8_t> fans;
  std::vector<uint32_t> later_fans;
  // Per slot: that of the same triangle's other side, or kNoMirror. The one with the smaller number
  // is what the payload tells of. Empty when nothing is two-sided.
  std::vector<LocalNumber> mirrors;
  static constexpr LocalNumber kNoMirror = 0xffff;
  // Of textured objects: corners, and per slot the places of its three among them.
  std::vector<TextureCorner> corners;
  std::vector<std::array<uint32_t, 3>> corner_places;

  uint32_t nodes() const { return static_cast<uint32_t>(error_codes.size()); }
  uint32_t in_triangles() const { return first_own_slot; }
  uint32_t listed() const { return static_cast<uint32_t>(triangles.size()); }
  uint32_t external_vertices() const { return static_cast<uint32_t>(vertices.size()); }
  uint32_t slots() const { return static_cast<uint32_t>(removers.size()); }
  uint32_t first_vertex(NodeIndex i) const {
    return vertex_begin.empty() ? external_vertices() + i : vertex_begin[i];
  }
  // The node with its further numbers: of one that brings a crumb, see kCrumb. They are applied and
  // taken back together.
  IndexRange numbers_of(NodeIndex i) const {
    if (fans.empty() || fans[i] != kCrumb) [[likely]]
      return {i, i + 1};
    NodeIndex end = i + 1;
    while (end < nodes() && hole_begin[end] == hole_begin[end + 1]) ++end;
    return {i, end};
  }
  // True when its number has no vertex in the mesh.
  bool without_vertex(NodeIndex i) const { return !fans.empty() && fans[i] == kCrumbWithoutVertex; }
  bool crumb(NodeIndex i) const { return !fans.empty() && fans[i] >= kCrumbWithoutVertex; }
  // Local vertices that the node creates.
  IndexRange created_vertices(NodeIndex i) const {
    const IndexRange numbers = numbers_of(i);
    return {first_vertex(numbers.first), first_vertex(numbers.last) - (without_vertex(i) ? 1 : 0)};
  }
  bool boundary(NodeIndex i) const {
    if (!fans.empty()) [[unlikely]]
      return fans[i] != 0;
    return star_begin[i + 1] - star_begin[i] + 1 == ring_begin[i + 1] - ring_begin[i];
  }
  std::span<const LocalNumber> ring(NodeIndex i) const {
    return {ring_vertices.data() + ring_begin[i], ring_vertices.data() + ring_begin[i + 1]};
  }
  std::span<const LocalNumber> hole(NodeIndex i) const {
    return {hole_slots.data() + hole_begin[i], hole_slots.data() + hole_begin[i + 1]};
  }
  // True when it has several fans, or two sides.
  bool has_later_fans(NodeIndex i) const {
    if (later_fans.empty()) return false;
    const auto next = std::lower_bound(later_fans.begin(), later_fans.end(), star_begin[i]);
    return next != later_fans.end() && *next < star_begin[i + 1];
  }
  // The slots of a node's fans, one after the other: those of a closed star are one, and what is
  // two-sided has one for each side.
  template <typename F>
  void ForEachFan(NodeIndex i, F&& f) const {
    const uint32_t end = star_begin[i + 1];
    uint32_t begin = star_begin[i];
    auto next = std::lower_bound(later_fans.begin(), later_fans.end(), begin);
    for (; next != later_fans.end() && *next < end; ++next) {
      f(IndexRange{begin, *next});
      begin = *next;
    }
    f(IndexRange{begin, end});
  }
  // True when `mirrors` says that another slot has the side which the payload tells of.
  bool is_mirror(uint32_t slot) const { return !mirrors.empty() && mirrors[slot] < slot; }
  bool two_sided(uint32_t slot) const { return !mirrors.empty() && mirrors[slot] != kNoMirror; }
  Vec3i position(uint32_t local_vertex) const { return positions[local_vertex]; }
  std::array<uint32_t, 3> listed_triangle(uint32_t slot) const {
    const std::array<LocalNumber, 3>& t = triangles[slot];
    return {t[0], t[1], t[2]};
  }
  std::array<uint32_t, 3> created_triangle(NodeIndex i, uint32_t slot) const {
    if (!created_corners.empty()) return created_corners[slot - listed()];
    const std::span<const LocalNumber> r = ring(i);
    const uint32_t j = slot - star_begin[i];
    return {external_vertices() + i, r[j], r[j + 1 == r.size() ? 0 : j + 1]};
  }
  std::array<TextureCorner, 3> texture(uint32_t slot) const {
    const std::array<uint32_t, 3>& places = corner_places[slot];
    return {corners[places[0]], corners[places[1]], corners[places[2]]};
  }
  // What it was decoded from, with rows of so many bytes.
  InPatch in_patch(size_t row_bytes) const;
  size_t memory_bytes() const;  // of the arrays
};

// kCorrupt, with `where`, for a cluster that is larger than it may be. Where `cluster` has
// two-sided triangles, there are two slots for each of these.
Result<CompactCluster> MakeCompact(Cluster cluster, const std::string& where);

}  // namespace mtdb::internal
