// SPDX-License-Identifier: Apache-2.0
// The corner join against the definitions of input_oracle.h, on random triangle soups, with memory
// for everything and with next to none.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>
#include <random>

#include "builder/intake/input_spool.h"
#include "builder/surface/corner_join.h"
#include "tests/builder/fixture.h"
#include "tests/builder/input_oracle.h"
#include "tests/support/oriented_mesh.h"

namespace mtdb::testing {

using namespace internal;

namespace {

const SpoolSpace& Space() {
  static const SpoolSpace kSpace{std::filesystem::temp_directory_path().string()};
  return kSpace;
}

// The smallest index first, as the oracle has it; flags follow.
TileTriangle Rotated(TileTriangle t) {
  for (int turn = 0; turn < 2 && (t.vertices[0] > t.vertices[1] || t.vertices[0] > t.vertices[2]);
       ++turn) {
    t.vertices = {t.vertices[1], t.vertices[2], t.vertices[0]};
    t.positions = {t.positions[1], t.positions[2], t.positions[0]};
    const TileTriangle before = t;
    for (uint32_t c = 0; c < 3; ++c) {
      t.set_order(c, before.order((c + 1) % 3));
      t.set_fixed(c, before.fixed((c + 1) % 3));
      t.set_fan(c, before.fan((c + 1) % 3));
      t.set_more_fans(c, before.more_fans((c + 1) % 3));
    }
  }
  return t;
}

// With the input's numbers of vertices. Those with several fans have a number for each, behind the
// input's, in the order of the vertices.
TileTriangle Unfanned(TileTriangle t, const InputOracle& oracle) {
  for (uint32_t c = 0; c < 3; ++c) {
    if (t.vertices[c] < oracle.report.vertices) continue;
    const uint32_t seat = t.seat(c);
    const auto fanned = std::ranges::find_if(oracle.fans, [&](const auto& at) {
      return oracle.FirstNumber(at.first) == seat && t.fan(c) < at.second;
    });
    REQUIRE(fanned != oracle.fans.end());
    t.vertices[c] = static_cast<uint32_t>(fanned->first);
  }
  return t;
}

// As seen from the other side.
TileTriangle TurnedOver(TileTriangle t) {
  const TileTriangle before = t;
  for (uint32_t c = 0; c < 3; ++c) {
    const uint32_t from = (3 - c) % 3;
    t.vertices[c] = before.vertices[from];
    t.positions[c] = before.positions[from];
    t.set_fixed(c, before.fixed(from));
    t.set_fan(c, before.fan(from));
    t.set_more_fans(c, before.more_fans(from));
    t.set_order(c, before.order(2 - c));
  }
  return t;
}

// Whether two triangles run through their common edge in one direction.
bool RunAlong(const TriangleVertices& a, const TriangleVertices& b) {
  for (size_t i = 0; i < 3; ++i) {
    for (size_t j = 0; j < 3; ++j) {
      if (a[i] == b[j] && a[(i + 1) % 3] == b[(j + 1) % 3]) return true;
    }
  }
  return false;
}

// `turned`: the kept triangles that were turned over. Neighbours that are two-sided run through the
// edges between them in opposite directions where the whole sheet can; else none was turned.
void RequireSheetsRunAlike(const InputOracle& oracle, const std::vector<bool>& turned) {
  const size_t count = oracle.kept.size();
  struct Neighbours {
    size_t a, b;
    bool along;
  };
  std::vector<Neighbours> pairs;
  for (const auto& [edge, uses] : oracle.uses) {
    if (uses != std::vector<int>{0, 0}) continue;
    std::vector<size_t> both;
    for (size_t i = 0; i < count; ++i) {
      const TriangleVertices& t = oracle.kept[i];
      if (std::ranges::count(t, edge.first) + std::ranges::count(t, edge.second) == 2) {
        both.push_back(i);
      }
    }
    pairs.push_back({both[0], both[1], RunAlong(oracle.kept[both[0]], oracle.kept[both[1]])});
  }
  // Each sheet's triangles get the sides that its first one asks for, as far as that goes.
  std::vector<int> side(count, -1);
  std::vector<size_t> sheet(count);
  std::set<size_t> one_sided;
  for (size_t first = 0; first < count; ++first) {
    if (!oracle.two_sided[first] || side[first] >= 0) continue;
    side[first] = 0;
    sheet[first] = first;
    for (bool more = true; more;) {
      more = false;
      for (auto [a, b, along] : pairs) {
        if (side[a] < 0) std::swap(a, b);
        if (side[a] < 0 || sheet[a] != first) continue;
        const int wanted = along ? 1 - side[a] : side[a];
        if (side[b] < 0) {
          side[b] = wanted;
          sheet[b] = first;
          more = true;
        } else if (side[b] != wanted) {
          one_sided.insert(first);
        }
      }
    }
  }
  for (const auto& [a, b, along] : pairs) {
    if (one_sided.contains(sheet[a])) continue;
    REQUIRE((turned[a] != turned[b]) == along);
  }
  for (size_t i = 0; i < count; ++i) {
    if (oracle.two_sided[i] && one_sided.contains(sheet[i])) REQUIRE_FALSE(turned[i]);
  }
}

void RequireAgreement(const TriangleMesh& mesh, size_t memory_bytes, unsigned threads) {
  const InputOracle oracle(mesh.triangles, mesh.positions.size());
  InputSpool input(&Space(), memory_bytes, false);
  const Status sent = SendMesh(mesh, input);
  if (oracle.kept.empty()) {
    REQUIRE(sent.code() == StatusCode::kBadInput);
    return;
  }
  REQUIRE(sent.ok());
  REQUIRE(input.report().degenerate_triangles == oracle.report.degenerate_triangles);
  Grid grid;
  grid.step = 1e-3;
  JoinTotals totals;
  std::vector<TileTriangle> found;
  bool rows_fit = true;
  const size_t row = mesh.header.attributes.row_bytes();
  const Status joined = JoinCorners(
      input, grid, {&Space(), memory_bytes, memory_bytes / 2, threads}, &totals,
      [&](const TriangleBlock& block) {
        rows_fit &= block.rows.size() == 3 * row * block.triangles.size();
        const std::byte* rows = block.rows.data();
        for (const TileTriangle& t : block.triangles) {
          const TileTriangle named = Unfanned(t, oracle);
          for (uint32_t c = 0; c < 3; ++c, rows += row) {
            const uint32_t v = named.vertices[c];
            rows_fit &= row == 0 || std::memcmp(rows, mesh.rows.data() + v * row, row) == 0;
            rows_fit &= t.positions[c] == grid.Quantize(mesh.positions[v]);
          }
          found.push_back(Rotated(named));
        }
        return Status::Ok();
      });
  INFO(joined.message());
  REQUIRE(joined.ok());
  REQUIRE(rows_fit);
  REQUIRE(totals.vertices == oracle.at.size());
  REQUIRE(totals.triangles == oracle.kept.size() + oracle.report.two_sided_triangles);
  REQUIRE(totals.two_sided_triangles == oracle.report.two_sided_triangles);
  REQUIRE(totals.boundary_edges == oracle.BorderEdges());
  REQUIRE(totals.unreferenced_vertices == oracle.report.unreferenced_vertices);
  REQUIRE(totals.duplicate_triangles == oracle.report.duplicate_triangles);
  REQUIRE(totals.nonmanifold_edges == oracle.report.nonmanifold_edges);
  REQUIRE(totals.inconsistent_edges == oracle.report.inconsistent_edges);
  const OrientedMesh sheets = OrientByDefinition(mesh.triangles);
  REQUIRE(totals.sheets.unorientable_sheets == sheets.unorientable_sheets);
  REQUIRE(totals.nonmanifold_vertices == oracle.report.nonmanifold_vertices);
  const std::vector<TileTriangle> expected = ClassifiedTriangles(mesh, grid);
  REQUIRE(found.size() == expected.size());
  std::vector<bool> turned;
  for (size_t i = 0; i < expected.size(); ++i) {
    INFO("triangle " << i);
    TileTriangle wanted = Rotated(Unfanned(expected[i], oracle));
    turned.push_back(found[i].vertices != wanted.vertices);
    if (turned.back()) wanted = TurnedOver(wanted);
    REQUIRE((!turned.back() || wanted.two_sided()));
    REQUIRE(found[i].vertices == wanted.vertices);  // the input's order
    REQUIRE(found[i].edges == wanted.edges);
    REQUIRE(found[i].fans == wanted.fans);
    REQUIRE(found[i].child == kNone32);
  }
  RequireSheetsRunAlike(oracle, turned);
}

TriangleMesh WithVertices(uint64_t count, std::mt19937& random) {
  TriangleMesh mesh;
  std::uniform_real_distribution<float> uniform(-1, 1);
  for (uint64_t v = 0; v < count; ++v) {
    mesh.positions.push_back({uniform(random), uniform(random), uniform(random)});
  }
  if (random() % 2 == 0) NumberVertices(&mesh);
  return mesh;
}

}  // namespace

TEST_CASE("Random soups are classified as the definitions say") {
  std::mt19937 random(1);
  for (int i = 0; i < 3000; ++i) {
    INFO("soup " << i);
    const uint64_t vertices = 3 + random() % 10;
    TriangleMesh soup = WithVertices(vertices, random);
    soup.triangles.resize(random() % 25);
    for (TriangleVertices& t : soup.triangles) {
      t = {random() % vertices, random() % vertices, random() % vertices};
    }
    RequireAgreement(soup, i % 2 == 0 ? 1 << 20 : 64, 1 + i % 3);
  }
}

TEST_CASE("Manifold pieces with few faults are classified as the definitions say") {
  std::mt19937 random(2);
  for (int i = 0; i < 400; ++i) {
    INFO("mesh " << i);
    // A torus of 4 x 4 cells, renumbered, some triangles gone, turned, or glued by a vertex.
    TriangleMesh mesh = WithVertices(20, random);
    std::vector<VertexIndex> number(20);
    for (size_t v = 0; v < number.size(); ++v) number[v] = v;
    std::shuffle(number.begin(), number.end(), random);
    std::vector<TriangleVertices>& list = mesh.triangles;
    for (size_t y = 0; y < 4; ++y) {
      for (size_t x = 0; x < 4; ++x) {
        const size_t r = (x + 1) % 4;
        const size_t u = (y + 1) % 4;
        list.push_back({number[4 * y + x], number[4 * y + r], number[4 * u + r]});
        list.push_back({number[4 * y + x], number[4 * u + r], number[4 * u + x]});
      }
    }
    if (random() % 3 == 0) {  // parts are two-sided; which side comes first is left to chance
      const size_t one_sided = list.size();
      for (size_t t = random() % one_sided; t < one_sided; ++t) {
        const TriangleVertices side = list[t];
        if (random() % 10 != 0) list.push_back({side[0], side[2], side[1]});
      }
    }
    std::shuffle(list.begin(), list.end(), random);
    list.resize(list.size() - random() % 12);
    if (random() % 3 == 0) std::swap(list[0][0], list[0][1]);
    if (random() % 3 == 0) {
      const VertexIndex from = random() % 20;
      const VertexIndex to = random() % 20;
      for (TriangleVertices& t : list) std::replace(t.begin(), t.end(), from, to);
    }
    RequireAgreement(mesh, i % 2 == 0 ? 1 << 20 : 200, 1 + i % 3);
  }
}

TEST_CASE("A surface larger than the memory is classified as the definitions say") {
  TriangleMesh mesh = MakeTerrain(20000);
  std::mt19937 random(3);
  for (int i = 0; i < 60; ++i) {
    TriangleVertices& t = mesh.triangles[random() % mesh.triangles.size()];
    switch (random() % 3) {
      case 0: std::swap(t[0], t[1]); break;
      case 1: t[random() % 3] = random() % mesh.positions.size(); break;
      default: t = mesh.triangles[random() % mesh.triangles.size()];
    }
  }
  std::shuffle(mesh.triangles.begin(), mesh.triangles.end(), random);
  NumberVertices(&mesh);
  for (const size_t memory : {size_t{64} << 20, size_t{100000}}) {
    RequireAgreement(mesh, memory, 1);
    RequireAgreement(mesh, memory, 4);
  }
}

TEST_CASE("An index out of range is named") {
  TriangleMesh mesh;
  mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  mesh.triangles = {{0, 1, 2}, {2, 1, 3}};
  InputSpool input(&Space(), 1 << 20, false);
  const Status status = SendMesh(mesh, input);
  REQUIRE(status.code() == StatusCode::kBadInput);
  REQUIRE(status.message() == "triangle 1: vertex index 3, but the mesh has 3 vertices");
}

TEST_CASE("An error of the receiver ends the join") {
  const TriangleMesh mesh = MakeTerrain(40000);
  InputSpool input(&Space(), 1 << 20, false);
  REQUIRE(SendMesh(mesh, input).ok());
  JoinTotals totals;
  int calls = 0;
  const Status status = JoinCorners(
      input, Grid{}, {&Space(), 1 << 20, 2}, &totals,
      [&](const TriangleBlock&) { return ++calls == 2 ? IoError("stop") : Status::Ok(); });
  REQUIRE(status.code() == StatusCode::kIoError);
  REQUIRE(calls == 2);
}

}  // namespace mtdb::testing
