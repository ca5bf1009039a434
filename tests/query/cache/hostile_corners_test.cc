// SPDX-License-Identifier: Apache-2.0
// Bytes of corners that nobody wrote: an error, or corners that are there.
#include <catch2/catch.hpp>

#include "codecs/cluster/cluster_codec.h"
#include "codecs/cluster/root_codec.h"
#include "query/cache/cluster_cache.h"
#include "tests/builder/fixture.h"
#include "tests/textures/charted_mesh.h"

namespace mtdb::testing {
namespace {

void CheckCorners(const Cluster& cluster) {
  REQUIRE(cluster.in.corner_places.size() == cluster.slots());
  for (const auto& places : cluster.in.corner_places) {
    for (const uint32_t place : places) REQUIRE(place < cluster.in.corners.size());
  }
  for (const TextureCorner& corner : cluster.in.corners) {
    REQUIRE(std::isfinite(corner.u));
    REQUIRE(std::isfinite(corner.v));
  }
}

}  // namespace

TEST_CASE("Flipped bits of textured units are errors, or corners that are there") {
  BuildOptions options;
  options.tile_triangles = 256;
  const BuiltObject built = Build(MakeCharted(Charting::kViews, 40, 20, 0.5, 8), options);
  const Surface& surface = *built.surface;
  const ClusterIndex& index = surface.index();
  const double step = built.record.texture->step;
  std::mt19937 random(1);
  LoadStats stats;
  size_t errors = 0, decoded = 0;
  for (UnitId unit = 0; unit < index.unit_count(); ++unit) {
    const LoadedUnitPtr loaded = surface.cache().Get(unit, &stats).value();
    Bytes payload;
    REQUIRE(ReadUnits(*surface.source(), {&unit, 1}, [&](UnitId, const Bytes& bytes) {
              payload = bytes;
              return Status::Ok();
            }).ok());
    const bool root = unit >= index.cluster_count();
    const auto decode = [&](ByteSpan bytes) {
      if (root) return DecodeRootPiece(bytes, {}, index.root_vertices(), "test", step);
      InPatch in = loaded->cluster.in_patch(0);
      in.corner_step = step;
      return DecodeCluster(bytes, std::move(in), {}, loaded->nodes(), "test");
    };
    const Result<Cluster> whole = decode(payload);
    REQUIRE(whole.ok());
    CheckCorners(*whole);
    for (int i = 0; i < 200; ++i) {
      Bytes bytes = payload;
      bytes[random() % bytes.size()] ^= static_cast<std::byte>(1 << random() % 8);
      if (i % 10 == 0) bytes.resize(random() % bytes.size());
      const Result<Cluster> changed = decode(bytes);
      changed.ok() ? ++decoded : ++errors;
      if (changed.ok()) CheckCorners(*changed);
    }
  }
  CHECK(errors > 0);
  CHECK(decoded > 0);
}

}  // namespace mtdb::testing
