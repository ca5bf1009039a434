// SPDX-License-Identifier: Apache-2.0
#include "codecs/cluster/cluster_codec.h"

#include <catch2/catch.hpp>
#include <random>

#include "codecs/coding/patch.h"
#include "tests/codecs/cluster_fixture.h"

namespace mtdb {
namespace {

using testing::ClusterFixture;
using testing::ClusterOptions;
using testing::MakeCluster;
using testing::MakeIn;
using testing::Numbers;
using testing::Surface;

struct Case {
  const char* name;
  ClusterOptions options;
  // Bytes of the payload. A change is a change of the format, of its models or of the fixture.
  size_t payload_bytes;
};

const Case kCases[] = {
    {"torus", {}, 1596},
    {"sheet", {.surface = Surface::kSheet, .seed = 2}, 1535},
    {"pierced sheet", {.surface = Surface::kSheet, .pierced = true, .seed = 3}, 1552},
    {"no children", {.children = 0, .seed = 4}, 1555},
    {"many children", {.children = 20, .seed = 5}, 1768},
    {"lossless", {.surface = Surface::kSheet, .numbers = Numbers::kLossless, .seed = 6}, 3794},
    {"wild numbers", {.numbers = Numbers::kWild, .seed = 7}, 4342},
    {"coinciding positions", {.numbers = Numbers::kCoincident, .seed = 8}, 2554},
    {"attributes", {.attributes = true, .seed = 9}, 8333},
    {"rounded attributes", {.rounded_attributes = true, .seed = 12}, 3695},
    {"a single node", {.side = 4, .keep = 0.94, .seed = 10}, 82},
    {"terrain", {.surface = Surface::kTerrain, .side = 24, .seed = 13}, 977},
    {"full terrain", {.surface = Surface::kTerrain, .side = 24, .keep = 0, .seed = 14}, 1298},
    {"terrain by another rule",
     {.surface = Surface::kOtherTerrain, .side = 24, .keep = 0.9, .seed = 15},
     305},
    {"a larger sheet", {.surface = Surface::kSheet, .side = 60, .seed = 11}, 12273},
    {"a book", {.surface = Surface::kBook, .seed = 16}, 2128},
    {"five pages",
     {.surface = Surface::kBook, .pages = 5, .attributes = true, .keep = 0.1, .seed = 17},
     23917},
    {"fifteen pages",
     {.surface = Surface::kBook,
      .side = 12,
      .pages = 15,
      .attributes = true,
      .keep = 0.1,
      .seed = 18},
     24016},
};

Result<Cluster> Decode(const ClusterFixture& fixture, const EncodedCluster& encoded,
                       ByteSpan payload) {
  return DecodeCluster(payload, MakeIn(fixture, encoded), fixture.attributes,
                       static_cast<uint32_t>(fixture.updates.nodes.size()), "test");
}

TEST_CASE("a cluster comes back as it was, in a pinned number of bytes") {
  for (const Case& c : kCases) {
    INFO(c.name);
    const ClusterFixture fixture = MakeCluster(c.options);
    const EncodedCluster encoded = EncodeCluster(fixture.updates, fixture.attributes);
    const Result<Cluster> cluster = Decode(fixture, encoded, encoded.payload);
    INFO((cluster.ok() ? "" : cluster.status().message()));
    REQUIRE(cluster.ok());
    REQUIRE(Difference(fixture, encoded, *cluster) == "");
    CHECK(encoded.payload.size() == c.payload_bytes);
  }
}

TEST_CASE("a decoded cluster encodes to the same bytes") {
  for (const Case& c : kCases) {
    INFO(c.name);
    const ClusterFixture fixture = MakeCluster(c.options);
    const EncodedCluster encoded = EncodeCluster(fixture.updates, fixture.attributes);
    if (encoded.explicit_arcs) continue;  // the order of in-triangles is the first encoder's choice
    const Result<Cluster> cluster = Decode(fixture, encoded, encoded.payload);
    REQUIRE(cluster.ok());
    const ClusterUpdates updates = UpdatesOf(*cluster, fixture.updates.is_height_field);
    REQUIRE((EncodeCluster(updates, fixture.attributes).payload == encoded.payload));
  }
}

TEST_CASE("clusters of terrains have holes on the lattice where the Delaunay rule made them") {
  constexpr uint8_t kLattice = 8;
  const auto flags = [](const ClusterOptions& options) {
    const ClusterFixture fixture = MakeCluster(options);
    const Bytes payload = EncodeCluster(fixture.updates, fixture.attributes).payload;
    ByteReader reader(payload);
    uint64_t before = 0;  // bytes of streams that lie before the head
    bool found = false;
    for (uint64_t streams = reader.GetVarint(); streams > 0; --streams) {
      found = found || reader.Get<uint8_t>() == 0x80;
      const uint64_t raw = reader.GetVarint();
      const uint64_t frame = reader.GetVarint();
      if (!found) before += frame == 0 ? raw : frame;
    }
    return static_cast<uint8_t>(reader.GetBytes(before + 1)[before]);
  };
  REQUIRE((flags({.surface = Surface::kTerrain, .side = 24, .seed = 13}) & kLattice) != 0);
  // Too few vertices for so many points.
  REQUIRE((flags({.surface = Surface::kTerrain, .side = 60, .keep = 0.995}) & kLattice) == 0);
  REQUIRE((flags({.surface = Surface::kOtherTerrain, .side = 24, .keep = 0.9}) & kLattice) == 0);
  REQUIRE((flags({.surface = Surface::kSheet}) & kLattice) == 0);
}

TEST_CASE("explicit arcs name slot and rotation of the child") {
  const ClusterFixture fixture = MakeCluster({.numbers = Numbers::kCoincident, .seed = 8});
  const EncodedCluster encoded = EncodeCluster(fixture.updates, fixture.attributes);
  REQUIRE(encoded.explicit_arcs);
  const Result<Cluster> cluster = Decode(fixture, encoded, encoded.payload);
  REQUIRE(cluster.ok());
  size_t arcs = 0;
  for (uint32_t s = cluster->in_triangles(); s < cluster->slots(); ++s) {
    arcs += RemovedByChild(cluster->removers[s]);
  }
  REQUIRE(cluster->explicit_arcs.size() == arcs);
}

TEST_CASE("every truncated prefix of a payload is refused") {
  for (const Case& c : kCases) {
    INFO(c.name);
    if (c.options.side > 30) continue;
    const ClusterFixture fixture = MakeCluster(c.options);
    const EncodedCluster encoded = EncodeCluster(fixture.updates, fixture.attributes);
    for (size_t n = 0; n < encoded.payload.size(); ++n) {
      REQUIRE_FALSE(Decode(fixture, encoded, ByteSpan(encoded.payload).first(n)).ok());
    }
  }
}

TEST_CASE("flipped bytes give an error or a cluster, never a crash") {
  std::mt19937 random(5);
  for (const Case& c : kCases) {
    INFO(c.name);
    if (c.options.side > 30) continue;
    const ClusterFixture fixture = MakeCluster(c.options);
    const EncodedCluster encoded = EncodeCluster(fixture.updates, fixture.attributes);
    size_t accepted = 0;
    constexpr size_t kTries = 600;
    for (size_t i = 0; i < kTries; ++i) {
      Bytes payload = encoded.payload;
      for (uint32_t flips = 1 + random() % 3; flips > 0; --flips) {
        payload[random() % payload.size()] ^= static_cast<std::byte>(1 + random() % 255);
      }
      const Result<Cluster> cluster = Decode(fixture, encoded, payload);
      if (!cluster.ok()) continue;
      ++accepted;
      REQUIRE(cluster->nodes() <= fixture.updates.nodes.size());
      REQUIRE(cluster->ring_vertices.size() <= size_t{kMaxRing} * cluster->nodes());
    }
    // The end state of each stream is 32 bits of check; only plain bytes and raw bits can pass.
    REQUIRE(accepted < kTries / 2);
  }
}

TEST_CASE("more nodes than the index says are refused") {
  const ClusterFixture fixture = MakeCluster({});
  const EncodedCluster encoded = EncodeCluster(fixture.updates, fixture.attributes);
  const auto nodes = static_cast<uint32_t>(fixture.updates.nodes.size());
  REQUIRE_FALSE(
      DecodeCluster(encoded.payload, MakeIn(fixture, encoded), {}, nodes - 1, "test").ok());
}

TEST_CASE("a stream of a later version is skipped or refused, as its tag says") {
  const ClusterFixture fixture = MakeCluster({.children = 0});
  const EncodedCluster encoded = EncodeCluster(fixture.updates, fixture.attributes);
  // One more stream of one byte, listed first and stored first.
  for (const uint8_t tag : {uint8_t{0x30}, uint8_t{0xf0}}) {
    ByteReader reader(encoded.payload);
    const uint64_t count = reader.GetVarint();
    ByteWriter longer;
    longer.PutVarint(count + 1);
    longer.Put(tag);
    longer.PutVarint(1);
    longer.PutVarint(0);
    for (uint64_t i = 0; i < count; ++i) {
      longer.Put(reader.Get<uint8_t>());
      longer.PutVarint(reader.GetVarint());
      longer.PutVarint(reader.GetVarint());
    }
    longer.Put<uint8_t>(0x55);
    longer.PutBytes(reader.GetBytes(reader.remaining()));
    const Result<Cluster> cluster = Decode(fixture, encoded, longer.bytes());
    REQUIRE(cluster.ok() == (tag < 0x80));
    if (!cluster.ok()) REQUIRE(cluster.status().code() == StatusCode::kUnsupported);
  }
}

// The example of codecs/FORMAT.md: a vertex in a triangle.
TEST_CASE("the worked example of the format has these bytes") {
  ClusterFixture fixture;
  ClusterUpdates& u = fixture.updates;
  u.positions = {{0, 0, 0}, {300, 0, 0}, {0, 300, 0}, {110, 90, 20}};
  u.triangles = {{3, 0, 1}, {3, 1, 2}, {3, 2, 0}, {0, 1, 2}};
  u.consumers.resize(4);
  u.consumers[1].child = 7;
  ClusterUpdates::Node node;
  node.vertex = 3;
  node.error_code = 68;
  node.hole_begin = 0;
  node.hole_count = 1;
  node.star_begin = 0;
  node.star_count = 3;
  u.nodes = {node};
  u.holes = {3};
  u.stars = {0, 1, 2};
  const EncodedCluster encoded = EncodeCluster(u, {});
  std::string hex;
  for (const std::byte b : encoded.payload) {
    constexpr char kDigits[] = "0123456789abcdef";
    hex += kDigits[static_cast<uint8_t>(b) >> 4];
    hex += kDigits[static_cast<uint8_t>(b) & 15];
  }
  CHECK(hex ==
        "05800500811000822000830300840800"
        "0210010107"
        "36000000f800039d0000000000000080"
        "41000000847f1004020000005a17ff4f0200000080002770020000004cf04b88"
        "4474012f0000002dcd4c4c");
  const Result<Cluster> cluster = Decode(fixture, encoded, encoded.payload);
  REQUIRE(cluster.ok());
  REQUIRE(Difference(fixture, encoded, *cluster) == "");
}

}  // namespace
}  // namespace mtdb
