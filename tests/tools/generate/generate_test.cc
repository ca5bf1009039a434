// SPDX-License-Identifier: Apache-2.0
#include "tools/generate/generate.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdio>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <numeric>
#include <set>
#include <string>
#include <sys/stat.h>
#include <unistd.h>
#include <unordered_map>
#include <vector>

#include "tests/support/temporary_folder.h"
#include "tools/generate/internal/marching.h"
#include "tools/generate/noise.h"

namespace mtdb {

using namespace internal;

namespace {

TriangleMesh Make(std::string_view shape, uint64_t triangles, uint64_t seed = 1) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  const GenerateOptions options{triangles, seed};
  const Status status =
      shape == "terrain" ? GenerateTerrain(options, sink) : GenerateSculpture(options, sink);
  INFO(status.message());
  REQUIRE(status.ok());
  return mesh;
}

uint64_t EdgeKey(uint64_t a, uint64_t b) { return a << 32 | b; }

// What counting edges and vertices tells about a mesh.
struct Topology {
  bool indices_are_good = true;       // in range, three different ones a triangle
  bool edges_are_manifold = true;     // no directed edge twice
  bool vertices_are_manifold = true;  // one fan of triangles around each vertex, and at least one
  uint64_t border_edges = 0;
  uint64_t border_loops = 0;
  uint64_t components = 0;
  int64_t euler = 0;
};

Topology Examine(const TriangleMesh& mesh) {
  Topology out;
  const size_t n = mesh.positions.size();
  std::unordered_map<uint64_t, size_t> triangle_of;
  triangle_of.reserve(mesh.triangles.size() * 4);
  std::vector<uint64_t> root(n), incident(n), any_triangle(n);
  std::iota(root.begin(), root.end(), 0);
  const auto find = [&](uint64_t v) {
    while (root[v] != v) v = root[v] = root[root[v]];
    return v;
  };
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    const TriangleVertices& f = mesh.triangles[t];
    if (f[0] >= n || f[1] >= n || f[2] >= n || f[0] == f[1] || f[1] == f[2] || f[2] == f[0]) {
      out.indices_are_good = false;
      return out;
    }
    for (size_t i = 0; i < 3; ++i) {
      out.edges_are_manifold &= triangle_of.emplace(EdgeKey(f[i], f[(i + 1) % 3]), t).second;
      root[find(f[i])] = find(f[(i + 1) % 3]);
      ++incident[f[i]];
      any_triangle[f[i]] = t;
    }
  }
  std::map<uint64_t, uint64_t> next_on_border;
  for (const auto& [edge, t] : triangle_of) {
    const uint64_t a = edge >> 32, b = edge & 0xffffffffu;
    if (triangle_of.count(EdgeKey(b, a)) != 0) continue;
    out.vertices_are_manifold &= next_on_border.emplace(a, b).second;
  }
  out.border_edges = next_on_border.size();
  std::set<uint64_t> seen;
  for (const auto& [start, unused] : next_on_border) {
    if (seen.count(start) != 0) continue;
    ++out.border_loops;
    for (uint64_t v = start; seen.insert(v).second;) v = next_on_border[v];
  }
  for (uint64_t v = 0; v < n; ++v) {
    if (find(v) == v) ++out.components;
    if (incident[v] == 0) {
      out.vertices_are_manifold = false;
      continue;
    }
    // Turn around v, both ways from one of its triangles: all of them must be met.
    uint64_t met = 1;
    const auto turn = [&](bool forward) {
      size_t t = any_triangle[v];
      for (;;) {
        const TriangleVertices& f = mesh.triangles[t];
        const auto at = static_cast<size_t>(std::find(f.begin(), f.end(), v) - f.begin());
        const auto neighbour = forward ? triangle_of.find(EdgeKey(v, f[(at + 2) % 3]))
                                       : triangle_of.find(EdgeKey(f[(at + 1) % 3], v));
        if (neighbour == triangle_of.end()) return false;
        t = neighbour->second;
        if (t == any_triangle[v]) return true;
        ++met;
      }
    };
    if (!turn(true)) turn(false);
    out.vertices_are_manifold &= met == incident[v];
  }
  const auto edges = static_cast<int64_t>((mesh.triangles.size() * 3 + out.border_edges) / 2);
  out.euler = static_cast<int64_t>(n) - edges + static_cast<int64_t>(mesh.triangles.size());
  return out;
}

