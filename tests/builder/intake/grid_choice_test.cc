// SPDX-License-Identifier: Apache-2.0
// The grid that is chosen from the data, against counts by definition.
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "builder/intake/corner_gather.h"
#include "builder/mesh_survey.h"
#include "tests/builder/fixture.h"

namespace mtdb::testing {

using namespace internal;

namespace {

MeshSurvey SurveyOfMesh(const TriangleMesh& mesh, const BuildOptions& options = {}) {
  const Result<MeshSurvey> survey =
      SurveyMesh([&](MeshSink& sink) { return SendMesh(mesh, sink); }, options);
  INFO(survey.status().message());
  REQUIRE(survey.ok());
  return *survey;
}

bool OnALine(Vec3i a, Vec3i b, Vec3i c) {
  const auto wide = [](Vec3i p) { return Vec3<int64_t>{p.x, p.y, p.z}; };
  return Cross(wide(b) - wide(a), wide(c) - wide(a)) == Vec3<int64_t>{};
}

uint64_t Collapsed(const TriangleMesh& mesh, const Grid& grid) {
  uint64_t count = 0;
  for (const TriangleVertices& t : mesh.triangles) {
    count += OnALine(grid.Quantize(mesh.positions[t[0]]), grid.Quantize(mesh.positions[t[1]]),
                     grid.Quantize(mesh.positions[t[2]]));
  }
  return count;
}

// A grid of unit squares, of which `thin` have a sliver of that height on their diagonal.
TriangleMesh WithSlivers(int side, int thin, double height) {
  TriangleMesh mesh;
  mesh.header.double_positions = true;
  const auto add = [&](Vec3d a, Vec3d b, Vec3d c) {
    const VertexIndex first = mesh.positions.size();
    for (const Vec3d p : {a, b, c}) mesh.positions.push_back(p);
    mesh.triangles.push_back({first, first + 1, first + 2});
  };
  std::mt19937 random(7);
  std::uniform_real_distribution<double> jitter(0, 0.2);
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const Vec3d a{x + jitter(random), y + jitter(random), jitter(random)};
      add(a, a + Vec3d{0.7, 0.1, 0.3}, a + Vec3d{0.1, 0.7, 0.2});
      if (thin-- > 0) add(a, a + Vec3d{0.7, 0.1, 0.3}, a + Vec3d{0.35, 0.05, 0.15 + height});
    }
  }
  return mesh;
}

}  // namespace

TEST_CASE("A survey counts what a grid collapses as the definition does") {
  const TriangleMesh mesh = WithSlivers(30, 400, 1e-3);
  for (const int bits : {6, 8, 10, 12, 14, 16, 20}) {
    BuildOptions options;
    options.bits = bits;
    options.max_collapsed = 1;
    const MeshSurvey survey = SurveyOfMesh(mesh, options);
    INFO(bits << " bits");
    CHECK(survey.collapsed_triangles == Collapsed(mesh, survey.grid));
    CHECK(survey.bits == bits);
    CHECK(survey.reason == GridReason::kGiven);
    CHECK(survey.flat_triangles == 0);
  }
  BuildOptions coarse;
  coarse.bits = 10;
  coarse.max_collapsed = 1;
  CHECK(SurveyOfMesh(mesh, coarse).collapsed_triangles > 100);
}

TEST_CASE("The chosen grid leaves thin triangles their area, and is no finer than that needs") {
  for (const double height : {1e-2, 1e-3, 3e-4, 1e-4}) {
    const TriangleMesh mesh = WithSlivers(30, 400, height);
    const MeshSurvey survey = SurveyOfMesh(mesh);
    INFO("height " << height << ": " << int{survey.bits} << " bits");
    CHECK(Collapsed(mesh, survey.grid) == 0);
    CHECK(survey.collapsed_triangles == 0);
    if (survey.bits == 16) {
      CHECK(survey.reason == GridReason::kLeastBits);
      continue;
    }
    CHECK(survey.reason == GridReason::kSlivers);
    CHECK(survey.collapsed_at_16_bits > 0);
    BuildOptions coarser;
    coarser.bits = survey.bits - 1;
    CHECK(SurveyOfMesh(mesh, coarser).collapsed_triangles > 0);
  }
}

