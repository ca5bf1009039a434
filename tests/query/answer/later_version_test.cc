// SPDX-License-Identifier: Apache-2.0
// Payloads with a stream that this program does not know.
#include <catch2/catch.hpp>

#include "query/surface.h"
#include "query/verify_object.h"
#include "tests/query/mt_fixture.h"

namespace mtdb::testing {

TEST_CASE("A payload with an unknown stream that must be understood is refused by name") {
  for (const bool root : {false, true}) {
    const MtFixture f = MakeMt({});
    Bytes& payload = root ? f.source->root_payloads()[0] : f.source->payloads_[0];
    payload[1] = std::byte{0xf0};  // the first stream's tag, after the number of streams
    const auto surface = Surface::Open(f.source).value();
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    const Status status = surface->Extract(Query{}, sink).status();
    INFO(status.message());
    REQUIRE(status.code() == StatusCode::kUnsupported);
    const std::string unit = root ? "root piece 0" : "cluster 0";
    REQUIRE(status.message().find(unit) != std::string::npos);
    REQUIRE(status.message().find("240") != std::string::npos);
    REQUIRE(mesh.triangles.empty());
    CheckReport report;
    REQUIRE(VerifyObject(*surface, VerifyLevel::kFull, &report).ok());
    REQUIRE_FALSE(report.ok());
    REQUIRE(report.failures[0].find(unit) != std::string::npos);
  }
}

}  // namespace mtdb::testing
