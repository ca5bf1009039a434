// SPDX-License-Identifier: Apache-2.0
#include "builder/rounds/tile_job.h"

namespace mtdb::internal {

TileOutcome DoTile(const TileJob& job, TileDecimator& decimator) {
  const TileSetting& setting = *job.setting;
  const TileSurface& beneath = job.beneath.surface;
  const DecimateOptions options{
      job.limits,
      {beneath.empty() ? nullptr : &beneath, setting.border ? &*setting.border : nullptr}};
  const TileResult result = decimator.Decimate(job.tile.triangles, setting.grid, options);
  TileOutcome outcome;
  outcome.cluster = MakeTileCluster(job.tile, result, setting.grid, setting.attributes,
                                    {job.beneath.goes_on_from, options.surface});
  outcome.cluster.entry.round = static_cast<uint8_t>(job.round);
  outcome.cluster.entry.hilbert = job.hilbert;
  outcome.locked_vertices = result.locked_vertices;
  outcome.seam_vertices = result.seam_vertices;
  outcome.stuck_topology = result.stuck_topology;
  outcome.stuck_degree = result.stuck_degree;
  return outcome;
}

}  // namespace mtdb::internal
