/* SPDX-License-Identifier: Apache-2.0 */
/* mtdb for C: the heights of terrains. Begin with mtdb.h, whose rules hold here. Coordinates are
 * those of the raster that was ingested, heights in its units. Functions are MTDB_INVALID_ARGUMENT
 * for objects that are no terrains. */
#ifndef MTDB_TOOLS_C_MTDB_TERRAIN_H
#define MTDB_TOOLS_C_MTDB_TERRAIN_H

#include "tools/c/mtdb_write.h"

#ifdef __cplusplus
extern "C" {
#endif

/* NOLINTBEGIN(readability-identifier-naming) */

/* Terrains from rasters. */

/* Files of heights: .hgt, .asc and .dem; all that GDAL reads, where mtdb was built with it. Several
 * of one grid become one object; where they overlap the first one wins. Without
 * options.height_step integers and decimals stay as they are, and other heights are rounded by at
 * most a thousandth of their range and a hundredth of the usual difference between neighbours.
 * Errors: as mtdb_ingest_arrays; MTDB_UNSUPPORTED for a format that nothing here reads. */
MTDB_API mtdb_code mtdb_ingest_rasters(mtdb_database* database, const char* name,
                                       const char* const* paths, size_t count,
                                       const mtdb_ingest_options* options, const mtdb_watch* watch,
                                       mtdb_error* error);
/* Heights in the caller's array, which is read during the call. */
typedef struct mtdb_height_array {
  size_t struct_bytes;
  uint32_t columns, rows;
  const double* heights; /* row after row; NAN: a hole */
  /* x = g[0] + g[1] * column + g[2] * row, y = g[3] + g[4] * column + g[5] * row, of a sample; all
   * 0: x is the column, y the row less than 0, as rows of pictures go down */
  double geotransform[6];
  const char* crs;          /* WKT2, or anything; NULL: not known */
  const char* height_units; /* NULL: not known */
} mtdb_height_array;
/* Steps of heights are found as by mtdb_ingest_rasters. */
MTDB_API mtdb_code mtdb_ingest_heights(mtdb_database* database, const char* name,
                                       const mtdb_height_array* array,
                                       const mtdb_ingest_options* options, const mtdb_watch* watch,
                                       mtdb_error* error);

/* Heights from terrains. */

/* What an answer took, and how good it is. */
typedef struct mtdb_height_cost {
  size_t struct_bytes;
  double error_bound; /* no height is farther from the input's */
  uint64_t clusters_read;
  uint64_t bytes_read;
} mtdb_height_cost;

/* The heights at `count` places, `points` as x y x y ...; NAN where there is a hole, and outside.
 * `options` and `cost` may be NULL. */
MTDB_API mtdb_code mtdb_find_heights(mtdb_object* object, const double* points, size_t count,
                                     const mtdb_probe_options* options, double* heights,
                                     mtdb_height_cost* cost, mtdb_error* error);

/* Samples at x = x0 + column * dx, y = y0 + row * dy. */
typedef struct mtdb_raster {
  size_t struct_bytes;
  double x0, y0; /* the first sample */
  double dx, dy;
  uint32_t columns, rows;
} mtdb_raster;
/* The samples of the raster that was ingested, or others that are spacing[0] apart in x and
 * spacing[1] in y (NULL: its own), in a window of least x and y, largest x and y (NULL: all).
 * Columns go east, rows south. MTDB_INVALID_ARGUMENT when none lies in the window. */
MTDB_API mtdb_code mtdb_get_raster(const mtdb_object* object, const double* window,
                                   const double* spacing, mtdb_raster* raster, mtdb_error* error);
/* The heights of all samples, row after row, NAN where there is none, into `heights` with room for
 * `count`. Memory besides: some MB. */
MTDB_API mtdb_code mtdb_sample_heights(mtdb_object* object, const mtdb_raster* raster,
                                       const mtdb_probe_options* options, double* heights,
                                       size_t count, mtdb_height_cost* cost, mtdb_error* error);

/* The heights along a line. */
typedef struct mtdb_profile mtdb_profile;
/* `corners`: two or more as x y x y ... */
MTDB_API mtdb_code mtdb_find_profile(mtdb_object* object, const double* corners, size_t count,
                                     const mtdb_probe_options* options, mtdb_profile** profile,
                                     mtdb_height_cost* cost, mtdb_error* error);
/* How many points it has: one for each corner, and for each crossing with an edge of the surface,
 * so that heights between two points are on a straight line. */
MTDB_API size_t mtdb_count_profile_points(const mtdb_profile* profile);
/* Four numbers a point: the distance from the first corner along the line, x, y, and the height;
 * NAN where a hole or the outside begins. They live as long as `profile`. */
MTDB_API const double* mtdb_get_profile_points(const mtdb_profile* profile);
MTDB_API void mtdb_free_profile(mtdb_profile* profile);

/* Heights of two terrains. */

typedef struct mtdb_height_change_options {
  size_t struct_bytes;
  int has_tolerance; /* not 0: is no height of b farther from that of a than `tolerance`? */
  double tolerance;
  int has_width; /* 0: without a tolerance 1/10,000 of the range of heights */
  double width;  /* rise and fall become known to within this, volumes to within this times area */
  int has_max_milliseconds;
  double max_milliseconds;
  const double* window;        /* least x and y, largest x and y; NULL: all */
  int as_stored;               /* not 0: stored heights are compared, not those before rounding */
  uint32_t threads;            /* 0: as many as the machine has */
  const mtdb_control* control; /* cancels */
} mtdb_height_change_options;
/* How much higher and lower b is than a, straight up and down, and the volumes of cut and fill
 * between them, with a proof. `json`: what docs/json.md says of mtdb/height_change/1, without
 * "seconds". `options` may be NULL. */
MTDB_API mtdb_code mtdb_compare_heights(mtdb_object* a, mtdb_object* b,
                                        const mtdb_height_change_options* options, mtdb_json** json,
                                        mtdb_error* error);

/* NOLINTEND(readability-identifier-naming) */

#ifdef __cplusplus
}
#endif

#endif
