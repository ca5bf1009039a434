// SPDX-License-Identifier: Apache-2.0
// Terrains from C: rasters in, heights out.
#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "query/heights.h"
#include "tools/c/internal/handles.h"
#include "tools/c/internal/ingest.h"
#include "tools/c/mtdb_terrain.h"
#include "tools/gdal/raster_input.h"

// NOLINTNEXTLINE(readability-identifier-naming)
struct mtdb_profile {
  std::vector<std::array<double, 4>> points;
};

namespace mtdb::internal {

namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr uint32_t kMostSide = 1u << 28;

Status PutCost(const HeightCost& cost, mtdb_height_cost* out) {
  if (out == nullptr) return Status::Ok();
  mtdb_height_cost filled{};
  filled.error_bound = cost.error_bound;
  filled.clusters_read = cost.clusters_read;
  filled.bytes_read = cost.bytes_read;
  return PutStruct(filled, "cost", out);
}

std::vector<std::array<double, 2>> Places(const double* points, size_t count) {
  std::vector<std::array<double, 2>> places(count);
  for (size_t i = 0; i < count; ++i) places[i] = {points[2 * i], points[2 * i + 1]};
  return places;
}

Status HeightsAt(const Surface& surface, std::span<const std::array<double, 2>> places,
                 const HeightOptions& options, double* heights, HeightCost* cost) {
  MTDB_ASSIGN_OR_RETURN(const std::vector<HeightAnswer> answers,
                        FindHeights(surface, places, options, cost));
  for (size_t i = 0; i < answers.size(); ++i) heights[i] = answers[i].height.value_or(kNone);
  return Status::Ok();
}

// The caller's array as a raster.
class ArrayReader final : public RasterReader {
 public:
  explicit ArrayReader(const mtdb_height_array& array) : heights_(array.heights) {
    path_ = "heights";
    info_.format = "array";
    RasterFrame& f = info_.frame;
    f.columns = array.columns;
    f.rows = array.rows;
    std::copy(array.geotransform, array.geotransform + 6, f.geotransform.begin());
    if (std::all_of(array.geotransform, array.geotransform + 6, [](double v) { return v == 0; })) {
      f.geotransform = {0, 1, 0, 0, 0, -1};
    }
    f.transform_of_samples = true;
    f.is_area = false;
    if (array.height_units != nullptr) f.height_units = array.height_units;
    if (array.crs != nullptr) info_.crs = array.crs;
    const uint64_t count = uint64_t{f.columns} * f.rows;
    const bool whole = std::all_of(heights_, heights_ + count,
                                   [](double h) { return std::isnan(h) || h == std::round(h); });
    f.sample_type = whole ? "int32" : "float64";
    info_.height_step = whole ? 1 : 0;
  }
  Status ReadRow(uint32_t row, std::span<double> heights) override {
    std::copy_n(heights_ + uint64_t{row} * info_.frame.columns, heights.size(), heights.begin());
    return Status::Ok();
  }

 private:
  const double* const heights_;
};

uint64_t MemoryOf(const mtdb_ingest_options& options) {
  return options.memory_bytes != 0 ? options.memory_bytes : BuildOptions().memory_bytes;
}

// Joins the rasters and stores them.
Status IngestOpened(mtdb_database* database, const char* name,
                    std::vector<std::unique_ptr<RasterReader>> files,
                    const mtdb_ingest_options* options, const mtdb_watch* watch) {
  MTDB_ASSIGN_OR_RETURN(const mtdb_ingest_options given, Take(options, "options"));
  if (given.bits != 0 || given.step != 0 || given.lossless != 0 || given.weld != 0 ||
      given.orient != 0 || given.normal_bits != 0 || given.attribute_step_count != 0) {
    return InvalidArgument(
        "options: bits, step, lossless, weld, orient, normal_bits and attribute_steps are for "
        "meshes; a raster's samples lie where they are, and height_step says to which multiples "
        "heights are rounded");
  }
  std::optional<double> step;
  if (given.height_step != 0) {
    if (!(given.height_step > 0) || !std::isfinite(given.height_step)) {
      return InvalidArgument("options.height_step: expected a number above 0");
    }
    step = given.height_step;
  }
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<RasterInput> input,
                        RasterInput::Join(std::move(files), {step, given.fill, MemoryOf(given)}));
  return Ingest(
      database, name, [&](MeshSink& sink) { return input->Read(sink); }, options, watch,
      input->terrain());
}

}  // namespace

Status IngestRasters(mtdb_database* database, const char* name, const char* const* paths,
                     size_t count, const mtdb_ingest_options* options, const mtdb_watch* watch) {
  MTDB_RETURN_IF_ERROR(NeedAll({{paths, "paths"}}));
  MTDB_ASSIGN_OR_RETURN(const mtdb_ingest_options given, Take(options, "options"));
  std::vector<std::unique_ptr<RasterReader>> files;
  for (size_t i = 0; i < count; ++i) {
    MTDB_RETURN_IF_ERROR(NeedAll({{paths[i], "paths"}}));
    MTDB_ASSIGN_OR_RETURN(std::unique_ptr<RasterReader> file,
                          OpenRaster(paths[i], MemoryOf(given) / 8));
    files.push_back(std::move(file));
  }
  return IngestOpened(database, name, std::move(files), options, watch);
}

}  // namespace mtdb::internal

using mtdb::Status;
using mtdb::internal::Guarded;
using mtdb::internal::NeedAll;
using mtdb::internal::Take;

mtdb_code mtdb_ingest_rasters(mtdb_database* database, const char* name, const char* const* paths,
                              size_t count, const mtdb_ingest_options* options,
                              const mtdb_watch* watch, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    return mtdb::internal::IngestRasters(database, name, paths, count, options, watch);
  });
}

