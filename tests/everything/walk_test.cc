// SPDX-License-Identifier: Apache-2.0
// What walks stand on: their text, their seeds, how they are shrunk.
#include <catch2/catch.hpp>

#include "tests/everything/random_walk.h"
#include "tests/everything/shrink.h"

namespace mtdb::everything {
namespace {

TEST_CASE("a walk's text is read back as the same walk") {
  for (uint64_t seed = 0; seed < 300; ++seed) {
    Walk walk = RandomWalk(seed);
    walk.steps[0].Set("name", std::string("a b%=\n\xc3\xbc"));
    const Result<Walk> read = ParseWalk(WalkText(walk));
    REQUIRE(read.ok());
    REQUIRE(*read == walk);
  }
  CHECK(ParseWalk("ask of=1\nask of\n").status().message().starts_with("line 2: "));
  CHECK_FALSE(ParseWalk("of=1").ok());
  CHECK(ParseWalk("# a remark\n\n")->steps.empty());
}

TEST_CASE("a seed always makes the same walk") {
  for (uint64_t seed = 1; seed < 50; ++seed) {
    CHECK(RandomWalk(seed) == RandomWalk(seed));
    CHECK(WalkText(RandomWalk(seed)) != WalkText(RandomWalk(seed + 1000)));
  }
}

TEST_CASE("numbers are read as they were written") {
  for (const double value : {0.1, 1e300, -4649776.25, 5e-324, 3.0}) {
    Step step;
    step.Set("x", value);
    CHECK(step.Number("x", 0) == value);
  }
  CHECK(Numbers("1,-2.5,x,3e2") == std::vector<double>{1, -2.5, 300});
  CHECK(Numbers("").empty());
}

TEST_CASE("a walk is shrunk to what its fault needs") {
  // Fails when some ingest has attributes and a later question clips.
  const auto fails = [](const Walk& walk) {
    bool rounded = false;
    for (const Step& step : walk.steps) {
      if (step.act == "ingest" &&
          ("," + step.Text("attr") + ",").find(",rgb,") != std::string::npos &&
          step.Int("size", 100) >= 40) {
        rounded = true;
      }
      if (step.act == "ask" && step.Flag("clip") && rounded) return true;
    }
    return false;
  };
  int shrunk = 0;
  for (uint64_t seed = 1; seed < 400; ++seed) {
    const Walk walk = RandomWalk(seed);
    if (!fails(walk)) continue;
    ++shrunk;
    const Walk small = Shrink(walk, fails, 2000);
    REQUIRE(fails(small));
    REQUIRE(small.steps.size() == 2);
    CHECK(small.steps[0].with.size() == 1);
    CHECK(small.steps[0].Text("attr") == "rgb");
    CHECK(small.steps[1] == Step{"ask", {{"clip", "1"}}});
  }
  CHECK(shrunk > 10);
}

TEST_CASE("shrinking keeps to its attempts") {
  int asked = 0;
  const Walk walk = RandomWalk(7);
  CHECK(Shrink(
            walk, [&](const Walk&) { return ++asked < 0; }, 10) == walk);
  CHECK(asked == 10);
}

}  // namespace
}  // namespace mtdb::everything
