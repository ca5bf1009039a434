// SPDX-License-Identifier: Apache-2.0
// What a raster is like, for people.
#pragma once

#include <string>

#include "store/base/raster_frame.h"

namespace mtdb {

// "201 x 201 samples, float32, each for a point".
std::string RasterSizeText(const RasterFrame& frame);
// "0.05 apart in x, 0.05 in y, the first at 0 10, the last at 10 0".
std::string SamplePlacesText(const RasterFrame& frame);

}  // namespace mtdb
