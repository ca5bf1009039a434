// SPDX-License-Identifier: Apache-2.0
// The checker has teeth: cuts by hand that are right pass, and what is wrong with a cut is said.
#include "tests/sheets/cut_check.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <random>
#include <set>

#include "tests/sheets/random_complex.h"
#include "tests/sheets/sheet_graph.h"

namespace mtdb::sheets {
namespace {

// Pages of 4 x 2 cells on a spine of vertices 0..4; a page p has vertices 5 + 10 p ... of its own,
// those of its middle first, then those of its far side.
Complex Book(uint32_t pages) {
  Complex book;
  for (uint32_t i = 0; i < 5; ++i) book.points.push_back({0, 0, static_cast<double>(i)});
  for (uint32_t page = 0; page < pages; ++page) {
    const double x = 0.25 * page - 0.5, y = 1;
    const uint32_t own = 5 + 10 * page;
    for (uint32_t i = 0; i < 10; ++i) {
      const double r = i < 5 ? 1 : 2;
      book.points.push_back({r * x, r * y, static_cast<double>(i % 5)});
    }
    for (uint32_t i = 0; i < 4; ++i) {
      for (uint32_t row = 0; row < 2; ++row) {
        const uint32_t a = row == 0 ? i : own + i, b = own + 5 * row + i;
        book.triangles.push_back({a, a + 1, b + 1});
        book.triangles.push_back({a, b + 1, b});
      }
    }
  }
  return book;
}

// Each page has become two triangles between the spine's ends and its outer corners, or three with
// the spine's middle vertex.
Complex CoarseBook(const Complex& book, uint32_t pages, bool middle) {
  Complex cut = book;
  cut.triangles.clear();
  for (uint32_t page = 0; page < pages; ++page) {
    const uint32_t c = 5 + 10 * page + 5, d = c + 4;
    cut.triangles.push_back({0, d, c});
    cut.triangles.push_back({0, middle ? 2u : 4u, d});
    if (middle) cut.triangles.push_back({2, 4, d});
  }
  return cut;
}

// A sheet of n x n cells, and which of its faces have opposites.
Complex Sheet(uint32_t n, const std::set<uint32_t>& two_sided = {}) {
  Complex sheet;
  for (uint32_t j = 0; j <= n; ++j) {
    for (uint32_t i = 0; i <= n; ++i) {
      sheet.points.push_back({static_cast<double>(i), static_cast<double>(j), 0});
    }
  }
  for (uint32_t j = 0; j < n; ++j) {
    for (uint32_t i = 0; i < n; ++i) {
      const uint32_t a = j * (n + 1) + i, d = a + n + 1;
      sheet.triangles.push_back({a, a + 1, d + 1});
      sheet.triangles.push_back({a, d + 1, d});
      if (!two_sided.contains(j * n + i)) continue;
      sheet.triangles.push_back({a, d + 1, a + 1});
      sheet.triangles.push_back({a, d, d + 1});
    }
  }
  return sheet;
}

// Keeps the vertices that faces name, as cuts do.
Complex Used(const Complex& complex) {
  Complex used;
  std::vector<uint32_t> number(complex.points.size(), ~0u);
  for (Triangle t : complex.triangles) {
    for (uint32_t& v : t) {
      if (number[v] == ~0u) {
        number[v] = static_cast<uint32_t>(used.points.size());
        used.points.push_back(complex.points[v]);
      }
      v = number[v];
    }
    used.triangles.push_back(t);
  }
  return used;
}

CutReport Check(const Complex& complex, const Complex& cut, bool vanish = false) {
  return CheckCut(complex, Used(cut), {.patches_may_vanish = vanish});
}

bool Says(const CutReport& report, const std::string& words) {
  return report.Text().find(words) != std::string::npos;
}

TEST_CASE("A graph of sheets knows creases, chains, patches and stars") {
  const SheetGraph book(Book(3));
  CHECK(book.patch_count() == 3);
  CHECK(book.components() == 1);
  CHECK(book.euler() == 1);
  CHECK(book.FindEdge(1, 2)->signature.faces() == 3);
  CHECK(book.FindEdge(0, 5) != nullptr);
  CHECK(book.FindEdge(0, 30) == nullptr);
  REQUIRE(book.chains().size() == 4);  // the spine and three borders
  CHECK(book.IsNode(0));
  CHECK(book.IsNode(4));
  CHECK_FALSE(book.IsNode(2));

  // A two-sided cell in the middle of a sheet has a closed border, and is no seam inside.
  const SheetGraph patch(Sheet(5, {12}));
  CHECK(patch.opposite_pairs() == 2);
  CHECK(patch.patch_count() == 2);
  REQUIRE(patch.chains().size() == 2);
  CHECK(patch.chains()[0].closed);
  CHECK(patch.chains()[1].closed);
  CHECK(patch.chains()[1].vertices.size() == 4);
  CHECK(patch.chains()[1].signature.two_sided == 1);

  Complex touching = Sheet(1);
  touching.points.insert(touching.points.end(), {{5, 5, 5}, {6, 5, 5}});
  touching.triangles.push_back({0, 4, 5});
  CHECK(SheetGraph(touching).star_parts(0) == 2);
  CHECK(SheetGraph(touching).star_parts(1) == 1);
  touching.triangles.push_back({4, 5, 0});
  CHECK(SheetGraph(touching).duplicates() == 1);
}

TEST_CASE("Right cuts of a book pass") {
  for (const uint32_t pages : {1u, 2u, 3u, 5u}) {
    const Complex book = Book(pages);
    INFO(pages << " pages");
    CHECK(Check(book, book).Text().empty());
    CHECK(Check(book, CoarseBook(book, pages, false)).Text().empty());
    CHECK(Check(book, CoarseBook(book, pages, true)).Text().empty());
  }
}

TEST_CASE("A gap at a crease is found") {
  const Complex book = Book(3);
  // Two pages still have the spine's middle vertex, the third one goes past it.
  Complex cut = CoarseBook(book, 3, true);
  const Complex coarse = CoarseBook(book, 3, false);
  std::vector<Triangle> faces;
  for (const Triangle& t : cut.triangles) {
    const bool third = std::max({t[0], t[1], t[2]}) >= 25;
    if (!third) faces.push_back(t);
  }
  faces.insert(faces.end(), coarse.triangles.end() - 2, coarse.triangles.end());
  cut.triangles = faces;
  const CutReport report = Check(book, cut);
  CHECK(Says(report, "edge 0 2 of the chain from 0 to 4 has 2+ 0- 0= instead of 3+ 0- 0="));
  CHECK(Says(report, "edge 0 4 is no crease of the input"));
}

TEST_CASE("A page whose edge went elsewhere is found") {
  const Complex book = Book(3);
  Complex cut = CoarseBook(book, 3, true);
  // The third page's edge from 2 to 4 goes to the first page's corner instead.
  for (Triangle& t : cut.triangles) {
    if (std::max({t[0], t[1], t[2]}) < 25) continue;
    std::replace(t.begin(), t.end(), 4u, 14u);
  }
  const CutReport report = Check(book, cut);
  INFO(report.Text());
  CHECK(Says(report, "edge 2 4 of the chain from 0 to 4 has 2+ 0- 0= instead of 3+ 0- 0="));
  CHECK(Says(report, "joins several patches"));
}

TEST_CASE("A crease that takes its vertices in another order is found") {
  const Complex book = Book(3);
  Complex cut = book;
  // The spine's vertices 1 and 3 have changed places in all pages.
  for (Triangle& t : cut.triangles) {
    for (uint32_t& v : t) v = v == 1 ? 3 : v == 3 ? 1 : v;
  }
  CHECK(Says(Check(book, cut), "edge 0 1 of the chain from 0 to 4 is not there"));
}

TEST_CASE("A lost end of a crease is found") {
  Complex tee = Sheet(4);  // and a fin over the row of vertices 11, 12, 13
  tee.points.insert(tee.points.end(), {{1, 2, 1}, {2, 2, 1}, {3, 2, 1}});
  for (const uint32_t i : {0u, 1u}) {
    tee.triangles.push_back({11 + i, 12 + i, 26 + i});
    tee.triangles.push_back({11 + i, 26 + i, 25 + i});
  }
  CHECK(Check(tee, tee).ok());
  Complex cut = tee;
  cut.triangles.resize(cut.triangles.size() - 4);
  CHECK_FALSE(Check(tee, cut).ok());
  // Small patches may vanish where that is said; then their creases are none.
  const CutReport vanished = Check(tee, cut, true);
  CHECK(vanished.Text().empty());
  CHECK(vanished.vanished_patches == 1);
  CHECK(vanished.vanished_vertices == 3);
  // Half a fin is not gone.
  cut.triangles.push_back({11, 12, 26});
  CHECK_FALSE(Check(tee, cut, true).ok());
}

TEST_CASE("Lost and foreign copies of two-sided faces are found") {
  const Complex sheet = Sheet(5, {6, 7, 11, 12});
  CHECK(Check(sheet, sheet).ok());
  Complex lost = sheet;
  const auto copy = std::find(lost.triangles.begin(), lost.triangles.end(), Triangle{7, 14, 8});
  REQUIRE(copy != lost.triangles.end());
  lost.triangles.erase(copy);
  CHECK(Says(Check(sheet, lost), "lacks its opposite"));
  Complex more = sheet;
  more.triangles.push_back({0, 7, 1});
  CHECK(Says(Check(sheet, more), "has an opposite"));
  // A sheet that is two-sided everywhere has no crease that a loss of all copies would change.
  std::set<uint32_t> all;
  for (uint32_t i = 0; i < 25; ++i) all.insert(i);
  Complex both = Sheet(5, all);
  CHECK(Says(Check(both, Sheet(5)), "lacks its opposite"));
  Complex twice = sheet;
  twice.triangles.push_back(twice.triangles[3]);
  CHECK(Says(Check(sheet, twice), "1 faces stand there twice"));
}

TEST_CASE("Sheets that let go of the vertex where they touched are found") {
  Complex fans;
  fans.points = {{0, 0, 0},  {1, 0, 1},  {0, 1, 1},   {-1, -1, 1},
                 {1, 0, -1}, {0, 1, -1}, {-1, -1, -1}};
  for (uint32_t i = 0; i < 3; ++i) {
    fans.triangles.push_back({0, 1 + i, 1 + (i + 1) % 3});
    fans.triangles.push_back({0, 4 + (i + 1) % 3, 4 + i});
  }
  CHECK(Check(fans, fans).ok());
  Complex cut = fans;
  cut.triangles = {{1, 2, 3}};
  for (uint32_t i = 0; i < 3; ++i) cut.triangles.push_back({0, 4 + (i + 1) % 3, 4 + i});
  const CutReport report = Check(fans, cut);
  CHECK(Says(report, "1 parts of sheets meet in vertex 0 instead of 2"));
  CHECK(Says(report, "2 components instead of 1"));
}

TEST_CASE("What is closed is not inside out, and vertices are those of the input") {
  const RandomComplex ball = MakeRandomComplex(Shape::kClosed, 4);
  Complex cut = ball.complex;
  CHECK(Says(Check(ball.complex, cut), "stand there twice") == (ball.duplicates > 0));
  Complex tetrahedron;
  tetrahedron.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  tetrahedron.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  cut = tetrahedron;
  CHECK(Check(tetrahedron, cut).ok());
  for (Triangle& t : cut.triangles) std::swap(t[0], t[1]);
  CHECK(Says(Check(tetrahedron, cut), "inside out"));
  cut = tetrahedron;
  cut.points[2][0] += 0.125;
  CHECK(Says(Check(tetrahedron, cut), "is none of the complex"));
  cut = tetrahedron;
  cut.points[2] = cut.points[1];
  CHECK(Says(Check(tetrahedron, cut), "is there twice"));
}

// Any one fault in a complex is one in a cut of it.
Complex Faulty(const Complex& right, uint32_t kind, std::mt19937& random) {
  Complex wrong = right;
  std::vector<Triangle>& faces = wrong.triangles;
  const size_t f = random() % faces.size();
  switch (kind) {
    case 0: faces.erase(faces.begin() + static_cast<std::ptrdiff_t>(f)); break;
    case 1: std::swap(faces[f][0], faces[f][1]); break;
    case 2: faces.push_back(faces[f]); break;
    case 3: faces[f][random() % 3] = static_cast<uint32_t>(random() % wrong.points.size()); break;
    case 4: faces.push_back({faces[f][0], faces[f][2], faces[f][1]}); break;
    default: {
      // A face goes over from one vertex to another one in all its edges: a tear.
      const uint32_t old = faces[f][0], other = faces[random() % faces.size()][1];
      for (uint32_t& v : faces[f]) v = v == old ? other : v;
    }
  }
  return wrong;
}

std::multiset<Triangle> FacesOf(const Complex& complex) {
  std::multiset<Triangle> faces;
  for (Triangle t : complex.triangles) {
    std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
    faces.insert(t);
  }
  return faces;
}

// All of the complex but what is there twice.
Complex WholeCut(const Complex& complex) {
  Complex cut = complex;
  cut.triangles.clear();
  const SheetGraph graph(complex);
  for (const auto& [corners, two_sided] : graph.sheets()) {
    const auto [a, b, c] = corners;
    cut.triangles.push_back({a, b, c});
    if (two_sided) cut.triangles.push_back({a, c, b});
  }
  return cut;
}

TEST_CASE("Each fault in a random complex is found") {
  std::mt19937 random(1);
  uint64_t tried = 0;
  for (uint32_t i = 0; i < 20 * kShapes; ++i) {
    const auto shape = static_cast<Shape>(i % kShapes);
    INFO(NameOf(shape) << " " << i / kShapes);
    const RandomComplex made = MakeRandomComplex(shape, i / kShapes);
    CHECK(SheetGraph(made.complex).duplicates() == made.duplicates);
    CHECK(made.complex.triangles.size() >= 20);
    CHECK(made.complex.triangles.size() <= 400);
    const Complex whole = WholeCut(made.complex);
    const CutReport report = Check(made.complex, whole);
    INFO(report.Text());
    CHECK(report.ok());
    for (uint32_t kind = 0; kind < 6; ++kind) {
      INFO("fault " << kind);
      const Complex wrong = Faulty(whole, kind, random);
      // Where the corner of a sheet has gone, the border takes its chord: that is a cut.
      if (Used(wrong).points.size() + 1 == Used(whole).points.size()) continue;
      if (FacesOf(wrong) == FacesOf(whole)) continue;
      CHECK_FALSE(Check(made.complex, wrong).ok());
      ++tried;
    }
  }
  CHECK(tried > 1000);
}

// The complex without the extras of which `gone` says so.
Complex Without(const RandomComplex& made, const std::set<uint32_t>& gone) {
  Complex cut = made.complex;
  cut.triangles.clear();
  for (size_t f = 0; f < made.complex.triangles.size(); ++f) {
    if (!gone.contains(made.extras[f])) cut.triangles.push_back(made.complex.triangles[f]);
  }
  return WholeCut(cut);
}

TEST_CASE("Flaps and crumbs may go where that is permitted, whole and one by one") {
  uint64_t tried = 0, halves = 0;
  for (uint32_t i = 0; i < 20 * kShapes; ++i) {
    const auto shape = static_cast<Shape>(i % kShapes);
    INFO(NameOf(shape) << " " << i / kShapes);
    const RandomComplex made = MakeRandomComplex(shape, i / kShapes);
    std::set<uint32_t> extras(made.extras.begin(), made.extras.end());
    extras.erase(kNoExtra);
    CHECK(Check(made.complex, Without(made, {}), true).vanished_patches == 0);
    std::set<uint32_t> gone;
    for (const uint32_t extra : extras) {
      // A triangle that goes on in a sheet may go like any ear.
      if (Check(made.complex, Without(made, {extra})).ok()) continue;
      gone.insert(extra);
      for (const std::set<uint32_t>& some : {std::set<uint32_t>{extra}, gone}) {
        const CutReport report = Check(made.complex, Without(made, some), true);
        INFO(report.Text());
        CHECK(report.ok());
        CHECK(report.vanished_patches == some.size());
        ++tried;
      }
      // Half of a crumb is not gone.
      Complex half = Without(made, {extra});
      const size_t before = half.triangles.size();
      for (size_t f = 0; f < made.extras.size(); ++f) {
        if (made.extras[f] == extra) half.triangles.push_back(made.complex.triangles[f]);
      }
      if (half.triangles.size() == before + 1) continue;
      half.triangles.resize(before + (half.triangles.size() - before) / 2);
      CHECK_FALSE(Check(made.complex, half, true).ok());
      ++halves;
    }
  }
  CHECK(tried > 300);
  CHECK(halves > 100);
}

TEST_CASE("The largest distance is that of the farthest point") {
  const Complex sheet = Sheet(4);
  Complex other = sheet;
  other.points[12][2] = 0.5;
  CHECK(LargestDistance(sheet, sheet, 0.1) < 1e-12);
  CHECK(LargestDistance(other, sheet, 0.1) == Approx(0.5));
  CHECK(LargestDistance(sheet, other, 0.1) > 0.35);
  CHECK(LargestDistance(sheet, other, 0.1) < 0.5);
  Complex far;
  far.points = {{0, 0, 9}, {1, 0, 9}, {0, 1, 9}};
  far.triangles = {{0, 1, 2}};
  CHECK(LargestDistance(far, sheet, 10) == Approx(9));
}

}  // namespace
}  // namespace mtdb::sheets
