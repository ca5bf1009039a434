// SPDX-License-Identifier: Apache-2.0
// Places on the ellipsoid of WGS 84, which globes are drawn on.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

#include "store/base/geometry.h"

namespace mtdb {

inline constexpr double kEarthRadius = 6378137;  // half of the longest axis, in metres
inline constexpr double kEarthFlattening = 1 / 298.257223563;
inline constexpr double kEarthSquaredEccentricity = kEarthFlattening * (2 - kEarthFlattening);
inline constexpr double kRadOfDegree = std::numbers::pi / 180;

// Degrees, and metres above the ellipsoid.
struct GlobePlace {
  double longitude = 0, latitude = 0, height = 0;
};

// A longitude or latitude.
struct GlobeDirection {
  double sin = 0, cos = 1;
  GlobeDirection() = default;
  explicit GlobeDirection(double degrees)
      : sin(std::sin(degrees * kRadOfDegree)), cos(std::cos(degrees * kRadOfDegree)) {}
};

// Earth-centred, earth-fixed: x through longitude 0, z through the north pole, in metres.
inline Vec3d EarthCentred(const GlobeDirection& longitude, const GlobeDirection& latitude,
                          double height) {
  const double s = latitude.sin, c = latitude.cos;
  const double n = kEarthRadius / std::sqrt(1 - kEarthSquaredEccentricity * s * s);
  return {(n + height) * c * longitude.cos, (n + height) * c * longitude.sin,
          (n * (1 - kEarthSquaredEccentricity) + height) * s};
}
inline Vec3d EarthCentred(const GlobePlace& place) {
  return EarthCentred(GlobeDirection(place.longitude), GlobeDirection(place.latitude),
                      place.height);
}

// The other way round; not at the poles' axis.
inline GlobePlace PlaceOnGlobe(Vec3d p) {
  constexpr int kSteps = 6;  // each leaves some hundredth of the error
  const double across = std::hypot(p.x, p.y);
  double lat = std::atan2(p.z, across * (1 - kEarthSquaredEccentricity)), height = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double s = std::sin(lat);
    const double n = kEarthRadius / std::sqrt(1 - kEarthSquaredEccentricity * s * s);
    height = across / std::cos(lat) - n;
    lat = std::atan2(p.z, across * (1 - kEarthSquaredEccentricity * n / (n + height)));
  }
  return {std::atan2(p.y, p.x) / kRadOfDegree, lat / kRadOfDegree, height};
}

// East, north and up at a place.
struct LocalFrame {
  Vec3d origin;  // earth-centred
  Vec3d east, north, up;

  explicit LocalFrame(const GlobePlace& place)
      : LocalFrame(GlobeDirection(place.longitude), GlobeDirection(place.latitude), place.height) {}
  LocalFrame(const GlobeDirection& lon, const GlobeDirection& lat, double height)
      : origin(EarthCentred(lon, lat, height)),
        east{-lon.sin, lon.cos, 0},
        north{-lat.sin * lon.cos, -lat.sin * lon.sin, lat.cos},
        up{lat.cos * lon.cos, lat.cos * lon.sin, lat.sin} {}
  Vec3d FromEarth(Vec3d p) const {
    const Vec3d d = p - origin;
    return {Dot(d, east), Dot(d, north), Dot(d, up)};
  }
  // Of a direction.
  Vec3d ToEarth(Vec3d d) const { return east * d.x + north * d.y + up * d.z; }
};

}  // namespace mtdb
