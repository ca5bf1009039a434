// SPDX-License-Identifier: Apache-2.0
// GlobeGrid: the tiles of all levels that clients divide a globe into.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "tools/tiles/places/geodesy.h"

namespace mtdb {

inline constexpr double kMercatorLatitude = 85.051128779806604;
// What Cesium computes of the ellipsoid, of 65 samples a tile, and of a quality of a quarter, for
// one tile at level 0.
inline constexpr double kErrorOfOneTile = kEarthRadius * 2 * std::numbers::pi * 0.25 / 65;

// Degrees: west, south, east, north.
struct GlobeRectangle {
  double west = 0, south = 0, east = 0, north = 0;
};

// Of a latitude in degrees, so that 180 degrees are a square's half side; and back.
inline double MercatorOf(double latitude) {
  return std::asinh(std::tan(latitude * kRadOfDegree)) / kRadOfDegree;
}
inline double LatitudeOf(double mercator) {
  return std::atan(std::sinh(mercator * kRadOfDegree)) / kRadOfDegree;
}

// The tiles of all levels: x from the west, y from the south.
class GlobeGrid {
 public:
  explicit GlobeGrid(bool mercator) : mercator_(mercator) {}
  bool mercator() const { return mercator_; }
  // What clients take for the level's error, in metres.
  double error(uint32_t level) const {
    return std::ldexp(kErrorOfOneTile / (mercator_ ? 1 : 2), -static_cast<int>(level));
  }
  // Of a side of a tile, in degrees of longitude.
  double side(uint32_t level) const {
    return std::ldexp(mercator_ ? 360.0 : 180.0, -static_cast<int>(level));
  }
  std::array<uint32_t, 2> counts(uint32_t level) const {
    return {(mercator_ ? 1u : 2u) << level, 1u << level};
  }
  double West(uint32_t level, uint32_t x) const { return side(level) * x - 180; }
  double South(uint32_t level, uint32_t y) const {
    return mercator_ ? LatitudeOf(side(level) * y - 180) : side(level) * y - 90;
  }
  GlobeRectangle Rectangle(uint32_t level, uint32_t x, uint32_t y) const {
    return {West(level, x), South(level, y), West(level, x + 1), South(level, y + 1)};
  }
  uint32_t Column(uint32_t level, double longitude) const {
    return Clamp((longitude + 180) / side(level), counts(level)[0]);
  }
  uint32_t Row(uint32_t level, double latitude) const {
    const double from_south =
        mercator_ ? MercatorOf(std::clamp(latitude, -kMercatorLatitude, kMercatorLatitude)) + 180
                  : latitude + 90;
    return Clamp(from_south / side(level), counts(level)[1]);
  }

 private:
  static uint32_t Clamp(double at, uint32_t count) {
    return static_cast<uint32_t>(std::clamp(std::floor(at), 0.0, count - 1.0));
  }
  bool mercator_;
};

}  // namespace mtdb
