// SPDX-License-Identifier: Apache-2.0
#include "tests/sheets/sheet_graph.h"

#include <algorithm>
#include <numeric>
#include <tuple>

namespace mtdb::sheets {
namespace {

class UnionFind {
 public:
  explicit UnionFind(size_t count) : of_(count) { std::iota(of_.begin(), of_.end(), 0u); }
  uint32_t Find(uint32_t i) {
    while (of_[i] != i) i = of_[i] = of_[of_[i]];
    return i;
  }
  void Join(uint32_t i, uint32_t j) { of_[Find(i)] = Find(j); }

 private:
  std::vector<uint32_t> of_;
};

// Rotated so that the least corner is first.
Triangle Rotated(Triangle t) {
  std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  return t;
}

// The same for both orientations.
Triangle Unoriented(Triangle t) {
  std::sort(t.begin(), t.end());
  return t;
}

}  // namespace

std::string Text(const Signature& signature) {
  return std::to_string(signature.along) + "+ " + std::to_string(signature.against) + "- " +
         std::to_string(signature.two_sided) + "=";
}

SheetGraph::SheetGraph(const Complex& complex) {
  FindSheets(complex);
  Finish(complex.points.size());
}

SheetGraph::SheetGraph(std::vector<Sheet> sheets, size_t points) : sheets_(std::move(sheets)) {
  for (const Sheet& sheet : sheets_) opposite_pairs_ += sheet.two_sided;
  Finish(points);
}

void SheetGraph::FindSheets(const Complex& complex) {
  std::vector<std::pair<Triangle, Triangle>> faces;  // without and with orientation
  for (const Triangle& t : complex.triangles) {
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) {
      ++degenerates_;
    } else {
      faces.emplace_back(Unoriented(t), Rotated(t));
    }
  }
  std::sort(faces.begin(), faces.end());
  for (size_t i = 0; i < faces.size(); ++i) {
    if (i > 0 && faces[i] == faces[i - 1]) {
      ++duplicates_;
    } else if (i > 0 && faces[i].first == faces[i - 1].first) {
      sheets_.back().two_sided = true;
      ++opposite_pairs_;
    } else {
      sheets_.push_back({faces[i].second, false});
    }
  }
}

void SheetGraph::Finish(size_t points) {
  FindEdges();
  FindPatches(points);
  FindStars(points);
  FindChains(points);
  uint64_t used = 0;
  UnionFind joined(points);
  for (const Edge& edge : edges_) joined.Join(edge.a, edge.b);
  for (uint32_t v = 0; v < points; ++v) {
    used += IsUsed(v);
    components_ += IsUsed(v) && joined.Find(v) == v;
  }
  euler_ = static_cast<int64_t>(used + sheets_.size()) - static_cast<int64_t>(edges_.size());
}

void SheetGraph::FindEdges() {
  std::vector<std::tuple<uint32_t, uint32_t, uint32_t, bool>> sides;  // a, b, sheet, along
  for (uint32_t s = 0; s < sheets_.size(); ++s) {
    for (size_t i = 0; i < 3; ++i) {
      const uint32_t a = sheets_[s].corners[i], b = sheets_[s].corners[(i + 1) % 3];
      sides.emplace_back(std::min(a, b), std::max(a, b), s, a < b);
    }
  }
  std::sort(sides.begin(), sides.end());
  for (const auto& [a, b, s, along] : sides) {
    if (edges_.empty() || edges_.back().a != a || edges_.back().b != b) {
      edges_.push_back({a, b, {}, static_cast<uint32_t>(sheets_of_edges_.size()), 0});
    }
    Edge& edge = edges_.back();
    ++edge.count;
    Signature& signature = edge.signature;
    ++(sheets_[s].two_sided ? signature.two_sided : along ? signature.along : signature.against);
    sheets_of_edges_.push_back(s);
  }
}

const Edge* SheetGraph::FindEdge(uint32_t a, uint32_t b) const {
  if (a > b) std::swap(a, b);
  const auto at = std::lower_bound(
      edges_.begin(), edges_.end(), std::pair(a, b),
      [](const Edge& edge, const auto& key) { return std::pair(edge.a, edge.b) < key; });
  return at != edges_.end() && at->a == a && at->b == b ? &*at : nullptr;
}

