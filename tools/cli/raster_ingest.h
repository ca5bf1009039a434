// SPDX-License-Identifier: Apache-2.0
// RasterIngest: rasters as the input of an ingest.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "builder/build.h"
#include "codecs/raster_file/raster_mosaic.h"
#include "tools/cli/verbs.h"
#include "tools/client/json.h"

namespace mtdb {

// Whether the path names a raster: by its suffix, of mtdb's own formats or of common ones that GDAL
// reads; and it is no mesh.
bool IsRaster(const std::string& path);

// The joined raster of the inputs, while it is read. Stays where it is.
class RasterIngest {
 public:
  // Null when the inputs are no rasters. Errors: those of the readers; kBadInput when only some
  // inputs are rasters, when they cannot be joined, or when heights are no multiples of a known
  // step and --step-z is not given; kInvalidArgument for options that rasters do not take.
  // `memory_bytes` is what the whole ingest may take.
  static Result<std::unique_ptr<RasterIngest>> Open(const IngestArguments& arguments,
                                                    uint64_t memory_bytes);

  // What the builder needs to know. The raster must outlive the build.
  TerrainInput terrain();
  Status Read(MeshSink& sink) { return SendRaster(mosaic_, mesh_, sink, &report_); }
  // After Read(): how many holes, and where files disagree.
  std::vector<std::string> Notes() const;
  Json ReportJson() const;
  // What the rasters are like, before they are read.
  void Print(const std::string& name) const;
  Json InfoJson() const;

 private:
  RasterIngest(RasterMosaic mosaic, RasterMeshOptions mesh, size_t files)
      : mosaic_(std::move(mosaic)), mesh_(mesh), files_(files) {}

  RasterMosaic mosaic_;
  const RasterMeshOptions mesh_;
  const size_t files_;
  RasterMeshReport report_;
};

}  // namespace mtdb
