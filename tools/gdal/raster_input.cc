// SPDX-License-Identifier: Apache-2.0
#include "tools/gdal/raster_input.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <set>
#include <sys/stat.h>

#include "codecs/mesh_file/mesh_file.h"
#include "codecs/raster_file/height_step.h"
#include "codecs/raster_file/raster_file.h"
#include "tools/gdal/gdal_raster.h"

namespace mtdb {

namespace {

// Of a row: heights as they come and as they are joined, two rows of vertex numbers, a mask.
constexpr uint64_t kSampleBytes = 32;

// Files that are rasters by their names, whoever reads them.
bool HasRasterSuffix(const std::string& path) {
  static const std::set<std::string> kSuffixes{
      ".hgt", ".asc", ".dem", ".tif", ".tiff", ".vrt", ".img", ".adf", ".bil", ".flt",
      ".dt0", ".dt1", ".dt2", ".grd", ".nc",   ".bag", ".jp2", ".bt",  ".ter"};
  std::filesystem::path name(path);
  if (name.extension() == ".gz") name.replace_extension();  // to be refused as what it is
  std::string suffix = name.extension().string();
  for (char& c : suffix) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return kSuffixes.contains(suffix);
}

}  // namespace

bool IsRaster(const std::string& path) {
  if (path == "-" || !HasRasterSuffix(path)) return false;
  return path.ends_with(".gz") || !IsMeshFile(path);
}

Result<std::unique_ptr<RasterReader>> OpenRaster(const std::string& path, uint64_t cache_bytes) {
  // To open a pipe would wait for who writes to it. Folders are rasters of some formats of GDAL.
  struct stat info {};
  if (::stat(path.c_str(), &info) == 0 && !S_ISREG(info.st_mode) && !S_ISDIR(info.st_mode)) {
    return IoError(path + ": is not a regular file; copy it to one");
  }
  Result<std::unique_ptr<RasterReader>> own = OpenOwnRaster(path);
  if (own.status().code() != StatusCode::kUnsupported) return own;
  return OpenGdalRaster(path, cache_bytes);
}

Result<std::unique_ptr<RasterInput>> RasterInput::Join(
    std::vector<std::unique_ptr<RasterReader>> files, const RasterInputOptions& options) {
  if (files.empty()) return InvalidArgument("no raster is given");
  const size_t count = files.size();
  const std::string first = files[0]->path();
  MTDB_ASSIGN_OR_RETURN(RasterMosaic mosaic, RasterMosaic::Join(std::move(files)));
  const RasterInfo& info = mosaic.info();
  const uint32_t fill = std::min(options.fill, std::max(info.frame.columns, info.frame.rows));
  uint64_t row_bytes = info.frame.columns * kSampleBytes;
  if (fill != 0) row_bytes += HoleFiller::MemoryBytes(info.frame.columns, fill);
  if (row_bytes > options.memory_bytes / 4) {
    return InvalidArgument(
        first + ": rows of " + std::to_string(info.frame.columns) + " samples" +
        (fill != 0 ? ", " + std::to_string(fill) + " of them at a time to close holes," : "") +
        " do not fit a quarter of the memory; allow at least --memory " +
        std::to_string((row_bytes >> 18) + 1) + "M");
  }
  RasterMeshOptions mesh;
  mesh.fill = fill;
  mesh.height_step = options.height_step.value_or(info.height_step);
  mesh.height_origin = info.height_origin;
  HeightStepReason reason =
      options.height_step ? HeightStepReason::kGiven : HeightStepReason::kFile;
  if (!(mesh.height_step > 0)) {
    const Result<HeightStep> chosen = ChooseHeightStep(mosaic);
    if (!chosen.ok()) {
      const Status& status = chosen.status();
      const bool named = status.message().starts_with(first) || count > 1;
      return named ? status : Status(status.code(), first + ": " + status.message());
    }
    mesh.height_step = chosen->step;
    mesh.height_origin = chosen->origin;
    reason = chosen->decimals ? HeightStepReason::kDecimals : HeightStepReason::kChosen;
  }
  return std::unique_ptr<RasterInput>(new RasterInput(std::move(mosaic), mesh, reason, count));
}

const char* HeightStepReasonName(HeightStepReason reason) {
  switch (reason) {
    case HeightStepReason::kGiven: return "given";
    case HeightStepReason::kFile: return "file";
    case HeightStepReason::kDecimals: return "decimals";
    case HeightStepReason::kChosen: return "chosen";
  }
  return "";
}

const char* HeightStepReasonText(HeightStepReason reason) {
  switch (reason) {
    case HeightStepReason::kGiven: return "as the options say";
    case HeightStepReason::kFile: return "as the file has them";
    case HeightStepReason::kDecimals: return "the decimals that they are written with";
    case HeightStepReason::kChosen:
      return "a fiftieth of the usual difference between neighbours, a five hundredth of the "
             "range, "
             "or less";
  }
  return "";
}

TerrainInput RasterInput::terrain() {
  TerrainInput terrain;
  terrain.frame = mosaic_.info().frame;
  terrain.crs = mosaic_.info().crs;
  terrain.grid = GridOf(terrain.frame, mesh_.height_step, mesh_.height_origin);
  terrain.reading = [this] {
    return TerrainInput::Reading{report_.rounding, report_.filled.samples, report_.holes};
  };
  return terrain;
}

}  // namespace mtdb
