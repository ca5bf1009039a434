// SPDX-License-Identifier: Apache-2.0
// Terrain: the files of a step's rasters, and the surface that they mean, sample by sample.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "tests/everything/step.h"

namespace mtdb::everything {

inline constexpr double kHole = std::numeric_limits<double>::quiet_NaN();

// Samples as they lie: rows from north to south.
struct Raster {
  uint32_t columns = 0, rows = 0;
  double cell = 1;
  double x0 = 0, y0 = 0;  // of the first sample, in the north-west
  std::vector<double> heights;

  double& At(uint32_t column, uint32_t row) { return heights[size_t{row} * columns + column]; }
  double At(uint32_t column, uint32_t row) const { return heights[size_t{row} * columns + column]; }
  bool Has(int64_t column, int64_t row) const {
    return column >= 0 && row >= 0 && column < columns && row < rows &&
           !std::isnan(At(static_cast<uint32_t>(column), static_cast<uint32_t>(row)));
  }
};

struct Terrain {
  // Column and row of a sample.
  using Sample = std::array<uint32_t, 2>;
  using Triangle = std::array<Sample, 3>;

  Raster raster;  // the files joined, heights as they are stored
  Raster given;   // likewise as the files have them
  std::vector<std::string> files;
  std::string step_z;          // that ingest is told; empty: none
  std::vector<Sample> filled;  // samples that --fill gives a height, which follows from the others
  uint64_t larger_holes = 0;   // that it leaves
  double rounding = 0;         // that --height-step made
  double lowest = 0, highest = 0;
  double tolerance = 0;                    // of what is written as text
  std::vector<std::array<double, 4>> rim;  // edges with one triangle: x y x y
  bool has_holes = false;                  // then borders move

  // The triangles of the cell that begins with this sample in the north-west: none, one or two,
  // counterclockwise from above. The diagonal runs from south-east to north-west, unless one of
  // these has no height.
  std::vector<Triangle> TrianglesOf(int64_t column, int64_t row) const;
  // A sample of which no triangle is a corner is no part of the surface.
  bool Covers(int64_t column, int64_t row) const;
  bool HasSurface() const;
  double X(const Sample& s) const { return raster.x0 + s[0] * raster.cell; }
  double Y(const Sample& s) const { return raster.y0 - s[1] * raster.cell; }
  // Heights of the surface at a place, of all triangles that it touches within `slack` of a cell:
  // as it is stored, or as it was given.
  std::vector<double> HeightsAt(double x, double y, double slack, bool as_given) const;
  // How far a place is from the border, with x and y in units of so many metres.
  double ToBorder(double x, double y, const std::array<double, 2>& metres) const;
};

// Writes the files of the step into the folder. What `rim` and the others say is of all of them.
Terrain MakeTerrain(const Step& step, const std::string& folder);
// Whether GDAL's tools are there, and mtdb was built with it.
bool HasGdal();
// What `extract` wrote as .asc; without rows: it cannot be read.
Raster ReadAscii(const std::string& path);
// From 0 to 1.
double Uniform(std::mt19937_64& random);

}  // namespace mtdb::everything
