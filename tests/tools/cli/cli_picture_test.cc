// SPDX-License-Identifier: Apache-2.0
// The options of render, from the command line.
#include <catch2/catch.hpp>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {

TEST_CASE("render says from where it looked and what its colours mean", "[cli]") {
  const Example& example = TheExample();
  const Folder folder;
  const std::string picture = folder.File("picture.png");
  const auto render = [&](const Arguments& more) {
    Arguments all{"render", example.store, picture, "--size", "60x40", "--error", "1%"};
    all.insert(all.end(), more.begin(), more.end());
    return RunJson(all)["picture"];
  };
  const Json top = render({"--view", "top", "--up", "0,1,0"});
  CHECK(top["up"] == Json({0, 1, 0}));
  CHECK(top["direction"][1].get<double>() == Approx(-1));
  CHECK(top["colour_range"].is_null());
  // Distances from what is stored are at most the bound that was asked for, and some are there.
  const Json error = render({"--colour", "error", "--background", "transparent"});
  CHECK(error["colour_range"][0] == 0);
  const double most = error["colour_range"][1];
  CHECK(most > 0);
  const double diagonal = RunJson({"info", example.store})["objects"][0]["diagonal"];
  CHECK(most <= 0.01 * diagonal);
  CHECK(static_cast<int>(ReadText(picture)[25]) == 6);  // PNG's colour type: with alpha
  RunFails(1, {"render", example.store, picture, "--colour", "no such"}, {"'no such'"});
  const std::string said = RunOk(
      {"render", example.store, picture, "--size", "60x40", "--colour", "error", "--error", "1%"});
  CHECK(said.find("colours: how far the picture's surface is from") != std::string::npos);
}

}  // namespace mtdb::test
