// The example of codecs/FORMAT.md, byte for byte, and what happens to bytes that are not it.
#include <catch2/catch.hpp>
#include <random>

#include "codecs/cluster_codec.h"

namespace mtdb::testing {

namespace {

const std::array<Vec3i, 3> kCorners = {Vec3i{0, 0, 0}, Vec3i{6, 0, 0}, Vec3i{0, 6, 0}};

// One node that splits the triangle of kCorners.
ClusterUpdates Example() {
  ClusterUpdates updates;
  updates.positions = {kCorners[0], kCorners[1], kCorners[2], {2, 2, 1}};
  updates.triangles = {{0, 1, 2}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
  updates.consumers.resize(4);
  updates.holes = {0};
  updates.stars = {1, 2, 3};
  updates.nodes.push_back({3, false, 5, 0, 1, 0, 3});
  return updates;
}

InPatch ExamplePatch() {
  std::vector<InTriangle> in(1);
  in[0].vertices = {10, 11, 12};
  in[0].positions = kCorners;
  REQUIRE(SortCanonically(in));
  return MakeInPatch(in);
}

Result<Cluster> Decode(ByteSpan payload) {
  return DecodeCluster(payload, ExamplePatch(), {}, 1, "example");
}

}  // namespace

TEST_CASE("The format's example is what the codec writes and reads") {
  const std::vector<uint8_t> expected = {0x06, 0x80, 0x03, 0x00, 0x81, 0x01, 0x00, 0x83, 0x01,
                                         0x00, 0x84, 0x03, 0x00, 0x85, 0x03, 0x00, 0x87, 0x03,
                                         0x00, 0x00, 0x01, 0x00, 0x00, 0x05, 0x00, 0x00, 0x02,
                                         0x00, 0x00, 0x00, 0x00, 0x00, 0x00};
  const EncodedCluster encoded = EncodeCluster(Example(), {});
  const auto* bytes = reinterpret_cast<const uint8_t*>(encoded.payload.data());
  REQUIRE(std::vector<uint8_t>(bytes, bytes + encoded.payload.size()) == expected);
  REQUIRE(encoded.out_triangles == 3);
  REQUIRE(encoded.external_vertices == 3);
  const Result<Cluster> cluster = Decode(encoded.payload);
  REQUIRE(cluster.ok());
  REQUIRE(cluster->nodes() == 1);
  REQUIRE(cluster->error_codes[0] == 5);
  REQUIRE(cluster->position(3) == Vec3i{2, 2, 1});
  REQUIRE(cluster->slots() == 4);
  REQUIRE(cluster->removers == std::vector<uint32_t>{0, kDrain, kDrain, kDrain});
}

TEST_CASE("Every prefix of a payload is refused") {
  const Bytes payload = EncodeCluster(Example(), {}).payload;
  for (size_t length = 0; length < payload.size(); ++length) {
    INFO(length);
    REQUIRE_FALSE(Decode(ByteSpan(payload).first(length)).ok());
  }
}

TEST_CASE("Damaged payloads give a cluster or an error, never more") {
  const Bytes payload = EncodeCluster(Example(), {}).payload;
  std::mt19937 random(3);
  for (int i = 0; i < 20000; ++i) {
    Bytes damaged = payload;
    for (uint32_t flips = 1 + random() % 3; flips > 0; --flips) {
      damaged[random() % damaged.size()] ^= static_cast<std::byte>(1 + random() % 255);
    }
    const Result<Cluster> cluster = Decode(damaged);
    if (cluster.ok()) REQUIRE(cluster->nodes() == 1);
  }
}

}  // namespace mtdb::testing