void SheetGraph::FindPatches(size_t points) {
  UnionFind joined(sheets_.size());
  for (const Edge& edge : edges_) {
    if (!edge.signature.regular()) continue;
    joined.Join(sheets_of_edges_[edge.first], sheets_of_edges_[edge.first + 1]);
  }
  std::vector<uint32_t> number(sheets_.size(), 0);
  patch_of_.resize(sheets_.size());
  patches_at_.resize(points);
  for (uint32_t s = 0; s < sheets_.size(); ++s) {
    if (joined.Find(s) == s) number[s] = patch_count_++;
  }
  for (uint32_t s = 0; s < sheets_.size(); ++s) {
    patch_of_[s] = number[joined.Find(s)];
    for (const uint32_t v : sheets_[s].corners) patches_at_[v].push_back(patch_of_[s]);
  }
  for (std::vector<uint32_t>& patches : patches_at_) {
    std::sort(patches.begin(), patches.end());
    patches.erase(std::unique(patches.begin(), patches.end()), patches.end());
  }
}

// A part of a star is a part of the graph of the edges opposite to the vertex.
void SheetGraph::FindStars(size_t points) {
  std::vector<std::tuple<uint32_t, uint32_t, uint32_t>> corners;  // vertex, its two neighbours
  for (const Sheet& sheet : sheets_) {
    for (size_t i = 0; i < 3; ++i) {
      corners.emplace_back(sheet.corners[i], sheet.corners[(i + 1) % 3],
                           sheet.corners[(i + 2) % 3]);
    }
  }
  std::sort(corners.begin(), corners.end());
  star_parts_.assign(points, 0);
  for (size_t begin = 0, end = 0; begin < corners.size(); begin = end) {
    const uint32_t v = std::get<0>(corners[begin]);
    std::vector<uint32_t> around;
    while (end < corners.size() && std::get<0>(corners[end]) == v) {
      around.push_back(std::get<1>(corners[end]));
      around.push_back(std::get<2>(corners[end++]));
    }
    std::sort(around.begin(), around.end());
    around.erase(std::unique(around.begin(), around.end()), around.end());
    const auto place = [&](uint32_t w) {
      return static_cast<uint32_t>(std::lower_bound(around.begin(), around.end(), w) -
                                   around.begin());
    };
    UnionFind joined(around.size());
    for (size_t i = begin; i < end; ++i) {
      joined.Join(place(std::get<1>(corners[i])), place(std::get<2>(corners[i])));
    }
    for (uint32_t i = 0; i < around.size(); ++i) star_parts_[v] += joined.Find(i) == i;
  }
}

void SheetGraph::FindChains(size_t points) {
  creases_at_.resize(points);
  for (uint32_t e = 0; e < edges_.size(); ++e) {
    if (edges_[e].signature.regular()) continue;
    creases_at_[edges_[e].a].push_back(e);
    creases_at_[edges_[e].b].push_back(e);
  }
  is_node_.resize(points);
  for (uint32_t v = 0; v < points; ++v) {
    const std::vector<uint32_t>& creases = creases_at_[v];
    const bool passes = creases.size() == 2 &&
                        Towards(edges_[creases[0]], v) == Towards(edges_[creases[1]], v).Flipped();
    is_node_[v] = !creases.empty() && !passes;
  }
  std::vector<bool> done(edges_.size());
  // First the chains between nodes, then closed ones, which may begin anywhere.
  for (const bool nodes : {true, false}) {
    for (uint32_t v = 0; v < points; ++v) {
      if (is_node_[v] != nodes) continue;
      for (const uint32_t e : creases_at_[v]) {
        if (!done[e]) chains_.push_back(Follow(v, e, &done));
      }
    }
  }
}

Chain SheetGraph::Follow(uint32_t from, uint32_t over, std::vector<bool>* done) const {
  Chain chain;
  chain.vertices.push_back(from);
  uint32_t at = from;
  for (;;) {
    const Edge& edge = edges_[over];
    (*done)[over] = true;
    const uint32_t to = edge.a == at ? edge.b : edge.a;
    if (chain.vertices.size() == 1) chain.signature = Towards(edge, to);
    if (to == from && !is_node_[from]) {
      chain.closed = true;
      return chain;
    }
    chain.vertices.push_back(to);
    if (is_node_[to]) return chain;
    over = creases_at_[to][creases_at_[to][0] == over ? 1 : 0];
    at = to;
  }
}

}  // namespace mtdb::sheets