double SignedVolume(const TriangleMesh& mesh) {
  double volume = 0;
  for (const TriangleVertices& t : mesh.triangles) {
    volume += Dot(mesh.positions[t[0]], Cross(mesh.positions[t[1]], mesh.positions[t[2]])) / 6;
  }
  return volume;
}

double LeastDoubleArea(const TriangleMesh& mesh) {
  double least = 1e300;
  for (const TriangleVertices& t : mesh.triangles) {
    const Vec3d a = mesh.positions[t[0]];
    least = std::min(least, Length(Cross(mesh.positions[t[1]] - a, mesh.positions[t[2]] - a)));
  }
  return least;
}

// The distance from `p` to the nearest vertex, through a grid of cells of size `cell`; at most
// `cell`.
class VertexGrid {
 public:
  VertexGrid(const TriangleMesh& mesh, double cell) : mesh_(mesh), cell_(cell) {
    for (size_t v = 0; v < mesh.positions.size(); ++v) {
      cells_[CellOf(mesh.positions[v])].push_back(v);
    }
  }
  double DistanceTo(Vec3d p) const {
    double best = cell_ * cell_;
    for (int c = 0; c < 27; ++c) {
      const Vec3d shift{(c % 3 - 1) * cell_, (c / 3 % 3 - 1) * cell_, (c / 9 - 1) * cell_};
      const auto found = cells_.find(CellOf(p + shift));
      if (found == cells_.end()) continue;
      for (const size_t v : found->second) {
        best = std::min(best, SquaredLength(mesh_.positions[v] - p));
      }
    }
    return std::sqrt(best);
  }

 private:
  std::array<int64_t, 3> CellOf(Vec3d p) const {
    return {static_cast<int64_t>(std::floor(p.x / cell_)),
            static_cast<int64_t>(std::floor(p.y / cell_)),
            static_cast<int64_t>(std::floor(p.z / cell_))};
  }
  const TriangleMesh& mesh_;
  double cell_;
  std::map<std::array<int64_t, 3>, std::vector<size_t>> cells_;
};

class Folder : public testing::TemporaryFolder {
 public:
  std::string File(const std::string& name) const { return path() + "/" + name; }
  size_t FileCount() const {
    const std::filesystem::directory_iterator files(path());
    return static_cast<size_t>(std::distance(begin(files), end(files)));
  }
};

