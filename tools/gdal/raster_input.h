// SPDX-License-Identifier: Apache-2.0
// RasterInput: rasters of heights as the input of an ingest.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "builder/build.h"
#include "codecs/raster_file/raster_mosaic.h"

namespace mtdb {

// Whether the path names a raster: by its suffix, of mtdb's own formats or of common ones that GDAL
// reads; and it is no mesh.
bool IsRaster(const std::string& path);
// Opens a raster that mtdb reads by itself, or GDAL. GDAL's cache takes at most `cache_bytes`.
Result<std::unique_ptr<RasterReader>> OpenRaster(const std::string& path, uint64_t cache_bytes);

struct RasterInputOptions {
  // Heights are rounded to its multiples; none: the files', or one that suits them.
  std::optional<double> height_step;
  uint32_t fill = 0;          // RasterMeshOptions::fill
  uint64_t memory_bytes = 0;  // of the ingest
};

// Where the step of heights is from.
enum class HeightStepReason {
  kGiven,     // by the options
  kFile,      // of the file: integers, decimals of a text
  kDecimals,  // floats that are decimals all the same
  kChosen     // see ChooseHeightStep
};
// "given", "file", "decimals", "chosen"
const char* HeightStepReasonName(HeightStepReason reason);
// For people: "as the files have them", ...
const char* HeightStepReasonText(HeightStepReason reason);

// Joined rasters, while they are ingested. Stays where it is.
class RasterInput {
 public:
  // Reads all heights once when neither options nor files have a step. Errors: those of the
  // readers; kBadInput when the rasters cannot be joined; kInvalidArgument when their rows take
  // more than a quarter of the memory.
  static Result<std::unique_ptr<RasterInput>> Join(std::vector<std::unique_ptr<RasterReader>> files,
                                                   const RasterInputOptions& options);

  // What the builder needs to know. The input must outlive the build.
  TerrainInput terrain();
  Status Read(MeshSink& sink) { return SendRaster(mosaic_, mesh_, sink, &report_); }

  const RasterInfo& info() const { return mosaic_.info(); }
  double height_step() const { return mesh_.height_step; }
  HeightStepReason height_step_reason() const { return reason_; }
  size_t files() const { return files_; }
  // After Read().
  const RasterMeshReport& report() const { return report_; }
  const RasterDisagreement& disagreement() const { return mosaic_.disagreement(); }

 private:
  RasterInput(RasterMosaic mosaic, RasterMeshOptions mesh, HeightStepReason reason, size_t files)
      : mosaic_(std::move(mosaic)), mesh_(mesh), reason_(reason), files_(files) {}

  RasterMosaic mosaic_;
  const RasterMeshOptions mesh_;
  const HeightStepReason reason_;
  const size_t files_;
  RasterMeshReport report_;
};

}  // namespace mtdb
