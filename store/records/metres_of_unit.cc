// SPDX-License-Identifier: Apache-2.0
#include "store/metres_of_unit.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

namespace mtdb {

std::array<double, 2> MetresOfUnit(const ObjectRecord& record) {
  constexpr double kMetresOfADegree = 111'195;
  const std::string& crs = record.georeference;
  if (!record.raster || !(crs.starts_with("GEOG") || crs.starts_with("GEODCRS"))) return {1, 1};
  const double latitude = (record.bounds.min.y + record.bounds.max.y) / 2;
  const double shrunk = std::max(std::cos(latitude * std::numbers::pi / 180), 1e-3);
  return {kMetresOfADegree * shrunk, kMetresOfADegree};
}

}  // namespace mtdb
