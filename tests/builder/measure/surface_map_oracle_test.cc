// SPDX-License-Identifier: Apache-2.0
// The map of a surface onto the meshes that simplify it, as rounds hand it on: paths that are
// whole, and closed ones around each triangle of the surface that can be drawn together.
#include <algorithm>
#include <catch2/catch.hpp>
#include <map>
#include <span>
#include <utility>

#include "builder/holes/tile_mesh.h"
#include "builder/measure/surface_map.h"
#include "builder/measure/tile_surface.h"
#include "tests/builder/fixture.h"
#include "tests/builder/nasty_meshes.h"
#include "tests/builder/rounds.h"

namespace mtdb::testing {

using namespace internal;

namespace {

using Ends = std::pair<uint32_t, uint32_t>;  // of an edge, in the input's numbering

// Where paths run, and along which triangles.
class Paths {
 public:
  // Of the mesh that some rounds have left, and what it stands for.
  Paths(std::span<const TileTriangle> mesh, const TileSurface& surface) : mesh_(mesh) {
    std::map<uint32_t, uint32_t> numbers;
    std::vector<std::array<uint32_t, 3>> corners;
    for (const TileTriangle& t : mesh) {
      auto& made = corners.emplace_back();
      for (size_t c = 0; c < 3; ++c) {
        made[c] = numbers.emplace(t.vertices[c], numbers.size()).first->second;
      }
      for (const uint32_t v : t.vertices) {
        around_[v].push_back(static_cast<uint32_t>(corners.size() - 1));
      }
    }
    PairHalfEdges(corners, static_cast<uint32_t>(numbers.size()), opposites_);
    for (const HeldVertex& h : surface.held) {
      homes_[surface.vertices[h.vertex]] = h.triangle;
    }
    for (const Chord& c : surface.chords) {
      chords_[{surface.vertices[c.from], surface.vertices[c.to]}].push_back(c);
    }
  }

  size_t crossings() const { return crossings_; }

  // The triangles on the path from one end to the other, all but those at vertices of the mesh
  // that it need not touch. Empty: it follows an edge of the mesh, or crosses nothing.
  std::vector<uint32_t> Triangles(uint32_t from, uint32_t to) {
    const bool turned = from > to;
    const auto found = chords_.find(turned ? Ends{to, from} : Ends{from, to});
    if (found == chords_.end()) return {};
    std::vector<Chord> left = found->second;
    std::vector<uint32_t> triangles;
    uint32_t in = kNone32;  // half-edge by which the next one is entered
    while (!left.empty()) {
      const auto next = std::find_if(left.begin(), left.end(), [&](const Chord& c) {
        return in == kNone32 ? c.enters == 3 : 3 * c.triangle + c.enters == in && c.enters != 3;
      });
      REQUIRE(next != left.end());
      triangles.push_back(next->triangle);
      const uint8_t leaves = next->leaves;
      const uint32_t triangle = next->triangle;
      left.erase(next);
      if (leaves == 3) {
        REQUIRE(left.empty());
        break;
      }
      ++crossings_;
      in = opposites_[3 * triangle + leaves];
      REQUIRE(in != kNone32);
      REQUIRE(!left.empty());
    }
    if (turned) std::reverse(triangles.begin(), triangles.end());
    RequirePlace(from, triangles.front());
    RequirePlace(to, triangles.back());
    return triangles;
  }

  // Where a vertex lies: its home, or the triangles around it.
  std::vector<uint32_t> PlacesOf(uint32_t vertex) const {
    const auto home = homes_.find(vertex);
    if (home != homes_.end()) return {home->second};
    return around_.at(vertex);
  }

  // Whether the closed path over a, b and c goes back by the way it came, piece by piece. At a
  // vertex of the mesh it may turn around it either way.
  bool CanBeDrawnTogether(const std::array<uint32_t, 3>& triangle) {
    std::vector<std::vector<uint32_t>> ways(1);
    for (size_t c = 0; c < 3; ++c) {
      const uint32_t from = triangle[c];
      const uint32_t to = triangle[c == 2 ? 0 : c + 1];
      std::vector<uint32_t> piece = Triangles(from, to);
      if (piece.empty()) piece = {CommonPlace(from, to)};
      std::vector<std::vector<uint32_t>> longer;
      for (const auto& way : ways) {
        for (const auto& turn : Turns(way.empty() ? kNone32 : way.back(), piece.front(), from)) {
          longer.push_back(way);
          longer.back().insert(longer.back().end(), turn.begin(), turn.end());
          longer.back().insert(longer.back().end(), piece.begin(), piece.end());
        }
      }
      ways = std::move(longer);
    }
    for (const auto& way : ways) {
      for (const auto& turn : Turns(way.back(), way.front(), triangle[0])) {
        std::vector<uint32_t> closed = way;
        closed.insert(closed.end(), turn.begin(), turn.end());
        closed.push_back(way.front());
        if (Reduced(closed) == 1) return true;
      }
    }
    return false;
  }

