// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <limits>

#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using testing::AppendValue;
using testing::ReadGood;
using testing::ReadOutcome;
using testing::ReadText;
using testing::RequireBadInput;

using Soup = std::vector<std::array<Vec3f, 3>>;

const Soup kTwo = {{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}}, {{{1, 0, 0}, {1, 1, 0.1f}, {-0.0f, 1, 0}}}};

std::string Binary(const Soup& soup, const std::string& title = "a title", float normal = 0,
                   uint16_t attribute = 0) {
  std::string file = title;
  file.resize(80, ' ');
  AppendValue(&file, static_cast<uint32_t>(soup.size()));
  for (const auto& t : soup) {
    for (const float n : {0.f, 0.f, normal}) AppendValue(&file, n);
    for (const Vec3f& p : t) {
      for (int axis = 0; axis < 3; ++axis) AppendValue(&file, p[axis]);
    }
    AppendValue(&file, attribute);
  }
  return file;
}

const std::string kAscii =
    "solid thing\n facet normal 0 0 0\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n"
    "   vertex 0 1 0\n  endloop\n endfacet\n FACET NORMAL 0 0 0\n  OUTER LOOP\n   VERTEX 1 0 0\n"
    "   VERTEX 1 1 0.1\n   VERTEX -0.0 1e0 0\n  ENDLOOP\n ENDFACET\nendsolid thing\n";

void RequireTwo(const ReadOutcome& outcome) {
  // Text gives the decimal number.
  const double last = outcome.mesh.header.from_text ? 0.1 : double{0.1f};
  REQUIRE(outcome.mesh.positions ==
          std::vector<Vec3d>{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, last}});
  REQUIRE(outcome.mesh.triangles == std::vector<TriangleVertices>{{0, 1, 2}, {1, 3, 2}});
  REQUIRE_FALSE(outcome.mesh.header.double_positions);
}

TEST_CASE("STL corners are joined by exact position, and -0 equals +0") {
  const ReadOutcome binary = ReadGood("b.stl", Binary(kTwo));
  RequireTwo(binary);
  REQUIRE(binary.report.format == "STL binary");
  REQUIRE(binary.report.ignored.empty());
  REQUIRE(binary.mesh.header.triangle_count == 2u);
  const ReadOutcome ascii = ReadGood("a.stl", kAscii);
  RequireTwo(ascii);
  REQUIRE(ascii.report.format == "STL ASCII");
  REQUIRE(ascii.report.ignored.empty());
}

TEST_CASE("STL: many vertices are joined as a map would") {
  Soup soup;
  const auto at = [](int i) {
    return Vec3f{static_cast<float>(i % 50), static_cast<float>(i / 50), 0.5f};
  };
  for (int i = 0; i < 2400; ++i) soup.push_back({at(i), at(i + 1), at(i + 50)});
  const ReadOutcome outcome = ReadGood("grid.stl", Binary(soup));
  REQUIRE(outcome.mesh.positions.size() == 2450);
  REQUIRE(outcome.mesh.triangles.size() == 2400);
  for (size_t i = 0; i < soup.size(); ++i) {
    for (size_t k = 0; k < 3; ++k) {
      const Vec3d p = outcome.mesh.positions[outcome.mesh.triangles[i][k]];
      REQUIRE(p == Vec3d{soup[i][k].x, soup[i][k].y, soup[i][k].z});
    }
  }
}

TEST_CASE("STL is binary by its size even if it begins with solid") {
  RequireTwo(ReadGood("s.stl", Binary(kTwo, "solid thing")));
}

TEST_CASE("STL normals and attribute bytes are reported as ignored when not zero") {
  REQUIRE(ReadGood("n.stl", Binary(kTwo, "", 1, 7)).report.ignored ==
          std::vector<std::string>{"facet normals", "facet attribute bytes"});
  std::string ascii = kAscii;
  ascii.replace(ascii.find("0 0 0"), 5, "0 0 1");
  REQUIRE(ReadGood("n.stl", ascii).report.ignored == std::vector<std::string>{"facet normals"});
  REQUIRE(ReadGood("t.stl", Binary(kTwo) + "tail").report.ignored ==
          std::vector<std::string>{"4 bytes after the last facet"});
}

