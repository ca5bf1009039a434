// SPDX-License-Identifier: Apache-2.0
// The free rule against all triangulations of a ring.
#include <catch2/catch.hpp>
#include <functional>
#include <numbers>
#include <random>
#include <set>
#include <span>

#include "builder/holes/free_filling.h"

namespace mtdb::testing {

using namespace internal;

namespace {

// A ring around the origin, seen along z, whose diagonals have random errors.
Hole RandomHole(uint32_t k, bool boundary, bool folded, std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(0, 1);
  Hole hole;
  hole.k = k;
  hole.boundary = boundary;
  hole.folded = folded;
  const double turn = (boundary ? 1 : 2) * std::numbers::pi / k;
  for (uint32_t i = 0; i < k; ++i) {
    const double angle = turn * (i + 0.6 * uniform(random));
    const double radius = 1 + uniform(random);
    hole.positions[i] = {radius * std::cos(angle), radius * std::sin(angle), uniform(random)};
  }
  hole.apex = {0, 0, 0.5};
  hole.LookAlong({0, 0, 1}, 3);
  for (uint32_t i = 0; i < k; ++i) {
    for (uint32_t j = 0; j < k; ++j) {
      hole.forbidden[i][j] = hole.forbidden[j][i] = random() % 12 == 0;
      hole.edge_error[i][j] = folded || random() % 4 == 0 ? 0 : uniform(random);
      if (!folded && random() % 16 == 0) hole.edge_error[i][j] = -1;
    }
  }
  return hole;
}

// Calls f for every triangulation of ring positions i..j, added to `filling`.
using Visit = std::function<void()>;
void ForEachFilling(std::vector<std::pair<uint32_t, uint32_t>> edges,
                    std::vector<Hole::Triangle>& filling, const Visit& f) {
  while (!edges.empty() && edges.back().second - edges.back().first < 2) edges.pop_back();
  if (edges.empty()) return f();
  const auto [i, j] = edges.back();
  edges.pop_back();
  for (uint32_t m = i + 1; m < j; ++m) {
    filling.push_back({static_cast<uint8_t>(i), static_cast<uint8_t>(m), static_cast<uint8_t>(j)});
    std::vector<std::pair<uint32_t, uint32_t>> more = edges;
    more.emplace_back(i, m);
    more.emplace_back(m, j);
    ForEachFilling(more, filling, f);
    filling.pop_back();
  }
}

// Squared errors of diagonals; infinite when the filling is not legal. Shapes count so little
// that they are left out.
double Cost(const Hole& hole, std::span<const Hole::Triangle> filling) {
  double cost = 0;
  for (const auto& [i, m, j] : filling) {
    const bool closing = i == 0 && j == hole.k - 1u;
    if (!closing && (hole.forbidden[i][j] || hole.edge_error[i][j] < 0)) return 1e9;
    if (Hole::Side(hole.points[i], hole.points[m], hole.points[j]) <= 0) return 1e9;
    if (!closing) cost += hole.edge_error[i][j] * hole.edge_error[i][j];
  }
  return cost;
}

}  // namespace

TEST_CASE("The free filling has the least errors of all triangulations of the ring") {
  std::mt19937 random(3);
  int filled = 0;
  int refused = 0;
  FreeFilling rule;
  for (int run = 0; run < 3000; ++run) {
    const uint32_t k = 3 + random() % 6;
    Hole hole = RandomHole(k, random() % 4 == 0, false, random);
    for (Vec3d& p : hole.positions) p.z *= 1e-3;  // flat: shapes hardly count
    hole.apex.z = 0;
    hole.LookAlong({0, 0, 1}, 1e-3);
    double least = 1e9;
    std::vector<Hole::Triangle> all;
    ForEachFilling({{0, k - 1}}, all, [&] { least = std::min(least, Cost(hole, all)); });
    Hole::Triangles found;
    rule.Open(hole);
    const bool fills = rule.Fill(hole, found);
    REQUIRE(fills == (least < 1e9));
    ++(fills ? filled : refused);
    if (!fills) continue;
    REQUIRE(Cost(hole, std::span(found).first(k - 2)) <= least + 1e-6);
  }
  REQUIRE(filled > 1000);
  REQUIRE(refused > 50);
}

TEST_CASE("A filling's triangles hang on each other and cover the ring") {
  std::mt19937 random(4);
  FreeFilling rule;
  int filled = 0;
  for (int run = 0; run < 2000; ++run) {
    const uint32_t k = 3 + random() % (Hole::kMaxRing - 2);
    const Hole hole = RandomHole(k, random() % 4 == 0, random() % 2 == 0, random);
    Hole::Triangles found;
    rule.Open(hole);
    if (!rule.Fill(hole, found)) continue;
    ++filled;
    std::set<std::pair<uint8_t, uint8_t>> open = {{0, static_cast<uint8_t>(k - 1)}};
    for (uint32_t t = 0; t < k - 2; ++t) {
      const auto [i, m, j] = found[t];
      REQUIRE(i < m);
      REQUIRE(m < j);
      REQUIRE(open.erase({i, j}) == 1);
      if (m > i + 1) open.insert({i, m});
      if (j > m + 1) open.insert({m, j});
    }
    REQUIRE(open.empty());
  }
  REQUIRE(filled > 1000);
}

}  // namespace mtdb::testing
