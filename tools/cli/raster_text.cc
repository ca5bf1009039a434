// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/raster_text.h"

#include <array>
#include <cmath>
#include <cstdio>

#include "tools/client/printable.h"

namespace mtdb {
namespace {

// With all digits that the number was written with, most often.
std::string Digits(double value) {
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "%.15g", value);
  return text.data();
}

std::string PlaceText(const RasterFrame& f, double column, double row) {
  const auto& g = f.geotransform;
  const double half = f.transform_of_samples ? 0 : 0.5;
  const double c = column + half, r = row + half;
  return Digits(g[0] + g[1] * c + g[2] * r) + " " + Digits(g[3] + g[4] * c + g[5] * r);
}

}  // namespace

std::string RasterSizeText(const RasterFrame& f) {
  return std::to_string(f.columns) + " x " + std::to_string(f.rows) + " samples, " +
         Printable(f.sample_type) + ", each for " + (f.is_area ? "its pixel" : "a point");
}

std::string SamplePlacesText(const RasterFrame& f) {
  const auto& g = f.geotransform;
  const bool turned = g[2] != 0 || g[4] != 0;
  return Digits(std::hypot(g[1], g[4])) + " apart " + (turned ? "along rows, " : "in x, ") +
         Digits(std::hypot(g[2], g[5])) + (turned ? " along columns" : " in y") +
         ", the first at " + PlaceText(f, 0, 0) + ", the last at " +
         PlaceText(f, f.columns - 1.0, f.rows - 1.0);
}

}  // namespace mtdb
