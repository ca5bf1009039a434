// SPDX-License-Identifier: Apache-2.0
// probe --height and profile.
#include <random>

#include "tests/tools/terrain_testing.h"

namespace mtdb::test {
namespace {

TEST_CASE("probe --height gives samples exactly, and what is between them on a straight line",
          "[cli]") {
  const Tile t;
  const auto probe = [&](const std::string& x, const std::string& y, Arguments more = {}) {
    Arguments arguments{"probe", t.store, "--height=" + x + "," + y};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return RunJson(arguments).at("heights").at(0);
  };
  CHECK(probe(t.X(10), t.Y(13)).at("height") == t.At(10, 13));
  CHECK(probe(t.X(0), t.Y(0)).at("height") == t.At(0, 0));
  CHECK(probe(t.X(50), t.Y(50)).at("height") == t.At(50, 50));
  CHECK(probe(t.X(10.5), t.Y(13)).at("height") == Approx((t.At(10, 13) + t.At(11, 13)) / 2));
  CHECK(probe(t.X(35), t.Y(22)).at("height").is_null());
  CHECK(probe("3", "50").at("height").is_null());
  const Json coarse = probe(t.X(10), t.Y(13), {"--error", "25"});
  CHECK(coarse.at("error_bound") <= 25);
  CHECK(std::abs(coarse.at("height").get<double>() - t.At(10, 13)) <=
        coarse.at("error_bound").get<double>());
  WriteText(t.folder.File("places"),
            t.X(3) + " " + t.Y(4) + "\n\n" + t.X(5) + ", " + t.Y(6) + "\n");
  const Json list = RunJson({"probe", t.store, "--heights", t.folder.File("places")});
  CHECK(list.at("heights").at(0).at("height") == t.At(3, 4));
  CHECK(list.at("heights").at(1).at("height") == t.At(5, 6));
  WriteText(t.folder.File("wrong"), "1 2\n3 x\n");
  CHECK_THAT(Run({"probe", t.store, "--heights", t.folder.File("wrong")}).err,
             Catch::Contains("line 2"));
}

TEST_CASE("many places at once have the heights that each has alone", "[cli]") {
  const Tile t;
  std::mt19937 random(4);
  std::string places;
  std::vector<std::string> alone;
  for (int i = 0; i < 40; ++i) {
    // Near each other and far away, in the hole, outside.
    const double spread = i % 3 == 0 ? 60 : 3;
    char text[100];
    std::snprintf(text, sizeof(text), "%.12g,%.12g",
                  7 + (29 + spread * (random() % 1000) / 1000.0) / 50,
                  10 - (19 + spread * (random() % 1000) / 1000.0) / 50);
    alone.push_back(text);
    if (i % 10 == 0) alone.push_back(text);
  }
  for (const std::string& place : alone) places += place + "\n";
  WriteText(t.folder.File("places"), places);
  for (const Arguments& error : {Arguments{}, Arguments{"--error", "20"}}) {
    Arguments together{"probe", t.store, "--heights", t.folder.File("places")};
    together.insert(together.end(), error.begin(), error.end());
    const Json found = RunJson(together).at("heights");
    REQUIRE(found.size() == alone.size());
    for (size_t i = 0; i < alone.size(); ++i) {
      Arguments one{"probe", t.store, "--height=" + alone[i]};
      one.insert(one.end(), error.begin(), error.end());
      const Json expected = RunJson(one).at("heights").at(0);
      CAPTURE(alone[i]);
      CHECK(found.at(i).at("height").is_null() == expected.at("height").is_null());
      if (expected.at("height").is_null() || !error.empty()) continue;
      CHECK(found.at(i).at("height").get<double>() ==
            Approx(expected.at("height").get<double>()).epsilon(1e-12));
    }
  }
}

TEST_CASE("a profile whose corners are far away is that of what lies between", "[cli]") {
  const Tile t;
  const auto heights = [&](double reach) {
    char line[200];
    // Through 7.5, 9.5 at 30 degrees.
    std::snprintf(line, sizeof(line), "--line=%.17g,%.17g,%.17g,%.17g", 7.5 - reach * 2,
                  9.5 - reach, 7.5 + reach * 2, 9.5 + reach);
    std::vector<std::array<double, 3>> points;
    const Json profile = RunJson({"profile", t.store, line});
    for (const Json& p : profile.at("points")) {
      if (p.at("height").is_null()) continue;
      points.push_back({p.at("x"), p.at("y"), p.at("height")});
    }
    return points;
  };
  const auto near = heights(1);
  REQUIRE(near.size() > 60);
  for (const double reach : {1e3, 1e7, 1e10}) {
    const auto far = heights(reach);
    CAPTURE(reach);
    REQUIRE(far.size() == near.size());
    for (size_t i = 0; i < near.size(); ++i) {
      CHECK(far[i][0] == Approx(near[i][0]).margin(1e-15 * reach));
      CHECK(far[i][2] == Approx(near[i][2]).margin(1e-3 + 1e-10 * reach));
    }
  }
}

TEST_CASE("a profile whose corners are too far away is refused with a sentence", "[cli]") {
  const Tile t;
  for (const char* line : {"-1e14,9.5,1e14,9.6", "-1e29,9.5,1e29,9.5", "1e29,1e29,1e29,2e29"}) {
    RunFails(1, {"profile", t.store, std::string("--line=") + line}, {"too far apart"});
  }
}

TEST_CASE("profile meets every edge along a line, and says where holes are", "[cli]") {
  const Tile t;
  // Along row 22 from column 20 to 50: each sample is met, and cells' diagonals are not crossed.
  const Json row = RunJson(
      {"profile", t.store, "--line=" + t.X(20) + "," + t.Y(22) + "," + t.X(50) + "," + t.Y(22)});
  std::map<int, double> heights;
  int gaps = 0;
  for (const Json& p : row.at("points")) {
    const double column = (p.at("x").get<double>() - 7) * 50;
    if (p.at("height").is_null()) {
      ++gaps;
      CHECK(column == Approx(29));
      continue;
    }
    heights[static_cast<int>(std::lround(column))] = p.at("height");
  }
  CHECK(gaps == 1);
  for (int c = 20; c <= 50; ++c) {
    if (c >= 30 && c < 40) {
      CHECK(heights.count(c) == 0);
    } else {
      REQUIRE(heights.count(c) == 1);
      CHECK(heights[c] == Approx(t.At(static_cast<uint32_t>(c), 22)));
    }
  }
  // Across: between two points heights are on a line, as single probes see them.
  const Json across =
      RunJson({"profile", t.store,
               "--line=" + t.X(2.3) + "," + t.Y(3.1) + "," + t.X(17.9) + "," + t.Y(11.7)});
  const Json& points = across.at("points");
  REQUIRE(points.size() > 30);
  for (size_t i = 0; i + 1 < points.size(); ++i) {
    const double x = (points[i].at("x").get<double>() + points[i + 1].at("x").get<double>()) / 2;
    const double y = (points[i].at("y").get<double>() + points[i + 1].at("y").get<double>()) / 2;
    const double z =
        (points[i].at("height").get<double>() + points[i + 1].at("height").get<double>()) / 2;
    if (i % 7 != 0) continue;
    char place[100];
    std::snprintf(place, sizeof(place), "--height=%.15g,%.15g", x, y);
    CHECK(RunJson({"probe", t.store, place}).at("heights").at(0).at("height").get<double>() ==
          Approx(z).margin(1e-6));
  }
  CHECK_THAT(RunOk({"profile", t.store, "--line=7.1,9.1,7.2,9.3", "--error", "20"}),
             Catch::Contains("distance,x,y,height"));
}

}  // namespace
}  // namespace mtdb::test
