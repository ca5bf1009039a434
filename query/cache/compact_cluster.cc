// SPDX-License-Identifier: Apache-2.0
#include "query/cache/compact_cluster.h"

#include <algorithm>
#include <utility>

#include "codecs/cluster/both_sides.h"

namespace mtdb::internal {
namespace {

template <typename T>
size_t VectorBytes(const std::vector<T>& v) {
  return v.capacity() * sizeof(T);
}

uint32_t Distance(int32_t to, int32_t from) {
  return static_cast<uint32_t>(to) - static_cast<uint32_t>(from);
}

std::vector<LocalNumber> Narrow(const std::vector<uint32_t>& numbers) {
  return std::vector<LocalNumber>(numbers.begin(), numbers.end());
}

// Without room for more.
template <typename T>
std::vector<T> Tight(std::vector<T> v) {
  if (v.capacity() == v.size()) return v;
  return std::vector<T>(v.begin(), v.end());
}

}  // namespace

LocalRemovers::LocalRemovers(std::span<const uint32_t> removers) : codes_(removers.size()) {
  std::ranges::transform(removers, codes_.begin(), ToLocalRemover);
}

LocalPositions::LocalPositions(std::span<const Vec3i> positions) {
  Box3i box;
  for (const Vec3i& p : positions) box.Add(p);
  const bool fits =
      positions.empty() || std::max({Distance(box.max.x, box.min.x), Distance(box.max.y, box.min.y),
                                     Distance(box.max.z, box.min.z)}) <= 0xffff;
  if (!fits) {
    parts_.far.assign(positions.begin(), positions.end());
    return;
  }
  if (!positions.empty()) parts_.base = box.min;
  parts_.near.resize(positions.size());
  std::transform(positions.begin(), positions.end(), parts_.near.begin(), [&](const Vec3i& p) {
    return std::array<uint16_t, 3>{static_cast<uint16_t>(Distance(p.x, parts_.base.x)),
                                   static_cast<uint16_t>(Distance(p.y, parts_.base.y)),
                                   static_cast<uint16_t>(Distance(p.z, parts_.base.z))};
  });
}

std::vector<Vec3i> LocalPositions::All() const {
  std::vector<Vec3i> all(size());
  for (size_t i = 0; i < all.size(); ++i) all[i] = (*this)[i];
  return all;
}

size_t LocalPositions::memory_bytes() const {
  return VectorBytes(parts_.near) + VectorBytes(parts_.far);
}

InPatch CompactCluster::in_patch(size_t row_bytes) const {
  InPatch in;
  for (uint32_t slot = 0; slot < listed(); ++slot) {
    if (is_mirror(slot)) continue;
    in.triangles.push_back(listed_triangle(slot));
    if (!mirrors.empty()) in.two_sided.push_back(two_sided(slot));
    if (corner_places.empty()) continue;
    const std::array<TextureCorner, 3> t = texture(slot);
    in.corners.insert(in.corners.end(), t.begin(), t.end());
  }
  in.vertices = vertices;
  for (uint32_t v = 0; v < external_vertices(); ++v) in.positions.push_back(position(v));
  const size_t bytes = external_vertices() * row_bytes;
  in.rows.assign(rows.begin(), rows.begin() + static_cast<std::ptrdiff_t>(bytes));
  return in;
}

size_t CompactCluster::memory_bytes() const {
  return VectorBytes(triangles) + positions.memory_bytes() + VectorBytes(vertices) +
         VectorBytes(rows) + VectorBytes(error_codes) + VectorBytes(ring_begin) +
         VectorBytes(ring_vertices) + VectorBytes(star_begin) + VectorBytes(hole_begin) +
         VectorBytes(hole_slots) + VectorBytes(removers.codes()) + VectorBytes(children) +
         VectorBytes(explicit_arcs) + VectorBytes(vertex_begin) + VectorBytes(created_corners) +
         VectorBytes(fans) + VectorBytes(later_fans) + VectorBytes(mirrors) + VectorBytes(corners) +
         VectorBytes(corner_places);
}

Result<CompactCluster> MakeCompact(Cluster cluster, const std::string& where) {
  std::vector<uint32_t> mirrors;
  if (!cluster.in.two_sided.empty()) mirrors = ShowBothSides(cluster);
  const size_t most = std::max({cluster.removers.size(), cluster.ring_vertices.size(),
                                cluster.hole_slots.size(), cluster.in.positions.size()});
  if (most > kMostSlots || cluster.nodes() > kMostNodes ||
      cluster.children.size() > kMostChildren) {
    return Corrupt(where + ": " + std::to_string(cluster.nodes()) + " nodes with " +
                   std::to_string(cluster.slots()) + " triangles and " +
                   std::to_string(cluster.children.size()) +
                   " children are more than a cluster may have");
  }
  CompactCluster c;
  c.triangles.resize(cluster.in.triangles.size());
  std::ranges::transform(cluster.in.triangles, c.triangles.begin(), [](const auto& t) {
    return std::array<LocalNumber, 3>{static_cast<LocalNumber>(t[0]),
                                      static_cast<LocalNumber>(t[1]),
                                      static_cast<LocalNumber>(t[2])};
  });
  c.positions = LocalPositions(cluster.in.positions);
  c.vertices = Tight(std::move(cluster.in.vertices));
  c.rows = Tight(std::move(cluster.in.rows));
  c.first_own_slot = cluster.first_own_slot;
  c.ring_begin = Narrow(cluster.ring_begin);
  c.ring_vertices = Narrow(cluster.ring_vertices);
  c.star_begin = Narrow(cluster.star_begin);
  c.hole_begin = Narrow(cluster.hole_begin);
  c.hole_slots = Narrow(cluster.hole_slots);
  c.removers = LocalRemovers(cluster.removers);
  c.error_codes = std::move(cluster.error_codes);
  c.children = Tight(std::move(cluster.children));
  c.explicit_arcs = Tight(std::move(cluster.explicit_arcs));
  c.vertex_begin = std::move(cluster.vertex_begin);
  c.created_corners = std::move(cluster.created_corners);
  c.fans = std::move(cluster.fans);
  c.later_fans = Tight(std::move(cluster.later_fans));
  c.corners = Tight(std::move(cluster.in.corners));
  c.corner_places = Tight(std::move(cluster.in.corner_places));
  c.mirrors = Narrow(mirrors);  // kNone32 becomes kNoMirror
  return c;
}

}  // namespace mtdb::internal
