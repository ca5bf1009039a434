// SPDX-License-Identifier: Apache-2.0
// ingest --up and --units, and who goes by them.
#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

// A pyramid that stands on the plane y = 0.
constexpr const char* kPyramid =
    "v 0 0 0\nv 4 0 0\nv 4 0 4\nv 0 0 4\nv 2 5 2\n"
    "f 1 2 3 4\nf 2 1 5\nf 3 2 5\nf 4 3 5\nf 1 4 5\n";

Json Object(const std::string& store) { return RunJson({"info", store}).at("objects").at(0); }

}  // namespace

TEST_CASE("what is up is found at ingest, and told by info, render, copies and packed files",
          "[cli]") {
  const Folder folder;
  const std::string mesh = folder.File("p.obj"), store = folder.File("s.mtdb");
  WriteText(mesh, kPyramid);
  Run({"ingest", mesh, store, "--quiet"});
  CHECK(Object(store).at("up") == Json::array({0, 1, 0}));
  CHECK(Object(store).at("up_given") == false);
  CHECK(Object(store).at("units") == "");
  CHECK(Run({"info", store}).out.find("up           y, found from the shape") != std::string::npos);
  CHECK(Run({"info", store}).out.find("units") == std::string::npos);

  Run({"ingest", mesh, store, "--quiet", "--replace", "--up=-x", "--units", "mm"});
  const std::string packed = folder.File("p.mtdbp"), copy = folder.File("c.mtdb");
  Run({"pack", store, packed});
  Run({"copy", store, copy});
  for (const std::string& s : {store, packed, copy}) {
    INFO(s);
    CHECK(Object(s).at("up") == Json::array({-1, 0, 0}));
    CHECK(Object(s).at("up_given") == true);
    CHECK(Object(s).at("units") == "mm");
    const Json picture = RunJson({"render", s, folder.File("p.png"), "--size", "64x64"});
    CHECK(picture.at("picture").at("up") == Json::array({-1, 0, 0}));
  }
  const std::string text = Run({"info", store}).out;
  CHECK(text.find("up           -x, as ingest was told") != std::string::npos);
  CHECK(text.find("units        mm") != std::string::npos);
}

TEST_CASE("--up and --units take what they say, and refuse the rest in one line", "[cli]") {
  const Folder folder;
  const std::string mesh = folder.File("p.obj"), store = folder.File("s.mtdb");
  WriteText(mesh, kPyramid);
  Run({"ingest", mesh, store, "--quiet", "--up", "0,3,4"});
  CHECK(Object(store).at("up").at(1).get<double>() == Approx(0.6));
  CHECK(Object(store).at("up").at(2).get<double>() == Approx(0.8));
  for (const char* const wrong : {"--up=w", "--up=0,0,0", "--up=1,2", "--up=--x",
                                  "--up=", "--units=lightyears", "--units="}) {
    INFO(wrong);
    const Outcome outcome = Run({"ingest", mesh, store, "--quiet", "--replace", wrong});
    CHECK(outcome.exit_code == 2);
    CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
  }
  CHECK(Object(store).at("up").at(1).get<double>() == Approx(0.6));
  const std::string raster = folder.File("r.asc");
  WriteText(raster,
            "ncols 3\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3\n2 3 4\n3 4 9\n");
  CHECK(Run({"ingest", raster, store, "--quiet", "--units", "mm"}).err.find("units") !=
        std::string::npos);
  CHECK(Run({"ingest", raster, store, "--quiet", "--up", "x"}).err.find("up") != std::string::npos);
  Run({"ingest", raster, store, "--quiet"});
  CHECK(RunJson({"info", store, "--name", "r"}).at("objects").at(0).at("up") ==
        Json::array({0, 0, 1}));
}

}  // namespace mtdb::test
