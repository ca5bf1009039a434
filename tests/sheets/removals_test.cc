// SPDX-License-Identifier: Apache-2.0
// The checker is no stricter than its rules: it accepts all that removing vertices by the rules
// leaves of random complexes.
#include "tests/sheets/removals.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <map>
#include <numeric>

#include "tests/sheets/cut_check.h"
#include "tests/sheets/random_complex.h"

namespace mtdb::sheets {
namespace {

// The faces of the sheets, with the vertices that they use.
Complex ComplexOf(const std::vector<Sheet>& sheets, const std::vector<Point>& points) {
  Complex complex;
  std::vector<uint32_t> number(points.size(), ~0u);
  for (const auto& [corners, two_sided] : sheets) {
    Triangle t = corners;
    for (uint32_t& v : t) {
      if (number[v] == ~0u) {
        number[v] = static_cast<uint32_t>(complex.points.size());
        complex.points.push_back(points[v]);
      }
      v = number[v];
    }
    complex.triangles.push_back(t);
    if (two_sided) complex.triangles.push_back({t[0], t[2], t[1]});
  }
  return complex;
}

// How often a vertex was removed at which so many half-disks met; at 0 the interior ones.
using Orders = std::map<uint32_t, uint64_t>;

uint32_t OrderOf(const SheetGraph& graph, uint32_t v) {
  for (const Edge& edge : graph.edges()) {
    if ((edge.a == v || edge.b == v) && !edge.signature.regular()) return edge.count;
  }
  return 0;
}

// Removes vertices in random order until none can be; returns how many sheets are left.
size_t Simplify(const RandomComplex& made, uint32_t seed, bool drop_extras, Orders* orders) {
  std::mt19937 random(seed);
  Complex complex = made.complex;
  if (drop_extras) {
    complex.triangles.clear();
    for (size_t f = 0; f < made.extras.size(); ++f) {
      if (made.extras[f] == kNoExtra) complex.triangles.push_back(made.complex.triangles[f]);
    }
  }
  SheetGraph graph(complex);
  std::vector<uint32_t> order(complex.points.size());
  std::iota(order.begin(), order.end(), 0u);
  uint64_t removed = 0;
  for (bool any = true; any;) {
    any = false;
    std::shuffle(order.begin(), order.end(), random);
    for (const uint32_t v : order) {
      const auto sheets = RemoveVertex(graph, v, random);
      if (!sheets) continue;
      ++(*orders)[OrderOf(graph, v)];
      graph = SheetGraph(*sheets, complex.points.size());
      any = true;
      if (++removed % 16 != 0) continue;
      const CutReport report = CheckCut(made.complex, ComplexOf(*sheets, complex.points),
                                        {.patches_may_vanish = drop_extras});
      INFO(removed << " removed\n" << report.Text());
      REQUIRE(report.ok());
    }
  }
  const CutReport report = CheckCut(made.complex, ComplexOf(graph.sheets(), complex.points),
                                    {.patches_may_vanish = drop_extras});
  INFO("all removed\n" << report.Text());
  CHECK(report.ok());
  return graph.sheets().size();
}

TEST_CASE("What removals by the rules leave of a complex is accepted as a cut of it") {
  Orders orders;
  for (uint32_t i = 0; i < 10 * kShapes; ++i) {
    const auto shape = static_cast<Shape>(i % kShapes);
    const uint32_t seed = i / kShapes;
    INFO(NameOf(shape) << " " << seed);
    const RandomComplex made = MakeRandomComplex(shape, seed);
    const size_t kept = Simplify(made, seed, false, &orders);
    CHECK(kept < made.complex.triangles.size());
    const size_t left = Simplify(made, seed, true, &orders);
    CHECK(left < made.complex.triangles.size());
  }
  // Interior vertices, borders, and chains at which two sheets and more meet.
  std::string text;
  for (const auto& [order, count] : orders) {
    text += " " + std::to_string(order) + ": " + std::to_string(count);
  }
  INFO("removed by order:" << text);
  for (uint32_t order = 0; order <= 3; ++order) CHECK(orders[order] > 100);
  CHECK(orders.rbegin()->first >= 5);
}

}  // namespace
}  // namespace mtdb::sheets
