// SPDX-License-Identifier: Apache-2.0
// CroppedRaster: the middle of a raster, for experiments whose size is given.
#pragma once

#include <algorithm>
#include <array>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "codecs/raster_file/raster_file.h"

namespace mtdb {

class CroppedRaster final : public RasterReader {
 public:
  // At most `side` columns and rows.
  CroppedRaster(std::unique_ptr<RasterReader> whole, uint32_t side) : whole_(std::move(whole)) {
    path_ = whole_->path();
    info_ = whole_->info();
    RasterFrame& frame = info_.frame;
    row_.resize(frame.columns);
    first_column_ = (frame.columns - std::min(frame.columns, side)) / 2;
    first_row_ = (frame.rows - std::min(frame.rows, side)) / 2;
    frame.columns = std::min(frame.columns, side);
    frame.rows = std::min(frame.rows, side);
    std::array<double, 6>& g = frame.geotransform;
    g[0] += g[1] * first_column_ + g[2] * first_row_;
    g[3] += g[4] * first_column_ + g[5] * first_row_;
  }
  Status ReadRow(uint32_t row, std::span<double> heights) override {
    MTDB_RETURN_IF_ERROR(whole_->ReadRow(first_row_ + row, row_));
    std::copy_n(row_.begin() + first_column_, heights.size(), heights.begin());
    return Status::Ok();
  }

 private:
  std::unique_ptr<RasterReader> whole_;
  std::vector<double> row_;
  uint32_t first_column_ = 0, first_row_ = 0;
};

}  // namespace mtdb
