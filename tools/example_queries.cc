// SPDX-License-Identifier: Apache-2.0
// example_queries STORE: asks for a part of a terrain in every way there is, once by C++ objects
// and once in JSON, which give the same mesh. docs/query.md has the same examples; `mtdb generate
// terrain` and `mtdb ingest` make a store for them.
#include <cstdio>
#include <numbers>
#include <string>
#include <vector>

#include "query/query_json.h"
#include "query/surface.h"
#include "store/database.h"

namespace mtdb {
namespace {

double Radians(double degrees) { return degrees * std::numbers::pi / 180; }

struct Example {
  std::string json;
  Query query;
};

Query In(RegionPtr region) {
  Query query;
  query.region = std::move(region);
  return query;
}

Query At(ThresholdPtr threshold) {
  Query query;
  query.threshold = std::move(threshold);
  return query;
}

// Where the mesh is to be accurate.
void AddRegions(std::vector<Example>* examples) {
  const auto add = [&](const char* json, RegionPtr region) {
    examples->push_back({json, In(std::move(region))});
  };
  Camera camera;
  camera.eye = {5, -2, 2};
  camera.direction = Vec3d{5, 5, -0.5} - camera.eye;
  camera.vertical_fov_rad = Radians(40);
  Camera near_camera;
  near_camera.eye = {5, -2, 2};
  near_camera.direction = {0, 1, -0.3};
  near_camera.vertical_fov_rad = Radians(45);
  near_camera.near = 0.1;
  near_camera.far = 8;

  add(R"({"region": {"box": {"min": [4, 4, -1], "max": [6, 7, 0.5]}}})",
      BoxRegion({{4, 4, -1}, {6, 7, 0.5}}));
  add(R"({"region": {"sphere": {"centre": [6, 4, 0], "radius": 1.5}}})",
      SphereRegion({6, 4, 0}, 1.5));
  add(R"({"region": {"half_space": {"point": [0, 0, -0.5], "normal": [0, 0, 1]}}})",
      HalfSpaceRegion({{0, 0, -0.5}, {0, 0, 1}}));
  add(R"({"region": {"polyhedron": [{"point": [0, 0, 0], "normal": [-1, -1, 0]},
                           {"point": [0, 0, 0], "normal": [1, -1, 0]},
                           {"point": [0, 4, 0], "normal": [0, 1, 0.2]}]}})",
      ConvexRegion({{{0, 0, 0}, {-1, -1, 0}}, {{0, 0, 0}, {1, -1, 0}}, {{0, 4, 0}, {0, 1, 0.2}}}));
  add(R"({"region": {"frustum": {"eye": [5, -2, 2], "target": [5, 5, -0.5], "fov": 40,
                        "viewport": [1200, 900]}}})",
      FrustumRegion(camera));
  add(R"({"region": {"frustum_shadow": {"eye": [5, -2, 2], "direction": [0, 1, -0.3], "near": 0.1,
                               "far": 8}}})",
      FrustumShadowRegion(near_camera));
  add(R"({"region": {"wedge": {"apex": [5, 0], "direction": [0, 1], "angle": 40, "near": 0.5,
                      "far": 8}}})",
      WedgeRegion({5, 0, 0, 1, Radians(40), 0.5, 8}));
  add(R"({"region": {"prism": {"polygon": [[2, 2], [8, 2], [8, 8], [5, 4], [2, 8]], "min_z": -1,
                      "max_z": 1}}})",
      PrismRegion({{2, 2}, {8, 2}, {8, 8}, {5, 4}, {2, 8}}, -1, 1));
  add(R"({"region": {"point": [5, 5, 0]}})", PointRegion({5, 5, 0}));
  add(R"({"region": {"segment": {"from": [1, 1, 1], "to": [9, 9, 0]}}})",
      SegmentRegion({1, 1, 1}, {9, 9, 0}));
  add(R"({"region": {"tube": {"line": [[1, 1, 0], [3, 6, 0], [9, 9, 0]], "radius": 0.25}}})",
      TubeRegion({{1, 1, 0}, {3, 6, 0}, {9, 9, 0}}, 0.25));
  add(R"({"region": {"union": [{"sphere": {"centre": [5, 5, 0], "radius": 1}},
                      {"point": [1, 1, 0]}]}})",
      UnionRegion({SphereRegion({5, 5, 0}, 1), PointRegion({1, 1, 0})}));
  add(R"({"region": {"intersection": [{"sphere": {"centre": [5, 5, 0], "radius": 3}},
                             {"half_space": {"point": [5, 5, 0], "normal": [0, -1, 0]}}]}})",
      IntersectionRegion({SphereRegion({5, 5, 0}, 3), HalfSpaceRegion({{5, 5, 0}, {0, -1, 0}})}));
  add(R"({"region": {"outside": {"wedge": {"apex": [5, 0], "direction": [0, 1], "angle": 40}}}})",
      ComplementRegion(WedgeRegion({5, 0, 0, 1, Radians(40)})));
}

