// SPDX-License-Identifier: Apache-2.0
#include "builder/intake/check_options.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "codecs/cluster/cluster_limits.h"
#include "store/base/attribute_grid.h"

namespace mtdb::internal {

namespace {

constexpr int kMaxGridBits = 24;
constexpr uint64_t kLeastMemory = uint64_t{256} << 20;

// What is kept for those who draw the object.
Status CheckUpAndUnits(const BuildOptions& options) {
  if (options.up) {
    const double length = Length(*options.up);
    if (!(length > 0) || !std::isfinite(length)) {
      return InvalidArgument("up: must be a vector other than 0");
    }
    const bool z = options.up->x == 0 && options.up->y == 0 && options.up->z > 0;
    if ((options.terrain || options.height_field) && !z) {
      return InvalidArgument("up: of a terrain it is z");
    }
  }
  if (options.units.empty()) return Status::Ok();
  if (options.terrain) {
    return InvalidArgument("units: a raster's file says what its heights and places are in");
  }
  if (std::ranges::find(kLengthUnits, options.units) != kLengthUnits.end()) return Status::Ok();
  std::string known;
  for (const std::string_view unit : kLengthUnits) {
    known += (known.empty() ? "" : ", ") + std::string(unit);
  }
  return InvalidArgument("units: expected one of " + known + ", found '" + options.units + "'");
}

}  // namespace

Status CheckBuildOptions(const BuildOptions& options) {
  MTDB_RETURN_IF_ERROR(CheckUpAndUnits(options));
  if (options.bits && (*options.bits < 1 || *options.bits > kMaxGridBits)) {
    return InvalidArgument("bits " + std::to_string(*options.bits) + ": must be 1 to 24");
  }
  if (options.step && !(*options.step > 0 && std::isfinite(*options.step))) {
    return InvalidArgument("step: must be a positive number of model units");
  }
  if (options.weld && !(*options.weld >= 0 && std::isfinite(*options.weld))) {
    return InvalidArgument("weld: must be a number of model units, 0 or more");
  }
  if (options.terrain && options.orient) {
    return InvalidArgument("orient: a raster's triangles all look up");
  }
  const bool placed = options.bits || options.step || options.weld;
  if (options.terrain && (placed || options.mode != PositionMode::kGrid)) {
    return InvalidArgument(
        "a raster's samples lie where they are: it takes no bits, step, welding or float32 "
        "positions; --height-step rounds heights");
  }
  if (options.height_field && (options.terrain || options.mode != PositionMode::kGrid)) {
    return InvalidArgument(
        "a mesh that becomes a terrain (--terrain) lies on a grid: --step or --bits, not "
        "--lossless");
  }
  if (options.degree_limit < 4 || options.degree_limit > 16) {
    return InvalidArgument("degree limit " + std::to_string(options.degree_limit) +
                           ": must be 4 to 16");
  }
  if (options.tile_triangles < 64 || options.tile_triangles > kMostTileTriangles ||
      options.reduction < 2) {
    return InvalidArgument("tiles: 64 to " + std::to_string(kMostTileTriangles) +
                           " triangles, reduced at least twofold");
  }
  if (options.normal_bits &&
      (*options.normal_bits < kMinNormalBits || *options.normal_bits > kMaxNormalBits)) {
    return InvalidArgument("normals of " + std::to_string(*options.normal_bits) +
                           " bits: must be 4 to 16");
  }
  for (const AttributeStep& step : options.attribute_steps) {
    if (!(step.step > 0 && std::isfinite(step.step))) {
      return InvalidArgument("step of attribute " + step.name + ": must be a positive number");
    }
  }
  if (options.texture_step && !(*options.texture_step >= 0 && *options.texture_step <= 1)) {
    return InvalidArgument("texture step: must be a number from 0 to 1");
  }
  if (options.memory_bytes < kLeastMemory) {
    return InvalidArgument("memory: at least 256 MiB are needed, " +
                           std::to_string(options.memory_bytes >> 20) + " MiB are allowed");
  }
  return Status::Ok();
}

}  // namespace mtdb::internal
