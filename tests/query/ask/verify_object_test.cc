// SPDX-License-Identifier: Apache-2.0
#include "query/verify_object.h"

#include <catch2/catch.hpp>

#include "tests/query/mt_fixture.h"

namespace mtdb::testing {
namespace {

CheckReport Verify(const MtFixture& f) {
  CheckReport report;
  SurfaceOptions options;
  options.cache_bytes = 100000;
  const auto surface = Surface::Open(f.source, options).value();
  REQUIRE(VerifyObject(*surface, VerifyLevel::kFull, &report).ok());
  REQUIRE(VerifyObject(*surface, VerifyLevel::kGlobal, &report).ok());
  return report;
}

}  // namespace

TEST_CASE("A sound object passes every check") {
  for (uint32_t seed = 0; seed < 8; ++seed) {
    MtOptions o;
    o.shape = static_cast<Shape>(seed % 4);
    o.coincident = seed >= 4;
    o.resolution = 16;
    o.tiles = 8;
    o.seed = seed;
    const CheckReport report = Verify(MakeMt(o));
    INFO((report.failures.empty() ? std::string() : report.failures[0]));
    REQUIRE(report.ok());
    REQUIRE(report.checks.size() == 5);
  }
}

TEST_CASE("A record that says something else fails, field by field") {
  MtOptions o;
  o.shape = Shape::kSheet;
  o.resolution = 16;
  o.tiles = 8;
  const MtFixture f = MakeMt(o);
  const ObjectRecord record = f.source->record_;
  const std::vector<std::function<void(ObjectRecord&)>> changes = {
      [](ObjectRecord& r) { --r.vertices; },
      [](ObjectRecord& r) { ++r.triangles; },
      [](ObjectRecord& r) { ++r.root_triangles; },
      [](ObjectRecord& r) { ++r.max_degree; },
      [](ObjectRecord& r) { ++r.depth; },
      [](ObjectRecord& r) { ++r.error_code_max; },
      [](ObjectRecord& r) { r.bounds.max.x += 1; },
      [](ObjectRecord& r) { ++r.surface_digest; },
      [](ObjectRecord& r) { ++r.border_digest; },
      [](ObjectRecord& r) { ++r.boundary_edges; },
      [](ObjectRecord& r) { ++r.euler_characteristic; },
  };
  for (const auto& change : changes) {
    f.source->record_ = record;
    change(f.source->record_);
    REQUIRE(!Verify(f).ok());
  }
}

TEST_CASE("A cluster that does not decode is reported once") {
  MtOptions o;
  o.resolution = 16;
  o.tiles = 8;
  const MtFixture f = MakeMt(o);
  f.source->cluster_payloads().back().resize(3);  // coarsest: others descend from it
  CheckReport report;
  const auto surface = Surface::Open(f.source).value();
  REQUIRE(VerifyObject(*surface, VerifyLevel::kFull, &report).ok());
  REQUIRE(report.failures.size() == 1);
  REQUIRE(report.failures[0].find("fixture: cluster") != std::string::npos);
}

}  // namespace mtdb::testing
