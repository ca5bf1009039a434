// SPDX-License-Identifier: Apache-2.0
// Heights of a terrain: at a place, along a line, and on the samples of a raster.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "query/surface.h"
#include "store/metres_of_unit.h"

namespace mtdb {

// Whether the object is one: its errors are differences in height.
bool IsTerrain(const ObjectRecord& record);

struct HeightOptions {
  // The largest difference in height from the input that is good enough, in units of height.
  // Negative: only the full resolution is.
  double error_model = -1;
  // Lets other threads cancel (kCancelled). Must outlive the call. May be null.
  QueryControl* control = nullptr;
};

// What an answer took, and how good it is.
struct HeightCost {
  double error_bound = 0;  // no height is farther from the input's
  uint64_t clusters_read = 0;
  uint64_t bytes_read = 0;
};

struct HeightAnswer {
  std::optional<double> height;  // none: there is a hole, or the terrain does not reach there
  HeightCost cost;
};

// The height at (x, y), in the coordinates of the object. On a sample at full resolution it is the
// sample's height. Errors: kInvalidArgument (the object is no terrain; numbers that are not
// finite), those of reading clusters. Safe for many threads.
Result<HeightAnswer> FindHeight(const Surface& surface, double x, double y,
                                const HeightOptions& options = {});

// The heights at many places, in their order; `cost` (not null) is that of all. Places that are
// near each other share a query, whose error bound is theirs. Memory: the answers, and the
// triangles around some of them. Errors: as FindHeight.
Result<std::vector<HeightAnswer>> FindHeights(const Surface& surface,
                                              std::span<const std::array<double, 2>> places,
                                              const HeightOptions& options, HeightCost* cost);

struct ProfilePoint {
  double distance = 0;  // from the line's first corner along it, in units of x and y
  double x = 0, y = 0;
  std::optional<double> height;  // none: a hole, or the outside, begins here
};
struct Profile {
  std::vector<ProfilePoint> points;
  HeightCost cost;
};

// The heights along the line through `corners` (two or more, {x, y}): one point for each corner and
// for each crossing with an edge of the cut, so that heights between two points are on a straight
// line. Errors: as FindHeight; also for two equal corners in a row.
Result<Profile> FindProfile(const Surface& surface, std::span<const std::array<double, 2>> corners,
                            const HeightOptions& options = {});

// A raster's samples: x = x0 + column * dx, y = y0 + row * dy.
struct HeightRaster {
  double x0 = 0, y0 = 0;  // the first sample
  double dx = 1, dy = -1;
  uint32_t columns = 0, rows = 0;
};
// The samples of the raster that was ingested, or others, `spacing` apart in x and y, that lie in
// `window` (least x and y, largest x and y). Columns go east, rows south. Errors: kInvalidArgument
// (no terrain; one that was a mesh, or rows that run another way, without a spacing; no sample in
// the window; more than 2^28 columns or rows).
Result<HeightRaster> RasterSamples(const ObjectRecord& record,
                                   const std::optional<std::array<double, 4>>& window,
                                   const std::optional<std::array<double, 2>>& spacing);

// The heights of rows `begin` to `end` - 1, row after row; NaN where there is none. Memory: these
// heights and the triangles over them. Errors: as FindHeight.
Result<std::vector<double>> SampleHeights(const Surface& surface, const HeightRaster& raster,
                                          uint32_t begin, uint32_t end,
                                          const HeightOptions& options, HeightCost* cost);
// Likewise all rows, band after band: `visit` takes whole rows. Errors: also those of `visit`.
Status VisitHeights(const Surface& surface, const HeightRaster& raster,
                    const HeightOptions& options, HeightCost* cost,
                    const std::function<Status(std::span<const double> rows)>& visit);

}  // namespace mtdb