// How accurate, in model units.
void AddThresholds(double diagonal, std::vector<Example>* examples) {
  const auto add = [&](const char* json, ThresholdPtr threshold) {
    examples->push_back({json, At(std::move(threshold))});
  };
  add(R"({"threshold": 0.002})", ConstantThreshold(0.002));
  add(R"({"threshold": "full"})", FullResolution());
  add(R"({"threshold": "coarsest"})", CoarsestThreshold());
  add(R"({"threshold": {"relative": 0.001}})", ConstantThreshold(0.001 * diagonal));
  add(R"({"threshold": {"linear": {"point": [5, 5, 0], "base": 0.001, "slope": 0.004}}})",
      LinearThreshold({5, 5, 0}, 0.001, 0.004));
  add(R"({"threshold": {"quadratic": {"point": [5, 5, 0], "base": 0.001, "factor": 0.002}}})",
      QuadraticThreshold({5, 5, 0}, 0.001, 0.002));
  add(R"({"threshold": {"square_root": {"point": [5, 5, 0], "base": 0.001, "factor": 0.01}}})",
      SquareRootThreshold({5, 5, 0}, 0.001, 0.01));
  add(R"({"threshold": {"exponential": {"point": [5, 5, 0], "base": 0.001, "rate": 0.7}}})",
      ExponentialThreshold({5, 5, 0}, 0.001, 0.7));

  Camera camera;
  camera.eye = {5, -2, 2};
  camera.direction = Vec3d{5, 5, -0.5} - camera.eye;
  camera.vertical_fov_rad = Radians(45);
  Query seen = At(ScreenThreshold(camera, 1));
  seen.region = FrustumRegion(camera);
  examples->push_back({R"({"region": {"frustum": {"eye": [5, -2, 2], "target": [5, 5, -0.5]}},
 "threshold": {"screen": {"camera": {"eye": [5, -2, 2], "target": [5, 5, -0.5]}, "pixels": 1}}})",
                       seen});

  add(R"({"threshold": {"by_region": {"region": {"sphere": {"centre": [5, 5, 0], "radius": 2}},
                             "inside": 0.002, "outside": 0.05}}})",
      RegionThreshold(SphereRegion({5, 5, 0}, 2), ConstantThreshold(0.002),
                      ConstantThreshold(0.05)));
  add(R"({"threshold": {"grid": {"origin": [0, 0, -2], "cell": [5, 5, 4], "counts": [2, 2, 1],
                        "errors": [0.001, 0.01, 0.01, 0.1]}}})",
      GridThreshold({{0, 0, -2}, {5, 5, 4}, {2, 2, 1}, {0.001, 0.01, 0.01, 0.1}}));
  add(R"({"threshold": {"smallest": [{"linear": {"point": [5, 5, 0], "base": 0.001, "slope": 0.004}},
                            0.01]}})",
      MinThreshold({LinearThreshold({5, 5, 0}, 0.001, 0.004), ConstantThreshold(0.01)}));
  add(R"({"threshold": {"largest": [{"relative": 0.0001}, 0.002]}})",
      MaxThreshold({ConstantThreshold(0.0001 * diagonal), ConstantThreshold(0.002)}));
}

// What it may cost, and what else comes with it.
void AddBudgets(std::vector<Example>* examples) {
  Query query;
  query.max_triangles = 5000;
  examples->push_back({R"({"max_triangles": 5000})", query});
  query = {};
  query.max_bytes = 30000;
  examples->push_back({R"({"max_bytes": 30000})", query});
  query = {};
  query.max_milliseconds = 60000;
  examples->push_back({R"({"max_milliseconds": 60000})", query});
  query = In(SphereRegion({6, 4, 0}, 1.5));
  query.clip = true;
  examples->push_back(
      {R"({"region": {"sphere": {"centre": [6, 4, 0], "radius": 1.5}}, "clip": true})", query});
  query = {};
  query.normals = true;
  examples->push_back({R"({"normals": true})", query});
}

// A surface whose cache is empty, so that a budget of bytes means the same for all.
Result<TriangleMesh> Ask(const std::shared_ptr<ClusterSource>& source, const Query& query,
                         ExtractStats* stats) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface, Surface::Open(source));
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  MTDB_ASSIGN_OR_RETURN(*stats, surface->Extract(query, sink));
  return mesh;
}

Status Run(const char* path) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database, Database::Open(path));
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<ClusterSource> source, database->OpenObject(""));
  const double diagonal = source->record().diagonal();
  std::vector<Example> examples;
  AddRegions(&examples);
  AddThresholds(diagonal, &examples);
  AddBudgets(&examples);
  for (const Example& example : examples) {
    ExtractStats stats;
    MTDB_ASSIGN_OR_RETURN(const TriangleMesh mesh, Ask(source, example.query, &stats));
    std::printf("%s\n  %zu triangles, error at most %g\n", example.json.c_str(),
                mesh.triangles.size(), stats.error_bound);
    MTDB_ASSIGN_OR_RETURN(const Query parsed, ParseQuery(example.json, diagonal));
    MTDB_ASSIGN_OR_RETURN(const TriangleMesh same, Ask(source, parsed, &stats));
    if (same.positions != mesh.positions || same.triangles != mesh.triangles ||
        same.rows != mesh.rows) {
      return InvalidArgument("the query in JSON gives another mesh");
    }
  }
  return Status::Ok();
}

}  // namespace
}  // namespace mtdb

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const mtdb::Status status = mtdb::Run(argv[1]);
  if (!status.ok()) return std::fprintf(stderr, "%s\n", status.message().c_str()), 1;
  return 0;
}
