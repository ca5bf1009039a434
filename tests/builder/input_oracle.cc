// SPDX-License-Identifier: Apache-2.0
#include "tests/builder/input_oracle.h"

#include <algorithm>
#include <iterator>
#include <optional>

namespace mtdb::testing {

InputOracle::InputOracle(const std::vector<TriangleVertices>& input, uint64_t vertex_count) {
  report.vertices = vertex_count;
  report.triangles = input.size();
  std::set<TriangleVertices> seen;
  std::map<TriangleVertices, size_t> numbers;  // of those that are kept
  for (TriangleVertices t : input) {
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) {
      ++report.degenerate_triangles;
      continue;
    }
    while (t[0] > t[1] || t[0] > t[2]) t = {t[1], t[2], t[0]};
    if (!seen.insert(t).second) {
      ++report.duplicate_triangles;
      continue;
    }
    if (const auto opposite = numbers.find({t[0], t[2], t[1]}); opposite != numbers.end()) {
      two_sided[opposite->second] = true;
      ++report.two_sided_triangles;
      continue;
    }
    numbers[t] = kept.size();
    kept.push_back(t);
    two_sided.push_back(false);
  }
  for (size_t i = 0; i < kept.size(); ++i) {
    for (size_t c = 0; c < 3; ++c) {
      const VertexIndex a = kept[i][c];
      const VertexIndex b = kept[i][(c + 1) % 3];
      uses[Between(a, b)].push_back(two_sided[i] ? 0 : a < b ? 1 : -1);
      at[a].push_back(i);
    }
  }
  report.unreferenced_vertices = vertex_count - at.size();
  for (const auto& [edge, u] : uses) {
    if (IsManifold(edge)) continue;
    ++report.nonmanifold_edges;
    report.inconsistent_edges += u == std::vector<int>{1, 1} || u == std::vector<int>{-1, -1};
    fixed.insert(edge.first);
    fixed.insert(edge.second);
  }
  for (const auto& [v, triangles] : at) {
    if (Fans(v) > 1) fixed.insert(v);
    if (Fans(v) > 1 && Fans(v) <= kMostOrder) fans[v] = static_cast<uint32_t>(Fans(v));
  }
  FindChains();
  report.nonmanifold_vertices = fixed.size();
}

// Takes the vertices on chains out of those that stay.
void InputOracle::FindChains() {
  for (auto v = fixed.begin(); v != fixed.end();) {
    const std::optional<uint32_t> order = ChainOrder(*v);
    if (!order) {
      ++v;
      continue;
    }
    chains[*v] = *order;
    v = fixed.erase(v);
  }
}

// Of a vertex with exactly two creases, of one order up to 15, which are the ends of all of its
// fans.
std::optional<uint32_t> InputOracle::ChainOrder(VertexIndex v) const {
  std::map<VertexIndex, size_t> creases;  // other end -> order
  for (const size_t t : at.at(v)) {
    for (const VertexIndex w : kept[t]) {
      if (w != v && OrderOf(Between(v, w)) != 0) creases[w] = OrderOf(Between(v, w));
    }
  }
  if (creases.size() != 2) return std::nullopt;
  const size_t order = creases.begin()->second;
  if (order < 2 || order > kMostOrder || creases.rbegin()->second != order) return std::nullopt;
  const std::vector<size_t> group = FanGroups(v);
  std::map<size_t, std::set<VertexIndex>> ends;
  for (size_t i = 0; i < group.size(); ++i) {
    ends[group[i]];
    for (const VertexIndex w : kept[at.at(v)[i]]) {
      if (creases.contains(w)) ends[group[i]].insert(w);
    }
  }
  for (const auto& [fan, crease_ends] : ends) {
    if (crease_ends.size() != 2) return std::nullopt;
  }
  return static_cast<uint32_t>(order);
}

// Of the numbers that a vertex with fans has, one for each, behind the input's.
uint32_t InputOracle::FirstNumber(VertexIndex v) const {
  uint64_t number = report.vertices;
  for (const auto& [other, count] : fans) {
    if (other < v) number += count;
  }
  return static_cast<uint32_t>(number);
}

