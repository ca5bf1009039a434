// SPDX-License-Identifier: Apache-2.0
// What BuildObject refuses, and what a failed or cancelled build leaves behind: nothing.
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

#include "store/verify_store.h"
#include "tests/builder/fixture.h"

namespace mtdb::testing {
namespace {

StatusCode CodeOf(const TriangleMesh& mesh, const BuildOptions& options) {
  TempStore store;
  const Result<ObjectRecord> record = BuildInto(store.database(), "object", mesh, options);
  REQUIRE(!record.ok());
  REQUIRE(!record.status().message().empty());
  REQUIRE(record.status().message().find('\n') == std::string::npos);
  REQUIRE(store.database().List().value().empty());
  return record.status().code();
}

// Passes everything on until call `fail_at`, counted from 0.
class FailingWriter final : public ObjectWriter {
 public:
  FailingWriter(std::unique_ptr<ObjectWriter> writer, int fail_at)
      : writer_(std::move(writer)), left_(fail_at) {}

  Result<UnitId> Add(const UnitEntry& entry, std::span<const UnitId> children,
                     ByteSpan payload) override {
    if (left_-- == 0) return Failure();
    return writer_->Add(entry, children, payload);
  }
  Status AddTextureFile(uint32_t page, ByteSpan part) override {
    if (left_-- == 0) return Failure();
    return writer_->AddTextureFile(page, part);
  }
  Result<ObjectRecord> Publish(const ObjectRecord& record, const BeforePublish& before) override {
    if (left_-- == 0) return Failure();
    return writer_->Publish(record, before);
  }
  bool failed() const { return left_ < 0; }

 private:
  static Status Failure() { return {StatusCode::kNoSpace, "the disk is full"}; }
  std::unique_ptr<ObjectWriter> writer_;
  int left_;
};

BuildOptions SmallTiles() {
  BuildOptions options;
  options.tile_triangles = 512;
  return options;
}

}  // namespace

TEST_CASE("Options outside their range are refused") {
  const TriangleMesh mesh = MakeTerrain(200);
  const auto code = [&](const auto& change) {
    BuildOptions options;
    change(options);
    return CodeOf(mesh, options);
  };
  using O = BuildOptions;
  CHECK(code([](O& o) { o.bits = 0; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.bits = 25; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.bits = -3; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.step = 0; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.step = -1; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.step = std::nan(""); }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.step = HUGE_VAL; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.step = 1e-9; }) == StatusCode::kInvalidArgument);  // over 2^24 cells
  CHECK(code([](O& o) { o.degree_limit = 3; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.degree_limit = 17; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.tile_triangles = 63; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.tile_triangles = 16385; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.reduction = 1; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.reduction = 0; }) == StatusCode::kInvalidArgument);
  CHECK(code([](O& o) { o.memory_bytes = 1 << 20; }) == StatusCode::kInvalidArgument);
}

TEST_CASE("A degree limit is kept") {
  const TriangleMesh mesh = MakeSculpture(4000);
  for (const uint32_t limit : {4u, 6u, 16u}) {
    BuildOptions options = SmallTiles();
    options.degree_limit = limit;
    const BuiltObject built = Build(mesh, options);
    REQUIRE(built.record.max_degree <= limit);
    REQUIRE(built.record.degree_limit == limit);
  }
}

TEST_CASE("Meshes that are none are refused") {
  const TriangleMesh good = MakeTerrain(200);
  const auto code = [&](const auto& change) {
    TriangleMesh mesh = good;
    change(mesh);
    return CodeOf(mesh, {});
  };
  using M = TriangleMesh;
  CHECK(code([](M& m) { m.triangles.clear(); }) == StatusCode::kBadInput);
  CHECK(code([](M& m) { m.triangles.assign(5, {1, 2, 1}); }) == StatusCode::kBadInput);
  CHECK(code([](M& m) { m = M{}; }) == StatusCode::kBadInput);
  CHECK(code([](M& m) { m.triangles[7][1] = m.positions.size(); }) == StatusCode::kBadInput);
  CHECK(code([](M& m) { m.triangles[7][2] = ~VertexIndex{0}; }) == StatusCode::kBadInput);
  CHECK(code([](M& m) { m.positions[9].y = std::nan(""); }) == StatusCode::kBadInput);
  CHECK(code([](M& m) { m.positions[9].z = HUGE_VAL; }) == StatusCode::kBadInput);
  CHECK(code([](M& m) { m.positions[9].z = -HUGE_VAL; }) == StatusCode::kBadInput);
}

