// SPDX-License-Identifier: Apache-2.0
#include "builder/rounds/tile_job.h"

#include <catch2/catch.hpp>

#include "builder/decimate/decimator.h"
#include "tests/builder/fixture.h"
#include "tests/builder/rounds.h"

namespace mtdb::testing {

using namespace internal;

TEST_CASE("A tile's job answers the same, whoever does it, and whatever it has done before") {
  const Rounds rounds(MakeSculpture(4000), 3);
  const TileSetting setting{rounds.grid, {}, {}, {}};
  TileJob job;
  job.setting = &setting;
  job.round = 2;
  job.tile.triangles = rounds.after;
  job.beneath = {GatherSurface(rounds.surfaces, rounds.after).value(), 1};
  job.limits.target_triangles = static_cast<uint32_t>(rounds.after.size() / 4);
  job.limits.largest_error = 1e9;
  REQUIRE(!job.beneath.surface.empty());
  SurfaceDecimator used;
  used.FirstGuesses(rounds.before, rounds.grid);
  const TileOutcome first = DoTile(job, used);
  REQUIRE(!first.cluster.empty);
  REQUIRE(!first.cluster.surface.empty());
  const TileOutcome again = DoTile(job, used);
  const TileJob sent = job;  // its numbers and bytes are all that is needed elsewhere
  SurfaceDecimator fresh;
  const TileOutcome elsewhere = DoTile(sent, fresh);
  for (const TileOutcome* other : {&again, &elsewhere}) {
    REQUIRE(other->cluster.encoded.payload == first.cluster.encoded.payload);
    REQUIRE(other->cluster.surface == first.cluster.surface);
    REQUIRE(other->cluster.left.triangles.size() == first.cluster.left.triangles.size());
    REQUIRE(other->locked_vertices == first.locked_vertices);
  }
}

}  // namespace mtdb::testing
