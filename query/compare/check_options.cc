// SPDX-License-Identifier: Apache-2.0
#include "query/compare/check_options.h"

#include <array>
#include <optional>
#include <string>

#include "store/metres_of_unit.h"

namespace mtdb::internal {
namespace {

constexpr double kStandardWidth = 1e-4;  // of the diagonal

Status CheckLength(const std::optional<double>& value, const char* name) {
  if (!value || (*value >= 0 && *value <= 1e30)) return Status::Ok();
  return InvalidArgument(std::string(name) + ": expected a length from 0 to 1e30, found " +
                         std::to_string(*value));
}

Status CheckSurface(const Surface& surface) {
  const std::array<double, 2> metres = MetresOfUnit(surface.record());
  if (metres[0] == 1 && metres[1] == 1) return Status::Ok();
  return InvalidArgument(surface.record().name +
                         ": its places are in degrees and its heights are not, so that it has no "
                         "distances in space; compare terrains in a projection with metres");
}

}  // namespace

Status CheckCompareOptions(const Surface& a, const Surface& b, const CompareOptions& options) {
  MTDB_RETURN_IF_ERROR(CheckLength(options.tolerance, "tolerance"));
  MTDB_RETURN_IF_ERROR(CheckLength(options.width, "width"));
  MTDB_RETURN_IF_ERROR(CheckLength(options.reach, "reach"));
  if (options.max_milliseconds && !(*options.max_milliseconds >= 0)) {
    return InvalidArgument("max_milliseconds: expected a number that is not negative");
  }
  if (!options.a_asks && !options.b_asks) {
    return InvalidArgument("compare: neither surface asks; let one of them");
  }
  MTDB_RETURN_IF_ERROR(CheckSurface(a));
  return CheckSurface(b);
}

double StandardWidth(const Side& a, const Side& b) {
  Box3d around = a.bounds();
  around.Add(b.bounds());
  return kStandardWidth * Diagonal(around);
}

}  // namespace mtdb::internal