TEST_CASE("Triangles without area ask for nothing") {
  TriangleMesh mesh = WithSlivers(20, 0, 0);
  const int bits = SurveyOfMesh(mesh).bits;
  const VertexIndex v = mesh.positions.size();
  for (const double t : {0.0, 0.37, 1.0}) mesh.positions.push_back(t * Vec3d{3.1, 1.7, 0.9});
  mesh.triangles.push_back({v, v + 1, v + 2});
  const MeshSurvey survey = SurveyOfMesh(mesh);
  CHECK(survey.flat_triangles == 1);
  CHECK(survey.bits == bits);
}

TEST_CASE("Short edges make the grid finer") {
  // Squares of one hundredth, at the ends of a field of 10,000.
  TriangleMesh mesh = WithSlivers(20, 0, 0);
  for (Vec3d& p : mesh.positions) p = p * 0.01;
  mesh.positions.push_back({7777.7777777, 1.2345678, 0.1});
  mesh.triangles.push_back({0, 1, mesh.positions.size() - 1});
  const MeshSurvey survey = SurveyOfMesh(mesh);
  CHECK(survey.bits > 16);
  CHECK(survey.grid.step <= survey.edges.percentile1 / 4);
  CHECK(survey.edges.longest == Approx(7777.7).epsilon(0.01));
}

TEST_CASE("Coordinates that are decimals are kept as they are written") {
  // Whole metres over 220 km, as heights have them: 16 bits would be steps of 3.4 m.
  for (const bool single : {false, true}) {
    TriangleMesh mesh;
    mesh.header.double_positions = !single;
    std::mt19937 random(3);
    for (int y = 0; y < 40; ++y) {
      for (int x = 0; x < 40; ++x) {
        mesh.positions.push_back({5500.0 * x, 5501.0 * y, static_cast<double>(random() % 3000)});
      }
    }
    for (VertexIndex y = 0; y < 39; ++y) {
      for (VertexIndex x = 0; x < 39; ++x) {
        const VertexIndex v = 40 * y + x;
        mesh.triangles.push_back({v, v + 1, v + 41});
        mesh.triangles.push_back({v, v + 41, v + 40});
      }
    }
    const MeshSurvey survey = SurveyOfMesh(mesh);
    CHECK(survey.reason == GridReason::kDecimals);
    CHECK(survey.grid.step == 1);
    const BuiltObject built = Build(mesh);
    CHECK(built.record.rounding_error == 0);
    CHECK(built.record.bits == 18);
    // Finer on the plane than four bits more can tell: the heights stay as they are written.
    if (!single) {
      TriangleMesh fine = mesh;
      for (Vec3d& p : fine.positions) p.x = std::round((p.x + 0.1) * 10) / 10;
      const MeshSurvey heights = SurveyOfMesh(fine);
      CHECK(heights.reason == GridReason::kSomeDecimals);
      CHECK(heights.grid.step == 1);
    }
    // Heights alone: the step is a part of their unit.
    for (Vec3d& p : mesh.positions) p.x *= 0.70710678118654752;
    if (single) {
      for (Vec3d& p : mesh.positions) p.x = static_cast<float>(p.x);
    }
    const MeshSurvey mixed = SurveyOfMesh(mesh);
    CHECK(mixed.reason == GridReason::kSomeDecimals);
    CHECK(1 / mixed.grid.step == std::floor(1 / mixed.grid.step));
    // Centimetres as float32 values, near enough to 0 that they are some.
    for (Vec3d& p : mesh.positions) {
      for (int i = 0; i < 3; ++i) p[i] = std::round(p[i] / 10) / 100;
      if (single) {
        for (int i = 0; i < 3; ++i) p[i] = static_cast<float>(p[i]);
      }
    }
    CHECK(SurveyOfMesh(mesh).grid.step == Approx(0.01).epsilon(1e-12));
  }
}

TEST_CASE("A grid on which most triangles have no area is refused, with what to do") {
  const TriangleMesh mesh = MakeSculpture(2000);
  for (const double step : {1.0, 1e30}) {
    BuildOptions options;
    options.step = step;
    TempStore store;
    const Result<ObjectRecord> record = BuildInto(store.database(), "object", mesh, options);
    REQUIRE(record.status().code() == StatusCode::kInvalidArgument);
    for (const char* words : {"leaves no area", "half of its edges", "16 bits"}) {
      CHECK_THAT(record.status().message(), Catch::Contains(words));
    }
  }
}

