// SPDX-License-Identifier: Apache-2.0
// RasterIngest: rasters as the input of an ingest.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "store/base/json.h"
#include "tools/cli/verbs/ingest_arguments.h"
#include "tools/gdal/raster_input.h"

namespace mtdb {

// kBadInput for an input that is a picture (PNG, JPEG), whose pixels are neither a mesh nor
// heights.
Status CheckNoPicture(const std::vector<std::string>& inputs);
// kBadInput for an input that is a file of mtdb itself.
Status CheckNoStore(const std::vector<std::string>& inputs);

// The joined raster of the inputs, while it is read. Stays where it is.
class RasterIngest {
 public:
  // Null when the inputs are no rasters. Errors: those of the readers; kBadInput when only some
  // inputs are rasters, or when they cannot be joined; kInvalidArgument for options that rasters do
  // not take. `memory_bytes` is what the whole ingest may take.
  static Result<std::unique_ptr<RasterIngest>> Open(const IngestArguments& arguments,
                                                    uint64_t memory_bytes);

  // What the builder needs to know. The raster must outlive the build.
  TerrainInput terrain() { return input_->terrain(); }
  Status Read(MeshSink& sink) { return input_->Read(sink); }
  // After Read(): how many holes, and where files disagree.
  std::vector<std::string> Notes() const;
  Json ReportJson() const;
  // What the rasters are like, before they are read.
  void Print(const std::string& name) const;
  Json InfoJson() const;

 private:
  explicit RasterIngest(std::unique_ptr<RasterInput> input) : input_(std::move(input)) {}

  const std::unique_ptr<RasterInput> input_;
};

}  // namespace mtdb