mtdb_code mtdb_ingest_heights(mtdb_database* database, const char* name,
                              const mtdb_height_array* array, const mtdb_ingest_options* options,
                              const mtdb_watch* watch, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{array, "array"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_height_array given, Take(array, "array"));
    MTDB_RETURN_IF_ERROR(NeedAll({{given.heights, "array.heights"}}));
    if (given.columns < 2 || given.rows < 2 || given.columns > mtdb::internal::kMostSide ||
        given.rows > mtdb::internal::kMostSide) {
      return mtdb::InvalidArgument("array: expected 2 to 2^28 columns and rows");
    }
    for (const double g : given.geotransform) {
      MTDB_RETURN_IF_ERROR(mtdb::internal::NeedFinite({g}, "array.geotransform"));
    }
    std::vector<std::unique_ptr<mtdb::RasterReader>> files;
    files.push_back(std::make_unique<mtdb::internal::ArrayReader>(given));
    return mtdb::internal::IngestOpened(database, name, std::move(files), options, watch);
  });
}

mtdb_code mtdb_find_heights(mtdb_object* object, const double* points, size_t count,
                            const mtdb_probe_options* options, double* heights,
                            mtdb_height_cost* cost, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}}));
    if (count > 0) MTDB_RETURN_IF_ERROR(NeedAll({{points, "points"}, {heights, "heights"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb::HeightOptions with,
                          mtdb::internal::ProbeOptionsOf<mtdb::HeightOptions>(options));
    mtdb::HeightCost told;
    MTDB_RETURN_IF_ERROR(mtdb::internal::HeightsAt(
        *object->surface, mtdb::internal::Places(points, count), with, heights, &told));
    return mtdb::internal::PutCost(told, cost);
  });
}

mtdb_code mtdb_get_raster(const mtdb_object* object, const double* window, const double* spacing,
                          mtdb_raster* raster, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}}));
    std::optional<std::array<double, 4>> within;
    std::optional<std::array<double, 2>> apart;
    if (window != nullptr) within = {window[0], window[1], window[2], window[3]};
    if (spacing != nullptr) apart = {spacing[0], spacing[1]};
    MTDB_ASSIGN_OR_RETURN(const mtdb::HeightRaster r,
                          mtdb::RasterSamples(object->surface->record(), within, apart));
    mtdb_raster filled{};
    filled.x0 = r.x0;
    filled.y0 = r.y0;
    filled.dx = r.dx;
    filled.dy = r.dy;
    filled.columns = r.columns;
    filled.rows = r.rows;
    return mtdb::internal::PutStruct(filled, "raster", raster);
  });
}

mtdb_code mtdb_sample_heights(mtdb_object* object, const mtdb_raster* raster,
                              const mtdb_probe_options* options, double* heights, size_t count,
                              mtdb_height_cost* cost, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {raster, "raster"}, {heights, "heights"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_raster given, Take(raster, "raster"));
    MTDB_ASSIGN_OR_RETURN(const mtdb::HeightOptions with,
                          mtdb::internal::ProbeOptionsOf<mtdb::HeightOptions>(options));
    MTDB_RETURN_IF_ERROR(
        mtdb::internal::NeedFinite({given.x0, given.y0, given.dx, given.dy}, "raster"));
    if (given.columns == 0 || given.rows == 0 || given.columns > mtdb::internal::kMostSide ||
        given.rows > mtdb::internal::kMostSide || given.dx == 0 || given.dy == 0) {
      return mtdb::InvalidArgument(
          "raster: expected 1 to 2^28 columns and rows, and steps that are not 0");
    }
    const uint64_t needed = uint64_t{given.columns} * given.rows;
    if (count < needed) {
      return Status(mtdb::StatusCode::kBudgetExceeded,
                    "heights: has room for " + std::to_string(count) + ", but the raster has " +
                        std::to_string(needed) + " samples");
    }
    const mtdb::HeightRaster samples{given.x0, given.y0,      given.dx,
                                     given.dy, given.columns, given.rows};
    mtdb::HeightCost told;
    MTDB_RETURN_IF_ERROR(mtdb::VisitHeights(
        *object->surface, samples, with, &told, [&](std::span<const double> rows) {
          heights = std::copy(rows.begin(), rows.end(), heights);
          return Status::Ok();
        }));
    return mtdb::internal::PutCost(told, cost);
  });
}

mtdb_code mtdb_find_profile(mtdb_object* object, const double* corners, size_t count,
                            const mtdb_probe_options* options, mtdb_profile** profile,
                            mtdb_height_cost* cost, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {corners, "corners"}, {profile, "profile"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb::HeightOptions with,
                          mtdb::internal::ProbeOptionsOf<mtdb::HeightOptions>(options));
    MTDB_ASSIGN_OR_RETURN(
        const mtdb::Profile found,
        mtdb::FindProfile(*object->surface, mtdb::internal::Places(corners, count), with));
    auto made = std::make_unique<mtdb_profile>();
    for (const mtdb::ProfilePoint& p : found.points) {
      made->points.push_back({p.distance, p.x, p.y, p.height.value_or(mtdb::internal::kNone)});
    }
    MTDB_RETURN_IF_ERROR(mtdb::internal::PutCost(found.cost, cost));
    *profile = made.release();
    return Status::Ok();
  });
}

size_t mtdb_count_profile_points(const mtdb_profile* profile) {
  return profile == nullptr ? 0 : profile->points.size();
}

const double* mtdb_get_profile_points(const mtdb_profile* profile) {
  return profile == nullptr || profile->points.empty() ? nullptr : profile->points.front().data();
}

void mtdb_free_profile(mtdb_profile* profile) { delete profile; }