// Cells of 5 cm in a projection's coordinates, heights that are no decimals, and triangles from the
// first two vertices to each of `far`.
TriangleMesh Scan(int side, const std::vector<Vec3d>& far) {
  TriangleMesh mesh;
  mesh.header.double_positions = true;
  const auto n = static_cast<VertexIndex>(side);
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      mesh.positions.push_back({431234.5 + 0.05 * x, 4812345.5 + 0.05 * y,
                                321 + 0.03 * std::sin(x / 3.0) * std::cos(y / 4.0)});
    }
  }
  for (VertexIndex y = 0; y + 1 < n; ++y) {
    for (VertexIndex x = 0; x + 1 < n; ++x) {
      const VertexIndex v = y * n + x;
      mesh.triangles.push_back({v, v + 1, v + n + 1});
      mesh.triangles.push_back({v, v + n + 1, v + n});
    }
  }
  for (const Vec3d p : far) {
    mesh.positions.push_back(p);
    mesh.triangles.push_back({0, 1, mesh.positions.size() - 1});
  }
  return mesh;
}

TEST_CASE("What lies far off a mesh makes its grid refused, and is named") {
  const Vec3d at{431234.5, 4812345.5, 321};
  std::vector<Vec3d> many;
  for (int i = 0; i < 20; ++i) many.push_back(at + Vec3d{3e5 * i + 1e6, -2e5 * i, 7.0 * i});
  const std::vector<std::vector<Vec3d>> cases{{{0, 0, 0}},
                                              {at + Vec3d{0, 0, 1e9}},
                                              {at + Vec3d{-3e6, 0, 0}},
                                              {at + Vec3d{5e6, 0, 0}, at - Vec3d{5e6, 2e6, 0}},
                                              many};
  for (const std::vector<Vec3d>& far : cases) {
    const TriangleMesh mesh = Scan(40, far);
    INFO(far.size() << " far, the first at " << far[0].x << ' ' << far[0].y << ' ' << far[0].z);
    const MeshSurvey survey = SurveyOfMesh(mesh);
    CHECK(survey.flat_triangles == 0);
    CHECK(survey.collapsed_triangles == Collapsed(mesh, survey.grid));
    CHECK(survey.refusal.code() == StatusCode::kBadInput);
    REQUIRE(survey.far_vertices);
    CHECK(survey.far_vertices->count == far.size());
    CHECK(survey.far_vertices->vertices == 1600 + far.size());
    CHECK(survey.far_vertices->vertex == 1600);
    CHECK(survey.far_vertices->position == far[0]);
    for (const char* words : {"leaves no area", "vertex 1600", "cut"}) {
      CHECK_THAT(survey.refusal.message(), Catch::Contains(words));
    }
    TempStore store;
    for (const int bits : {0, 1, 12, 24}) {
      BuildOptions options;
      if (bits != 0) options.bits = bits;
      const Status status = BuildInto(store.database(), "object", mesh, options).status();
      INFO(bits << " bits: " << status.message());
      REQUIRE_FALSE(status.ok());
      CHECK_THAT(status.message(), Catch::Contains("vertex 1600"));
    }
    BuildOptions fine;
    fine.step = 0.001;
    const Status status = BuildInto(store.database(), "object", mesh, fine).status();
    CHECK_THAT(status.message(), Catch::Contains("2^24 steps") && Catch::Contains("vertex 1600"));
  }
}

TEST_CASE("A far vertex that no triangle uses, and large coordinates as such, harm nothing") {
  TriangleMesh mesh = Scan(40, {});
  for (const bool stray : {false, true}) {
    if (stray) mesh.positions.push_back({0, 0, 0});
    const MeshSurvey survey = SurveyOfMesh(mesh);
    CHECK(survey.refusal.ok());
    CHECK(survey.collapsed_triangles == 0);
    CHECK(survey.flat_triangles == 0);
    CHECK_FALSE(survey.far_vertices);
  }
  for (const double scale : {1e-12, 1e12}) {
    TriangleMesh scaled = mesh;
    for (Vec3d& p : scaled.positions) p = p * scale;
    CHECK(SurveyOfMesh(scaled).refusal.ok());
    CHECK(SurveyOfMesh(scaled).flat_triangles == 0);
  }
  // So far that the grid is still fine.
  CHECK(SurveyOfMesh(Scan(40, {Vec3d{434000, 4812345, 300}})).refusal.ok());
  // As float32 it has no area to lose.
  mesh.header.double_positions = false;
  for (Vec3d& p : mesh.positions) {
    for (int i = 0; i < 3; ++i) p[i] = static_cast<float>(p[i]);
  }
  CHECK(SurveyOfMesh(mesh).refusal.ok());
}

