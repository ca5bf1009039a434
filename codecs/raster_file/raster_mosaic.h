// SPDX-License-Identifier: Apache-2.0
// RasterMosaic: several rasters of one regular grid as one; SendRaster: a raster as a mesh.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "codecs/raster_file/hole_filler.h"
#include "codecs/raster_file/raster_file.h"
#include "store/base/mesh_sink.h"

namespace mtdb {

// Samples that several files give, and not alike.
struct RasterDisagreement {
  uint64_t overlapping = 0;  // samples that more than one file gives
  uint64_t samples = 0;      // those of them that differ
  double largest = 0;        // by how much at most
  friend bool operator==(const RasterDisagreement&, const RasterDisagreement&) = default;
};

// Where files overlap, the first one that has a height wins. Single thread.
class RasterMosaic {
 public:
  // kBadInput, naming both files, when their samples are not on one grid, or when their coordinate
  // systems or the units of heights differ; also for a geotransform that gives samples no places of
  // their own.
  static Result<RasterMosaic> Join(std::vector<std::unique_ptr<RasterReader>> files);

  // Of the whole: the first file's, but for size, geotransform and height step. Where the files'
  // nodata values differ it has none, and where their types do it is of float64.
  const RasterInfo& info() const { return info_; }
  // As RasterReader::ReadRow.
  Status ReadRow(uint32_t row, std::span<double> heights);
  // Of all rows that were read since row 0 was.
  const RasterDisagreement& disagreement() const { return disagreement_; }

 private:
  struct Part {
    std::unique_ptr<RasterReader> file;
    uint32_t column = 0, row = 0;  // of its first sample in the whole
  };
  RasterInfo info_;
  std::vector<Part> parts_;
  std::vector<double> row_;
  RasterDisagreement disagreement_;
};

struct RasterMeshOptions {
  double height_step = 1;  // > 0
  double height_origin = 0;
  uint32_t fill = 0;  // closes holes of up to so many columns and rows (HoleFiller); 0: none
};
struct RasterMeshReport {
  uint64_t samples = 0;  // that have a height
  uint64_t holes = 0;    // that have none
  HoleFillReport filled;
  double rounding = 0;  // how far a height was moved to a multiple of the step, at most
};

// Sends the triangles between the raster's samples through `sink`: the Delaunay triangulation of
// the samples, with ties broken as codecs/FORMAT.md says, so that each cell has the same diagonal.
// A cell with three samples is one triangle; one with fewer is a hole. Positions are integers:
// column, RasterFrame::LatticeRow and steps of height. Memory: two rows. kBadInput when no cell has
// three samples, or a height is 2^30 steps or more from the origin.
Status SendRaster(RasterMosaic& raster, const RasterMeshOptions& options, MeshSink& sink,
                  RasterMeshReport* report);

}  // namespace mtdb
