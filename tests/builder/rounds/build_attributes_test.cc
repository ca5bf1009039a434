// SPDX-License-Identifier: Apache-2.0
// Attributes that are rounded when they come in: within what was promised, and the same ever after.
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <map>

#include "store/base/attribute_grid.h"
#include "tests/builder/fixture.h"

namespace mtdb::testing {
namespace {

struct Row {
  uint32_t id;
  uint8_t colour[3];
  float normal[3];
  float quality;
  double time;
};
constexpr size_t kRowBytes = 4 + 3 + 12 + 4 + 8;

Row ReadRow(const Bytes& rows, size_t vertex) {
  ByteReader r(ByteSpan(rows).subspan(vertex * kRowBytes, kRowBytes));
  Row row{};
  row.id = r.Get<uint32_t>();
  for (uint8_t& c : row.colour) c = r.Get<uint8_t>();
  for (float& c : row.normal) c = r.Get<float>();
  row.quality = r.Get<float>();
  row.time = r.Get<double>();
  return row;
}

Vec3d Normal(const Row& row) { return {row.normal[0], row.normal[1], row.normal[2]}; }

TriangleMesh MakeAttributed(uint64_t triangles) {
  TriangleMesh mesh = MakeSculpture(triangles);
  mesh.header.attributes.attributes = {
      {"id", ScalarType::kUint32},   {"red", ScalarType::kUint8},
      {"green", ScalarType::kUint8}, {"blue", ScalarType::kUint8},
      {"nx", ScalarType::kFloat32},  {"ny", ScalarType::kFloat32},
      {"nz", ScalarType::kFloat32},  {"quality", ScalarType::kFloat32},
      {"time", ScalarType::kFloat64}};
  std::mt19937_64 random(5);
  std::normal_distribution<double> coordinate;
  ByteWriter w;
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    w.Put(static_cast<uint32_t>(v));
    for (int i = 0; i < 3; ++i) w.Put(static_cast<uint8_t>(random() % 256));
    const Vec3d n{coordinate(random), coordinate(random), coordinate(random)};
    for (int i = 0; i < 3; ++i) w.Put(static_cast<float>(n[i] / Length(n)));
    w.Put(static_cast<float>(100 * coordinate(random)));
    w.Put(1e6 + coordinate(random));
  }
  mesh.rows = w.Take();
  return mesh;
}

BuildOptions Rounding() {
  BuildOptions options;
  options.tile_triangles = 1024;
  options.normal_bits = 10;
  options.attribute_steps = {{"quality", 0.25}, {"time", 1e-3}};
  return options;
}

}  // namespace

TEST_CASE("Rounded attributes come back within their promise, and built again bit by bit") {
  const TriangleMesh mesh = MakeAttributed(8000);
  const BuiltObject built = Build(mesh, Rounding());
  const std::vector<VertexAttribute>& stored = built.record.attributes.attributes;
  CHECK(stored[4].normal_bits == 10);
  CHECK(stored[7].step == 0.25);
  CHECK(stored[8].step == 1e-3);
  CHECK(built.surface->record().attributes == built.record.attributes);
  TriangleMesh full = Extract(*built.surface, Query{});
  REQUIRE(full.rows.size() == mesh.positions.size() * kRowBytes);
  const double angle = 2.13 / OctahedralCentre(10);
  double worst_angle = 0;
  double worst_quality = 0;
  double worst_time = 0;
  for (size_t v = 0; v < full.positions.size(); ++v) {
    const Row now = ReadRow(full.rows, v);
    const Row before = ReadRow(mesh.rows, now.id);
    REQUIRE(std::memcmp(now.colour, before.colour, 3) == 0);
    REQUIRE(Length(Normal(now)) == Approx(1).margin(1e-6));
    worst_angle = std::max(worst_angle, Length(Normal(now) - Normal(before)));
    worst_quality = std::max(worst_quality, std::abs(double{now.quality} - before.quality));
    worst_time = std::max(worst_time, std::abs(now.time - before.time));
  }
  CHECK(worst_angle <= angle);
  CHECK(worst_quality <= 0.125 * 1.0001);
  CHECK(worst_time <= 0.5e-3 * 1.0001);
  CHECK(worst_angle > 0.3 * angle);
  CHECK(worst_quality > 0.12);
  CHECK(worst_time > 0.49e-3);

  // What was rounded stays as it is, and so does every triangle.
  const BuiltObject again = Build(full, Rounding());
  CHECK(Triangles(Extract(*again.surface, Query{})) == Triangles(full));
  // A layout's promise counts for nothing unless the options make it.
  full.rows = mesh.rows;
  const BuiltObject lossless = Build(full);
  CHECK(lossless.record.attributes == mesh.header.attributes);
  CHECK(lossless.record.payload_bytes > built.record.payload_bytes);
}

TEST_CASE("Rounding smaller makes objects smaller") {
  const TriangleMesh mesh = MakeAttributed(4000);
  uint64_t last = Build(mesh).record.payload_bytes;
  for (const int bits : {16, 12, 8}) {
    BuildOptions options;
    options.normal_bits = bits;
    const uint64_t bytes = Build(mesh, options).record.payload_bytes;
    CHECK(bytes < last);
    last = bytes;
  }
}

TEST_CASE("Rounding that the input does not allow is refused") {
  const TriangleMesh mesh = MakeAttributed(200);
  const auto build = [](const TriangleMesh& input, const auto& change) {
    BuildOptions options;
    change(options);
    TempStore store;
    const auto record = BuildInto(store.database(), "object", input, options);
    REQUIRE(!record.ok());
    REQUIRE(store.database().List().value().empty());
    return record.status();
  };
  using O = BuildOptions;
  const auto code = [&](const auto& change) { return build(mesh, change).code(); };
  CHECK(code([](O& o) { o.normal_bits = 3; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.normal_bits = 17; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.attribute_steps = {{"none", 1}}; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.attribute_steps = {{"red", 1}}; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.attribute_steps = {{"time", 0}}; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) {
          o.attribute_steps = {{"time", 1}, {"time", 2}};
        }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) {
          o.normal_bits = 8;
          o.attribute_steps = {{"ny", 1}};
        }) == StatusCode::kInvalidArgument);
  const Status far = build(mesh, [](O& o) { o.attribute_steps = {{"quality", 1e-7}}; });
  CHECK(far.code() == StatusCode::kBadInput);
  CHECK(far.message().find("vertex 0: quality: ") != std::string::npos);
  TriangleMesh bare = mesh;
  bare.header.attributes = {};
  bare.rows = {};
  CHECK(build(bare, [](O& o) { o.normal_bits = 8; }).code() == StatusCode::kInvalidArgument);
  TriangleMesh broken = mesh;
  const float nan = std::nanf("");
  std::memcpy(broken.rows.data() + 7 * kRowBytes + 7, &nan, sizeof(nan));
  const Status not_finite = build(broken, [](O& o) { o.normal_bits = 8; });
  CHECK(not_finite.code() == StatusCode::kBadInput);
  CHECK(not_finite.message().find("vertex 7: nx: ") != std::string::npos);
}

}  // namespace mtdb::testing
