// SPDX-License-Identifier: Apache-2.0
// The options of extract and render that say what is asked for, as a query.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "store/base/json.h"
#include "store/base/status.h"
#include "tools/request/arguments.h"

namespace mtdb {

// Parts of a query are as docs/query.md has them.
struct QueryOptions {
  bool full = false;
  std::optional<AskedError> error;
  std::optional<double> pixels;
  Json::Array errors_at;                    // thresholds by distance from a point
  std::optional<AskedError> error_outside;  // of the regions
  std::optional<uint64_t> triangles;
  std::optional<uint64_t> max_bytes;
  std::optional<double> max_milliseconds;
  bool normals = false;

  Json::Array regions;
  bool frustum = false;
  bool intersect = false;  // of the regions, not their union
  bool outside = false;
  bool clip = false;

  std::optional<Vec3d> eye, target, up;
  std::optional<double> fov;  // degrees
  std::optional<Extent> viewport;

  std::string file;  // with a query; then no region and no threshold

  bool has_camera() const { return eye && target; }
};

// An option of the command line, and parameter of the server, that is a region.
struct RegionOption {
  const char* name;  // "--box"
  const char* form;  // of its text, which `parse` turns into a part of a query
  Result<Json> (*parse)(const std::string& text);
  const char* description;
};
// As help lists them. An error of `parse` is kInvalidArgument and says what was expected.
std::span<const RegionOption> RegionOptions();
// Likewise the text of a threshold by distance.
Result<Json> ErrorAtOption(const std::string& text);

// Finds options that lack others or do not go with them. `draws`: the camera alone is of use.
// Errors are kInvalidArgument and begin with the option.
Status CheckOptions(const QueryOptions& options, bool draws);
// The camera of options that have one. Without a viewport of their own, it is `viewport`.
Json CameraOf(const QueryOptions& options, const Extent& viewport);
// A text that is a query. Errors: those of ParseQuery.
Result<Json> ParseQueryText(const std::string& text);
// What the options ask for, as QueryFromJson takes it. Reads `file`. Errors: kNotFound, kIoError,
// kInvalidArgument.
Result<Json> QueryOf(const QueryOptions& options, const Extent& viewport);

}  // namespace mtdb
