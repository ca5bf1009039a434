// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/three_d/tile_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "tools/tiles/level/vertex_table.h"

namespace mtdb {

namespace {

constexpr uint32_t kNone = ~uint32_t{0};

// A vertex's number in the tile.
struct Number {
  uint32_t value = kNone;
};

Vec3f Unit(Vec3f n) {
  const double length = Length(Vec3d{n.x, n.y, n.z});
  if (!(length > 0) || !std::isfinite(length)) return {0, 0, 1};
  return {static_cast<float>(n.x / length), static_cast<float>(n.y / length),
          static_cast<float>(n.z / length)};
}

class TileMeshMaker {
 public:
  TileMeshMaker(const LevelMesh& mesh, const TileMeshOptions& options)
      : mesh_(mesh), options_(options) {}

  GltfTile Make(std::span<const LevelTriangle> triangles) {
    AddTriangles(triangles);
    tile_.surface_triangles = tile_.indices.size() / 3;
    if (options_.skirt > 0) AddSkirts();
    Box3i box;
    for (const Vec3i& p : tile_.positions) box.Add(p);
    if (box.empty()) box = {{0, 0, 0}, {0, 0, 0}};
    for (Vec3i& p : tile_.positions) p = p - box.min;
    tile_.step = options_.step;
    tile_.origin = options_.origin + ToDouble(box.min) * options_.step;
    return std::move(tile_);
  }

 private:
  struct Edge {
    uint32_t low = 0, high = 0;  // of the tile's vertices
    bool turned = false;         // the triangle goes from high to low
  };

  void AddTriangles(std::span<const LevelTriangle> triangles) {
    VertexTable<Number> table(triangles.size() / 2);
    tile_.indices.reserve(3 * triangles.size());
    for (const LevelTriangle& t : triangles) {
      std::array<uint32_t, 3> v{};
      for (size_t c = 0; c < 3; ++c) v[c] = NumberOf(t[c], &table);
      const auto& p = tile_.positions;
      if (p[v[0]] == p[v[1]] || p[v[1]] == p[v[2]] || p[v[2]] == p[v[0]]) continue;
      tile_.indices.insert(tile_.indices.end(), v.begin(), v.end());
    }
  }

  uint32_t NumberOf(uint32_t vertex, VertexTable<Number>* table) {
    uint32_t& number = table->At(vertex).value;
    if (number != kNone) return number;
    number = static_cast<uint32_t>(tile_.positions.size());
    const LevelVertex& from = mesh_.vertex(vertex);
    tile_.positions.push_back(LatticePoint(from.position, options_.origin, options_.step));
    tile_.normals.push_back(Unit(from.normal));
    if (options_.colours) tile_.colours.push_back(from.rgba);
    is_inside_.push_back(options_.inside.Contains(from.position));
    return number;
  }

  // Edges of one triangle of the tile, where another triangle of the level may go on.
  std::vector<Edge> Border() const {
    std::vector<Edge> edges;
    const auto& indices = tile_.indices;
    for (size_t t = 0; t < indices.size(); t += 3) {
      for (size_t c = 0; c < 3; ++c) {
        const uint32_t a = indices[t + c], b = indices[t + (c + 1) % 3];
        if (is_inside_[a] || is_inside_[b]) continue;
        edges.push_back({std::min(a, b), std::max(a, b), a > b});
      }
    }
    const auto ends = [](const Edge& e) { return std::pair(e.low, e.high); };
    std::sort(edges.begin(), edges.end(),
              [&](const Edge& a, const Edge& b) { return ends(a) < ends(b); });
    std::vector<Edge> border;
    for (size_t i = 0; i < edges.size();) {
      size_t end = i + 1;
      while (end < edges.size() && ends(edges[end]) == ends(edges[i])) ++end;
      if (end == i + 1) border.push_back(edges[i]);
      i = end;
    }
    return border;
  }

  void AddSkirts() {
    std::vector<uint32_t> below(tile_.positions.size(), kNone);
    const auto lowered = [&](uint32_t v) {
      if (below[v] != kNone) return below[v];
      below[v] = static_cast<uint32_t>(tile_.positions.size());
      const Vec3f n = options_.skirt_is_vertical ? Vec3f{0, 0, 1} : tile_.normals[v];
      const double steps = options_.skirt / options_.step;
      Vec3i p = tile_.positions[v];
      for (int i = 0; i < 3; ++i) {
        p[i] -= static_cast<int32_t>(std::lround(static_cast<double>(n[i]) * steps));
      }
      const Vec3f normal = tile_.normals[v];
      tile_.positions.push_back(p);
      tile_.normals.push_back(normal);
      if (options_.colours) {
        const std::array<uint8_t, 4> colour = tile_.colours[v];
        tile_.colours.push_back(colour);
      }
      return below[v];
    };
    for (const Edge& e : Border()) {
      const uint32_t a = e.turned ? e.high : e.low, b = e.turned ? e.low : e.high;
      const uint32_t a_below = lowered(a), b_below = lowered(b);
      // Its front is seen from beside the tile.
      for (const uint32_t v : {b, a, a_below, b, a_below, b_below}) tile_.indices.push_back(v);
    }
  }

  const LevelMesh& mesh_;
  const TileMeshOptions& options_;
  GltfTile tile_;
  std::vector<bool> is_inside_;
};

}  // namespace

GltfTile MakeTileMesh(const LevelMesh& mesh, std::span<const LevelTriangle> triangles,
                      const TileMeshOptions& options) {
  return TileMeshMaker(mesh, options).Make(triangles);
}

}  // namespace mtdb