TEST_CASE("STL ASCII may hold several solids, without names and with CR LF") {
  std::string text = "solid\r\n" + kAscii.substr(kAscii.find(" facet"));
  for (size_t at = text.find('\n') + 1; (at = text.find('\n', at)) != std::string::npos; at += 2) {
    text.replace(at, 1, "\r\n");
  }
  const ReadOutcome outcome = ReadGood("two.stl", text + kAscii);
  REQUIRE(outcome.mesh.positions.size() == 4);
  REQUIRE(outcome.mesh.triangles.size() == 4);
}

TEST_CASE("STL: coordinates that are not finite are refused with their place") {
  for (const float bad : {std::nanf(""), -std::numeric_limits<float>::infinity()}) {
    Soup soup = kTwo;
    soup[1][1].y = bad;
    RequireBadInput("n.stl", Binary(soup), {"facet 1: y is", "expected a finite number"});
  }
  std::string ascii = kAscii;
  ascii.replace(ascii.find("1 1 0.1"), 7, "1 1 nan");
  RequireBadInput("n.stl", ascii, {"line 12: z is nan"});
}

TEST_CASE("STL: counts are compared with the bytes that remain") {
  std::string huge = Binary(kTwo);
  const uint32_t count = 0xfffffffeu;
  huge.replace(80, 4, reinterpret_cast<const char*>(&count), 4);
  RequireBadInput("h.stl", huge, {"promises 4294967294 facets of 50 bytes, but only 100 bytes"});
  RequireBadInput("h.stl", Binary({}), {"no facets"});
  RequireBadInput("h.stl", "a text, not a mesh\n", {"expected STL", "found 19 bytes"});
}

TEST_CASE("STL ASCII: bad lines are refused with line, expectation and text") {
  const auto bad = [](const std::string& from, const std::string& to,
                      std::initializer_list<const char*> parts) {
    std::string text = kAscii;
    text.replace(text.find(from), from.size(), to);
    RequireBadInput("bad.stl", text, parts);
  };
  bad("facet normal", "facet", {"line 2: expected 'facet normal X Y Z'"});
  bad("facet normal", "faucet normal", {"line 2: expected 'facet' or 'endsolid', found"});
  bad("outer loop", "inner loop", {"line 3: expected 'outer loop'"});
  bad("vertex 0 1 0", "vertex 0 1", {"line 6: expected three numbers, found"});
  bad("vertex 0 1 0", "endloop", {"line 6: expected 'vertex X Y Z'"});
  bad("endloop", "vertex 0 0 1", {"line 7: expected 'endloop'"});
  bad("endfacet", "facet", {"line 8: expected 'endfacet'"});
  RequireBadInput("bad.stl", kAscii + "more\n", {"line 17: expected 'solid', found 'more'"});
  RequireBadInput("bad.stl", "solid empty\nendsolid empty\n", {"no facets"});
}

TEST_CASE("STL: every prefix of a binary file is refused, also when it begins with solid") {
  for (const char* title : {"title", "solid"}) {
    const std::string file = Binary(kTwo, title);
    for (size_t n = 0; n < file.size(); ++n) {
      CAPTURE(n);
      RequireBadInput("cut.stl", file.substr(0, n), {});
    }
  }
}

TEST_CASE("STL: every prefix of an ASCII file up to endsolid is refused") {
  const size_t whole = kAscii.find("endsolid") + 8;
  for (size_t n = 0; n < whole; ++n) {
    CAPTURE(n);
    RequireBadInput("cut.stl", kAscii.substr(0, n), {});
  }
  for (size_t n = whole; n <= kAscii.size(); ++n) {
    CAPTURE(n);
    RequireTwo(ReadGood("cut.stl", kAscii.substr(0, n)));
  }
}

}  // namespace
}  // namespace mtdb
