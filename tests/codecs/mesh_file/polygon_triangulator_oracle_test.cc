// SPDX-License-Identifier: Apache-2.0
// Polygons in integers, so that areas and turns of the answer are known exactly.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <map>
#include <random>
#include <vector>

#include "codecs/mesh_file/polygons/exact_turn.h"
#include "codecs/mesh_file/polygons/polygon_triangulator.h"

namespace mtdb {
namespace {

using internal::PlanePoint;
using internal::PolygonTriangulator;
using internal::TurnOf;
__extension__ using Wide = __int128;

struct Point {
  int64_t x = 0, y = 0;
  friend bool operator==(Point, Point) = default;
};
using Polygon = std::vector<Point>;

Wide Turn(Point a, Point b, Point c) {
  return Wide{b.x - a.x} * (c.y - a.y) - Wide{b.y - a.y} * (c.x - a.x);
}
int SignOf(Wide value) { return (value > 0) - (value < 0); }

Wide TwiceArea(const Polygon& p) {
  Wide area = 0;
  for (size_t i = 2; i < p.size(); ++i) area += Turn(p[0], p[i - 1], p[i]);
  return area;
}

// Ways of putting the plane into space that keep what lies on a line there; the first one turns
// nothing.
Vec3d Placed(Point p, int place) {
  const auto x = static_cast<double>(p.x), y = static_cast<double>(p.y);
  switch (place) {
    case 0: return {x, y, 0};
    case 1: return {5, x, y};
    case 2: return {y, -3, x};
    case 3: return {x, y, 2 * x - 3 * y + 7};
    case 4: return {-x, y, -4 * x + y};
    case 5: return {std::ldexp(x, -900), std::ldexp(y, -900), std::ldexp(x - y, -900)};
    case 6: return {std::ldexp(x, 70), std::ldexp(y, 70), std::ldexp(y + x, 70)};
    default: return {x + 4e6, y + 5e6, 0};
  }
}
constexpr int kPlaces = 8;

struct Answer {
  std::vector<PolygonTriangulator::Triangle> triangles;
  bool is_fan = false;
};
Answer Triangulated(const Polygon& polygon, int place = 0) {
  std::vector<Vec3d> corners;
  for (const Point p : polygon) corners.push_back(Placed(p, place));
  PolygonTriangulator triangulator;
  Answer answer;
  const auto triangles = triangulator.Triangulate(corners, &answer.is_fan);
  answer.triangles.assign(triangles.begin(), triangles.end());
  return answer;
}

// Two fewer triangles than corners; each edge of the outline is of one triangle, each other one of
// two that run along it in opposite directions.
void CheckBorder(const Polygon& polygon, const Answer& answer) {
  REQUIRE(answer.triangles.size() == polygon.size() - 2);
  std::map<std::pair<uint32_t, uint32_t>, int> edges;
  for (const auto& t : answer.triangles) {
    for (int i = 0; i < 3; ++i) ++edges[{t[i], t[(i + 1) % 3]}];
  }
  const auto count = static_cast<uint32_t>(polygon.size());
  for (uint32_t i = 0; i < count; ++i) --edges[{i, (i + 1) % count}];
  for (const auto& [edge, times] : edges) {
    const auto back = edges.find({edge.second, edge.first});
    REQUIRE(times == (back == edges.end() ? 0 : back->second));
  }
}

// All triangles turn as the polygon does, and their areas sum up to its: then they cover what the
// outline goes round once, and nothing else.
void CheckInside(const Polygon& polygon, const Answer& answer, bool all_with_area) {
  REQUIRE_FALSE(answer.is_fan);
  CheckBorder(polygon, answer);
  const Wide area = TwiceArea(polygon);
  Wide sum = 0;
  for (const auto& t : answer.triangles) {
    const Wide turn = Turn(polygon[t[0]], polygon[t[1]], polygon[t[2]]);
    REQUIRE(SignOf(turn) * SignOf(area) >= (all_with_area ? 1 : 0));
    sum += turn;
  }
  REQUIRE(sum == area);
}

bool Cross(Point a, Point b, Point c, Point d) {
  const auto between = [](Point p, Point q, Point r) {
    return Turn(p, q, r) == 0 && std::min(p.x, q.x) <= r.x && r.x <= std::max(p.x, q.x) &&
           std::min(p.y, q.y) <= r.y && r.y <= std::max(p.y, q.y);
  };
  if (SignOf(Turn(a, b, c)) * SignOf(Turn(a, b, d)) < 0 &&
      SignOf(Turn(c, d, a)) * SignOf(Turn(c, d, b)) < 0) {
    return true;
  }
  return between(a, b, c) || between(a, b, d) || between(c, d, a) || between(c, d, b);
}

bool IsSimple(const Polygon& p) {
  const size_t n = p.size();
  for (size_t i = 0; i < n; ++i) {
    for (size_t k = i + 1; k < n; ++k) {
      const Point a = p[i], b = p[(i + 1) % n], c = p[k], d = p[(k + 1) % n];
      if (a == c || a == b) return false;
      if (k == i + 1) {
        if (Turn(a, b, d) == 0 && (b.x - a.x) * (d.x - b.x) + (b.y - a.y) * (d.y - b.y) < 0) {
          return false;
        }
        continue;
      }
      if (i == 0 && k == n - 1) continue;  // seen as k, i
      if (Cross(a, b, c, d)) return false;
    }
  }
  const Point a = p[n - 1], b = p[0], d = p[1];
  return Turn(a, b, d) != 0 || (b.x - a.x) * (d.x - b.x) + (b.y - a.y) * (d.y - b.y) > 0;
}

// Random corners, whose crossing edges are exchanged until there are none.
Polygon RandomSimple(std::mt19937_64* random, size_t corners, int64_t side) {
  for (;;) {
    Polygon p;
    while (p.size() < corners) {
      const Point q{static_cast<int64_t>((*random)() % side),
                    static_cast<int64_t>((*random)() % side)};
      if (std::find(p.begin(), p.end(), q) == p.end()) p.push_back(q);
    }
    for (int tries = 0; tries < 500; ++tries) {
      bool changed = false;
      for (size_t i = 0; i + 2 < corners; ++i) {
        for (size_t k = i + 2; k < corners; ++k) {
          if (i == 0 && k == corners - 1) continue;
          if (!Cross(p[i], p[i + 1], p[k], p[(k + 1) % corners])) continue;
          std::reverse(p.begin() + static_cast<std::ptrdiff_t>(i) + 1,
                       p.begin() + static_cast<std::ptrdiff_t>(k) + 1);
          changed = true;
        }
      }
      if (!changed) break;
    }
    if (IsSimple(p)) return p;
  }
}

Polygon Comb(int teeth) {
  Polygon p{{0, 0}, {4 * teeth, 0}};
  for (int i = teeth; i-- > 0;) {
    for (const Point q :
         {Point{4 * i + 3, 100}, Point{4 * i + 2, 100}, Point{4 * i + 2, 1}, Point{4 * i + 1, 1}}) {
      p.push_back(q);
    }
  }
  p.push_back({0, 1});
  return p;
}

TEST_CASE("the turn of three points is exact") {
  std::mt19937_64 random(7);
  const auto number = [&](int bits) {
    return static_cast<int64_t>(random() >> (64 - bits)) - (int64_t{1} << (bits - 1));
  };
  int zero = 0;
  for (int i = 0; i < 200'000; ++i) {
    const int bits = 3 + static_cast<int>(random() % 50);
    const Point a{number(bits), number(bits)}, b{number(bits), number(bits)};
    // Near the line ab, if not on it.
    Point c{2 * b.x - a.x, 2 * b.y - a.y};
    c.x += static_cast<int64_t>(random() % 3) - 1;
    const double scale = std::ldexp(1, static_cast<int>(random() % 300) - 250);
    const auto point = [&](Point p) {
      return PlanePoint{scale * static_cast<double>(p.x), scale * static_cast<double>(p.y)};
    };
    const int expected = SignOf(Turn(a, b, c));
    zero += expected == 0 ? 1 : 0;
    REQUIRE(TurnOf(point(a), point(b), point(c)) == expected);
  }
  REQUIRE(zero > 1000);
  // Of coordinates of very different sizes.
  REQUIRE(TurnOf({0, 0}, {1, 0}, {0.5, 0x1p-400}) == 1);
  REQUIRE(TurnOf({1e30, 1e30}, {0, 0}, {0x1p-300, -0x1p-300}) == 1);
  REQUIRE(TurnOf({1e30, 1e30}, {0x1p-300, 0x1p-300}, {0, 0}) == 0);
}

TEST_CASE("simple polygons are covered by triangles, wherever they lie in space") {
  std::mt19937_64 random(11);
  for (int i = 0; i < 1500; ++i) {
    CAPTURE(i);
    // Small sides give corners on lines.
    const size_t corners = 4 + random() % (i % 10 == 0 ? 60 : 12);
    Polygon p =
        RandomSimple(&random, corners, i % 3 == 0 ? 10 + static_cast<int64_t>(corners) : 4000);
    if (i % 2 == 0) std::reverse(p.begin(), p.end());
    CheckInside(p, Triangulated(p, i % kPlaces), true);
  }
}

TEST_CASE("a quadrilateral gets the shorter diagonal of those that lie inside") {
  using Triangles = std::vector<PolygonTriangulator::Triangle>;
  const Triangles even{{0, 1, 2}, {0, 2, 3}}, odd{{0, 1, 3}, {1, 2, 3}};
  REQUIRE(Triangulated({{0, 0}, {1, 0}, {1, 1}, {0, 1}}).triangles == even);  // equal ones
  REQUIRE(Triangulated({{0, 0}, {9, 1}, {10, 3}, {1, 2}}).triangles == odd);
  REQUIRE(Triangulated({{0, 2}, {1, -2}, {2, 2}, {1, 1}}).triangles == odd);
  REQUIRE(Triangulated({{1, 1}, {0, 2}, {1, -2}, {2, 2}}).triangles == even);
  REQUIRE(Triangulated({{0, 0}, {2, 0}, {4, 0}, {2, 9}}).triangles == odd);  // a corner on a line
  // A triangle with a corner twice.
  const Polygon twice{{0, 0}, {4, 0}, {2, 3}, {2, 3}};
  CheckInside(twice, Triangulated(twice), false);
}

TEST_CASE("corners on lines, corners twice and bridges to holes are no trouble for polygons") {
  Polygon stairs;
  for (int i = 0; i < 7; ++i) stairs.push_back({i, 0});
  for (int i = 0; i < 5; ++i) stairs.push_back({6, 1 + i});
  for (int i = 0; i < 6; ++i) stairs.push_back({5 - i, 5 - i});
  stairs.pop_back();
  const Polygon hole{{0, 0}, {9, 0}, {9, 9}, {0, 9}, {0, 0},
                     {3, 3}, {3, 6}, {6, 6}, {6, 3}, {3, 3}};
  // Two holes, of which the second hangs on the first.
  const Polygon holes{{0, 0},  {20, 0}, {20, 9}, {0, 9},  {0, 0}, {3, 3}, {3, 6}, {6, 6},
                      {12, 6}, {15, 3}, {12, 3}, {12, 6}, {6, 6}, {6, 3}, {3, 3}};
  // An edge that leads inwards and back.
  const Polygon slit{{0, 0}, {4, 0}, {4, 4}, {2, 2}, {4, 4}, {0, 4}};
  const Polygon square{{0, 0}, {4, 0}, {4, 4}, {0, 4}};
  Polygon twice;
  for (const Point p : square) twice.insert(twice.end(), 3, p);
  const Polygon touching{{0, 0}, {2, -1}, {2, 1}, {0, 0}, {-2, 1}, {-2, -1}};
  // Outwards.
  const Polygon spike{{0, 0}, {4, 0}, {4, 4}, {8, 8}, {4, 4}, {0, 4}};
  for (int place = 0; place < kPlaces; ++place) {
    CAPTURE(place);
    for (const Polygon& p : {stairs, hole, holes, slit}) {
      for (size_t first = 0; first < p.size(); ++first) {
        Polygon turned(p.begin() + static_cast<std::ptrdiff_t>(first), p.end());
        turned.insert(turned.end(), p.begin(), p.begin() + static_cast<std::ptrdiff_t>(first));
        CAPTURE(first);
        CheckInside(turned, Triangulated(turned, place), true);
      }
    }
    for (const Polygon& p : {twice, touching, spike}) {
      CAPTURE(p.size(), p[1].x);
      CheckInside(p, Triangulated(p, place), false);
    }
  }
}

TEST_CASE("a polygon without area keeps its corners; one that crosses itself becomes a fan") {
  const Polygon line{{0, 0}, {1, 1}, {5, 5}, {2, 2}, {2, 2}, {-1, -1}};
  const Polygon point(9, Point{3, 4});
  const Polygon bow{{0, 0}, {4, 4}, {4, 0}, {0, 4}};
  const Polygon star{{0, 0}, {5, 8}, {10, 0}, {0, 5}, {10, 5}};
  for (int place = 0; place < kPlaces; ++place) {
    CAPTURE(place);
    for (const Polygon& p : {line, point}) CheckInside(p, Triangulated(p, place), false);
    for (const Polygon& p : {bow, star}) {
      const Answer answer = Triangulated(p, place);
      REQUIRE(answer.is_fan);
      CheckBorder(p, answer);
      REQUIRE(answer.triangles[0] == PolygonTriangulator::Triangle{0, 1, 2});
    }
  }
}

TEST_CASE("any corners whatever become two fewer triangles with the outline as border") {
  std::mt19937_64 random(5);
  for (int i = 0; i < 3000; ++i) {
    CAPTURE(i);
    Polygon p(4 + random() % 20);
    for (Point& q : p) {
      q = {static_cast<int64_t>(random() % (i % 2 == 0 ? 3 : 40)),
           static_cast<int64_t>(random() % (i % 3 == 0 ? 2 : 30))};
    }
    CheckBorder(p, Triangulated(p, i % kPlaces));
  }
}

TEST_CASE("a hundred thousand corners are cut in any order of corners") {
  const Polygon comb = Comb(25'000);
  CheckInside(comb, Triangulated(comb), true);
  Polygon zigzag;
  for (int i = 0; i < 50'000; ++i) zigzag.push_back({i, i % 2 * 1000});
  for (int i = 50'000; i-- > 0;) zigzag.push_back({i, i % 2 * 1000 + 1});
  CheckInside(zigzag, Triangulated(zigzag), true);
  Polygon repeated;
  for (int i = 0; i < 100'000; ++i) repeated.push_back({i % 3 == 1, i % 3 == 2});
  CheckBorder(repeated, Triangulated(repeated));
  std::mt19937_64 random(3);
  Polygon wild;
  for (int i = 0; i < 100'000; ++i) {
    wild.push_back({static_cast<int64_t>(random() % 1000), static_cast<int64_t>(random() % 1000)});
  }
  const Answer answer = Triangulated(wild);
  REQUIRE(answer.is_fan);
  REQUIRE(answer.triangles.size() == wild.size() - 2);
}

}  // namespace
}  // namespace mtdb