TEST_CASE("Of two parts far from each other the smaller one is named, and lossless where it can") {
  TriangleMesh mesh = Scan(40, {});
  for (Vec3d& p : mesh.positions) {
    for (int i = 0; i < 3; ++i)
      p[i] = static_cast<float>(p[i] - Vec3d{431234.5, 4812345.5, 321}[i]);
  }
  const TriangleMesh one = mesh;
  for (const Vec3d p : one.positions) {
    mesh.positions.push_back(p * 8 + Vec3d{0, 16777216, 0});
  }
  for (size_t t = 0; t < 2500; ++t) {
    TriangleVertices corners = one.triangles[t];
    for (VertexIndex& v : corners) v += one.positions.size();
    mesh.triangles.push_back(corners);
  }
  mesh.header.double_positions = false;
  for (Vec3d& p : mesh.positions) {
    for (int i = 0; i < 3; ++i) p[i] = static_cast<float>(p[i]);
  }
  const MeshSurvey survey = SurveyOfMesh(mesh);
  REQUIRE_FALSE(survey.refusal.ok());
  REQUIRE(survey.far_vertices);
  CHECK(survey.far_vertices->position.y > 1e7);
  CHECK(survey.far_vertices->count < 1600);
  CHECK_THAT(survey.refusal.message(), Catch::Contains("--lossless"));
  BuildOptions lossless;
  lossless.mode = PositionMode::kLossless;
  CHECK(SurveyOfMesh(mesh, lossless).refusal.ok());
}

TEST_CASE("Components are counted") {
  TriangleMesh mesh = WithSlivers(5, 0, 0);
  CHECK(SurveyOfMesh(mesh).components == 25);
  CHECK(SurveyOfMesh(MakeSculpture(2000)).components == 1);
}

TEST_CASE("Corners are looked up the same in memory and out of core") {
  std::mt19937 random(11);
  const SpoolSpace space{"."};
  for (const uint64_t rows : {1u, 1000u, 300'000u, 1'000'000u}) {
    constexpr size_t kStride = 17;
    constexpr size_t kBytes = 12;
    Spool table_spool(&space, 1 << 16), triangles(&space, 1 << 16);
    std::vector<std::array<std::byte, kStride>> table(rows);
    for (auto& row : table) {
      for (std::byte& b : row) b = static_cast<std::byte>(random());
      REQUIRE(table_spool.Append(row.data(), kStride).ok());
    }
    std::vector<std::array<uint32_t, 3>> corners(200'000);
    for (auto& t : corners) {
      for (uint32_t& v : t) v = static_cast<uint32_t>(random() % rows);
      REQUIRE(triangles.Append(t.data(), sizeof(t)).ok());
    }
    REQUIRE(table_spool.Finish().ok());
    REQUIRE(triangles.Finish().ok());
    const CornerTable lookup{&table_spool, rows, kStride, kBytes};
    for (const size_t memory : {size_t{1} << 30, size_t{1} << 20}) {
      size_t at = 0;
      bool same = true;
      const Status status = GatherCorners(
          triangles, lookup, &space, memory,
          [&](const std::array<uint32_t, 3>& t, const std::array<const std::byte*, 3>& found) {
            same = same && t == corners[at++];
            for (size_t c = 0; c < 3; ++c) {
              same = same && std::memcmp(found[c], table[t[c]].data(), kBytes) == 0;
            }
            return Status::Ok();
          });
      REQUIRE(status.ok());
      CHECK(at == corners.size());
      CHECK(same);
    }
  }
  CHECK(space.file_bytes == 0);
}

}  // namespace mtdb::testing
