// SPDX-License-Identifier: Apache-2.0
// What is up: found once by the build, or as its options say, and kept in the record.
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <numbers>

#include "store/base/estimate_up.h"
#include "tests/builder/fixture.h"

namespace mtdb::testing {
namespace {

// A closed cone whose tip points along `axis`, with rings x columns x 2 triangles on its side, and
// a base of few.
TriangleMesh Cone(Vec3d axis, uint32_t rings, uint32_t columns) {
  const Vec3d u = std::fabs(axis.x) < 0.5 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0};
  const Vec3d v = Cross(axis, u);
  TriangleMesh mesh;
  for (uint32_t r = 0; r < rings; ++r) {
    const double radius = 10.0 * (rings - r) / rings, height = 25.0 * r / rings;
    for (uint32_t c = 0; c < columns; ++c) {
      const double angle = 2 * std::numbers::pi * c / columns;
      mesh.positions.push_back(u * (radius * std::cos(angle)) + v * (radius * std::sin(angle)) +
                               axis * (height + 1000));
    }
  }
  const auto tip = static_cast<VertexIndex>(mesh.positions.size());
  mesh.positions.push_back(axis * 1025.0);
  mesh.positions.push_back(axis * 1000.0);
  for (uint32_t c = 0; c < columns; ++c) {
    const uint32_t d = (c + 1) % columns, last = (rings - 1) * columns;
    for (uint32_t r = 0; r + 1 < rings; ++r) {
      const uint32_t a = r * columns;
      mesh.triangles.push_back({a + c, a + d, a + columns + d});
      mesh.triangles.push_back({a + c, a + columns + d, a + columns + c});
    }
    mesh.triangles.push_back({last + c, last + d, tip});
    mesh.triangles.push_back({d, c, tip + 1});
  }
  // Lossless stores keep float32.
  for (Vec3d& p : mesh.positions) {
    for (int i = 0; i < 3; ++i) p[i] = static_cast<float>(p[i]);
  }
  return mesh;
}

ObjectRecord Record(const TriangleMesh& mesh, const BuildOptions& options = {}) {
  TempStore store;
  const Result<ObjectRecord> record = BuildInto(store.database(), "object", mesh, options);
  REQUIRE(record.status().message() == "");
  return *record;
}

}  // namespace

TEST_CASE("A cone's tip is up, along whatever axis it points") {
  for (const Vec3d axis : {Vec3d{0, 0, 1}, Vec3d{0, 1, 0}, Vec3d{1, 0, 0}, Vec3d{0, 0, -1},
                           Vec3d{0, -1, 0}, Vec3d{-1, 0, 0}}) {
    CAPTURE(axis.x, axis.y, axis.z);
    const TriangleMesh cone = Cone(axis, 4, 24);
    REQUIRE(EstimateUp(cone) == axis);
    BuildOptions options;
    for (const PositionMode mode : {PositionMode::kGrid, PositionMode::kLossless}) {
      options.mode = mode;
      const ObjectRecord record = Record(cone, options);
      REQUIRE(record.up.has_value());
      CHECK(record.up->direction == axis);
      CHECK(!record.up->given);
    }
  }
}

TEST_CASE(
    "What is up in a large mesh is found from a coarser one, and does not depend on threads") {
  // More triangles than are kept of any mesh, nearly all of them on one side.
  const TriangleMesh cone = Cone({0, -1, 0}, 120, 240);
  REQUIRE(cone.triangles.size() > 55'000);
  BuildOptions options;
  for (const unsigned threads : {1U, 3U}) {
    options.threads = threads;
    CHECK(Record(cone, options).up->direction == Vec3d{0, -1, 0});
  }
}

TEST_CASE("The user's up and units are kept, and change nothing but the record") {
  const TriangleMesh cone = Cone({0, 1, 0}, 4, 24);
  const ObjectRecord found = Record(cone);
  BuildOptions options;
  options.up = Vec3d{0, -30, 40};
  options.units = "mm";
  const ObjectRecord given = Record(cone, options);
  REQUIRE(given.up.has_value());
  CHECK(given.up->given);
  CHECK(Length(given.up->direction - Vec3d{0, -0.6, 0.8}) < 1e-12);
  CHECK(given.units == "mm");
  CHECK(found.units.empty());
  CHECK(given.index_checksum == found.index_checksum);
  CHECK(given.digest_hex() != found.digest_hex());
}

TEST_CASE("Terrains have z up, whatever their shape") {
  BuildOptions options;
  options.height_field = true;
  // So steep that it would stand otherwise.
  TriangleMesh hill = MakeTerrain(400);
  for (Vec3d& p : hill.positions) p.z *= 40;
  CHECK(Record(hill, options).up->direction == Vec3d{0, 0, 1});
  options.up = Vec3d{0, 0, 2};
  CHECK(Record(hill, options).up->direction == Vec3d{0, 0, 1});
}

TEST_CASE("Up and units that are none are refused") {
  const TriangleMesh mesh = MakeTerrain(200);
  const auto refused = [&](const auto& change) {
    BuildOptions options;
    change(options);
    TempStore store;
    const Status status = BuildInto(store.database(), "object", mesh, options).status();
    CHECK(store.database().List().value().empty());
    return status.code() == StatusCode::kInvalidArgument;
  };
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  CHECK(refused([](BuildOptions& o) { o.up = Vec3d{0, 0, 0}; }));
  CHECK(refused([](BuildOptions& o) { o.up = Vec3d{0, kInfinity, 0}; }));
  CHECK(refused([](BuildOptions& o) { o.up = Vec3d{0, std::nan(""), 1}; }));
  CHECK(refused([](BuildOptions& o) { o.units = "parsec"; }));
  CHECK(refused([](BuildOptions& o) {
    o.height_field = true;
    o.up = Vec3d{0, 1, 0};
  }));
}

}  // namespace mtdb::testing