// 0: two triangles that run opposite ways, or that are both two-sided.
size_t InputOracle::OrderOf(const Edge& edge) const {
  const std::vector<int>& u = uses.at(edge);
  const bool goes_on = u.size() == 2 && u[0] + u[1] == 0;
  return goes_on ? 0 : u.size();
}

uint64_t InputOracle::BorderEdges() const {
  uint64_t count = 0;
  for (const auto& [edge, u] : uses) count += u.size() == 1 && u[0] != 0;
  return count;
}

size_t InputOracle::Fans(VertexIndex v) const {
  const std::vector<size_t> group = FanGroups(v);
  return std::set<size_t>(group.begin(), group.end()).size();
}

// Groups of triangles at v that are joined by manifold edges at v: the first one of each.
std::vector<size_t> InputOracle::FanGroups(VertexIndex v) const {
  const std::vector<size_t>& triangles = at.at(v);
  std::map<VertexIndex, std::vector<size_t>> by_edge;
  for (size_t i = 0; i < triangles.size(); ++i) {
    for (const VertexIndex w : kept[triangles[i]]) {
      if (w != v && IsManifold(Between(v, w))) by_edge[w].push_back(i);
    }
  }
  std::vector<size_t> group(triangles.size());
  for (size_t i = 0; i < group.size(); ++i) group[i] = i;
  for (bool changed = true; changed;) {
    changed = false;
    for (const auto& [w, members] : by_edge) {
      const size_t least = std::min(group[members.front()], group[members.back()]);
      for (const size_t i : {members.front(), members.back()}) {
        changed |= group[i] != least;
        group[i] = least;
      }
    }
  }
  return group;
}

// Those of many triangles first; else by their first triangles.
std::vector<size_t> InputOracle::SortedFans(VertexIndex v) const {
  const std::vector<size_t> group = FanGroups(v);
  std::vector<size_t> sorted(group);
  std::sort(sorted.begin(), sorted.end());
  sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
  const auto size = [&](size_t fan) { return std::count(group.begin(), group.end(), fan); };
  std::stable_sort(sorted.begin(), sorted.end(),
                   [&](size_t a, size_t b) { return size(a) > size(b); });
  return sorted;
}

std::vector<TileTriangle> ClassifiedTriangles(const TriangleMesh& mesh, const Grid& grid) {
  const InputOracle oracle(mesh.triangles, mesh.positions.size());
  std::vector<TileTriangle> triangles;
  for (const TriangleVertices& kept : oracle.kept) {
    TileTriangle& t = triangles.emplace_back();
    for (uint32_t c = 0; c < 3; ++c) {
      const VertexIndex v = kept[c];
      const size_t order = oracle.OrderOf(InputOracle::Between(v, kept[(c + 1) % 3]));
      t.vertices[c] = static_cast<uint32_t>(v);
      t.positions[c] = grid.Quantize(mesh.positions[v]);
      t.set_order(c, static_cast<uint32_t>(std::min<size_t>(order, kMostOrder)));
      t.set_fixed(c, oracle.fixed.contains(v));
      t.set_two_sided(oracle.two_sided[triangles.size() - 1]);
      if (!oracle.fans.contains(v)) continue;
      const std::vector<size_t> group = oracle.FanGroups(v);
      const std::vector<size_t> sorted = oracle.SortedFans(v);
      const std::vector<size_t>& around = oracle.at.at(v);
      const auto here = std::find(around.begin(), around.end(), triangles.size() - 1);
      const size_t fan = group[static_cast<size_t>(here - around.begin())];
      const auto number = static_cast<size_t>(
          std::distance(sorted.begin(), std::find(sorted.begin(), sorted.end(), fan)));
      t.set_fan(c, static_cast<uint32_t>(number));
      t.set_more_fans(c, number + 1 < sorted.size());
      t.vertices[c] = oracle.FirstNumber(v) + t.fan(c);
    }
  }
  return triangles;
}

}  // namespace mtdb::testing
