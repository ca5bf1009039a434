// SPDX-License-Identifier: Apache-2.0
#include "builder/rounds/tile_job.h"

namespace mtdb::internal {

Status PrepareTile(const SurfaceWindow& surfaces, TileJob& job) {
  MTDB_ASSIGN_OR_RETURN(job.beneath, surfaces.Beneath(job.tile.triangles));
  const TileSurface& beneath = job.beneath.surface;
  const Grid& grid = job.setting->grid;
  // Where the image of what vanishes would be is not known.
  if (job.setting->is_height_field || job.setting->texture) return Status::Ok();
  if (!beneath.empty() && HasManyCrumbs(job.tile.triangles)) job.beneath = surfaces.Afresh();
  const CrumbLimits limits{job.limits.crumb_error, beneath.own};
  if (limits.fresh()) JoinSheets(job.tile.triangles);
  job.crumbs = RemoveCrumbs(grid, limits, job.tile, &job.vanished);
  if (job.crumbs.empty()) return Status::Ok();
  if (limits.fresh()) {
    JoinSheets(job.tile.triangles);
    return Status::Ok();
  }
  MTDB_ASSIGN_OR_RETURN(job.beneath, surfaces.Beneath(job.tile.triangles));
  return Status::Ok();
}

TileOutcome DoTile(const TileJob& job, TileDecimator& decimator) {
  const TileSetting& setting = *job.setting;
  const TileSurface& beneath = job.beneath.surface;
  const DecimateOptions options{
      job.limits,
      {beneath.empty() ? nullptr : &beneath, setting.border ? &*setting.border : nullptr,
       setting.texture ? &job.tile : nullptr, setting.row_bytes(),
       setting.texture ? setting.texture->scale : 0}};
  const TileResult result = decimator.Decimate(job.tile.triangles, setting.grid, options);
  TileOutcome outcome;
  outcome.cluster = MakeTileCluster(job.tile, job.crumbs, result, setting.grid, setting.attributes,
                                    setting.texture, {job.beneath.goes_on_from, options.surface});
  outcome.cluster.entry.round = static_cast<uint8_t>(job.round);
  outcome.cluster.entry.hilbert = job.hilbert;
  outcome.vanished_components = job.vanished.components;
  outcome.vanished_border_loops = job.vanished.border_loops;
  outcome.locked_vertices = result.locked_vertices;
  outcome.seam_vertices = result.seam_vertices;
  outcome.stuck_topology = result.stuck_topology;
  outcome.stuck_degree = result.stuck_degree;
  return outcome;
}

}  // namespace mtdb::internal
