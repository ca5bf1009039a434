// SPDX-License-Identifier: Apache-2.0
#include "tests/sheets/random_complex.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>
#include <random>
#include <set>

namespace mtdb::sheets {
namespace {

constexpr double kPi = 3.14159265358979;
constexpr double kCell = 0.125;  // of grids

class Maker {
 public:
  Maker(Shape shape, uint32_t seed) : random_(seed * 16 + static_cast<uint32_t>(shape)) {
    roughness_ = Uniform(0, 0.03);
  }
  RandomComplex Make(Shape shape);

 private:
  using Corner = std::function<uint32_t(int, int)>;

  int Below(int end) { return static_cast<int>(random_() % static_cast<uint32_t>(end)); }
  int Between(int low, int high) { return low + Below(high - low + 1); }
  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  bool Chance(double part) { return Uniform(0, 1) < part; }

  uint32_t Vertex(Point p);
  void Face(uint32_t a, uint32_t b, uint32_t c) { faces().push_back({a, b, c}); }
  std::vector<Triangle>& faces() { return made_.complex.triangles; }
  // Two triangles for each cell, cut along a random diagonal.
  void Grid(int m, int n, const Corner& corner);
  // A sheet in the plane z = 0; its vertices go to grid_.
  void Floor(int m, int n);
  uint32_t At(int i, int j) const { return grid_[static_cast<size_t>(j * (width_ + 1) + i)]; }
  // Hangs a sheet of `height` rows on a path of vertices, towards `way`.
  void Hang(const std::vector<uint32_t>& foot, int height, Point way);
  void Ball(Point middle, double radius, int splits);
  void Cone(uint32_t apex, Point way, int around);
  void Flap(bool on_edge);
  // Faces whose middles are within `radius` of that of a random one.
  std::vector<size_t> Region(double radius);
  void Reverse(const std::vector<size_t>& region);
  void Copy(const std::vector<size_t>& region);  // in the opposite orientation

  void Book();
  void Wall();
  void Room();
  void Moebius();
  void Touch();
  void Closed();
  void Bulkhead();
  void Mixture();
  void Extras();
  void Shuffle();

  std::mt19937 random_;
  double roughness_ = 0;
  RandomComplex made_;
  std::set<Point> taken_;
  std::vector<uint32_t> grid_;
  int width_ = 0, depth_ = 0;
};

uint32_t Maker::Vertex(Point p) {
  for (double& x : p) {
    x = std::round((x + Uniform(-roughness_, roughness_)) / kLatticeStep) * kLatticeStep;
  }
  while (!taken_.insert(p).second) p[static_cast<size_t>(Below(3))] += kLatticeStep;
  made_.complex.points.push_back(p);
  return static_cast<uint32_t>(made_.complex.points.size() - 1);
}

void Maker::Grid(int m, int n, const Corner& corner) {
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < m; ++i) {
      const uint32_t a = corner(i, j), b = corner(i + 1, j);
      const uint32_t c = corner(i + 1, j + 1), d = corner(i, j + 1);
      if (Chance(0.5)) {
        Face(a, b, c);
        Face(a, c, d);
      } else {
        Face(a, b, d);
        Face(b, c, d);
      }
    }
  }
}

void Maker::Floor(int m, int n) {
  width_ = m;
  depth_ = n;
  for (int j = 0; j <= n; ++j) {
    for (int i = 0; i <= m; ++i) {
      const double bend = 0.1 * std::sin(0.7 * i) * std::cos(0.5 * j);
      grid_.push_back(Vertex({kCell * i, kCell * j, bend}));
    }
  }
  Grid(m, n, [&](int i, int j) { return At(i, j); });
}

void Maker::Hang(const std::vector<uint32_t>& foot, int height, Point way) {
  std::vector<std::vector<uint32_t>> rows{foot};
  for (int h = 1; h <= height; ++h) {
    rows.emplace_back();
    for (const uint32_t v : foot) {
      Point p = made_.complex.points[v];
      for (size_t k = 0; k < 3; ++k) p[k] += kCell * h * way[k];
      rows.back().push_back(Vertex(p));
    }
  }
  const bool other_way = Chance(0.5);
  const auto along = static_cast<int>(foot.size()) - 1;
  Grid(along, height, [&](int i, int j) {
    return rows[static_cast<size_t>(j)][static_cast<size_t>(other_way ? along - i : i)];
  });
}

