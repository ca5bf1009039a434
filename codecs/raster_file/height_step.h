// SPDX-License-Identifier: Apache-2.0
// ChooseHeightStep: to which multiples the heights of a raster of floats are rounded.
#pragma once

#include "codecs/raster_file/raster_mosaic.h"

namespace mtdb {

struct HeightStep {
  double step = 0;  // > 0; heights are rounded to its multiples from `origin`
  double origin = 0;
  bool decimals = false;  // the heights are written with so many decimals, and stay as they are
};

// Reads all rows once. Where all heights are decimal numbers with up to nine digits after the
// point, be it as binary32, the step is their last digit, and no height is rounded. Else it is the
// largest of 1, 2, 5 times a power of ten with which rounding moves no height by more than a
// thousandth of the heights' range, nor by more than a hundredth of the usual difference between
// neighbours (the lesser of mean and median, those that are 0 left out), but not below what
// binary32 itself can tell where the file has that. Errors: those of the reader; kBadInput without
// a height. Memory: two rows.
Result<HeightStep> ChooseHeightStep(RasterMosaic& raster);

}  // namespace mtdb