TEST_CASE("Lossless refuses coordinates that float32 cannot hold") {
  TriangleMesh mesh = MakeTerrain(200);
  BuildOptions lossless;
  lossless.mode = PositionMode::kLossless;
  REQUIRE(Build(mesh, lossless).record.bits == 32);
  for (int i = 0; i < 3; ++i) {
    for (const bool declared : {false, true}) {
      TriangleMesh bad = mesh;
      bad.header.double_positions = declared;
      bad.positions[11][i] = 0.1;  // between two float32 values
      CHECK(CodeOf(bad, lossless) == StatusCode::kBadInput);
      bad.positions[11][i] = 2e30;
      CHECK(CodeOf(bad, lossless) == StatusCode::kBadInput);
      bad.positions[11][i] = -0.0;
      CHECK(Build(bad, lossless).record.vertices == mesh.positions.size());
    }
  }
}

TEST_CASE("Coordinates far from the origin and of any size are accepted") {
  for (const double scale : {1e-30, 1e-6, 1.0, 1e6, 1e22}) {
    TriangleMesh mesh = MakeTerrain(1000);
    for (Vec3d& p : mesh.positions) p = (p + Vec3d{5e6, -3e6, 0}) * scale;
    mesh.header.double_positions = true;
    const BuiltObject built = Build(mesh, SmallTiles());
    const TriangleMesh full = Extract(*built.surface, Query{});
    const bool same = Triangles(full) == ExpectedTriangles(mesh, built.record.grid);
    CHECK(same);
    CHECK(built.record.root_triangles < 500);
  }
}

TEST_CASE("A cancelled build leaves no object, and the store can be used again") {
  const TriangleMesh mesh = MakeSculpture(6000);
  const std::string digest = Build(mesh, SmallTiles()).record.digest_hex();
  TempStore store;
  REQUIRE(BuildInto(store.database(), "keep", mesh, SmallTiles()).ok());
  int calls = 0;
  for (int cancel_at = 0;; ++cancel_at) {
    calls = 0;
    const Result<ObjectRecord> record =
        BuildInto(store.database(), "object", mesh, SmallTiles(), [&](const BuildProgress&) {
          return calls++ == cancel_at ? Status(StatusCode::kCancelled, "enough") : Status::Ok();
        });
    if (record.ok()) {
      REQUIRE(cancel_at > 4);  // read, join, rounds, root, publish
      REQUIRE(record->digest_hex() == digest);
      break;
    }
    REQUIRE(calls == cancel_at + 1);  // not called again
    REQUIRE(record.status().code() == StatusCode::kCancelled);
    REQUIRE(record.status().message() == "enough");
    REQUIRE(store.database().List().value().size() == 1);
  }
  CheckReport report;
  REQUIRE(VerifyStore(store.path(), "", &report).ok());
  REQUIRE(report.ok());
}

TEST_CASE("Progress grows from 0 to 1 and names its stages in order") {
  const TriangleMesh mesh = MakeSculpture(60000);
  BuildOptions options;
  options.tile_triangles = 256;
  TempStore store;
  double last = 0;
  std::vector<std::string> stages;
  const Result<ObjectRecord> record =
      BuildInto(store.database(), "object", mesh, options, [&](const BuildProgress& p) {
        CHECK(p.overall >= last);
        CHECK(p.overall <= 1);
        CHECK(p.triangles_done <= p.triangles_total);
        CHECK((p.round != 0) == (std::string(p.stage) == "round"));
        last = p.overall;
        if (stages.empty() || stages.back() != p.stage) stages.emplace_back(p.stage);
        return Status::Ok();
      });
  REQUIRE(record.ok());
  REQUIRE(last == 1);
  REQUIRE(stages == std::vector<std::string>{"read", "join", "round", "root", "publish"});
}

TEST_CASE("An error of the writer is the build's error, whichever call fails") {
  const TriangleMesh mesh = MakeSculpture(6000);
  TempStore store;
  int fail_at = 0;
  for (;; fail_at += fail_at < 3 ? 1 : 3) {
    FailingWriter writer(store.database().Create("object", false).value(), fail_at);
    const Result<ObjectRecord> record = BuildObject(mesh, SmallTiles(), writer);
    REQUIRE(record.ok() == !writer.failed());
    if (record.ok()) break;
    REQUIRE(record.status().code() == StatusCode::kNoSpace);
    REQUIRE(record.status().message() == "the disk is full");
    REQUIRE(store.database().List().value().empty());
  }
  REQUIRE(fail_at > 10);
  REQUIRE(store.database().List().value().size() == 1);
}

}  // namespace mtdb::testing