 private:
  void RequirePlace(uint32_t vertex, uint32_t triangle) const {
    const std::vector<uint32_t> places = PlacesOf(vertex);
    REQUIRE(std::find(places.begin(), places.end(), triangle) != places.end());
  }
  uint32_t CommonPlace(uint32_t a, uint32_t b) const {
    const std::vector<uint32_t> of_b = PlacesOf(b);
    for (const uint32_t t : PlacesOf(a)) {
      if (std::find(of_b.begin(), of_b.end(), t) != of_b.end()) return t;
    }
    FAIL("an edge of the surface crosses nothing, and its ends lie in different triangles");
    return kNone32;
  }
  uint32_t Beyond(uint32_t triangle, uint32_t side) const {
    const uint32_t o = opposites_[3 * triangle + side];
    return o == kNone32 ? kNone32 : o / 3;
  }
  // The triangles between two at a vertex of the mesh, in either direction; elsewhere nothing.
  std::vector<std::vector<uint32_t>> Turns(uint32_t from, uint32_t to, uint32_t vertex) const {
    if (from == kNone32 || from == to) return {{}};
    REQUIRE(!homes_.contains(vertex));
    std::vector<std::vector<uint32_t>> turns;
    for (const uint32_t step : {2u, 0u}) {
      std::vector<uint32_t> between;
      for (uint32_t at = from; at != kNone32;) {
        const auto& v = mesh_[at].vertices;
        const auto c = static_cast<uint32_t>(std::find(v.begin(), v.end(), vertex) - v.begin());
        at = Beyond(at, (c + step) % 3);
        if (at == to) {
          turns.push_back(between);
          break;
        }
        if (at != kNone32) between.push_back(at);
        if (between.size() > 100) break;
      }
    }
    return turns;
  }
  // What is left of a way from triangle to triangle when it does not go back.
  static size_t Reduced(const std::vector<uint32_t>& way) {
    std::vector<uint32_t> kept;
    for (const uint32_t t : way) {
      if (!kept.empty() && kept.back() == t) continue;
      if (kept.size() > 1 && kept[kept.size() - 2] == t) {
        kept.pop_back();
      } else {
        kept.push_back(t);
      }
    }
    return kept.size();
  }

  std::span<const TileTriangle> mesh_;
  std::vector<uint32_t> opposites_;
  std::map<uint32_t, std::vector<uint32_t>> around_;
  std::map<uint32_t, uint32_t> homes_;
  std::map<Ends, std::vector<Chord>> chords_;
  size_t crossings_ = 0;
};

}  // namespace

TEST_CASE("Closed paths around the surface's triangles can be drawn together on every mesh") {
  const TriangleMesh meshes[] = {MakeSculpture(4000), MakeTerrain(3000), MakeSheet(40, 0.03)};
  const std::vector<size_t> tiles_of_rounds[] = {{1}, {3}, {4, 3}, {4, 3, 2, 1}, {4, 9, 8, 7}};
  for (const TriangleMesh& mesh : meshes) {
    for (const std::vector<size_t>& tiles : tiles_of_rounds) {
      Rounds rounds(mesh, tiles[0], 0.5f);
      for (size_t r = 1; r < tiles.size(); ++r) rounds.Run(tiles[r]);
      CAPTURE(mesh.triangles.size(), tiles.size(), rounds.after.size());
      const TileSurface surface = GatherSurface(rounds.surfaces, rounds.after).value();
      REQUIRE(surface.round == 1);
      for (const Chord& c : surface.chords) REQUIRE(c.error == 0.5f);  // also of edges that pass
      Paths paths(rounds.after, surface);
      for (const TileTriangle& t : rounds.before) {
        if (!paths.CanBeDrawnTogether(t.vertices)) {
          FAIL("around " << t.vertices[0] << ", " << t.vertices[1] << ", " << t.vertices[2]);
        }
      }
      REQUIRE(paths.crossings() > 100);
    }
  }
}

}  // namespace mtdb::testing
