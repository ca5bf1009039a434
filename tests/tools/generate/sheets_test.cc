// SPDX-License-Identifier: Apache-2.0
// What the shape "sheets" is made of, counted edge by edge.
#include "tools/generate/internal/sheets.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <vector>

#include "store/base/geometry.h"
#include "tools/generate/generate.h"

namespace mtdb {
namespace {

using internal::PlanSheets;
using internal::SheetsPlan;

TriangleMesh Make(uint64_t triangles, uint64_t seed = 1) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  REQUIRE(GenerateSheets({.triangles = triangles, .seed = seed}, sink).ok());
  return mesh;
}

// A triangle and its opposite count as one sheet.
struct Counts {
  uint64_t pairs = 0, duplicates = 0, components = 0;
  std::map<uint64_t, uint64_t> edges_by_sheets, edges_by_faces;
  uint64_t flag_border = 0;             // edges of a two-sided and a one-sided sheet
  uint64_t disagreeing = 0;             // edges of two one-sided sheets that run the same way
  int64_t euler = 0;                    // vertices - edges + sheets
  double area = 0, two_sided_area = 0;  // of sheets without the others' edges of one sheet
};

struct EdgeCount {
  uint64_t sheets = 0, faces = 0, two_sided = 0;
  int64_t turn = 0;
};

Counts Count(const TriangleMesh& mesh) {
  Counts counts;
  std::map<TriangleVertices, std::set<TriangleVertices>> sheets;
  for (TriangleVertices t : mesh.triangles) {
    std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
    TriangleVertices key = t;
    std::sort(key.begin(), key.end());
    counts.duplicates += sheets[key].insert(t).second ? 0 : 1;
  }
  std::map<std::pair<uint64_t, uint64_t>, EdgeCount> edges;
  std::vector<uint64_t> root(mesh.positions.size());
  std::iota(root.begin(), root.end(), 0);
  const auto find = [&](uint64_t v) {
    while (root[v] != v) v = root[v] = root[root[v]];
    return v;
  };
  for (const auto& [key, sides] : sheets) {
    const bool pair = sides.size() == 2;
    counts.pairs += pair;
    const TriangleVertices& t = *sides.begin();
    for (size_t i = 0; i < 3; ++i) {
      const uint64_t a = t[i], b = t[(i + 1) % 3];
      root[find(a)] = find(b);
      EdgeCount& edge = edges[{std::min(a, b), std::max(a, b)}];
      ++edge.sheets;
      edge.faces += sides.size();
      edge.two_sided += pair;
      edge.turn += a < b ? 1 : -1;
    }
  }
  for (const auto& [ends, edge] : edges) {
    ++counts.edges_by_sheets[edge.sheets];
    ++counts.edges_by_faces[edge.faces];
    counts.flag_border += edge.sheets == 2 && edge.two_sided == 1;
    counts.disagreeing += edge.sheets == 2 && edge.two_sided == 0 && edge.turn != 0;
  }
  for (uint64_t v = 0; v < root.size(); ++v) counts.components += find(v) == v;
  counts.euler =
      static_cast<int64_t>(root.size() + sheets.size()) - static_cast<int64_t>(edges.size());
  return counts;
}

double AreaOf(const TriangleMesh& mesh, const TriangleVertices& t) {
  const Vec3d a = mesh.positions[t[0]];
  return Length(Cross(mesh.positions[t[1]] - a, mesh.positions[t[2]] - a)) / 2;
}

TEST_CASE("sheets have the fins, flaps, crumbs and copies that they are said to have") {
  for (const uint64_t triangles : {10'000u, 40'000u, 400'000u}) {
    const TriangleMesh mesh = Make(triangles);
    const SheetsPlan plan = PlanSheets(triangles, 1);
    INFO(triangles << " wanted, " << mesh.triangles.size() << " made");
    CHECK(plan.fins == triangles / 400);
    CHECK(plan.flaps == triangles / 400 * 3 / 2);
    CHECK(plan.crumbs == triangles / 80);
    CHECK(std::abs(static_cast<double>(mesh.triangles.size()) / static_cast<double>(triangles) -
                   1) < 0.03);
    const Counts counts = Count(mesh);
    CHECK(counts.duplicates == 0);
    CHECK(counts.disagreeing == 0);
    // Three sheets at the feet of fins, and where flaps hang on edges.
    CHECK(counts.edges_by_sheets.at(3) == plan.fin_columns + (plan.flaps + 1) / 2);
    // The other three sides of fins, and what does not hang of flaps.
    CHECK(counts.edges_by_sheets.at(1) ==
          plan.fin_columns + 2 * plan.fin_rows + (plan.flaps + 1) / 2 * 2 + plan.flaps / 2 * 3);
    CHECK(counts.edges_by_sheets.size() == 3);
    CHECK(counts.edges_by_faces.at(1) == plan.fin_columns + 2 * plan.fin_rows);
    CHECK(counts.edges_by_faces.at(3) + counts.flag_border > plan.fin_columns / 2);
    // Everything but crumbs hangs together, and a torus has the characteristic 0.
    CHECK(counts.components == plan.crumbs + 1);
    CHECK(counts.euler == static_cast<int64_t>(2 * plan.crumbs));
    const uint64_t fewest_corners = 10 * 4;  // of ten patches' borders
    CHECK(counts.flag_border > fewest_corners);
  }
}

TEST_CASE("a third of the base has opposite copies, and all of it looks outward") {
  const uint64_t triangles = 100'000;
  const TriangleMesh mesh = Make(triangles);
  const SheetsPlan plan = PlanSheets(triangles, 1);
  const uint64_t base = plan.columns * plan.rows;
  double area = 0, copies = 0, volume = 0, least = 1e300;
  for (size_t f = 0; f < mesh.triangles.size(); ++f) {
    const TriangleVertices& t = mesh.triangles[f];
    least = std::min(least, AreaOf(mesh, t));
    if (std::max({t[0], t[1], t[2]}) >= base) continue;
    const bool copy = f > 0 && t[0] == mesh.triangles[f - 1][0] &&
                      t[1] == mesh.triangles[f - 1][2] && t[2] == mesh.triangles[f - 1][1];
    (copy ? copies : area) += AreaOf(mesh, t);
    if (copy) continue;
    volume += Dot(mesh.positions[t[0]], Cross(mesh.positions[t[1]], mesh.positions[t[2]])) / 6;
  }
  CHECK(copies / area == Approx(1.0 / 3).margin(0.015));
  CHECK(least > 0);
  // Of a torus of radii 1 and 0.4: 2 pi^2 r^2.
  CHECK(volume == Approx(3.16).epsilon(0.1));
}

TEST_CASE("crumbs are closed, look outward and float above the base") {
  const uint64_t triangles = 40'000;
  const TriangleMesh mesh = Make(triangles);
  const uint64_t crumbs = PlanSheets(triangles, 1).crumbs;
  // They come last, four or eight triangles each, with vertices of their own.
  std::map<VertexIndex, std::vector<TriangleVertices>> by_first;
  uint64_t found = 0;
  size_t end = mesh.triangles.size();
  VertexIndex vertices = mesh.positions.size();
  while (found < crumbs) {
    size_t begin = end;
    VertexIndex least = vertices;
    // Downwards, until 2 of the edges' triangles are there for each edge.
    for (const size_t size : {4u, 8u}) {
      std::set<VertexIndex> corners;
      for (size_t f = end - size; f < end; ++f) {
        corners.insert(mesh.triangles[f].begin(), mesh.triangles[f].end());
      }
      if (corners.size() != (size == 4 ? 4u : 6u) || *corners.rbegin() + 1 != vertices) continue;
      begin = end - size;
      least = *corners.begin();
    }
    REQUIRE(begin < end);
    double volume = 0;
    for (size_t f = begin; f < end; ++f) {
      const TriangleVertices& t = mesh.triangles[f];
      const Vec3d from = mesh.positions[least];
      volume += Dot(mesh.positions[t[0]] - from,
                    Cross(mesh.positions[t[1]] - from, mesh.positions[t[2]] - from)) /
                6;
    }
    REQUIRE(volume > 0);
    end = begin;
    vertices = least;
    ++found;
  }
  CHECK(vertices < mesh.positions.size());
}

TEST_CASE("small requests for sheets give a base, and other seeds other sheets") {
  for (const uint64_t triangles : {100u, 500u, 1'000u, 3'000u}) {
    const Counts counts = Count(Make(triangles));
    CHECK(counts.duplicates == 0);
    CHECK(counts.edges_by_sheets.at(2) > 100);
  }
  const TriangleMesh one = Make(10'000, 1), again = Make(10'000, 1), other = Make(10'000, 2);
  CHECK(one.positions == again.positions);
  CHECK(one.triangles == again.triangles);
  CHECK(one.positions != other.positions);
  const Counts counts = Count(other);
  CHECK(counts.components == PlanSheets(10'000, 2).crumbs + 1);
}

}  // namespace
}  // namespace mtdb