std::string Contents(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

TEST_CASE("every marching case is a set of oriented discs without diagonals on faces") {
  for (unsigned inside = 0; inside < 256; ++inside) {
    const MarchingCase& c = MarchingCases()[inside];
    CHECK((c.triangle_count == 0) == (inside == 0 || inside == 255));
    std::map<std::pair<int, int>, int> directed;
    for (size_t t = 0; t < c.triangle_count; ++t) {
      for (size_t i = 0; i < 3; ++i) {
        const int a = c.triangles[t][i], b = c.triangles[t][(i + 1) % 3];
        CHECK((c.edges >> a & 1) == 1);
        CHECK(++directed[{a, b}] == 1);
      }
    }
    // The crossed edges are those between an inside and an outside corner.
    for (unsigned e = 0; e < 12; ++e) {
      const unsigned start = kCubeEdgeStart[e], end = start + (1u << e / 4);
      CHECK((c.edges >> e & 1u) == ((inside >> start ^ inside >> end) & 1u));
    }
  }
}

TEST_CASE("gradient noise stays within its stated bounds") {
  float largest = 0, steepest = 0;
  for (uint64_t i = 0; i < 200'000; ++i) {
    const auto at = [i](uint64_t k) {
      return Splat4(64 * UnitFloat(StreamSeed(5, 3 * i + k)) - 32);
    };
    constexpr float kStep = 1.0f / 256;
    const Float4 step = {0, kStep, 0, 0};
    const Float4 n = GradientNoise3(at(0) + step, at(1), at(2), 7);
    largest = std::max(largest, std::abs(n[0]));
    steepest = std::max(steepest, std::abs(n[1] - n[0]) / kStep);
  }
  CHECK(largest < kNoise3Bound);
  CHECK(largest > 0.6f);
  CHECK(steepest < kNoise3Lipschitz);
}

TEST_CASE("the sculpture is one closed outward manifold of genus above zero, at every size") {
  for (const uint64_t triangles : {1'000u, 5'000u, 50'000u, 300'000u}) {
    const TriangleMesh mesh = Make("sculpture", triangles);
    INFO(triangles << " wanted, " << mesh.triangles.size() << " made");
    const double off =
        std::abs(static_cast<double>(mesh.triangles.size()) / static_cast<double>(triangles) - 1);
    CHECK(off < 0.03);
    const Topology t = Examine(mesh);
    CHECK(t.indices_are_good);
    CHECK(t.edges_are_manifold);
    CHECK(t.vertices_are_manifold);
    CHECK(t.border_edges == 0);
    CHECK(t.components == 1);
    CHECK(t.euler < 0);  // 2 - 2 * genus: two handles or more
    CHECK(t.euler % 2 == 0);
    CHECK(SignedVolume(mesh) > 0.5);
    CHECK(LeastDoubleArea(mesh) > 0);
  }
}

TEST_CASE("other seeds give other sculptures, as sound as the first") {
  const TriangleMesh first = Make("sculpture", 30'000, 1);
  for (const uint64_t seed : {2u, 3u, 77u}) {
    const TriangleMesh mesh = Make("sculpture", 30'000, seed);
    CHECK(mesh.positions != first.positions);
    const Topology t = Examine(mesh);
    CHECK(t.edges_are_manifold);
    CHECK(t.vertices_are_manifold);
    CHECK(t.border_edges == 0);
    CHECK(t.components == 1);
    CHECK(t.euler < 0);
  }
}

TEST_CASE("the same seed gives the same sculpture at two sizes, finer sampled") {
  const TriangleMesh coarse = Make("sculpture", 20'000);
  const TriangleMesh fine = Make("sculpture", 320'000);
  // The coarse mesh lacks octaves below three of its cells, some 0.13 long.
  const VertexGrid fine_grid(fine, 0.08), coarse_grid(coarse, 0.15);
  double sum = 0;
  for (const Vec3d& p : coarse.positions) {
    const double d = fine_grid.DistanceTo(p);
    CHECK(d < 0.08);
    sum += d;
  }
  CHECK(sum / static_cast<double>(coarse.positions.size()) < 0.02);
  for (size_t v = 0; v < fine.positions.size(); v += 7) {
    CHECK(coarse_grid.DistanceTo(fine.positions[v]) < 0.12);
  }
}

TEST_CASE("the terrain is a manifold disc with one border") {
  for (const uint64_t triangles : {100u, 5'000u, 50'000u}) {
    const TriangleMesh mesh = Make("terrain", triangles);
    const double off =
        std::abs(static_cast<double>(mesh.triangles.size()) / static_cast<double>(triangles) - 1);
    CHECK(off < 0.03);
    const Topology t = Examine(mesh);
    CHECK(t.indices_are_good);
    CHECK(t.edges_are_manifold);
    CHECK(t.vertices_are_manifold);
    CHECK(t.border_loops == 1);
    CHECK(t.components == 1);
    CHECK(t.euler == 1);
    Box3d box;
    for (const Vec3d& p : mesh.positions) box.Add(p);
    CHECK(box.min.x == 0);
    CHECK(box.max.x == 10);
    CHECK(box.max.y == 10);
    const double height = box.max.z - box.min.z;
    CHECK(height > (triangles < 1000 ? 0.0 : 1.2));  // at 100 triangles there are no octaves yet
    CHECK(height < 3.2);
    for (const TriangleVertices& f : mesh.triangles) {
      const Vec3d a = mesh.positions[f[0]];
      CHECK(Cross(mesh.positions[f[1]] - a, mesh.positions[f[2]] - a).z > 0);
    }
  }
}

TEST_CASE("the same options give the same bytes, another seed others") {
  const Folder folder;
  for (const char* shape : {"sculpture", "terrain", "sheets"}) {
    REQUIRE(GenerateFile(shape, {20'000, 4}, folder.File("a.ply")).ok());
    REQUIRE(GenerateFile(shape, {20'000, 4}, folder.File("b.ply")).ok());
    REQUIRE(GenerateFile(shape, {20'000, 5}, folder.File("c.ply")).ok());
    const std::string a = Contents(folder.File("a.ply"));
    CHECK(a == Contents(folder.File("b.ply")));
    CHECK(a != Contents(folder.File("c.ply")));
  }
  CHECK(folder.FileCount() == 3);
}

TEST_CASE("the file holds the mesh that the sink gets") {
  const Folder folder;
  const std::string path = folder.File("s.ply");
  REQUIRE(GenerateFile("sculpture", {5'000, 1}, path).ok());
  const TriangleMesh mesh = Make("sculpture", 5'000);
  const std::string bytes = Contents(path);
  const size_t header = bytes.find("end_header\n") + 11;
  CHECK(bytes.find("element vertex " + std::to_string(mesh.positions.size()) + "\n") < header);
  CHECK(bytes.find("element face " + std::to_string(mesh.triangles.size()) + "\n") < header);
  REQUIRE(bytes.size() == header + 12 * mesh.positions.size() + 13 * mesh.triangles.size());
  ByteReader reader(AsBytes(bytes).subspan(header));
  size_t wrong = 0;
  for (const Vec3d& p : mesh.positions) {
    for (int i = 0; i < 3; ++i) wrong += reader.Get<float>() != static_cast<float>(p[i]);
  }
  for (const TriangleVertices& t : mesh.triangles) {
    wrong += reader.Get<uint8_t>() != 3;
    for (const VertexIndex v : t) wrong += reader.Get<uint32_t>() != v;
  }
  CHECK(wrong == 0);
}

TEST_CASE("wrong requests and unwritable paths are refused and leave nothing") {
  const Folder folder;
  const std::string path = folder.File("x.ply");
  CHECK(GenerateFile("teapot", {1000, 1}, path).code() == StatusCode::kInvalidArgument);
  CHECK(GenerateFile("sculpture", {99, 1}, path).code() == StatusCode::kInvalidArgument);
  CHECK(GenerateFile("sheets", {99, 1}, path).code() == StatusCode::kInvalidArgument);
  CHECK(GenerateFile("sheets", {9'000'000'000, 1}, path).code() == StatusCode::kInvalidArgument);
  CHECK(GenerateFile("terrain", {30'000'000'000, 1}, path).code() == StatusCode::kInvalidArgument);
  CHECK(GenerateFile("sculpture", {9'000'000'000, 1}, path).code() == StatusCode::kInvalidArgument);
  const std::string nowhere = folder.File("no/such/folder/x.ply");
  const Status status = GenerateFile("terrain", {1000, 1}, nowhere);
  CHECK(status.code() == StatusCode::kIoError);
  CHECK(status.message().find(nowhere) != std::string::npos);
  CHECK(folder.FileCount() == 0);
}

TEST_CASE("an error of the sink stops the generator") {
  class FullSink final : public MeshSink {
   public:
    Status Begin(const MeshHeader&) override { return Status::Ok(); }
    Status AddVertices(std::span<const Vec3d>, ByteSpan) override {
      return Status(StatusCode::kNoSpace, "full");
    }
    Status AddTriangles(std::span<const TriangleVertices>) override { return Status::Ok(); }
    Status End() override { return Status::Ok(); }
  };
  FullSink sink;
  CHECK(GenerateSculpture({2'000, 1}, sink).code() == StatusCode::kNoSpace);
  CHECK(GenerateTerrain({2'000, 1}, sink).code() == StatusCode::kNoSpace);
  CHECK(GenerateSheets({2'000, 1}, sink).code() == StatusCode::kNoSpace);
}

}  // namespace
}  // namespace mtdb
