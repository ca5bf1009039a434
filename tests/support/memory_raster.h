// SPDX-License-Identifier: Apache-2.0
// MemoryRaster: a raster that a test makes, as files give it.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "codecs/raster_file/raster_mosaic.h"

namespace mtdb::testing {

constexpr double kHole = std::numeric_limits<double>::quiet_NaN();

class MemoryRaster final : public RasterReader {
 public:
  MemoryRaster(uint32_t columns, uint32_t rows, std::vector<double> heights)
      : heights_(std::move(heights)) {
    path_ = "memory";
    info_.frame.columns = columns;
    info_.frame.rows = rows;
    info_.frame.sample_type = "int16";
    info_.frame.transform_of_samples = true;
    info_.height_step = 1;
  }
  RasterInfo& info() { return info_; }
  Status ReadRow(uint32_t row, std::span<double> heights) override {
    const size_t columns = info_.frame.columns;
    std::copy_n(heights_.begin() + static_cast<std::ptrdiff_t>(row * columns), columns,
                heights.begin());
    return Status::Ok();
  }

 private:
  std::vector<double> heights_;
};

// Hills of whole metres with some roughness, row after row.
inline std::vector<double> MakeHeights(uint32_t columns, uint32_t rows, uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<double> heights;
  for (uint32_t r = 0; r < rows; ++r) {
    for (uint32_t c = 0; c < columns; ++c) {
      const double hills = 300 * std::sin(c / 17.0) * std::cos(r / 23.0) + 90 * std::sin(r / 5.0);
      heights.push_back(std::round(800 + hills + random() % 13));
    }
  }
  return heights;
}

inline RasterMosaic MosaicOf(std::unique_ptr<MemoryRaster> raster) {
  std::vector<std::unique_ptr<RasterReader>> files;
  files.push_back(std::move(raster));
  return *RasterMosaic::Join(std::move(files));
}

}  // namespace mtdb::testing