// A random octahedron, each of whose faces is split in four so many times.
void Maker::Ball(Point middle, double radius, int splits) {
  const auto project = [&](Point p) {
    const double length = std::hypot(p[0], p[1], p[2]);
    for (size_t k = 0; k < 3; ++k) p[k] = middle[k] + p[k] * radius / length;
    return p;
  };
  std::vector<Point> points{{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  std::vector<Triangle> faces;
  for (uint32_t i = 0; i < 8; ++i) {
    const uint32_t x = i & 1, y = 2 + (i >> 1 & 1), z = 4 + (i >> 2);
    const bool mirrored = ((i ^ i >> 1 ^ i >> 2) & 1) != 0;
    faces.push_back({x, mirrored ? z : y, mirrored ? y : z});
  }
  for (int split = 0; split < splits; ++split) {
    std::map<std::pair<uint32_t, uint32_t>, uint32_t> halves;
    const auto half = [&](uint32_t a, uint32_t b) {
      const auto [at, fresh] =
          halves.try_emplace(std::minmax(a, b), static_cast<uint32_t>(points.size()));
      if (fresh) {
        points.push_back({points[a][0] + points[b][0], points[a][1] + points[b][1],
                          points[a][2] + points[b][2]});
      }
      return at->second;
    };
    std::vector<Triangle> finer;
    for (const auto& [a, b, c] : faces) {
      const uint32_t ab = half(a, b), bc = half(b, c), ca = half(c, a);
      for (const Triangle& t : {Triangle{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}}) {
        finer.push_back(t);
      }
    }
    faces = finer;
  }
  std::vector<uint32_t> number;
  for (const Point& p : points) number.push_back(Vertex(project(p)));
  for (const auto& [a, b, c] : faces) Face(number[a], number[b], number[c]);
}

// Two rings around an apex.
void Maker::Cone(uint32_t apex, Point way, int around) {
  const Point tip = made_.complex.points[apex];
  std::array<std::vector<uint32_t>, 2> rings;
  for (size_t r = 0; r < 2; ++r) {
    for (int i = 0; i < around; ++i) {
      const double u = 2 * kPi * i / around, size = kCell * static_cast<double>(r + 1);
      rings[r].push_back(
          Vertex({tip[0] + size * (way[0] + 0.8 * std::cos(u)),
                  tip[1] + size * (way[1] + 0.8 * std::sin(u)), tip[2] + size * way[2]}));
    }
  }
  const auto ring = [&](size_t r, int i) { return rings[r][static_cast<size_t>(i % around)]; };
  for (int i = 0; i < around; ++i) Face(apex, ring(0, i), ring(0, i + 1));
  Grid(around, 1, [&](int i, int j) { return ring(j == 0 ? 1u : 0u, around - i); });
}

// One triangle or two opposite ones, on an edge or a vertex of what is there.
void Maker::Flap(bool on_edge) {
  const Triangle t = faces()[static_cast<size_t>(Below(static_cast<int>(faces().size())))];
  const Point& p = made_.complex.points[t[0]];
  const auto beside = [&] {
    return Vertex(
        {p[0] + Uniform(-0.06, 0.06), p[1] + Uniform(-0.06, 0.06), p[2] + Uniform(0.02, 0.06)});
  };
  const uint32_t a = t[0], b = on_edge ? t[1] : beside(), c = beside();
  Face(a, b, c);
  if (Chance(0.7)) Face(a, c, b);
}

std::vector<size_t> Maker::Region(double radius) {
  const auto middle = [&](size_t f) {
    Point sum{};
    for (const uint32_t v : faces()[f]) {
      for (size_t k = 0; k < 3; ++k) sum[k] += made_.complex.points[v][k] / 3;
    }
    return sum;
  };
  const Point from = middle(static_cast<size_t>(Below(static_cast<int>(faces().size()))));
  std::vector<size_t> region;
  for (size_t f = 0; f < faces().size(); ++f) {
    const Point p = middle(f);
    if (std::hypot(p[0] - from[0], p[1] - from[1], p[2] - from[2]) < radius) region.push_back(f);
  }
  return region;
}

void Maker::Reverse(const std::vector<size_t>& region) {
  for (const size_t f : region) std::swap(faces()[f][1], faces()[f][2]);
}

void Maker::Copy(const std::vector<size_t>& region) {
  for (const size_t f : region) {
    const auto [a, b, c] = faces()[f];
    Face(a, c, b);
  }
}

void Maker::Book() {
  const int pages = Between(3, 7), length = Between(3, 8);
  const int width = std::clamp(260 / (2 * pages * length), 2, 6);
  std::vector<uint32_t> spine;
  for (int i = 0; i <= length; ++i) spine.push_back(Vertex({0.04 * std::sin(i), 0, kCell * i}));
  for (int page = 0; page < pages; ++page) {
    const double angle = 2 * kPi * (page + Uniform(0, 0.5)) / pages;
    const size_t from = faces().size();
    Hang(spine, width, {std::cos(angle), std::sin(angle), 0});
    if (!Chance(0.25) || page + 1 < pages / 2) continue;
    std::vector<size_t> region(faces().size() - from);
    std::iota(region.begin(), region.end(), from);
    Copy(region);
  }
}

void Maker::Wall() {
  Floor(Between(6, 10), Between(5, 8));
  const int row = Between(1, depth_ - 1), first = Between(0, 2);
  std::vector<uint32_t> foot;
  for (int i = first; i <= width_ - Between(0, 2); ++i) foot.push_back(At(i, row));
  Hang(foot, Between(2, 5), {0, Uniform(-0.3, 0.3), 1});
}

void Maker::Room() {
  Floor(Between(6, 9), Between(6, 9));
  const int row = Between(2, depth_ - 2), column = Between(2, width_ - 2), height = Between(2, 3);
  std::vector<uint32_t> foot, other;
  for (int i = 0; i <= width_; ++i) foot.push_back(At(i, row));
  const auto first = static_cast<uint32_t>(made_.complex.points.size());
  Hang(foot, height, {0, 0, 1});
  // The second wall ends at the first one.
  std::vector<std::vector<uint32_t>> rows(static_cast<size_t>(height) + 1);
  for (int j = 0; j <= row; ++j) rows[0].push_back(At(column, j));
  for (int h = 1; h <= height; ++h) {
    for (int j = 0; j < row; ++j) {
      Point p = made_.complex.points[At(column, j)];
      p[2] += kCell * h;
      rows[static_cast<size_t>(h)].push_back(Vertex(p));
    }
    rows[static_cast<size_t>(h)].push_back(first +
                                           static_cast<uint32_t>((h - 1) * (width_ + 1) + column));
  }
  Grid(row, height,
       [&](int i, int j) { return rows[static_cast<size_t>(j)][static_cast<size_t>(i)]; });
}

void Maker::Moebius() {
  const int around = Between(8, 24), across = Between(2, std::min(6, 190 / around));
  for (int i = 0; i < around; ++i) {
    const double u = 2 * kPi * i / around;
    for (int j = 0; j <= across; ++j) {
      const double w = 0.5 * (static_cast<double>(j) / across - 0.5), r = 0.6 + w * std::cos(u / 2);
      grid_.push_back(Vertex({r * std::cos(u), r * std::sin(u), w * std::sin(u / 2)}));
    }
  }
  Grid(around, across, [&](int i, int j) {
    return grid_[static_cast<size_t>(i == around ? across - j : i * (across + 1) + j)];
  });
}

void Maker::Touch() {
  const uint32_t apex = Vertex({0, 0, 0});
  const int fans = Between(2, 4);
  constexpr std::array<Point, 4> kWays = {
      Point{0, 0, 1}, {0, 0, -1}, {1.5, 1.5, 0.2}, {-1.5, -1.5, 0.3}};
  for (int fan = 0; fan < fans; ++fan) Cone(apex, kWays[static_cast<size_t>(fan)], Between(5, 12));
}

void Maker::Closed() {
  const int balls = Between(1, 3);
  for (int ball = 0; ball < balls; ++ball) {
    const size_t from = faces().size();
    const Point middle{0.8 * ball, Uniform(0, 0.1), Uniform(0, 0.1)};
    Ball(middle, Uniform(0.2, 0.35), ball == 0 ? 2 : Between(0, 1));
    std::vector<size_t> region(faces().size() - from);
    std::iota(region.begin(), region.end(), from);
    if (Chance(0.3)) Reverse(region);
    if (Chance(0.3)) Copy(region);
  }
}

void Maker::Bulkhead() {
  const int around = Between(6, 12), along = Between(3, 6), at = Between(1, along - 1);
  for (int j = 0; j <= along; ++j) {
    for (int i = 0; i < around; ++i) {
      const double u = 2 * kPi * i / around;
      grid_.push_back(Vertex({0.3 * std::cos(u), 0.3 * std::sin(u), kCell * j}));
    }
  }
  const auto tube = [&](int i, int j) {
    return grid_[static_cast<size_t>(j * around + i % around)];
  };
  Grid(around, along, tube);
  std::vector<uint32_t> inner;
  for (int i = 0; i < around; ++i) {
    const double u = 2 * kPi * i / around;
    inner.push_back(Vertex({0.15 * std::cos(u), 0.15 * std::sin(u), kCell * at + 0.05}));
  }
  const auto ring = [&](int i) { return inner[static_cast<size_t>(i % around)]; };
  Grid(around, 1, [&](int i, int j) { return j == 0 ? tube(i, at) : ring(i); });
  const uint32_t middle = Vertex({0, 0, kCell * at + 0.08});
  for (int i = 0; i < around; ++i) Face(middle, ring(i), ring(i + 1));
}

void Maker::Mixture() {
  Floor(Between(7, 9), Between(6, 8));
  Copy(Region(0.3));
  std::vector<uint32_t> foot;
  for (int i = 1; i < width_; ++i) foot.push_back(At(i, depth_ / 2));
  Hang(foot, Between(2, 3), {0, 0.2, 1});
  Cone(At(2, 1), {0, 0, -1}, Between(4, 6));
  Reverse(Region(0.2));
}

void Maker::Extras() {
  if (Chance(0.4)) Reverse(Region(Uniform(0.05, 0.35)));
  if (Chance(0.4) && faces().size() < 250) Copy(Region(Uniform(0.05, 0.35)));
  made_.extras.assign(faces().size(), kNoExtra);
  uint32_t extra = 0;
  const auto add = [&](int count, const std::function<void()>& make) {
    for (; count > 0; --count) {
      make();
      made_.extras.resize(faces().size(), extra++);
    }
  };
  add(Below(4), [&] { Flap(Chance(0.5)); });
  add(Below(3), [&] {
    const Point middle{Uniform(0, 0.8), Uniform(0, 0.8), Uniform(0.2, 0.3)};
    Ball(middle, Uniform(0.02, 0.06), 0);
  });
  for (int again = Below(3); again > 0; --again) faces().push_back(faces()[0]);
  made_.extras.resize(faces().size(), kNoExtra);
}

void Maker::Shuffle() {
  std::vector<uint32_t> to(made_.complex.points.size()), order(faces().size());
  std::iota(to.begin(), to.end(), 0u);
  std::iota(order.begin(), order.end(), 0u);
  std::shuffle(to.begin(), to.end(), random_);
  std::shuffle(order.begin(), order.end(), random_);
  const RandomComplex before = made_;
  for (size_t v = 0; v < to.size(); ++v) made_.complex.points[to[v]] = before.complex.points[v];
  for (size_t f = 0; f < order.size(); ++f) {
    Triangle t = before.complex.triangles[order[f]];
    for (uint32_t& v : t) v = to[v];
    std::rotate(t.begin(), t.begin() + Below(3), t.end());
    faces()[f] = t;
    made_.extras[f] = before.extras[order[f]];
  }
}

RandomComplex Maker::Make(Shape shape) {
  switch (shape) {
    case Shape::kBook: Book(); break;
    case Shape::kWall: Wall(); break;
    case Shape::kRoom: Room(); break;
    case Shape::kMoebius: Moebius(); break;
    case Shape::kSeam:
      Floor(Between(6, 12), Between(6, 12));
      Reverse(Region(Uniform(0.2, 0.6)));
      break;
    case Shape::kPatch:
      Floor(Between(6, 9), Between(6, 9));
      Copy(Region(Uniform(0.2, 0.5)));
      break;
    case Shape::kTouch: Touch(); break;
    case Shape::kClosed: Closed(); break;
    case Shape::kBulkhead: Bulkhead(); break;
    case Shape::kMixture: Mixture(); break;
  }
  Extras();
  std::set<Triangle> seen;
  for (Triangle t : faces()) {
    std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
    made_.duplicates += seen.insert(t).second ? 0 : 1;
  }
  Shuffle();
  return made_;
}

}  // namespace

std::string NameOf(Shape shape) {
  constexpr std::array<const char*, kShapes> kNames = {
      "book",  "wall",  "room",   "Moebius band", "seam",
      "patch", "touch", "closed", "bulkhead",     "mixture"};
  return kNames[static_cast<size_t>(shape)];
}

RandomComplex MakeRandomComplex(Shape shape, uint32_t seed) {
  return Maker(shape, seed).Make(shape);
}

}  // namespace mtdb::sheets
