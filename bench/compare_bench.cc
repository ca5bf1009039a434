// SPDX-License-Identifier: Apache-2.0
// How long it takes to prove that two surfaces lie within a tolerance of each other, or where not.
//
//   compare_bench [--triangles N] [--threads N] [--json FILE]
//
// A sculpture against two copies: one with 100 dents, of which the tolerance is half the depth, and
// one that was moved by less than a tolerance along its normals, in waves. Each time from new
// handles with empty caches, at several tolerances: the verdict, the time, and how many of the
// clusters were read. Beside it what CGAL's AABB tree takes to measure the distances of all
// vertices, both ways, which proves nothing of what lies between them.
//
// Exits with 1 when a verdict is wrong or a dent was missed.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "bench/internal/hausdorff.h"
#include "bench/internal/workload.h"
#include "query/compare.h"

namespace mtdb {

namespace {

constexpr int kDents = 100;

struct Arguments {
  uint64_t triangles = 2'000'000;
  unsigned threads = 0;
  std::string json;
};

double SecondsSince(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

std::vector<Vec3d> NormalsOf(const TriangleMesh& mesh) {
  std::vector<Vec3d> normals(mesh.positions.size());
  for (const TriangleVertices& t : mesh.triangles) {
    const Vec3d a = mesh.positions[t[0]];
    const Vec3d normal = Cross(mesh.positions[t[1]] - a, mesh.positions[t[2]] - a);
    for (const VertexIndex v : t) normals[v] += normal;
  }
  for (Vec3d& n : normals) n = n * (1 / std::max(Length(n), 1e-300));
  return normals;
}

Vec3d AsFloat(Vec3d p) {
  return {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
}

// Round dents that do not touch, at random places.
TriangleMesh Dented(TriangleMesh mesh, double depth, double radius) {
  const std::vector<Vec3d> normals = NormalsOf(mesh);
  const std::vector<Vec3d> before = mesh.positions;
  std::mt19937 random(1);
  std::vector<Vec3d> centres;
  while (centres.size() < kDents) {
    const Vec3d c = before[random() % before.size()];
    const auto is_near = [&](Vec3d d) { return Length(c - d) < 4 * radius; };
    if (!std::ranges::any_of(centres, is_near)) centres.push_back(c);
  }
  for (size_t i = 0; i < before.size(); ++i) {
    for (const Vec3d& c : centres) {
      const double r2 = SquaredLength(before[i] - c) / (radius * radius);
      if (r2 < 1) mesh.positions[i] += normals[i] * (-depth * (1 - r2) * (1 - r2));
    }
    mesh.positions[i] = AsFloat(mesh.positions[i]);
  }
  return mesh;
}

TriangleMesh Waved(TriangleMesh mesh, double by) {
  const std::vector<Vec3d> normals = NormalsOf(mesh);
  for (size_t i = 0; i < normals.size(); ++i) {
    const Vec3d p = mesh.positions[i];
    mesh.positions[i] = AsFloat(p + normals[i] * (by * std::sin(9 * p.x) * std::sin(8 * p.y)));
  }
  return mesh;
}

class Bench {
 public:
  explicit Bench(const Arguments& arguments)
      : arguments_(arguments), mesh_(Sculpture(arguments.triangles)) {
    for (const Vec3d& p : mesh_.positions) bounds_.Add(p);
    store_.Build("before", mesh_, {});
  }

  bool Run() {
    std::printf("%-7s %9s  %-9s %8s %8s %9s %7s  %s\n", "copy", "tolerance", "verdict", "seconds",
                "CGAL, s", "triangles", "read", "places each way");
    const double diagonal = Diagonal(bounds_);
    bool right = true;
    for (const double depth : {0.02, 0.004}) {
      const TriangleMesh dented = Dented(mesh_, depth, 0.04);
      right &= Row("dents", dented, depth / 2, CompareVerdict::kExceeds);
    }
    for (const double part : {0.003, 0.001, 0.0003}) {
      const TriangleMesh waved = Waved(mesh_, part * diagonal / 4);
      right &= Row("waves", waved, part * diagonal, CompareVerdict::kWithin);
    }
    if (!arguments_.json.empty()) right &= WriteRows(arguments_.json, rows_);
    return right;
  }

 private:
  bool Row(const std::string& name, const TriangleMesh& copy, double tolerance,
           CompareVerdict expected) {
    BenchStore other;
    other.Build("after", copy, {});
    CompareOptions options;
    options.tolerance = tolerance;
    options.threads = arguments_.threads;
    const auto begin = std::chrono::steady_clock::now();
    const Result<Comparison> found =
        Compare(*store_.OpenSurface("before"), *other.OpenSurface("after"), options);
    const double seconds = SecondsSince(begin);
    if (!found) {
      std::fprintf(stderr, "%s\n", found.status().message().c_str());
      return false;
    }
    const auto measuring = std::chrono::steady_clock::now();
    const double measured =
        std::max(LargestVertexDistance(mesh_, copy), LargestVertexDistance(copy, mesh_));
    const double cgal_seconds = SecondsSince(measuring);
    const double read =
        static_cast<double>(found->clusters_read) / static_cast<double>(found->clusters_total);
    const size_t places[] = {found->a_to_b->places.size(), found->b_to_a->places.size()};
    const bool within = found->verdict == CompareVerdict::kWithin;
    std::printf("%-7s %9.5f  %-9s %8.2f %8.2f %9llu %6.1f%%  %zu, %zu\n", name.c_str(), tolerance,
                within                                       ? "within"
                : found->verdict == CompareVerdict::kExceeds ? "exceeds"
                                                             : "?",
                seconds, cgal_seconds, static_cast<unsigned long long>(found->triangles),
                100 * read, places[0], places[1]);
    rows_.push_back({{"copy", name},
                     {"tolerance", tolerance},
                     {"seconds", seconds},
                     {"cgal_seconds", cgal_seconds},
                     {"read", read},
                     {"triangles", found->triangles},
                     {"places", places[0]}});
    const size_t most = within ? 0 : kDents;
    return found->verdict == expected && found->distance.high >= measured * (1 - 1e-6) &&
           places[0] == most && places[1] == most;
  }

  const Arguments& arguments_;
  const TriangleMesh& mesh_;
  Box3d bounds_;
  BenchStore store_;
  Json rows_ = Json::array();
};

}  // namespace

}  // namespace mtdb

int main(int argc, char** argv) {
  mtdb::Arguments arguments;
  CLI::App app{"Measures comparisons of surfaces."};
  app.add_option("--triangles", arguments.triangles);
  app.add_option("--threads", arguments.threads);
  app.add_option("--json", arguments.json);
  CLI11_PARSE(app, argc, argv);
  const bool right = mtdb::Bench(arguments).Run();
  if (!right) std::fprintf(stderr, "compare_bench: a verdict is wrong\n");
  return right ? 0 : 1;
}
