// SPDX-License-Identifier: Apache-2.0
// OrientSheets against the definition, with memory for everything and with next to none; and shapes
// of which one knows what is right.
#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <random>

#include "builder/intake/input_spool.h"
#include "builder/surface/orient_sheets.h"
#include "builder/surface/sheet_sides.h"
#include "codecs/mesh_file/mesh_file.h"
#include "tests/builder/fixture.h"
#include "tests/support/oriented_mesh.h"

namespace mtdb::testing {

using namespace internal;

namespace {

const SpoolSpace& Space() {
  static const SpoolSpace kSpace{std::filesystem::temp_directory_path().string()};
  return kSpace;
}

std::vector<TriangleVertices> TrianglesOf(const InputMesh& input) {
  std::vector<TriangleVertices> triangles;
  SpoolReader reader(&input.triangle_spool());
  std::array<uint32_t, 3> t;
  while (reader.remaining() != 0 && reader.Get(&t)) triangles.push_back({t[0], t[1], t[2]});
  return triangles;
}

// What OrientSheets makes of the triangles.
std::vector<TriangleVertices> Oriented(const TriangleMesh& mesh, size_t memory_bytes,
                                       SheetReport* report) {
  InputSpool input(&Space(), 1 << 20, false);
  const Status sent = SendMesh(mesh, input);
  INFO(sent.message());
  REQUIRE(sent.ok());
  const auto counted =
      CountSheets(input.triangle_spool(), input.vertices(), &Space(), memory_bytes);
  const auto oriented = OrientSheets(&input, &Space(), memory_bytes);
  REQUIRE(counted.ok());
  INFO(oriented.status().message());
  REQUIRE(oriented.ok());
  REQUIRE(counted->inconsistent_edges == oriented->inconsistent_edges);
  REQUIRE(counted->unorientable_sheets == oriented->unorientable_sheets);
  REQUIRE(counted->turned_triangles == oriented->turned_triangles);
  *report = *oriented;
  return TrianglesOf(input);
}

// No triangle has two equal vertices.
OrientedMesh RequireAgreement(const TriangleMesh& mesh, size_t memory_bytes) {
  const OrientedMesh expected = OrientByDefinition(mesh.triangles);
  SheetReport report;
  const std::vector<TriangleVertices> found = Oriented(mesh, memory_bytes, &report);
  std::vector<TriangleVertices> turned = mesh.triangles;
  TurnOver(expected, &turned);
  REQUIRE(report.inconsistent_edges == expected.inconsistent_edges);
  REQUIRE(report.unorientable_sheets == expected.unorientable_sheets);
  REQUIRE(report.turned_triangles == expected.turned_triangles);
  REQUIRE(found == turned);
  return expected;
}

// A band of 2 n triangles, closed with half a turn or without.
TriangleMesh Band(VertexIndex n, bool half_turn) {
  TriangleMesh mesh;
  for (VertexIndex i = 0; i < n; ++i) {
    const double angle = 2 * 3.14159265 * static_cast<double>(i) / static_cast<double>(n);
    for (const double side : {-0.3, 0.3}) {
      const double turn = half_turn ? angle / 2 : 0;
      const double radius = 1 + side * std::cos(turn);
      mesh.positions.push_back(
          {radius * std::cos(angle), radius * std::sin(angle), side * std::sin(turn) + side});
    }
  }
  for (VertexIndex i = 0; i < n; ++i) {
    const VertexIndex a = 2 * i, b = 2 * i + 1;
    VertexIndex c = (2 * i + 2) % (2 * n), d = (2 * i + 3) % (2 * n);
    if (i + 1 == n && half_turn) std::swap(c, d);
    mesh.triangles.push_back({a, c, b});
    mesh.triangles.push_back({b, c, d});
  }
  return mesh;
}

// Of rows x columns cells; its poles are vertices. Looks outwards.
TriangleMesh Sphere(VertexIndex rows, VertexIndex columns) {
  TriangleMesh mesh;
  mesh.positions.push_back({0, 0, -1});
  for (VertexIndex r = 1; r < rows; ++r) {
    for (VertexIndex c = 0; c < columns; ++c) {
      const double up = 3.14159265 * static_cast<double>(r) / static_cast<double>(rows);
      const double around = 6.2831853 * static_cast<double>(c) / static_cast<double>(columns);
      mesh.positions.push_back(
          {std::sin(up) * std::cos(around), std::sin(up) * std::sin(around), -std::cos(up)});
    }
  }
  mesh.positions.push_back({0, 0, 1});
  const VertexIndex top = mesh.positions.size() - 1;
  const auto at = [&](VertexIndex r, VertexIndex c) { return 1 + (r - 1) * columns + c % columns; };
  for (VertexIndex c = 0; c < columns; ++c) {
    mesh.triangles.push_back({0, at(1, c + 1), at(1, c)});
    for (VertexIndex r = 1; r + 1 < rows; ++r) {
      mesh.triangles.push_back({at(r, c), at(r, c + 1), at(r + 1, c + 1)});
      mesh.triangles.push_back({at(r, c), at(r + 1, c + 1), at(r + 1, c)});
    }
    mesh.triangles.push_back({at(rows - 1, c), at(rows - 1, c + 1), top});
  }
  return mesh;
}

// Each with this chance.
void Flip(double chance, std::mt19937& random, TriangleMesh* mesh) {
  for (TriangleVertices& t : mesh->triangles) {
    if (std::uniform_real_distribution(0.0, 1.0)(random) < chance) std::swap(t[0], t[1]);
  }
}

// All vertices and triangles in another order.
void Shuffle(std::mt19937& random, TriangleMesh* mesh) {
  std::vector<VertexIndex> number(mesh->positions.size());
  for (size_t v = 0; v < number.size(); ++v) number[v] = v;
  std::shuffle(number.begin(), number.end(), random);
  const std::vector<Vec3d> old = mesh->positions;
  for (size_t v = 0; v < old.size(); ++v) mesh->positions[number[v]] = old[v];
  for (TriangleVertices& t : mesh->triangles) {
    for (VertexIndex& v : t) v = number[v];
  }
  std::shuffle(mesh->triangles.begin(), mesh->triangles.end(), random);
}

double Volume(const TriangleMesh& mesh, const std::vector<TriangleVertices>& triangles) {
  double volume = 0;
  for (const TriangleVertices& t : triangles) {
    volume += Dot(mesh.positions[t[0]], Cross(mesh.positions[t[1]], mesh.positions[t[2]])) / 6;
  }
  return volume;
}

// 64 bytes make as many blocks as there may be.
constexpr size_t kMemories[] = {64, 100'000, 16 << 20};

}  // namespace

TEST_CASE("Sheets of random soups are oriented as the definition says") {
  std::mt19937 random(1);
  OrientedMesh sum;
  for (int i = 0; i < 3000; ++i) {
    INFO("soup " << i);
    const uint64_t vertices = 4 + random() % 9;
    TriangleMesh soup;
    for (uint64_t v = 0; v < vertices; ++v) {
      soup.positions.push_back({static_cast<double>(random() % 100), 1.0 * v, 0});
    }
    for (uint64_t left = 1 + random() % 20; left > 0; --left) {
      const VertexIndex a = random() % vertices;
      const VertexIndex b = (a + 1 + random() % (vertices - 1)) % vertices;
      VertexIndex c = random() % vertices;
      while (c == a || c == b) c = (c + 1) % vertices;
      soup.triangles.push_back({a, b, c});
    }
    const OrientedMesh found = RequireAgreement(soup, kMemories[i % 3]);
    sum.turned_triangles += found.turned_triangles;
    sum.unorientable_sheets += found.unorientable_sheets;
  }
  CHECK(sum.turned_triangles > 1000);
  CHECK(sum.unorientable_sheets > 0);
}

TEST_CASE("Sheets of surfaces with faults are oriented as the definition says") {
  std::mt19937 random(2);
  uint64_t unorientable = 0;
  for (int i = 0; i < 300; ++i) {
    INFO("mesh " << i);
    TriangleMesh mesh = i % 3 == 0   ? Sphere(4 + random() % 8, 4 + random() % 8)
                        : i % 3 == 1 ? Band(4 + random() % 60, true)
                                     : Band(4 + random() % 60, false);
    const VertexIndex count = mesh.positions.size();
    const size_t own = mesh.triangles.size();
    for (size_t more = random() % 6; more > 0; --more) {  // repeated, opposite, and third ones
      TriangleVertices t = mesh.triangles[random() % own];
      if (random() % 3 == 0) std::swap(t[1], t[2]);
      if (random() % 3 == 0) t[2] = random() % count;
      if (t[2] != t[0] && t[2] != t[1]) mesh.triangles.push_back(t);
    }
    for (size_t less = random() % 6; less > 0; --less) mesh.triangles.pop_back();
    Flip(0.1 * static_cast<double>(random() % 6), random, &mesh);
    if (random() % 2 == 0) Shuffle(random, &mesh);
    unorientable += RequireAgreement(mesh, kMemories[random() % 3]).unorientable_sheets;
  }
  CHECK(unorientable > 15);
}

TEST_CASE("The memory does not change how sheets are oriented") {
  std::mt19937 random(3);
  TriangleMesh mesh = Sphere(60, 90);
  Flip(0.5, random, &mesh);
  Shuffle(random, &mesh);
  for (const size_t memory : kMemories) RequireAgreement(mesh, memory);
}

TEST_CASE("A sphere of which some triangles look inwards looks outwards") {
  std::mt19937 random(4);
  TriangleMesh mesh = Sphere(40, 60);
  const double volume = Volume(mesh, mesh.triangles);
  REQUIRE(volume > 4);
  const std::vector<TriangleVertices> before = mesh.triangles;
  Flip(0.3, random, &mesh);
  uint64_t flipped = 0;
  for (size_t i = 0; i < before.size(); ++i) flipped += mesh.triangles[i] != before[i];
  SheetReport report;
  const std::vector<TriangleVertices> found = Oriented(mesh, 4096, &report);
  CHECK(report.turned_triangles == flipped);
  CHECK(report.unorientable_sheets == 0);
  CHECK(Volume(mesh, found) == Approx(volume));
  mesh.triangles = found;
  Oriented(mesh, 4096, &report);
  CHECK(report.inconsistent_edges == 0);
  CHECK(report.turned_triangles == 0);
}

TEST_CASE("A consistent sheet that looks inwards stays, as the wall of a cavity") {
  TriangleMesh mesh = Sphere(8, 12);
  for (TriangleVertices& t : mesh.triangles) std::swap(t[0], t[1]);
  SheetReport report;
  CHECK(Oriented(mesh, 4096, &report) == mesh.triangles);
  CHECK(report.turned_triangles == 0);
}

TEST_CASE("A Moebius band is counted and stays as it is") {
  std::mt19937 random(5);
  for (const size_t memory : kMemories) {
    TriangleMesh mesh = Band(200, true);
    SheetReport report;
    CHECK(Oriented(mesh, memory, &report) == mesh.triangles);
    CHECK(report.unorientable_sheets == 1);
    CHECK(report.inconsistent_edges == 1);
    CHECK(report.turned_triangles == 0);
    Flip(0.5, random, &mesh);
    CHECK(Oriented(mesh, memory, &report) == mesh.triangles);
    CHECK(report.unorientable_sheets == 1);
    TriangleMesh other = Band(200, false);
    Flip(0.4, random, &other);
    Oriented(other, memory, &report);
    CHECK(report.unorientable_sheets == 0);
    CHECK(report.turned_triangles > 100);
  }
}

TEST_CASE("Meshes of users become consistent after random flips") {
  const std::string folder = std::string(MTDB_SOURCE_DIR) + "/../shared/data/";
  std::mt19937 random(6);
  for (const char* name : {"bunny.ply", "skull.obj", "dragon_res2_ascii_nonmanifold.ply"}) {
    if (!std::filesystem::exists(folder + name)) {
      WARN("skipped: no " << folder << name);
      continue;
    }
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    MeshReadReport read;
    REQUIRE(ReadMeshFile(folder + name, sink, &read).ok());
    std::erase_if(mesh.triangles, [](const TriangleVertices& t) {
      return t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
    });
    CAPTURE(name);
    RequireAgreement(mesh, 1 << 20);
    Flip(0.2, random, &mesh);
    const OrientedMesh once = RequireAgreement(mesh, 1 << 20);
    TurnOver(once, &mesh.triangles);
    const OrientedMesh twice = RequireAgreement(mesh, 1 << 20);
    CHECK(twice.turned_triangles == 0);
    CHECK(twice.unorientable_sheets == once.unorientable_sheets);
    if (once.unorientable_sheets == 0) CHECK(twice.inconsistent_edges == 0);
  }
}

TEST_CASE("More triangles than the memory takes are refused with what helps") {
  // Nothing is allocated before.
  const Result<uint32_t> block = SheetBlock(uint64_t{1} << 36, 1 << 20);
  REQUIRE(block.status().code() == StatusCode::kBudgetExceeded);
  CHECK_THAT(block.status().message(), Catch::Contains("--memory"));
}

}  // namespace mtdb::testing
