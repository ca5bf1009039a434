// SPDX-License-Identifier: Apache-2.0
#include "store/base/raster_frame.h"

namespace mtdb {

bool RasterFrame::is_flipped() const {
  const auto& g = geotransform;
  return g[1] * g[5] - g[2] * g[4] < 0;
}

Grid GridOf(const RasterFrame& frame, double height_step, double height_origin) {
  const auto& g = frame.geotransform;
  const double half = frame.transform_of_samples ? 0 : 0.5;
  // Row (lattice row 0) and the sense in which rows count.
  const double first = frame.is_flipped() ? frame.rows - 1 + half : half;
  const double sense = frame.is_flipped() ? -1 : 1;
  Grid grid;
  grid.mode = PositionMode::kRaster;
  grid.origin = {g[0] + g[1] * half + g[2] * first, g[3] + g[4] * half + g[5] * first,
                 height_origin};
  grid.plane = {g[1], sense * g[2], g[4], sense * g[5]};
  grid.step = height_step;
  grid.error_unit = height_step / 16;
  return grid;
}

}  // namespace mtdb
