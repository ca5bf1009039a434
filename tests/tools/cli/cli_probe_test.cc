// SPDX-License-Identifier: Apache-2.0
// What `mtdb probe` finds and how it refuses.
#include <limits>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

std::string Numbers(const std::vector<double>& numbers) {
  std::string text;
  for (const double n : numbers) text += (text.empty() ? "" : ",") + std::to_string(n);
  return text;
}

std::vector<double> Bound(const Example& example, const char* which) {
  return example.info.at("bounds").at(which).get<std::vector<double>>();
}

TEST_CASE("probe --point finds the closest point", "[cli]") {
  const Example& example = TheExample();
  const std::vector<double> corner = Bound(example, "min");
  const Json json = RunJson({"probe", example.store, "--point=" + Numbers(corner)});
  REQUIRE(json.at("hit") == true);
  const Vec3d p{std::stod(std::to_string(corner[0])), std::stod(std::to_string(corner[1])),
                std::stod(std::to_string(corner[2]))};
  const TriangleMesh mesh = ReadMesh(example.full);
  double expected = std::numeric_limits<double>::infinity();
  for (const TriangleVertices& t : mesh.triangles) {
    expected = std::min(expected,
                        SquaredDistancePointTriangle(p, mesh.positions[t[0]], mesh.positions[t[1]],
                                                     mesh.positions[t[2]]));
  }
  const double distance = json.at("distance");
  CHECK(distance == Approx(std::sqrt(expected)).epsilon(1e-5));  // the file has float32 positions
  CHECK(json.at("front") == true);
  CHECK(json.at("triangle").size() == 3);
  CHECK(json.at("clusters_read") <= json.at("clusters_total"));
  const Json near = RunJson({"probe", example.store, "--point=" + Numbers(corner), "--limit",
                             std::to_string(distance / 2)});
  CHECK(near.at("hit") == false);
  CHECK_FALSE(near.contains("point"));
  const Json coarse = RunJson({"probe", example.store, "--point=" + Numbers(corner), "--error",
                               "0.05", "--name", "sculpture"});
  CHECK(std::abs(coarse.at("distance").get<double>() - distance) <=
        coarse.at("error_bound").get<double>());
  CHECK(coarse.at("clusters_read") <= json.at("clusters_read"));
  CHECK_THAT(RunOk({"probe", example.store, "--point=" + Numbers(corner)}),
             Catch::Contains("distance ") && Catch::Contains("from outside"));
}

TEST_CASE("probe --ray finds the first hit, or none", "[cli]") {
  const Example& example = TheExample();
  std::vector<double> ray = Bound(example, "min");
  const std::vector<double> max = Bound(example, "max");
  for (size_t i = 0; i < 3; ++i) ray.push_back(max[i] - ray[i]);
  const Json hit = RunJson({"probe", example.store, "--ray=" + Numbers(ray)});
  REQUIRE(hit.at("hit") == true);
  const double t = hit.at("parameter");
  CHECK(t > 0);
  CHECK(t < 1);
  CHECK(hit.at("distance").get<double>() == Approx(t * std::hypot(ray[3], ray[4], ray[5])));
  CHECK(hit.at("front") == true);
  for (size_t i = 0; i < 3; ++i) {
    CHECK(hit.at("point").at(i).get<double>() == Approx(ray[i] + t * ray[i + 3]).margin(1e-5));
  }
  for (size_t i = 3; i < 6; ++i) ray[i] = -ray[i];
  const Json miss = RunJson({"probe", example.store, "--ray=" + Numbers(ray)});
  CHECK(miss.at("hit") == false);
  CHECK_THAT(RunOk({"probe", example.store, "--ray=" + Numbers(ray)}),
             Catch::Contains("does not hit"));
}

TEST_CASE("probe wants one point or one ray", "[cli]") {
  const Example& example = SmallExample();
  RunFails(2, {"probe", example.store}, {"--point", "--ray"});
  RunFails(2, {"probe", example.store, "--point", "0,0,0", "--ray", "0,0,0,1,0,0"}, {"--ray"});
  RunFails(2, {"probe", example.store, "--point", "0,0"}, {"--point", "3 numbers X,Y,Z"});
  RunFails(2, {"probe", example.store, "--ray", "0,0,0,0,0,0"}, {"--ray", "direction"});
  RunFails(2, {"probe", example.store, "--ray", "0,0,0,1,0,nan"}, {"--ray"});
  RunFails(1, {"probe", example.store, "--point", "0,0,0", "--name", "other"}, {"other"});
  RunFails(1, {"probe", example.folder.File("none.mtdb"), "--point", "0,0,0"}, {"none.mtdb"});
}

}  // namespace
}  // namespace mtdb::test
